//! A portfolio of methods for one nonlinear variational inequality of any size, tried one after the other: for few
//! variables, or over sets that couple them, Josephy-Newton with pivoting or conic programs, which finds solutions
//! where Jacobians are singular; for many variables over intervals, active sets if `F'` is a constant M-matrix, then
//! semismooth Newton and interior points on sparse factors; and if all fail, the same methods from other starts.

use super::auto::SolverKind;
use super::interior_point::InteriorPoint;
use super::scaled::{ScaledVi, Sizes};
use super::sparse_jacobian::evaluated;
use super::{ActiveSet, JosephyNewton, NonlinearVi, Outcome, Report, SparseNewton, SparseVi, Worst};
use factorisation::SparseMatrix;
use faer::sparse::Triplet;
use nalgebra::DMatrix;
use problem::{Control, ConvexSet, Workspace};

/// Largest number of variables for which Lemke's method of pivoting comes first: its tableau fits into the cache.
const PIVOTS_AT_MOST: usize = 300;
/// Largest number of times that a solved problem is rescaled by the terms of `F` at its solution and solved again: at
/// the start the terms, to which residuals are relative, are larger than at a solution.
const ROUNDS: usize = 4;
/// Largest number of variables for which dense matrices are used.
const DENSE_AT_MOST: usize = 1000;
/// Number of starting points tried in addition to the given one (`STARTS`), and the same for many variables
/// (`FEW_STARTS`).
const STARTS: usize = 12;
const FEW_STARTS: usize = 2;

/// The result of the portfolio of methods on a nonlinear variational inequality, without the point `z`.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// The report of the best attempt.
    pub report: Report,
    /// The name of the method of the best attempt.
    pub method: &'static str,
    /// The number of starts tried beside the given one.
    pub starts: usize,
    /// The total number of iterations of all attempts.
    pub iterations: usize,
    /// Whether pivoting on an affine problem ended on a ray.
    pub ray: bool,
}

/// A nonlinear variational inequality with a sparse Jacobian, presented with a dense one.
struct Dense<'a>(&'a mut dyn SparseVi, Vec<f64>);

impl NonlinearVi for Dense<'_> {
    fn set(&self) -> &ConvexSet {
        self.0.set()
    }

    fn evaluate(&mut self, z: &[f64], f: &mut [f64]) {
        self.0.evaluate(z, f);
    }

    fn jacobian(&mut self, z: &[f64], derivative: &mut DMatrix<f64>) {
        self.0.derivatives(z, &mut self.1);
        derivative.fill(0.0);
        for (&at, value) in self.0.pattern().iter().zip(&self.1) {
            derivative[at] += value;
        }
    }
}

/// The methods of the portfolio for nonlinear variational inequalities, built when they are first needed.
pub struct Portfolio {
    m: usize,
    kind: SolverKind,
    dense: Option<JosephyNewton>,
    sparse: Option<SparseNewton>,
    interior: Option<InteriorPoint>,
}

/// A method of the portfolio.
#[derive(Clone, Copy, Debug)]
enum Method {
    JosephyNewton,
    ActiveSet,
    Newton { searches: bool },
    InteriorPoint,
}

impl Method {
    fn name(self) -> &'static str {
        match self {
            Self::JosephyNewton => "josephy_newton",
            Self::ActiveSet => "active_set",
            Self::Newton { .. } => "semismooth_newton",
            Self::InteriorPoint => "interior_point",
        }
    }
}

impl Portfolio {
    /// Creates a portfolio for `m` variables. Affine problems are solved by a solver of `kind`; unless `kind` is
    /// automatic, no other method is tried.
    pub fn new(m: usize, kind: SolverKind) -> Self {
        Self { m, kind, dense: None, sparse: None, interior: None }
    }

    /// Solves the variational inequality from `z` until the natural map relative to the terms of `F` is below
    /// `tolerance`, and leaves the best point in `z`.
    pub fn solve(&mut self, vi: &mut dyn SparseVi, tolerance: f64, z: &mut [f64], control: &Control) -> Found {
        let first = z.to_vec();
        let mut found = self.once(vi, tolerance, z, control);
        let mut best = z.to_vec();
        let starts = if self.m <= PIVOTS_AT_MOST { STARTS } else { FEW_STARTS };
        for number in 1..=starts {
            let is_over = matches!(found.report.outcome, Outcome::Solved | Outcome::Interrupted);
            // An affine problem that ends on a ray does so from every start.
            if is_over || found.ray || control.poll().is_some() {
                break;
            }
            start(number, (&first, largest_of(&first)), vi.set(), z);
            let next = self.once(vi, tolerance, z, control);
            let (tried, iterations) = (number, found.iterations + next.iterations);
            let is_better = next.report.outcome == Outcome::Solved
                || next.report.residual < found.report.residual
                || found.report.residual.is_nan();
            if is_better {
                best.copy_from_slice(z);
                found = next;
            }
            (found.starts, found.iterations) = (tried, iterations);
        }
        z.copy_from_slice(&best);
        found
    }

    /// Solves the variational inequality from one starting point. If the terms of `F` differ widely in size at the
    /// solution, scales rows and variables so that they do not, and continues from the solution in these units.
    pub fn once(&mut self, vi: &mut dyn SparseVi, tolerance: f64, z: &mut [f64], control: &Control) -> Found {
        let mut found = self.as_given(vi, tolerance, z, control);
        for _ in 0..ROUNDS {
            if found.report.outcome != Outcome::Solved || vi.set().has_blocks() {
                break;
            }
            let at = Sizes::at(vi, z);
            let Some(scales) = at.scales(vi.pattern()) else { break };
            let mut scaled = ScaledVi::new(vi, scales);
            let mut point = z.to_vec();
            scaled.scale(&mut point);
            if worst(&mut scaled, &point).relative() <= tolerance {
                break;
            }
            let next = match self.m {
                ..=PIVOTS_AT_MOST => self.as_given(&mut scaled, tolerance, &mut point, control),
                // Near the solution no other method than Newton's is needed.
                _ => {
                    let report = self.newton(&mut scaled, tolerance, &mut point, false, control);
                    Found { report, iterations: report.iterations, ..found }
                }
            };
            found.iterations += next.iterations;
            scaled.unscale(&mut point);
            // Reject a point at which the terms of a row have almost vanished: an `F` that tends to zero at infinity
            // has no solution there.
            if next.report.outcome != Outcome::Solved || !Sizes::at(vi, &point).keep(&at) {
                break;
            }
            z.copy_from_slice(&point);
            found.report = next.report;
        }
        found
    }

    /// Solves the variational inequality from one starting point, without rescaling.
    fn as_given(&mut self, vi: &mut dyn SparseVi, tolerance: f64, z: &mut [f64], control: &Control) -> Found {
        let only_dense = vi.set().has_blocks() || self.kind != SolverKind::Auto;
        let order: &[Method] = match (only_dense, self.m) {
            (true, _) => &[Method::JosephyNewton],
            (false, ..=PIVOTS_AT_MOST) => {
                &[Method::JosephyNewton, Method::Newton { searches: true }, Method::InteriorPoint]
            }
            (false, ..=DENSE_AT_MOST) => &[
                Method::ActiveSet,
                Method::Newton { searches: false },
                Method::InteriorPoint,
                Method::Newton { searches: true },
                Method::JosephyNewton,
            ],
            (false, _) => &[
                Method::ActiveSet,
                Method::Newton { searches: false },
                Method::InteriorPoint,
                Method::Newton { searches: true },
            ],
        };
        let first = z.to_vec();
        let mut best: Option<(Found, Vec<f64>)> = None;
        let (mut iterations, mut ray) = (0, false);
        for &method in order {
            let mut point = first.clone();
            let report = match method {
                Method::JosephyNewton => self.josephy_newton(vi, tolerance, &mut point, &mut ray, control),
                Method::ActiveSet => active_set(vi, tolerance, &mut point, control),
                Method::Newton { searches } => self.newton(vi, tolerance, &mut point, searches, control),
                Method::InteriorPoint => self.interior_point(vi, tolerance, &mut point, control),
            };
            iterations += report.iterations;
            let is_better = best.as_ref().is_none_or(|(best, _)| {
                report.outcome == Outcome::Solved
                    || report.residual < best.report.residual
                    || best.report.residual.is_nan()
            });
            if is_better {
                best = Some((Found { report, method: method.name(), starts: 0, iterations, ray }, point));
            }
            if matches!(report.outcome, Outcome::Solved | Outcome::Interrupted) {
                break;
            }
        }
        let Some((found, point)) = best else {
            return Found { report: Report::UNSUITABLE, method: "none", starts: 0, iterations, ray };
        };
        z.copy_from_slice(&point);
        Found { iterations, ray, ..found }
    }

    fn newton(
        &mut self,
        vi: &mut dyn SparseVi,
        tolerance: f64,
        z: &mut [f64],
        searches: bool,
        control: &Control,
    ) -> Report {
        if self.sparse.is_none() {
            self.sparse = SparseNewton::new(self.m, vi.pattern(), control);
        }
        self.sparse.as_mut().map_or(Report::UNSUITABLE, |sparse| sparse.solve(vi, tolerance, z, searches, control))
    }

    /// Runs the interior-point method, and then Newton's method from its result, which puts active variables exactly
    /// on their bounds.
    fn interior_point(&mut self, vi: &mut dyn SparseVi, tolerance: f64, z: &mut [f64], control: &Control) -> Report {
        if self.interior.is_none() {
            self.interior = InteriorPoint::new(self.m, vi.pattern(), control);
        }
        let Some(interior) = &mut self.interior else { return Report::UNSUITABLE };
        let report = interior.solve(vi, tolerance, z, control);
        let mut ended = z.to_vec();
        let polished = self.newton(vi, tolerance, &mut ended, false, control);
        if polished.residual < report.residual
            && (polished.outcome == Outcome::Solved || report.outcome != Outcome::Solved)
        {
            z.copy_from_slice(&ended);
            return Report { iterations: report.iterations + polished.iterations, ..polished };
        }
        report
    }

    /// Runs the Josephy-Newton method, and on intervals further Newton steps as long as these converge fast.
    fn josephy_newton(
        &mut self,
        vi: &mut dyn SparseVi,
        tolerance: f64,
        z: &mut [f64],
        ray: &mut bool,
        control: &Control,
    ) -> Report {
        vi.set().project_all(z, &mut Workspace::default());
        let entries = vi.pattern().len();
        let dense = self.dense.get_or_insert_with(|| JosephyNewton::new(self.m, self.kind));
        let mut report = Report::BREAKDOWN;
        let mut iterations = 0;
        for _ in 0..ROUNDS {
            let allowed = tolerance * worst(vi, z).terms;
            report = dense.solve(&mut Dense(vi, vec![0.0; entries]), allowed, z, control);
            iterations += report.iterations;
            if report.outcome != Outcome::Solved || worst(vi, z).relative() <= tolerance {
                break;
            }
        }
        let reached = worst(vi, z);
        // The comparison is false also if `F` is not finite.
        let is_near = reached.relative() <= tolerance;
        if report.outcome == Outcome::Solved && !is_near {
            report.outcome = Outcome::Limit;
        }
        report = Report { residual: reached.largest, iterations, ..report };
        *ray |=
            report.outcome != Outcome::Solved && dense.attempts().iter().any(|attempt| attempt.outcome == Outcome::Ray);
        if report.outcome == Outcome::Solved && self.kind == SolverKind::Auto && !vi.set().has_blocks() {
            let mut polished = z.to_vec();
            let newton = self.newton(vi, tolerance, &mut polished, false, control);
            if newton.outcome == Outcome::Solved && newton.residual <= report.residual {
                z.copy_from_slice(&polished);
                report = Report { iterations: report.iterations + newton.iterations, ..newton };
            }
        }
        report
    }
}

/// Runs the active set method if it ends after finitely many steps: `F` is affine with an M-matrix.
fn active_set(vi: &mut dyn SparseVi, tolerance: f64, z: &mut [f64], control: &Control) -> Report {
    let m = z.len();
    if !vi.is_affine() {
        return Report::UNSUITABLE;
    }
    let mut derivatives = vec![0.0; vi.pattern().len()];
    vi.derivatives(z, &mut derivatives);
    let is_positive = |at: &(&(usize, usize), &f64)| (at.0.0 == at.0.1) == (*at.1 > 0.0);
    let mut entries = vi.pattern().iter().zip(&derivatives).filter(|(_, value)| **value != 0.0);
    if !entries.all(|entry| is_positive(&entry)) {
        return Report::UNSUITABLE;
    }
    let triplets: Vec<Triplet<usize, usize, f64>> =
        vi.pattern().iter().zip(&derivatives).map(|(&(i, j), &value)| Triplet::new(i, j, value)).collect();
    let matrix = SparseMatrix::try_new_from_triplets(m, m, &triplets).ok();
    let of_matrix = |matrix: SparseMatrix| match vi.grid() {
        Some(shape) => ActiveSet::on_grid(&matrix, &shape, control).ok(),
        None => ActiveSet::new(&matrix).ok(),
    };
    let Some(mut method) = matrix.and_then(of_matrix) else { return Report::UNSUITABLE };
    let mut q = vec![0.0; m];
    vi.evaluate(&vec![0.0; m], &mut q);
    let report = method.solve(&q, vi.set(), z, control);
    let reached = worst(vi, z);
    let outcome = match report.outcome {
        Outcome::Solved if reached.relative() > tolerance => Outcome::Limit,
        outcome => outcome,
    };
    Report { outcome, residual: reached.largest, ..report }
}

/// Returns the component with the largest relative residual at a point.
fn worst(vi: &mut dyn SparseVi, z: &[f64]) -> Worst {
    let (f, _, terms) = evaluated(vi, z);
    Worst::of(vi.set(), (z, &f), &terms)
}

/// Returns the largest absolute value of an entry, or 1 if all are zero.
fn largest_of(z: &[f64]) -> f64 {
    let largest = z.iter().fold(0.0_f64, |most, z| most.max(z.abs()));
    if largest > 0.0 { largest } else { 1.0 }
}

/// Computes the starting point with the given number, counted from one: its distance from the start `first` grows
/// with the number, in units of `size`, and its components are spread by multiples of the golden ratio.
pub fn start(number: usize, (first, size): (&[f64], f64), set: &ConvexSet, z: &mut [f64]) {
    /// The golden ratio less one.
    const RATIO: f64 = 0.618_033_988_749_894_8;
    // Distances of the starting points 1, 2, 3, .., in units of `size`: 0, 1, 1, 1, 10, 10, 10, 100, ..
    let reach = if number == 1 { 0.0 } else { size * 10.0_f64.powi(((number - 2) / 3) as i32) };
    let free = number > 1 && number.is_multiple_of(2);
    for (i, (z, first)) in z.iter_mut().zip(first).enumerate() {
        let part = ((i + 1) as f64 * RATIO * (number as f64).sqrt()).fract();
        let (lower, upper) = (set.lower[i], set.upper[i]);
        *z = match (lower.is_finite(), upper.is_finite()) {
            (true, true) if number > 1 && upper - lower <= 2.0 * reach => lower + part * (upper - lower),
            (true, false) if number > 1 => lower + part * reach,
            (false, true) if number > 1 => upper - part * reach,
            _ if number == 1 => 0.0,
            _ if free => reach * (2.0 * part - 1.0),
            _ => first + reach * (2.0 * part - 1.0),
        };
    }
    set.project_all(z, &mut Workspace::default());
}
