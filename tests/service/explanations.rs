//! Pages of explanations: every error and warning code of the program has one.

use crate::harness::{Call, Site, instant, one_worker};
use dvi::explanation::{Page, find, pages};
use dvi::service::http::Kind;
use dvi::solution::CheckCode;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Collects the source texts of the program. Tests, comments, the command-line commands and the web page are left
/// out.
fn sources(folder: &Path, found: &mut Vec<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if path.is_dir() && !["tests", "command", "page", "fixtures"].contains(&name) {
            sources(&path, found);
        } else if name.ends_with(".rs") && name != "tests.rs" {
            let text = fs::read_to_string(&path).unwrap();
            let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
            let lines = text.lines().filter(|line| !line.trim_start().starts_with("//"));
            found.push(lines.collect::<Vec<_>>().join("\n"));
        }
    }
}

/// Returns the expression at the beginning of `text`. It ends at an unmatched closing bracket or, unless it is the
/// body of a function, at a comma or semicolon outside of brackets.
fn expression(text: &str, is_body: bool) -> &str {
    let (mut depth, mut quoted, mut escaped) = (0, false, false);
    for (at, c) in text.char_indices() {
        match c {
            _ if escaped => escaped = false,
            '\\' if quoted => escaped = true,
            '"' => quoted = !quoted,
            _ if quoted => {}
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => {
                depth -= 1;
                if depth < 0 || (depth == 0 && is_body && c == '}') {
                    return &text[..at];
                }
            }
            ',' | ';' if depth == 0 && !is_body => return &text[..at],
            _ => {}
        }
    }
    text
}

/// Returns the error code at the beginning of `text`, if `text` begins with a string literal of a single word.
fn code(text: &str) -> Option<&str> {
    let (word, _) = text.trim_start().strip_prefix('"')?.split_once('"')?;
    let is_code = !word.is_empty() && word.bytes().all(|c| c.is_ascii_lowercase() || c == b'_');
    is_code.then_some(word)
}

/// Collects error codes that are passed as arguments to functions that create errors: arguments that consist of a
/// string literal.
fn among_arguments<'t>(text: &'t str, opener: &str, codes: &mut BTreeSet<&'t str>) {
    for rest in text.split(opener).skip(1) {
        let mut rest = rest;
        loop {
            let argument = expression(rest, false);
            if argument.trim().len() == code(argument).map_or(usize::MAX, |word| word.len() + 2) {
                codes.extend(code(argument));
            }
            match rest[argument.len()..].strip_prefix(',') {
                Some(next) => rest = next,
                None => break,
            }
        }
    }
}

/// Collects error codes that are returned as values: string literals at the beginning of an expression, or of a
/// branch, match arm or pair in it.
fn as_values<'t>(text: &'t str, opener: &str, is_body: bool, codes: &mut BTreeSet<&'t str>) {
    for rest in text.split(opener).skip(1) {
        let value = expression(rest, is_body);
        codes.extend(code(value));
        for before in ["=> ", "{ ", "{\n", "("] {
            codes.extend(value.split(before).skip(1).filter_map(code));
        }
    }
}

fn codes_of_sources(texts: &[String]) -> BTreeSet<&str> {
    let mut codes = BTreeSet::new();
    for text in texts {
        for opener in ["Error::new(", "Self::new(", ".report(", ".fail(", ".caveat(", "broken("] {
            among_arguments(text, opener, &mut codes);
        }
        for opener in ["{ code: ", " code: ", "let code = ", "let (code, message) = ", "let (code, message, near) = "] {
            as_values(text, opener, false, &mut codes);
        }
        for opener in ["fn code(&self) -> &'static str ", " -> Option<(&'static str, String)> "] {
            as_values(text, opener, true, &mut codes);
        }
    }
    codes
}

#[test]
fn every_code_in_the_sources_has_a_page() {
    let mut texts = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut texts);
    let codes = codes_of_sources(&texts);
    // Known error codes that the search must find, one for each way in which the sources write codes.
    for known in [
        "unknown_key",
        "wrong_arity",
        "reserved_name",
        "initial_jump",
        "newton_failed",
        "joints",
        "wall_time",
        "too_many_nodes",
    ] {
        assert!(codes.contains(known), "{known} is not among {codes:?}");
    }
    assert!(codes.len() > 140, "{}: {codes:?}", codes.len());
    let missing: Vec<_> = codes.iter().filter(|code| find(code).is_none()).collect();
    assert!(missing.is_empty(), "no page in src/explanation/pages for {missing:?}");
}

#[test]
fn every_refusal_and_every_reason_of_a_verdict_has_a_page() {
    let refusals = Kind::ALL.iter().map(|kind| kind.slug());
    for code in refusals.chain(CheckCode::ALL.into_iter().map(CheckCode::name)) {
        assert!(find(code).is_some(), "no page in src/explanation/pages for {code}");
    }
}

#[test]
fn no_page_explains_what_is_never_said() {
    let mut texts = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut texts);
    for Page { code, .. } in pages() {
        let (quoted, slug) = (format!("\"{code}\""), format!("\"{}\"", code.replace('_', "-")));
        assert!(texts.iter().any(|text| text.contains(&quoted) || text.contains(&slug)), "{code} is never said");
    }
}

#[tokio::test]
async fn the_type_of_every_problem_can_be_looked_up() {
    let site = Site::new(one_worker(), instant());
    let list = site.get("/problems").await.json();
    assert_eq!(list.as_array().unwrap().len(), pages().len());
    for row in list.as_array().unwrap() {
        assert_eq!(&site.get(row["type"].as_str().unwrap()).await.json(), row);
    }
    for kind in Kind::ALL {
        let row = site.get(&format!("/problems/{}", kind.slug())).await.json();
        assert_eq!(row["status"], kind.status().as_u16());
        assert_eq!((&row["title"], &row["type"]), (&kind.title().into(), &format!("/problems/{}", kind.slug()).into()));
    }
    site.get("/problems/none").await.problem(404, "no-such-problem");
}

/// Returns the addresses of explanation pages that are named in `text`.
fn addresses(text: &str) -> BTreeSet<String> {
    let is_part = |c: char| c.is_ascii_lowercase() || c == '_' || c == '-';
    let words = text.split("/problems/").skip(1).map(|rest| rest.split(|c| !is_part(c)).next().unwrap());
    words.filter(|word| !word.is_empty()).map(|word| format!("/problems/{word}")).collect()
}

#[tokio::test]
async fn every_page_of_a_code_that_is_named_anywhere_is_there_in_every_form() {
    let site = Site::new(one_worker(), instant());
    let mut texts = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut texts);
    let said = codes_of_sources(&texts).into_iter().map(str::to_owned);
    let told = pages().iter().map(|page| page.code.to_owned());
    let refusals = Kind::ALL.iter().map(|kind| kind.slug().to_owned());
    let checks = CheckCode::ALL.into_iter().map(|code| code.name().to_owned());
    let mut all: BTreeSet<String> =
        said.chain(told).chain(refusals).chain(checks).map(|code| format!("/problems/{code}")).collect();
    all.extend(addresses(&dvi::service::http::description().to_string()));
    let guide = site.get("/docs").await;
    let chapters = guide.text().split(" href=\"").skip(1).filter_map(|rest| rest.split(['"', '#']).next());
    let chapters: BTreeSet<&str> = chapters.filter(|href| href.starts_with("/docs/")).collect();
    assert!(chapters.len() > 5, "{chapters:?}");
    for page in chapters.into_iter().chain(["/", "/problems", "/docs"]) {
        let page = Call::new("GET", page).header("accept", "text/html").send(&site).await;
        all.extend(addresses(page.text()));
    }
    for page in pages() {
        let Page { meaning, why, remedy, example, .. } = page;
        [meaning, why, remedy, example].into_iter().for_each(|text| all.extend(addresses(text)));
    }
    assert!(all.len() > 200, "{}", all.len());
    for address in all {
        for accept in ["application/json", "text/html", "text/plain"] {
            let page = Call::new("GET", &address).header("accept", accept).send(&site).await;
            assert_eq!(page.status.as_u16(), 200, "{address} as {accept}");
        }
    }
}

#[tokio::test]
async fn a_page_comes_in_the_form_that_is_asked_for() {
    let site = Site::new(one_worker(), instant());
    let of = |accept: &'static str| Call::new("GET", "/problems/unknown_key").header("accept", accept).send(&site);
    let page = of("text/html").await;
    assert!(page.header("content-type").starts_with("text/html") && page.text().contains("<h1>unknown_key</h1>"));
    let text = of("text/plain").await;
    assert!(text.header("content-type").starts_with("text/plain") && text.text().contains("What to do: "));
    assert_eq!(of("application/json").await.json()["code"], "unknown_key");
    assert_eq!(of("text/html").await.header("vary"), "accept");
    of("image/png").await.problem(406, "not-acceptable");
}

#[test]
fn the_command_line_explains_too() {
    let explain = |arguments: &[&str]| Command::new(env!("CARGO_BIN_EXE_dvi")).arg("explain").args(arguments).output();
    let list = String::from_utf8(explain(&[]).unwrap().stdout).unwrap();
    assert!(pages().iter().all(|page| list.contains(&format!("  {} ", page.code))), "{list}");
    let page = String::from_utf8(explain(&["queue-full"]).unwrap().stdout).unwrap();
    assert!(page.starts_with("queue_full: ") && page.contains("--queue"), "{page}");
    let unknown = explain(&["nonsense"]).unwrap();
    assert_eq!(unknown.status.code(), Some(64));
    assert!(String::from_utf8(unknown.stderr).unwrap().contains("`dvi explain` lists all"));
}
