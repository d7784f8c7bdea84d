//! Plots of a solution in SVG: its fields over time in panels below each other, with a common time axis and separate
//! ordinates (small multiples: E. R. Tufte, "Envisioning Information", 1990, chapter 4).
//!
//! Up to eight fields have a panel each. More fields are sorted by magnitude and share panels. Switches of the active
//! face and contact events are thin vertical lines. The plot is light or dark according to the reader's preference.

mod axis;
mod double_logarithmic;
mod elements;
mod legend;
mod members;
mod overview;
mod panel;
mod thinning;
mod work_precision;

use super::{CheckCode, Event, EventKind, Field, Solution, Status};
use axis::Axis;
use elements::{line, plain, text};
use panel::{HEADING, MOST_LINES, Stage, panel};
use std::io::{self, Write};
use svg::Document;
use svg::node::element::{Rectangle, Style, Title};

pub use double_logarithmic::{Curve, double_logarithmic};
pub use overview::{Arrangement, LARGE, SMALL, Words, overview};
pub use work_precision::{curves, work_precision};

const MOST_PANELS: usize = 8;
const WIDTH: f64 = 760.0;
const LEFT: f64 = 68.0;
const RIGHT: f64 = WIDTH - 24.0;
/// Height of the title of a plot, in pixels.
const TITLE: f64 = 44.0;
/// Height of the labels of the time axis and the remarks below it, in pixels.
const FOOT: f64 = 58.0;
/// Approximate number of intervals between the ticks of the time axis.
const TIME_TICKS: usize = 10;
/// Least distance in pixels between two switches of variables that are drawn separately.
const APART: f64 = 2.0;
/// Number of characters that fit into a line of the plot, and into a line of a title in large type.
const LINE_CHARACTERS: usize = 80;
const LARGE_CHARACTERS: usize = 60;

/// Writes the plot of a solution, under its label. The plot shows error against run time for a study, and the table
/// for a sweep.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_svg(solution: &Solution, label: Option<&str>, out: &mut impl Write) -> io::Result<()> {
    if let Some(study) = &solution.study {
        return writeln!(out, "{}", study.picture);
    }
    if let Some(table) = &solution.table {
        return writeln!(out, "{}", members::members(solution, table, label));
    }
    let trajectory = &solution.trajectory;
    let axis = Axis::spanning(trajectory.t.iter().copied(), 0.0);
    let mut stage = Stage { t: &trajectory.t, axis, left: LEFT, right: RIGHT, switches: Vec::new() };
    stage.switches = switches(solution, &stage);
    let panels = if trajectory.t.is_empty() { Vec::new() } else { panels(&trajectory.fields) };
    // A few panels are high, and many panels are low, so that the whole plot fits on a screen.
    let height = (60.0 + 240.0 / panels.len().max(1) as f64).round();
    let floor = TITLE + panels.len() as f64 * (HEADING + height);

    let title = plain(label.unwrap_or("Trajectory"), LINE_CHARACTERS);
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
    let mut colour = 0;
    for (k, fields) in panels.iter().enumerate() {
        picture = picture.add(panel(&stage, fields, TITLE + k as f64 * (HEADING + height), height, colour));
        colour += fields.len();
    }
    if !panels.is_empty() {
        for tick in stage.axis.ticks(TIME_TICKS) {
            let x = LEFT + tick.fraction * (RIGHT - LEFT);
            picture = picture.add(line("tick", (x, floor), (x, floor + 4.0)));
            picture = picture.add(text(tick.label, "middle", x, floor + 18.0));
        }
        let unit = stage.axis.unit().map_or_else(|| "t".to_owned(), |unit| format!("t  {unit}"));
        picture = picture.add(line("tick", (LEFT, floor), (RIGHT, floor)));
        picture = picture.add(text(unit, "faint end", RIGHT, floor + 38.0));
    }
    picture = picture.add(text(plain(&remarks(solution, &panels), LINE_CHARACTERS), "faint", LEFT, floor + 38.0));
    writeln!(out, "{picture}")
}

/// Distributes the fields of the answer over the panels of the plot.
fn panels(fields: &[Field]) -> Vec<Vec<&Field>> {
    let mut fields: Vec<&Field> = fields.iter().take(MOST_PANELS * MOST_LINES).collect();
    let lines = fields.len().div_ceil(MOST_PANELS).max(1);
    if lines > 1 {
        fields.sort_by(|a, b| magnitude(b).total_cmp(&magnitude(a)));
    }
    fields.chunks(lines).map(<[&Field]>::to_vec).collect()
}

fn magnitude(field: &Field) -> f64 {
    field.values.iter().fold(0.0, |largest, value| value.abs().max(largest))
}

/// Returns the horizontal positions of the switches in the plot, with indistinguishable ones merged.
fn switches(solution: &Solution, stage: &Stage<'_>) -> Vec<f64> {
    let events = solution.trajectory.events.iter();
    let within = events.filter(|event| (0.0..=1.0).contains(&stage.axis.fraction(event.t)));
    let mut places: Vec<f64> = within.map(|event| stage.x(event.t)).collect();
    places.sort_by(f64::total_cmp);
    places.dedup_by(|x, before| *x - *before < APART);
    places
}

/// Returns the text of the remarks below the plot.
fn remarks(solution: &Solution, panels: &[Vec<&Field>]) -> String {
    let mut remarks = Vec::new();
    if let (Some(error), Status::Failed | Status::Stopped) = (&solution.error, solution.status) {
        let ended = if solution.status == Status::Failed { "failed" } else { "stopped" };
        remarks.push(format!("{ended} at t = {}: {}", error.time, error.code));
    }
    let because = solution.verdict.because.iter().map(|reason| reason.code);
    let because: Vec<String> =
        because.filter(|code| *code != CheckCode::NotAtEnd).map(|code| code.to_string()).collect();
    if !because.is_empty() {
        remarks.push(format!("not trusted: {}", because.join(", ")));
    }
    if panels.is_empty() {
        remarks.push("there is nothing to show".to_owned());
        return remarks.join("; ");
    }
    let events = &solution.trajectory.events;
    let of_face = |event: &Event| matches!(event.kind, EventKind::Activated | EventKind::Deactivated);
    match (events.len(), events.iter().all(of_face)) {
        (0, _) => {}
        (1, true) => remarks.push("dashed: a switch of the active face".to_owned()),
        (count, true) => remarks.push(format!("dashed: {count} switches of the active face")),
        (1, false) => remarks.push("dashed: a change of a contact".to_owned()),
        (count, false) => remarks.push(format!("dashed: {count} changes of contacts")),
    }
    let shown: usize = panels.iter().map(Vec::len).sum();
    if shown < solution.trajectory.fields.len() {
        remarks.push(format!("{shown} of {} fields", solution.trajectory.fields.len()));
    }
    remarks.join("; ")
}

#[cfg(test)]
mod tests;
