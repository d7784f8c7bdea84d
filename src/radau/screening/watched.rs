//! The monitors of a face that are watched over a step: of each variable in an interval what must not become negative while
//! it keeps its place.

use crate::face::Activity;
use crate::system::System;
use numerics::Interval;
use problem::Side;

/// A quantity that must not become negative on the face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watched {
    pub variable: usize,
    pub place: Activity,
    /// Of a variable inside: whether the upper bound is meant.
    pub upper: bool,
    /// What counts as zero.
    pub limit: f64,
}

impl Watched {
    /// The monitor where `G` and `z` are these, and the bounds of the variable.
    pub fn of(&self, g: f64, z: f64, lower: f64, upper: f64) -> f64 {
        match self.place {
            Activity::AtLower => g,
            Activity::AtUpper => -g,
            _ if self.upper => upper - z,
            _ => z - lower,
        }
    }

    /// The bound that it keeps from, where rows of the problem are as in `values`; zero of a variable on its bound, whose `G` it is.
    pub fn bound(&self, system: &System<'_>, values: &[Interval]) -> Interval {
        match self.place {
            Activity::Inactive if self.upper => system.bound(self.variable, Side::Upper, values),
            Activity::Inactive => system.bound(self.variable, Side::Lower, values),
            _ => Interval::point(0.0),
        }
    }

    /// The sign with which `G`, or `z` where the variable is inside, enters it.
    pub fn sign(&self) -> f64 {
        let is_negative = self.place == Activity::AtUpper || self.place == Activity::Inactive && self.upper;
        if is_negative { -1.0 } else { 1.0 }
    }

    /// What moves in it.
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
    /// Its derivatives by the variables, from those of `G` as they are.
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

/// The monitors of the face, but for those of blocks, into `out`; each may fall to `-limit`, which is what `limits` say of
/// a variable and of its `G`.
pub(super) fn watch(system: &System<'_>, limits: impl Fn(usize) -> [f64; 2], out: &mut Vec<Watched>) {
    out.clear();
    for &k in &system.intervals {
        let place = system.face.places[k];
        let watched = |upper: bool, limit: f64| Watched { variable: k, place, upper, limit };
        match place {
            Activity::AtLower | Activity::AtUpper => out.push(watched(false, limits(k)[1])),
            Activity::Inactive => {
                let ends = [(false, system.set.lower[k]), (true, system.set.upper[k])];
                let finite = ends.into_iter().filter(|(_, end)| end.is_finite());
                out.extend(finite.map(|(upper, _)| watched(upper, limits(k)[0])));
            }
            Activity::Fixed | Activity::Boundary(_) | Activity::Vertex => {}
        }
    }
}
