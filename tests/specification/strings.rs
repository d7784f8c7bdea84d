//! Checks all texts that a user may read, which are the string literals in the sources and the descriptions in the
//! schema: phrases that readers did not understand must not occur. With `--nocapture`, the test prints the texts for
//! a review.

use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Smallest number of words of a string literal that is checked for puzzling phrases: those with fewer words are names,
/// keys and addresses.
const FEWEST_WORDS: usize = 4;

/// Phrases in messages that users did not understand, in lower case.
const PUZZLING: [&str; 16] = [
    "in no circle",
    "is no component known",
    "in its stride",
    "makes no sense",
    "whose it is",
    "who runs the service",
    "belongs into",
    "differentiated 1 times",
    "` is no name",
    "takes no change",
    "needs a proxy",
    "what it comes to",
    "come out as they must",
    "an error of theirs",
    "followed each other ever faster",
    "at once or in time",
];

/// Returns the source text of a Rust file without comments and without the tests at its end.
fn without_comments(source: &str) -> String {
    let code = source.split("#[cfg(test)]").next().unwrap_or_default();
    code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

/// Returns the string literals of a Rust source; a line of a literal that ends in a backslash continues on the next
/// line.
fn quoted(code: &str) -> Vec<String> {
    let plain = code.replace("'\"'", "''").replace("\\\"", "\u{201d}");
    let texts = plain.split('"').skip(1).step_by(2);
    texts.map(|text| text.split("\\\n").map(str::trim_start).collect::<String>()).collect()
}

fn read(folder: &Path, visit: &mut impl FnMut(&Path, &str)) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            if name != "vendor" && name != "tests" {
                read(&path, visit);
            }
        } else if name.ends_with(".rs") && name != "tests.rs" || name.ends_with(".js") {
            visit(&path, &without_comments(&fs::read_to_string(&path).unwrap()));
        }
    }
}

fn descriptions(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(members) => {
            for (key, member) in members {
                if let ("description", Some(text)) = (key.as_str(), member.as_str()) {
                    found.insert(text.to_owned());
                }
                descriptions(member, found);
            }
        }
        Value::Array(elements) => elements.iter().for_each(|element| descriptions(element, found)),
        _ => {}
    }
}

#[test]
fn no_text_has_a_phrase_that_puzzled_its_readers() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut texts = BTreeSet::new();
    let mut puzzling = Vec::new();
    read(&root.join("src"), &mut |path: &Path, code: &str| {
        let lower = code.to_lowercase();
        puzzling.extend(
            PUZZLING.iter().filter(|phrase| lower.contains(**phrase)).map(|phrase| format!("{path:?}: {phrase}")),
        );
        texts.extend(quoted(code));
    });
    let schema = fs::read_to_string(root.join("api/specification.schema.json")).unwrap();
    descriptions(&serde_json::from_str(&schema).unwrap(), &mut texts);
    texts.retain(|text| text.split_whitespace().count() >= FEWEST_WORDS);
    for text in &texts {
        let lower = text.to_lowercase();
        puzzling.extend(
            PUZZLING.iter().filter(|phrase| lower.contains(**phrase)).map(|phrase| format!("{text}: {phrase}")),
        );
        println!("{text}");
    }
    assert!(texts.len() > 1000, "{} texts", texts.len());
    assert_eq!(puzzling, Vec::<String>::new());
}
