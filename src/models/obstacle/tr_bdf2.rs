//! TR-BDF2: the trapezoidal rule to `t + gamma h`, then the second-order backward differentiation formula to `t + h`,
//! with a variational inequality at both stages:
//!
//! ```text
//! U_1 = u,    M (U_i - u - h sum_{j<i} a_ij k_j) + d h A(t_i) U_i - d h f(t_i) = d h w_i,    U_i in K(t_i),
//! k_i = (U_i - u - h sum_{j<i} a_ij k_j) / (d h),    <w_i, v - U_i> <= 0  for all v in K(t_i),    u_+ = U_3
//! ```
//!
//! with `gamma = 2 - sqrt 2`, `d = gamma / 2`, `a_21 = d`, `a_31 = a_32 = sqrt 2 / 4`. The method is of second order,
//! L-stable and stiffly accurate, uses one matrix `M + d h A` for both stages, and has a third-order companion for
//! error estimation (Bank et al. 1985; Hosea and Shampine 1996, *Analysis and implementation of TR-BDF2*, equations 3
//! and 16). For American options, Le Floc'h 2014 found it the most accurate of the usual schemes.
//!
//! Where the free boundary passes, `u_t` of a parabolic obstacle problem is continuous; only `u_tt` jumps. The error of
//! a step is then `h^2` on the nodes passed by the free boundary, a fraction `h` of the domain: the order is preserved,
//! and steps need not end at such times.

mod automaton;
mod one_step;

pub use automaton::ContactChange;

use super::hidden::{Hidden, Seen};
use super::resting::Moment;
use super::settings::{Counts, ObstacleError, Settings};
use super::stage::{Stage, Unsolved};
use super::{Obstacle, ObstacleDataError, Semidiscrete};
use hybrid::Breaks;
use problem::Control;
use std::f64::consts::SQRT_2;

/// The abscissa of the first stage of TR-BDF2, as a fraction of the step.
pub const GAMMA: f64 = 2.0 - SQRT_2;
/// The diagonal coefficient `d` of both stages of TR-BDF2.
const D: f64 = 0.5 * GAMMA;
/// The coefficients `a_31 = a_32` of TR-BDF2, the weights of the first two slopes.
const W: f64 = 0.25 * SQRT_2;
/// The weights of the embedded third-order method less those of TR-BDF2, for error estimation.
const E: [f64; 3] = [(1.0 - W) / 3.0 - W, (3.0 * W + 1.0) / 3.0 - W, D / 3.0 - D];

/// The default initial step size, as a fraction of the integration interval.
const FIRST: f64 = 1e-4;

/// The relative tolerance, in place of `rtol`, for hidden motion of nodes between stages in runs with a fixed step
/// size.
const FIXED: f64 = 1e-3;

/// Fraction of the error tolerance below which hidden motion of nodes between stages is not bounded more closely.
const NEGLIGIBLE: f64 = 0.1;

/// The length of the implicit Euler step that computes the initial slope `u'`, relative to the first time step: short
/// enough not to affect the accuracy of the run, yet a step that projects onto `K`.
const INITIAL: f64 = 1e-3;

/// The TR-BDF2 stepper of an obstacle problem, with its state.
pub struct TrBdf2<'c> {
    /// The semidiscrete equations, with vectors evaluated at the current time.
    pub system: Semidiscrete,
    /// The time that the integration has reached.
    pub t: f64,
    /// The nodal values of the solution at the current time.
    pub u: Vec<f64>,
    /// The contact force of the obstacles on each node at the current time.
    pub force: Vec<f64>,
    /// The start time of the last step, the nodal values at that time, and the nodal values at the first stage.
    pub last: (f64, Vec<f64>, Vec<f64>),
    /// Statistics of the time integration.
    pub counts: Counts,
    end: f64,
    settings: Settings,
    control: &'c Control,
    stage: Stage,
    /// The size of the next time step to attempt.
    h: f64,
    /// The slopes `k_j` at the beginning of the step and at both stages.
    slopes: [Vec<f64>; 3],
    /// The explicit part `u + h sum_{j<i} a_ij k_j` of stage `i`.
    base: Vec<f64>,
    /// The error estimate of the attempted step at each node.
    error: Vec<f64>,
    /// The nodal values at both stages of the attempted step.
    trial: [Vec<f64>; 2],
    /// The contact states and forces at the beginning of the step and at both stages. When a step is accepted, `accept`
    /// swaps the first and the last.
    moments: [Moment; 3],
    hidden: Hidden,
    was_rejected: bool,
    /// The least distance of a node without a Dirichlet condition from the obstacles at the current time.
    gap: f64,
    breaks: Breaks,
    /// Whether no step has been made since a breakpoint of the data, so that the next step starts anew.
    restarts: bool,
    /// The beginnings and ends of contact since the last step began, with their times.
    pub changes: Vec<(f64, ContactChange)>,
}

/// The result of an attempted TR-BDF2 step.
enum Attempt {
    /// Both stages were solved; the error estimate of the step, in units of the tolerance.
    Made(f64),
    /// The variational inequality of a stage was not solved, for the given reason.
    Unsolved(&'static str),
}

impl<'c> TrBdf2<'c> {
    /// Initialises the stepper at `start`.
    ///
    /// # Errors
    /// If the data at `start` are invalid, or if the variational inequality of the initial slope is not solved.
    pub fn new(
        problem: Obstacle,
        (start, end): (f64, f64),
        settings: Settings,
        control: &'c Control,
    ) -> Result<Self, ObstacleError> {
        let mut system = Semidiscrete::new(problem, control).map_err(|_| ObstacleError::Interrupted { t: start })?;
        system.vectors_at(start, control)?;
        let u = system.initial(start, control)?;
        let n = u.len();
        let zeros = || vec![0.0; n];
        let first = settings.first_step.unwrap_or(FIRST * (end - start)).min(settings.max_step).min(end - start);
        let mut stepper = Self {
            hidden: Hidden::new(&system),
            moments: std::array::from_fn(|_| Moment::new(n)),
            stage: Stage::new(&system),
            system,
            t: start,
            last: (start, u.clone(), u.clone()),
            u,
            force: zeros(),
            counts: Counts::default(),
            end,
            settings,
            control,
            h: settings.step.unwrap_or(first),
            slopes: [zeros(), zeros(), zeros()],
            base: zeros(),
            error: zeros(),
            trial: [zeros(), zeros()],
            was_rejected: false,
            gap: f64::INFINITY,
            breaks: Breaks::new(start),
            restarts: false,
            changes: Vec::new(),
        };
        stepper.find_initial_slope(stepper.h)?;
        stepper.gap = stepper.least_gap(&stepper.u);
        Ok(stepper)
    }

    /// Returns the coefficients of `part` and `part^2` in the displacement of a node that came into contact within the
    /// last step, where `part` is the fraction of the step; `None` for other nodes.
    fn approach(&self, node: usize) -> Option<[f64; 2]> {
        let (start, before, middle) = &self.last;
        let [at_end, at_middle, at_start] = &self.moments;
        if at_start.held[node] != 0 || at_end.held[node] == 0 {
            return None;
        }
        // Once the step is accepted, `slopes[2]` contains the slope at the beginning of the step.
        let change = (self.t - start) * self.slopes[2][node];
        let bends = at_middle.held[node] == 0;
        let curvature = (middle[node] - before[node] - GAMMA * change) / (GAMMA * GAMMA);
        Some([change, if bends { curvature } else { 0.0 }])
    }

    /// Sets the initial slope and contact forces for a step of size `h`, by a short implicit Euler step.
    fn find_initial_slope(&mut self, h: f64) -> Result<(), ObstacleError> {
        let h = INITIAL * h;
        self.base.copy_from_slice(&self.u);
        self.trial[1].copy_from_slice(&self.u);
        match self.solve(1, h, self.t + h)? {
            Ok(()) => {}
            Err(why) => return Err(ObstacleError::Unsolved { t: self.t, h, why }),
        }
        self.slopes.swap(0, 2);
        self.moments.swap(0, 2);
        self.force.copy_from_slice(&self.moments[0].force);
        self.system.vectors_at(self.t, self.control)?;
        self.moments[0].load.copy_from_slice(&self.system.load);
        Ok(())
    }

    fn attempt(&mut self, h: f64, next: f64) -> Result<Attempt, ObstacleError> {
        let Self { base, u, slopes: [first, ..], trial, .. } = self;
        for ((base, &u), &k) in base.iter_mut().zip(u.iter()).zip(first.iter()) {
            *base = u + D * h * k;
        }
        trial[0].copy_from_slice(u);
        if let Err(why) = self.solve(0, D * h, self.t + GAMMA * h)? {
            return Ok(Attempt::Unsolved(why));
        }
        let Self { base, u, slopes: [first, second, _], trial, .. } = self;
        for (((base, &u), &k), &l) in base.iter_mut().zip(u.iter()).zip(first.iter()).zip(second.iter()) {
            *base = u + W * h * (k + l);
        }
        let [middle, last] = trial;
        last.copy_from_slice(middle);
        if let Err(why) = self.solve(1, D * h, next)? {
            return Ok(Attempt::Unsolved(why));
        }
        let largest = self.largest(h);
        let size = self.settings.atol + self.settings.rtol * largest;
        if self.settings.step.is_some() {
            // In a run with a fixed step size, compare the hidden motion of nodes with the tolerance `FIXED` instead of
            // `rtol`.
            let size = FIXED / self.settings.rtol * size;
            self.counts.unproven += u64::from(self.hidden_error(h, next, size)? > size);
            self.counts.given_steps += if largest > 0.0 { self.error(h) / largest } else { 0.0 };
            return Ok(Attempt::Made(0.0));
        }
        let error = self.hidden_error(h, next, size)?.hypot(self.error(h));
        Ok(Attempt::Made(if error == 0.0 { 0.0 } else { error / size }))
    }

    /// Returns the largest `|u|` over the nodes at both ends of the attempted step; if `u` is zero, the largest
    /// displacement that the load causes in a step of size `h`.
    fn largest(&self, h: f64) -> f64 {
        let largest = self.trial[1].iter().chain(&self.u).fold(0.0_f64, |largest, u| largest.max(u.abs()));
        if largest > 0.0 {
            return largest;
        }
        let loads = self.moments.iter().flat_map(|moment| moment.load.iter().zip(&self.system.weights));
        loads.fold(0.0, |largest, (load, weight)| largest.max(h * load.abs() / weight))
    }

    /// Returns the bound on hidden motion of nodes between the stages of a step, computed to within the fraction
    /// `NEGLIGIBLE` of the error tolerance `size`.
    fn hidden_error(&mut self, h: f64, next: f64, size: f64) -> Result<f64, ObstacleError> {
        let times = [self.t, self.t + GAMMA * h, next];
        let seen = Seen { times, values: [&self.u, &self.trial[0], &self.trial[1]], moments: &self.moments };
        self.hidden.error(&mut self.system, &seen, NEGLIGIBLE * size, self.control)
    }

    /// Solves stage `i` of the attempted step from the initial guess `trial[i]` and computes its slope; the inner error
    /// is the reason why the variational inequality was not solved.
    fn solve(&mut self, i: usize, shift: f64, t: f64) -> Result<Result<(), &'static str>, ObstacleError> {
        self.system.vectors_at(t, self.control)?;
        self.counts.vectors += 1;
        let changed = self.system.operator_at(t, self.control)?;
        self.counts.operators += u64::from(changed);
        let u = &mut self.trial[i];
        let solved = self.stage.solve(&self.system, (shift, changed), &self.base, u, self.control);
        let work = &self.stage.work;
        (self.counts.matrices, self.counts.solves, self.counts.passes) = (work.matrices, work.solves, work.passes);
        match solved {
            Ok(residual) if residual <= self.settings.vi_tolerance => {
                self.counts.residual = self.counts.residual.max(residual);
            }
            Ok(_) => return Ok(Err("the residual is above the tolerance")),
            Err(Unsolved::Interrupted) => return Err(ObstacleError::Interrupted { t: self.t }),
            Err(Unsolved::Memory) => return Err(ObstacleError::Memory { nodes: self.u.len() }),
            Err(Unsolved::Singular) => return Ok(Err("the matrix has no positive diagonal")),
            Err(Unsolved::NoSolution) => return Ok(Err("no active set was found")),
        }
        for ((slope, &u), &base) in self.slopes[i + 1].iter_mut().zip(u.iter()).zip(&self.base) {
            *slope = (u - base) / shift;
        }
        let Moment { held, force, kept, load } = &mut self.moments[i + 1];
        kept.copy_from_slice(&self.stage.kept);
        held.copy_from_slice(&self.stage.held);
        force.copy_from_slice(&self.stage.force);
        load.copy_from_slice(&self.system.load);
        Ok(Ok(()))
    }

    /// Returns the root mean square error estimate of the step, with stiff components damped by the matrix of the
    /// stages. A node that came into contact at the end of the step lies exactly on the obstacle. Its error counts
    /// only as far as the error that it would have without the obstacle exceeds its displacement by the obstacle.
    fn error(&mut self, h: f64) -> f64 {
        let Self { slopes: [a, b, c], base: difference, error, moments, system, stage, control, .. } = self;
        for (i, difference) in difference.iter_mut().enumerate() {
            *difference = h * (E[0] * a[i] + E[1] * b[i] + E[2] * c[i]);
        }
        if !stage.damp(system, difference, error, control) {
            return f64::NAN;
        }
        let [first, middle, last] = moments;
        let (mut square, mut domain) = (0.0, 0.0);
        for (i, (&error, &weight)) in error.iter().zip(&system.weights).enumerate() {
            let landed = last.held[i] != 0 && first.held[i] == 0 && middle.held[i] == 0;
            let without = || (difference[i] - E[2] / D * last.kept[i]).abs() - last.kept[i].abs();
            let error = if landed { without().max(0.0) } else { error };
            square += weight * error * error;
            domain += weight;
        }
        (square / domain).sqrt()
    }

    /// Local extrapolation: adds the error estimate `e_1` of the accepted step to its end, for third order. The
    /// estimate is damped once more to `e` by `S e = M e_1` with `S = M + d h A` on free nodes, to keep the method A-
    /// and L-stable; the slope changes by `-M^-1 A e = -(e_1 - e) / (d h)`. Nodes in contact are not changed.
    fn extrapolate(&mut self, h: f64) {
        let Self { base: once, error, trial: [_, last], slopes: [.., slope], system, stage, control, .. } = self;
        once.copy_from_slice(error);
        if !stage.damp(system, once, error, control) {
            return;
        }
        for i in (0..last.len()).filter(|&i| !system.is_given[i]) {
            last[i] = system.set.project(i, last[i] + error[i]);
            slope[i] -= (once[i] - error[i]) / (D * h);
        }
    }

    /// Accepts the attempted step of size `h`, which ends at time `next`, as the last step of the run.
    fn append(&mut self, h: f64, next: f64) {
        if self.settings.step.is_none() {
            self.extrapolate(h);
        }
        let [middle, last] = &mut self.trial;
        self.last.0 = self.t;
        std::mem::swap(&mut self.last.1, &mut self.u);
        std::mem::swap(&mut self.last.2, middle);
        std::mem::swap(&mut self.u, last);
        let [first, _, third] = &mut self.slopes;
        std::mem::swap(first, third);
        self.moments.swap(0, 2);
        self.force.copy_from_slice(&self.moments[0].force);
        self.t = next;
    }
}

impl From<ObstacleDataError> for ObstacleError {
    fn from(error: ObstacleDataError) -> Self {
        Self::ObstacleDataError(error)
    }
}
