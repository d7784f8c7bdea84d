//! The joints of an island as bilateral rows `G v = -b`, eliminated exactly: with `S = G M^-1 G^T`,
//!
//! ```text
//! lambda = -S^-1 (b + G v_free + Y^T r),    Y = J M^-1 G^T,    W <- W - Y S^-1 Y^T
//! ```
//!
//! so that contacts see bodies that are already joined. `S` is singular where joints say the same twice, as in a closed
//! chain: it is factorised with a shift of rounding size, which proximal iterations take out again.

use super::contact::Contact;
use super::delassus::Block;
use super::joint::{Joint, Row};
use super::motion::Motion;
use factorisation::{Cholesky, SparseMatrix};
use faer::sparse::Triplet;
use nalgebra::{Isometry3, Matrix3, Vector3};
use problem::Control;

/// The shift of `S`, in parts of its greatest diagonal entry, and the iterations that take it out.
const SHIFT: f64 = 1e-11;
const REFINEMENTS: usize = 3;

/// The rows of the joints of an island, at one configuration.
pub struct Constraints {
    rows: Vec<(Row, [Option<u32>; 2])>,
    /// `S` by its nonzeros.
    entries: Vec<(usize, usize, f64)>,
    factor: Cholesky,
}

impl Constraints {
    /// The rows of these joints; `None` if there are none, or no memory for them.
    pub fn new(joints: &[(&Joint, [Option<u32>; 2])], moving: &[Motion]) -> Option<Self> {
        let mut rows = Vec::new();
        let mut of_joint = Vec::new();
        for &(joint, bodies) in joints {
            of_joint.clear();
            joint.rows(poses(bodies, moving), &mut of_joint);
            rows.extend(of_joint.drain(..).map(|row| (row, bodies)));
        }
        if rows.is_empty() {
            return None;
        }
        let entries = schur(&rows, moving);
        let largest = entries.iter().map(|&(_, _, value)| value.abs()).fold(0.0, f64::max);
        let shifted = entries.iter().copied().chain((0..rows.len()).map(|k| (k, k, SHIFT * largest)));
        let triplets: Vec<_> = shifted.map(|(i, j, value)| Triplet::new(i, j, value)).collect();
        let matrix = SparseMatrix::try_new_from_triplets(rows.len(), rows.len(), &triplets).ok()?;
        let mut factor = Cholesky::new(&matrix)?;
        factor.factorise(&matrix);
        Some(Self { rows, entries, factor })
    }

    /// `c`, the values of the equations.
    pub fn values(&self) -> impl Iterator<Item = f64> {
        self.rows.iter().map(|(row, _)| row.value)
    }

    /// `G v`.
    fn velocity(&self, moving: &[Motion]) -> Vec<f64> {
        let of = |body: Option<u32>| {
            body.map_or_else(Default::default, |body| (moving[body as usize].velocity, moving[body as usize].omega))
        };
        self.rows.iter().map(|(row, bodies)| row.velocity(bodies.map(of))).collect()
    }

    /// Solves `S x = b` in place; false if `S` has no factors.
    fn solve(&mut self, b: &mut [f64]) -> bool {
        let right = b.to_vec();
        b.fill(0.0);
        let mut rest = right.clone();
        for _ in 0..REFINEMENTS {
            if !self.factor.solve(&mut rest) {
                return false;
            }
            for (b, rest) in b.iter_mut().zip(&rest) {
                *b += rest;
            }
            rest.copy_from_slice(&right);
            for &(i, j, value) in &self.entries {
                rest[i] -= value * b[j];
            }
        }
        true
    }

    /// Makes `G v = -b` by impulses; false if `S` has no factors.
    pub fn hold(&mut self, b: &[f64], moving: &mut [Motion]) -> bool {
        let mut lambda = self.velocity(moving);
        for (lambda, b) in lambda.iter_mut().zip(b) {
            *lambda = -(*lambda + b);
        }
        let solved = self.solve(&mut lambda);
        self.push(&lambda, moving);
        solved
    }

    /// Changes the momenta by `G^T lambda`.
    fn push(&self, lambda: &[f64], moving: &mut [Motion]) {
        for ((row, bodies), lambda) in self.rows.iter().zip(lambda) {
            for (side, sign) in [(0, 1.0), (1, -1.0)] {
                if let Some(body) = bodies[side] {
                    moving[body as usize].push(&(row.force * (sign * lambda)), &(row.torques[side] * *lambda));
                }
            }
        }
    }

    /// The blocks of `-Y S^-1 Y^T`; `None` if `S` has no factors, or `control` asks to stop.
    pub fn coupling(&mut self, contacts: &[Contact], moving: &[Motion], control: &Control) -> Option<Vec<Block>> {
        let n = self.rows.len();
        let mut coupled = Vec::new();
        for (k, contact) in contacts.iter().enumerate() {
            control.go_on().ok()?;
            let mut columns = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
            let mut any = false;
            for (i, (row, bodies)) in self.rows.iter().enumerate() {
                let y = mixed(row, bodies, contact, moving);
                any |= y != Vector3::zeros();
                for (column, y) in columns.iter_mut().zip(&y) {
                    column[i] = *y;
                }
            }
            if any {
                let mut solved = columns.clone();
                for column in &mut solved {
                    if !self.solve(column) {
                        return None;
                    }
                }
                coupled.push((k, columns, solved));
            }
        }
        let product = |x: &[Vec<f64>; 3], y: &[Vec<f64>; 3]| {
            Matrix3::from_fn(|i, j| -x[i].iter().zip(&y[j]).map(|(a, b)| a * b).sum::<f64>())
        };
        let pairs = coupled.iter().flat_map(|(i, y, _)| coupled.iter().map(move |(j, _, x)| (*i, *j, product(y, x))));
        Some(pairs.collect())
    }
}

/// The poses of two bodies; the world is at the origin.
pub fn poses(bodies: [Option<u32>; 2], moving: &[Motion]) -> [&Isometry3<f64>; 2] {
    static WORLD: std::sync::LazyLock<Isometry3<f64>> = std::sync::LazyLock::new(Isometry3::identity);
    bodies.map(|body| body.map_or(&*WORLD, |body| &moving[body as usize].pose))
}

/// `G M^-1 G^T` by its nonzeros.
fn schur(rows: &[(Row, [Option<u32>; 2])], moving: &[Motion]) -> Vec<(usize, usize, f64)> {
    let mut touches: Vec<(u32, usize, usize)> = Vec::new();
    for (k, (_, bodies)) in rows.iter().enumerate() {
        touches.extend(bodies.iter().enumerate().filter_map(|(side, body)| body.map(|body| (body, k, side))));
    }
    touches.sort_unstable();
    let mut entries = Vec::new();
    for group in touches.chunk_by(|a, b| a.0 == b.0) {
        let body = &moving[group[0].0 as usize];
        for &(_, i, side_i) in group {
            let a = &rows[i].0;
            let turned = body.mobility * a.torques[side_i];
            for &(_, j, side_j) in group {
                let b = &rows[j].0;
                let sign = if side_i == side_j { 1.0 } else { -1.0 };
                entries.push((i, j, sign * a.force.dot(&b.force) / body.mass + turned.dot(&b.torques[side_j])));
            }
        }
    }
    entries
}

/// `J M^-1 G^T` for one contact and one row.
fn mixed(row: &Row, bodies: &[Option<u32>; 2], contact: &Contact, moving: &[Motion]) -> Vector3<f64> {
    let mut y = Vector3::zeros();
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        let Some(body) = bodies[side] else { continue };
        let motion = &moving[body as usize];
        let (v, w) = (row.force * (sign / motion.mass), motion.mobility * row.torques[side]);
        y += contact.velocity(|other| if other == body { (v, w) } else { Default::default() });
    }
    y
}
