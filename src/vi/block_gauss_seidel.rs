//! Projected block Gauss-Seidel with over-relaxation, for variational inequalities with many small blocks: block
//! after block,
//!
//! ```text
//! y_B solves the variational inequality over K_B with A_BB and q_B + sum over C != B of A_BC z_C
//! z_B <- P_B((1 - omega) z_B + omega y_B)
//! ```
//!
//! with each local problem solved exactly (Cryer 1971 for intervals; Jourdan, Alart and Jean 1998, *A Gauss-Seidel
//! like algorithm to solve frictional contact problems*, for blocks). The iteration converges linearly for symmetric
//! positive definite `A` and `0 < omega < 2`. For a positive definite `A` that is not symmetric it converges for
//! small `omega` and may diverge for `omega = 1`: the matrix of Radau IIA with three stages multiplies the error by
//! 1.33 a sweep at `omega = 1`, and by 0.32 at 0.86. Therefore `omega` grows while the residual falls, shrinks when
//! it rises, and stays below values that have failed.

use super::residual::Gauge;
use super::semismooth_newton::BlockNewton;
use super::{AffineVi, EXACT, Outcome, Report, TOLERANCE, ViSolver};
use nalgebra::DMatrix;
use problem::{Block, Control, ConvexSet, Shape, Workspace};

/// Largest number of sweeps over all blocks.
const SWEEPS: usize = 4_000;

/// Number of sweeps between two evaluations of the residual.
const STRIDE: usize = 5;

/// Convergence is fast if the sweeps between two evaluations of the residual lower the residual to this fraction.
const FAST: f64 = 0.1;

/// Growth of the relaxation factor `omega` while the residual falls, its largest value, and the factor that lowers
/// both after a rise.
const GROWTH: f64 = 0.02;
const LARGEST: f64 = 1.6;
const SHRINKAGE: f64 = 0.8;

/// Number of sweeps whose progress predicts whether the remaining sweeps suffice.
const WINDOW: usize = 200;

/// The projected block Gauss-Seidel solver. Its workspace grows with the problems.
#[derive(Debug, Default)]
pub struct BlockGaussSeidel {
    gauge: Gauge,
    locals: Vec<Local>,
    work: Workspace,
    z: Vec<f64>,
    w: Vec<f64>,
}

/// The local problem of one block, with its solver.
#[derive(Debug)]
struct Local {
    members: Vec<usize>,
    set: ConvexSet,
    matrix: DMatrix<f64>,
    /// The factor `a` if the matrix of the block, `A_BB`, is the multiple `a I` of the identity.
    isotropic: Option<f64>,
    q: Vec<f64>,
    z: Vec<f64>,
    newton: BlockNewton,
}

impl BlockGaussSeidel {
    /// Creates a solver; its blocks are set by the first problem.
    pub fn new() -> Self {
        Self::default()
    }
}

impl ViSolver for BlockGaussSeidel {
    fn name(&self) -> &'static str {
        "block_gauss_seidel"
    }

    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64], control: &Control) -> Report {
        if !vi.is_sound() {
            return Report::BREAKDOWN;
        }
        if (0..z.len())
            .any(|i| vi.set.block_of(i).is_none() && vi.matrix[(i, i)] <= 0.0 && vi.set.lower[i] < vi.set.upper[i])
        {
            return Report::UNSUITABLE;
        }
        self.load(vi, z);
        let mut best = self.gauge.measure(vi, &self.z);
        z.copy_from_slice(&self.z);
        let (mut omega, mut largest, mut last) = (1.0, LARGEST, f64::INFINITY);
        let (mut least, mut least_before) = (best.relative(), best.relative());
        let mut sweeps = 0;
        let mut converging = true;
        let mut failure = Outcome::Limit;
        // Continue after the tolerance is reached as long as sweeps converge fast.
        while sweeps < SWEEPS && best.componentwise > EXACT && (converging || !best.is_solved()) {
            if control.poll().is_some() {
                failure = Outcome::Interrupted;
                break;
            }
            for _ in 0..STRIDE {
                self.sweep(vi, omega, control);
            }
            sweeps += STRIDE;
            let found = self.gauge.measure(vi, &self.z);
            if found.residual.is_nan() {
                break;
            }
            // Replace the incrementally updated `w`, which accumulates rounding errors.
            self.w.copy_from_slice(&self.gauge.w);
            if found.componentwise >= last {
                largest = SHRINKAGE * omega;
            }
            omega = largest.min(omega + GROWTH);
            last = found.componentwise;
            converging = found.componentwise <= FAST * best.componentwise;
            if found.componentwise < best.componentwise {
                z.copy_from_slice(&self.z);
                best = found;
            }
            least = least.min(found.relative());
            if sweeps.is_multiple_of(WINDOW) {
                let windows_left = ((SWEEPS - sweeps) / WINDOW) as f64;
                if (least / TOLERANCE).ln() > (least_before / least).ln() * windows_left {
                    break;
                }
                least_before = least;
            }
        }
        if best.residual.is_nan() {
            return Report { iterations: sweeps, ..Report::BREAKDOWN };
        }
        best.report(failure, sweeps)
    }
}

impl BlockGaussSeidel {
    fn load(&mut self, vi: &AffineVi<'_>, z: &[f64]) {
        let blocks = vi.set.blocks();
        let alike = |(local, block): (&Local, &Block)| local.members == block.members;
        if self.locals.len() != blocks.len() || !self.locals.iter().zip(blocks).all(alike) {
            self.locals = blocks.iter().map(|block| Local::new(&block.members)).collect();
        }
        for (local, block) in self.locals.iter_mut().zip(blocks) {
            local.load(vi, &block.shape);
        }
        self.z.clear();
        self.z.extend(z.iter().map(|z| if z.is_finite() { *z } else { 0.0 }));
        vi.set.project_all(&mut self.z, &mut self.work);
        self.w.resize(z.len(), 0.0);
        vi.product(&self.z, &mut self.w);
    }

    fn sweep(&mut self, vi: &AffineVi<'_>, omega: f64, control: &Control) {
        for i in (0..self.z.len()).filter(|&i| vi.set.block_of(i).is_none() && vi.set.lower[i] < vi.set.upper[i]) {
            let new = vi.set.project(i, self.z[i] - omega * self.w[i] / vi.matrix[(i, i)]);
            advance(vi, &mut self.z, &mut self.w, i, new);
        }
        for local in &mut self.locals {
            local.solve(&self.z, &self.w, omega, &mut self.work, control);
            for (&i, &new) in local.members.iter().zip(&local.z) {
                advance(vi, &mut self.z, &mut self.w, i, new);
            }
        }
    }
}

/// Sets one component of `z` and updates `w = A z + q`.
fn advance(vi: &AffineVi<'_>, z: &mut [f64], w: &mut [f64], i: usize, new: f64) {
    let change = new - z[i];
    z[i] = new;
    if change != 0.0 {
        let m = w.len();
        for (w, a) in w.iter_mut().zip(&vi.matrix.as_slice()[i * m..][..m]) {
            *w += change * a;
        }
    }
}

impl Local {
    fn new(members: &[usize]) -> Self {
        let k = members.len();
        Self {
            members: members.to_vec(),
            set: ConvexSet::free(0),
            matrix: DMatrix::zeros(k, k),
            isotropic: None,
            q: vec![0.0; k],
            z: vec![0.0; k],
            newton: BlockNewton::default(),
        }
    }

    fn load(&mut self, vi: &AffineVi<'_>, shape: &Shape) {
        let k = self.members.len();
        let known = self.set.blocks().first().map(|block| &block.shape);
        if let (Some(Shape::Ball { .. }), &Shape::Ball { radius }) = (known, shape) {
            self.set.set_radius(0, radius);
        } else if known != Some(shape) {
            self.set = ConvexSet::free(k);
            self.set.bind((0..k).collect(), shape.clone());
        }
        for (j, &column) in self.members.iter().enumerate() {
            for (i, &row) in self.members.iter().enumerate() {
                self.matrix[(i, j)] = vi.matrix[(row, column)];
            }
        }
        let a = self.matrix[(0, 0)];
        let isotropic = |(at, x): (usize, &f64)| *x == if at % k == at / k { a } else { 0.0 };
        self.isotropic = (a > 0.0 && self.matrix.iter().enumerate().all(isotropic)).then_some(a);
    }

    /// Solves the local problem of the block at the current `z` with `w = A z + q`, and writes the relaxed solution
    /// to `self.z`.
    fn solve(&mut self, z: &[f64], w: &[f64], omega: f64, work: &mut Workspace, control: &Control) {
        for (i, &member) in self.members.iter().enumerate() {
            self.z[i] = z[member];
            self.q[i] = w[member];
        }
        for (q, row) in self.q.iter_mut().zip(self.matrix.row_iter()) {
            *q -= row.iter().zip(&self.z).map(|(a, z)| a * z).sum::<f64>();
        }
        if let Some(a) = self.isotropic {
            self.z.iter_mut().zip(&self.q).for_each(|(z, q)| *z = -q / a);
            self.set.project_all(&mut self.z, work);
        } else {
            let vi = AffineVi { matrix: &self.matrix, q: &self.q, set: &self.set };
            self.newton.solve(&vi, &mut self.z, control);
        }
        if omega != 1.0 {
            for (new, &member) in self.z.iter_mut().zip(&self.members) {
                *new = (1.0 - omega) * z[member] + omega * *new;
            }
            self.set.project_all(&mut self.z, work);
        }
    }
}
