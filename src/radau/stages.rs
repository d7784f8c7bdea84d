//! The stage equations on one face, `diag(M, 0) Z_i = h sum_j a_ij Phi(t_j, y_n + Z_j)`, by simplified Newton
//! iterations on `W = T^-1 Z`, which decouples the equations (Hairer and Wanner 1996, IV.8; the tests on the rate are
//! those of RADAU5).

use super::face::{Activity, Monitor, monitors};
use super::factors::Factors;
use super::newton_control::{NewtonControl, mean_square_root};
use super::points::Points;
use super::settings::RejectionCause;
use super::system::System;
use super::tableau::Tableau;
use factorisation::of_size;
use problem::Face;

/// Stage increments `Z`, their transforms `W = T^-1 Z` and the values `Phi`, each `s` blocks of `n + m`.
#[derive(Clone, Debug)]
pub struct Stages {
    /// Number of unknowns per stage: `n` states and `m` variables.
    pub unknowns: usize,
    /// The stage increments `Z_i = y_i - y_n`.
    pub z: Vec<f64>,
    /// The transformed stage increments `W = T^-1 Z`.
    pub w: Vec<f64>,
    /// Values of `Phi`, the rows of the system on the active face of `K`, at the stages as of the last evaluation.
    pub phi: Vec<f64>,
    right: Vec<f64>,
    /// The product `diag(M, 0) W` of the mass matrix and the transformed increments.
    mw: Vec<f64>,
    y: Vec<f64>,
    /// The rows of the problem at the stages, as last evaluated.
    pub points: Points,
    /// The monitors (event functions) of the active face at every stage, stage by stage, as of the last convergence of
    /// Newton's method.
    pub monitors: Vec<Monitor>,
    at_stage: Vec<Monitor>,
}

/// Outcome of Newton's method on the stages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Newton {
    /// Newton's method converged: its increments are below the tolerance.
    Converged {
        /// Number of Newton iterations until convergence.
        iterations: usize,
        /// Whether a monitor (event function) of the active face is violated at a stage, so that the face ends within
        /// the step.
        violated: bool,
    },
    /// Newton's method would need too many iterations; the step size should be multiplied by this factor, below 1.
    Slow(f64),
    /// Newton's method cannot continue, for this cause.
    Failed(RejectionCause),
}

/// Observed contraction of Newton's method, carried from one step to the next.
#[derive(Clone, Copy, Debug)]
pub struct Contraction {
    /// The last estimate of the convergence rate of Newton's method.
    pub theta: f64,
    /// The quantity `theta / (1 - theta)` of the last step, for the convergence test after the first iteration.
    pub factor: f64,
}

/// The convergence rate assumed if Newton's method converges in one iteration, so that no rate is observed; also the
/// rate up to which a Jacobian is kept for the next step.
pub const THETA: f64 = 1e-3;

impl Default for Contraction {
    fn default() -> Self {
        Self { theta: 1.0, factor: 1.0 }
    }
}

impl Stages {
    /// Allocates the stage equations for at most `s` stages of `unknowns` unknowns.
    pub fn new(s: usize, unknowns: usize) -> Self {
        let zeros = vec![0.0; s * unknowns];
        Self {
            unknowns,
            z: zeros.clone(),
            w: zeros.clone(),
            phi: zeros.clone(),
            right: zeros.clone(),
            mw: zeros,
            y: vec![0.0; unknowns],
            points: Points::default(),
            monitors: Vec::new(),
            at_stage: Vec::new(),
        }
    }

    /// Returns the unknowns `y` at stage `i` of the present step.
    pub fn stage(&mut self, y0: &[f64], i: usize) -> &[f64] {
        let z = &self.z[i * self.unknowns..];
        for ((y, y0), z) in self.y.iter_mut().zip(y0).zip(z) {
            *y = y0 + z;
        }
        &self.y
    }

    /// Evaluates `Phi`, the rows of the system on the active face of `K`, at every stage; returns false if a number is
    /// not finite.
    pub fn evaluate(&mut self, system: &mut System<'_>, tableau: &Tableau, t: f64, h: f64, y0: &[f64]) -> bool {
        let n = self.unknowns;
        if system.unknowns == system.states && tableau.stages() > 1 {
            return self.points.evaluate_rates(system, &tableau.c, (t, h), y0, &self.z, &mut self.phi);
        }
        self.points.evaluate(system, &tableau.c, (t, h), y0, &self.z);
        let stages = self.phi.chunks_exact_mut(n).take(tableau.stages()).enumerate();
        stages.fold(true, |finite, (i, phi)| finite & system.take_phi(&self.points, i, phi))
    }

    /// Sets the transformed increments `W = T^-1 Z` of the stages from the increments `Z`.
    pub fn transform(&mut self, tableau: &Tableau) {
        combine(tableau.t_inverse.as_slice(), &self.z, &mut self.w, self.unknowns);
    }

    /// Replaces the increments `Z` by the collocation polynomial at `ratio` times the nodes: starting values for
    /// another step size.
    pub fn resample(&mut self, tableau: &Tableau, ratio: f64) {
        let n = self.unknowns;
        let s = tableau.stages();
        let mut basis = vec![0.0; s];
        self.right.fill(0.0);
        for (c, out) in tableau.c.iter().zip(self.right.chunks_exact_mut(n)) {
            tableau.increments_at(ratio * c, &mut basis);
            for (factor, z) in basis.iter().zip(self.z.chunks_exact(n)) {
                for (out, z) in out.iter_mut().zip(z) {
                    *out += factor * z;
                }
            }
        }
        self.z[..s * n].copy_from_slice(&self.right[..s * n]);
        self.transform(tableau);
    }

    /// Solves the transformed linear equations of one Newton iteration: given `Phi` at the stages, adds the increment
    /// to `W` and `Z` and returns its weighted norm, or `None` for a singular matrix.
    pub fn increment(
        &mut self,
        system: &System<'_>,
        tableau: &Tableau,
        factors: &mut Factors,
        h: f64,
        weight: &[f64],
    ) -> Option<f64> {
        of_size!(self.unknowns, |n| self.increment_of(n, system, tableau, factors, h, weight))
    }

    #[inline(always)]
    fn increment_of(
        &mut self,
        n: usize,
        system: &System<'_>,
        tableau: &Tableau,
        factors: &mut Factors,
        h: f64,
        weight: &[f64],
    ) -> Option<f64> {
        let weight = &weight[..n];
        let s = tableau.stages();
        combine(tableau.t_inverse.as_slice(), &self.phi, &mut self.right, n);
        let mw = if system.is_explicit_ode() {
            &self.w
        } else {
            for i in 0..s {
                system.multiply_by_mass(&self.w[i * n..(i + 1) * n], &mut self.mw[i * n..(i + 1) * n]);
            }
            &self.mw
        };
        let mut block = 0;
        if let Some(gamma) = tableau.gamma {
            let gamma = gamma / h;
            for (right, mw) in self.right[..n].iter_mut().zip(&mw[..n]) {
                *right -= gamma * mw;
            }
            if !factors.solve_real(&mut self.right[..n]) {
                return None;
            }
            block = 1;
        }
        for (k, pair) in tableau.pairs.iter().enumerate() {
            let (p, q) = (block * n, (block + 1) * n);
            let (alpha, beta) = (pair.re / h, pair.im / h);
            // For each pair of complex eigenvalues, the first real block contains the real part of the complex
            // unknown, and the second block minus its imaginary part.
            let (re, im) = self.right[p..q + n].split_at_mut(n);
            for ((re, im), (mw_p, mw_q)) in re.iter_mut().zip(&mut *im).zip(mw[p..q].iter().zip(&mw[q..q + n])) {
                *re = *re - alpha * mw_p - beta * mw_q;
                *im = alpha * mw_q - beta * mw_p - *im;
            }
            if !factors.solve_pair(k, re, im) {
                return None;
            }
            im.iter_mut().for_each(|im| *im = -*im);
            block += 2;
        }
        let mut sum = 0.0;
        for i in 0..s {
            let rows = self.right[i * n..(i + 1) * n].iter().zip(&mut self.w[i * n..(i + 1) * n]);
            for ((dw, w), weight) in rows.zip(weight) {
                *w += dw;
                sum += (dw * weight) * (dw * weight);
            }
        }
        combine(tableau.t.as_slice(), &self.w, &mut self.z, n);
        let terms = || self.right[..s * n].chunks_exact(n).flat_map(|row| row.iter().zip(weight).map(|(dw, w)| dw * w));
        Some(mean_square_root(sum, s * n, terms))
    }

    /// Solves the stage equations by Newton's method on the active face of `K` from the current increments `Z`, with `W
    /// = T^-1 Z`.
    #[expect(clippy::too_many_arguments, reason = "a step is its problem, method, factors, place and tolerance")]
    pub fn newton(
        &mut self,
        system: &mut System<'_>,
        tableau: &Tableau,
        factors: &mut Factors,
        t: f64,
        h: f64,
        y0: &[f64],
        control: &NewtonControl,
        contraction: &mut Contraction,
    ) -> Newton {
        let most = control.most;
        let mut factor = contraction.factor.max(f64::EPSILON).powf(0.8);
        let (mut last_norm, mut last_ratio) = (0.0, 0.0);
        let mut evaluated = false;
        let is_ode = system.is_explicit_ode();
        contraction.theta = THETA;
        for k in 1..=most {
            if !evaluated && !self.evaluate(system, tableau, t, h, y0) {
                return Newton::Failed(RejectionCause::NotFinite);
            }
            evaluated = false;
            system.work.newton += 1;
            let Some(norm) = self.increment(system, tableau, factors, h, &control.weight) else {
                return Newton::Failed(RejectionCause::Singular);
            };
            if !norm.is_finite() {
                return Newton::Failed(RejectionCause::NotFinite);
            }
            // Increments at the rounding level of y neither shrink nor matter.
            let rounding = || norm <= 4.0 * f64::EPSILON * self.size(y0, &control.weight, tableau.stages());
            if k > 1 {
                let ratio = norm / last_norm;
                let theta: f64 = if k == 2 { ratio } else { (ratio * last_ratio).sqrt() };
                if theta < 0.99 {
                    contraction.theta = theta;
                    // Increments of variables or algebraic states change the states, which in turn change the
                    // variables, at alternating rates: the next ratio may be the larger one.
                    let next = match (is_ode || system.constant_jacobian(), k) {
                        (true, _) => theta,
                        (false, 2) => ratio.max(factor),
                        (false, _) => ratio.max(last_ratio),
                    };
                    factor = next / (1.0 - theta);
                } else if k == 2 && !is_ode && !rounding() {
                    // The extrapolated starting values were better in the states than in the variables, so that the
                    // first increments show no rate of convergence.
                    factor = f64::INFINITY;
                } else if !rounding() {
                    contraction.theta = theta;
                    return Newton::Failed(RejectionCause::Diverged);
                }
                last_ratio = ratio;
                let left = (most - 1).saturating_sub(k) as i32;
                let predicted = factor * norm * theta.powi(left) / control.kappa;
                // Judge the predicted number of iterations from the third increment on: extrapolated variables dominate
                // the first increment, which shows no rate of convergence.
                if predicted >= 1.0 && (k > 2 || is_ode) && !rounding() {
                    let q = predicted.clamp(1e-4, 20.0);
                    return Newton::Slow(0.8 * q.powf(-1.0 / (4.0 + f64::from(left))));
                }
            }
            last_norm = norm.max(f64::EPSILON);
            // The first increment alone shows no rate of convergence. The rate of the last step may belong to other
            // derivatives: it is trusted for half of the digits.
            let is_told = k > 1 || norm * norm <= control.kappa || system.constant_jacobian();
            if factor * norm <= control.kappa && is_told || rounding() {
                contraction.factor = factor;
                if k > 1 {
                    system.work.contraction.observe(contraction.theta);
                }
                if system.bounded.is_empty() {
                    return Newton::Converged { iterations: k, violated: false };
                }
                let rounding = rounding();
                match self.verify(system, tableau, t, h, y0, control) {
                    None => return Newton::Failed(RejectionCause::NotFinite),
                    Some(Verdict { degenerate: true, .. }) => return Newton::Failed(RejectionCause::Diverged),
                    Some(Verdict { satisfied, violated, .. }) if satisfied || rounding => {
                        return Newton::Converged { iterations: k, violated };
                    }
                    Some(_) => evaluated = true,
                }
            }
        }
        Newton::Slow(0.5)
    }

    /// Returns the weighted norm of the unknowns `y` over the stages.
    pub fn size(&self, y0: &[f64], weight: &[f64], s: usize) -> f64 {
        let n = self.unknowns;
        let stages = self.z[..s * n].chunks_exact(n);
        let terms = stages.flat_map(|z| y0.iter().zip(z).zip(weight).map(|((y0, z), w)| (y0.abs() + z.abs()) * w));
        mean_square_root(terms.clone().map(|y| y * y).sum(), s * n, || terms)
    }

    /// Evaluates `Phi` at every stage and checks the equations and monitors of the bounded variables; returns `None`
    /// if a number is not finite.
    fn verify(
        &mut self,
        system: &mut System<'_>,
        tableau: &Tableau,
        t: f64,
        h: f64,
        y0: &[f64],
        control: &NewtonControl,
    ) -> Option<Verdict> {
        let n = self.unknowns;
        let mut verdict = Verdict { satisfied: true, violated: false, degenerate: false };
        self.monitors.clear();
        self.points.evaluate(system, &tableau.c, (t, h), y0, &self.z);
        for i in 0..tableau.stages() {
            self.stage(y0, i);
            let phi = &mut self.phi[i * n..(i + 1) * n];
            if !system.take_phi(&self.points, i, phi) {
                return None;
            }
            for &k in &system.intervals {
                let residual = phi[system.states + k].abs();
                verdict.satisfied &= residual == 0.0
                    || system.face.places[k] != Activity::Inactive
                    || residual <= control.noise_of_g(system, k, &self.y);
            }
            for (b, block) in system.set.blocks().iter().enumerate() {
                let noise = control.noise_of_block(system, b, &self.y);
                for (i, &k) in block.members.iter().enumerate() {
                    let least = if system.equations[b].is_of_z[i] { noise.z } else { noise.g };
                    let residual = phi[system.states + k].abs();
                    verdict.satisfied &= residual == 0.0 || residual <= least;
                }
            }
            monitors(system, control, &self.y, &mut self.at_stage);
            let violated = self.at_stage.iter().any(Monitor::is_violated);
            verdict.degenerate |= !violated && has_degenerate_block(system, control, &self.y);
            verdict.violated |= violated;
            self.monitors.extend_from_slice(&self.at_stage);
        }
        Some(verdict)
    }
}

/// Result of the check of the equations and monitors of the bounded variables at the stages.
struct Verdict {
    /// Whether the equations of the active face of `K` hold at the stages to the tolerance of the variational
    /// inequality.
    satisfied: bool,
    /// Whether a monitor of the active face of `K` is violated at a stage.
    violated: bool,
    /// Whether, on a curved face of a cone, values beside the apex satisfy the equations of the face but not the
    /// variational inequality.
    degenerate: bool,
}

/// Largest admissible residual of the natural map of a block, relative to its noise, if the equations of the face of
/// the block hold to within noise.
const MAPPED: f64 = 100.0;

/// Whether a block on a curved face violates its inequality at `y`, the point of the last evaluation of `system`,
/// though its equations and monitors hold to within noise: the equations are homogeneous, and beside the apex every
/// direction satisfies them.
fn has_degenerate_block(system: &mut System<'_>, control: &NewtonControl, y: &[f64]) -> bool {
    (0..system.face.blocks.len()).any(|b| {
        if !matches!(system.face.blocks[b], Face::Boundary(_)) {
            return false;
        }
        let noise = control.noise_of_block(system, b, y);
        system.defect_of_block(b, &y[system.states..], noise.z / noise.g) > MAPPED * noise.z
    })
}

/// Computes `out_i = sum_j matrix_ij x_j` on blocks of length `n`, for every available number of stages; the `s x s`
/// matrix is stored column by column.
pub(super) fn combine(matrix: &[f64], x: &[f64], out: &mut [f64], n: usize) {
    match matrix.len() {
        1 => combine_stages::<1>(matrix, x, out, n),
        4 => combine_stages::<2>(matrix, x, out, n),
        9 => combine_stages::<3>(matrix, x, out, n),
        16 => combine_stages::<4>(matrix, x, out, n),
        25 => combine_stages::<5>(matrix, x, out, n),
        36 => combine_stages::<6>(matrix, x, out, n),
        49 => combine_stages::<7>(matrix, x, out, n),
        64 => combine_stages::<8>(matrix, x, out, n),
        _ => combine_stages::<9>(matrix, x, out, n),
    }
}

/// Computes [`combine`] with the number of stages known to the compiler: small systems spend a quarter of their time
/// in this function.
fn combine_stages<const S: usize>(matrix: &[f64], x: &[f64], out: &mut [f64], n: usize) {
    let columns = matrix.as_chunks::<S>().0.first_chunk::<S>().expect("a square matrix");
    let (x, out) = (&x[..S * n], &mut out[..S * n]);
    for l in 0..n {
        let mut sums = [0.0; S];
        for (j, column) in columns.iter().enumerate() {
            let value = x[j * n + l];
            for (sum, entry) in sums.iter_mut().zip(column) {
                *sum += entry * value;
            }
        }
        for (i, sum) in sums.iter().enumerate() {
            out[i * n + l] = *sum;
        }
    }
}
