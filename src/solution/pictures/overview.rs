//! Overview of the errors of many runs: panels with common axes in powers of ten (small multiples: E. R. Tufte,
//! "Envisioning Information", 1990, chapter 4), so that panels can be compared.

use super::double_logarithmic::{CROSSES, Curve, Decades, power, told_of_marks};
use super::elements::{line, plain, tenths, text};
use super::legend::Legend;
use super::{LEFT, LINE_CHARACTERS, RIGHT, WIDTH};
use svg::Document;
use svg::node::element::{Group, Rectangle, Style, Title};

/// Layout in pixels: the base lines of the title and of the first row of the legend, the distance from there to the
/// names of the first panels, the distances between rows and between columns of panels, and the height of the foot.
const TITLE: f64 = 30.0;
const LEGEND: f64 = 54.0;
const NAMES: f64 = 44.0;
const BETWEEN: f64 = 30.0;
const GAP: f64 = 14.0;
const FOOT: f64 = 64.0;
/// The width in pixels of a character in the name of a panel.
const CHARACTER: f64 = 6.6;
/// The space for a label on either axis of an overview, in pixels.
const LABEL: f64 = 30.0;

/// The arrangement of the panels in an overview.
#[derive(Clone, Copy, Debug)]
pub struct Arrangement {
    /// Number of panels in a row of the overview.
    pub columns: usize,
    /// The height of a panel between its axes, in pixels.
    pub height: f64,
    /// The radius of the mark of a run, in pixels.
    pub radius: f64,
}

/// The arrangement of an overview with many small panels.
pub const SMALL: Arrangement = Arrangement { columns: 4, height: 92.0, radius: 2.0 };
/// The arrangement of an overview with few large panels.
pub const LARGE: Arrangement = Arrangement { columns: 2, height: 190.0, radius: 3.0 };

/// The texts of an overview of errors: title and labels of the axes.
#[derive(Clone, Copy, Debug)]
pub struct Words<'a> {
    /// The title, for screen readers; also drawn if `titled` is set.
    pub title: &'a str,
    /// Whether the title of the overview is drawn.
    pub titled: bool,
    /// The label of the ordinate of all panels.
    pub ordinate: &'a str,
    /// The label of the abscissa of all panels.
    pub abscissa: &'a str,
}

/// Draws an overview as an SVG document. Each panel has a name and curves; the curves of all panels have the same
/// meaning, in the same order.
pub fn overview(panels: &[(&str, Vec<Curve>)], words: Words<'_>, arrangement: Arrangement) -> String {
    let Arrangement { columns, height, .. } = arrangement;
    let columns = columns.min(panels.len()).max(1);
    let width = (RIGHT - LEFT - GAP * (columns - 1) as f64) / columns as f64;
    let curves = || panels.iter().flat_map(|(_, curves)| curves);
    let x = Decades::spanning(curves().flat_map(Curve::abscissae), 0.0, width);
    let y = Decades::spanning(curves().flat_map(|curve| &curve.points).map(|point| point.1), height, 0.0);
    let lost = if curves().any(|curve| !curve.lost.is_empty()) { CROSSES } else { 0.0 };
    let shift = if words.titled { 0.0 } else { LEGEND - TITLE };
    let names = panels.first().map_or(&[][..], |(_, curves)| curves).iter().map(|curve| curve.name.as_str());
    let legend = Legend::new(names, LEFT, RIGHT);
    let top = LEGEND - shift + legend.extra() + NAMES + lost;
    let row = height + BETWEEN + lost;
    let floor = top + panels.len().div_ceil(columns) as f64 * row - BETWEEN - lost;
    let mut picture = Document::new()
        .set("viewBox", (0.0, 0.0, WIDTH, floor + FOOT))
        .set("width", WIDTH)
        .set("height", floor + FOOT)
        .set("role", "img")
        .add(Title::new(words.title))
        .add(Style::new(include_str!("style.css")))
        .add(Rectangle::new().set("class", "paper").set("width", "100%").set("height", "100%").set("rx", 8))
        .add(legend.drawn(LEGEND - shift));
    if words.titled {
        picture = picture.add(text(plain(words.title, LINE_CHARACTERS), "title", LEFT, TITLE));
    }
    for (k, (name, curves)) in panels.iter().enumerate() {
        let (left, down) = ((k % columns) as f64 * (width + GAP), (k / columns) as f64 * row);
        let lowest = k + columns >= panels.len();
        let place = format!("translate({}, {})", tenths(LEFT + left), tenths(top + down));
        let last = k % columns == columns - 1 || k + 1 == panels.len();
        let group = panel(name, curves, (&x, &y), (k % columns == 0, lowest, last), (arrangement.radius, lost));
        picture = picture.add(group.set("transform", place));
    }
    picture
        .add(text(plain(words.ordinate, LINE_CHARACTERS), "faint", LEFT, top - lost - 22.0))
        .add(text(words.abscissa, "faint end", RIGHT, floor + 38.0))
        .add(text(told_of_marks(curves()), "faint", LEFT, floor + 54.0))
        .to_string()
}

/// Draws a panel with its origin at the upper left. Labels of the ordinate are drawn for the `first` panel of a row,
/// labels of the abscissa for the `lowest` panel of a column, except labels that would overlap the panel to the
/// right.
fn panel(
    name: &str,
    curves: &[Curve],
    (x, y): (&Decades, &Decades),
    (first, lowest, last): (bool, bool, bool),
    (radius, lost): (f64, f64),
) -> Group {
    let mut group = Group::new().add(text(plain(name, (x.to / CHARACTER) as usize), "", 0.0, -6.0 - lost));
    for decade in grid(y, 0.6 * LABEL) {
        let at = y.place(10f64.powi(decade));
        group = group.add(line("grid", (0.0, at), (x.to, at)));
        if first {
            group = group.add(text(power(decade), "end", -6.0, at + 4.0));
        }
    }
    for decade in grid(x, LABEL) {
        let at = x.place(10f64.powi(decade));
        group = group.add(line("grid", (at, 0.0), (at, y.from)));
        if lowest && (last || at < x.to - 0.5 * LABEL) {
            group = group.add(text(power(decade), "middle", at, y.from + 16.0));
        }
    }
    for (k, curve) in curves.iter().enumerate().filter(|(_, curve)| !curve.points.is_empty() || !curve.lost.is_empty())
    {
        group = group.add(curve.drawn(k, radius, (x, y), -0.6 * lost));
    }
    group
}

/// Returns decades of an axis that are at least `room` pixels apart, at multiples of 1, 2, 4, ..
fn grid(axis: &Decades, room: f64) -> Vec<i32> {
    let decade = (axis.to - axis.from).abs() / f64::from(axis.high - axis.low);
    let mut every = 1;
    while f64::from(every) * decade < room && every < axis.high - axis.low {
        every *= 2;
    }
    (axis.low..=axis.high).filter(|decade| decade.rem_euclid(every) == 0).collect()
}
