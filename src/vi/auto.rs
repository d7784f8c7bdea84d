//! The choice of a solver by size, and the other one where the first fails. Pivoting costs `m^2` a pivot and takes
//! about `m` of them, Newton `m^3 / 3` a step and takes five, or where the solution is degenerate a hundred. Up to the
//! size where a tableau leaves the cache, pivoting is as fast or faster and never worse by much.

use super::{AffineVi, Lemke, Outcome, Report, SemismoothNewton, ViSolver};

/// Up to this many variables, pivoting comes first.
const LEMKE_AT_MOST: usize = 500;

/// Names a solver, as `vi_solver` does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SolverKind {
    /// Chosen by size; the other one is tried where the first fails.
    #[default]
    Auto,
    /// [`Lemke`].
    Lemke,
    /// [`SemismoothNewton`].
    SemismoothNewton,
}

impl SolverKind {
    /// Every kind, in the order in which they are offered.
    pub const ALL: [Self; 3] = [Self::Auto, Self::Lemke, Self::SemismoothNewton];

    /// The kind of this name, if there is one.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Lemke => "lemke",
            Self::SemismoothNewton => "semismooth_newton",
        }
    }

    /// A solver of this kind for up to `m` variables.
    pub fn build(self, m: usize) -> Box<dyn ViSolver> {
        match self {
            Self::Auto => Box::new(Auto::new(m)),
            Self::Lemke => Box::new(Lemke::new(m)),
            Self::SemismoothNewton => Box::new(SemismoothNewton::new(m)),
        }
    }
}

/// Both solvers, and which of them answered last.
#[derive(Debug)]
pub struct Auto {
    lemke: Option<Lemke>,
    newton: Option<SemismoothNewton>,
    size: usize,
    start: Vec<f64>,
    last: SolverKind,
}

impl Auto {
    /// A solver for problems of up to `m` variables. The second choice is built when it is first needed.
    pub fn new(m: usize) -> Self {
        let mut auto = Self { lemke: None, newton: None, size: m, start: vec![0.0; m], last: SolverKind::Auto };
        match first_choice(m) {
            SolverKind::Lemke => auto.lemke = Some(Lemke::new(m)),
            _ => auto.newton = Some(SemismoothNewton::new(m)),
        }
        auto
    }

    fn run(&mut self, kind: SolverKind, vi: &AffineVi<'_>, z: &mut [f64]) -> Report {
        self.last = kind;
        match kind {
            SolverKind::Lemke => self.lemke.get_or_insert_with(|| Lemke::new(self.size)).solve(vi, z),
            _ => self.newton.get_or_insert_with(|| SemismoothNewton::new(self.size)).solve(vi, z),
        }
    }
}

fn first_choice(m: usize) -> SolverKind {
    if m <= LEMKE_AT_MOST { SolverKind::Lemke } else { SolverKind::SemismoothNewton }
}

impl ViSolver for Auto {
    /// The name of the solver that answered last; `auto` before the first problem.
    fn name(&self) -> &'static str {
        self.last.name()
    }

    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64]) -> Report {
        let m = vi.q.len();
        self.start.resize(m, 0.0);
        self.start.copy_from_slice(z);
        let choice = first_choice(m);
        let first = self.run(choice, vi, z);
        if first.outcome == Outcome::Solved || first.residual.is_nan() {
            return first;
        }
        let other = if choice == SolverKind::Lemke { SolverKind::SemismoothNewton } else { SolverKind::Lemke };
        let mut candidate = std::mem::take(&mut self.start);
        let second = self.run(other, vi, &mut candidate);
        let iterations = first.iterations + second.iterations;
        // A ray says more than a limit: it may prove that there is no solution.
        let prefer_second = second.outcome == Outcome::Solved
            || second.outcome == Outcome::Ray
            || (first.outcome != Outcome::Ray && second.residual < first.residual);
        let report = if prefer_second {
            z.copy_from_slice(&candidate);
            second
        } else {
            self.last = choice;
            first
        };
        self.start = candidate;
        Report { iterations, ..report }
    }
}
