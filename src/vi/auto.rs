//! Choice of a solver of variational inequalities by set and size, and of the next solver if the first fails.
//!
//! Over intervals, with `m` variables, pivoting costs `m^2` operations a pivot and takes about `m` pivots; Newton's
//! method costs `m^3 / 3` operations a step and takes five steps, or up to a hundred if the solution is degenerate.
//! Up to the size at which a tableau exceeds the cache, pivoting is as fast or faster, and never much slower. A large
//! sparse matrix with the signs of an obstacle problem is solved by the active set method. Over blocks Newton's
//! method comes first, and for many small blocks Gauss-Seidel; the interior-point method, a hundred times slower on
//! small problems, solves those that the other two leave unsolved.

use super::{AffineVi, BlockGaussSeidel, Conic, DenseActiveSet, Lemke, Outcome, Report, SemismoothNewton, ViSolver};
use nalgebra::DMatrix;
use problem::Control;

/// Largest number of variables for which Lemke's method of complementary pivoting is tried first.
const LEMKE_AT_MOST: usize = 500;

/// Largest mean number of nonzeros in a row, as on grids, for which a sparse factorisation costs less than one dense
/// pivot.
const SPARSE: usize = 30;

/// Smallest number of variables, and largest size of their blocks, for which Gauss-Seidel sweeps over the blocks are
/// tried first.
const SWEEPS_FROM: usize = 300;
const SMALL_BLOCK: usize = 4;

/// The kind of a solver of variational inequalities, with the name used in the setting `vi_solver`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SolverKind {
    /// The solver is chosen by the feasible set and the number of variables; others are tried if the first fails.
    #[default]
    Auto,
    /// Complementary pivoting, [`Lemke`].
    Lemke,
    /// The semismooth Newton method, [`SemismoothNewton`].
    SemismoothNewton,
    /// The primal-dual active set method, [`DenseActiveSet`].
    ActiveSet,
    /// The interior-point method for conic programs, [`Conic`].
    Conic,
    /// The projected block Gauss-Seidel method, [`BlockGaussSeidel`].
    BlockGaussSeidel,
}

/// A solver that was tried on the last problem, with its outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attempt {
    /// The solver that was tried.
    pub solver: SolverKind,
    /// The outcome of the attempt.
    pub outcome: Outcome,
}

impl SolverKind {
    /// Every kind of solver, in the order in which they are offered to users.
    pub const ALL: [Self; 6] =
        [Self::Auto, Self::Lemke, Self::SemismoothNewton, Self::ActiveSet, Self::Conic, Self::BlockGaussSeidel];

    /// Returns the kind of solver with this name, if any.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Returns the name of the kind of solver.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Lemke => "lemke",
            Self::SemismoothNewton => "semismooth_newton",
            Self::ActiveSet => "active_set",
            Self::Conic => "conic",
            Self::BlockGaussSeidel => "block_gauss_seidel",
        }
    }

    /// Builds a solver of this kind for up to `m` variables.
    pub fn build(self, m: usize) -> Box<dyn ViSolver> {
        match self {
            Self::Auto => Box::new(Auto::new(m)),
            Self::Lemke => Box::new(Lemke::new(m)),
            Self::SemismoothNewton => Box::new(SemismoothNewton::new(m)),
            Self::ActiveSet => Box::new(DenseActiveSet::new()),
            Self::Conic => Box::new(Conic::new()),
            Self::BlockGaussSeidel => Box::new(BlockGaussSeidel::new()),
        }
    }
}

/// The solver that chooses among the others: those used so far, with the attempts at the last problem.
pub struct Auto {
    size: usize,
    /// The solvers built so far, in the order of their first use.
    solvers: Vec<(SolverKind, Box<dyn ViSolver>)>,
    attempts: Vec<Attempt>,
    start: Vec<f64>,
    candidate: Vec<f64>,
    last: SolverKind,
}

impl Auto {
    /// Creates a solver for problems of up to `m` variables. Each underlying solver is built when it is first needed.
    pub fn new(m: usize) -> Self {
        Self {
            size: m,
            solvers: Vec::new(),
            attempts: Vec::with_capacity(SolverKind::ALL.len()),
            start: vec![0.0; m],
            candidate: vec![0.0; m],
            last: SolverKind::Auto,
        }
    }

    fn run(&mut self, kind: SolverKind, vi: &AffineVi<'_>, warm: bool, control: &Control) -> Report {
        let place = self.solvers.iter().position(|(known, _)| *known == kind).unwrap_or_else(|| {
            self.solvers.push((kind, kind.build(self.size)));
            self.solvers.len() - 1
        });
        if !warm {
            self.candidate.copy_from_slice(&self.start);
        }
        let report = self.solvers[place].1.solve(vi, &mut self.candidate, control);
        self.attempts.push(Attempt { solver: kind, outcome: report.outcome });
        report
    }
}

/// Returns the solvers to try for a problem, in order.
fn order(vi: &AffineVi<'_>) -> &'static [SolverKind] {
    use SolverKind::{ActiveSet, BlockGaussSeidel, Conic, Lemke, SemismoothNewton};
    if !vi.set.has_blocks() {
        return match vi.q.len() <= LEMKE_AT_MOST {
            true => &[Lemke, SemismoothNewton],
            false if is_sparse_z_matrix(vi.matrix) => &[ActiveSet, SemismoothNewton, Lemke],
            false => &[SemismoothNewton, Lemke],
        };
    }
    // For a single block a sweep would solve the whole problem: leave Gauss-Seidel out.
    if vi.set.blocks().iter().any(|block| block.members.len() == vi.q.len()) {
        return &[SemismoothNewton, Conic];
    }
    let small = vi.set.blocks().iter().all(|block| block.members.len() <= SMALL_BLOCK);
    if small && vi.q.len() >= SWEEPS_FROM {
        &[BlockGaussSeidel, SemismoothNewton, Conic]
    } else {
        &[SemismoothNewton, Conic, BlockGaussSeidel]
    }
}

/// Whether a matrix suits the active set method: few nonzeros, positive on the diagonal and nonpositive off it.
fn is_sparse_z_matrix(matrix: &DMatrix<f64>) -> bool {
    let m = matrix.nrows();
    let has_the_signs = (0..m).all(|j| matrix.column(j).iter().enumerate().all(|(i, a)| (i == j) == (*a > 0.0)));
    let entries = matrix.iter().filter(|a| **a != 0.0).count();
    has_the_signs && entries <= SPARSE * m
}

/// Whether the second solver's report is more informative than the first's. A ray of Lemke's method is more
/// informative than an iteration limit: it may prove that no solution exists.
fn says_more(first: &Report, second: &Report) -> bool {
    second.outcome == Outcome::Solved
        || second.outcome == Outcome::Ray
        || (first.outcome != Outcome::Ray && (second.residual < first.residual || first.residual.is_nan()))
}

impl ViSolver for Auto {
    /// Returns the name of the solver whose result was returned last; `auto` before the first problem.
    fn name(&self) -> &'static str {
        self.last.name()
    }

    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64], control: &Control) -> Report {
        self.start.clear();
        self.start.extend_from_slice(z);
        self.candidate.resize(z.len(), 0.0);
        self.attempts.clear();
        let mut best: Option<Report> = None;
        let mut iterations = 0;
        for &kind in order(vi) {
            // The result of Gauss-Seidel sweeps is a good start for Newton's method.
            let warm = self.attempts.last().is_some_and(|last| last.solver == SolverKind::BlockGaussSeidel);
            let report = self.run(kind, vi, warm, control);
            iterations += report.iterations;
            if best.as_ref().is_none_or(|best| says_more(best, &report)) {
                z.copy_from_slice(&self.candidate);
                self.last = kind;
                best = Some(report);
            }
            let is_unsound = report.outcome == Outcome::Breakdown && report.residual.is_nan();
            if is_unsound || matches!(report.outcome, Outcome::Solved | Outcome::Interrupted) {
                break;
            }
        }
        Report { iterations, ..best.unwrap_or(Report::BREAKDOWN) }
    }

    fn attempts(&self) -> &[Attempt] {
        &self.attempts
    }
}
