//! The monitors of a face that are examined over a step: for each variable in an interval, the quantities that must
//! stay nonnegative while the variable keeps its activity.

use crate::face::Activity;
use crate::system::System;
use numerics::Interval;
use problem::Side;

/// A monitor (event function): a quantity that must stay nonnegative while a variable keeps its activity on the active
/// face of `K`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watched {
    pub variable: usize,
    pub place: Activity,
    /// For a free variable, whether the monitor is the distance to the upper bound, rather than to the lower one.
    pub upper: bool,
}

impl Watched {
    /// Returns the value of the monitor (event function) for given values of `G`, `z` and the bounds of its variable.
    pub fn of(&self, g: f64, z: f64, lower: f64, upper: f64) -> f64 {
        match self.place {
            Activity::AtLower => g,
            Activity::AtUpper => -g,
            _ if self.upper => upper - z,
            _ => z - lower,
        }
    }

    /// Returns the range of the bound in the monitor of a free variable, given the ranges `values` of the rows of the
    /// problem; zero for a variable on a bound, whose monitor is its `G`.
    pub fn bound(&self, system: &System<'_>, values: &[Interval]) -> Interval {
        match self.place {
            Activity::Inactive if self.upper => system.bound(self.variable, Side::Upper, values),
            Activity::Inactive => system.bound(self.variable, Side::Lower, values),
            _ => Interval::point(0.0),
        }
    }

    /// Returns the sign with which `G`, or `z` of a free variable, enters the monitor (event function).
    pub fn sign(&self) -> f64 {
        let is_negative = self.place == Activity::AtUpper || self.place == Activity::Inactive && self.upper;
        if is_negative { -1.0 } else { 1.0 }
    }

    /// Returns the monitor (event function), without its constant or moving bound, as a linear combination.
    pub fn combination(&self) -> Combination {
        let own = vec![(self.variable, self.sign())];
        match self.place {
            Activity::Inactive => Combination { variables: own, rows: Vec::new() },
            _ => Combination { variables: Vec::new(), rows: own },
        }
    }
}

/// A linear function of variables and of rows of `G`, as pairs of a variable and a factor.
#[derive(Clone, Debug, Default)]
pub(super) struct Combination {
    pub variables: Vec<(usize, f64)>,
    pub rows: Vec<(usize, f64)>,
}

impl Combination {
    /// Returns the derivatives of the linear function with respect to the variables, from the current derivatives of
    /// `G`.
    pub fn by_variables(&self, system: &System<'_>) -> Vec<f64> {
        let n = system.states;
        let mut slopes = vec![0.0; system.unknowns - n];
        self.variables.iter().for_each(|&(k, factor)| slopes[k] += factor);
        for &(l, factor) in &self.rows {
            let of_variables = system.entries_of_variable(l).filter(|(j, _)| *j >= n);
            of_variables.for_each(|(j, value)| slopes[j - n] += factor * value);
        }
        slopes
    }
}

/// Writes the monitors (event functions) of the active face of `K`, except those of blocks, to `out`.
pub(super) fn watch(system: &System<'_>, out: &mut Vec<Watched>) {
    out.clear();
    for &k in &system.intervals {
        let place = system.face.places[k];
        let watched = |upper: bool| Watched { variable: k, place, upper };
        match place {
            Activity::AtLower | Activity::AtUpper => out.push(watched(false)),
            Activity::Inactive => {
                let ends = [(false, system.set.lower[k]), (true, system.set.upper[k])];
                let finite = ends.into_iter().filter(|(_, end)| end.is_finite());
                out.extend(finite.map(|(upper, _)| watched(upper)));
            }
            Activity::Fixed | Activity::Boundary(_) | Activity::Vertex => {}
        }
    }
}
