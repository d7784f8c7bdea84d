//! Varying coefficients of friction. With the impulses `r(mu)` of the contact law and the resulting state at the end
//! of the step, the coefficients satisfy
//!
//! ```text
//! mu_k = mu_k(t+, q+, v+, |u_t,k+|)
//! ```
//!
//! The equation is solved by a secant iteration that starts from the coefficients at the beginning of the step. Where
//! friction falls steeply with the slip speed, several solutions may exist: iterations without the secant leave an
//! unstable solution for the next one.

use nalgebra::Vector3;

/// Largest number of solves of the contact law for one step with varying coefficients of friction.
const ROUNDS: usize = 60;

/// Tolerance on the error of a coefficient of friction, which has no unit, at which iterations end: the contact law
/// is solved no more accurately.
const SETTLED: f64 = 1e-11;

/// Coefficients of friction down to minus this value are rounding errors of zero.
const ROUNDING: f64 = 1e-12;

/// Returns the coefficient of friction with rounding errors of zero removed; `None` if it is negative or not finite.
pub fn admissible(mu: f64) -> Option<f64> {
    (mu.is_finite() && mu >= -ROUNDING).then_some(mu.max(0.0))
}

/// Secant iteration for the coefficients of friction of one step.
#[derive(Clone, Debug, Default)]
pub struct Coefficients {
    rounds: usize,
    /// The coefficients of friction of the last secant iteration, and their errors: the coefficient at the end
    /// velocities less the assumed one.
    last: Option<(Vec<f64>, Vec<f64>)>,
}

impl Coefficients {
    /// Makes one iteration. The impulses `r` were computed with the coefficients `mu` and lead to a state with the
    /// coefficients `due`. Returns the largest error of `mu` if iterations are over; otherwise returns `None` and
    /// sets `mu` to the next coefficients to try.
    pub fn settle(&mut self, mu: &mut Vec<f64>, due: Vec<f64>, r: &[Vector3<f64>]) -> Option<f64> {
        self.rounds += 1;
        let off: Vec<f64> = due.iter().zip(&*mu).map(|(due, used)| due - used).collect();
        // Coefficients of contacts without an impulse have no effect on the step: leave them out of the error.
        let acting = |&i: &usize| r[i].x > 0.0;
        let farthest = (0..off.len()).filter(acting).map(|i| off[i].abs()).fold(0.0, f64::max);
        if farthest <= SETTLED {
            return Some(0.0);
        }
        if self.rounds == ROUNDS {
            return Some(farthest);
        }
        let next = (0..off.len()).map(|i| {
            let slope = self.last.as_ref().map(|(last, before)| (off[i] - before[i]) / (mu[i] - last[i]));
            let step = slope.filter(|slope| slope.is_finite() && *slope < 0.0).map_or(off[i], |slope| -off[i] / slope);
            (mu[i] + step).max(0.0)
        });
        let next: Vec<f64> = next.collect();
        self.last = Some((std::mem::replace(mu, next), off));
        None
    }
}
