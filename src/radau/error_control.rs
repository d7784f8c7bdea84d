//! Step size and order, as in RADAU (Hairer and Wanner, Stiff differential equations solved by Radau methods, 1999)
//! with Gustafsson's predictive controller (Hairer and Wanner 1996, IV.8).

use super::stages::Contraction;

/// Tolerances of a method with `s` stages, rescaled so that the error of the result, rather than that of the embedded
/// formula of order `s`, is about the requested tolerance.
#[derive(Clone, Copy, Debug)]
pub struct Rescaled {
    /// Rescaled relative tolerance, `0.1 rtol^((s+1)/(2s))` if the step size is adaptive, for the requested tolerance
    /// `rtol` and `s` stages.
    pub rtol: f64,
    /// The exponent `(s+1)/(2s)` that converts tolerances and errors of the result to those of the embedded formula.
    pub exponent: f64,
    /// Factor of each absolute tolerance `atol`: the rescaled `rtol` divided by the requested one.
    pub factor: f64,
    /// The tolerance on the norm of the remaining Newton increment.
    pub kappa: f64,
    /// Maximum number of Newton iterations on the stages of a step: 4, 7, 12, 17 for 1, 3, 5, 7 stages if the step size
    /// is adaptive.
    pub most: usize,
}

impl Rescaled {
    /// Rescales the tolerances of a run; with a fixed step size there is no embedded formula, and `rtol` bounds the
    /// Newton error alone.
    pub fn new(s: usize, rtol: f64, adaptive: bool) -> Self {
        let order = s as f64;
        let exponent = (order + 1.0) / (2.0 * order);
        let scaled = if adaptive { 0.1 * rtol.powf(exponent) } else { rtol };
        let kappa = if s == 1 { 0.03 } else { scaled.powf((order - 1.0) / (order + 1.0)).min(0.03) };
        let most = match s {
            // A fixed step size cannot be reduced if Newton's method converges slowly.
            _ if !adaptive => 150,
            1 => 4,
            _ => (2.5 * order - 0.5).floor() as usize,
        };
        let kappa = kappa.max(10.0 * f64::EPSILON / scaled);
        Self { rtol: scaled, exponent, factor: scaled / rtol, kappa, most }
    }
}

/// State of the step size and order controllers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Controller {
    /// Size of the last accepted step and its error in tolerances, for the predictive controller; `None` after a start,
    /// a switch or a change of order.
    accepted: Option<(f64, f64)>,
    /// Whether the last attempt at a step was rejected.
    pub rejected: bool,
    /// Whether the stages of the last attempt could not be solved, although Newton's method may have contracted fast
    /// in the step before.
    surprised: bool,
    /// The ratio of the last two accepted step sizes.
    quotient: f64,
    /// A damped measure of the contraction of Newton's method on the stages, for the choice of the order.
    contraction: f64,
    /// Number of accepted steps since the order last changed.
    since_change: u32,
    /// Upper bound on the step size, so that the stages do not miss variations of the rates between them.
    caution: Caution,
}

/// A bound on the step size while the rates vary, in time or along the states, by more than the stages of longer steps
/// show. No error estimate indicates when the bound may be dropped, so a longer step is tried after a number of steps.
/// The number doubles each time the stages of a longer step miss the variation, and is halved each time they show it:
/// whether or not the bound remains necessary, the lost work is of the order of the necessary work.
#[derive(Clone, Copy, Debug, Default)]
struct Caution {
    /// The largest step size that is allowed at present.
    most: f64,
    /// The number of accepted steps before a longer step is tried.
    left: u64,
    /// The number of accepted steps that must follow a rejection before a longer step is tried.
    wait: u64,
}

impl Caution {
    fn rejected(&mut self, smaller: f64) {
        // Several rejected attempts at one step double the number of steps to wait only once.
        if self.left < self.wait || self.wait == 0 {
            self.wait = (2 * self.wait).max(1);
        }
        self.left = self.wait;
        self.most = smaller;
    }

    /// Returns the size of the next step after an accepted step of size `h`, if its error allows a next step of the
    /// size `new`.
    fn accepted(&mut self, h: f64, new: f64) -> f64 {
        if self.left > 0 {
            self.left -= 1;
            return new.min(self.most.max(h));
        }
        if self.wait > 0 && h > self.most {
            self.wait /= 2;
            self.most = h;
        }
        new
    }
}

impl Controller {
    /// Returns the factor by which the step size may change for an error of the step of `error` tolerances. The safety
    /// factor is smaller for more Newton iterations.
    fn basic(s: usize, error: f64, newton: usize, most: usize) -> f64 {
        let most = most as f64;
        let safety = 0.9 * (2.0 * most + 1.0) / (2.0 * most + newton as f64);
        (safety * error.powf(-1.0 / (s as f64 + 1.0))).clamp(0.2, 8.0)
    }

    /// Returns the next step size after an accepted step of size `h` with an error of `error` tolerances.
    pub fn accept(&mut self, s: usize, h: f64, error: f64, newton: usize, most: usize) -> f64 {
        let error = error.max(1e-10);
        let mut new = h * Self::basic(s, error, newton, most);
        if let Some((h_accepted, error_accepted)) = self.accepted {
            let growth = (error_accepted / (error * error)).powf(1.0 / (s as f64 + 1.0));
            new = new.min(h * (0.9 * (h / h_accepted) * growth).clamp(0.2, 8.0));
            self.quotient = h / h_accepted;
        }
        if self.rejected {
            new = new.min(h);
        }
        self.accepted = Some((h, error.max(0.01)));
        self.rejected = false;
        self.since_change += 1;
        self.caution.accepted(h, new)
    }

    /// Returns the next step size after a step of size `h` whose error is too large.
    pub fn reject(&mut self, s: usize, h: f64, error: f64, newton: usize, most: usize, first: bool) -> f64 {
        self.rejected = true;
        if first { 0.1 * h } else { h * Self::basic(s, error, newton, most).min(0.9) }
    }

    /// Returns the next step size after a step of size `h` whose stages missed a variation of the rates, in time or
    /// along the states, that causes an error of `missed` tolerances in the states.
    pub fn miss(&mut self, s: usize, h: f64, missed: f64, newton: usize, most: usize) -> f64 {
        let smaller = self.reject(s, h, missed, newton, most, false);
        self.caution.rejected(smaller);
        smaller
    }

    /// Records a rejected step whose stages missed a variation of the rates that begins at the distance `size` from
    /// its beginning; returns `size`, the next step size.
    pub fn cut(&mut self, size: f64) -> f64 {
        self.rejected = true;
        size
    }

    /// Discards the recorded size and error of the steps before a switch.
    pub fn restart(&mut self) {
        self.accepted = None;
    }

    /// Records an attempt whose stages could not be solved, although Newton's method may have contracted fast in the
    /// step before.
    pub fn surprise(&mut self) {
        self.rejected = true;
        self.surprised = true;
    }

    /// Returns whether the next step should have more stages (1), fewer (-1) or as many (0): the contraction of
    /// Newton's method shows whether a higher order is worth its larger systems.
    pub fn order_change(&mut self, contraction: Contraction) -> isize {
        self.contraction = contraction.theta.max(0.5 * self.contraction).min(10.0);
        let steady = self.quotient > 0.8 && self.quotient < 1.2;
        let change = if self.contraction >= 0.8 || self.surprised {
            -1
        } else {
            isize::from(self.contraction <= 0.002 && steady && self.since_change > 10)
        };
        self.surprised = false;
        change
    }

    /// Resets the controllers after a change of order (of the number of stages).
    pub fn order_changed(&mut self) {
        self.since_change = 0;
        self.accepted = None;
    }
}
