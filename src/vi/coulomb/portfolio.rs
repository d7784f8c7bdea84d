//! A portfolio of methods for Coulomb's law, run in turn depending on the residual.
//!
//! 1. One contact: its exact solution.
//! 2. Block Gauss-Seidel with Anderson's acceleration, as long as its rate predicts the tolerance within few sweeps.
//! 3. Proximal Newton, from the best point so far, if contacts are few: its contact states are often those of the
//!    solution.
//! 4. The interior-point method, which finds the contact states, then Newton again if the tolerance is not reached; not
//!    if there are contact patches.
//! 5. If Newton stalls, ADMM for a while, then Newton from its result, and so on with ever longer runs. ADMM keeps its
//!    own state, so that nothing is lost if Newton fails again.
//!
//! If contacts are too many for a factorisation, only sweeps are made, up to their limit; if the operator is known in
//! factored form, [`ProximalSweeps`](super::ProximalSweeps) continue.
//!
//! No method judges its own success: the residual is recomputed from the problem.

use super::admm::Admm;
use super::anderson::Anderson;
use super::gauss_seidel::Sweeps;
use super::interior_point::InteriorPoint;
use super::newton::ProximalNewton;
use super::scaling::{Residual, Scaling};
use super::{CoulombProblem, Evidence, solve_contact};
use crate::Outcome;
use nalgebra::Vector3;
use problem::Control;

/// Number of Gauss-Seidel sweeps between two evaluations of the residual.
pub(super) const SWEEPS_AT_ONCE: usize = 10;

/// Number of ADMM iterations before the second attempt of Newton's method, and the percentage by which each later run
/// of ADMM is longer than the last.
const FIRST_RUN: usize = 100;
const RUN_GROWTH_PERCENT: usize = 60;

/// Limits on the work of one solve of Coulomb's law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The relative natural map, both with each contact in its own unit and in the user's units, at which the solve
    /// ends. Default 1e-10.
    pub tolerance: f64,
    /// Gauss-Seidel continues only while its rate predicts the tolerance within this number of further sweeps, or
    /// within the number that costs as much as one dense factorisation. Default 100.
    pub sweeps: usize,
    /// Largest number of factorisations in one attempt of Newton's method, and from one start of the interior-point
    /// method. Default 40.
    pub factorisations: usize,
    /// Largest total number of ADMM iterations, and of sweeps. Default 30,000; a problem without a solution uses all
    /// of them.
    pub iterations: usize,
    /// Largest number of contacts for which methods that factorise matrices are used. Default unlimited.
    pub factorised: usize,
    /// Largest number of accelerated sweeps for problems with more contacts than can be factorised. Default 300.
    pub accelerated: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            tolerance: 1e-10,
            sweeps: 100,
            factorisations: 40,
            iterations: 30_000,
            factorised: usize::MAX,
            accelerated: 300,
        }
    }
}

/// Largest number of contacts for which Newton's method precedes the interior-point method: it needs fewer
/// factorisations, and for few contacts the contact states at the start are often those of the solution. For many
/// contacts with many solutions the interior-point method finds a central one, from which later solves start well.
const NEWTON_FIRST: usize = 50;

/// A method of the portfolio for Coulomb's law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Exact solution of one contact, by the cases of Coulomb's law.
    Exact,
    /// Block Gauss-Seidel sweeps over the contacts.
    GaussSeidel,
    /// Nonsmooth Newton in a proximal-point iteration.
    ProximalNewton,
    /// A primal-dual interior-point method.
    InteriorPoint,
    /// The alternating direction method of multipliers (ADMM).
    Admm,
}

impl Method {
    /// Returns the name of the method in the diagnostics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::GaussSeidel => "block_gauss_seidel",
            Self::ProximalNewton => "proximal_newton",
            Self::InteriorPoint => "interior_point",
            Self::Admm => "admm",
        }
    }
}

/// One attempt of a method of the portfolio at a contact problem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attempt {
    /// The method of the attempt.
    pub method: Method,
    /// The number of sweeps, Newton steps or ADMM iterations of the attempt.
    pub iterations: usize,
    /// The residual before the attempt: the largest of the relative natural map in the user's units, that with each
    /// contact in its own unit, and the latter relative to velocities alone.
    pub before: f64,
    /// The residual after the attempt, defined as the residual before it.
    pub after: f64,
}

/// The input of an iterative method of the portfolio.
pub(super) struct Task<'a> {
    pub scaling: &'a Scaling,
    pub tolerance: f64,
    pub control: &'a Control,
}

impl Task<'_> {
    /// Whether the residual is below the tolerance, or `control` asks to stop.
    pub fn is_over(&self, residual: f64) -> bool {
        residual <= self.tolerance || self.control.poll().is_some()
    }
}

/// The result of a solve of Coulomb's law, with its accuracy.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// `Solved`, `Limit` (a limit on the work or `Control` ended the solve; the best point is returned) or
    /// `Breakdown`.
    pub outcome: Outcome,
    /// The residuals of Coulomb's law, in the user's units.
    pub evidence: Evidence,
    /// The attempts of the methods, in order; empty if the start was the solution.
    pub attempts: Vec<Attempt>,
}

/// The portfolio for Coulomb's law. Its workspace grows to the size of the largest problem and is reused.
#[derive(Debug, Default)]
pub struct Coulomb {
    /// Limits on the work of one solve.
    pub limits: Limits,
    scaling: Scaling,
    /// Scaled impulses: the best so far (`best`), and those of the current method (`work`).
    best: Vec<Vector3<f64>>,
    work: Vec<Vector3<f64>>,
    sweeps: Sweeps,
    acceleration: Anderson,
    residual: Residual,
    attempts: Vec<Attempt>,
}

impl Coulomb {
    /// Creates a portfolio with the given limits on its work.
    pub fn new(limits: Limits) -> Self {
        Self { limits, ..Self::default() }
    }

    /// Solves from the impulses `r`, and writes the best result to `r`. Polls `control` throughout.
    ///
    /// # Panics
    /// Panics if `r` does not have one impulse for each contact.
    pub fn solve(&mut self, problem: &CoulombProblem, r: &mut [Vector3<f64>], control: &Control) -> Report {
        assert_eq!(r.len(), problem.contacts(), "one impulse for each contact");
        self.attempts.clear();
        if !r.iter().flatten().all(|x| x.is_finite()) {
            r.fill(Vector3::zeros());
        }
        if let ([r], [q], [mu]) = (&mut *r, problem.q(), problem.mu()) {
            self.solve_one(problem, r, q, *mu);
        } else {
            self.scaling.fit(problem);
            self.best.clear();
            self.best.extend(self.scaling.scale(r));
            self.residual = self.scaling.residual(&self.best);
            self.sweep(control);
            if self.best.len() <= self.limits.factorised {
                self.alternate(control);
            }
            for (r, best) in r.iter_mut().zip(self.scaling.unscale(&self.best)) {
                *r = best;
            }
        }
        let evidence = Evidence::of(problem, r);
        let outcome = if evidence.relative.is_nan() {
            Outcome::Breakdown
        } else if self.residual.strict <= self.limits.tolerance {
            Outcome::Solved
        } else {
            Outcome::Limit
        };
        Report { outcome, evidence, attempts: self.attempts.clone() }
    }

    fn solve_one(&mut self, problem: &CoulombProblem, r: &mut Vector3<f64>, q: &Vector3<f64>, mu: f64) {
        let start = *r;
        if let Some(exact) = solve_contact(problem.matrix().diagonal(0), q, mu) {
            *r = exact;
        }
        let relative = |r: &Vector3<f64>| Evidence::of(problem, std::slice::from_ref(r)).relative;
        let (before, after) = (relative(&start), relative(r));
        self.residual = Residual { relative: after, strict: after };
        self.attempts.push(Attempt { method: Method::Exact, iterations: 1, before, after });
    }

    fn is_over(&self, control: &Control) -> bool {
        self.residual.strict <= self.limits.tolerance || control.poll().is_some()
    }

    /// Records an attempt that ended with the impulses `work`, and keeps these if they are the best so far.
    fn record(&mut self, method: Method, iterations: usize, before: Residual, after: Residual) {
        self.attempts.push(Attempt { method, iterations, before: before.strict, after: after.strict });
        if after.strict < self.residual.strict {
            self.residual = after;
            std::mem::swap(&mut self.best, &mut self.work);
        }
    }

    /// Makes sweeps with Anderson's acceleration. If Newton's method is available (the contacts are few enough for a
    /// factorisation), sweeps continue only while their rate of convergence predicts the tolerance within as many
    /// further sweeps as cost one dense factorisation, or within the limit `sweeps`.
    fn sweep(&mut self, control: &Control) {
        if self.is_over(control) {
            return;
        }
        let n = self.best.len();
        let can_factorise = n <= self.limits.factorised;
        let stored = self.scaling.problem.matrix().stored();
        let worth = (n.saturating_pow(3) / stored).min(self.limits.iterations).max(self.limits.sweeps) as f64;
        let most = if can_factorise { self.limits.iterations } else { self.limits.accelerated };
        let before = self.residual;
        let mut sweeps = 0;
        let mut x = self.best.clone();
        self.work.clone_from(&self.best);
        self.sweeps.fit(self.scaling.problem.matrix());
        self.acceleration.start(&x);
        while !self.is_over(control) && sweeps < most {
            for turn in 1..=SWEEPS_AT_ONCE {
                self.sweeps.sweep(&self.scaling.problem, &mut x);
                if turn == SWEEPS_AT_ONCE {
                    self.work.copy_from_slice(&x);
                }
                self.acceleration.advance(&mut x);
            }
            sweeps += SWEEPS_AT_ONCE;
            let found = self.scaling.residual(&self.work);
            if found.strict < self.residual.strict {
                self.residual = found;
                self.best.copy_from_slice(&self.work);
            }
            let digits_to_go = (found.strict / self.limits.tolerance).log10();
            let digits_a_sweep = (before.strict / found.strict).log10() / sweeps as f64;
            let promises = digits_to_go <= digits_a_sweep * worth;
            if found.strict.is_nan() || (can_factorise && !promises) {
                break;
            }
        }
        let (method, before, after) = (Method::GaussSeidel, before.strict, self.residual.strict);
        self.attempts.push(Attempt { method, iterations: sweeps, before, after });
    }

    /// Runs the interior-point method, unless there are contact patches.
    fn pass_through_the_interior(&mut self, control: &Control) {
        // The barrier of the method is that of second-order cones, which the cone of a patch is not.
        if self.scaling.problem.has_patches() {
            return;
        }
        let Some(mut method) = InteriorPoint::new(&self.scaling) else { return };
        let before = self.residual;
        self.work.clone_from(&self.best);
        let task = Task { scaling: &self.scaling, tolerance: self.limits.tolerance, control };
        let (steps, after) = method.improve(&task, &mut self.work, before, self.limits.factorisations);
        self.record(Method::InteriorPoint, steps, before, after);
    }

    /// Runs Newton's method and ADMM in turn, with the interior-point method once: first for many contacts, otherwise
    /// after Newton's first attempt.
    fn alternate(&mut self, control: &Control) {
        if self.is_over(control) {
            return;
        }
        let mut has_passed = self.best.len() > NEWTON_FIRST;
        if has_passed {
            self.pass_through_the_interior(control);
            if self.is_over(control) {
                return;
            }
        }
        let Some(mut newton) = ProximalNewton::new(&self.scaling) else { return };
        self.work.clone_from(&self.best);
        let mut start = self.residual;
        let mut admm: Option<Admm> = None;
        let mut run = FIRST_RUN;
        loop {
            let Limits { tolerance, factorisations, iterations, .. } = self.limits;
            let task = Task { scaling: &self.scaling, tolerance, control };
            let (steps, after) = newton.improve(&task, &mut self.work, start, factorisations);
            self.record(Method::ProximalNewton, steps, start, after);
            if !has_passed && !self.is_over(control) {
                has_passed = true;
                self.pass_through_the_interior(control);
                self.work.clone_from(&self.best);
                start = self.residual;
                continue;
            }
            if admm.is_none() {
                admm = Admm::new(&self.scaling, &self.best);
            }
            let Some(admm) = &mut admm else { return };
            let done = admm.iterations();
            if self.is_over(control) || done >= iterations {
                return;
            }
            let before = self.scaling.residual(admm.impulses());
            let task = Task { scaling: &self.scaling, tolerance, control };
            let Some(reached) = admm.run(&task, run.min(iterations - done)) else { return };
            start = reached;
            self.work.clear();
            self.work.extend_from_slice(admm.impulses());
            self.record(Method::Admm, admm.iterations() - done, before, start);
            if self.is_over(control) {
                return;
            }
            self.work.clear();
            self.work.extend_from_slice(admm.impulses());
            run += run * RUN_GROWTH_PERCENT / 100;
        }
    }
}
