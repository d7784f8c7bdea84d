//! The validated data of one frictional contact problem.

use super::BlockMatrix;
use super::cone::FrictionCone;
use super::patch::{PatchCone, Role};
use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// The data `W`, `q` and `mu` of `n` contacts. `W` may be of any rank, and slightly nonsymmetric.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CoulombProblem {
    matrix: BlockMatrix,
    q: Vec<Vector3<f64>>,
    mu: Vec<f64>,
    /// The roles of the block rows (point contact, or force or torque of a patch); empty if all are point contacts.
    roles: Vec<Role>,
}

/// The reason why data are not a contact problem.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CoulombProblemError {
    /// The lengths of `W`, `q` and `mu` do not agree.
    #[error("{contacts} contacts need {contacts} vectors q and {contacts} coefficients, got {q} and {mu}")]
    Shape {
        /// The number of block rows of `W`.
        contacts: usize,
        /// The length of `q`, in contacts.
        q: usize,
        /// The length of `mu`.
        mu: usize,
    },
    /// A row or column index, or the row pointers, do not fit the shape of `W`.
    #[error("the indices of W do not fit {contacts} contacts")]
    Index {
        /// The number of block rows of `W`.
        contacts: usize,
    },
    /// An entry of `W` or `q` is NaN or infinite.
    #[error("W and q must be finite")]
    NotFinite,
    /// The row of the force of a patch is not followed by that of its torque, or the row of a torque is not preceded
    /// by that of a force.
    #[error("the force of a patch and its torque must be neighbours")]
    Roles,
    /// A coefficient of friction is negative, NaN or infinite.
    #[error("the coefficient of contact {contact} must be a number >= 0, got {value}")]
    Coefficient {
        /// The index of the contact with the inadmissible coefficient.
        contact: usize,
        /// The value of the inadmissible friction coefficient.
        value: f64,
    },
}

impl CoulombProblem {
    /// Checks and stores the data of `n = matrix.len()` contacts.
    pub fn new(matrix: BlockMatrix, q: Vec<Vector3<f64>>, mu: Vec<f64>) -> Result<Self, CoulombProblemError> {
        let problem = Self { matrix, q, mu, roles: Vec::new() };
        problem.check().map(|()| problem)
    }

    /// Replaces the data of the problem, reusing memory; after an error the problem must not be solved.
    pub fn replace(&mut self, matrix: &BlockMatrix, q: &[Vector3<f64>], mu: &[f64]) -> Result<(), CoulombProblemError> {
        self.matrix.clone_from(matrix);
        self.q.clear();
        self.q.extend_from_slice(q);
        self.mu.clear();
        self.mu.extend_from_slice(mu);
        self.roles.clear();
        self.check()
    }

    /// Sets the roles of the block rows.
    ///
    /// # Errors
    /// Fails if the force and the torque of a patch are not in neighbouring rows, or the number of roles is wrong.
    pub fn take_roles(&mut self, roles: &[Role]) -> Result<(), CoulombProblemError> {
        let is_force = |k: usize| matches!(roles.get(k), Some(Role::Force(_)));
        let is_torque = |k: usize| roles.get(k) == Some(&Role::Torque);
        let fits = |(k, role): (usize, &Role)| match role {
            Role::Point => true,
            Role::Force(_) => is_torque(k + 1),
            Role::Torque => k > 0 && is_force(k - 1),
        };
        if !(roles.is_empty() || roles.len() == self.contacts()) || !roles.iter().enumerate().all(fits) {
            return Err(CoulombProblemError::Roles);
        }
        self.roles.clear();
        if roles.iter().any(|role| *role != Role::Point) {
            self.roles.extend_from_slice(roles);
        }
        Ok(())
    }

    /// Returns the role of block row `k`.
    pub(super) fn role(&self, k: usize) -> Role {
        self.roles.get(k).copied().unwrap_or_default()
    }

    /// Whether the problem has a contact patch.
    pub(super) fn has_patches(&self) -> bool {
        !self.roles.is_empty()
    }

    /// Returns the index of the other block row of the patch to which row `k` belongs; `None` for a point contact.
    pub(super) fn partner(&self, k: usize) -> Option<usize> {
        match self.role(k) {
            Role::Point => None,
            Role::Force(_) => Some(k + 1),
            Role::Torque => Some(k - 1),
        }
    }

    /// Calls `of` with each block row and its part of the natural map, for impulses `r` and velocities `u`; the
    /// natural map of a patch is computed once for both of its rows.
    pub(super) fn natural_maps(
        &self,
        r: impl Fn(usize) -> Vector3<f64>,
        u: impl Fn(usize) -> Vector3<f64>,
        mut of: impl FnMut(usize, Vector3<f64>),
    ) {
        for k in 0..self.contacts() {
            let mu = self.mu[k];
            match self.role(k) {
                Role::Point => of(k, FrictionCone { mu }.natural_map(r(k), u(k))),
                Role::Force(reach) => {
                    let [force, torque] = PatchCone { mu, reach }.natural_map(&[r(k), r(k + 1)], &[u(k), u(k + 1)]);
                    of(k, force);
                    of(k + 1, torque);
                }
                Role::Torque => {}
            }
        }
    }

    fn check(&self) -> Result<(), CoulombProblemError> {
        let contacts = self.matrix.len();
        let (q, mu) = (self.q.len(), self.mu.len());
        if q != contacts || mu != contacts {
            return Err(CoulombProblemError::Shape { contacts, q, mu });
        }
        if !self.matrix.is_finite() || !self.q.iter().flatten().all(|x| x.is_finite()) {
            return Err(CoulombProblemError::NotFinite);
        }
        match self.mu.iter().position(|mu| !(mu.is_finite() && *mu >= 0.0)) {
            Some(contact) => Err(CoulombProblemError::Coefficient { contact, value: self.mu[contact] }),
            None => Ok(()),
        }
    }

    /// Reads `W` (`3n x 3n`) from compressed sparse rows, and `q` (`3n`) contact by contact.
    pub fn from_csr(
        offsets: &[usize],
        columns: &[usize],
        values: &[f64],
        q: &[f64],
        mu: Vec<f64>,
    ) -> Result<Self, CoulombProblemError> {
        let contacts = mu.len();
        if q.len() != 3 * contacts {
            return Err(CoulombProblemError::Shape { contacts, q: q.len() / 3, mu: contacts });
        }
        let bad = CoulombProblemError::Index { contacts };
        if offsets.len() != 3 * contacts + 1 || columns.len() != values.len() {
            return Err(bad);
        }
        let mut blocks = Vec::with_capacity(values.len());
        for (i, window) in offsets.windows(2).enumerate() {
            let range = window[0]..window[1];
            let (Some(columns), Some(values)) = (columns.get(range.clone()), values.get(range)) else {
                return Err(bad);
            };
            for (&j, &value) in columns.iter().zip(values) {
                let mut block = Matrix3::zeros();
                block[(i % 3, j % 3)] = value;
                blocks.push((i / 3, j / 3, block));
            }
        }
        let matrix = BlockMatrix::from_blocks(contacts, blocks).ok_or(bad)?;
        Self::new(matrix, q.chunks_exact(3).map(Vector3::from_column_slice).collect(), mu)
    }

    /// Returns the number of contacts.
    pub fn contacts(&self) -> usize {
        self.mu.len()
    }

    /// Returns the Delassus operator `W`.
    pub fn matrix(&self) -> &BlockMatrix {
        &self.matrix
    }

    /// Returns the free velocities `q`: the relative velocities without contact impulses.
    pub fn q(&self) -> &[Vector3<f64>] {
        &self.q
    }

    /// Returns the coefficients of friction, one for each block row.
    pub fn mu(&self) -> &[f64] {
        &self.mu
    }

    /// Returns the relative velocity `u_k = (W r + q)_k` of contact `k`.
    pub fn velocity(&self, k: usize, r: &[Vector3<f64>]) -> Vector3<f64> {
        self.matrix.row_product(k, r) + self.q[k]
    }

    /// Writes the scaled problem `(D W D, D q, mu)` into `target`.
    pub(super) fn scale_into(&self, d: &[f64], target: &mut Self) {
        self.matrix.scale_into(d, &mut target.matrix);
        target.q.clear();
        target.q.extend(self.q.iter().zip(d).map(|(q, d)| q * *d));
        target.mu.clone_from(&self.mu);
        target.roles.clone_from(&self.roles);
    }
}
