//! The variational inequality of a stage of TR-BDF2 for the nodal values `U`: with `s = d h`, where `d` is the
//! diagonal coefficient of the method and `h` the step size, and the explicit part `base` of the stage,
//!
//! ```text
//! U in K,    <S U + q, V - U> >= 0  for all V in K,    S = M + s A,    q = -M base - s f,
//! ```
//!
//! and `(S U + q) / s` is the contact force of the obstacles.

use super::Semidiscrete;
use factorisation::SparseMatrix;
use problem::Control;
use vi::{ActiveSet, Outcome, Unsuitable};

/// A solver of the variational inequalities of TR-BDF2 stages, with the matrix and the active set of the last stage.
pub struct Stage {
    /// The contact force on each node in the last stage; zero at nodes with Dirichlet conditions.
    pub force: Vec<f64>,
    /// The contact state of each node in the last stage: 1 on the lower obstacle, -1 on the upper obstacle, 0 free.
    pub held: Vec<i8>,
    /// The displacement of each node that its contact force causes in the last stage, with its neighbours fixed.
    pub kept: Vec<f64>,
    /// The numbers of stage matrices, solves and active sets so far.
    pub work: Work,
    matrix: SparseMatrix,
    shape: Vec<usize>,
    solver: Option<(f64, ActiveSet)>,
    q: Vec<f64>,
}

/// Statistics of the solver of the variational inequalities of stages.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// The number of matrices of stages set up.
    pub matrices: u64,
    /// The number of variational inequalities of stages solved.
    pub solves: u64,
    /// The number of active sets tried, over all stages.
    pub passes: u64,
}

/// Why the variational inequality of a stage was not solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsolved {
    /// The solve of the stage was interrupted through [`Control`].
    Interrupted,
    /// The factors of the stage matrix do not fit into memory.
    Memory,
    /// A diagonal entry of the stage matrix is not positive.
    Singular,
    /// The iteration over active sets found none that solves the variational inequality.
    NoSolution,
}

impl Stage {
    /// Allocates the solver of the variational inequalities of stages for a semidiscrete obstacle problem.
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

    /// Solves the stage inequality from the initial guess `u`, which is replaced by the solution. Returns the
    /// natural-map residual, with rows divided by their diagonal entry, relative to the largest `|u|`. `system` must
    /// be evaluated at the time of the stage; `shift` is `s = d h`, and `changed` states whether `A` has changed
    /// since the last call.
    ///
    /// # Errors
    /// The reason why the inequality was not solved.
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

    /// Sets `error = S^-1 M difference` on free nodes, with the stage matrix `S`, and zero on nodes in contact or
    /// with Dirichlet conditions. Returns whether the solve succeeded.
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

/// Adds the product `factor A x` with a sparse matrix `A` to `y`.
fn add_product(factor: f64, matrix: &SparseMatrix, x: &[f64], y: &mut [f64]) {
    for (j, &x) in x.iter().enumerate() {
        let rows = matrix.symbolic().row_idx_of_col_raw(j);
        for (&i, &value) in rows.iter().zip(matrix.val_of_col(j)) {
            y[i] += factor * x * value;
        }
    }
}
