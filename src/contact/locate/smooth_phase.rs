//! A smooth phase: motion in one contact mode, from its beginning to its end.

use super::bursts::Parts;
use super::hidden::Enclosed;
use super::integrals::Integrals;
use super::mode::Status;
use super::mode_equations::ModeEquations;
use super::monitors::{Monitor, monitors};
use super::search::Violation;
use super::{EventDriven, FRICTION_SLACK, Method};
use crate::ContactError;
use crate::energy::Energy;
use hybrid::OneStep;
use nalgebra::Vector3;
use numerics::Interval;
use problem::{Control, Mechanical};
use radau::Settings;

/// Two copies of the mode equations: for integration, and for evaluation of monitors (event functions) within a step.
pub struct ModeEvaluators {
    main: ModeEquations,
    watch: ModeEquations,
}

impl ModeEvaluators {
    /// Builds the evaluators of one mechanical system, each on a copy of the system made by `problem`.
    pub fn new(problem: impl Fn() -> Box<dyn Mechanical>) -> Self {
        Self { main: ModeEquations::new(problem()), watch: ModeEquations::new(problem()) }
    }
}

/// Refinement of an event time by repeated steps: `REFINEMENTS` steps are allowed in any case, and up to
/// `MOST_REFINEMENTS` while each reduces the remaining change of the time by the fraction `TAKEN_OFF`. For a flight
/// that is short compared with the step, Newton's method halves the change each time, down to the resolution of the
/// clock.
const REFINEMENTS: usize = 6;
const MOST_REFINEMENTS: usize = 60;
const TAKEN_OFF: f64 = 0.25;

/// The largest change of the event time in one refinement of a located event, as a fraction of the time since the step
/// began.
const NEAR: f64 = 0.5;

/// A 3D slip may grow by at most the factor `GROWTH` in a step; the time at which it has grown by that factor, where
/// the step is cut, is bisected to the fraction `GROWN` of the step.
pub(super) const GROWTH: f64 = 4.0;
const GROWN: f64 = 1e-6;

/// The relative tolerance on the stages of the implicit method in a step that is cut at an event.
const CUT_RTOL: f64 = 1e-11;

/// Drift of held constraints that ends a phase, as a fraction of the gap below which a contact is closed; also the
/// drift allowed in a step, as a fraction of the tolerances of the coordinates.
const DRIFT: f64 = 0.1;

/// A run of the one-step method within one contact mode.
pub struct SmoothPhase<'l, 'p> {
    /// The event-driven run to which the smooth phase belongs.
    pub located: &'l mut EventDriven<'p>,
    pub(super) mode: Vec<Status>,
    pub(crate) method: Option<Method<'l>>,
    pub(crate) watch: &'l mut ModeEquations,
    pub(super) control: &'l Control,
    pub(super) over: bool,
    /// The partition in time of the last step, so fine that the points of each part represent the explicit dependence
    /// on time.
    pub(super) parts: Parts,
    /// The largest absolute value of each coordinate and velocity in the last step.
    pub(super) reached: Vec<f64>,
    /// A time in the last step, with the impulses and the work from the beginning of the step to that time.
    pub(super) acted: (f64, Integrals),
}

impl<'l, 'p> SmoothPhase<'l, 'p> {
    /// Starts the integration of the current mode of an event-driven run.
    pub fn new(located: &'l mut EventDriven<'p>, evaluators: &'l mut ModeEvaluators, control: &'l Control) -> Self {
        let ModeEvaluators { main, watch } = evaluators;
        let mode = located.mode.clone();
        let mut method = None;
        if let Some(mode) = &mode {
            let least = located.tolerances_of_slips();
            let x = [located.state.q.as_slice(), &located.state.v].concat();
            // Prefer loads whose friction is shared evenly: such contacts stick as long as they can, whereas the
            // loads of the contact law are a vertex of the admissible set, from which one contact slips at once.
            let normals: Vec<_> = located.loads.iter().map(|load| Vector3::x() * load.x).collect();
            if normals != located.loads {
                watch.set_mode(mode, (&normals, &located.coefficients), &least);
                watch.evaluate_at(located.state.t, &x);
                if watch.hold_below(FRICTION_SLACK) {
                    located.loads = normals;
                }
            }
            for equations in [&mut *main, &mut *watch] {
                equations.set_mode(mode, (&located.loads, &located.coefficients), &least);
            }
            let remaining = located.end - located.state.t;
            let first_step = located.h.filter(|h| *h < remaining).or(located.radau.first_step);
            let settings = Settings { first_step, ..located.radau.clone() };
            method = Method::new(main, settings, located.state.t, &x, located.end, control).ok();
        }
        let mode = mode.unwrap_or_default();
        let acted = (located.state.t, Integrals::none(mode.len()));
        let parts = Parts::default();
        let reached = vec![0.0; 2 * located.structure.coordinates];
        Self { mode, method, watch, control, over: false, parts, reached, acted, located }
    }

    /// Whether the contact mode of this smooth phase, or the run, has ended.
    pub fn is_over(&self) -> bool {
        self.over || self.located.is_done()
    }

    /// Returns the one-step method of smooth motion, with data of its last step; `None` while time stepping replaces
    /// it.
    pub fn method(&self) -> Option<&radau::Radau<'l>> {
        self.method.as_ref()
    }

    /// Makes one step of the smooth motion, and handles the event at its end.
    ///
    /// # Errors
    /// See [`VelocityStep::advance`](crate::VelocityStep::advance).
    pub fn advance(&mut self) -> Result<(), ContactError> {
        hybrid::advance(self)
    }

    /// Whether the step that ended at the time `t` ended at a breakpoint in time while a contact is closed.
    pub(super) fn is_behind_break(&self, t: f64) -> bool {
        let ends_there = |method: &Method<'_>| method.t() == t && method.begins_anew() && !method.is_done();
        self.mode.iter().any(|status| status.is_closed()) && self.method.as_ref().is_some_and(ends_there)
    }

    /// Updates the slip directions of the mode, which the monitors of slip-stick transitions refer to, to the
    /// directions of the current 3D slips: a slip may turn by any angle.
    pub(super) fn follow_slips(&mut self) {
        let EventDriven { structure, constraints, state, .. } = &*self.located;
        for (k, (status, contact)) in self.mode.iter_mut().zip(&structure.contacts).enumerate() {
            if let Status::Slip(direction) = status
                && contact.slips > 1
            {
                let slip = constraints.slip(structure.tangents(k), &state.v);
                if slip.norm() > 0.0 {
                    *direction = slip.normalize();
                }
            }
        }
    }

    /// Interpolates the state `x = (q, v)` at a time within the last step.
    pub(super) fn at(&mut self, t: f64, x: &mut [f64]) {
        if let Some(method) = &mut self.method {
            method.at(t, x);
        }
    }

    /// Writes the state `x = (q, v)` at a time within the last step; at the end of the step, the state in the new
    /// mode.
    pub fn states_at(&mut self, t: f64, x: &mut [f64]) {
        let EventDriven { state, last, .. } = &*self.located;
        if t < state.t && t >= last.t && self.method.is_some() {
            return self.at(t, x);
        }
        let (q, v) = x.split_at_mut(state.q.len());
        q.copy_from_slice(&state.q);
        v.copy_from_slice(&state.v);
    }

    /// Encloses the state `x` between two times within the last step; returns an empty list if the step was not
    /// smooth motion.
    pub(super) fn ranges(&self, from: f64, to: f64) -> Vec<Interval> {
        self.method.as_ref().map_or_else(Vec::new, |method| method.ranges(from, to))
    }

    /// Encloses the state `x` and its rounding errors between two times within the last step.
    pub fn ranges_with_rounding(&self, from: f64, to: f64) -> Vec<Interval> {
        self.method.as_ref().map_or_else(Vec::new, |method| method.ranges_with_rounding(from, to))
    }

    /// Returns the slopes of the state `x` at a time within the last step.
    pub(super) fn slopes_at(&self, t: f64) -> Vec<f64> {
        self.method.as_ref().map_or_else(Vec::new, |method| method.slopes_at(t))
    }

    /// Counts a step of smooth motion by the result of its enclosure.
    pub(super) fn note_screened(&mut self, enclosed: &Enclosed) {
        if self.mode.is_empty() {
            return;
        }
        let is_proven = self.parts.are_decided && self.method.as_ref().is_none_or(Method::are_rates_shown);
        let screening = &mut self.located.screening;
        match enclosed {
            Enclosed::Proven if is_proven => screening.proven += 1,
            Enclosed::Missed | Enclosed::Violated(_) => screening.missed += 1,
            Enclosed::Proven | Enclosed::Undecided => screening.undecided += 1,
        }
    }

    /// Evaluates the monitors (event functions) of the contact mode at a time within the last step.
    pub(super) fn monitors_at(&mut self, t: f64, out: &mut Vec<Monitor>) {
        let mut x = vec![0.0; 2 * self.located.structure.coordinates];
        self.at(t, &mut x);
        monitors(self.watch, &self.located.structure, &self.mode, t, (&x, &self.reached), out);
    }

    /// Returns the slip speed of contact `k` at a time within the last step, and its tolerance.
    pub(super) fn slip_at(&mut self, k: usize, t: f64) -> (f64, f64) {
        let n = self.located.structure.coordinates;
        let mut x = vec![0.0; 2 * n];
        self.at(t, &mut x);
        self.watch.evaluate_at(t, &x);
        let tolerance = self.located.tolerance_of_slip(k, self.watch.constraints(), &x[n..]);
        (self.watch.slip(k, &x[n..]).norm(), tolerance)
    }

    /// Returns the time up to which the Newton matrix is valid in the last step: a 3D slip resists turning by `mu
    /// r_n/|u_t|`, so that a slip that begins, or grows many times, needs steps that grow with it.
    pub(super) fn grown(&mut self, begin: f64, end: f64) -> f64 {
        let mut until = end;
        for k in 0..self.mode.len() {
            if self.located.structure.contacts[k].slips < 2 || !matches!(self.mode[k], Status::Slip(_)) {
                continue;
            }
            let (first, tolerance) = self.slip_at(k, begin);
            let most = GROWTH * (first + tolerance);
            if self.slip_at(k, until).0 <= most {
                continue;
            }
            let mut small = begin;
            let close = (GROWN * (end - begin)).max(4.0 * f64::EPSILON * end.abs());
            while until - small > close {
                let middle = 0.5 * (small + until);
                let side = if self.slip_at(k, middle).0 > most { &mut until } else { &mut small };
                *side = middle;
            }
        }
        until
    }

    /// Solves the step anew up to the event until the event time converges; keeps the last of these steps.
    pub(super) fn refine(&mut self, begin: f64, end: f64, violation: &Violation) -> f64 {
        let Violation { mut t, index, origin, mut slope, .. } = *violation;
        let least = 4.0 * f64::EPSILON * begin.abs().max(f64::MIN_POSITIVE);
        if violation.jumps && t - begin > least {
            self.cut_at(t);
            return t;
        }
        let is_near = |change: f64, t: f64| change.abs() <= NEAR * (t - begin);
        // Measure the monitor from zero, dropping its drift, unless the time to the root without the drift is far from
        // the present event time.
        let level = if is_near(origin / slope, t) { 0.0 } else { origin };
        let mut values = Vec::new();
        let mut last = f64::INFINITY;
        for attempt in 0..MOST_REFINEMENTS {
            if t - begin <= least {
                return begin;
            }
            if !self.cut_at(t) {
                break;
            }
            self.monitors_at(t, &mut values);
            slope = values[index].rate.unwrap_or(slope);
            let change = (values[index].value - level) / slope;
            let next = (t - change).min(end);
            // Stop the refinement if the monitor does not fall towards its root, or if its root is far from the present
            // event time.
            let settled = next <= begin || (next - t).abs() <= 2.0 * f64::EPSILON * t.abs();
            let stalls = attempt >= REFINEMENTS && change.abs() > (1.0 - TAKEN_OFF) * last;
            if slope >= 0.0 || !is_near(change, t) || settled || stalls {
                break;
            }
            (t, last) = (next, change.abs());
        }
        self.cut_at(t);
        t
    }

    /// Solves the step anew up to the time `t`, with a tighter tolerance; returns whether the solve succeeded.
    pub(super) fn cut_at(&mut self, t: f64) -> bool {
        let tighter = (CUT_RTOL / self.located.radau.rtol).min(1.0);
        self.method.as_mut().is_some_and(|method| method.cut_at(t, tighter))
    }

    /// Advances the state from `begin` to `t`, and adds the work and the impulses of the contacts in between to those
    /// of the run.
    pub(super) fn travel(&mut self, begin: f64, t: f64) {
        let n = self.located.structure.coordinates;
        let mut x = vec![0.0; 2 * n];
        let integrals = self.integrals(begin, t);
        self.at(t, &mut x);
        if self.is_unlawful(&integrals, &x[n..]) {
            self.located.screening.missed += 1;
        }
        let Integrals { impulses, friction, forces, drives, .. } = integrals;
        self.located.impulses.iter_mut().zip(&impulses).for_each(|(sum, r)| *sum += r);
        let state = &mut self.located.state;
        state.t = t;
        state.q.copy_from_slice(&x[..n]);
        state.v.copy_from_slice(&x[n..]);
        let energies = self.watch.problem().energies(t, &state.q, &state.v);
        let energy = &mut self.located.energy;
        energy.dissipate(friction, 0.0, energies.kinetic);
        energy.work(forces, drives);
        energy.close(energies.kinetic, energies.potential);
    }

    /// Records the largest violations of joints and gaps at a time within the last step; the mode equations must have
    /// been evaluated at that time.
    pub(super) fn note_violations(&mut self, t: f64, q: &[f64]) {
        let EventDriven { radau, violations, .. } = &mut *self.located;
        if violations.joints().is_empty() && violations.gaps().is_empty() {
            return;
        }
        let tolerances = radau.tolerances(0, q);
        violations.note(t, q, self.watch.constraints(), (&[], &tolerances), |k| self.mode[k].is_closed());
    }

    /// Writes the coordinates and velocities at a time within the last step, and returns impulses and energy balance.
    pub fn outputs(&mut self, t: f64, q: &mut [f64], v: &mut [f64]) -> (Vec<Vector3<f64>>, Energy) {
        let EventDriven { state, last, .. } = &*self.located;
        if t >= state.t {
            q.copy_from_slice(&state.q);
            v.copy_from_slice(&state.v);
            return (self.located.impulses.clone(), self.located.energy);
        }
        let begin = last.t;
        if self.method.is_none() {
            let part = (t - begin) / (state.t - begin);
            q.iter_mut().zip(last.q.iter().zip(&state.q)).for_each(|(out, (a, b))| *out = a + part * (b - a));
            v.copy_from_slice(&state.v);
            let impulses = self.located.impulses_before.iter().zip(&self.located.impulses);
            let energy = self.located.energy_before.towards(&self.located.energy, part);
            return (impulses.map(|(a, b)| a + (b - a) * part).collect(), energy);
        }
        let mut x = vec![0.0; 2 * q.len()];
        self.at(t, &mut x);
        q.copy_from_slice(&x[..q.len()]);
        v.copy_from_slice(&x[q.len()..]);
        // Output times increase: continue the integrals of contact forces and powers from the last output time.
        let from = if t >= self.acted.0 { self.acted.0 } else { begin };
        let part = self.integrals(from, t);
        if from == begin {
            self.acted.1 = Integrals::none(self.mode.len());
        }
        self.acted.0 = t;
        self.acted.1.add(1.0, &part);
        let Integrals { impulses, friction, forces, drives, .. } = &self.acted.1;
        let impulses = impulses.iter().zip(&self.located.impulses_before).map(|(r, before)| r + before).collect();
        let mut energy = self.located.energy_before;
        energy.dissipate(*friction, 0.0, 0.0);
        energy.work(*forces, *drives);
        (impulses, energy)
    }

    /// Returns a factor for the next step size if a held constraint has drifted off zero: drift, which grows with the
    /// square of the step size, must stay well below the tolerances.
    pub(super) fn drift(&self) -> Option<f64> {
        let EventDriven { structure, constraints, step, state, radau, .. } = &*self.located;
        let ticks = 4.0 * step.problem.rounding_of_time(state.t);
        let tolerances = radau.tolerances(0, &state.q);
        let closed = (0..self.mode.len()).filter(|&k| self.mode[k].is_closed()).map(|k| structure.joints + k);
        let held = (0..structure.joints).chain(closed);
        let drifted = held.filter(|&row| {
            constraints.values[row].abs() > DRIFT * step.closed(row) + ticks * constraints.drift[row].abs()
        });
        let growth = |row: usize| (DRIFT * constraints.size(row, &tolerances) / constraints.values[row].abs()).sqrt();
        drifted.map(growth).reduce(f64::min)
    }
}
