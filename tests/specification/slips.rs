//! Common mistakes in specifications, and the words of the error message that say how to correct them. Each row of
//! `slips.json` has a specification, pairs of texts of which the first is replaced by the second to make the mistake,
//! and the required words.

use crate::documents::errors_of;
use serde_json::Value;

#[test]
fn every_slip_says_what_to_write() {
    let table: Value = serde_json::from_str(include_str!("slips.json")).expect("a table");
    let rows = table["slips"].as_array().expect("rows");
    let mut silent = Vec::new();
    for row in rows {
        let row: Vec<&str> = row.as_array().expect("a row").iter().map(|text| text.as_str().expect("a text")).collect();
        let (says, row) = row.split_last().expect("an answer");
        let text = match row {
            ["whole", text] => (*text).to_owned(),
            [name, pairs @ ..] => {
                let document = table["documents"][name].as_str().expect("a document").to_owned();
                pairs.chunks(2).fold(document, |document, pair| {
                    assert!(document.contains(pair[0]), "{name} has no {}", pair[0]);
                    document.replacen(pair[0], pair[1], 1)
                })
            }
            [] => panic!("a row names a document"),
        };
        let said: Vec<String> = errors_of(&text)
            .into_iter()
            .map(|error| {
                let suggestion = error.did_you_mean.map(|name| format!("did you mean {name}?")).unwrap_or_default();
                format!("{}: {} {} {suggestion}", error.pointer, error.detail, error.expected.unwrap_or_default())
            })
            .collect();
        if !said.iter().any(|said| said.contains(says)) {
            silent.push(format!("{row:?} is answered, without {says:?}, by {said:#?}"));
        }
    }
    assert!(silent.is_empty(), "{} of {}:\n{}", silent.len(), rows.len(), silent.join("\n"));
}

#[test]
fn a_byte_order_mark_is_no_slip() {
    let document = crate::documents::block().to_string();
    assert!(dvi::specification::Specification::from_json(format!("\u{feff}{document}").as_bytes()).is_ok());
}
