//! The tokens of a netlist. Blanks, commas and parentheses separate them; `=` is a token of its own, and so is a text
//! in braces or quotes. A line that begins with `*` is a comment, as is the text after `;` or ` $ `; a line that begins
//! with `+` continues the previous one.

use crate::wording::abridged;
use std::ops::Range;
use winnow::combinator::{alt, opt, preceded, repeat};
use winnow::prelude::*;
use winnow::stream::LocatingSlice;
use winnow::token::take_while;

/// A token of a netlist, with its line and column.
#[derive(Clone, Copy, Debug)]
pub(super) struct Token<'a> {
    pub text: &'a str,
    /// Line of the token in the netlist, counted from 1.
    pub line: usize,
    /// Column of the token in the line of the netlist, counted from 1, in characters.
    pub column: usize,
}

impl<'a> Token<'a> {
    /// Whether the token of a netlist begins like a number or an expression.
    pub fn is_like_a_number(self) -> bool {
        self.text.starts_with(|c: char| c.is_ascii_digit() || "+-.{'".contains(c))
    }

    /// Returns the text between braces or quotes, if the token is an expression in braces or quotes.
    pub fn expression(self) -> Option<&'a str> {
        let within = |open, close| self.text.strip_prefix(open)?.strip_suffix(close);
        within('{', '}').or_else(|| within('\'', '\''))
    }

    /// Returns the text of the token of a netlist, shortened for a message.
    pub fn shown(self) -> String {
        abridged(self.text)
    }
}

/// A statement: the tokens of a line of a netlist and of its continuation lines.
#[derive(Clone, Debug)]
pub(super) struct Statement<'a> {
    pub tokens: Vec<Token<'a>>,
}

/// Returns the statements of a netlist in order, without empty lines and comments.
pub(super) fn statements(text: &str) -> Vec<Statement<'_>> {
    let mut statements: Vec<Statement<'_>> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let indent = line.len() - line.trim_start().len();
        let (goes_on, offset) = match line.as_bytes().get(indent) {
            None | Some(b'*') => continue,
            Some(b'+') => (true, indent + 1),
            Some(_) => (false, 0),
        };
        let code = line[offset..].split(';').next().unwrap_or_default();
        let code = code.split(" $ ").next().unwrap_or_default();
        let tokens: Vec<Token<'_>> = words(code)
            .into_iter()
            .map(|(text, place)| {
                let column = line[..offset + place.start].chars().count() + 1;
                Token { text, line: number + 1, column }
            })
            .collect();
        match statements.last_mut() {
            Some(last) if goes_on => last.tokens.extend(tokens),
            _ if tokens.is_empty() => {}
            _ => statements.push(Statement { tokens }),
        }
    }
    statements
}

/// Splits a line of a netlist into words with their byte ranges.
fn words(text: &str) -> Vec<(&str, Range<usize>)> {
    fn is_blank(c: char) -> bool {
        c.is_whitespace() || "(),".contains(c)
    }
    let until = |close: char| take_while(0.., move |c: char| c != close);
    let word = alt((
        "=",
        ('{', until('}'), opt('}')).take(),
        ('\'', until('\''), opt('\'')).take(),
        take_while(1.., |c: char| !is_blank(c) && !"={'".contains(c)),
    ));
    let blanks = || take_while::<_, LocatingSlice<&str>, winnow::error::EmptyError>(0.., is_blank);
    let mut all = repeat(0.., preceded(blanks(), word.with_span()));
    // Every character of the line that is not a blank belongs to a word, so only blanks can remain unread.
    all.parse_next(&mut LocatingSlice::new(text)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_expression_in_braces_or_quotes_is_one_word() {
        let told: Vec<&str> = words("R1 a b {2*(r + 1)} x='a, b'\t{open").into_iter().map(|(word, _)| word).collect();
        assert_eq!(told, ["R1", "a", "b", "{2*(r + 1)}", "x", "=", "'a, b'", "{open"]);
    }

    #[test]
    fn lines_go_on_and_comments_say_nothing() {
        let text = "* title\nV1 in 0 PULSE(0,5\n\n+ 1m) ; as the source\n; nothing\nC1 a 0 1u IC=5";
        let words: Vec<Vec<(&str, usize, usize)>> = statements(text)
            .into_iter()
            .map(|statement| statement.tokens.iter().map(|t| (t.text, t.line, t.column)).collect())
            .collect();
        let first =
            vec![("V1", 2, 1), ("in", 2, 4), ("0", 2, 7), ("PULSE", 2, 9), ("0", 2, 15), ("5", 2, 17), ("1m", 4, 3)];
        let second =
            vec![("C1", 6, 1), ("a", 6, 4), ("0", 6, 6), ("1u", 6, 8), ("IC", 6, 11), ("=", 6, 13), ("5", 6, 14)];
        assert_eq!(words, [first, second]);
    }
}
