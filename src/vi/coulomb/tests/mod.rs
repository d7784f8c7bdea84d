//! Tests of Coulomb's law against independent solutions: closed forms, statics, another solver.

mod closed_forms;
mod factors;
mod local;
mod parts;
mod stacks;

use super::{BlockMatrix, CoulombProblem, Reach};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Dimensions of contact patches, relative to a radius of gyration: of about its size, almost zero, and very
/// different from each other.
pub(super) const REACHES: [Reach; 8] = [
    Reach { drill: 1.0, roll: 1.0 },
    Reach { drill: 0.1, roll: 0.01 },
    Reach { drill: 0.0, roll: 1e-3 },
    Reach { drill: 0.1, roll: 0.0 },
    Reach { drill: 1e-9, roll: 1e-12 },
    Reach { drill: 1e3, roll: 1e-6 },
    Reach { drill: 1e3, roll: 1e3 },
    Reach { drill: 1e6, roll: 1e6 },
];

/// A generator of uniform random numbers in `[-1, 1)` (`SplitMix64`).
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    pub(super) fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.number())
    }

    fn matrix(&mut self) -> Matrix3<f64> {
        Matrix3::from_fn(|_, _| self.number())
    }
}

/// Builds the contact problem of a dense Delassus operator.
fn problem(dense: &DMatrix<f64>, q: Vec<Vector3<f64>>, mu: Vec<f64>) -> CoulombProblem {
    let n = q.len();
    let blocks = (0..n * n).map(|e| (e / n, e % n, dense.fixed_view::<3, 3>(3 * (e / n), 3 * (e % n)).into_owned()));
    let blocks = blocks.filter(|(.., block)| block.amax() > 0.0);
    let matrix = BlockMatrix::from_blocks(n, blocks).expect("indices in range");
    CoulombProblem::new(matrix, q, mu).expect("a well-formed problem")
}
