//! Monotone symmetric variational inequalities as conic programs, by the interior-point method Clarabel (Goulart and Chen
//! 2024, *Clarabel: an interior-point solver for conic programs with quadratic objectives*):
//!
//! ```text
//! min 1/2 <z, A z> + <q, z>,    z in K    written as    B z + s = b,  s in {0}, R+ or a second-order cone
//! ```
//!
//! The program is built once for a set; later problems overwrite `A`, `q` and `b` in place. An interior point lies near the
//! face of the answer and not on it, so Newton's method on the natural map starts from it and says how good it is.

use super::{AffineVi, Outcome, Report, SemismoothNewton, ViSolver};
use crate::problem::{ConvexSet, Shape};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, SolverStatus,
    SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT, ZeroConeT},
};

/// Entries of `A` that differ by no more than this fraction of the largest from those across the diagonal are equal.
const SYMMETRIC: f64 = 1e-10;

/// The gap and the feasibility to reach; Newton's method does the rest.
const ACCURACY: f64 = 1e-10;

/// Clarabel, and the problem it is built for.
#[derive(Default)]
pub struct Conic {
    built: Option<Built>,
    newton: Option<SemismoothNewton>,
    start: Vec<f64>,
}

/// A program for one set.
struct Built {
    solver: DefaultSolver<f64>,
    set: ConvexSet,
    /// The upper triangle of `A`, by columns.
    triangle: Vec<f64>,
    b: Vec<f64>,
}

impl Conic {
    /// A solver that builds its program at the first problem.
    pub fn new() -> Self {
        Self::default()
    }
}

impl std::fmt::Debug for Conic {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Conic").field("set", &self.built.as_ref().map(|built| &built.set)).finish()
    }
}

impl ViSolver for Conic {
    fn name(&self) -> &'static str {
        "conic"
    }

    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64]) -> Report {
        if !vi.is_sound() {
            return Report::BREAKDOWN;
        }
        if !is_symmetric(vi) {
            return Report::UNSUITABLE;
        }
        if !self.built.as_mut().is_some_and(|built| built.update(vi)) {
            self.built = Built::new(vi);
        }
        let Some(Built { solver, .. }) = &mut self.built else { return Report::UNSUITABLE };
        solver.solve();
        let iterations = solver.solution.iterations as usize;
        let failure = match solver.solution.status {
            SolverStatus::DualInfeasible | SolverStatus::AlmostDualInfeasible => Outcome::Ray,
            SolverStatus::NumericalError => Outcome::Breakdown,
            _ => Outcome::Limit,
        };
        self.start.clear();
        self.start.extend_from_slice(&solver.solution.x);
        let newton = self.newton.get_or_insert_with(|| SemismoothNewton::new(z.len()));
        let report = newton.solve(vi, &mut self.start);
        z.copy_from_slice(&self.start);
        let outcome = if report.outcome == Outcome::Solved { Outcome::Solved } else { failure };
        Report { outcome, iterations: iterations + report.iterations, ..report }
    }
}

impl Built {
    /// `None` where nothing bounds `z`, or the data are none that Clarabel takes.
    fn new(vi: &AffineVi<'_>) -> Option<Self> {
        let m = vi.q.len();
        let (rows, b, cones) = constraints(vi.set);
        if rows.is_empty() {
            return None;
        }
        let mut triangle = Vec::new();
        write_triangle(vi, &mut triangle);
        let starts = (0..=m).map(|j| j * (j + 1) / 2).collect();
        let places = (0..m).flat_map(|j| 0..=j).collect();
        let p = CscMatrix::new(m, m, starts, places, triangle.clone());
        let (i, (j, value)) = rows.into_iter().unzip::<_, _, Vec<_>, (Vec<_>, Vec<_>)>();
        let a = CscMatrix::new_from_triplets(b.len(), m, i, j, value);
        let settings = DefaultSettings {
            verbose: false,
            max_threads: 1,
            presolve_enable: false,
            input_sparse_dropzeros: false,
            tol_gap_abs: ACCURACY,
            tol_gap_rel: ACCURACY,
            tol_feas: ACCURACY,
            ..DefaultSettings::default()
        };
        let solver = DefaultSolver::new(&p, vi.q, &a, &b, &cones, settings).ok()?;
        Some(Self { solver, set: vi.set.clone(), triangle, b })
    }

    /// Overwrites the data. False if the set has other constraints, so that a new program is needed.
    fn update(&mut self, vi: &AffineVi<'_>) -> bool {
        if !have_one_form(&self.set, vi.set) {
            return false;
        }
        if self.set != *vi.set {
            self.set.clone_from(vi.set);
            self.b = constraints(vi.set).1;
            if self.solver.update_b(&self.b).is_err() {
                return false;
            }
        }
        let before = self.triangle.clone();
        write_triangle(vi, &mut self.triangle);
        (before == self.triangle || self.solver.update_P(&self.triangle).is_ok())
            && self.solver.update_q(&vi.q.to_vec()).is_ok()
    }
}

fn is_symmetric(vi: &AffineVi<'_>) -> bool {
    let noise = SYMMETRIC * vi.matrix.amax();
    let m = vi.q.len();
    (0..m).all(|j| (0..j).all(|i| (vi.matrix[(i, j)] - vi.matrix[(j, i)]).abs() <= noise))
}

fn write_triangle(vi: &AffineVi<'_>, triangle: &mut Vec<f64>) {
    triangle.clear();
    triangle.extend((0..vi.q.len()).flat_map(|j| (0..=j).map(move |i| vi.matrix[(i, j)])));
}

/// Whether two sets differ in the numbers of `b` alone.
fn have_one_form(a: &ConvexSet, b: &ConvexSet) -> bool {
    let kind =
        |set: &ConvexSet, i: usize| (set.lower[i].is_finite(), set.upper[i].is_finite(), set.lower[i] == set.upper[i]);
    a.dimension() == b.dimension()
        && (0..a.dimension()).all(|i| kind(a, i) == kind(b, i))
        && a.blocks().len() == b.blocks().len()
        && a.blocks().iter().zip(b.blocks()).all(|(a, b)| {
            let balls = matches!((&a.shape, &b.shape), (Shape::Ball { .. }, Shape::Ball { .. }));
            a.members == b.members && (balls || a.shape == b.shape)
        })
}

/// The entries of `B` as `(row, (column, value))`, with `b` and the cones of its rows.
#[expect(clippy::type_complexity, reason = "the three parts of one program")]
fn constraints(set: &ConvexSet) -> (Vec<(usize, (usize, f64))>, Vec<f64>, Vec<SupportedConeT<f64>>) {
    let (mut rows, mut b, mut cones) = (Vec::new(), Vec::new(), Vec::new());
    for (i, (&lower, &upper)) in set.lower.iter().zip(&set.upper).enumerate() {
        if lower == upper {
            rows.push((b.len(), (i, 1.0)));
            b.push(upper);
            cones.push(ZeroConeT(1));
            continue;
        }
        for (end, sign) in [(lower, -1.0), (upper, 1.0)] {
            if end.is_finite() {
                rows.push((b.len(), (i, sign)));
                b.push(sign * end);
                cones.push(NonnegativeConeT(1));
            }
        }
    }
    for block in set.blocks() {
        let k = block.members.len();
        let mut inside = |b: &mut Vec<f64>| {
            for &i in &block.members {
                rows.push((b.len(), (i, -1.0)));
                b.push(0.0);
            }
        };
        match &block.shape {
            Shape::Ball { radius } => {
                b.push(*radius);
                inside(&mut b);
                cones.push(SecondOrderConeT(k + 1));
            }
            Shape::SecondOrderCone => {
                inside(&mut b);
                cones.push(SecondOrderConeT(k));
            }
            Shape::Simplex => {
                inside(&mut b);
                rows.extend(block.members.iter().map(|&i| (b.len(), (i, 1.0))));
                b.push(1.0);
                cones.extend([NonnegativeConeT(k), ZeroConeT(1)]);
            }
            Shape::Polyhedron(polyhedron) => {
                for row in 0..polyhedron.rows() {
                    let entries = block.members.iter().zip(polyhedron.normal(row));
                    rows.extend(entries.map(|(&i, &a)| (b.len(), (i, a))));
                    b.push(polyhedron.offset(row));
                }
                cones.push(NonnegativeConeT(polyhedron.rows()));
            }
        }
    }
    (rows, b, cones)
}
