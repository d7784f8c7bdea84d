//! Error against run time, both in powers of ten: a line for each series, a dot for each run. The better a method, the
//! further to the lower left its line.

use super::elements::{line, plain, tenths, text};
use super::panel::{MOST_LINES, polyline};
use super::thinning::Point;
use super::{LARGE_CHARACTERS, LEFT, LINE_CHARACTERS, RIGHT, WIDTH};
use crate::solution::{Series, StudyRun};
use svg::Document;
use svg::node::element::{Circle, Rectangle, Style, TSpan, Title};

const TOP: f64 = 70.0;
const FLOOR: f64 = 400.0;
const HEIGHT: f64 = 460.0;
/// Errors below this are rounding, and shown at it.
const LEAST_ERROR: f64 = 1e-17;
/// Decades that have room for a label each.
const MOST_LABELS: i32 = 10;

/// An axis in powers of ten, from pixel to pixel.
struct Decades {
    low: i32,
    high: i32,
    from: f64,
    to: f64,
}

impl Decades {
    /// All decades of the values.
    fn spanning(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        let (low, high) = if low <= high { (low, high) } else { (1.0, 1.0) };
        let (low, high) = (low.log10().floor() as i32, high.log10().ceil() as i32);
        Self { low, high: high.max(low + 1), from, to }
    }

    fn place(&self, value: f64) -> f64 {
        let fraction = (value.log10() - f64::from(self.low)) / f64::from(self.high - self.low);
        self.from + fraction * (self.to - self.from)
    }

    /// The decades with a label.
    fn ticks(&self) -> impl Iterator<Item = i32> {
        let step = (self.high - self.low - 1) / MOST_LABELS + 1;
        (self.low..=self.high).step_by(step as usize)
    }
}

/// The picture of a study: errors at the end, relative, against run times in seconds.
pub fn work_precision(series: &[Series], label: Option<&str>, reference: &str) -> String {
    let point = |run: &StudyRun| Some((run.wall_seconds.max(1e-9), run.error_at_end?.max(LEAST_ERROR)));
    let points: Vec<Vec<Point>> = series.iter().map(|series| series.runs.iter().filter_map(point).collect()).collect();
    let all = || points.iter().flatten();
    let x = Decades::spanning(all().map(|point| point.0), LEFT, RIGHT);
    let y = Decades::spanning(all().map(|point| point.1), FLOOR, TOP);
    let title = plain(label.unwrap_or("Error against run time"), LINE_CHARACTERS);
    let class = if title.chars().count() > LARGE_CHARACTERS { "long title" } else { "title" };
    let mut picture = Document::new()
        .set("viewBox", (0.0, 0.0, WIDTH, HEIGHT))
        .set("width", WIDTH)
        .set("height", HEIGHT)
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
            picture.add(line("grid", (at, TOP), (at, FLOOR))).add(text(power(decade), "middle", at, FLOOR + 18.0));
    }
    let mut names = text("", "name", LEFT, 56.0);
    for (k, (series, points)) in series.iter().zip(&points).enumerate() {
        let mark = TSpan::new("●").set("class", format!("mark{}", k % MOST_LINES));
        let mark = if k == 0 { mark } else { mark.set("dx", 12) };
        names = names.add(mark).add(TSpan::new(plain(&series.method, 30)).set("dx", 5));
        let shown: Vec<Point> = points.iter().map(|point| (x.place(point.0), y.place(point.1))).collect();
        picture = picture.add(polyline(&shown, k));
        for (at, height) in shown {
            let dot = Circle::new().set("cx", tenths(at)).set("cy", tenths(height)).set("r", 3.5);
            picture = picture.add(dot.set("class", format!("mark{}", k % MOST_LINES)));
        }
    }
    let against = plain(&format!("relative error at the end, against {reference}"), LINE_CHARACTERS);
    picture
        .add(names)
        .add(text(against, "faint", LEFT, FLOOR + 38.0))
        .add(text("run time in s", "faint end", RIGHT, FLOOR + 38.0))
        .to_string()
}

/// `10⁻³`.
fn power(decade: i32) -> String {
    format!("10{}", super::axis::raised(decade))
}
