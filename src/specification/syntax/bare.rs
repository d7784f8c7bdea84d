//! Words, numbers and expressions that a JSON text has without quotes, or in the quotes of other languages.

use super::{Fault, Slip};
use crate::wording::{abridged, quoted};

/// Pairs of opening and closing quotes that other languages have for strings.
const QUOTES: [(char, char); 5] =
    [('\'', '\''), ('`', '`'), ('\u{201c}', '\u{201d}'), ('\u{2018}', '\u{2019}'), ('\u{ab}', '\u{bb}')];

/// Words that other languages have for the literals of JSON.
const WORDS: [(&str, &[&str]); 3] = [
    ("true", &["true", "yes", "on", ".true."]),
    ("false", &["false", "no", "off", ".false."]),
    ("null", &["null", "none", "undefined", "nil", "nothing", "missing"]),
];

/// Words, such as `NaN`, that other languages have for numbers that are not finite.
const NO_NUMBERS: [&str; 6] = ["nan", "inf", "infinity", "-inf", "-infinity", "+infinity"];

/// Returns the text of an entry of a list or object: up to a comma or closing bracket outside parentheses, or the end
/// of the line.
fn entry(rest: &str) -> &str {
    let mut depth = 0_usize;
    for (at, c) in rest.char_indices() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' if depth > 0 => depth -= 1,
            ']' | '}' if depth > 0 => depth -= 1,
            ',' | ';' if depth == 0 => return rest[..at].trim_end(),
            ']' | '}' | '\n' => return rest[..at].trim_end(),
            _ => {}
        }
    }
    rest.trim_end()
}

/// Returns the first word or character of the faulty text, quoted for a message.
pub(super) fn shown(rest: &str) -> String {
    let word: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    if word.is_empty() {
        rest.chars().next().map_or(String::new(), |c| format!("`{c}`"))
    } else {
        format!("`{}`", abridged(&word))
    }
}

/// Rewrites a text between quotes of another language with the quotes of JSON.
fn in_quotes(rest: &str) -> Option<String> {
    let first = rest.chars().next()?;
    let &(_, close) = QUOTES.iter().find(|(open, close)| *open == first || *close == first)?;
    let rest = &rest[first.len_utf8()..];
    let end = rest.find([first, close])?;
    Some(quoted(&rest[..end]))
}

/// Describes the fault at which the key of a JSON member is expected.
pub(super) fn key(text: &str, fault: &Fault) -> Slip {
    let rest = &text[fault.at..];
    if let Some(key) = in_quotes(rest) {
        return Slip::new(format!("{} where a quote `\"` belongs", shown(rest)), key);
    }
    let before = text[..fault.before.start].trim_end();
    let whole = before.len() - before.bytes().rev().take_while(u8::is_ascii_digit).count();
    let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
    let follows_number = text[fault.before.clone()] == *"," && whole < before.len();
    if follows_number && !digits.is_empty() && !rest[digits.len()..].trim_start().starts_with(':') {
        let whole = &before[whole..];
        let write = format!("decimals with a point: `{whole}.{digits}`; no commas in large numbers: `{whole}{digits}`");
        return Slip::new("a number where a key belongs", write);
    }
    let word: String = rest.chars().take_while(|c| c.is_alphanumeric() || "_-.".contains(*c)).collect();
    if word.is_empty() || word.starts_with("...") {
        return Slip::new(format!("{} where a key belongs", shown(rest)), "a key in quotes; JSON has no placeholders");
    }
    Slip::new("a key without quotes", quoted(&word))
}

/// Describes the fault in the text after a JSON value, where a comma or closing bracket belongs.
pub(super) fn behind_a_value(text: &str, fault: &Fault) -> Slip {
    let (before, rest) = (&text[fault.before.clone()], &text[fault.at..]);
    let is_next = rest.starts_with(['"', '{', '[']);
    if before == "\"\"" && rest.starts_with('"') && fault.before.end == fault.at {
        return Slip::new("three quotes", "one quote `\"` at each end of a string");
    }
    if is_next {
        let inside = if fault.open.last().is_some_and(|&(bracket, _)| bracket == b'{') { "members" } else { "entries" };
        return Slip::new(format!("{} where a comma belongs", shown(rest)), format!("`,` between two {inside}"));
    }
    if rest.starts_with([';', ':', '=']) {
        return Slip::new(format!("{} where a comma belongs", shown(rest)), "`,` between two members");
    }
    match before.ends_with('"') {
        true => Slip::new(
            format!("{} after a string", shown(rest)),
            "`,` or the end of the list or object; `\\\"` for a quote in a string",
        ),
        false => value(&text[fault.before.start..]),
    }
}

/// Describes a faulty JSON value at the beginning of a text.
pub(super) fn value(rest: &str) -> Slip {
    if let Some(text) = in_quotes(rest) {
        return Slip::new(format!("{} where a quote `\"` belongs", shown(rest)), text);
    }
    let entry = entry(rest);
    let folded = entry.to_ascii_lowercase();
    let what = |what: &str| format!("{what} `{}`", abridged(entry));
    if let Some((word, _)) = WORDS.iter().find(|(_, foreign)| foreign.contains(&folded.as_str())) {
        return Slip::new(what("the word"), format!("`{word}`"));
    }
    if NO_NUMBERS.contains(&folded.as_str()) {
        let write = "a finite number: JSON has no NaN and no infinity; leave out a bound for none";
        return Slip::new(what("the word"), write);
    }
    if let Some(number) = number(entry) {
        return Slip::new(what("the number"), number);
    }
    if entry.starts_with("...") || entry.starts_with(['<', '$', '\u{2026}']) || entry.is_empty() {
        return Slip::new(format!("{} where a value belongs", shown(rest)), "a value: JSON has no placeholders");
    }
    let inside = entry.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
    if let Some(inside) = inside.filter(|inside| inside.contains('"')) {
        return Slip::new("a list in parentheses", format!("`[{}]`", abridged(inside)));
    }
    Slip::new("an expression without quotes", quoted(entry))
}

/// Rewrites a number in the notation of another language as JSON.
fn number(entry: &str) -> Option<String> {
    let (sign, digits) = match entry.strip_prefix('-') {
        Some(rest) => ("-", rest),
        None => ("", entry.strip_prefix('+').unwrap_or(entry)),
    };
    if let Some(value) = digits.strip_prefix("0x").or(digits.strip_prefix("0X")) {
        return u64::from_str_radix(value, 16).ok().map(|value| format!("`{sign}{value}`: numbers are decimal"));
    }
    let (plain, unit) = match digits.split_once(' ') {
        Some((number, unit)) => (number, unit.trim()),
        None => digits.split_at(digits.find(|c: char| c.is_alphabetic() && !"eE".contains(c)).unwrap_or(digits.len())),
    };
    let plain = plain.replace('_', "");
    if !plain.starts_with(|c: char| c.is_ascii_digit() || c == '.')
        || !unit.chars().all(|c| c.is_alphanumeric() || "/^%".contains(c))
    {
        return None;
    }
    if plain.ends_with(['e', 'E', '+', '-']) {
        return Some("digits of the exponent, as in `1e3`".to_owned());
    }
    plain.parse::<f64>().ok()?;
    let (mantissa, exponent) = plain.split_at(plain.find(['e', 'E']).unwrap_or(plain.len()));
    let (whole, fraction) =
        mantissa.split_once('.').map_or((mantissa, None), |(whole, fraction)| (whole, Some(fraction)));
    let whole = whole.trim_start_matches('0');
    let whole = if whole.is_empty() { "0" } else { whole };
    let fraction = fraction.map(|f| format!(".{}", if f.is_empty() { "0" } else { f })).unwrap_or_default();
    let number = format!("`{sign}{whole}{fraction}{exponent}`");
    Some(if unit.is_empty() {
        number
    } else {
        format!("{number}: numbers have no units; write all of them in one system, such as SI")
    })
}
