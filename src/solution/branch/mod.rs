//! Branches of periodic orbits and of steady states over one parameter, with the events on them: folds, period
//! doublings (flips), tori (Neimark and Sacker), oscillations (Hopf), branching, and the borders that only systems
//! with switches and impacts have, where an orbit begins to touch a bound or contact (grazing) or a steady state
//! reaches the border of its active face (di Bernardo and others 2008, *Piecewise-smooth Dynamical Systems*).

mod arclength;
mod cut;
mod orbits;
mod rests;
mod test_functions;

pub use orbits::{follow_orbits, follow_orbits_of_motion};
pub use rests::follow_rests;

use super::Solution;
use super::orbit::Periodic;
use expression::Tape;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// The plan of a continuation: the kind of solutions on the branch, the parameter and its interval.
#[derive(Clone, Debug)]
pub struct BranchPlan {
    /// The kind of solutions on the branch: periodic orbits or steady states.
    pub of: BranchOf,
    /// The index of the parameter that varies along the branch.
    pub parameter: usize,
    /// The name of the parameter that varies along the branch.
    pub name: String,
    /// The value of the parameter at which the branch begins.
    pub from: f64,
    /// The value of the parameter at which the branch ends.
    pub to: f64,
    /// The largest number of points of the branch.
    pub points: usize,
}

/// The kind of solutions on a branch.
#[derive(Clone, Debug)]
pub enum BranchOf {
    /// Periodic orbits, and their period as a function of the parameters if it is given.
    Orbits(Periodic, Option<Tape>),
    /// Branches of steady states.
    Rests,
}

/// A branch of solutions over a parameter: lists with one value per point, and the events between the points.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Branch {
    /// The name of the parameter that varies along the branch.
    pub name: String,
    /// The values of the parameter, in the order of the points of the branch.
    pub parameter: Vec<f64>,
    /// The states at the beginning of each orbit, or at each steady state, by name.
    pub points: Vec<BTreeMap<String, f64>>,
    /// The periods of orbits; empty for steady states.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub period: Vec<f64>,
    /// Whether each solution is asymptotically stable; null if unknown.
    pub stable: Vec<Option<bool>>,
    /// The Floquet multipliers of orbits, or the eigenvalues at steady states, as `[re, im]`.
    pub spectrum: Vec<Vec<[f64; 2]>>,
    /// The events on the branch, in their order along it.
    pub events: Vec<BranchEvent>,
    /// The reason why the branch ends before the end of the parameter interval, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended: Option<String>,
    /// Number of runs over one period, or of evaluations of the equations of a steady state.
    pub shots: u64,
}

impl Branch {
    /// Adds the branch of solutions and its caveats to the answer.
    fn tell(self, solution: &mut Solution) {
        if let Some(why) = &self.ended {
            let end = self.parameter.last().copied().unwrap_or_default();
            let message =
                format!("the branch ends at `{}` = {end:?}, before the end of its interval: {why}", self.name);
            solution.diagnostics.checks.caveat("branch_ended", message);
        }
        if let Some(point) = self.unexplained() {
            let [from, to] = [point, point + 1].map(|point| self.parameter[point]);
            let message = format!(
                "between `{}` = {from:?} and {to:?} the stability changes, and what happens there was not found: two eigenvalues or \
                 multipliers may pass together, as those of two like parts; ask for this piece of the branch alone",
                self.name
            );
            solution.diagnostics.checks.caveat("branch_event_missed", message);
        }
        solution.branch = Some(self);
    }

    /// Returns the first point of the branch after which the stability changes without an event.
    fn unexplained(&self) -> Option<usize> {
        let changes = |pair: &[Option<bool>]| matches!(pair, [Some(before), Some(after)] if before != after);
        let has_event = |point: usize| self.events.iter().any(|event| event.after == point as u64);
        let pairs = self.stable.windows(2).enumerate();
        pairs.filter(|(_, pair)| changes(pair)).map(|(point, _)| point).find(|point| !has_event(*point))
    }
}

/// An event on a branch: a bifurcation or a border.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct BranchEvent {
    /// The value of the parameter at the event.
    pub at: f64,
    /// The kind of the event.
    pub kind: BranchEventKind,
    /// The index of the last point before the event, counted from 0.
    pub after: u64,
    /// The states at the event.
    pub point: BTreeMap<String, f64>,
    /// The period of the orbit at the event.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period: Option<f64>,
    /// The variable or contact that changes at a border.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
}

/// The kind of an event on a branch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum BranchEventKind {
    /// The branch turns back in the parameter: two solutions meet and vanish (a multiplier is 1, or an eigenvalue 0).
    Fold,
    /// A multiplier is -1: a branch of orbits with twice the period begins.
    Flip,
    /// Two complex multipliers are on the unit circle: a torus begins.
    NeimarkSacker,
    /// Two eigenvalues are imaginary: a branch of periodic orbits begins.
    Hopf,
    /// A multiplier is 1, or an eigenvalue 0, and the branch does not turn: it meets another branch.
    Branching,
    /// An orbit begins or ceases to touch a bound or a contact.
    Grazing,
    /// Another border: the order of switches, or the active face of a steady state, changes.
    Border,
}
