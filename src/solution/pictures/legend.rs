//! Styles that distinguish the lines of a plot, first by six colours, then by dashes and mark shapes, and the legend
//! of the lines.

use super::elements::{plain, tenths, text};
use super::thinning::Point;
use svg::node::element::{Group, Path, Polyline, TSpan, Text};

/// Number of distinct colours of the lines of a plot.
pub const COLOURS: usize = 6;

/// The shapes of the marks on lines as text: one for each pass through the line colours. After the last, the shapes
/// repeat.
const SHAPES: [&str; 3] = ["●", "■", "▲"];

/// Widths in pixels of a mark in the legend with its margins, and of the widest and of other characters of a wide
/// typeface.
const MARK: f64 = 38.0;
const WIDE: f64 = 13.0;
const CHARACTER: f64 = 7.6;

/// Height of a row of the legend, in pixels.
pub const ROW: f64 = 20.0;

/// Largest number of characters of a name in the legend.
const NAME: usize = 44;

/// The legend of a plot: the names of the lines, in rows that fit between `left` and `right`.
pub struct Legend<'a> {
    rows: Vec<Vec<(usize, &'a str)>>,
    left: f64,
}

impl<'a> Legend<'a> {
    /// Breaks the names of the lines into rows of the legend.
    pub fn new(names: impl Iterator<Item = &'a str>, left: f64, right: f64) -> Self {
        let (mut rows, mut at) = (vec![Vec::new()], left);
        for (k, name) in names.enumerate() {
            let width = MARK + name.chars().take(NAME).map(width).sum::<f64>();
            if at + width > right && at > left {
                rows.push(Vec::new());
                at = left;
            }
            at += width;
            rows.last_mut().expect("there is a first row").push((k, name));
        }
        Self { rows, left }
    }

    /// Returns the height in pixels of all rows of the legend but the first.
    pub fn extra(&self) -> f64 {
        ROW * (self.rows.len() - 1) as f64
    }

    /// Draws the rows of the legend, the first one at height `y`.
    pub fn drawn(&self, y: f64) -> Group {
        let rows = self.rows.iter().enumerate();
        rows.fold(Group::new(), |group, (k, row)| group.add(names(row, NAME, self.left, y + ROW * k as f64)))
    }
}

/// Draws one row of the legend, each name after the mark of its line and cut to `most` characters.
pub fn names(row: &[(usize, &str)], most: usize, x: f64, y: f64) -> Text {
    row.iter().enumerate().fold(text("", "name", x, y), |names, (place, &(k, name))| {
        let mark = TSpan::new(SHAPES[round(k)]).set("class", colour("mark", k));
        let mark = if place == 0 { mark } else { mark.set("dx", 12) };
        names.add(mark).add(TSpan::new(plain(name, most)).set("dx", 5))
    })
}

/// Draws a line through `points` in the style of the `k`-th line.
pub fn polyline(points: &[Point], k: usize) -> Polyline {
    // A line of one point has no length: if the point is repeated, its round ends form a dot.
    let again = if let [only] = points { Some(only) } else { None };
    let mut shown = String::new();
    for (x, y) in points.iter().chain(again) {
        let separator = if shown.is_empty() { "" } else { " " };
        shown += &format!("{separator}{},{}", tenths(*x), tenths(*y));
    }
    let class = match round(k) {
        0 => colour("line", k),
        round => format!("{} dashes{round}", colour("line", k)),
    };
    Polyline::new().set("class", class).set("points", shown)
}

/// Draws a mark of the `k`-th line of a plot, with the area of a disc of radius `r`.
pub fn mark(place: Point, k: usize, r: f64) -> Path {
    Path::new().set("class", colour("mark", k)).set("d", shape(place, k, r))
}

/// Draws a hollow mark of the `k`-th line of a plot, with its outline in the colour of the line.
pub fn hollow(place: Point, k: usize, r: f64) -> Path {
    Path::new().set("class", format!("hollow {}", colour("line", k))).set("d", shape(place, k, r))
}

/// Draws a cross in the colour of the `k`-th line of a plot.
pub fn cross((x, y): Point, k: usize, r: f64) -> Path {
    let (low, high, left, right) = (tenths(y + r), tenths(y - r), tenths(x - r), tenths(x + r));
    let strokes = format!("M{left},{low}L{right},{high}M{left},{high}L{right},{low}");
    Path::new().set("class", format!("cross {}", colour("line", k))).set("d", strokes)
}

/// Draws a thin line in the colour of the `k`-th line of a plot.
pub fn whisker(from: Point, to: Point, k: usize) -> Path {
    let [a, b, c, d] = [from.0, from.1, to.0, to.1].map(tenths);
    Path::new().set("class", format!("whisker {}", colour("line", k))).set("d", format!("M{a},{b}L{c},{d}"))
}

fn shape((x, y): Point, k: usize, r: f64) -> String {
    let [x, y, r] = [x, y, r].map(tenths);
    match round(k) {
        0 => format!("M{},{y}a{r},{r} 0 1 0 {},0a{r},{r} 0 1 0 {},0z", tenths(x - r), 2.0 * r, -2.0 * r),
        1 => {
            let half = tenths(0.9 * r);
            format!("M{},{}h{s}v{s}h-{s}z", tenths(x - half), tenths(y - half), s = 2.0 * half)
        }
        _ => {
            let half = tenths(1.3 * r);
            format!("M{},{}h{}l-{half},-{}z", tenths(x - half), tenths(y + 0.8 * half), 2.0 * half, tenths(1.8 * half))
        }
    }
}

fn width(c: char) -> f64 {
    if matches!(c, 'm' | 'w' | 'M' | 'W') { WIDE } else { CHARACTER }
}

fn colour(of: &str, k: usize) -> String {
    format!("{of}{}", k % COLOURS)
}

fn round(k: usize) -> usize {
    k / COLOURS % SHAPES.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_have_no_room_in_a_row_begin_a_new_one() {
        let name = "x".repeat(20);
        let names = vec![name.as_str(); 7];
        let legend = Legend::new(names.into_iter(), 0.0, 600.0);
        assert_eq!(legend.rows.iter().map(Vec::len).collect::<Vec<_>>(), [3, 3, 1]);
        assert_eq!(legend.rows[2], [(6, name.as_str())]);
        assert_eq!(legend.extra(), 2.0 * ROW);
        assert_eq!(Legend::new([name.as_str()].into_iter(), 0.0, 10.0).rows.len(), 1, "a row has one name at least");
    }

    #[test]
    fn eighteen_lines_are_told_apart_by_colour_dashes_and_marks() {
        let points = [(0.0, 0.0), (9.0, 9.0)];
        let mut lines: Vec<String> = (0..18).map(|k| polyline(&points, k).to_string()).collect();
        let mut marks: Vec<String> = (0..18).map(|k| mark((5.0, 5.0), k, 3.5).to_string()).collect();
        for drawn in [&mut lines, &mut marks] {
            drawn.sort();
            drawn.dedup();
            assert_eq!(drawn.len(), 18);
        }
    }
}
