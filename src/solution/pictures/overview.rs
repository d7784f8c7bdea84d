//! Error against run time of many systems at a glance: a small panel for each, with the same logarithmic axes for
//! comparison (small multiples: E. R. Tufte, "Envisioning Information", 1990, chapter 4).

use super::double_logarithmic::{Curve, Decades, power, told_of_marks};
use super::elements::{line, plain, tenths, text};
use super::legend::{Legend, polyline};
use super::thinning::Point;
use super::{LEFT, LINE_CHARACTERS, RIGHT, WIDTH};
use svg::Document;
use svg::node::element::{Group, Rectangle, Style, Title};

const COLUMNS: usize = 4;
/// Top of the first panel; height of panels; distances between them; height of the foot.
const TOP: f64 = 84.0;
const HEIGHT: f64 = 92.0;
const BETWEEN: f64 = 26.0;
const GAP: f64 = 14.0;
const FOOT: f64 = 64.0;
/// The size of a mark.
const RADIUS: f64 = 2.0;
/// Decades between horizontal grid lines.
const EVERY: i32 = 4;

/// Draws named panels; the curves of all panels have the same meaning in the same order.
pub fn overview(panels: &[(&str, Vec<Curve>)], title: &str, below: &str, abscissa: &str) -> String {
    let width = (RIGHT - LEFT - GAP * (COLUMNS - 1) as f64) / COLUMNS as f64;
    let all = || panels.iter().flat_map(|(_, curves)| curves).flat_map(|curve| &curve.points);
    let x = Decades::spanning(all().map(|point| point.0), 0.0, width);
    let y = Decades::spanning(all().map(|point| point.1), HEIGHT, 0.0);
    let rows = panels.len().div_ceil(COLUMNS);
    let floor = TOP + rows as f64 * (HEIGHT + BETWEEN) - BETWEEN;
    let mut picture = Document::new()
        .set("viewBox", (0.0, 0.0, WIDTH, floor + FOOT))
        .set("width", WIDTH)
        .set("height", floor + FOOT)
        .set("role", "img")
        .add(Title::new(title))
        .add(Style::new(include_str!("style.css")))
        .add(Rectangle::new().set("class", "paper").set("width", "100%").set("height", "100%").set("rx", 8))
        .add(text(plain(title, LINE_CHARACTERS), "title", LEFT, 30.0));
    if let Some((_, curves)) = panels.first() {
        let legend = Legend::new(curves.iter().map(|curve| curve.name.as_str()), LEFT, RIGHT);
        picture = picture.add(legend.drawn(54.0));
    }
    for (k, (name, curves)) in panels.iter().enumerate() {
        let (left, top) = ((k % COLUMNS) as f64 * (width + GAP), (k / COLUMNS) as f64 * (HEIGHT + BETWEEN));
        let lowest = k + COLUMNS >= panels.len();
        let place = format!("translate({}, {})", tenths(LEFT + left), tenths(TOP + top));
        picture = picture.add(panel(name, curves, (&x, &y), (k % COLUMNS == 0, lowest)).set("transform", place));
    }
    picture
        .add(text(plain(below, LINE_CHARACTERS), "faint", LEFT, floor + 42.0))
        .add(text(abscissa, "faint end", RIGHT, floor + 42.0))
        .add(text(told_of_marks(panels.iter().flat_map(|(_, curves)| curves)), "faint", LEFT, floor + 58.0))
        .to_string()
}

/// Draws a panel with its origin at the upper left. It has ordinate labels if it is the first of its row, and abscissa
/// labels if it is the last of its column.
fn panel(name: &str, curves: &[Curve], (x, y): (&Decades, &Decades), (first, lowest): (bool, bool)) -> Group {
    let grid =
        |axis: &Decades| (axis.low..=axis.high).filter(|decade| decade.rem_euclid(EVERY) == 0).collect::<Vec<i32>>();
    let mut group = Group::new().add(text(plain(name, 24), "", 0.0, -6.0));
    for decade in grid(y) {
        let at = y.place(10f64.powi(decade));
        group = group.add(line("grid", (0.0, at), (x.to, at)));
        if first {
            group = group.add(text(power(decade), "end", -6.0, at + 4.0));
        }
    }
    for decade in (x.low..=x.high).filter(|decade| decade.rem_euclid(2) == 0) {
        let at = x.place(10f64.powi(decade));
        group = group.add(line("grid", (at, 0.0), (at, y.from)));
        if lowest {
            group = group.add(text(power(decade), "middle", at, y.from + 16.0));
        }
    }
    for (k, curve) in curves.iter().enumerate() {
        let place = |point: Point| (x.place(point.0), y.place(point.1));
        let shown: Vec<Point> = curve.points.iter().copied().map(place).collect();
        group = group.add(polyline(&shown, k)).add(curve.marks(k, RADIUS, place));
    }
    group
}
