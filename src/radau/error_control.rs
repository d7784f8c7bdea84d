//! Step size and order, as in RADAU (Hairer and Wanner, Stiff differential equations solved by Radau methods, 1999)
//! with Gustafsson's predictive controller (Hairer and Wanner 1996, IV.8).

use super::stages::Contraction;

/// Tolerances of a method with `s` stages, rescaled so that the error of the result, not of the embedded formula of
/// order `s`, is about the tolerance asked for.
#[derive(Clone, Copy, Debug)]
pub struct Rescaled {
    /// `0.1 rtol^((s+1)/(2s))`
    pub rtol: f64,
    /// `(s+1)/(2s)`, by which tolerances and errors of the result become those of the embedded formula.
    pub exponent: f64,
    /// What multiplies each `atol`: `rtol' / rtol`.
    pub factor: f64,
    /// The bound on the norm of the remaining Newton increment.
    pub kappa: f64,
    /// The most Newton iterations: 4, 7, 12, 17 for 1, 3, 5, 7 stages where the step can be made smaller instead.
    pub most: usize,
}

impl Rescaled {
    /// For an adaptive run; with a fixed step there is no embedded formula and `rtol` bounds the Newton error alone.
    pub fn new(s: usize, rtol: f64, adaptive: bool) -> Self {
        let order = s as f64;
        let exponent = (order + 1.0) / (2.0 * order);
        let scaled = if adaptive { 0.1 * rtol.powf(exponent) } else { rtol };
        let kappa = if s == 1 { 0.03 } else { scaled.powf((order - 1.0) / (order + 1.0)).min(0.03) };
        let most = match s {
            // A fixed step cannot be made smaller instead.
            _ if !adaptive => 150,
            1 => 4,
            _ => (2.5 * order - 0.5).floor() as usize,
        };
        let kappa = kappa.max(10.0 * f64::EPSILON / scaled);
        Self { rtol: scaled, exponent, factor: scaled / rtol, kappa, most }
    }
}

/// The memory of the step size and order controllers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Controller {
    /// Size and error of the last accepted step, for the predictive controller; none after a start, switch or change
    /// of order.
    accepted: Option<(f64, f64)>,
    /// Whether the last attempt was rejected.
    pub rejected: bool,
    /// Whether the last attempt failed unexpectedly.
    surprised: bool,
    /// The ratio of the last two accepted step sizes.
    quotient: f64,
    /// A damped measure of the contraction of Newton's method.
    contraction: f64,
    /// Accepted steps since the order last changed.
    since_change: u32,
    /// How long steps may be for their stages to show what the rates do.
    caution: Caution,
}

/// A bound on the step size while the rates do more, in time or along the states, than the stages of longer steps show. No
/// error estimate says when the bound may be dropped, so a longer step is tried after a number of steps. That number doubles
/// each time a longer step does not show the rates, and is halved each time one does: the work that is lost, whether or not
/// the bound remains necessary, is of the order of the work of the steps that are needed.
#[derive(Clone, Copy, Debug, Default)]
struct Caution {
    /// The largest step size allowed.
    most: f64,
    /// The number of accepted steps until a longer one is tried.
    left: u64,
    /// The value of `left` after the last rejection.
    wait: u64,
}

impl Caution {
    fn rejected(&mut self, smaller: f64) {
        // Attempts at one step count once.
        if self.left < self.wait || self.wait == 0 {
            self.wait = (2 * self.wait).max(1);
        }
        self.left = self.wait;
        self.most = smaller;
    }

    /// The size of the next step after one of size `h`, where the error allows `new`.
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
    /// The factor that error `error`, in units of the tolerance, allows the step to change by. Larger Newton counts make it
    /// more careful.
    fn basic(s: usize, error: f64, newton: usize, most: usize) -> f64 {
        let most = most as f64;
        let safety = 0.9 * (2.0 * most + 1.0) / (2.0 * most + newton as f64);
        (safety * error.powf(-1.0 / (s as f64 + 1.0))).clamp(0.2, 8.0)
    }

    /// The next step size after an accepted step of size `h`.
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

    /// The next step size after a step of size `h` whose error was too large.
    pub fn reject(&mut self, s: usize, h: f64, error: f64, newton: usize, most: usize, first: bool) -> f64 {
        self.rejected = true;
        if first { 0.1 * h } else { h * Self::basic(s, error, newton, most).min(0.9) }
    }

    /// The next step size after a step of size `h` whose stages did not show what the rates do, in time or along the states:
    /// `missed` is the error this causes in the states, in units of their tolerances.
    pub fn miss(&mut self, s: usize, h: f64, missed: f64, newton: usize, most: usize) -> f64 {
        let smaller = self.reject(s, h, missed, newton, most, false);
        self.caution.rejected(smaller);
        smaller
    }

    /// The next step size after a step whose stages did not show what the rates do from `size` on.
    pub fn cut(&mut self, size: f64) -> f64 {
        self.rejected = true;
        size
    }

    /// Forgets what the steps before a switch said of those after it.
    pub fn restart(&mut self) {
        self.accepted = None;
    }

    /// Tells of a step that failed though the step before gave no reason to expect it.
    pub fn surprise(&mut self) {
        self.rejected = true;
        self.surprised = true;
    }

    /// Whether the next step should have more stages (1), fewer (-1) or as many: the contraction of Newton's method
    /// tells whether a higher order is worth its larger systems.
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

    /// Starts the memory anew after a change of order.
    pub fn order_changed(&mut self) {
        self.since_change = 0;
        self.accepted = None;
    }
}
