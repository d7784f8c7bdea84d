//! Gauss-Seidel sweeps in a proximal-point iteration, for contact problems that are too large for a factorisation.
//!
//! If contacts outnumber degrees of freedom, sweeps of Coulomb's law stall: the slip speed in the law makes it
//! non-monotone. A proximal term,
//!
//! ```text
//! u = W r + q + c D^-2 (r - r_0)  with Coulomb's law,    D_k = (tr W_kk / 3)^(-1/2)
//! ```
//!
//! (Rockafellar 1976, *Monotone operators and the proximal point algorithm*) restores their linear convergence. The
//! solution with the proximal term satisfies the law up to relative velocities of `c |r - r_0| / D^2`. The centre
//! `r_0` is the result of sweeps of the law itself, and then the solution with the last centre, as long as that
//! lowers the residual. The outcome refers to the law with the proximal term, and the evidence to Coulomb's law
//! itself.

use super::anderson::Anderson;
use super::cone::FrictionCone;
use super::evidence::Row;
use super::factored::{Factored, Twist};
use super::local::Diagonal;
use super::portfolio::{Attempt, Method, SWEEPS_AT_ONCE};
use super::scaling::{Residual, residual, unit};
use super::{Evidence, Limits, Report};
use crate::Outcome;
use nalgebra::{Matrix3, Vector3};
use problem::Control;

/// The weight `c`: the proximal term of a contact weighs as much as the mean of its own block of `W`. Some 30 sweeps
/// then suffice, whatever the number of contacts; smaller weights take more sweeps and hardly change the residual of
/// the law.
const PROXIMAL: f64 = 1.0;

/// Each outer iteration must lower the residual of Coulomb's law to this fraction; otherwise it is the last.
const OUTER_DECREASE: f64 = 0.5;

/// A solution of Coulomb's law with the proximal term.
#[derive(Clone, Debug, PartialEq)]
pub struct ProximalReport {
    /// The report, with the residuals of Coulomb's law without the proximal term.
    pub report: Report,
    /// The relative residual of the law with the proximal term, to which the outcome refers; relative as
    /// [`Evidence::relative`].
    pub solved: f64,
}

/// The solver by proximal sweeps. Its workspace grows to the size of the largest problem and is reused.
#[derive(Debug, Default)]
pub struct ProximalSweeps {
    /// The scales `D_k` of the contacts, and the scaled data of the problem.
    d: Vec<f64>,
    factors: Factored,
    q: Vec<Vector3<f64>>,
    mu: Vec<f64>,
    /// The diagonal blocks of `W` with the proximal term added.
    diagonal: Vec<Diagonal>,
    /// The weight `c` of the proximal term, and the impulses `r_0` at its centre.
    weight: f64,
    centre: Vec<Vector3<f64>>,
    /// The best impulses so far, the current ones, and those from which the next sweep starts.
    best: Vec<Vector3<f64>>,
    work: Vec<Vector3<f64>>,
    next: Vec<Vector3<f64>>,
    twists: Vec<Twist>,
    acceleration: Anderson,
    attempts: Vec<Attempt>,
}

impl ProximalSweeps {
    /// Solves from the impulses `r`, and writes the result to `r`. Polls `control` throughout.
    ///
    /// # Panics
    /// Panics if `q`, `mu` and `r` do not have one entry for each contact.
    pub fn solve(
        &mut self,
        factors: &Factored,
        q: &[Vector3<f64>],
        mu: &[f64],
        r: &mut [Vector3<f64>],
        limits: &Limits,
        control: &Control,
    ) -> ProximalReport {
        let n = factors.len();
        assert_eq!([q.len(), mu.len(), r.len()], [n; 3], "one entry for each contact");
        if !r.iter().flatten().all(|x| x.is_finite()) {
            r.fill(Vector3::zeros());
        }
        self.fit(factors, q, mu);
        self.best.clear();
        self.best.extend(r.iter().zip(&self.d).map(|(r, d)| r / *d));
        self.attempts.clear();
        let is_over = |residual: &Residual| residual.strict <= limits.tolerance || control.poll().is_some();
        let (tolerance, mut left) = (limits.tolerance, limits.accelerated);
        self.regularise(0.0);
        let mut of_law = self.sweep(limits.sweeps.min(left), tolerance, control);
        let mut solved = of_law;
        while !is_over(&of_law) {
            left = left.saturating_sub(self.attempts.last().map_or(0, |attempt| attempt.iterations));
            let before = of_law;
            self.regularise(PROXIMAL);
            solved = self.sweep(limits.iterations, tolerance, control);
            self.weight = 0.0;
            of_law = self.residual();
            if left == 0 || of_law.relative > OUTER_DECREASE * before.relative {
                break;
            }
        }
        for ((r, best), d) in r.iter_mut().zip(&self.best).zip(&self.d) {
            *r = best * *d;
        }
        let velocities = factors.product(r);
        let row = |k: usize| Row::of_point(mu[k], q[k], r[k], velocities[k] + q[k]);
        let evidence = Evidence::of_rows((0..n).map(row));
        let outcome = if evidence.relative.is_nan() {
            Outcome::Breakdown
        } else if solved.strict <= limits.tolerance {
            Outcome::Solved
        } else {
            Outcome::Limit
        };
        ProximalReport {
            report: Report { outcome, evidence, attempts: self.attempts.clone() },
            solved: solved.relative,
        }
    }

    /// Copies and scales a contact problem.
    fn fit(&mut self, factors: &Factored, q: &[Vector3<f64>], mu: &[f64]) {
        self.d.clear();
        self.d.extend((0..factors.len()).map(|k| unit(&factors.diagonal(k))));
        self.factors.clone_from(factors);
        self.factors.scale(&self.d);
        self.q.clear();
        self.q.extend(q.iter().zip(&self.d).map(|(q, d)| q * *d));
        self.mu.clear();
        self.mu.extend_from_slice(mu);
    }

    /// Sets the weight of the proximal term, and makes the best impulses its centre.
    fn regularise(&mut self, weight: f64) {
        self.weight = weight;
        self.centre.clone_from(&self.best);
        self.diagonal.clear();
        let shift = Matrix3::from_diagonal_element(weight);
        self.diagonal.extend((0..self.factors.len()).map(|k| Diagonal::new(&(self.factors.diagonal(k) + shift))));
    }

    /// Returns the relative velocity `u_k` of contact `k` with the proximal term, for impulses `r` that give the
    /// bodies the velocities `twists`.
    fn velocity(&self, k: usize, r: &Vector3<f64>, twists: &[Twist]) -> Vector3<f64> {
        self.factors.row_product(k, twists) + self.q[k] + (r - self.centre[k]) * self.weight
    }

    /// Returns the residual of the best impulses so far.
    fn residual(&mut self) -> Residual {
        let best = std::mem::take(&mut self.best);
        let found = self.residual_of(&best);
        self.best = best;
        found
    }

    fn residual_of(&mut self, r: &[Vector3<f64>]) -> Residual {
        let mut twists = std::mem::take(&mut self.twists);
        self.factors.twists(r, &mut twists);
        let contact = |(k, r): (usize, &Vector3<f64>)| {
            (FrictionCone { mu: self.mu[k] }, self.d[k], *r, self.velocity(k, r, &twists), self.q[k])
        };
        let found = residual(r.iter().enumerate().map(contact));
        self.twists = twists;
        found
    }

    /// Makes accelerated sweeps from the best impulses so far; returns the smallest residual that they reach.
    fn sweep(&mut self, most: usize, tolerance: f64, control: &Control) -> Residual {
        let before = self.residual();
        let mut found = before;
        let mut sweeps = 0;
        let (mut next, mut work) = (std::mem::take(&mut self.next), std::mem::take(&mut self.work));
        next.clone_from(&self.best);
        self.acceleration.start(&next);
        while sweeps < most && found.strict > tolerance && control.poll().is_none() {
            for turn in 1..=SWEEPS_AT_ONCE {
                self.sweep_once(&mut next);
                if turn == SWEEPS_AT_ONCE {
                    work.clone_from(&next);
                }
                self.acceleration.advance(&mut next);
            }
            sweeps += SWEEPS_AT_ONCE;
            let reached = self.residual_of(&work);
            if reached.strict < found.strict {
                found = reached;
                self.best.clone_from(&work);
            }
            if reached.strict.is_nan() {
                break;
            }
        }
        (self.next, self.work) = (next, work);
        let (method, before, after) = (Method::GaussSeidel, before.strict, found.strict);
        if sweeps > 0 {
            self.attempts.push(Attempt { method, iterations: sweeps, before, after });
        }
        found
    }

    /// Makes one Gauss-Seidel sweep over all contacts.
    fn sweep_once(&mut self, r: &mut [Vector3<f64>]) {
        let mut twists = std::mem::take(&mut self.twists);
        self.factors.twists(r, &mut twists);
        for (k, (r, diagonal)) in r.iter_mut().zip(&self.diagonal).enumerate() {
            let q = self.velocity(k, r, &twists) - diagonal.times(r);
            if let Some(exact) = diagonal.solve(q, self.mu[k]) {
                let change = exact - *r;
                if change != Vector3::zeros() {
                    self.factors.push(k, &change, &mut twists);
                    *r = exact;
                }
            }
        }
        self.twists = twists;
    }
}
