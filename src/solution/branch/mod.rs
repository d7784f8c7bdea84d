//! Branches of periodic orbits and of states of rest over one parameter, with what happens on them: folds, period doublings
//! (flips), tori (Neimark and Sacker), oscillations (Hopf), branching, and the borders that only systems with switches and
//! impacts have, where an orbit touches what it did not before (grazing) or a state of rest comes to the border of its face
//! (di Bernardo and others 2008, *Piecewise-smooth Dynamical Systems*).

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

/// What is followed.
#[derive(Clone, Debug)]
pub struct BranchPlan {
    /// Orbits, or states of rest.
    pub of: BranchOf,
    /// The parameter, by its number and its name.
    pub parameter: usize,
    /// Its name.
    pub name: String,
    /// Where it begins.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// The most points.
    pub points: usize,
}

/// What the points of a branch are.
#[derive(Clone, Debug)]
pub enum BranchOf {
    /// Periodic orbits; their period as a function of the parameters, where it is given.
    Orbits(Periodic, Option<Tape>),
    /// States of rest.
    Rests,
}

/// A branch of solutions over a parameter: lists of one length, a value a point, and what happens between the points.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Branch {
    /// The name of the parameter.
    pub name: String,
    /// Its values, from where the branch begins.
    pub parameter: Vec<f64>,
    /// The states where orbits begin, or of rest, by their names.
    pub points: Vec<BTreeMap<String, f64>>,
    /// The periods of orbits; empty of states of rest.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub period: Vec<f64>,
    /// Whether what is near comes nearer; null where that is not known.
    pub stable: Vec<Option<bool>>,
    /// The Floquet multipliers of orbits, or the eigenvalues of states of rest, as `[re, im]`.
    pub spectrum: Vec<Vec<[f64; 2]>>,
    /// What happens on the branch, in its order.
    pub events: Vec<BranchEvent>,
    /// Why it ends before the end of the interval, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended: Option<String>,
    /// Runs over one period, or solutions of the equations of rest, that it took.
    pub shots: u64,
}

impl Branch {
    /// Puts the branch into the answer.
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

    /// The first point behind which the stability changes although nothing happens.
    fn unexplained(&self) -> Option<usize> {
        let changes = |pair: &[Option<bool>]| matches!(pair, [Some(before), Some(after)] if before != after);
        let has_event = |point: usize| self.events.iter().any(|event| event.after == point as u64);
        let pairs = self.stable.windows(2).enumerate();
        pairs.filter(|(_, pair)| changes(pair)).map(|(point, _)| point).find(|point| !has_event(*point))
    }
}

/// Something that happens on a branch.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct BranchEvent {
    /// The value of the parameter.
    pub at: f64,
    /// What.
    pub kind: BranchEventKind,
    /// The point before it, counted from 0.
    pub after: u64,
    /// The states there.
    pub point: BTreeMap<String, f64>,
    /// The period there, of an orbit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period: Option<f64>,
    /// What the border is: the variable or the contact that changes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
}

/// What happens on a branch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum BranchEventKind {
    /// The branch turns back in the parameter: two solutions meet and vanish (a multiplier 1, an eigenvalue 0).
    Fold,
    /// A multiplier is -1: an orbit of twice the period begins.
    Flip,
    /// Two multipliers are on the unit circle: a torus begins.
    NeimarkSacker,
    /// Two eigenvalues are imaginary: an oscillation begins.
    Hopf,
    /// A multiplier is 1, or an eigenvalue 0, and the branch does not turn: it meets another.
    Branching,
    /// An orbit comes to touch a bound or a contact that it did not reach before, or no longer does.
    Grazing,
    /// Another border: the order of switches, or the face of a state of rest, changes.
    Border,
}
