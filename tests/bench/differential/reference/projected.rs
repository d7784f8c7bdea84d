//! Reference solutions of linear systems over any set by small fixed steps: a Runge-Kutta method if `D` is positive
//! definite, so that `z` is a Lipschitz function of time and states, and implicit Euler otherwise. A projected
//! fixed-point iteration determines `z`. Runs with several step sizes estimate the error of the finest, and their
//! extrapolation is more accurate if the error is smooth in the step size.

use super::Values;
use crate::differential::linear::{Linear, Shape, product};
use nalgebra::{DMatrix, DVector};

const ROUNDS: usize = 20_000;
/// Relative increment of `z` at which the fixed-point iteration has converged.
const FOUND: f64 = 1e-13;

/// Returns the states at `times`; `None` if a factor of the set has no projection in this module, or the iteration
/// does not converge.
pub fn solve(system: &Linear, initial: &[f64], times: &[f64], steps: usize) -> Option<Values> {
    let solver = Solver::new(system)?;
    let [coarse, fine, finest] = [1, 2, 4].map(|factor| solver.run(initial, times, factor * steps));
    let (coarse, fine, mut finest) = (coarse?, fine?, finest?);
    let far = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let mut accuracy = Vec::new();
    for ((coarse, fine), finest) in coarse.iter().zip(&fine).zip(&mut finest) {
        let (first, second) = (far(coarse, fine), far(fine, finest));
        let size = finest.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
        // For a first-order method, the difference of the two finest runs estimates the error; if differences do not
        // decrease, the error is unknown.
        if second > 0.75 * first && second > 1e-9 * size {
            return None;
        }
        accuracy.push(2.0 * second + 1e-9 * size);
        finest.iter_mut().zip(fine).for_each(|(x, before)| *x += if solver.is_explicit { 0.0 } else { *x - before });
    }
    Some(Values { columns: finest, accuracy })
}

struct Solver<'a> {
    system: &'a Linear,
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    d: DMatrix<f64>,
    gamma: f64,
    is_explicit: bool,
}

impl<'a> Solver<'a> {
    fn new(system: &'a Linear) -> Option<Self> {
        if system.set.iter().any(|(shape, _)| matches!(shape, Shape::Polyhedron(..))) {
            return None;
        }
        let (n, m) = (system.states(), system.variables());
        let matrix = |rows: &[Vec<f64>], r: usize, k: usize| DMatrix::from_fn(r, k, |i, j| rows[i][j]);
        let d = matrix(&system.d, m, m);
        let least = if m == 0 { 1.0 } else { (&d + d.transpose()).symmetric_eigenvalues().min() };
        let is_explicit = least > 1e-3 * d.amax();
        let cb = product(&system.c, &system.b);
        if !is_explicit && m > 0 && matrix(&cb, m, m).symmetric_eigenvalues().min() <= 0.0 {
            return None;
        }
        let [a, b, c] = [matrix(&system.a, n, n), matrix(&system.b, n, m), matrix(&system.c, m, n)];
        Some(Self { system, a, b, c, gamma: step_of(&d), d, is_explicit })
    }

    fn run(&self, initial: &[f64], times: &[f64], steps: usize) -> Option<Vec<Vec<f64>>> {
        let end = *times.last()?;
        let mut x = DVector::from_column_slice(initial);
        let mut z = DVector::zeros(self.system.variables());
        let mut columns = vec![Vec::with_capacity(times.len()); initial.len()];
        let (mut t, mut before) = (0.0, 0.0);
        let h = end / steps as f64;
        // Steps end at the output times, so that nothing is interpolated.
        for &time in times {
            let parts = ((time - before) / h).ceil().max(1.0);
            let h = (time - before) / parts;
            if h > 0.0 {
                let implicit = (!self.is_explicit).then(|| self.implicit(h)).flatten();
                for _ in 0..parts as usize {
                    match &implicit {
                        Some(implicit) => implicit.step(self, t, h, &mut x, &mut z)?,
                        None => self.runge_kutta(t, h, &mut x, &mut z)?,
                    }
                    t += h;
                }
                (t, before) = (time, time);
            }
            columns.iter_mut().zip(x.iter()).for_each(|(column, x)| column.push(*x));
        }
        Some(columns)
    }

    fn drive(&self, t: f64) -> DVector<f64> {
        DVector::from_iterator(self.system.states(), self.system.drive.iter().map(|signal| signal.at(t)))
    }

    fn gap(&self, t: f64) -> DVector<f64> {
        DVector::from_iterator(self.system.variables(), self.system.gap.iter().map(|signal| signal.at(t)))
    }

    fn rates(&self, t: f64, x: &DVector<f64>, z: &mut DVector<f64>) -> Option<DVector<f64>> {
        solve_inequality(&self.system.set, (&self.d, self.gamma), &(&self.c * x + self.gap(t)), z)?;
        Some(&self.a * x + &self.b * &*z + self.drive(t))
    }

    fn runge_kutta(&self, t: f64, h: f64, x: &mut DVector<f64>, z: &mut DVector<f64>) -> Option<()> {
        let first = self.rates(t, x, z)?;
        let second = self.rates(t + h / 2.0, &(&*x + &first * (h / 2.0)), z)?;
        let third = self.rates(t + h / 2.0, &(&*x + &second * (h / 2.0)), z)?;
        let fourth = self.rates(t + h, &(&*x + &third * h), z)?;
        *x += (first + (second + third) * 2.0 + fourth) * (h / 6.0);
        x.iter().all(|x| x.is_finite()).then_some(())
    }

    fn implicit(&self, h: f64) -> Option<Implicit> {
        let n = self.system.states();
        let inverse = (DMatrix::identity(n, n) - &self.a * h).try_inverse()?;
        let response = &inverse * &self.b * h;
        let d = &self.d + &self.c * &response;
        Some(Implicit { gamma: step_of(&d), d, inverse, response })
    }
}

/// Implicit Euler with a fixed step size: `x+ = inverse (x + h a) + response z`.
struct Implicit {
    inverse: DMatrix<f64>,
    response: DMatrix<f64>,
    d: DMatrix<f64>,
    gamma: f64,
}

impl Implicit {
    fn step(&self, of: &Solver<'_>, t: f64, h: f64, x: &mut DVector<f64>, z: &mut DVector<f64>) -> Option<()> {
        let free = &self.inverse * (&*x + of.drive(t + h) * h);
        solve_inequality(&of.system.set, (&self.d, self.gamma), &(&of.c * &free + of.gap(t + h)), z)?;
        *x = free + &self.response * &*z;
        x.iter().all(|x| x.is_finite()).then_some(())
    }
}

/// Returns a step size for which the projected fixed-point iteration is a contraction: one over the norm of `D` if
/// `D` is symmetric, and less according to its asymmetry otherwise.
fn step_of(d: &DMatrix<f64>) -> f64 {
    let norm = d.norm();
    let skew = (d - d.transpose()).norm() / 2.0;
    let least = (d + d.transpose()).symmetric_eigenvalues().min() / 2.0;
    if skew <= 1e-12 * norm { 1.0 / norm } else { least / (norm * norm) }
}

/// Solves `z in K`, `<D z + q, z~ - z> >= 0` for all `z~ in K` with a positive definite `D`, starting from the
/// previous `z`.
fn solve_inequality(
    set: &[(Shape, usize)],
    (d, gamma): (&DMatrix<f64>, f64),
    q: &DVector<f64>,
    z: &mut DVector<f64>,
) -> Option<()> {
    if q.is_empty() {
        return Some(());
    }
    for _ in 0..ROUNDS {
        let next = projection(set, &(&*z - (d * &*z + q) * gamma))?;
        let (change, size) = ((&next - &*z).amax(), next.amax());
        *z = next;
        if change <= FOUND * size.max(gamma * q.amax()) {
            return Some(());
        }
    }
    None
}

/// Returns the projection of `z` onto the set `K`.
fn projection(set: &[(Shape, usize)], z: &DVector<f64>) -> Option<DVector<f64>> {
    let mut out = z.clone();
    let mut first = 0;
    for (shape, size) in set {
        let part = &mut out.as_mut_slice()[first..first + size];
        first += size;
        match shape {
            Shape::Free => {}
            Shape::Nonnegative => part.iter_mut().for_each(|z| *z = z.max(0.0)),
            Shape::Box(lower, upper) => part.iter_mut().for_each(|z| *z = z.clamp(*lower, *upper)),
            Shape::Ball(radius) => {
                let norm = part.iter().map(|z| z * z).sum::<f64>().sqrt();
                if norm > *radius {
                    part.iter_mut().for_each(|z| *z *= radius / norm);
                }
            }
            Shape::Cone => {
                let norm = part[1..].iter().map(|z| z * z).sum::<f64>().sqrt();
                if norm <= -part[0] {
                    part.fill(0.0);
                } else if norm > part[0] {
                    let height = 0.5 * (part[0] + norm);
                    part[1..].iter_mut().for_each(|z| *z *= height / norm);
                    part[0] = height;
                }
            }
            Shape::Simplex => {
                let mut sorted = part.to_vec();
                sorted.sort_by(|a, b| b.total_cmp(a));
                let (mut sum, mut shift) = (0.0, 0.0);
                for (k, z) in sorted.iter().enumerate() {
                    sum += z;
                    let candidate = (sum - 1.0) / (k + 1) as f64;
                    if *z > candidate {
                        shift = candidate;
                    }
                }
                part.iter_mut().for_each(|z| *z = (*z - shift).max(0.0));
            }
            Shape::Polyhedron(..) => return None,
        }
    }
    Some(out)
}
