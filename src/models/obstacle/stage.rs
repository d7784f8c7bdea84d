//! The variational inequality of a stage: with `s = d h` and the explicit part `base` of the stage,
//!
//! ```text
//! U in K,    <S U + q, V - U> >= 0  for all V in K,    S = M + s A,    q = -M base - s f,
//! ```
//!
//! and `(S U + q) / s` is what the obstacles push with.

use super::Semidiscrete;
use factorisation::SparseMatrix;
use problem::Control;
use vi::{ActiveSet, Outcome, Unsuitable};

/// A solver of the inequalities of the stages, with the matrix and the active set of the last.
pub struct Stage {
    /// What the obstacles push with at each node, where the sides do not.
    pub force: Vec<f64>,
    /// Which obstacle holds each node: 1 from below, -1 from above, 0 none.
    pub held: Vec<i8>,
    /// How far an obstacle keeps each node from where it would be without it, its neighbours as they are.
    pub kept: Vec<f64>,
    /// What was done.
    pub work: Work,
    matrix: SparseMatrix,
    shape: Vec<usize>,
    solver: Option<(f64, ActiveSet)>,
    q: Vec<f64>,
}

/// What was done.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// Matrices set up.
    pub matrices: u64,
    /// Inequalities solved.
    pub solves: u64,
    /// Active sets tried.
    pub passes: u64,
}

/// Why an inequality was not solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsolved {
    /// The outside asked to stop.
    Interrupted,
    /// The factors do not fit.
    Memory,
    /// A diagonal entry is not positive.
    Singular,
    /// No active set was found.
    NoSolution,
}

impl Stage {
    /// Room for the stages of a system.
    pub fn new(system: &Semidiscrete) -> Self {
        let n = system.load.len();
        Self {
            force: vec![0.0; n],
            held: vec![0; n],
            kept: vec![0.0; n],
            work: Work::default(),
            matrix: system.mass.clone(),
            shape: system.problem.grid.shape(),
            solver: None,
            q: vec![0.0; n],
        }
    }

    /// Solves from `u`, and leaves the answer there: its natural-map residual, of rows divided by their diagonal, relative
    /// to the largest `|u|`. The system is at the time of the stage; `changed` says that `A` is another than the last time.
    ///
    /// # Errors
    /// Why it was not solved.
    pub fn solve(
        &mut self,
        system: &Semidiscrete,
        (shift, changed): (f64, bool),
        base: &[f64],
        u: &mut [f64],
        control: &Control,
    ) -> Result<f64, Unsolved> {
        if changed || self.solver.as_ref().is_none_or(|(of, _)| *of != shift) {
            self.set_up(system, shift, control)?;
        }
        let Some((_, solver)) = &mut self.solver else { return Err(Unsolved::Singular) };
        for (q, load) in self.q.iter_mut().zip(&system.load) {
            *q = -shift * load;
        }
        add_product(-1.0, &system.mass, base, &mut self.q);
        let report = solver.solve(&self.q, &system.set, u, control);
        self.work.solves += 1;
        self.work.passes += report.iterations as u64;
        match report.outcome {
            Outcome::Solved => {}
            Outcome::Interrupted => return Err(Unsolved::Interrupted),
            _ => return Err(Unsolved::NoSolution),
        }
        self.force.copy_from_slice(&self.q);
        add_product(1.0, &self.matrix, u, &mut self.force);
        let (mut residual, mut largest) = (0.0_f64, f64::MIN_POSITIVE);
        for (i, (force, &u)) in self.force.iter_mut().zip(u.iter()).enumerate() {
            let diagonal = self.matrix.get(i, i).copied().unwrap_or(1.0);
            residual = residual.max((u - system.set.project(i, u - *force / diagonal)).abs());
            largest = largest.max(u.abs());
            *force = if system.is_given[i] { 0.0 } else { *force / shift };
            let (lower, upper) = (u == system.set.lower[i], u == system.set.upper[i]);
            self.held[i] = if *force > 0.0 && lower {
                1
            } else if *force < 0.0 && upper {
                -1
            } else {
                0
            };
            self.kept[i] = if self.held[i] == 0 { 0.0 } else { *force * shift / diagonal };
        }
        Ok(residual / largest)
    }

    /// `error = S^-1 M difference` on the nodes that no obstacle and no side holds, zero elsewhere.
    pub fn damp(&mut self, system: &Semidiscrete, difference: &[f64], error: &mut [f64], control: &Control) -> bool {
        error.fill(0.0);
        add_product(1.0, &system.mass, difference, error);
        self.solver.as_mut().is_some_and(|(_, solver)| solver.solve_inside(error, control))
    }

    fn set_up(&mut self, system: &Semidiscrete, shift: f64, control: &Control) -> Result<(), Unsolved> {
        let (_, values) = self.matrix.parts_mut();
        for ((value, mass), stiffness) in values.iter_mut().zip(system.mass.val()).zip(system.stiffness.val()) {
            *value = mass + shift * stiffness;
        }
        self.work.matrices += 1;
        self.solver = None;
        let solver = ActiveSet::on_grid(&self.matrix, &self.shape, control).map_err(|unsuitable| match unsuitable {
            Unsuitable::Interrupted => Unsolved::Interrupted,
            Unsuitable::Memory => Unsolved::Memory,
            Unsuitable::Shape { .. } | Unsuitable::Diagonal { .. } => Unsolved::Singular,
        })?;
        self.solver = Some((shift, solver));
        Ok(())
    }
}

/// `y += factor A x`
fn add_product(factor: f64, matrix: &SparseMatrix, x: &[f64], y: &mut [f64]) {
    for (j, &x) in x.iter().enumerate() {
        let rows = matrix.symbolic().row_idx_of_col_raw(j);
        for (&i, &value) in rows.iter().zip(matrix.val_of_col(j)) {
            y[i] += factor * x * value;
        }
    }
}
