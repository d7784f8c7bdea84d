//! Suggestions for texts that are not JSON: comments, commas, quotes, numbers and words of other languages, and
//! documents in other formats.

mod bare;
mod formats;
mod scanner;

use crate::error::SpecificationError;
use crate::pointer::{Step, pointer};
use crate::wording::abridged;
use scanner::{Fault, Wanted};

/// Description of a fault in a text that is not JSON, and what to write instead.
struct Slip {
    what: String,
    write: String,
}

impl Slip {
    fn new(what: impl Into<String>, write: impl Into<String>) -> Self {
        Self { what: what.into(), write: write.into() }
    }
}

/// Returns the error for a text that is not JSON, where serde stopped at `path`.
pub(super) fn error(text: &[u8], error: &serde_json::Error, path: &[Step]) -> SpecificationError {
    let message = error.to_string();
    if text.trim_ascii().is_empty() {
        return SpecificationError::new("", "syntax", "the document is empty")
            .expected("a JSON object: {\"problem\": {...}, \"time\": {\"end\": 1}}");
    }
    if message.starts_with("number out of range") {
        return SpecificationError::new(pointer(path), "number_out_of_range", message)
            .expected("a number between -1.8e308 and 1.8e308");
    }
    if message.starts_with("recursion limit exceeded") {
        // The path to a fault in a deeply nested document carries no information.
        return SpecificationError::new("", "too_deep", message).expected("at most 127 levels of lists and objects");
    }
    let otherwise = || SpecificationError::new(pointer(path), "syntax", message.clone()).expected("a JSON object");
    let Ok(text) = std::str::from_utf8(text) else {
        return otherwise().expected("text in UTF-8");
    };
    let Some(fault) = scanner::fault(text.as_bytes()) else { return otherwise() };
    let (Slip { what, write }, path) = match formats::other(text) {
        Some(slip) => (slip, &[][..]),
        None => (slip(text, &fault), path),
    };
    let detail = format!("{what} at {}", position(text, fault.at));
    SpecificationError::new(pointer(path), "syntax", detail).expected(write)
}

/// Formats the line and the column, counted from 1, of a byte offset in the text.
fn position(text: &str, at: usize) -> String {
    let before = &text[..at];
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |line| line.chars().count()) + 1;
    format!("line {line} column {column}")
}

fn slip(text: &str, fault: &Fault) -> Slip {
    let rest = &text[fault.at..];
    if rest.starts_with("//") || rest.starts_with("/*") || rest.starts_with('#') || rest.starts_with("--") {
        return Slip::new(
            "a comment",
            "no comment: JSON has none; write a remark in `label`, or in a member `comment`",
        );
    }
    let Some(next) = rest.chars().next() else { return end_of_text(text, fault) };
    let innermost = fault.open.last();
    match (fault.wanted, next) {
        (Wanted::Text, _) => in_string(text, fault, next),
        (Wanted::Key | Wanted::Value, ']' | '}') if text[fault.before.clone()] == *"," => {
            Slip::new(format!("a comma before `{next}`"), "no comma after the last entry")
        }
        (Wanted::Value, ',') if text[fault.before.clone()] == *":" => {
            Slip::new("`,` where a value belongs", "a value before it")
        }
        (Wanted::Key | Wanted::Value, ',') => {
            Slip::new("a comma with nothing before it", "one comma between two entries")
        }
        (Wanted::Value, ']' | '}' | ':') => Slip::new(format!("`{next}` where a value belongs"), "a value before it"),
        (Wanted::Separator | Wanted::Key, ']' | '}') if let Some(&(bracket, at)) = innermost => {
            let closing = closing(bracket);
            let opened = format!("`{}` at {}", char::from(bracket), position(text, at));
            Slip::new(
                format!("`{next}` where {opened} is open"),
                format!("`{closing}` before it, which closes {opened}"),
            )
        }
        (Wanted::End, ']' | '}') => Slip::new(
            format!("an unmatched `{next}`"),
            "nothing: all brackets are closed before it, and the document ends",
        ),
        (Wanted::End, ':') => Slip::new(
            "a member outside an object",
            "the document between braces: {\"problem\": {...}, \"time\": {\"end\": 1}}",
        ),
        (Wanted::End, _) => Slip::new("text after the end of the document", "nothing: one document is one JSON object"),
        (Wanted::Colon, _) => {
            let key = &text[fault.before.clone()];
            match key.split_once(':') {
                Some((name, _)) => Slip::new("a key without its closing quote", format!("{name}\": ...")),
                None => Slip::new(
                    format!("{} where a colon belongs", bare::shown(rest)),
                    format!("`:` between key and value: {}: ...", abridged(key)),
                ),
            }
        }
        (Wanted::Separator, ':') if let Some(&(b'[', at)) = innermost => {
            let opened = format!("`[` at {}", position(text, at));
            Slip::new(
                format!("a member in the list that {opened} opens"),
                format!("`]`, which closes {opened}, before the key"),
            )
        }
        (Wanted::Separator, _) => bare::behind_a_value(text, fault),
        (Wanted::Key, _) => bare::key(text, fault),
        (Wanted::Value, _) => bare::value(rest),
    }
}

/// Describes a JSON text that ends too early.
fn end_of_text(text: &str, fault: &Fault) -> Slip {
    if fault.wanted == Wanted::Text {
        let string = abridged(text[fault.before.clone()].trim_end());
        return Slip::new(
            format!(
                "the end of the text within the string {string}, which begins at {}",
                position(text, fault.before.start)
            ),
            "a quote `\"` at the end of the string",
        );
    }
    let Some(&(bracket, at)) = fault.open.last() else { return Slip::new("the end of the text", "a JSON object") };
    let opened = format!("`{}` at {}", char::from(bracket), position(text, at));
    let closing: String = fault.open.iter().rev().map(|&(bracket, _)| closing(bracket)).collect();
    let value = if matches!(fault.wanted, Wanted::Colon | Wanted::Value) { "a value, then " } else { "" };
    Slip::new(format!("the end of the text where {opened} is open"), format!("{value}`{}`", abridged(&closing)))
}

fn closing(bracket: u8) -> char {
    if bracket == b'{' { '}' } else { ']' }
}

/// Describes an unterminated or invalid string in a JSON text.
fn in_string(text: &str, fault: &Fault, next: char) -> Slip {
    let begins = position(text, fault.before.start);
    match next {
        '\\' => Slip::new(
            "a backslash in a string",
            "`\\\\` for a backslash; after one only `\" \\ / b f n r t u` may follow",
        ),
        '\n' | '\r' => Slip::new(
            format!("the end of the line within the string that begins at {begins}"),
            "a quote `\"` at the end of the string, which must be on one line",
        ),
        control => Slip::new(
            format!("the control character U+{:04X} in a string", u32::from(control)),
            "a space, or `\\t` for a tab",
        ),
    }
}
