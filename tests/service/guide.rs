//! The user guide: its links resolve, and it covers every key and code of specifications and results.

use crate::harness::{Site, instant, one_worker};
use axum::http::StatusCode;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Returns the values of an attribute in an HTML page.
fn attributes<'a>(page: &'a str, name: &str) -> Vec<&'a str> {
    let start = format!(" {name}=\"");
    page.split(start.as_str()).skip(1).filter_map(|rest| rest.split('"').next()).collect()
}

/// Returns all pages of the guide, by address.
async fn pages(site: &Site) -> BTreeMap<String, String> {
    let first = site.get("/docs").await;
    assert_eq!(first.status, StatusCode::OK);
    let mut pages = BTreeMap::from([("/docs".to_owned(), first.text().to_owned())]);
    let chapters: BTreeSet<String> = attributes(first.text(), "href")
        .into_iter()
        .filter(|href| href.starts_with("/docs/"))
        .map(str::to_owned)
        .collect();
    for chapter in chapters {
        let address = chapter.split('#').next().unwrap().to_owned();
        let page = site.get(&address).await;
        assert_eq!(page.status, StatusCode::OK, "{address}");
        pages.insert(address, page.text().to_owned());
    }
    pages
}

#[tokio::test]
async fn every_link_of_the_guide_leads_somewhere() {
    let site = Site::new(one_worker(), instant());
    let pages = pages(&site).await;
    let chapters = fs::read_dir(Path::new(ROOT).join("api/guide")).unwrap().count();
    assert!(pages.len() > chapters + 4, "{:?}", pages.keys());
    for (address, page) in &pages {
        for href in attributes(page, "href") {
            let (path, id) = href.split_once('#').unwrap_or((href, ""));
            if path.starts_with("http://") || path.starts_with("https://") || id.starts_with("s=") {
                continue;
            }
            if let Some(name) = id.strip_prefix("example=") {
                assert!(Path::new(ROOT).join(format!("api/examples/{name}.json")).exists(), "{address}: {href}");
                continue;
            }
            let target = if path.is_empty() { Some(page) } else { pages.get(path) };
            match target {
                Some(target) if id.is_empty() || attributes(target, "id").contains(&id) => {}
                Some(_) => panic!("{address}: nothing has the id of {href}"),
                None => assert_eq!(site.get(path).await.status, StatusCode::OK, "{address}: {href}"),
            }
        }
    }
}

#[tokio::test]
async fn every_key_field_and_code_stands_in_the_guide() {
    let site = Site::new(one_worker(), instant());
    let pages = pages(&site).await;
    let all: String = pages.values().cloned().collect();
    let named = |word: &str| all.contains(&format!("<code>{word}</code>"));
    let schema: Value =
        serde_json::from_slice(&fs::read(Path::new(ROOT).join("api/specification.schema.json")).unwrap()).unwrap();
    let mut keys = BTreeSet::new();
    properties(&schema, &mut keys);
    let description = dvi::service::http::description();
    for name in ["Solution", "Trajectory", "Diagnostics", "Verdict", "StatusInfo", "Event"] {
        properties(&description["components"]["schemas"][name], &mut keys);
    }
    // In the guide, an unnamed alternative of the schema is written as `{"key": ..}`.
    let missing: Vec<&String> =
        keys.iter().filter(|key| !named(key) && !all.contains(&format!("\"{key}\": .."))).collect();
    assert!(missing.is_empty(), "{missing:?}");
    let missing: Vec<&str> =
        dvi::explanation::pages().iter().map(|page| page.code).filter(|code| !named(code)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}

fn properties(schema: &Value, into: &mut BTreeSet<String>) {
    match schema {
        Value::Object(members) => {
            if let Some(Value::Object(properties)) = members.get("properties") {
                into.extend(properties.keys().cloned());
            }
            members.values().for_each(|one| properties(one, into));
        }
        Value::Array(items) => items.iter().for_each(|one| properties(one, into)),
        _ => {}
    }
}

/// Tests that each type of problem, block, method and check is explained in the handwritten chapters of the guide,
/// not only in generated ones.
#[test]
fn what_is_written_most_is_explained_in_words() {
    let folder = fs::read_dir(Path::new(ROOT).join("api/guide")).unwrap();
    let text: String = folder.map(|file| fs::read_to_string(file.unwrap().path()).unwrap()).collect();
    let schema: Value =
        serde_json::from_slice(&fs::read(Path::new(ROOT).join("api/specification.schema.json")).unwrap()).unwrap();
    let mut words: Vec<String> = dvi::solution::CheckCode::ALL.map(|code| code.name().to_owned()).into();
    for name in ["Problem", "Block"] {
        let alternatives = schema["$defs"][name]["oneOf"].as_array().unwrap();
        words.extend(alternatives.iter().map(|one| one["required"][0].as_str().unwrap().to_owned()));
    }
    words.extend(schema["properties"].as_object().unwrap().keys().cloned());
    words.extend(schema["$defs"]["Method"]["properties"].as_object().unwrap().keys().cloned());
    let missing: Vec<&String> = words
        .iter()
        .filter(|word| !text.contains(&format!("`{word}`")) && !text.contains(&format!("\"{word}\"")))
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
    for entry in fs::read_dir(Path::new(ROOT).join("api/examples")).unwrap() {
        let name = entry.unwrap().path().file_stem().unwrap().to_str().unwrap().to_owned();
        assert!(text.contains(&format!("#example={name}")), "examples.md does not have {name}");
    }
}

#[tokio::test]
async fn a_search_finds_sections_and_shows_no_markup_of_its_own() {
    let site = Site::new(one_worker(), instant());
    let found = site.get("/docs/search?q=energy+balance").await;
    assert!(found.text().contains("/docs/evidence#energy_balance"), "{}", found.text());
    let hostile = site.get("/docs/search?q=%3Cscript%3Ealert(1)%3C%2Fscript%3E").await;
    assert!(!hostile.text().contains("<script") && hostile.text().contains("&lt;script&gt;"), "{}", hostile.text());
    let nothing = site.get("/docs/search").await;
    assert!(nothing.text().contains("Nothing was found"));
    site.get("/docs/nowhere").await.problem(404, "not-found");
}
