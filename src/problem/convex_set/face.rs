//! The faces of a block as smooth manifolds `c(z) = 0`. With a basis `T` of the tangent space, the variational
//! inequality on a face is the square system
//!
//! ```text
//! c(z) = 0,    T(z)^T G = 0
//! ```
//!
//! Its solution solves the variational inequality as long as all [`Monitor`]s are nonnegative: the distances to the
//! inactive inequalities of the block, and the multipliers of the active ones (`-G` in the normal cone; Rockafellar
//! and Wets 1998, 6.C). Each constraint is solved for one member of the block, its pivot, and takes the equation row
//! of this member; `T` is the basis given by the elimination of the pivots (index `p`):
//!
//! ```text
//! ball       |z| = r                G_i - (z_i/z_p) G_p = 0
//! cone       z_1 = |(z_2, ..)|      G_i + (z_i/z_1) G_1 = 0
//! simplex    sum z = 1, z_j = 0     G_i - G_p = 0
//! rows       N z = b                G_i - N_i^T N_p^-T G_p = 0
//! ```
//!
//! The equations are rational near the apex where a face ends, so that a solution can be continued past the end of
//! the face in order to locate it. On the boundary of the self-dual cone, `z` and `G` may be exchanged:
//!
//! ```text
//! G_1 = |(G_2, ..)|,    z_i + (G_i/G_1) z_1 = 0
//! ```
//!
//! The dual form is equivalent, and better conditioned if `G` is far from zero: when the ray of `z` rotates within a
//! step, the primal form mixes the equations for `z` along the ray with those across it.

use super::ball;
use super::block::Shape;
use super::polyhedron::{Polyhedron, dot};

/// A face of a block of `K`: the part of the block on which the same inequalities are active.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Face {
    /// The interior of the block of `K`, where none of its inequalities is active.
    Interior,
    /// The curved boundary of a ball or a cone without its apex. The number is the index of the pivot component for a
    /// ball; for a cone, 0 for the primal form of the equations (in `z`), 1 for the dual form (in `G`).
    Boundary(usize),
    /// A single point of the block: the apex of a cone, or a ball of radius zero.
    Vertex,
    /// A flat face of the block, given by its active inequalities: the zero members of a simplex, the active rows of a
    /// polyhedron.
    Edge(Vec<usize>),
}

/// An event function of a face of a block (monitor): nonnegative as long as the face is the active one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Monitor {
    /// The distance to an inactive inequality of the block, in the unit of `z`.
    Distance(f64),
    /// The multiplier of an active inequality of the block, in the unit of `G`.
    Multiplier(f64),
}

/// The equations `Phi = R G + c = 0` of a face of a block of `K` at one point; the block couples `k` components of `z`,
/// its members.
#[derive(Clone, Debug, Default)]
pub struct FaceEquations {
    /// The number `k` of components of `z` that the block couples.
    pub members: usize,
    /// The derivative `R` of the residual `Phi` with respect to `G`, by rows: zero in rows of constraints on `z`, rows
    /// of the transposed tangent basis `T^T` otherwise.
    pub combination: Vec<f64>,
    /// The term `c` of the residual `Phi = R G + c`: the constraint residuals; zero in rows that are not constraints on
    /// `z`.
    pub constraint: Vec<f64>,
    /// For each row of the residual `Phi`, whether it has the unit of `z` rather than that of `G`.
    pub is_of_z: Vec<bool>,
    /// The derivative of the residual `Phi` with respect to `z` at constant `G`, by rows: constraint gradients, and
    /// curvature terms.
    pub own: Vec<f64>,
    /// The derivative of the residual `Phi` with respect to the radius of a ball.
    pub by_radius: Vec<f64>,
    /// The event functions (monitors) of the face, in an order that depends on the face only.
    pub monitors: Vec<Monitor>,
}

impl FaceEquations {
    /// Sets the equations and event functions of the block's face `face` at `z` and `G`, both in the coordinates of the
    /// shape.
    pub fn set(&mut self, shape: &Shape, face: &Face, z: &[f64], g: &[f64]) {
        let k = z.len();
        self.members = k;
        for (matrix, size) in [
            (&mut self.combination, k * k),
            (&mut self.own, k * k),
            (&mut self.constraint, k),
            (&mut self.by_radius, k),
        ] {
            matrix.clear();
            matrix.resize(size, 0.0);
        }
        self.is_of_z.clear();
        self.is_of_z.resize(k, false);
        self.monitors.clear();
        match (shape, face) {
            (_, Face::Interior) => self.interior(shape, z),
            (_, Face::Vertex) => self.vertex(shape, z, g),
            (Shape::Ball { radius }, Face::Boundary(pivot)) => self.sphere(*radius, *pivot, z, g),
            (Shape::Simplex, Face::Edge(zeros)) => self.simplex(zeros, z, g),
            (Shape::Polyhedron(polyhedron), Face::Edge(rows)) => self.rows(polyhedron, rows, z, g),
            (_, Face::Boundary(1)) => self.dual_cone(z, g),
            _ => self.cone(z, g),
        }
    }

    /// Returns row `i` of the derivative `R` of the face equations' residual `Phi` with respect to `G`.
    pub fn combination_of(&self, i: usize) -> &[f64] {
        &self.combination[i * self.members..][..self.members]
    }

    /// Returns entry `i` of the residual `Phi = R G + c` of the face equations for the given `G`.
    pub fn value(&self, i: usize, g: &[f64]) -> f64 {
        self.constraint[i] + dot(self.combination_of(i), g)
    }

    fn interior(&mut self, shape: &Shape, z: &[f64]) {
        (0..z.len()).for_each(|i| self.combination[i * z.len() + i] = 1.0);
        match shape {
            Shape::Ball { radius } => self.monitors.push(Monitor::Distance(radius - ball::norm(z))),
            Shape::SecondOrderCone => self.monitors.push(Monitor::Distance(z[0] - ball::norm(&z[1..]))),
            Shape::Simplex => {}
            Shape::Polyhedron(polyhedron) => {
                let slack = |j: usize| polyhedron.offset(j) - dot(polyhedron.normal(j), z);
                self.monitors.extend((0..polyhedron.rows()).map(|j| Monitor::Distance(slack(j))));
            }
        }
    }

    fn vertex(&mut self, shape: &Shape, z: &[f64], g: &[f64]) {
        for (i, z_i) in z.iter().enumerate() {
            self.constraint[i] = -z_i;
            self.own[i * z.len() + i] = -1.0;
            self.is_of_z[i] = true;
        }
        self.monitors.push(match shape {
            Shape::Ball { radius } => Monitor::Distance(-radius),
            _ => Monitor::Multiplier(g[0] - ball::norm(&g[1..])),
        });
    }

    fn sphere(&mut self, radius: f64, pivot: usize, z: &[f64], g: &[f64]) {
        let (k, length) = (z.len(), ball::norm(z));
        for i in (0..k).filter(|&i| i != pivot) {
            let ratio = z[i] / z[pivot];
            self.combination[i * k + i] = 1.0;
            self.combination[i * k + pivot] = -ratio;
            self.own[i * k + i] = -g[pivot] / z[pivot];
            self.own[i * k + pivot] = ratio * g[pivot] / z[pivot];
        }
        for (j, z_j) in z.iter().enumerate() {
            self.own[pivot * k + j] = -z_j / length;
        }
        self.constraint[pivot] = radius - length;
        self.is_of_z[pivot] = true;
        self.by_radius[pivot] = 1.0;
        self.monitors.push(Monitor::Multiplier(-dot(z, g) / length));
    }

    fn cone(&mut self, z: &[f64], g: &[f64]) {
        let k = z.len();
        let mut square = 0.0;
        for i in 1..k {
            let ratio = z[i] / z[0];
            square += ratio * ratio;
            self.combination[i * k + i] = 1.0;
            self.combination[i * k] = ratio;
            self.own[i * k + i] = g[0] / z[0];
            self.own[i * k] = -ratio * g[0] / z[0];
            self.own[i] = ratio;
        }
        // The boundary of the cone is given by the constraint `c = (|v|^2/s - s)/2 = 0` with `z = (s, v)`.
        self.constraint[0] = 0.5 * (square - 1.0) * z[0];
        self.own[0] = -0.5 * (square + 1.0);
        self.is_of_z[0] = true;
        self.monitors.extend([Monitor::Multiplier(g[0]), Monitor::Distance(z[0])]);
    }

    fn dual_cone(&mut self, z: &[f64], g: &[f64]) {
        let k = z.len();
        let mut square = 0.0;
        for i in 1..k {
            let ratio = g[i] / g[0];
            square += ratio * ratio;
            self.combination[i * k + i] = -z[0] / g[0];
            self.combination[i * k] = ratio * z[0] / g[0];
            self.combination[i] = ratio;
            // The product `R G` is zero in row `i`, so that the residual `Phi_i` is the constraint on `z` alone.
            self.constraint[i] = -(z[i] + ratio * z[0]);
            self.own[i * k + i] = -1.0;
            self.own[i * k] = -ratio;
            self.is_of_z[i] = true;
        }
        // In the dual form, the constraint `(|v|^2/s - s)/2` with `(s, v) = G` is homogeneous of degree one, and so
        // equals its derivative times `G`.
        self.combination[0] = -0.5 * (square + 1.0);
        self.monitors.extend([Monitor::Multiplier(g[0]), Monitor::Distance(z[0])]);
    }

    fn simplex(&mut self, zeros: &[usize], z: &[f64], g: &[f64]) {
        let k = z.len();
        let pivot = (0..k).find(|i| !zeros.contains(i)).unwrap_or(0);
        for i in 0..k {
            let is_zero = zeros.contains(&i);
            if is_zero {
                self.constraint[i] = -z[i];
                self.own[i * k + i] = -1.0;
                self.is_of_z[i] = true;
            } else if i != pivot {
                self.combination[i * k + i] = 1.0;
                self.combination[i * k + pivot] = -1.0;
            }
            self.own[pivot * k + i] = -1.0;
            let monitor = if is_zero { Monitor::Multiplier(g[i] - g[pivot]) } else { Monitor::Distance(z[i]) };
            self.monitors.push(monitor);
        }
        self.constraint[pivot] = 1.0 - z.iter().sum::<f64>();
        self.is_of_z[pivot] = true;
    }

    fn rows(&mut self, polyhedron: &Polyhedron, rows: &[usize], z: &[f64], g: &[f64]) {
        let k = z.len();
        let Elimination { pivots, normals, inverse } = Elimination::of(polyhedron, rows);
        let count = pivots.len();
        let slack = |j: usize| polyhedron.offset(j) - dot(polyhedron.normal(j), z);
        for i in (0..k).filter(|i| !pivots.contains(i)) {
            self.combination[i * k + i] = 1.0;
            for (q, pivot) in pivots.iter().enumerate() {
                self.combination[i * k + pivot] = -normals[q * k + i];
            }
        }
        for (q, pivot) in pivots.iter().enumerate() {
            self.constraint[*pivot] = rows.iter().zip(&inverse[q * count..]).map(|(&j, w)| w * slack(j)).sum();
            self.is_of_z[*pivot] = true;
            for j in 0..k {
                self.own[pivot * k + j] = -normals[q * k + j];
            }
        }
        for j in 0..polyhedron.rows() {
            self.monitors.push(match rows.iter().position(|row| *row == j) {
                Some(at) => {
                    let force: f64 = pivots.iter().enumerate().map(|(q, p)| inverse[q * count + at] * g[*p]).sum();
                    Monitor::Multiplier(-force)
                }
                None => Monitor::Distance(slack(j)),
            });
        }
    }
}

/// The matrices `N_p^-1 N` and `N_p^-1` for the active rows `N` of a polyhedron, where `N_p` are the pivot columns of
/// `N`, chosen by complete pivoting.
pub(super) struct Elimination {
    pub(super) pivots: Vec<usize>,
    normals: Vec<f64>,
    pub(super) inverse: Vec<f64>,
}

impl Elimination {
    pub(super) fn of(polyhedron: &Polyhedron, rows: &[usize]) -> Self {
        let (count, k) = (rows.len(), polyhedron.dimension());
        let width = k + count;
        let mut table = vec![0.0; count * width];
        for (q, &row) in rows.iter().enumerate() {
            table[q * width..][..k].copy_from_slice(polyhedron.normal(row));
            table[q * width + k + q] = 1.0;
        }
        let mut pivots = vec![0; count];
        for step in 0..count {
            let places = (step..count).flat_map(|q| (0..k).map(move |j| (q, j)));
            let size = |&(q, j): &(usize, usize)| table[q * width + j].abs();
            let Some((row, pivot)) = places.max_by(|a, b| size(a).total_cmp(&size(b))) else { break };
            (0..width).for_each(|j| table.swap(row * width + j, step * width + j));
            pivots[step] = pivot;
            let scale = table[step * width + pivot];
            table[step * width..][..width].iter_mut().for_each(|entry| *entry /= scale);
            for q in (0..count).filter(|&q| q != step) {
                let factor = table[q * width + pivot];
                for j in 0..width {
                    table[q * width + j] -= factor * table[step * width + j];
                }
            }
        }
        let part = |from: usize, to: usize| table.chunks_exact(width).flat_map(|row| row[from..to].to_vec()).collect();
        Self { normals: part(0, k), inverse: part(k, width), pivots }
    }
}
