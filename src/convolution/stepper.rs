//! Uniform steps for a convolution inequality. In step `n` the values `Z` of `z` at the stages solve one variational
//! inequality,
//!
//! ```text
//! Z_i in K(t_n + c_i h),    <d_i w_i, z~ - Z_i> >= 0,    w = W_0 Z + sum_{k<n} W_{n-k} Z_k + q(t_n + c h)
//! ```
//!
//! where the factors `d_i = b_i / c_i > 0` do not change the solutions, and make the matrix positive definite for a
//! kernel of index at most one with a positive definite matrix.

use super::forcing::Forcing;
use super::history::{History, Part};
use super::kernel::{Kernel, NoWeights};
use super::weights::Weights;
use nalgebra::DMatrix;
use problem::{Control, ConvexSet, Dvi, Side, Workspace};
use radau::Tableau;
use vi::{AffineVi, Outcome, SolverKind, ViSolver};

/// The settings of a run of a problem with memory over a uniform mesh of time.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// The number of stages of the Radau IIA method, from 1 to 9.
    pub stages: usize,
    /// The solver of the variational inequality of a step.
    pub vi_solver: SolverKind,
    /// The residual of the natural map that is accepted if the solver gives up, relative to the terms of the
    /// inequality.
    pub vi_tolerance: f64,
}

/// The reason why a step of a problem with memory failed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// The kernel of the convolution is not finite at some lag.
    #[error("the kernel is not finite at t = {lag:?} after its beginning")]
    Kernel {
        /// The lag, the time since the beginning of the kernel, at which it is not finite.
        lag: f64,
    },
    /// The function `q` of time in the inequality, or a moving bound, is not finite.
    #[error("row {row} is not finite at t = {t:?}")]
    NotFinite {
        /// The index of the variable, or the number of variables plus the index of the moving bound.
        row: usize,
        /// The time at which the function `q` or the moving bound is not finite.
        t: f64,
    },
    /// A lower bound exceeds the upper one, or a radius is negative.
    #[error("the {} of variable {variable} is empty at t = {t:?}: {}", side.emptiness().0, side.emptiness().1)]
    EmptySet {
        /// Index of the variable whose admissible set is empty.
        variable: usize,
        /// The bound or the radius that makes the admissible set of the variable empty.
        side: Side,
        /// The time at which the admissible set of the variable is empty.
        t: f64,
    },
    /// No solution of the variational inequality of the step was found.
    #[error(
        "the variational inequality of the step to t = {t:?} was not solved ({outcome}, residual {residual:e}): it may have \
         no solution, as where a kernel does not oppose its variable"
    )]
    Unsolved {
        /// The time at the end of the step that failed.
        t: f64,
        /// The outcome that the solver of the variational inequality reports.
        outcome: &'static str,
        /// The residual of the natural map of the variational inequality.
        residual: f64,
    },
    /// The caller asked, through [`Control`], to stop in the middle of the run.
    #[error("interrupted at t = {t:?}")]
    Interrupted {
        /// The time that the run had reached when it stopped.
        t: f64,
    },
}

impl StepError {
    /// A stable identifier of the error for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Kernel { .. } | Self::NotFinite { .. } => "not_finite",
            Self::EmptySet { .. } => "empty_set",
            Self::Unsolved { .. } => "vi_unsolved",
            Self::Interrupted { .. } => "interrupted",
        }
    }
}

/// A run of a problem with memory over a uniform mesh.
pub struct Convolution<'p> {
    /// The Runge-Kutta tableau of the steps of the run.
    pub tableau: &'static Tableau,
    forcing: Forcing<'p>,
    history: History,
    /// The matrix `D W_0` of the variational inequality of a step, stage by stage.
    matrix: DMatrix<f64>,
    /// The convolution weight `W_0` without the scaling by `D`, stage by stage.
    first: DMatrix<f64>,
    /// The set `K` of the variables at each stage of a step.
    set: ConvexSet,
    solver: Box<dyn ViSolver>,
    tolerance: f64,
    start: f64,
    /// The constant step size of the run.
    pub h: f64,
    /// The values `Z` of the variables at the stages of the last step, stage by stage.
    pub z: Vec<f64>,
    /// The values `w` of the inequality at the stages of the last step, stage by stage.
    pub w: Vec<f64>,
    /// The integral of `z` up to the beginning of the last step.
    pub integral: Vec<f64>,
    past: Vec<f64>,
    q: Vec<f64>,
    /// The number of pivots and iterations of the solver of variational inequalities so far.
    pub iterations: u64,
    /// The largest residual of the natural map in a step, relative to its terms, and the time at the end of that
    /// step.
    pub residual: (f64, f64),
    lagrange: Vec<f64>,
    increments: Vec<f64>,
    work: Workspace,
}

impl<'p> Convolution<'p> {
    /// Prepares a run of `steps` steps over `[start, end]`; `problem` has no states, and its inequality is the
    /// function `q` of time.
    ///
    /// # Errors
    /// If the kernel is not finite, or on interruption.
    pub fn new(
        problem: &'p mut dyn Dvi,
        kernel: &Kernel,
        settings: &Settings,
        start: f64,
        end: f64,
        steps: usize,
        control: &Control,
    ) -> Result<Self, StepError> {
        let tableau = Tableau::of(settings.stages);
        let (s, m, h) = (settings.stages, problem.structure().variables, (end - start) / steps as f64);
        let mut parts = Vec::with_capacity(kernel.terms.len());
        for term in &kernel.terms {
            let weights = term.function.weights(tableau, h, steps, control).map_err(|error| match error {
                NoWeights::NotFinite(lag) => StepError::Kernel { lag },
                NoWeights::Interrupted => StepError::Interrupted { t: start },
            })?;
            parts.push(Part { weights, matrix: term.matrix.clone() });
        }
        let first = first(s, m, &parts);
        let mut matrix = first.clone();
        for (i, mut row) in matrix.row_iter_mut().enumerate() {
            row *= tableau.d[i / m];
        }
        Ok(Self {
            tableau,
            set: problem.structure().set.power(s),
            forcing: Forcing::new(problem),
            history: History::new(s, m, steps, parts),
            matrix,
            first,
            solver: settings.vi_solver.build(s * m),
            tolerance: settings.vi_tolerance,
            start,
            h,
            z: vec![0.0; s * m],
            w: vec![0.0; s * m],
            integral: vec![0.0; m],
            past: vec![0.0; s * m],
            q: vec![0.0; s * m],
            iterations: 0,
            residual: (0.0, start),
            lagrange: vec![0.0; s],
            increments: vec![0.0; s],
            work: Workspace::default(),
        })
    }

    /// Returns the number of variables `z` of the problem.
    pub fn variables(&self) -> usize {
        self.integral.len()
    }

    /// Returns the number of steps made so far.
    pub fn steps(&self) -> usize {
        self.history.steps()
    }

    /// Returns the time at the end of step number `step`, counted from one; the start for zero.
    pub fn time(&self, step: usize) -> f64 {
        self.start + step as f64 * self.h
    }

    /// Returns the values of a variable at the ends of all steps of the run.
    pub fn ends(&self, variable: usize) -> &[f64] {
        self.history.sequence(self.tableau.stages() - 1, variable)
    }

    /// Returns the name of the solver of the variational inequality of the last step.
    pub fn solver(&self) -> &'static str {
        self.solver.name()
    }

    /// Returns the lower and the upper bound of a variable at a stage of the last step.
    pub fn interval(&self, stage: usize, variable: usize) -> (f64, f64) {
        let place = stage * self.variables() + variable;
        (self.set.lower[place], self.set.upper[place])
    }

    /// Makes the next step, before the end of the run.
    ///
    /// # Errors
    /// If values are not finite, a set is empty, no solution is found, or on interruption.
    pub fn step(&mut self, control: &Control) -> Result<(), StepError> {
        let m = self.variables();
        let steps = self.steps();
        if steps > 0 {
            self.advance_integral();
        }
        self.history.contribution(&mut self.past);
        for i in 0..self.tableau.stages() {
            let t = self.start + (steps as f64 + self.tableau.c[i]) * self.h;
            let q = self.forcing.at(t, i * m, &mut self.set)?;
            for (past, q) in self.past[i * m..].iter_mut().zip(q) {
                *past += q;
            }
        }
        for (place, (q, past)) in self.q.iter_mut().zip(&self.past).enumerate() {
            *q = self.tableau.d[place / m] * past;
        }
        let vi = AffineVi { matrix: &self.matrix, q: &self.q, set: &self.set };
        let report = self.solver.solve(&vi, &mut self.z, control);
        self.iterations += report.iterations as u64;
        let end = self.time(steps + 1);
        let relative = {
            let forcing = self.q.iter().fold(0.0_f64, |most, q| most.max(q.abs()));
            let rows = self.matrix.row_iter().zip(&self.q);
            let terms = rows.map(|(row, q)| q.abs() + row.iter().zip(&self.z).map(|(a, z)| (a * z).abs()).sum::<f64>());
            // The sum of all terms is at least `|q|`: if that is large enough for the residual to be accepted, the
            // other terms are not computed.
            let is_clear = report.residual <= self.tolerance * forcing;
            let size = if is_clear { forcing } else { terms.fold(0.0, f64::max) };
            if report.residual == 0.0 { 0.0 } else { report.residual / size }
        };
        if relative > self.residual.0 || relative.is_nan() {
            self.residual = (relative, end);
        }
        match report.outcome {
            Outcome::Solved => {}
            Outcome::Interrupted => return Err(StepError::Interrupted { t: self.time(steps) }),
            _ if relative <= self.tolerance => {}
            outcome => {
                let (outcome, residual) = (outcome.name(), report.residual);
                return Err(StepError::Unsolved { t: end, outcome, residual });
            }
        }
        self.w.copy_from_slice(&self.past);
        for (column, z) in self.first.column_iter().zip(&self.z) {
            self.w.iter_mut().zip(column.iter()).for_each(|(w, a)| *w += a * z);
        }
        self.history.append(&self.z);
        Ok(())
    }

    fn advance_integral(&mut self) {
        let m = self.variables();
        for (stage, b) in self.z.chunks_exact(m).zip(&self.tableau.b) {
            self.integral.iter_mut().zip(stage).for_each(|(integral, z)| *integral += self.h * b * z);
        }
    }

    /// Writes the variables `z`, their integral and `w` at the fraction `theta` of the last step, by their
    /// collocation polynomials. The variables are projected onto `K`, which moves them no farther from the solution.
    ///
    /// # Errors
    /// If a moving bound is invalid.
    pub fn interpolate(&mut self, theta: f64, set: &mut ConvexSet, out: &mut [f64]) -> Result<(), StepError> {
        let (s, m) = (self.tableau.stages(), self.variables());
        let t = self.start + (self.steps() as f64 - 1.0 + theta) * self.h;
        self.forcing.at(t, 0, set)?;
        self.tableau.stages_at(theta, &mut self.lagrange);
        self.tableau.increments_at(theta, &mut self.increments);
        let (lagrange, increments) = (&self.lagrange, &self.increments);
        let (z, rest) = out.split_at_mut(m);
        let (integral, w) = rest.split_at_mut(m);
        for k in 0..m {
            let at = |values: &[f64]| (0..s).map(|i| lagrange[i] * values[i * m + k]).sum::<f64>();
            (z[k], w[k]) = (at(&self.z), at(&self.w));
            let increment = |i: usize| (0..s).map(|j| self.tableau.a[(i, j)] * self.z[j * m + k]).sum::<f64>();
            integral[k] = self.integral[k] + self.h * (0..s).map(|i| increments[i] * increment(i)).sum::<f64>();
        }
        set.project_all(z, &mut self.work);
        Ok(())
    }
}

/// Assembles the first convolution weight `W_0` of the kernel as a matrix over stages and variables.
fn first(s: usize, m: usize, parts: &[Part]) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(s * m, s * m);
    for Part { weights, matrix: entries } in parts {
        let weight = |weights: &Weights, i, j| weights.sequence(i, j)[0];
        for &(row, column, value) in entries {
            for (i, j) in (0..s * s).map(|place| (place / s, place % s)) {
                matrix[(i * m + row, j * m + column)] += value * weight(weights, i, j);
            }
        }
    }
    matrix
}
