//! The basic shapes of plots. Positions are rounded to a tenth of a pixel: finer than the eye can see, and coarser
//! than the digits in which machines differ.

use super::thinning::Point;
use svg::node::element::{Line, Text};

/// Draws a straight line as an SVG element.
pub fn line(class: &str, from: Point, to: Point) -> Line {
    let ends = Line::new().set("x1", tenths(from.0)).set("y1", tenths(from.1));
    ends.set("x2", tenths(to.0)).set("y2", tenths(to.1)).set("class", class)
}

/// Draws a text that starts at `(x, y)`, or ends there if its class is `end`.
pub fn text(content: impl Into<String>, class: &str, x: f64, y: f64) -> Text {
    Text::new(content).set("x", tenths(x)).set("y", tenths(y)).set("class", class)
}

/// Returns a user's text, restricted to the characters of XML 1.0 (section 2.2) and cut to `most` characters.
pub fn plain(written: &str, most: usize) -> String {
    let allowed = |c: char| if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') { '\u{fffd}' } else { c };
    let mut rest = written.chars().map(allowed);
    let mut text: String = rest.by_ref().take(most).collect();
    if rest.next().is_some() {
        text.pop();
        text.push('…');
    }
    text
}

/// Rounds a position in a plot to a tenth of a pixel, without `-0`.
pub fn tenths(pixels: f64) -> f64 {
    (pixels * 10.0).round() / 10.0 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_cut_and_say_so() {
        assert_eq!(plain("velocity", 8), "velocity");
        assert_eq!(plain("velocities", 8), "velocit…");
    }

    #[test]
    fn characters_that_xml_forbids_are_replaced() {
        assert_eq!(plain("a\u{0}b\u{1b}c\u{ffff}", 10), "a\u{fffd}b\u{fffd}c\u{fffd}");
    }
}
