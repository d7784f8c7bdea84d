//! One panel of a plot: the lines of a few fields of similar magnitude, over the common time axis.

use super::axis::Axis;
use super::elements::{line, text};
use super::legend::{COLOURS, names, polyline};
use super::thinning::thin;
use crate::Field;
use svg::node::element::Group;

/// Largest number of lines (fields) in one panel of a plot.
pub const MOST_LINES: usize = COLOURS;

/// Height of the names above the lines of a panel, in pixels.
pub const HEADING: f64 = 26.0;

/// Number of characters that fit into the heading of a panel beside the marks of the lines.
const HEADING_CHARACTERS: usize = 78;

/// Height per tick of the ordinate, in pixels, and the largest number of ticks of a panel.
const TICK: f64 = 30.0;
const MOST_TICKS: usize = 5;

/// Free space above and below the lines of a panel, relative to the span of their values.
const MARGIN: f64 = 0.08;

/// The parts that all panels of a plot share: the time axis and its position, and the switches.
pub struct Stage<'a> {
    /// The times of the values in all fields.
    pub t: &'a [f64],
    /// The time axis of the plot.
    pub axis: Axis,
    /// Position of the low end of the time axis, in pixels.
    pub left: f64,
    /// Position of the high end of the time axis, in pixels.
    pub right: f64,
    /// Horizontal positions of the switches, in pixels from the left of the plot.
    pub switches: Vec<f64>,
}

impl Stage<'_> {
    /// Returns the horizontal position of the time `t`, in pixels from the left of the plot.
    pub fn x(&self, t: f64) -> f64 {
        self.left + self.axis.fraction(t) * (self.right - self.left)
    }
}

/// Draws the panel of `fields` with their heading, from `top` on; the lines are `height` pixels high, and the first
/// line has colour number `colour`.
pub fn panel(stage: &Stage<'_>, fields: &[&Field], top: f64, height: f64, colour: usize) -> Group {
    let axis = Axis::spanning(fields.iter().flat_map(|field| field.values.iter().copied()), MARGIN);
    let (ceiling, floor) = (top + HEADING, top + HEADING + height);
    let y = |value: f64| floor - axis.fraction(value) * height;
    let line_of = |k: usize| (colour + k) % COLOURS;
    let named: Vec<_> = fields.iter().enumerate().map(|(k, field)| (line_of(k), field.name.as_str())).collect();
    let each = HEADING_CHARACTERS / fields.len().max(1);
    let mut group = Group::new().add(names(&named, each, stage.left, ceiling - 8.0));
    if let Some(unit) = axis.unit() {
        group = group.add(text(unit, "faint end", stage.left - 8.0, ceiling - 8.0));
    }
    for tick in axis.ticks(((height / TICK) as usize).min(MOST_TICKS)) {
        let y = floor - tick.fraction * height;
        group = group.add(line("grid", (stage.left, y), (stage.right, y)));
        group = group.add(text(tick.label, "end", stage.left - 8.0, y + 4.0));
    }
    for tick in stage.axis.ticks(super::TIME_TICKS) {
        let x = stage.left + tick.fraction * (stage.right - stage.left);
        group = group.add(line("grid", (x, ceiling), (x, floor)));
    }
    for &x in &stage.switches {
        group = group.add(line("switch", (x, ceiling), (x, floor)));
    }
    for (k, field) in fields.iter().enumerate() {
        let finite = stage.t.iter().zip(&field.values).filter(|(t, value)| t.is_finite() && value.is_finite());
        let points = thin(finite.map(|(&t, &value)| (stage.x(t), y(value))));
        group = group.add(polyline(&points, line_of(k)));
    }
    group
}
