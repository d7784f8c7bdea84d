//! Plots of curves on two logarithmic axes: one line per curve, with a mark at each point.

use super::elements::{line, plain, text};
use super::legend::{Legend, cross, hollow, mark, polyline, whisker};
use super::thinning::Point;
use super::{LARGE_CHARACTERS, LEFT, LINE_CHARACTERS, RIGHT, WIDTH};
use svg::Document;
use svg::node::element::{Group, Rectangle, Style, Title};

/// Vertical positions in pixels of the names of the curves, and of the top of the axes below a single row of names.
const NAMES: f64 = 56.0;
const TOP: f64 = 70.0;
/// Heights in pixels of the axes, and of the foot below the axes.
const HEIGHT: f64 = 330.0;
const FOOT: f64 = 60.0;
/// The radius of the mark of a point, in pixels.
const RADIUS: f64 = 3.5;
/// Space above the axes for the crosses of runs without an answer, in pixels.
pub(super) const CROSSES: f64 = 14.0;
/// Largest number of decades of an axis at which each decade has a label.
const MOST_LABELS: i32 = 10;

/// A curve of a double logarithmic plot, with its marks.
#[derive(Clone, Debug, Default)]
pub struct Curve {
    /// The name of the curve in the legend.
    pub name: String,
    /// The points of the curve; both coordinates are positive.
    pub points: Vec<Point>,
    /// The points that are drawn as hollow marks: their answers are not trusted.
    pub untrusted: Vec<Point>,
    /// The abscissae of runs without an answer, which are drawn as crosses above the axes.
    pub lost: Vec<f64>,
    /// For each point with repeated runs, the least and the largest abscissa of the repeats, and their common
    /// ordinate.
    pub spread: Vec<(f64, f64, f64)>,
}

impl Curve {
    /// Draws the line, the spread and the marks of this curve in the style of the `k`-th curve; crosses are drawn at
    /// the height `above`.
    pub(super) fn drawn(&self, k: usize, radius: f64, (x, y): (&Decades, &Decades), above: f64) -> Group {
        let place = |&(a, b): &Point| (x.place(a), y.place(b));
        let shown: Vec<Point> = self.points.iter().map(place).collect();
        let mut group = Group::new().add(polyline(&shown, k));
        for &(least, largest, ordinate) in &self.spread {
            let at = y.place(ordinate);
            group = group.add(whisker((x.place(least), at), (x.place(largest), at), k));
        }
        for point in &self.points {
            let shape = if self.untrusted.contains(point) { hollow } else { mark };
            group = group.add(shape(place(point), k, radius));
        }
        self.lost.iter().fold(group, |group, &at| group.add(cross((x.place(at), above), k, radius)))
    }

    /// Returns the abscissae of all points, crosses and spreads of the curve.
    pub(super) fn abscissae(&self) -> impl Iterator<Item = f64> {
        let spread = self.spread.iter().flat_map(|&(least, largest, _)| [least, largest]);
        self.points.iter().map(|point| point.0).chain(self.lost.iter().copied()).chain(spread)
    }
}

/// Returns the text that explains hollow marks and crosses, if there are any in the plot.
pub(super) fn told_of_marks<'a>(curves: impl Iterator<Item = &'a Curve> + Clone) -> String {
    let hollow =
        curves.clone().any(|curve| !curve.untrusted.is_empty()).then_some("hollow marks: answers that are not trusted");
    let lost =
        curves.clone().any(|curve| !curve.lost.is_empty()).then_some("crosses at the top: runs without an answer");
    hollow.into_iter().chain(lost).collect::<Vec<_>>().join("; ")
}

/// A logarithmic axis from decade `low` to decade `high`, between two pixel positions.
pub(super) struct Decades {
    pub low: i32,
    pub high: i32,
    pub from: f64,
    pub to: f64,
}

impl Decades {
    /// Creates a logarithmic axis over all decades in which the values lie.
    pub fn spanning(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        let (low, high) = if low <= high { (low, high) } else { (1.0, 1.0) };
        let (low, high) = (low.log10().floor() as i32, high.log10().ceil() as i32);
        Self { low, high: high.max(low + 1), from, to }
    }

    pub fn place(&self, value: f64) -> f64 {
        let fraction = (value.log10() - f64::from(self.low)) / f64::from(self.high - self.low);
        self.from + fraction * (self.to - self.from)
    }

    /// Returns the decades of the axis that have a label.
    pub fn ticks(&self) -> impl Iterator<Item = i32> {
        let step = (self.high - self.low - 1) / MOST_LABELS + 1;
        (self.low..=self.high).step_by(step as usize)
    }
}

/// Draws a double logarithmic plot as an SVG document; `below` is the label of the ordinate, `abscissa` that of the
/// abscissa.
pub fn double_logarithmic(curves: &[Curve], title: &str, below: &str, abscissa: &str) -> String {
    let x = Decades::spanning(curves.iter().flat_map(Curve::abscissae), LEFT, RIGHT);
    let legend = Legend::new(curves.iter().map(|curve| curve.name.as_str()), LEFT, RIGHT);
    let lost = if curves.iter().any(|curve| !curve.lost.is_empty()) { CROSSES } else { 0.0 };
    let top = TOP + legend.extra() + lost;
    let floor = top + HEIGHT;
    let y = Decades::spanning(curves.iter().flat_map(|curve| &curve.points).map(|point| point.1), floor, top);
    let title = plain(title, LINE_CHARACTERS);
    let class = if title.chars().count() > LARGE_CHARACTERS { "long title" } else { "title" };
    let mut picture = Document::new()
        .set("viewBox", (0.0, 0.0, WIDTH, floor + FOOT))
        .set("width", WIDTH)
        .set("height", floor + FOOT)
        .set("role", "img")
        .add(Title::new(title.as_str()))
        .add(Style::new(include_str!("style.css")))
        .add(Rectangle::new().set("class", "paper").set("width", "100%").set("height", "100%").set("rx", 8))
        .add(text(title, class, LEFT, 30.0));
    for decade in y.ticks() {
        let at = y.place(10f64.powi(decade));
        picture =
            picture.add(line("grid", (LEFT, at), (RIGHT, at))).add(text(power(decade), "end", LEFT - 8.0, at + 4.0));
    }
    for decade in x.ticks() {
        let at = x.place(10f64.powi(decade));
        picture =
            picture.add(line("grid", (at, top), (at, floor))).add(text(power(decade), "middle", at, floor + 18.0));
    }
    for (k, curve) in curves.iter().enumerate() {
        picture = picture.add(curve.drawn(k, RADIUS, (&x, &y), top - 0.6 * CROSSES));
    }
    picture
        .add(legend.drawn(NAMES))
        .add(text(plain(below, LINE_CHARACTERS), "faint", LEFT, floor + 38.0))
        .add(text(told_of_marks(curves.iter()), "faint", LEFT, floor + 54.0))
        .add(text(abscissa, "faint end", RIGHT, floor + 38.0))
        .to_string()
}

/// Formats a power of ten as text, such as `10⁻³`.
pub(super) fn power(decade: i32) -> String {
    format!("10{}", super::axis::raised(decade))
}
