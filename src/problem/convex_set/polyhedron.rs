//! The polyhedron `{z : A z <= b}`, its rows scaled to unit length.
//!
//! The projection is exact, by a dual active-set method (`active_rows`). With `N` the rows that the method ends on, of
//! full rank, its derivative is the projection onto their null space, `P' = I - N^T (N N^T)^-1 N`.

use super::active_rows::ActiveRows;
use super::ball::norm;

/// `{z : A z <= b}`, not empty.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyhedron {
    dimension: usize,
    /// The rows of `A`, one after the other, each of length one.
    normals: Vec<f64>,
    /// `b`, scaled likewise.
    offsets: Vec<f64>,
}

/// So many times a point far along a direction is taken eight times as far before it is far enough.
const LEAPS: usize = 40;

impl Polyhedron {
    /// `{z : A z <= b}` from the rows of `A` in order, `b.len()` of them with `dimension` entries each. Rows of zeros
    /// say nothing and are left out. `None` if the set is empty or a number is not finite.
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

    /// Entry `i` of `b` where row `i` has unit length.
    pub fn offset(&self, i: usize) -> f64 {
        self.offsets[i]
    }

    /// The largest distance of a row's plane from the origin.
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

    /// `sup <d, z>`. It is infinite if the projection of `d` onto the recession cone is not zero; else the projection
    /// of a point far along `d` is a maximiser, where `d` is in the cone of the active rows (Mangasarian and Meyer 1979,
    /// *Nonlinear perturbation of linear programs*).
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
