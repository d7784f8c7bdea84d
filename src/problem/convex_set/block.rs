//! Blocks: factors of the convex set `K` that couple several components of the variables `z`.

use super::active_rows::ActiveRows;
use super::face::Face;
use super::polyhedron::{Polyhedron, dot};
use super::{ball, second_order_cone, simplex};

/// The shape of a block of `K`: a convex set in the space of the block's `k` components.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// The Euclidean ball `|z| <= radius` about the origin.
    Ball {
        /// The radius of the ball, nonnegative.
        radius: f64,
    },
    /// The second-order cone `z_1 >= |(z_2, .., z_k)|`.
    SecondOrderCone,
    /// The unit simplex `z >= 0`, `sum z = 1`.
    Simplex,
    /// A polyhedron `A z <= b`.
    Polyhedron(Polyhedron),
}

/// A block of the convex set `K`: a shape, and the components of `z` that it couples.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// The indices of the block's components in `z`, in the order of the shape's coordinates.
    pub members: Vec<usize>,
    /// The shape of the block, a convex set in the space of its components.
    pub shape: Shape,
}

/// Workspace for the projection onto a block; it grows to the size of the largest block that has used it.
#[derive(Clone, Debug, Default)]
pub struct BlockWorkspace {
    sorted: Vec<f64>,
    rows: ActiveRows,
}

impl Shape {
    /// Writes the projection of `x` onto the block's shape to `p`; `x` and `p` have one entry per component of the
    /// block. NaN in `x` gives NaN in `p`.
    pub fn project(&self, x: &[f64], p: &mut [f64], work: &mut BlockWorkspace) {
        match self {
            Shape::Ball { radius } => ball::project(*radius, x, p),
            Shape::SecondOrderCone => second_order_cone::project(x, p),
            Shape::Simplex => {
                work.sorted.resize(x.len(), 0.0);
                simplex::project(x, p, &mut work.sorted);
            }
            Shape::Polyhedron(polyhedron) => {
                work.rows.project(polyhedron, 1.0, x, p);
            }
        }
    }

    /// Writes the projection of `x` onto the shape to `p`, and an element of the B-subdifferential of the projection
    /// at `x` to `derivative`: a symmetric `k x k` matrix with eigenvalues in `[0, 1]`, equal to the derivative where
    /// it exists. Each shape's module documents its choice at kinks.
    pub fn linearise(&self, x: &[f64], p: &mut [f64], derivative: &mut [f64], work: &mut BlockWorkspace) {
        self.project(x, p, work);
        match self {
            Shape::Ball { radius } => ball::derivative(*radius, x, derivative),
            Shape::SecondOrderCone => second_order_cone::derivative(x, derivative),
            Shape::Simplex => simplex::derivative(p, derivative),
            Shape::Polyhedron(_) => {
                for (j, column) in derivative.chunks_exact_mut(x.len()).enumerate() {
                    column.fill(0.0);
                    column[j] = 1.0;
                    work.rows.restrict(column);
                }
            }
        }
    }

    /// Returns the face of the block's shape whose relative interior contains the projection of `x`; the projection is
    /// written to `p`.
    pub fn face(&self, x: &[f64], p: &mut [f64], work: &mut BlockWorkspace) -> Face {
        self.project(x, p, work);
        match self {
            Shape::Ball { radius } if *radius == 0.0 => Face::Vertex,
            Shape::Ball { radius } if ball::norm(x) < *radius => Face::Interior,
            Shape::Ball { .. } => Face::Boundary(ball::largest(p)),
            Shape::SecondOrderCone if p.iter().all(|p| *p == 0.0) => Face::Vertex,
            Shape::SecondOrderCone if ball::norm(&x[1..]) < x[0] => Face::Interior,
            Shape::SecondOrderCone => Face::Boundary(0),
            Shape::Simplex => Face::Edge((0..p.len()).filter(|&i| p[i] == 0.0).collect()),
            Shape::Polyhedron(_) if work.rows.rows().is_empty() => Face::Interior,
            Shape::Polyhedron(_) => Face::Edge(work.rows.rows().to_vec()),
        }
    }

    /// Returns the support function `sup <d, z>` over points `z` of the block's shape; infinite if the shape is
    /// unbounded in direction `d`.
    pub fn support(&self, d: &[f64], work: &mut BlockWorkspace) -> f64 {
        match self {
            Shape::Ball { radius } => radius * ball::norm(d),
            Shape::SecondOrderCone if ball::norm(&d[1..]) <= -d[0] => 0.0,
            Shape::SecondOrderCone => f64::INFINITY,
            Shape::Simplex => d.iter().fold(f64::NEG_INFINITY, |largest, d| largest.max(*d)),
            Shape::Polyhedron(polyhedron) => polyhedron.support(d, &mut work.rows),
        }
    }

    /// Returns whether `d` is in the recession cone of the block's shape: whether `z + s d` stays in the shape for all
    /// `s >= 0`.
    pub fn recedes(&self, d: &[f64]) -> bool {
        match self {
            Shape::Ball { .. } | Shape::Simplex => d.iter().all(|d| *d == 0.0),
            Shape::SecondOrderCone => ball::norm(&d[1..]) <= d[0],
            Shape::Polyhedron(polyhedron) => polyhedron.recedes(d),
        }
    }

    /// Returns the length scale of the block's shape: the radius of a ball, one for a simplex, the largest distance of
    /// a bounding plane of a polyhedron from the origin. `None` for cones.
    pub fn size(&self) -> Option<f64> {
        let size = match self {
            Shape::Ball { radius } => *radius,
            Shape::Simplex => 1.0,
            Shape::SecondOrderCone => 0.0,
            Shape::Polyhedron(polyhedron) => polyhedron.reach(),
        };
        (size > 0.0).then_some(size)
    }

    /// Returns whether the block's shape is bounded: whether its recession cone is zero.
    pub fn is_bounded(&self, work: &mut BlockWorkspace) -> bool {
        match self {
            Shape::Ball { .. } | Shape::Simplex => true,
            Shape::SecondOrderCone => false,
            Shape::Polyhedron(polyhedron) => {
                let mut d = vec![0.0; polyhedron.dimension()];
                (0..2 * d.len()).all(|k| {
                    d.fill(0.0);
                    d[k / 2] = if k % 2 == 0 { 1.0 } else { -1.0 };
                    polyhedron.support(&d, &mut work.rows) < f64::INFINITY
                })
            }
        }
    }

    /// Returns whether the block's shape, as a set in `k` dimensions, is nonempty.
    pub fn is_nonempty(&self, k: usize) -> bool {
        match self {
            Shape::Ball { radius } => *radius >= 0.0,
            Shape::SecondOrderCone | Shape::Simplex => k > 0,
            Shape::Polyhedron(polyhedron) => polyhedron.dimension() == k,
        }
    }

    /// Returns the largest violation of a constraint of the block's shape by `z`, as a length; at most zero if `z` is
    /// in the shape.
    pub fn violation(&self, z: &[f64]) -> f64 {
        match self {
            Shape::Ball { radius } => ball::norm(z) - radius,
            Shape::SecondOrderCone => std::f64::consts::FRAC_1_SQRT_2 * (ball::norm(&z[1..]) - z[0]),
            Shape::Simplex => {
                let excess = (z.iter().sum::<f64>() - 1.0).abs();
                z.iter().fold(excess, |worst, z| worst.max(-z))
            }
            Shape::Polyhedron(polyhedron) => (0..polyhedron.rows())
                .map(|i| dot(polyhedron.normal(i), z) - polyhedron.offset(i))
                .fold(f64::NEG_INFINITY, f64::max),
        }
    }
}
