//! The methods in turn, as the residual bids.
//!
//! 1. One contact: its exact solution.
//! 2. Block Gauss-Seidel, as long as its rate promises the tolerance in few sweeps.
//! 3. Proximal Newton, from the best point so far.
//! 4. Where Newton stalls, ADMM for a while, then Newton from there, and so on with ever longer runs. ADMM keeps its own
//!    state, so that nothing is lost when Newton fails again.
//!
//! No method is trusted to say that it has succeeded: the residual is computed anew from the problem.

use super::admm::Admm;
use super::gauss_seidel;
use super::newton::ProximalNewton;
use super::scaling::Scaling;
use super::{CoulombProblem, Evidence, solve_contact};
use crate::problem::Control;
use crate::vi::Outcome;
use nalgebra::Vector3;

/// Sweeps between looks at the residual.
const SWEEPS_AT_ONCE: usize = 10;

/// ADMM iterations before Newton's second attempt, and the growth of the runs after it.
const FIRST_RUN: usize = 100;
const RUN_GROWTH: f64 = 1.6;

/// Bounds on the work of one solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The relative natural map, scaled and unscaled, that ends the solve. Default 1e-10.
    pub tolerance: f64,
    /// Gauss-Seidel goes on only while it promises the tolerance within this many further sweeps. Default 100.
    pub sweeps: usize,
    /// Factorisations in one attempt of Newton. Default 40.
    pub factorisations: usize,
    /// ADMM iterations in all. Default 30,000; a problem without a solution costs all of them.
    pub iterations: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { tolerance: 1e-10, sweeps: 100, factorisations: 40, iterations: 30_000 }
    }
}

/// A method of the portfolio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The cases of Coulomb's law for one contact.
    Exact,
    /// Block Gauss-Seidel.
    GaussSeidel,
    /// Nonsmooth Newton in a proximal iteration.
    ProximalNewton,
    /// ADMM.
    Admm,
}

impl Method {
    /// The name users see in the diagnostics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::GaussSeidel => "block_gauss_seidel",
            Self::ProximalNewton => "proximal_newton",
            Self::Admm => "admm",
        }
    }
}

/// One method's turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attempt {
    /// What was tried.
    pub method: Method,
    /// Sweeps, Newton steps or ADMM iterations.
    pub iterations: usize,
    /// Relative residual that it found.
    pub before: f64,
    /// Relative residual that it left.
    pub after: f64,
}

/// What a solve did, and how good its answer is.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// `Solved`, `Limit` (a bound or `Control` ended it; the best point is returned) or `Breakdown`.
    pub outcome: Outcome,
    /// How well the answer satisfies Coulomb's law, in the user's units.
    pub evidence: Evidence,
    /// What was tried, in turn; empty where the start was the answer.
    pub attempts: Vec<Attempt>,
}

/// The portfolio. Its workspace grows to the largest problem seen and is kept.
#[derive(Debug, Default)]
pub struct Coulomb {
    /// Bounds on the work.
    pub limits: Limits,
    scaling: Scaling,
    /// Scaled impulses: the best so far, and those of the method at work.
    best: Vec<Vector3<f64>>,
    work: Vec<Vector3<f64>>,
    residual: f64,
    attempts: Vec<Attempt>,
}

impl Coulomb {
    /// A portfolio with these limits.
    pub fn new(limits: Limits) -> Self {
        Self { limits, ..Self::default() }
    }

    /// Solves from the impulses `r`, one for each contact, and leaves the best found there. Polls `control` between
    /// methods and sweeps.
    pub fn solve(&mut self, problem: &CoulombProblem, r: &mut [Vector3<f64>], control: &Control) -> Report {
        self.attempts.clear();
        if !r.iter().flatten().all(|x| x.is_finite()) {
            r.fill(Vector3::zeros());
        }
        if let ([r], [q], [mu]) = (&mut *r, problem.q(), problem.mu()) {
            self.solve_one(problem, r, q, *mu);
        } else if r.len() == problem.contacts() {
            self.scaling.fit(problem);
            self.best.clear();
            self.best.extend(self.scaling.scale(r));
            self.residual = self.scaling.residual(&self.best);
            self.sweep(control);
            self.alternate(control);
            for (r, best) in r.iter_mut().zip(self.scaling.unscale(&self.best)) {
                *r = best;
            }
        }
        let evidence = Evidence::of(problem, r);
        let outcome = if evidence.relative.is_nan() || r.len() != problem.contacts() {
            Outcome::Breakdown
        } else if self.residual <= self.limits.tolerance {
            Outcome::Solved
        } else {
            Outcome::Limit
        };
        Report { outcome, evidence, attempts: self.attempts.clone() }
    }

    fn solve_one(&mut self, problem: &CoulombProblem, r: &mut Vector3<f64>, q: &Vector3<f64>, mu: f64) {
        if let Some(exact) = solve_contact(problem.matrix().diagonal(0), q, mu) {
            *r = exact;
        }
        self.residual = Evidence::of(problem, std::slice::from_ref(r)).relative;
        let attempt = Attempt { method: Method::Exact, iterations: 1, before: f64::NAN, after: self.residual };
        self.attempts.push(attempt);
    }

    fn is_over(&self, control: &Control) -> bool {
        self.residual <= self.limits.tolerance || control.poll().is_some()
    }

    /// Records a turn that ended with `work`, and keeps that if it is the best.
    fn record(&mut self, method: Method, iterations: usize, before: f64, after: f64) {
        self.attempts.push(Attempt { method, iterations, before, after });
        if after < self.residual {
            self.residual = after;
            std::mem::swap(&mut self.best, &mut self.work);
        }
    }

    fn sweep(&mut self, control: &Control) {
        let before = self.residual;
        let mut found = before;
        let mut sweeps = 0;
        self.work.clone_from(&self.best);
        while !self.is_over(control) && found > self.limits.tolerance {
            for _ in 0..SWEEPS_AT_ONCE {
                gauss_seidel::sweep(&self.scaling.problem, &mut self.work, 1.0);
            }
            sweeps += SWEEPS_AT_ONCE;
            let last = std::mem::replace(&mut found, self.scaling.residual(&self.work));
            let digits_to_go = (found / self.limits.tolerance).log10();
            let digits_a_sweep = (last / found).log10() / SWEEPS_AT_ONCE as f64;
            // A NaN does not arrive either.
            let arrives = digits_to_go <= digits_a_sweep * self.limits.sweeps as f64;
            if !arrives {
                break;
            }
        }
        if sweeps > 0 {
            self.record(Method::GaussSeidel, sweeps, before, found);
        }
    }

    /// Newton and ADMM in turn.
    fn alternate(&mut self, control: &Control) {
        if self.is_over(control) {
            return;
        }
        let Some(mut newton) = ProximalNewton::new(&self.scaling) else { return };
        self.work.clone_from(&self.best);
        let mut start = self.residual;
        let mut admm: Option<Admm> = None;
        let mut run = FIRST_RUN as f64;
        loop {
            let Limits { tolerance, factorisations, iterations, .. } = self.limits;
            let (steps, after) = newton.improve(&self.scaling, &mut self.work, start, tolerance, factorisations);
            self.record(Method::ProximalNewton, steps, start, after);
            if admm.is_none() {
                admm = Admm::new(&self.scaling, &self.best);
            }
            let Some(admm) = &mut admm else { return };
            let done = admm.iterations();
            if self.is_over(control) || done >= iterations {
                return;
            }
            let before = self.scaling.residual(admm.impulses());
            start = admm.run(&self.scaling, tolerance, run as usize);
            if start.is_nan() {
                return;
            }
            self.work.clear();
            self.work.extend_from_slice(admm.impulses());
            self.record(Method::Admm, admm.iterations() - done, before, start);
            if self.is_over(control) {
                return;
            }
            self.work.clear();
            self.work.extend_from_slice(admm.impulses());
            run *= RUN_GROWTH;
        }
    }
}
