//! State of a run as reported between steps: time, values, error estimates, counters.

use super::estimate::ROUNDING;
use super::{Extent, Radau};
use crate::consistent_variables::inequality;
use crate::dense_output::GivenStep;
use crate::face::{ActiveFace, Activity};
use crate::start::Jump;
use crate::tableau::Tableau;
use crate::work::Work;
use numerics::Interval;
use problem::{ConvexSet, Dvi, FaceEquations};

/// Rounding error of the sums in a step, relative to their terms.
const ROUNDING_OF_RANGES: f64 = 4.0 * f64::EPSILON;

/// The variables at the end of a step, with the data to check their variational inequality.
#[derive(Clone, Copy, Debug)]
pub struct Variables<'a> {
    /// The set `K` at the end of the step.
    pub set: &'a ConvexSet,
    /// Indices of the variables that have a bound, counted from 0.
    pub bounded: &'a [usize],
    /// The values of all variables at the end of the step.
    pub z: &'a [f64],
    /// The values of `G` at the end of the step.
    pub g: &'a [f64],
}

/// The last accepted step, with the data needed to differentiate it.
#[derive(Clone, Copy, Debug)]
pub struct LastStep<'a> {
    /// Time at the beginning of the last accepted step.
    pub t: f64,
    /// The size of the last accepted step.
    pub h: f64,
    /// The unknowns `y` at the beginning of the step.
    pub y: &'a [f64],
    /// The stage increments, in as many blocks as there are stages.
    pub z: &'a [f64],
    /// The Runge-Kutta coefficients of the step.
    pub tableau: &'static Tableau,
}

/// The beginning or the end of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The beginning of the step.
    Before,
    /// The end of the step.
    After,
}

impl Radau<'_> {
    /// Returns the last accepted step; of size zero if there is none.
    pub fn last_step(&self) -> LastStep<'_> {
        LastStep {
            t: self.last.t,
            h: self.last.h,
            y: &self.last.y,
            z: &self.last.z,
            tableau: self.orders.last().tableau,
        }
    }

    /// Whether the last step ended at a breakpoint or a switch, behind which the run begins anew.
    pub fn begins_anew(&self) -> bool {
        !self.continues
    }

    /// Returns the time of the first jump of the states, forced by constraints at the start or at a breakpoint of the
    /// rows.
    pub fn jumped(&self) -> Option<f64> {
        self.jumped
    }

    /// Whether a change of an unknown is larger than the tolerance of the unknown.
    pub fn is_beyond_tolerance(&self, unknown: usize, change: f64) -> bool {
        (change * self.control.weight[unknown]).abs() > 1.0
    }

    /// Removes and returns the jumps of the states since the last call.
    pub fn take_jumps(&mut self) -> Vec<Jump> {
        std::mem::take(&mut self.jumps)
    }

    /// Returns the largest magnitude of each unknown in the run so far.
    pub fn largest(&self) -> &[f64] {
        &self.extent.largest
    }

    /// Returns the number of stages of the method with which the next step is made.
    pub fn stages(&self) -> usize {
        self.tableau().stages()
    }

    /// Returns the counters of evaluations, factorisations and Newton iterations of the run.
    pub fn work(&self) -> Work {
        self.system.work
    }

    /// Returns the work on affine variational inequalities, both for stages and for the selection of faces: the name
    /// of the solver, the number of problems solved, and the number of pivots or iterations.
    pub fn vi_work(&self) -> Option<(&'static str, u64, u64)> {
        let (stages, faces) = (self.stage_vi.as_ref()?, self.switching.probe.vi.as_ref()?);
        let last = if stages.solves > 0 { stages } else { faces };
        Some((last.solver(), stages.solves + faces.solves, stages.pivots + faces.pivots))
    }

    /// Returns the unsuccessful attempts of the solver at affine variational inequalities of the stages, each with
    /// its number of occurrences.
    pub fn vi_failures(&self) -> impl Iterator<Item = (vi::Attempt, u64)> + '_ {
        self.stage_vi.iter().flat_map(|vi| &vi.failures).copied()
    }

    /// Returns which end of the last step the time `t` is to within the rounding of the clock; `None` if it is
    /// neither.
    pub fn end_at(&self, t: f64) -> Option<End> {
        let rounding = self.clock.rounding(self.last.h);
        if (self.clock.t - t).abs() <= rounding {
            Some(End::After)
        } else if (t - self.last.t).abs() <= rounding {
            Some(End::Before)
        } else {
            None
        }
    }

    /// Evaluates the unknowns `y` at a time within the last accepted step into `out`: the states from the collocation
    /// polynomial, with consistent variables; at the end of a step that is a switch, the variables after the switch.
    ///
    /// If variables are determined by equations, a time at an end of the step to within the rounding of the clock is
    /// that end. At such times, rows that jump in time may be on the other side of their jump than the face, so that
    /// constraints and consistent variables are meaningless: they would move the states as far as the jump of a
    /// source demands.
    pub(super) fn interpolate(&mut self, t: f64, out: &mut [f64]) {
        let end =
            if self.consistent.is_some() { self.end_at(t) } else { Some(End::After).filter(|_| t == self.clock.t) };
        let (at_end, at_begin) = (end == Some(End::After), end == Some(End::Before));
        let t = match end {
            Some(End::After) => self.clock.t,
            Some(End::Before) => self.last.t,
            None => t,
        };
        let mut are_found = false;
        if at_end {
            out.copy_from_slice(&self.y);
            are_found = self.find_variables(t, out);
        } else {
            std::mem::swap(&mut self.system.face, &mut self.last.face);
            if at_begin {
                out.copy_from_slice(&self.last.y);
                are_found = self.find_variables(t, out);
            } else {
                self.last.at(self.orders.last().tableau, t, out);
                if self.last.is_smooth {
                    are_found = self.bring_onto_face(t, out);
                } else {
                    inequality::solve(&mut self.system, t, out);
                }
            }
        }
        // If consistent variables were found, the moving bounds are already those at the states in `out`.
        if !self.system.bounded.is_empty() && (are_found || self.system.evaluate(t, out)) {
            self.system.project(out);
        }
        if !at_end {
            std::mem::swap(&mut self.system.face, &mut self.last.face);
        }
    }

    /// Brings the unknowns `y` at time `t` onto the present face: the states onto its constraints, then the variables
    /// to consistent ones; returns whether consistent variables were found.
    pub(crate) fn bring_onto_face(&mut self, t: f64, y: &mut [f64]) -> bool {
        self.switching.constraints.correct(&mut self.system, &self.control, t, y);
        self.find_variables(t, y)
    }

    /// Sets the variables in `y` to those consistent with the states on the present face; returns whether they were
    /// found.
    fn find_variables(&mut self, t: f64, y: &mut [f64]) -> bool {
        let Some(consistent) = &mut self.consistent else { return false };
        let are_found = consistent.solve(&mut self.system, &self.control, t, y);
        if !are_found {
            self.forget_jacobian();
        }
        are_found
    }

    /// Returns the unknowns at the end of the last step, on the active face of that step: before a switch at its end.
    pub(crate) fn before_switch(&mut self) -> Vec<f64> {
        let t = self.last.t + self.last.h;
        let mut y = vec![0.0; self.system.unknowns];
        self.last.at(self.orders.last().tableau, t, &mut y);
        std::mem::swap(&mut self.system.face, &mut self.last.face);
        self.find_variables(t, &mut y);
        std::mem::swap(&mut self.system.face, &mut self.last.face);
        y
    }

    /// Returns the data for the assessment of the variables at the time reached; `None` if no variable has a bound,
    /// or a value is not finite.
    pub fn variables(&mut self) -> Option<Variables<'_>> {
        if self.system.bounded.is_empty() || !self.system.evaluate(self.clock.t, &self.y) {
            return None;
        }
        let (n, unknowns) = (self.system.states, self.system.unknowns);
        Some(Variables {
            set: &self.system.set,
            bounded: &self.system.bounded,
            z: &self.y[n..],
            g: &self.system.values[n..unknowns],
        })
    }

    /// Returns the active face of `K` at the time reached.
    pub fn face(&self) -> &ActiveFace {
        &self.system.face
    }

    /// Returns the equations of the active face of the set of each block at the time reached.
    pub fn equations_of_blocks(&mut self) -> Vec<FaceEquations> {
        self.system.evaluate(self.clock.t, &self.y);
        self.system.equations_for_z(&self.y)
    }

    /// Returns enclosures of the states over `[from, to]` within the last step, widened by rounding errors: those of
    /// the states, of the sum of the terms of their rates, and of time.
    pub fn ranges_with_rounding(&self, from: f64, to: f64) -> Vec<Interval> {
        let Self { system, clock, last, .. } = self;
        let mut ranges = self.ranges_of_polynomials(from, to);
        let at_ends = |j: usize| [&last.y, &self.y].map(|y| y.get(j).map_or(0.0, |y| y.abs()));
        let size = |j: usize| {
            let [begin, end] = at_ends(j);
            ranges.get(j).map_or(0.0, |range: &Interval| range.size()).max(begin).max(end)
        };
        let sizes: Vec<f64> = (0..system.unknowns).map(size).collect();
        let span = last.h.abs() + clock.t.abs();
        for (j, range) in ranges.iter_mut().enumerate() {
            let mass = system.mass_diagonal[j].abs();
            let rates = system.terms_of_row(j, |i| [sizes[i]])[0] / if mass == 0.0 { 1.0 } else { mass };
            let rounding = ROUNDING_OF_RANGES * (range.size() + span * rates);
            *range = Interval::new(range.lo - rounding, range.hi + rounding);
        }
        ranges
    }

    /// Returns the error estimates of the last step, if the step size is prescribed.
    pub fn given_step(&self) -> &GivenStep {
        &self.last.given
    }

    /// Returns, for each state, whether active inequalities hold it at zero: it was never larger than the rounding
    /// errors of its steps. Active inequalities hold the states in an inequality `G_k = 0` of the present face, those
    /// in the rate of a held state if no variable occurs in that rate, and those whose rates consist of states at
    /// zero.
    pub fn held_at_zero(&self) -> Vec<bool> {
        let Self { system, extent: Extent { longest, largest }, .. } = self;
        let n = system.states;
        let nonzero = |row: usize| system.entries_of_row(row).filter(|(_, value)| *value != 0.0).map(|(j, _)| j);
        let active = system.bounded.iter().filter(|&&k| system.face.places[k] == Activity::Inactive);
        let mut found: Vec<usize> = active.flat_map(|&k| nonzero(n + k)).filter(|j| *j < n).collect();
        let mut held = vec![false; n];
        while let Some(state) = found.pop() {
            if !std::mem::replace(&mut held[state], true) && nonzero(state).all(|j| j < n) {
                found.extend(nonzero(state));
            }
        }
        // Distance by which the terms of its rate could move a state in the whole run.
        let way = |state: usize| {
            let mass = system.mass_diagonal[state].abs();
            let terms = system.terms_of_row(state, |j| [largest[j]])[0];
            self.counts.accepted as f64 * longest * terms / if mass == 0.0 { 1.0 } else { mass }
        };
        let mut zero: Vec<bool> = (0..n).map(|j| held[j] && largest[j] <= ROUNDING * way(j)).collect();
        let follows = |j: usize, zero: &[bool]| {
            !zero[j] && nonzero(j).next().is_some() && nonzero(j).all(|i| i < n && zero[i]) && largest[j] <= way(j)
        };
        while zero.contains(&true)
            && let Some(next) = (0..n).find(|&j| follows(j, &zero))
        {
            zero[next] = true;
        }
        zero
    }

    /// Whether the stages of the last step were solved on one active face of `K`.
    pub fn is_smooth(&self) -> bool {
        self.last.is_smooth
    }

    /// Whether the last step kept one active face of `K`, and the next step continues on it.
    pub fn kept_face(&self) -> bool {
        self.last.is_smooth && self.continues
    }

    /// Returns the problem, for evaluations outside the steps.
    pub fn problem(&mut self) -> &mut dyn Dvi {
        self.system.problem()
    }
}
