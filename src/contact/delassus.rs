//! The Delassus operator `W`: the response of contact velocities to contact impulses while the joints hold:
//!
//! ```text
//! v = v_free + Y r,    Y = H J^T,    H = M^-1 - M^-1 A^T (A M^-1 A^T)^+ A M^-1,    W = J Y
//! ```
//!
//! The rows of `A` are those of the joints, the rows of `J` those of the contacts. With redundant joints the
//! pseudo-inverse selects the joint impulses of least norm.

use factorisation::{DenseLu, Pivoted};
use nalgebra::{DMatrix, Matrix3};
use problem::{Constraints, MechanicalStructure};
use vi::coulomb::BlockMatrix;

/// Rank tolerance for `A M^-1 A^T`: pivots below this fraction of the largest pivot belong to redundant joints.
const REDUNDANT: f64 = 1e-11;

/// LU factors of the mass matrix `M`, and the responses to the constraint rows at one state.
pub struct Delassus {
    factors: DenseLu<f64>,
    /// Responses to constraint rows, one column per row: `M^-1 A^T` for the joints, then `H J^T` for the contacts.
    responses: DMatrix<f64>,
    /// The pseudo-inverse `(A M^-1 A^T)^+` of the joints' Delassus matrix.
    joints: DMatrix<f64>,
    /// The number of factorisations of `M` so far.
    pub factorisations: u64,
}

impl Delassus {
    /// Allocates matrices for a mechanical system of the given structure.
    pub fn new(structure: &MechanicalStructure) -> Self {
        Self {
            factors: DenseLu::new(structure.coordinates),
            responses: DMatrix::zeros(structure.coordinates, structure.rows()),
            joints: DMatrix::zeros(structure.joints, structure.joints),
            factorisations: 0,
        }
    }

    /// Factorises the mass matrix `M` of a mechanical system at one state.
    pub fn factorise(&mut self, mass: &DMatrix<f64>) {
        self.factors.entries().copy_from_slice(mass.as_slice());
        self.factors.factorise();
        self.factorisations += 1;
    }

    /// Overwrites the generalised impulse `p` with the velocity change `M^-1 p`; returns false if the result is not
    /// finite.
    pub fn solve(&mut self, p: &mut [f64]) -> bool {
        self.factors.solve(p)
    }

    /// Computes the responses to all joint rows and the pseudo-inverse `(A M^-1 A^T)^+`; returns false if one of them
    /// is not finite.
    pub fn hold_joints(&mut self, constraints: &Constraints) -> bool {
        let j = self.joints.nrows();
        if !(0..j).all(|row| self.respond(constraints, row)) {
            return false;
        }
        if j == 0 {
            return true;
        }
        let gram = constraints.transposed.columns(0, j).transpose() * self.responses.columns(0, j);
        pseudo_inverse(gram).map(|inverse| self.joints = inverse).is_some()
    }

    /// Writes `M^-1 j` for row `j` of the constraint Jacobian into the column of that row in the matrix of responses.
    fn respond(&mut self, constraints: &Constraints, row: usize) -> bool {
        let n = self.responses.nrows();
        let column = &mut self.responses.as_mut_slice()[row * n..(row + 1) * n];
        column.copy_from_slice(constraints.row(row));
        self.factors.solve(column)
    }

    /// Computes the response `H j` to a contact row `j` while the joints hold; returns false if the response is not
    /// finite.
    pub fn update_response(&mut self, constraints: &Constraints, row: usize) -> bool {
        if !self.respond(constraints, row) {
            return false;
        }
        let (n, j) = (self.responses.nrows(), self.joints.nrows());
        if j > 0 {
            let (joints, rest) = self.responses.as_mut_slice().split_at_mut(j * n);
            let column = &mut rest[(row - j) * n..(row - j + 1) * n];
            let violation: Vec<f64> = (0..j).map(|i| dot(constraints.row(i), column)).collect();
            add_joint_response(joints, &self.joints, &violation, column);
        }
        true
    }

    /// Returns the joint impulses that remove the velocity violation `A v + b` of the joints and are the least in the
    /// metric of `M`.
    pub fn joint_impulses(&self, violation: &[f64]) -> Vec<f64> {
        impulses(&self.joints, violation).collect()
    }

    /// Projects the velocities `v` onto the joint constraints, `A v + b = 0`, by joint impulses that are least in the
    /// metric of `M`.
    pub fn obey_joints(&self, violation: &[f64], v: &mut [f64]) {
        if !violation.is_empty() {
            let n = self.responses.nrows();
            add_joint_response(&self.responses.as_slice()[..violation.len() * n], &self.joints, violation, v);
        }
    }

    /// Projects coordinates or velocities `x` that violate constraints by `off`: `x -= M^-1 C^T (C M^-1 C^T)^+ off`,
    /// where `C` consists of the given rows of the constraint Jacobian; returns false if the result is not finite.
    pub fn remove(&mut self, constraints: &Constraints, rows: &[usize], off: &[f64], x: &mut [f64]) -> bool {
        if rows.is_empty() {
            return true;
        }
        if !rows.iter().all(|&row| self.respond(constraints, row)) {
            return false;
        }
        let gram =
            DMatrix::from_fn(rows.len(), rows.len(), |i, j| dot(constraints.row(rows[i]), self.response(rows[j])));
        let Some(inverse) = pseudo_inverse(gram) else { return false };
        for (i, &row) in rows.iter().enumerate() {
            let impulse: f64 = off.iter().enumerate().map(|(k, off)| inverse[(i, k)] * off).sum();
            x.iter_mut().zip(self.response(row)).for_each(|(x, response)| *x -= response * impulse);
        }
        x.iter().all(|x| x.is_finite())
    }

    /// Returns the response `H j` to row `j` of the constraint Jacobian.
    pub fn response(&self, row: usize) -> &[f64] {
        let n = self.responses.nrows();
        &self.responses.as_slice()[row * n..(row + 1) * n]
    }

    /// Returns the Delassus operator `W` of the given contacts in 3 x 3 blocks. For a direction in which a contact
    /// cannot slip, the diagonal entry of `W` is set to that of the contact's normal.
    pub fn blocks(
        &self,
        structure: &MechanicalStructure,
        constraints: &Constraints,
        contacts: &[usize],
    ) -> Option<BlockMatrix> {
        let rows = |k: usize| std::iter::once(structure.normal(k)).chain(structure.tangents(k));
        let mut blocks = Vec::with_capacity(contacts.len() * contacts.len());
        let mut entries = Vec::new();
        for (i, &k) in contacts.iter().enumerate() {
            // Collect the nonzero entries of the contact's rows: a contact involves few of the coordinates.
            entries.clear();
            for (a, row) in rows(k).enumerate() {
                entries.extend((0..).zip(constraints.row(row)).filter(|(_, x)| **x != 0.0).map(|(c, x)| (a, c, *x)));
            }
            for (j, &l) in contacts.iter().enumerate() {
                let mut block = Matrix3::zeros();
                for (b, column) in rows(l).enumerate() {
                    let response = self.response(column);
                    entries.iter().for_each(|&(a, c, x): &(usize, usize, f64)| block[(a, b)] += x * response[c]);
                }
                if i == j {
                    let filler = if block[(0, 0)] > 0.0 { block[(0, 0)] } else { 1.0 };
                    for a in 1 + structure.contacts[k].slips..3 {
                        block[(a, a)] = filler;
                    }
                }
                if i == j || block != Matrix3::zeros() {
                    blocks.push((i, j, block));
                }
            }
        }
        BlockMatrix::from_blocks(contacts.len(), blocks)
    }
}

fn pseudo_inverse(gram: DMatrix<f64>) -> Option<DMatrix<f64>> {
    if !gram.iter().all(|x| x.is_finite()) {
        return None;
    }
    let pivoted = Pivoted::new(gram);
    pivoted.pseudo_inverse(pivoted.rank(REDUNDANT))
}

/// Returns the joint impulses `-(A M^-1 A^T)^+ violation` that remove a velocity violation of the joints.
fn impulses(inverse: &DMatrix<f64>, violation: &[f64]) -> impl Iterator<Item = f64> {
    (0..violation.len()).map(|i| -violation.iter().enumerate().map(|(k, off)| inverse[(i, k)] * off).sum::<f64>())
}

/// Adds `M^-1 A^T` times the joint impulses that remove the velocity violation of the joints to the velocities `v`.
fn add_joint_response(joints: &[f64], inverse: &DMatrix<f64>, violation: &[f64], v: &mut [f64]) {
    for (response, impulse) in joints.chunks_exact(v.len().max(1)).zip(impulses(inverse, violation)) {
        v.iter_mut().zip(response).for_each(|(v, response)| *v += response * impulse);
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
