//! What stands in a text that another language would understand, and what is written here.

use super::scope::{Scope, excerpt};

/// Letters behind a number that stand for a power of ten elsewhere, with it.
const SUFFIXES: [(&str, &str); 9] = [
    ("f", "e-15"),
    ("p", "e-12"),
    ("n", "e-9"),
    ("u", "e-6"),
    ("k", "e3"),
    ("M", "e6"),
    ("meg", "e6"),
    ("G", "e9"),
    ("T", "e12"),
];

/// Units that people write behind numbers.
const UNITS: [&str; 36] = [
    "m", "mm", "cm", "km", "um", "s", "ms", "us", "ns", "min", "h", "kg", "g", "N", "kN", "Nm", "J", "kJ", "W", "kW",
    "V", "mV", "kV", "A", "mA", "F", "uF", "nF", "H", "mH", "uH", "Hz", "kHz", "MHz", "Pa", "K",
];

/// The next token, as people would name it.
pub(super) fn found(rest: &str) -> String {
    let in_word = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'.');
    match rest.chars().next() {
        None => "the end".to_owned(),
        Some(control) if control.is_control() => format!("the control character U+{:04X}", u32::from(control)),
        Some(first) => match rest.bytes().take_while(in_word).count() {
            0 => format!("`{first}`"),
            length => format!("`{}`", excerpt(&rest[..length])),
        },
    }
}

/// What to write instead where an operand was expected.
pub(super) fn of_operand(before: &str, rest: &str) -> Option<&'static str> {
    Some(match rest.as_bytes().first()? {
        b'|' => "a magnitude is written `abs(v)`",
        b'!' | b'~' => "a condition is negated by `not`",
        b'>' if before.ends_with('<') => "what is not equal is written `a != b`",
        b'=' if before.ends_with(['<', '>', '=', '!']) => "comparisons are written `<= >= == !=`",
        b'[' => "there are no lists in expressions",
        _ => return None,
    })
}

/// What to write instead where an operator was expected.
pub(super) fn of_operator(before: &str, rest: &str, scope: &Scope) -> Option<String> {
    let next = rest.chars().next()?;
    let after = rest[next.len_utf8()..].chars().next();
    let ends_in_digit = before.ends_with(|c: char| c.is_ascii_digit() || c == '.');
    let remedy = match next {
        '&' => "conditions are joined by `and`",
        '|' if after == Some('|') => "conditions are joined by `or`",
        '|' => "a magnitude is written `abs(v)`, and conditions are joined by `or`",
        '~' if after == Some('=') => "what is not equal is written `a != b`",
        '<' | '>' | '=' | '!' if is_second_comparison(before) => "of three numbers: `a < b and b < c`",
        '=' => "a comparison is written `==`; of an equation stands the right-hand side alone",
        '?' => "a choice is written `if(c, a, b)`",
        '%' => "the remainder of a division is `mod(a, b)`",
        '\'' => "a derivative is no term: of an equation stands the right-hand side alone",
        ',' if ends_in_digit && after.is_some_and(|c| c.is_ascii_digit()) => "decimals have a point: `0.1`",
        '[' => "an index is part of a name: `x_1`",
        '.' if after.is_some_and(|c| c.is_ascii_alphabetic()) => "functions stand by themselves: `sin(x)`",
        '_' | '(' | '.' | 'a'..='z' | 'A'..='Z' | '0'..='9' => return Some(of_product(before, rest, scope)),
        _ => return None,
    };
    Some(remedy.to_owned())
}

/// What to write where an operand follows an operand.
fn of_product(before: &str, rest: &str, scope: &Scope) -> String {
    let word = &rest[..rest.bytes().take_while(u8::is_ascii_alphanumeric).count()];
    let number = before.trim_end();
    let start = number.rfind(|c: char| !c.is_ascii_digit() && c != '.').map_or(0, |at| at + 1);
    let is_name = number[..start].ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_');
    let literal = &number[start..];
    if literal.is_empty() || is_name || scope.get(word).is_some() {
        return "a product is written with `*`".to_owned();
    }
    let literal = excerpt(literal);
    match SUFFIXES.iter().find(|(suffix, _)| *suffix == word) {
        Some((_, power)) => format!("numbers have no suffixes: `{literal}{power}`"),
        None if matches!(word, "deg" | "degrees") => format!("angles are in radians: `{literal}*pi/180`"),
        None if UNITS.contains(&word) => "numbers have no units: all are in one system, such as SI".to_owned(),
        None => "a product is written with `*`".to_owned(),
    }
}

/// Whether a comparison stands in this text since the last parenthesis, comma or word that joins conditions.
fn is_second_comparison(before: &str) -> bool {
    let start = before.rfind(['(', ',']).map_or(0, |at| at + 1);
    let open = &before[start..];
    let open = open.rsplit_once(" and ").or_else(|| open.rsplit_once(" or ")).map_or(open, |(_, last)| last);
    open.contains(['<', '>']) || open.contains("==") || open.contains("!=")
}
