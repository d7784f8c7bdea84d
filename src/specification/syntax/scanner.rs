//! Locates the first fault of a text that is not JSON (RFC 8259), and the token expected at the fault.

use std::ops::Range;

/// The kind of token that JSON expects at a place in a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// A JSON value is expected: in a list, after a colon, or as the document.
    Value,
    /// The key of a JSON member is expected.
    Key,
    /// The colon after the key of a JSON member is expected.
    Colon,
    /// A comma, or the closing bracket of the JSON list or object, is expected.
    Separator,
    /// The end of the text is expected: the document is complete.
    End,
    /// The rest of a string that begins at `Fault::before` is expected.
    Text,
}

/// The first fault of a text that is not JSON.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    /// Byte offset of the unexpected token at the fault, or the length of a text that ends too early.
    pub at: usize,
    /// The kind of JSON token that is expected at the fault.
    pub wanted: Wanted,
    /// Whether the token before the fault is an opening bracket.
    pub is_first: bool,
    /// The brackets that are open at the fault, with their byte offsets.
    pub open: Vec<(u8, usize)>,
    /// Byte range of the token before the fault.
    pub before: Range<usize>,
}

/// Finds the first fault of a text; `None` if its tokens form a JSON document.
pub(super) fn fault(text: &[u8]) -> Option<Fault> {
    let mut fault = Fault { at: 0, wanted: Wanted::Value, is_first: false, open: Vec::new(), before: 0..0 };
    loop {
        fault.at += text[fault.at..].iter().take_while(|byte| b" \t\r\n".contains(byte)).count();
        let Some(&byte) = text.get(fault.at) else {
            return (fault.wanted != Wanted::End).then_some(fault);
        };
        let innermost = fault.open.last().map(|&(bracket, _)| bracket);
        let closes = (byte == b']' && innermost == Some(b'[')) || (byte == b'}' && innermost == Some(b'{'));
        let (wanted, is_first, end) = match (fault.wanted, byte) {
            (Wanted::Value, b'{' | b'[') => {
                fault.open.push((byte, fault.at));
                (if byte == b'{' { Wanted::Key } else { Wanted::Value }, true, fault.at + 1)
            }
            (Wanted::Separator, _) if closes => (fault.close(), false, fault.at + 1),
            (Wanted::Value | Wanted::Key, _) if closes && fault.is_first => (fault.close(), false, fault.at + 1),
            (Wanted::Value | Wanted::Key, b'"') => match string(text, fault.at) {
                Ok(end) if fault.wanted == Wanted::Key => (Wanted::Colon, false, end),
                Ok(end) => (fault.after_value(), false, end),
                Err(at) => {
                    return Some(Fault { at, wanted: Wanted::Text, before: fault.at..at, ..fault });
                }
            },
            (Wanted::Colon, b':') => (Wanted::Value, false, fault.at + 1),
            (Wanted::Separator, b',') => {
                (if innermost == Some(b'{') { Wanted::Key } else { Wanted::Value }, false, fault.at + 1)
            }
            (Wanted::Value, _) => match literal(&text[fault.at..]) {
                0 => return Some(fault),
                length => (fault.after_value(), false, fault.at + length),
            },
            _ => return Some(fault),
        };
        fault = Fault { wanted, is_first, at: end, before: fault.at..end, open: fault.open };
    }
}

impl Fault {
    fn close(&mut self) -> Wanted {
        self.open.pop();
        self.after_value()
    }

    fn after_value(&self) -> Wanted {
        if self.open.is_empty() { Wanted::End } else { Wanted::Separator }
    }
}

/// Returns the end of the JSON string that begins at `start`, or the offset of its first invalid byte.
fn string(text: &[u8], start: usize) -> Result<usize, usize> {
    let mut at = start + 1;
    loop {
        match text.get(at) {
            Some(b'"') => return Ok(at + 1),
            Some(b'\\') if text.get(at + 1).is_some_and(|byte| b"\"\\/bfnrtu".contains(byte)) => at += 2,
            None | Some(b'\\' | ..=0x1f) => return Err(at),
            Some(_) => at += 1,
        }
    }
}

/// Returns the length of the JSON number or literal at the beginning of a text; 0 if there is none.
fn literal(text: &[u8]) -> usize {
    let length = text.iter().take_while(|byte| byte.is_ascii_alphanumeric() || b"+-._".contains(byte)).count();
    let token = &text[..length];
    if [&b"true"[..], b"false", b"null"].contains(&token) || is_number(token) { length } else { 0 }
}

fn is_number(token: &[u8]) -> bool {
    let digits = |text: &[u8]| text.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let rest = token.strip_prefix(b"-").unwrap_or(token);
    let whole = digits(rest);
    if whole == 0 || (whole > 1 && rest[0] == b'0') {
        return false;
    }
    let mut rest = &rest[whole..];
    if let Some(fraction) = rest.strip_prefix(b".") {
        let length = digits(fraction);
        if length == 0 {
            return false;
        }
        rest = &fraction[length..];
    }
    if let [b'e' | b'E', exponent @ ..] = rest {
        let exponent = exponent.strip_prefix(b"+").or(exponent.strip_prefix(b"-")).unwrap_or(exponent);
        return !exponent.is_empty() && digits(exponent) == exponent.len();
    }
    rest.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_no_fault() {
        for text in ["{}", "[]", " [1, -2.5e-3, {\"a\": [true, null, \"x\\n\"]}, []] ", "0", "\"a\"", "1E+5"] {
            assert_eq!(fault(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn a_fault_is_where_its_token_begins() {
        for (text, at, wanted) in [
            ("", 0, Wanted::Value),
            ("{\"a\": 01}", 6, Wanted::Value),
            ("{\"a\": True}", 6, Wanted::Value),
            ("[1,]", 3, Wanted::Value),
            ("{\"a\": 1,}", 8, Wanted::Key),
            ("{\"a\" 1}", 5, Wanted::Colon),
            ("[1 2]", 3, Wanted::Separator),
            ("[1}", 2, Wanted::Separator),
            ("{} {}", 3, Wanted::End),
            ("[\"a\n\"]", 3, Wanted::Text),
            ("[\"a", 3, Wanted::Text),
        ] {
            let fault = fault(text.as_bytes()).unwrap();
            assert_eq!((fault.at, fault.wanted), (at, wanted), "{text}");
        }
    }
}
