//! One step after another: Jacobian, factors, stages, face, error, acceptance.

use super::consistent::Consistent;
use super::dense_output::Step;
use super::error_control::{Controller, Rescaled};
use super::face::Place;
use super::factors::Factors;
use super::settings::{Cause, Settings, StageChoice, StepError};
use super::stage_vi::StageVi;
use super::stages::{Contraction, Newton, NewtonControl, Stages, THETA};
use super::switches::{Located, Switching};
use super::system::System;
use super::tableau::Tableau;
use crate::problem::{ConvexSet, Dvi};
use crate::vi;

/// Counts of what a run did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Accepted steps.
    pub accepted: u64,
    /// Steps rejected for their error.
    pub rejected_error: u64,
    /// Steps rejected because Newton's method failed.
    pub rejected_newton: u64,
}

/// A method with its tolerances.
pub(super) struct Method {
    pub(super) tableau: &'static Tableau,
    pub(super) tolerance: Rescaled,
}

/// Radau IIA on one problem.
pub struct Radau<'p> {
    pub(super) system: System<'p>,
    pub(super) settings: Settings,
    pub(super) methods: Vec<Method>,
    pub(super) current: usize,
    pub(super) control: NewtonControl,
    pub(super) stages: Stages,
    pub(super) factors: Factors,
    pub(super) factored: Option<f64>,
    jacobian: Freshness,
    pub(super) stage_vi: Option<StageVi>,
    pub(super) switching: Switching,
    pub(super) consistent: Option<Consistent>,
    contraction: Contraction,
    controller: Controller,
    pub(super) t: f64,
    /// What rounding took from `t`.
    lag: f64,
    pub(super) y: Vec<f64>,
    end: f64,
    pub(super) h: f64,
    pub(super) last: Step,
    last_method: usize,
    pub(super) continues: bool,
    pub(super) jumped: bool,
    estimate: Vec<f64>,
    embedded: Vec<f64>,
    shifted: Vec<f64>,
    /// Counters.
    pub counts: Counts,
}

/// The variables at the end of a step.
#[derive(Clone, Copy, Debug)]
pub struct Variables<'a> {
    /// `K` there.
    pub set: &'a ConvexSet,
    /// The variables that have a bound, counted from 0.
    pub bounded: &'a [usize],
    /// All variables.
    pub z: &'a [f64],
    /// `G` there.
    pub g: &'a [f64],
}

/// What is known of the derivatives at hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Freshness {
    /// None, or none worth keeping.
    Stale,
    /// Of an earlier step, and good enough.
    Kept,
    /// Of this step.
    Fresh,
}

/// How the stages of an attempt came out.
enum Attempt {
    /// Solved, in so many Newton iterations; `coupled` over the stages, or on one face.
    Solved { h: f64, iterations: usize, coupled: bool },
    /// To be done again with the step times this factor.
    Failed(f64),
}

impl Attempt {
    /// What to multiply the step by.
    fn factor(&self) -> f64 {
        match self {
            Self::Solved { .. } => 1.0,
            Self::Failed(factor) => *factor,
        }
    }
}

impl<'p> Radau<'p> {
    /// Prepares a run from `(t, x)` to `end`; finds the face of `K` and the variables there.
    ///
    /// # Errors
    /// If something is not finite at the start, or the start is inconsistent.
    pub fn new(problem: &'p mut dyn Dvi, settings: Settings, t: f64, x: &[f64], end: f64) -> Result<Self, StepError> {
        let mut system = System::new(problem)?;
        let counts = match settings.stages {
            StageChoice::Fixed(s) => vec![s],
            StageChoice::Auto => vec![3, 5, 7],
        };
        let adaptive = settings.step.is_none();
        let methods: Vec<Method> = counts
            .iter()
            .map(|&s| Method { tableau: Tableau::of(s), tolerance: Rescaled::new(s, settings.rtol, adaptive) })
            .collect();
        let most_stages = counts.iter().copied().max().unwrap_or(1);
        let unknowns = system.unknowns;
        let mut y = vec![0.0; unknowns];
        y[..system.states].copy_from_slice(x);
        system.project(&mut y);
        let control = NewtonControl {
            weight: vec![0.0; unknowns],
            size: vec![0.0; unknowns],
            kappa: 0.0,
            most: 0,
            vi_tolerance: settings.vi_tolerance,
        };
        let stage_vi = if system.bounded.is_empty() {
            None
        } else {
            Some(StageVi::new(&system, most_stages, settings.vi_solver)?)
        };
        let mut radau = Self {
            stages: Stages::new(most_stages, unknowns),
            switching: Switching::new(&system, &settings)?,
            factors: Factors::new(&system),
            consistent: Consistent::new(&system),
            stage_vi,
            estimate: vec![0.0; unknowns],
            embedded: vec![0.0; unknowns],
            shifted: vec![0.0; unknowns],
            system,
            settings,
            methods,
            current: 0,
            control,
            factored: None,
            jacobian: Freshness::Stale,
            contraction: Contraction::default(),
            controller: Controller::default(),
            t,
            lag: 0.0,
            y,
            end,
            h: 0.0,
            last: Step::default(),
            last_method: 0,
            continues: false,
            jumped: false,
            counts: Counts::default(),
        };
        radau.check_finite()?;
        radau.h = radau.first_step();
        radau.start()?;
        Ok(radau)
    }

    /// The time reached.
    pub fn t(&self) -> f64 {
        self.t
    }

    /// `y = (x, z)` at the time reached.
    pub fn y(&self) -> &[f64] {
        &self.y
    }

    /// Whether the end is reached.
    pub fn is_done(&self) -> bool {
        self.t >= self.end
    }

    /// Whether the states jumped at the start, because the constraints did not allow it.
    pub fn jumped(&self) -> bool {
        self.jumped
    }

    /// The number of stages in use.
    pub fn stages(&self) -> usize {
        self.tableau().stages()
    }

    /// Counters of evaluations.
    pub fn work(&self) -> super::system::Work {
        self.system.work
    }

    /// The affine problems solved, over the stages and for faces: the solver that answered last, how many, and their
    /// pivots or iterations.
    pub fn vi_work(&self) -> Option<(&'static str, u64, u64)> {
        let (stages, faces) = (self.stage_vi.as_ref()?, self.switching.probe.vi.as_ref()?);
        let last = if stages.solves > 0 { stages } else { faces };
        Some((last.solver(), stages.solves + faces.solves, stages.pivots + faces.pivots))
    }

    /// The attempts at affine problems of the stages that did not solve them, each with how often it happened.
    pub fn vi_failures(&self) -> impl Iterator<Item = (vi::Attempt, u64)> + '_ {
        self.stage_vi.iter().flat_map(|vi| &vi.failures).copied()
    }

    /// `y` at a time within the last accepted step, into `out`: the states from the collocation polynomial, the variables
    /// that belong to them; at the end of a step that is a switch, those after it.
    pub fn interpolate(&mut self, t: f64, out: &mut [f64]) {
        let at_end = t == self.t;
        if at_end {
            out.copy_from_slice(&self.y);
        } else {
            self.last.at(self.methods[self.last_method].tableau, t, out);
            std::mem::swap(&mut self.system.face, &mut self.last.face);
        }
        if let Some(consistent) = &mut self.consistent
            && (at_end || self.last.is_smooth)
            && !consistent.solve(&mut self.system, t, out)
        {
            self.forget_jacobian();
        }
        if !self.system.bounded.is_empty() && self.system.evaluate(t, out) {
            self.system.project(out);
        }
        if !at_end {
            std::mem::swap(&mut self.system.face, &mut self.last.face);
        }
    }

    /// What is needed to judge the variables at the time reached; `None` where no variable has a bound.
    pub fn variables(&mut self) -> Option<Variables<'_>> {
        if self.system.bounded.is_empty() || !self.system.evaluate(self.t, &self.y) {
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

    /// The active face.
    pub fn face(&self) -> &[Place] {
        &self.system.face
    }

    /// Whether the last step has kept one face.
    pub fn kept_face(&self) -> bool {
        self.last.is_smooth && self.continues
    }

    /// The problem, to be asked for more than steps need.
    pub fn problem(&mut self) -> &mut dyn Dvi {
        self.system.problem()
    }

    /// The time left.
    fn remaining(&self) -> f64 {
        (self.end - self.t) - self.lag
    }

    pub(super) fn tableau(&self) -> &'static Tableau {
        self.methods[self.current].tableau
    }

    /// Makes one accepted step.
    ///
    /// # Errors
    /// If the step size falls below what `t` or the settings allow, with the cause.
    pub fn step(&mut self) -> Result<(), StepError> {
        loop {
            let remaining = self.remaining();
            let Settings { step, min_step, max_step, .. } = self.settings;
            let mut h = step.unwrap_or(self.h.max(min_step)).min(max_step);
            if 1.000_1 * h >= remaining {
                h = remaining;
            } else if self.t + (h + self.lag) == self.t {
                return Err(StepError::StepTooSmall { t: self.t, h, cause: Cause::Error });
            }
            let outcome = self.attempt(h)?;
            let Attempt::Solved { h: reached, iterations, coupled } = outcome else {
                self.counts.rejected_newton += 1;
                self.controller.surprise();
                if self.jacobian == Freshness::Kept {
                    self.forget_jacobian();
                }
                self.shrink(h, Cause::Newton, |_| outcome.factor() * h)?;
                continue;
            };
            if self.settings.step.is_some() {
                self.accept(reached, coupled);
                return Ok(());
            }
            let error = self.error(reached, coupled);
            let (s, most) = (self.tableau().stages(), self.control.most);
            if error < 1.0 {
                let mut new = self.controller.accept(s, reached, error, iterations, most);
                // A step nearly as large as the last is not worth new factors.
                if !coupled && self.contraction.theta <= THETA && (1.0..=1.2).contains(&(new / reached)) {
                    new = reached;
                }
                // A step cut short by a switch says nothing against the size that was tried.
                self.h = if reached < h { h } else { new };
                self.accept(reached, coupled);
                self.change_order();
                return Ok(());
            }
            self.counts.rejected_error += 1;
            self.switching.abandon();
            if coupled {
                self.system.face.copy_from_slice(&self.switching.before);
            }
            let first = self.counts.accepted == 0;
            self.shrink(reached, Cause::Error, |controller| {
                controller.reject(s, reached, error.min(1e10), iterations, most, first)
            })?;
        }
    }

    /// Solves the stages of a step of size `h`, or of the shorter one that ends at a switch.
    fn attempt(&mut self, h: f64) -> Result<Attempt, StepError> {
        if self.system.set.has_blocks() {
            self.differentiate()?;
            self.set_tolerances(h);
            self.predict(h);
            return Ok(self.couple(h));
        }
        for _ in 0..=self.system.bounded.len() {
            self.prepare(h)?;
            self.predict(h);
            match self.newton(h) {
                Newton::Converged { iterations, violated } => {
                    let dip = if violated || self.stage_vi.is_none() { None } else { self.dip(h) };
                    if !violated && dip.is_none() {
                        return Ok(Attempt::Solved { h, iterations, coupled: false });
                    }
                    match self.locate(h, dip)? {
                        Located::At(h) => return Ok(Attempt::Solved { h, iterations, coupled: false }),
                        Located::Now => {}
                        Located::Nowhere => break,
                    }
                }
                Newton::Slow(factor) if self.stage_vi.is_none() => return Ok(Attempt::Failed(factor)),
                Newton::Diverged if self.stage_vi.is_none() => return Ok(Attempt::Failed(0.5)),
                Newton::Slow(_) | Newton::Diverged => break,
            }
        }
        self.predict(h);
        Ok(self.couple(h))
    }

    /// Newton's method on the present face.
    pub(super) fn newton(&mut self, h: f64) -> Newton {
        let tableau = self.tableau();
        self.stages.newton(
            &mut self.system,
            tableau,
            &mut self.factors,
            self.t,
            h,
            &self.y,
            &self.control,
            &mut self.contraction,
        )
    }

    /// Solves the stages with the VI coupled over them, from the increments at hand.
    fn couple(&mut self, h: f64) -> Attempt {
        let tableau = self.tableau();
        let Some(stage_vi) = &mut self.stage_vi else { return Attempt::Failed(0.5) };
        self.contraction = Contraction::default();
        self.switching.remember(&self.system.face);
        if stage_vi.solve(&mut self.system, tableau, &mut self.stages, self.t, h, &self.y, &self.control) {
            Attempt::Solved { h, iterations: self.control.most, coupled: true }
        } else {
            Attempt::Failed(0.5)
        }
    }

    /// Makes derivatives, factors and tolerances ready for a step of size `h`.
    pub(super) fn prepare(&mut self, h: f64) -> Result<(), StepError> {
        self.differentiate()?;
        if self.factored != Some(h) {
            let tableau = self.methods[self.current].tableau;
            self.factors.compute(&self.system, &self.system.face, tableau, h);
            self.system.work.factorisations += 1;
            self.factored = Some(h);
        }
        self.set_tolerances(h);
        Ok(())
    }

    /// Makes the derivatives those of this step where they are stale.
    fn differentiate(&mut self) -> Result<(), StepError> {
        if self.jacobian == Freshness::Stale {
            if !self.system.differentiate(self.t, &self.y) {
                let row = self.system.entries().find(|(_, _, value)| !value.is_finite()).map_or(0, |(row, _, _)| row);
                let (what, component) = self.name_row(row);
                let what = match what {
                    "rate" => "derivative of the rate",
                    "inequality" => "derivative of the inequality",
                    _ => "derivative of the bound",
                };
                return Err(StepError::NotFinite { what, component, t: self.t });
            }
            self.jacobian = Freshness::Fresh;
            self.factored = None;
        }
        Ok(())
    }

    /// The weights of the Newton norm at `y`: `1/sc` for states; for variables, what an error of theirs over a step
    /// does to the states (never `z` itself, which is of lower order and jumps).
    pub(super) fn set_tolerances(&mut self, h: f64) {
        let tolerance = &self.methods[self.current].tolerance;
        let n = self.system.states;
        for j in 0..n {
            let scale = tolerance.factor * self.settings.atol[j] + tolerance.rtol * self.y[j].abs();
            self.control.weight[j] = 1.0 / scale.max(f64::MIN_POSITIVE);
        }
        for (size, y) in self.control.size.iter_mut().zip(&self.y) {
            *size = y.abs();
        }
        self.control.kappa = tolerance.kappa;
        self.control.most = tolerance.most;
        if self.system.unknowns > n {
            let (states, effects) = self.control.weight.split_at_mut(n);
            effects.fill(0.0);
            for (i, j, value) in self.system.entries() {
                if i < n && j >= n {
                    let mass = self.system.mass_diagonal[i];
                    let effect = if mass == 0.0 { value } else { h * value / mass };
                    effects[j - n] = effects[j - n].max(effect.abs() * states[i]);
                }
            }
        }
    }

    /// Starting values: the last collocation polynomial, continued; zero where it says nothing of this step.
    pub(super) fn predict(&mut self, h: f64) {
        let n = self.system.unknowns;
        let tableau = self.tableau();
        if !self.continues || self.last_method != self.current {
            self.stages.z.fill(0.0);
            self.stages.w.fill(0.0);
            return;
        }
        self.last.increment_at(tableau, 1.0, &mut self.shifted);
        for (i, c) in tableau.c.iter().enumerate() {
            let out = &mut self.stages.z[i * n..(i + 1) * n];
            self.last.increment_at(tableau, 1.0 + c * h / self.last.h, out);
            for (out, end) in out.iter_mut().zip(&self.shifted) {
                *out -= end;
            }
        }
        self.stages.transform(tableau);
    }

    /// The embedded estimate of the error of the states, in units of the tolerance,
    /// `E^-1 (Phi(t_n, y_n) + (1/h) diag(M, 0) sum_i D_i Z_i)`, filtered once more where it looks too large.
    fn error(&mut self, h: f64, coupled: bool) -> f64 {
        if coupled && let Some(vi) = &mut self.stage_vi {
            vi.swap_face(&mut self.system);
        }
        let error = self.filtered_error(h, coupled);
        if coupled && let Some(vi) = &mut self.stage_vi {
            vi.swap_face(&mut self.system);
        }
        error
    }

    fn filtered_error(&mut self, h: f64, coupled: bool) -> f64 {
        let n = self.system.unknowns;
        let states = self.system.states;
        let factors = match &mut self.stage_vi {
            Some(vi) if coupled => vi.factors(),
            _ => &mut self.factors,
        };
        let weights = &self.methods[self.current].tableau.estimate;
        self.shifted.fill(0.0);
        for (weight, z) in weights.iter().zip(self.stages.z.chunks_exact(n)) {
            for (sum, z) in self.shifted[..states].iter_mut().zip(z) {
                *sum += weight / h * z;
            }
        }
        self.embedded.fill(0.0);
        self.system.add_mass(1.0, &self.shifted, &mut self.embedded);
        let mut error = f64::INFINITY;
        for pass in 0..2 {
            if pass == 1 {
                for (shifted, (y, e)) in self.shifted.iter_mut().zip(self.y.iter().zip(&self.estimate)) {
                    *shifted = y + e;
                }
            }
            let y = if pass == 0 { &self.y } else { &self.shifted };
            if !self.system.phi(self.t, y, &mut self.estimate) {
                return f64::INFINITY;
            }
            for (sum, e) in self.estimate.iter_mut().zip(&self.embedded) {
                *sum += e;
            }
            if !factors.solve_real(&mut self.estimate) {
                return f64::INFINITY;
            }
            let sum: f64 =
                self.estimate[..states].iter().zip(&self.control.weight).map(|(e, w)| (e * w) * (e * w)).sum();
            error = (sum / states as f64).sqrt();
            if error < 1.0 || !(self.counts.accepted == 0 || self.controller.rejected) {
                break;
            }
        }
        if error.is_nan() { f64::INFINITY } else { error }
    }

    /// Makes the step at hand part of the trajectory.
    fn accept(&mut self, h: f64, coupled: bool) {
        let n = self.system.unknowns;
        let s = self.tableau().stages();
        let face = if coupled { &self.switching.before } else { &self.system.face };
        self.last.set(self.t, h, &self.y, &self.stages.z[..s * n], face);
        self.last.is_smooth = !coupled;
        self.last.slope.clear();
        if let Some(gamma) = self.tableau().gamma
            && self.settings.step.is_none()
            && !coupled
        {
            let states = &self.estimate[..self.system.states];
            self.last.slope.extend(states.iter().map(|e| gamma * e));
        }
        self.last_method = self.current;
        if h >= self.remaining() {
            (self.t, self.lag) = (self.end, 0.0);
        } else {
            // The rounding errors of many short steps would else add up.
            let (t, step) = (self.t, h + self.lag);
            self.t = t + step;
            let taken = self.t - t;
            self.lag = (t - (self.t - taken)) + (step - taken);
        }
        for (y, z) in self.y.iter_mut().zip(&self.stages.z[(s - 1) * n..s * n]) {
            *y += z;
        }
        self.counts.accepted += 1;
        self.continues = true;
        if !(self.system.constant_jacobian() || self.contraction.theta <= THETA) {
            self.jacobian = Freshness::Stale;
        } else if self.jacobian == Freshness::Fresh {
            self.jacobian = Freshness::Kept;
        }
        self.settle(coupled);
    }

    /// Takes more stages or fewer from the next step on, where the number is free.
    fn change_order(&mut self) {
        if self.methods.len() == 1 {
            return;
        }
        let wish = self.controller.order_change(self.contraction);
        let new = self.current.saturating_add_signed(wish).min(self.methods.len() - 1);
        if new != self.current {
            self.current = new;
            self.factored = None;
            self.contraction = Contraction::default();
            self.controller.order_changed();
        }
    }

    /// Makes the next attempt smaller than `h`; fails where the step is fixed or would be too small to go on with.
    fn shrink(&mut self, h: f64, cause: Cause, smaller: impl Fn(&mut Controller) -> f64) -> Result<(), StepError> {
        if self.settings.step.is_some() {
            self.check_evaluation()?;
            return Err(StepError::NewtonFailed { t: self.t, h });
        }
        let min_step = self.settings.min_step;
        self.h = smaller(&mut self.controller).max(if h > min_step { min_step } else { 0.0 });
        let least = min_step.max(10.0 * f64::EPSILON * self.t.abs()).max(f64::MIN_POSITIVE);
        if self.h < least || !self.h.is_finite() {
            // What the last, shortest attempt met says more than that it failed.
            self.check_evaluation()?;
            return Err(StepError::StepTooSmall { t: self.t, h: self.h, cause });
        }
        Ok(())
    }

    /// Has the derivatives evaluated anew before the next attempt.
    pub(super) fn forget_jacobian(&mut self) {
        if !self.system.constant_jacobian() {
            self.jacobian = Freshness::Stale;
        }
    }

    /// Forgets what no longer holds after a switch: derivatives, factors, the continued polynomial.
    pub(super) fn restart(&mut self) {
        self.forget_jacobian();
        self.factored = None;
        self.continues = false;
        self.contraction = Contraction::default();
        self.controller.restart();
    }

    fn check_finite(&mut self) -> Result<(), StepError> {
        self.system.evaluate(self.t, &self.y);
        self.check_evaluation()
    }

    /// Whether the last evaluation gave numbers, and intervals that hold one.
    fn check_evaluation(&self) -> Result<(), StepError> {
        let t = self.t;
        if let Some(row) = self.system.values.iter().position(|value| !value.is_finite()) {
            let (what, component) = self.name_row(row);
            return Err(StepError::NotFinite { what, component, t });
        }
        let set = &self.system.set;
        match self.system.bounded.iter().find(|&&k| set.lower[k] > set.upper[k]) {
            Some(&variable) => Err(StepError::EmptySet { variable, t }),
            None => Ok(()),
        }
    }

    /// What a row of the evaluation is, and its number among its kind.
    fn name_row(&self, row: usize) -> (&'static str, usize) {
        let (n, unknowns) = (self.system.states, self.system.unknowns);
        if row < n {
            ("rate", row)
        } else if row < unknowns {
            ("inequality", row - n)
        } else {
            ("bound", row - unknowns)
        }
    }

    /// A first step over which the rates at the start change the states by about the tolerance to the power that the
    /// order asks for.
    fn first_step(&mut self) -> f64 {
        let span = self.end - self.t;
        if let Some(h) = self.settings.step.or(self.settings.first_step) {
            return h.min(span);
        }
        let n = self.system.states;
        self.set_tolerances(span);
        let speed = (0..n)
            .map(|j| {
                let mass = self.system.mass_diagonal[j];
                let rate = if mass == 0.0 { 0.0 } else { self.system.values[j] / mass };
                (rate * self.control.weight[j]).powi(2)
            })
            .sum::<f64>()
            .sqrt()
            / (n as f64).sqrt();
        let s = self.tableau().stages() as f64;
        // One tolerance of change a step is far too careful; the order says by how much.
        let reach = (1.0 / self.settings.rtol).powf(1.0 - 1.0 / (s + 1.0)).sqrt();
        let least = (1e-12 * span).max(f64::EPSILON * self.t.abs());
        (reach / speed).min(1e-3 * span).max(least).min(span)
    }
}
