//! Remedies for messages: equivalents in this language for syntax of other languages.

use super::scope::{Scope, excerpt};

/// Suffixes of numbers that denote powers of ten in other languages.
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

/// Units that users may write after numbers.
const UNITS: [&str; 42] = [
    "Ohm", "ohm", "Ohms", "ohms", "kOhm", "sec", "m", "mm", "cm", "km", "um", "s", "ms", "us", "ns", "min", "h", "kg",
    "g", "N", "kN", "Nm", "J", "kJ", "W", "kW", "V", "mV", "kV", "A", "mA", "F", "uF", "nF", "H", "mH", "uH", "Hz",
    "kHz", "MHz", "Pa", "K",
];

/// Returns the next token, as text for messages.
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

/// Returns the remedy for text at a place where an operand was expected.
pub(super) fn of_operand(before: &str, rest: &str) -> Option<&'static str> {
    let word = rest.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').next();
    if matches!(word, Some("and" | "or")) {
        return Some("`and` and `or` stand between two conditions: `a and b`");
    }
    Some(match rest.as_bytes().first()? {
        b'|' => "a magnitude is written `abs(v)`",
        b'!' | b'~' => "a condition is negated by `not`",
        b'>' if before.ends_with('<') => "the comparison for not equal is written `a != b`",
        b'=' if before.ends_with(['<', '>', '=', '!']) => "comparisons are written `<= >= == !=`",
        b'[' => "there are no lists in expressions",
        b'{' => "terms are grouped by parentheses: `(a + b)`",
        b'"' | b'\'' | b'`' => "names are written without quotes",
        b'$' => "names are written without `$`",
        b'\\' => "there is no LaTeX: a fraction is `a/b`",
        _ => return None,
    })
}

/// Returns the remedy for text at a place where an operator was expected.
pub(super) fn of_operator(before: &str, rest: &str, scope: &Scope) -> Option<String> {
    let next = rest.chars().next()?;
    let after = rest[next.len_utf8()..].chars().next();
    let ends_in_digit = before.ends_with(|c: char| c.is_ascii_digit() || c == '.');
    let remedy = match next {
        '&' => "conditions are joined by `and`",
        '|' if after == Some('|') => "conditions are joined by `or`",
        '|' => "a magnitude is written `abs(v)`, and conditions are joined by `or`",
        '~' if after == Some('=') => "the comparison for not equal is written `a != b`",
        '!' if after != Some('=') => "there is no factorial",
        '<' | '>' | '=' | '!' if is_second_comparison(before) => "a chain of comparisons is written `a < b and b < c`",
        '=' => "a comparison is written `==`; of an equation, write the right-hand side only",
        '?' => "a choice is written `if(c, a, b)`",
        '%' => "the remainder of a division is `mod(a, b)`",
        '\'' => {
            "the velocity of a coordinate `x` is `x_dot`; a derivative is not a term: of an equation, write the \
             right-hand side only"
        }
        ')' => "`(` is missing before it, or remove it",
        ',' if ends_in_digit && after.is_some_and(|c| c.is_ascii_digit()) => "decimals have a point: `0.1`",
        '[' => "an index follows the name of a vector: `x[1]`",
        '.' if after == Some('.') => "a range belongs in a sum: `sum(x[i] for i in 1..n)`",
        '.' if after.is_some_and(|c| c.is_ascii_alphabetic()) => "functions are written without a prefix: `sin(x)`",
        '_' | '(' | '.' | 'a'..='z' | 'A'..='Z' | '0'..='9' => return Some(of_product(before, rest, scope)),
        _ => return None,
    };
    Some(remedy.to_owned())
}

/// Returns the word (letters, digits, underscores) at the end of a text.
fn last_word(text: &str) -> &str {
    &text[text.rfind(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).map_or(0, |at| at + 1)..]
}

/// Returns the remedy for an operand that directly follows another operand.
fn of_product(before: &str, rest: &str, scope: &Scope) -> String {
    let word = &rest[..rest.bytes().take_while(u8::is_ascii_alphanumeric).count()];
    let number = before.trim_end();
    let start = number.rfind(|c: char| !c.is_ascii_digit() && c != '.').map_or(0, |at| at + 1);
    let is_name = number[..start].ends_with(|c: char| c.is_ascii_alphanumeric() || c == '_');
    let literal = &number[start..];
    let is_literal = !literal.is_empty() && !is_name;
    let name = last_word(number);
    if rest.starts_with('(') && scope.get(name).is_some() {
        let name = excerpt(name);
        return format!(
            "`{name}` is not a function: write `{name}` for its present value (there are no delays), or `{name}*(a + \
             b)` for a product"
        );
    }
    if word == "mod" {
        return "the remainder of a division is `mod(a, b)`".to_owned();
    }
    if is_literal
        && literal == "0"
        && word.starts_with(['x', 'X'])
        && let Ok(value) = u64::from_str_radix(&word[1..], 16)
    {
        return format!("numbers are decimal: `{value}`");
    }
    if is_literal && matches!(word, "e" | "E") && scope.get(word).is_none() {
        return format!("an exponent has digits: `{literal}e3`");
    }
    if !is_literal || scope.get(word).is_some() {
        return "a product is written with `*`".to_owned();
    }
    let literal = excerpt(literal);
    match SUFFIXES.iter().find(|(suffix, _)| *suffix == word) {
        Some((_, power)) => format!("numbers have no suffixes: `{literal}{power}`"),
        None if matches!(word, "deg" | "degrees") => format!("angles are in radians: `{literal}*pi/180`"),
        None if UNITS.contains(&word) => {
            "numbers have no units: write all of them in one system, such as SI".to_owned()
        }
        None => "a product is written with `*`".to_owned(),
    }
}

/// Whether the text before an unexpected comparison operator contains a comparison since the last parenthesis, comma,
/// `and` or `or`.
fn is_second_comparison(before: &str) -> bool {
    let start = before.rfind(['(', ',']).map_or(0, |at| at + 1);
    let open = &before[start..];
    let open = open.rsplit_once(" and ").or_else(|| open.rsplit_once(" or ")).map_or(open, |(_, last)| last);
    open.contains(['<', '>']) || open.contains("==") || open.contains("!=")
}

/// Returns the remedy for a function of other languages without an equivalent name.
pub(super) fn of_call(name: &str) -> Option<&'static str> {
    Some(match name {
        "rand" | "random" | "randn" | "noise" => "a table of random numbers drawn beforehand",
        "integral" | "integrate" | "int" | "cumtrapz" => "an entry of `integrals`",
        "d" | "diff" | "der" | "ddt" | "dt" | "grad" => "the right-hand side only; write a rate under `rate`",
        "delay" | "lag" => "a state that follows with a time constant, or a `convolution` problem: there are no delays",
        _ => return None,
    })
}

/// Returns the remedy for a word that denotes a number in other languages.
pub(super) fn of_name(name: &str) -> Option<&'static str> {
    Some(match name.to_ascii_lowercase().as_str() {
        "inf" | "infinity" => "a finite number; leave out a bound, or write `null`, for none",
        "nan" | "none" | "null" => "a finite number",
        "true" => "1, or a condition such as `t > 1`",
        "false" => "0, or a condition such as `t > 1`",
        _ => return None,
    })
}

/// Returns the correct call of a function whose name is not followed by a parenthesis.
pub(super) fn of_function(name: &str, rest: &str) -> String {
    let power = rest.strip_prefix("**").or_else(|| rest.strip_prefix('^'));
    if let Some((exponent, _)) = power.and_then(|power| power.split_once('(')) {
        return format!("`{name}(x)^{}`", excerpt(exponent.trim()));
    }
    let in_word = |byte: &u8| byte.is_ascii_alphanumeric() || *byte == b'_';
    match &rest[..rest.bytes().take_while(in_word).count()] {
        "" => format!("`{name}(t)`"),
        word => format!("`{name}({})`", excerpt(word)),
    }
}

/// Returns the expression for an inequality: the difference of its sides, which is nonnegative if the inequality
/// holds.
pub(super) fn of_inequality(text: &str) -> Option<String> {
    let mut depth = 0_usize;
    let at = text.bytes().position(|byte| {
        match byte {
            b'(' => depth += 1,
            b')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        depth == 0 && matches!(byte, b'<' | b'>')
    })?;
    let (left, right) = (text[..at].trim(), text[at + 1..].trim_start_matches('=').trim());
    if left.is_empty() || right.is_empty() || right.contains(['<', '>', '=', '!', '?']) || left.contains(['=', '!']) {
        return None;
    }
    let (more, less) = if text.as_bytes()[at] == b'>' { (left, right) } else { (right, left) };
    let is_sum = |text: &str| text.contains(['+', '-']);
    Some(match less {
        "0" => format!("`{}`", excerpt(more)),
        _ if is_sum(less) => format!("`{} - ({})`", excerpt(more), excerpt(less)),
        _ => format!("`{} - {}`", excerpt(more), excerpt(less)),
    })
}
