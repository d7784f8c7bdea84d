//! One step after another: Jacobian, factors, stages, face, error, acceptance.

use super::consistent::Consistent;
use super::dense_output::Step;
use super::error_control::{Controller, Rescaled};
use super::factors::Factors;
use super::settings::{Cause, Settings, StageChoice, StepError};
use super::stage_vi::StageVi;
use super::stages::{Contraction, Newton, NewtonControl, Stages};
use super::switches::{Located, Switching};
use super::system::System;
use super::tableau::Tableau;
use crate::problem::Dvi;

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
    pub(super) tableau: Tableau,
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
        let system = System::new(problem)?;
        let counts = match settings.stages {
            StageChoice::Fixed(s) => vec![s],
            StageChoice::Auto => vec![3, 5, 7],
        };
        let adaptive = settings.step.is_none();
        let methods: Vec<Method> = counts
            .iter()
            .map(|&s| Method { tableau: Tableau::new(s), tolerance: Rescaled::new(s, settings.rtol, adaptive) })
            .collect();
        let most_stages = counts.iter().copied().max().unwrap_or(1);
        let unknowns = system.unknowns;
        let mut y = vec![0.0; unknowns];
        y[..system.states].copy_from_slice(x);
        for k in 0..unknowns - system.states {
            y[system.states + k] = system.set.project(k, 0.0);
        }
        let control =
            NewtonControl { weight: vec![0.0; unknowns], kappa: 0.0, most: 0, vi_tolerance: settings.vi_tolerance };
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

    /// The coupled solver, where there are bounded variables.
    pub fn vi(&self) -> Option<&StageVi> {
        self.stage_vi.as_ref()
    }

    /// `y` at a time within the last accepted step, into `out`: the states from the collocation polynomial, the variables
    /// that belong to them; at the end of a step that is a switch, those after it.
    pub fn interpolate(&mut self, t: f64, out: &mut [f64]) {
        let n = self.system.states;
        let at_end = t == self.t;
        if at_end {
            out.copy_from_slice(&self.y);
        } else {
            self.last.at(&self.methods[self.last_method].tableau, t, out);
            std::mem::swap(&mut self.system.face, &mut self.last.face);
        }
        if let Some(consistent) = &mut self.consistent
            && (at_end || self.last.is_smooth)
            && !consistent.solve(&mut self.system, t, out)
        {
            self.forget_jacobian();
        }
        if !self.system.bounded.is_empty() && self.system.evaluate(t, out) {
            for &k in &self.system.bounded {
                out[n + k] = self.system.set.project(k, out[n + k]);
            }
        }
        if !at_end {
            std::mem::swap(&mut self.system.face, &mut self.last.face);
        }
    }

    /// The evidence at the time reached: `(natural-map residual, least distance of z to its bounds, least G signed so
    /// that it should not be negative, largest product)`, over the bounded variables.
    pub fn complementarity(&mut self) -> Option<[f64; 4]> {
        if self.system.bounded.is_empty() || !self.system.evaluate(self.t, &self.y) {
            return None;
        }
        let n = self.system.states;
        let set = &self.system.set;
        let mut worst = [0.0_f64, f64::INFINITY, f64::INFINITY, 0.0];
        for &k in &self.system.bounded {
            let (z, g) = (self.y[n + k], self.system.values[n + k]);
            let distance = (z - set.lower[k]).min(set.upper[k] - z);
            let signed = if z <= set.lower[k] {
                g
            } else if z >= set.upper[k] {
                -g
            } else {
                -g.abs()
            };
            worst[0] = worst[0].max((z - set.project(k, z - g)).abs());
            worst[1] = worst[1].min(distance);
            worst[2] = worst[2].min(signed);
            worst[3] = worst[3].max((distance * g).abs());
        }
        Some(worst)
    }

    pub(super) fn tableau(&self) -> &Tableau {
        &self.methods[self.current].tableau
    }

    /// Makes one accepted step.
    ///
    /// # Errors
    /// If the step size falls below what `t` or the settings allow, with the cause.
    pub fn step(&mut self) -> Result<(), StepError> {
        loop {
            let remaining = self.end - self.t;
            let mut h = self.settings.step.unwrap_or(self.h).min(self.settings.max_step);
            if 1.000_1 * h >= remaining {
                h = remaining;
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
                if !coupled && self.contraction.theta <= 1e-3 && (1.0..=1.2).contains(&(new / reached)) {
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
            let first = self.counts.accepted == 0;
            self.shrink(reached, Cause::Error, |controller| {
                controller.reject(s, reached, error.min(1e10), iterations, most, first)
            })?;
        }
    }

    /// Solves the stages of a step of size `h`, or of the shorter one that ends at a switch.
    fn attempt(&mut self, h: f64) -> Result<Attempt, StepError> {
        for _ in 0..=self.system.bounded.len() {
            self.prepare(h)?;
            self.predict(h);
            match self.newton(h) {
                Newton::Converged { iterations, violated: false } => {
                    return Ok(Attempt::Solved { h, iterations, coupled: false });
                }
                Newton::Converged { iterations, violated: true } => match self.locate(h)? {
                    Located::At(h) => return Ok(Attempt::Solved { h, iterations, coupled: false }),
                    Located::Now => {}
                    Located::Nowhere => break,
                },
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
        let tableau = &self.methods[self.current].tableau;
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
        let Some(stage_vi) = &mut self.stage_vi else { return Attempt::Failed(0.5) };
        let tableau = &self.methods[self.current].tableau;
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
        if self.jacobian == Freshness::Stale {
            if !self.system.differentiate(self.t, &self.y) {
                let component = self.system.derivatives.iter().position(|value| !value.is_finite()).unwrap_or(0);
                return Err(StepError::NotFinite { what: "derivative", component, t: self.t });
            }
            self.jacobian = Freshness::Fresh;
            self.factored = None;
        }
        if self.factored != Some(h) {
            let tableau = &self.methods[self.current].tableau;
            self.factors.compute(&self.system, &self.system.face, tableau, h);
            self.system.work.factorisations += 1;
            self.factored = Some(h);
        }
        self.set_tolerances(h);
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
        let tableau = &self.methods[self.current].tableau;
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
        self.last_method = self.current;
        self.t = if h >= self.end - self.t { self.end } else { self.t + h };
        for (y, z) in self.y.iter_mut().zip(&self.stages.z[(s - 1) * n..s * n]) {
            *y += z;
        }
        self.counts.accepted += 1;
        self.continues = true;
        if !(self.system.constant_jacobian() || self.contraction.theta <= 1e-3) {
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
            return Err(StepError::NewtonFailed { t: self.t, h });
        }
        self.h = smaller(&mut self.controller);
        let least = self.settings.min_step.max(10.0 * f64::EPSILON * self.t.abs()).max(f64::MIN_POSITIVE);
        if self.h < least || !self.h.is_finite() {
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
        if self.system.evaluate(self.t, &self.y) {
            return Ok(());
        }
        let at = self.system.values.iter().position(|value| !value.is_finite()).unwrap_or(0);
        let (n, unknowns) = (self.system.states, self.system.unknowns);
        let (what, component) = if at < n {
            ("rate", at)
        } else if at < unknowns {
            ("inequality", at - n)
        } else {
            ("bound", at - unknowns)
        };
        Err(StepError::NotFinite { what, component, t: self.t })
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
        (reach / speed).min(1e-3 * span).max(1e-12 * span)
    }
}
