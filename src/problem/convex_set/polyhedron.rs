//! The polyhedron `{z : A z <= b}`, with rows scaled to unit length.
//!
//! The projection is exact, by a dual active-set method (`active_rows`). Its derivative is the projection onto the null
//! space of the active rows `N`, which have full rank: `P' = I - N^T (N N^T)^-1 N`.

use super::active_rows::ActiveRows;
use super::ball::norm;

/// A nonempty polyhedron `{z : A z <= b}`.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyhedron {
    dimension: usize,
    /// The concatenated rows of `A`, of unit length.
    normals: Vec<f64>,
    /// `b`, scaled as the rows of `A`.
    offsets: Vec<f64>,
}

/// Limit on extensions, by a factor of eight, of the far point used for the support function.
const LEAPS: usize = 40;

impl Polyhedron {
    /// `{z : A z <= b}` from the concatenated rows of `A`, `b.len()` rows of `dimension` entries. Zero rows are
    /// dropped. `None` if the set is empty or an entry is not finite.
    pub fn new(dimension: usize, rows: &[f64], b: &[f64]) -> Option<Self> {
        if rows.len() != dimension * b.len() || rows.iter().chain(b).any(|x| !x.is_finite()) {
            return None;
        }
        let mut polyhedron = Self { dimension, normals: Vec::new(), offsets: Vec::new() };
        for (row, &b) in rows.chunks_exact(dimension.max(1)).zip(b) {
            let length = norm(row);
            if length > 0.0 {
                polyhedron.normals.extend(row.iter().map(|a| a / length));
                polyhedron.offsets.push(b / length);
            } else if b < 0.0 {
                return None;
            }
        }
        let mut point = vec![0.0; dimension];
        ActiveRows::default().project(&polyhedron, 1.0, &vec![0.0; dimension], &mut point).then_some(polyhedron)
    }

    /// The number of rows.
    pub fn rows(&self) -> usize {
        self.offsets.len()
    }

    /// Row `i` of `A`, of unit length.
    pub fn normal(&self, i: usize) -> &[f64] {
        &self.normals[i * self.dimension..][..self.dimension]
    }

    /// Entry `i` of `b`, scaled to row `i` of unit length.
    pub fn offset(&self, i: usize) -> f64 {
        self.offsets[i]
    }

    /// The largest distance of a bounding plane from the origin.
    pub(super) fn reach(&self) -> f64 {
        self.offsets.iter().fold(0.0, |most, b| b.abs().max(most))
    }

    /// The dimension of the space.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Whether `z + s d` stays in the set for all `s >= 0`.
    pub(super) fn recedes(&self, d: &[f64]) -> bool {
        let noise = 1e-12 * norm(d);
        (0..self.rows()).all(|i| dot(self.normal(i), d) <= noise)
    }

    /// The support function `sup <d, z>`. It is infinite if the projection of `d` onto the recession cone is not zero.
    /// Otherwise the projection of a point sufficiently far in direction `d` is a maximiser, which is the case if `d`
    /// is in the cone of the active rows (Mangasarian and Meyer 1979, *Nonlinear perturbation of linear programs*).
    pub(super) fn support(&self, d: &[f64], rows: &mut ActiveRows) -> f64 {
        let length = norm(d);
        if length == 0.0 {
            return 0.0;
        }
        let mut p = vec![0.0; self.dimension];
        rows.project(self, 0.0, d, &mut p);
        if norm(&p) > 1e-9 * length {
            return f64::INFINITY;
        }
        let mut scale = 1.0 / length;
        for _ in 0..LEAPS {
            let far: Vec<f64> = d.iter().map(|d| scale * d).collect();
            rows.project(self, 1.0, &far, &mut p);
            if rows.generate(d) {
                break;
            }
            scale *= 8.0;
        }
        dot(d, &p)
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
