//! The contact law with polygonal friction, as a linear complementarity problem (Stewart and Trinkle 1996; Anitescu
//! and Potra 1997, who show that its matrix is copositive and that Lemke's method solves it):
//!
//! ```text
//! 0 <= c_n     _|_  n^T v+ - w              >= 0
//! 0 <= beta    _|_  lambda 1 + D^T v+       >= 0,    r_t = D beta
//! 0 <= lambda  _|_  mu c_n - 1^T beta       >= 0
//! ```
//!
//! A contact without friction has `c_n` alone. Each contact is scaled by its own unit in the diagonal matrix `D`: the
//! solver gets `D W D` and `D q`, with impulses `D^-1 r`, since `W` has the size of an inverse mass, whereas `mu` and
//! the entries one are pure numbers. The entries of `D` are powers of two, so that scaling is exact.

use super::{Cone, Contacts, Report};
use nalgebra::{DMatrix, Matrix3, Vector3};
use problem::{Control, ConvexSet};
use vi::coulomb::BlockMatrix;
use vi::{AffineVi, Lemke, Outcome, ViSolver};

/// The linear complementarity problem of the contacts and its solver.
#[derive(Debug)]
pub struct Polyhedral {
    solver: Lemke,
    /// The contact and the kind of each unknown of the complementarity problem.
    unknowns: Vec<(usize, Unknown)>,
    /// The diagonal of the scaling matrix `D`, one entry for each contact.
    units: Vec<f64>,
    /// The solution of the last complementarity problem, the starting point of the next.
    z: Vec<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Unknown {
    /// The normal impulse `c_n` or a component of `beta`, with the direction of the impulse.
    Impulse(Vector3<f64>),
    /// The slip speed `lambda` of the contact.
    Slip,
}

impl Default for Polyhedral {
    fn default() -> Self {
        Self { solver: Lemke::new(0), unknowns: Vec::new(), units: Vec::new(), z: Vec::new() }
    }
}

impl Polyhedral {
    /// Solves for the impulses `r` of the contact law with `u = W r + q` and target `w = 0`.
    pub fn solve(
        &mut self,
        contacts: &Contacts<'_>,
        delassus: &BlockMatrix,
        q: &[Vector3<f64>],
        r: &mut [Vector3<f64>],
        report: &mut Report,
        control: &Control,
    ) {
        self.units.clear();
        self.units.extend((0..r.len()).map(|k| unit(delassus.diagonal(k))));
        let last = std::mem::take(&mut self.unknowns);
        for k in 0..r.len() {
            self.unknowns.push((k, Unknown::Impulse(Vector3::x())));
            let corners = match contacts.cone[k] {
                Cone::Polyhedral(corners) => corners,
                Cone::Quadratic => 2,
            };
            if contacts.mu[k] > 0.0 {
                let corners = (0..corners).map(|i| corner(i, corners));
                self.unknowns.extend(corners.map(|corner| (k, Unknown::Impulse(corner))));
                self.unknowns.push((k, Unknown::Slip));
            }
        }
        let m = self.unknowns.len();
        if last != self.unknowns {
            self.z.clear();
            self.z.resize(m, 0.0);
        }
        let matrix = DMatrix::from_fn(m, m, |i, j| self.entry(contacts, delassus, i, j));
        let q: Vec<f64> = self
            .unknowns
            .iter()
            .map(|&(k, unknown)| match unknown {
                Unknown::Impulse(direction) => direction.dot(&q[k]) * self.units[k],
                Unknown::Slip => 0.0,
            })
            .collect();
        let set = ConvexSet::nonnegative(m);
        let solved = self.solver.solve(&AffineVi { matrix: &matrix, q: &q, set: &set }, &mut self.z, control);
        r.fill(Vector3::zeros());
        for (&(k, unknown), z) in self.unknowns.iter().zip(&self.z) {
            if let Unknown::Impulse(direction) = unknown {
                r[k] += direction * (*z * self.units[k]);
            }
        }
        // Include the velocities before the step: if they cancel in `q`, their rounding errors remain.
        let before = contacts.before.iter().zip(&self.units).map(|(u, unit)| u.amax() * unit);
        let terms = q.iter().chain(&self.z).map(|x| x.abs()).chain(before);
        let size = terms.fold(f64::MIN_POSITIVE, f64::max);
        report.solver = self.solver.name();
        report.iterations += solved.iterations as u64;
        report.residual = solved.residual / size;
        report.outcome = match solved.outcome {
            Outcome::Limit if report.residual <= super::UNSOLVED => Outcome::Solved,
            outcome => outcome,
        };
    }

    fn entry(&self, contacts: &Contacts<'_>, delassus: &BlockMatrix, i: usize, j: usize) -> f64 {
        let ((k, row), (l, column)) = (self.unknowns[i], self.unknowns[j]);
        match (row, column) {
            (Unknown::Impulse(row), Unknown::Impulse(column)) => {
                let units = self.units[k] * self.units[l];
                delassus.block(k, l).map_or(0.0, |block| row.dot(&(block * column)) * units)
            }
            (Unknown::Impulse(row), Unknown::Slip) if k == l && row.x == 0.0 => 1.0,
            (Unknown::Slip, Unknown::Impulse(column)) if k == l => {
                if column.x > 0.0 {
                    contacts.mu[k]
                } else {
                    -1.0
                }
            }
            _ => 0.0,
        }
    }
}

/// Returns the largest power of two below `(tr W_kk / 3)^(-1/2)`, the unit of a contact with the diagonal block
/// `W_kk`.
fn unit(diagonal: &Matrix3<f64>) -> f64 {
    let exponent = (-0.5 * (diagonal.trace() / 3.0).log2()).floor();
    if exponent.is_finite() { exponent.exp2() } else { 1.0 }
}

/// Returns corner `i` of a regular polygon; corners on the axes are exact, so that opposite ones cancel.
fn corner(i: usize, corners: usize) -> Vector3<f64> {
    let (quarters, rest) = (4 * i / corners, 4 * i % corners);
    let angle = std::f64::consts::FRAC_PI_2 * rest as f64 / corners as f64;
    let (sine, cosine) = angle.sin_cos();
    let (y, z) = match quarters {
        0 => (cosine, sine),
        1 => (-sine, cosine),
        2 => (-cosine, -sine),
        _ => (sine, -cosine),
    };
    Vector3::new(0.0, y, z)
}
