//! Coefficients of friction that vary: with the impulses `r(mu)` of the law and the state that they lead to,
//!
//! ```text
//! mu_k = mu_k(t+, q+, v+, |u_t,k+|)
//! ```
//!
//! is solved by a secant iteration from the coefficients at the beginning. Where friction falls steeply with the speed of
//! the slip there may be several solutions: iterations without the secant lead away from an unstable one, to the next.

use nalgebra::Vector3;

/// Largest number of solutions of the law for one step.
const ROUNDS: usize = 60;

/// Change of a coefficient, which has no unit, at which iterations end: the law is solved no more accurately.
const SETTLED: f64 = 1e-11;

/// Coefficients down to minus this are rounding of zero.
const ROUNDING: f64 = 1e-12;

/// A coefficient of friction that can be: not negative, but for rounding.
pub fn admissible(mu: f64) -> Option<f64> {
    (mu.is_finite() && mu >= -ROUNDING).then_some(mu.max(0.0))
}

/// The iteration for the coefficients of one step.
#[derive(Clone, Debug, Default)]
pub struct Coefficients {
    rounds: usize,
    /// The coefficients of the last round, and by how much they were off.
    last: Option<(Vec<f64>, Vec<f64>)>,
}

impl Coefficients {
    /// Takes the coefficients `due` in the state that the impulses `r` lead to, which those in `mu` gave. Returns by how
    /// much `mu` is off if iterations are over, else sets `mu` to the next ones to try.
    pub fn settle(&mut self, mu: &mut Vec<f64>, due: Vec<f64>, r: &[Vector3<f64>]) -> Option<f64> {
        self.rounds += 1;
        let off: Vec<f64> = due.iter().zip(&*mu).map(|(due, used)| due - used).collect();
        // Coefficients of contacts without an impulse do not act.
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
