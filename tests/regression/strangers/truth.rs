//! The known solution of a problem from outside the project, as its file states it, and the comparison of a result
//! with it.

use crate::reference::digits;
use dvi::solution::{EventKind, Solution, Status};
use serde::Deserialize;
use serde_json::Value;
use serde_json::value::RawValue;
use std::collections::BTreeMap;

/// A problem from outside the project with its known solution: the contents of a file in `tests/reference/strangers`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Problem {
    /// The kind of failure of the solver when the problem was added: A a wrong result, B no end, C an error, D a wrong
    /// verdict or message, E slowness.
    pub class: char,
    /// A description of what makes the problem hard.
    #[serde(rename = "about")]
    _about: String,
    /// The publication or computation from which the known solution is taken.
    #[serde(rename = "source")]
    _source: String,
    /// Limit of the solve's computing time in seconds, for an optimised build.
    pub seconds: u32,
    pub truth: Truth,
    /// The specification as text, since the order of JSON members is part of the problem.
    pub specification: Box<RawValue>,
}

/// The properties by which a result of the problem is recognised as right.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Truth {
    /// Output times, and the exact values of fields at these times.
    t: Vec<f64>,
    fields: BTreeMap<String, Values>,
    /// For each listed kind of event of a variable or a contact, the exact times of all such events.
    events: Vec<Times>,
    /// The number of events of a kind, exactly or as a lower bound.
    counts: Vec<Count>,
    /// The smallest and the largest permitted value of a field at any time.
    bounds: BTreeMap<String, [f64; 2]>,
    /// Values that the diagnostics of the solution must contain.
    evidence: Vec<Evidence>,
    /// The time after which no solution of the problem exists.
    no_solution_after: Option<Time>,
    /// Whether a refusal of the problem, or an early end of the run with a stated cause, is right as well.
    pub may_be_refused: bool,
    /// Whether the only requirement is that the run stops when it is cancelled.
    pub stops: bool,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Values {
    within: f64,
    values: Vec<Value>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Times {
    kind: EventKind,
    of: String,
    within: f64,
    t: Vec<Value>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Count {
    kind: EventKind,
    count: Option<usize>,
    at_least: Option<usize>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Evidence {
    /// A JSON pointer to a value in the diagnostics of the solution.
    at: String,
    is: Option<Value>,
    at_most: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Time {
    t: Value,
    within: f64,
}

impl Truth {
    /// Returns a message on the first error of a completed result, compared with the known solution.
    pub fn fault(&self, solution: &Solution) -> Option<String> {
        if let Some(Time { t, .. }) = &self.no_solution_after {
            return Some(format!("reached the end, and there is no solution after t = {}", digits(t)));
        }
        let fields = self.fields.iter().filter_map(|(name, values)| self.off(solution, name, values));
        let bounds = self.bounds.iter().filter_map(|(name, bounds)| outside(solution, name, *bounds));
        let events = self.events.iter().filter_map(|times| times.off(solution));
        let counts = self.counts.iter().filter_map(|Count { kind, count, at_least }| {
            let found = solution.trajectory.events.iter().filter(|event| event.kind == *kind).count();
            if count.is_some_and(|count| found != count) || at_least.is_some_and(|least| found < least) {
                return Some(format!("{found} events {kind:?}"));
            }
            None
        });
        fields.chain(bounds).chain(events).chain(counts).next()
    }

    /// Returns a message on the first value in the diagnostics that differs from the required one.
    pub fn misleading(&self, solution: &Solution) -> Option<String> {
        let diagnostics = serde_json::to_value(&solution.diagnostics).expect("diagnostics");
        self.evidence.iter().find_map(|Evidence { at, is, at_most }| {
            let found = diagnostics.pointer(at).unwrap_or(&Value::Null);
            let equal = is.as_ref().is_none_or(|is| is == found);
            let small = at_most.is_none_or(|most| found.as_f64().is_some_and(|found| found <= most));
            (!equal || !small).then(|| format!("the diagnostics say {found} at {at}"))
        })
    }

    /// Whether a failed run was right to fail: the problem may be refused, or it has no solution after about the time
    /// of the failure.
    pub fn ends_early(&self, solution: &Solution) -> bool {
        if solution.status != Status::Failed {
            return false;
        }
        let time = solution.error.as_ref().expect("a cause").time;
        let there = |Time { t, within }: &Time| (time - digits(t)).abs() <= *within;
        self.may_be_refused || self.no_solution_after.as_ref().is_some_and(there)
    }

    /// Returns a message on the largest error of a field at the output times, if it exceeds the permitted one.
    fn off(&self, solution: &Solution, name: &str, Values { within, values }: &Values) -> Option<String> {
        let column = solution.trajectory.field(name).unwrap_or_else(|| panic!("there is no field `{name}`"));
        assert_eq!(values.len(), self.t.len(), "`{name}` has a value at each time");
        let worst = self.t.iter().zip(values).map(|(&t, value)| {
            let there = |found: &f64| (found - t).abs() <= 1e-12 * t.abs();
            let at = solution.trajectory.t.iter().position(there).unwrap_or_else(|| panic!("no output at t = {t}"));
            (t, column[at], (column[at] - digits(value)).abs())
        });
        let (t, found, error) = worst.max_by(|a, b| a.2.total_cmp(&b.2)).expect("a time");
        (error > *within).then(|| format!("{name}({t}) = {found}, off by {error:.1e} where {within:.0e} is allowed"))
    }
}

/// Returns a message on the first value of a field that lies outside its known bounds, if any.
fn outside(solution: &Solution, name: &str, [least, largest]: [f64; 2]) -> Option<String> {
    let column = solution.trajectory.field(name).unwrap_or_else(|| panic!("there is no field `{name}`"));
    let found = column.iter().find(|value| !(least..=largest).contains(*value))?;
    Some(format!("{name} = {found:.3e}, not within [{least}, {largest}]"))
}

impl Times {
    /// Returns how the events of a solution differ from the known ones, if they do.
    fn off(&self, solution: &Solution) -> Option<String> {
        let Self { kind, of, within, t } = self;
        let events = solution.trajectory.events.iter();
        let found: Vec<f64> =
            events.filter(|event| event.kind == *kind && event.of == *of).map(|event| event.t).collect();
        if found.len() != t.len() {
            return Some(format!("{of} is {kind:?} {} times, not {}", found.len(), t.len()));
        }
        let errors = found.iter().zip(t).map(|(found, t)| (found - digits(t)).abs());
        let worst = errors.fold(0.0, f64::max);
        (worst > *within).then(|| format!("{of} is {kind:?} up to {worst:.1e} too early or too late"))
    }
}
