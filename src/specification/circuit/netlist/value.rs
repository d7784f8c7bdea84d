//! Numbers of a netlist with a scale suffix, as `4.7k`, `10u` or `1Meg`. Letters after the suffix are a unit and are
//! ignored: `10uF`, `50Hz`. In either case `m` is 1e-3 and `meg` is 1e6; therefore `1F` is a femtofarad, as in SPICE.

use super::NetlistError;
use super::tokens::Token;
use winnow::ascii::float;
use winnow::error::EmptyError;
use winnow::prelude::*;
use winnow::token::take_while;

/// Scale suffixes of numbers in a netlist and their factors; the first suffix that matches applies.
const SCALES: [(&str, f64); 11] = [
    ("meg", 1e6),
    ("t", 1e12),
    ("g", 1e9),
    ("k", 1e3),
    ("m", 1e-3),
    ("u", 1e-6),
    ("\u{b5}", 1e-6),
    ("\u{3bc}", 1e-6),
    ("n", 1e-9),
    ("p", 1e-12),
    ("f", 1e-15),
];

/// Reads a token of a netlist as a number with an optional scale suffix.
pub(super) fn value(token: Token<'_>) -> Result<f64, NetlistError> {
    let letters = take_while::<_, _, EmptyError>(0.., char::is_alphabetic);
    let mut number = (float, letters).map(|(number, letters): (f64, &str)| scaled(number, letters));
    match number.parse(token.text) {
        Ok(value) if value.is_finite() => Ok(value),
        _ => {
            let detail = format!("`{}` is not a number", token.shown());
            Err(NetlistError::new(token, "malformed_number", detail, "a number such as 4.7k, 100n or 1e-3"))
        }
    }
}

/// Scales a number by its suffix with one rounding: a factor below 1 is inexact in binary, but its reciprocal is exact.
pub(super) fn scaled(number: f64, letters: &str) -> f64 {
    let letters = letters.to_lowercase();
    let scale = SCALES.iter().find(|(suffix, _)| letters.starts_with(suffix)).map_or(1.0, |&(_, scale)| scale);
    if scale < 1.0 { number / (1.0 / scale).round() } else { number * scale }
}

/// Returns a warning about a suffix of which a reader would expect another scale than that of SPICE: `1M` as a
/// million, `1F` as a farad.
pub(super) fn likely_meant(text: &str) -> Option<&'static str> {
    let letters = text.trim_start_matches(|c: char| c.is_ascii_digit() || "+-.".contains(c));
    let is_number = letters.len() < text.len();
    match letters {
        _ if !is_number => None,
        "M" | "MOhm" | "MOhms" | "MHz" => Some("`M` is a thousandth in SPICE: a million is `Meg`"),
        "F" | "f" | "Farad" | "farad" => Some("`F` is 1e-15 in SPICE: a farad has no suffix"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Option<f64> {
        value(Token { text, line: 1, column: 1 }).ok()
    }

    #[test]
    fn suffixes_scale_and_units_say_nothing() {
        let known = [
            ("1k", 1e3),
            ("4.7K", 4700.0),
            ("2MEG", 2e6),
            ("2meg", 2e6),
            ("3m", 3e-3),
            ("3M", 3e-3),
            ("10uF", 10e-6),
            ("10\u{b5}", 10e-6),
            ("100n", 100e-9),
            ("22p", 22e-12),
            ("1F", 1e-15),
            ("5g", 5e9),
            ("1T", 1e12),
            ("50Hz", 50.0),
            ("-1.5e-3", -1.5e-3),
            ("1e3k", 1e6),
            (".5", 0.5),
        ];
        for (text, expected) in known {
            assert_eq!(of(text), Some(expected), "{text}");
        }
    }

    #[test]
    fn scales_that_are_likely_another_are_told() {
        for text in ["1M", "2.2M", "1MHz", "1F", "-3f"] {
            assert!(likely_meant(text).is_some(), "{text}");
        }
        for text in ["1m", "1Meg", "1MEG", "1mF", "10u", "M", "F", "f1", "100pF"] {
            assert_eq!(likely_meant(text), None, "{text}");
        }
    }

    #[test]
    fn what_is_no_number_is_none() {
        for text in ["", "k", "1k2", "1..2", "one", "nan", "inf", "1e999", "--1", "5%"] {
            assert_eq!(of(text), None, "{text}");
        }
    }
}
