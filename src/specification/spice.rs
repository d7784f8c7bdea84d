//! A SPICE deck as a specification: its title becomes the label, its lines the netlist of a circuit, the end time of
//! `.tran` the end of the horizon.

use super::circuit::netlist;
use super::label::LONGEST;
use serde_json::{Map, Value, json};
use std::borrow::Cow;

/// Returns the specification for a deck with `.tran`, and any other text unchanged.
pub fn document(text: &[u8]) -> Cow<'_, [u8]> {
    let Some(deck) = deck(text) else { return Cow::Borrowed(text) };
    let mut document = Map::new();
    // Errors in the netlist of the deck are reported when the document is read as a specification.
    if let Ok(netlist) = netlist::read(deck) {
        if let Some(title) = netlist.title.filter(|title| !title.is_empty()) {
            document.insert("label".to_owned(), json!(title.chars().take(LONGEST).collect::<String>()));
        }
        if let Some(transient) = netlist.transient {
            document.insert("time".to_owned(), json!({"end": transient.end}));
        }
    } else {
        document.insert("time".to_owned(), json!({"end": 1}));
    }
    document.insert("problem".to_owned(), json!({"circuit": {"netlist": deck}}));
    Cow::Owned(Value::Object(document).to_string().into_bytes())
}

/// Returns the text of a SPICE deck, which is not JSON and has a line `.tran`; `None` for any other text.
fn deck(text: &[u8]) -> Option<&str> {
    let text = str::from_utf8(text).ok()?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let is_transient = |line: &str| line.trim_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(".tran"));
    (!text.trim_start().starts_with('{') && text.lines().any(is_transient)).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deck_becomes_a_specification_and_all_else_stays() {
        let deck = b"An RC circuit\nV1 in 0 5\nR1 in out 1k\nC1 out 0 1u\n.tran 1u {5*tau} uic\n.param tau=1m\n.end\n";
        let made: Value = serde_json::from_slice(&document(deck)).unwrap();
        assert_eq!(made["label"], "An RC circuit");
        assert_eq!(made["time"]["end"], 5e-3);
        assert_eq!(made["problem"]["circuit"]["netlist"].as_str().map(str::as_bytes), Some(&deck[..]));
        for text in [&b"{\"label\": \".tran\"}"[..], b"  {\n.tran", b"R1 a 0 1", b"", b"\xff\n.tran 1"] {
            assert_eq!(document(text), text);
        }
    }
}
