//! Display of an error with a caret at its position in the text.

use super::error::ExpressionError;
use std::iter::repeat_n;

/// The maximum number of characters of an erroneous expression that an error message shows above the caret.
const WIDTH: usize = 72;

/// The mark of omitted text at either end of the part of an expression that an error message shows.
const ELLIPSIS: &str = "...";

impl ExpressionError {
    /// Returns two lines: the text, or a window of a long text, and a caret under the error. Line breaks and tabs are
    /// shown as spaces, control characters as U+FFFD, so that the caret is aligned.
    pub fn caret(&self, text: &str) -> String {
        let place = text.floor_char_boundary(self.offset);
        let (before, after) = text.split_at(place);
        let reach = WIDTH / 2;
        // If the text on one side of the caret is short, give its unused width to the other side.
        let shown_before = shown(before.chars().rev(), WIDTH - shown(after.chars(), reach));
        let shown_after = shown(after.chars(), WIDTH - shown_before);
        let start = before.char_indices().rev().take(shown_before).last().map_or(place, |(start, _)| start);
        let end = after.char_indices().nth(shown_after).map_or(text.len(), |(end, _)| place + end);

        let left = if start > 0 { ELLIPSIS } else { "" };
        let right = if end < text.len() { ELLIPSIS } else { "" };
        let window: String = text[start..end].chars().map(printable).collect();
        let margin: String = repeat_n(' ', left.len() + shown_before).collect();
        format!("{left}{window}{right}\n{margin}^")
    }
}

/// Counts the characters of a text, up to the limit `room`.
fn shown(characters: impl Iterator<Item = char>, room: usize) -> usize {
    characters.take(room).count()
}

fn printable(character: char) -> char {
    match character {
        '\t' | '\n' | '\r' => ' ',
        control if control.is_control() => char::REPLACEMENT_CHARACTER,
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(offset: usize, text: &str) -> String {
        ExpressionError::new("syntax", offset, String::new()).caret(text)
    }

    #[test]
    fn a_short_text_is_shown_whole() {
        assert_eq!(at(4, "x + * y"), "x + * y\n    ^");
        assert_eq!(at(3, "x +"), "x +\n   ^");
        assert_eq!(at(0, ""), "\n^");
    }

    #[test]
    fn a_long_text_is_shown_around_the_place() {
        let text = format!("{}?{}", "a".repeat(500), "b".repeat(500));
        let expected = format!("...{}?{}...\n{}^", "a".repeat(36), "b".repeat(35), " ".repeat(39));
        assert_eq!(at(500, &text), expected);
    }

    #[test]
    fn the_window_of_a_long_text_is_full_at_its_ends() {
        let text = "a".repeat(500);
        assert_eq!(at(0, &text), format!("{}...\n^", "a".repeat(72)));
        assert_eq!(at(500, &text), format!("...{}\n{}^", "a".repeat(72), " ".repeat(75)));
    }

    #[test]
    fn what_cannot_be_printed_does_not_move_the_caret() {
        assert_eq!(at(4, "x\t+\n?"), "x + ?\n    ^");
        assert_eq!(at(2, "x\0?"), "x\u{fffd}?\n  ^");
        assert_eq!(at(4, "\u{3bc}\u{3bc}?"), "\u{3bc}\u{3bc}?\n  ^");
        assert_eq!(at(3, "\u{3bc}\u{3bc}?"), "\u{3bc}\u{3bc}?\n ^");
        assert_eq!(at(99, "x"), "x\n ^");
    }
}
