//! The structure of a specification: its text without the numbers of its `parameters`. The text is scanned, not
//! parsed: a structure is meaningful only once a text with equal structure has been parsed and its parameters found
//! to be those that the scan finds.

use std::ops::Range;

/// The text of a specification without the numbers of its parameters, and the parameters with these numbers.
#[derive(Debug)]
pub struct Structure<'a> {
    /// The text of the specification with `#` in place of each number of a parameter.
    pub text: Vec<u8>,
    parameters: Vec<(&'a str, f64)>,
}

const KEY: &[u8] = b"\"parameters\"";

impl<'a> Structure<'a> {
    /// Separates `text`, a specification, from the numbers of its parameters, if it contains exactly one object of
    /// parameters, with at least one number.
    pub fn of(text: &'a [u8]) -> Option<Self> {
        let key = find(text, KEY)?;
        let rest = key + KEY.len();
        if find(&text[rest..], KEY).is_some() {
            return None;
        }
        let mut scanner = Scanner { text, place: rest };
        scanner.take(b':')?;
        scanner.take(b'{')?;
        let (mut numbers, mut parameters) = (Vec::new(), Vec::new());
        loop {
            let name = scanner.string()?;
            scanner.take(b':')?;
            if scanner.peek()? == b'"' {
                scanner.string()?;
            } else {
                let (range, number) = scanner.number()?;
                numbers.push(range);
                parameters.push((name, number));
            }
            match scanner.peek()? {
                b',' => scanner.place += 1,
                b'}' => break,
                _ => return None,
            }
        }
        if numbers.is_empty() {
            return None;
        }
        let mut left = Vec::with_capacity(text.len());
        let mut copied = 0;
        for Range { start, end } in numbers {
            left.extend_from_slice(&text[copied..start]);
            left.push(b'#');
            copied = end;
        }
        left.extend_from_slice(&text[copied..]);
        Some(Self { text: left, parameters })
    }

    /// The names and values of the parameters that the specification gives as numbers, not as expressions.
    pub fn parameters(&self) -> impl Iterator<Item = (&'a str, f64)> {
        self.parameters.iter().copied()
    }
}

fn find(text: &[u8], sought: &[u8]) -> Option<usize> {
    text.windows(sought.len()).position(|window| window == sought)
}

/// A scanner of JSON: the text of a specification and the position reached in it.
struct Scanner<'a> {
    text: &'a [u8],
    place: usize,
}

impl<'a> Scanner<'a> {
    /// Skips white space, and returns the next byte of the specification.
    fn peek(&mut self) -> Option<u8> {
        while matches!(self.text.get(self.place)?, b' ' | b'\t' | b'\n' | b'\r') {
            self.place += 1;
        }
        self.text.get(self.place).copied()
    }

    fn take(&mut self, byte: u8) -> Option<()> {
        (self.peek()? == byte).then(|| self.place += 1)
    }

    /// Reads a JSON string without escape sequences from the specification.
    fn string(&mut self) -> Option<&'a str> {
        self.take(b'"')?;
        let rest = &self.text[self.place..];
        let length = rest.iter().position(|byte| matches!(byte, b'"' | b'\\'))?;
        self.place += length;
        self.take(b'"')?;
        str::from_utf8(&rest[..length]).ok()
    }

    /// Reads a number in JSON syntax (RFC 8259, section 6); returns its range and its value if it is finite as an
    /// `f64`.
    fn number(&mut self) -> Option<(Range<usize>, f64)> {
        self.peek()?;
        let start = self.place;
        self.skip(b"-");
        match self.digits() {
            0 => return None,
            count if count > 1 && self.text[self.place - count] == b'0' => return None,
            _ => {}
        }
        if self.skip(b".") && self.digits() == 0 {
            return None;
        }
        if self.skip(b"eE") {
            self.skip(b"+-");
            if self.digits() == 0 {
                return None;
            }
        }
        let number: f64 = str::from_utf8(&self.text[start..self.place]).ok()?.parse().ok()?;
        number.is_finite().then_some((start..self.place, number))
    }

    /// Skips the next byte of the text if it is one of `any`; returns whether it was.
    fn skip(&mut self, any: &[u8]) -> bool {
        let found = self.text.get(self.place).is_some_and(|byte| any.contains(byte));
        self.place += usize::from(found);
        found
    }

    /// Skips the next decimal digits of the specification, and returns how many there were.
    fn digits(&mut self) -> usize {
        let count = self.text[self.place..].iter().take_while(|byte| byte.is_ascii_digit()).count();
        self.place += count;
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_parameters_are_left_out_and_nothing_else() {
        let text = br#"{"a": 1, "parameters": {"m": 1.5e-3, "k":"2*m" , "f" :-0}, "time": {"end": 20}}"#;
        let structure = Structure::of(text).unwrap();
        assert_eq!(structure.text, br##"{"a": 1, "parameters": {"m": #, "k":"2*m" , "f" :#}, "time": {"end": 20}}"##);
        assert!(structure.parameters().eq([("m", 1.5e-3), ("f", -0.0)]));
    }

    #[test]
    fn what_is_no_flat_object_of_numbers_and_texts_has_no_structure() {
        for text in [
            "",
            "{}",
            r#"{"parameters"#,
            r#"{"parameters": {"#,
            r#"{"parameters": {}}"#,
            r#"{"parameters": {"m": "1"}}"#,
            r#"{"parameters": {"m": 01}}"#,
            r#"{"parameters": {"m": +1}}"#,
            r#"{"parameters": {"m": 1.}}"#,
            r#"{"parameters": {"m": 1e}}"#,
            r#"{"parameters": {"m": 1e999}}"#,
            r#"{"parameters": {"m": null}}"#,
            r#"{"parameters": {"m": {"n": 1}}}"#,
            r#"{"parameters": {"\u006d": 1}}"#,
            r#"{"parameters": {"m": 1}, "parameters": {"m": 2}}"#,
        ] {
            assert!(Structure::of(text.as_bytes()).is_none(), "{text}");
        }
    }
}
