//! Tests of the solvers of variational inequalities by enumeration of faces, closed forms, feasible directions, and
//! agreement with each other.

mod active_set;
mod blocks;
mod choice;
mod closed_forms;
mod degenerate;
mod families;
mod multigrid;
mod nonlinear;
mod properties;
mod sizes;

use super::{AffineVi, BlockGaussSeidel, Conic, Lemke, Outcome, Report, SemismoothNewton, ViSolver};
use nalgebra::{DMatrix, DVector};
use problem::{Control, ConvexSet, Polyhedron, Shape, Workspace};

const INFINITY: f64 = f64::INFINITY;

/// The data of an affine variational inequality.
#[derive(Clone, Debug)]
struct Problem {
    matrix: DMatrix<f64>,
    q: Vec<f64>,
    set: ConvexSet,
}

impl Problem {
    fn new(matrix: DMatrix<f64>, q: Vec<f64>, set: ConvexSet) -> Self {
        Self { matrix, q, set }
    }

    fn complementarity(matrix: DMatrix<f64>, q: Vec<f64>) -> Self {
        let set = ConvexSet::nonnegative(q.len());
        Self { matrix, q, set }
    }

    fn solve(&self, solver: &mut dyn ViSolver, z: &mut [f64]) -> Report {
        solver.solve(&AffineVi { matrix: &self.matrix, q: &self.q, set: &self.set }, z, &Control::new())
    }

    fn w(&self, z: &[f64]) -> Vec<f64> {
        let w = &self.matrix * DVector::from_column_slice(z) + DVector::from_column_slice(&self.q);
        w.as_slice().to_vec()
    }

    /// Returns the natural-map residual of the point `z`, relative to `max(1, |q|, |A| |z|)`.
    fn scaled_residual(&self, z: &[f64]) -> f64 {
        let size = self.matrix.abs() * DVector::from_column_slice(z).abs();
        let q = self.q.iter().fold(1.0_f64, |x, q| x.max(q.abs()));
        self.set.natural_residual(z, &self.w(z)) / size.amax().max(q)
    }

    /// Solves the problem from zero by each solver, asserts a small residual, and returns the solutions.
    fn solve_by_all(&self) -> Vec<Vec<f64>> {
        solvers(self.q.len()).into_iter().map(|mut solver| self.solve_exactly(&mut *solver)).collect()
    }

    fn solve_exactly(&self, solver: &mut dyn ViSolver) -> Vec<f64> {
        let mut z = vec![0.0; self.q.len()];
        let report = self.solve(solver, &mut z);
        assert_eq!(report.outcome, Outcome::Solved, "{} left {report:?}", solver.name());
        let residual = self.scaled_residual(&z);
        assert!(residual <= 1e-10, "{} left {residual} in {report:?}", solver.name());
        z
    }

    /// Returns all solutions over intervals, by enumeration of the `3^m` faces of `K`.
    fn solutions_by_enumeration(&self) -> Vec<Vec<f64>> {
        let m = self.q.len();
        (0..3_usize.pow(u32::try_from(m).expect("small"))).filter_map(|code| self.solution_on_face(code)).collect()
    }

    fn solution_on_face(&self, mut code: usize) -> Option<Vec<f64>> {
        let m = self.q.len();
        let mut z = DVector::zeros(m);
        let mut inside = Vec::new();
        for i in 0..m {
            match code % 3 {
                0 => z[i] = self.set.lower[i],
                1 => z[i] = self.set.upper[i],
                _ => inside.push(i),
            }
            code /= 3;
        }
        if z.iter().any(|z| !z.is_finite()) {
            return None;
        }
        let w = &self.matrix * &z + DVector::from_column_slice(&self.q);
        let block = self.matrix.select_rows(&inside).select_columns(&inside);
        let rhs = -w.select_rows(&inside);
        let x = if inside.is_empty() { rhs } else { block.lu().solve(&rhs)? };
        for (k, &i) in inside.iter().enumerate() {
            z[i] = x[k];
        }
        let z = z.as_slice().to_vec();
        (self.scaled_residual(&z) < 1e-9).then_some(z)
    }
}

fn solvers(m: usize) -> Vec<Box<dyn ViSolver>> {
    vec![Box::new(Lemke::new(m)), Box::new(SemismoothNewton::new(m))]
}

/// A generator of reproducible random numbers (Vigna 2015, `SplitMix64`).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^ (x >> 31)
    }

    /// Returns a uniform random number in `[-1, 1)`.
    fn number(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self, m: usize) -> Vec<f64> {
        (0..m).map(|_| self.number()).collect()
    }

    fn matrix(&mut self, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| self.number())
    }

    /// Returns a random positive definite matrix `B B^T / m + 0.1 I`.
    fn positive_definite(&mut self, m: usize) -> DMatrix<f64> {
        let b = self.matrix(m, m);
        &b * b.transpose() / m as f64 + DMatrix::identity(m, m) * 0.1
    }

    /// Returns a random matrix that is positive definite plus skew, its columns scaled by positive numbers: a
    /// P-matrix, far from symmetric and not positive definite.
    fn nonsymmetric_p(&mut self, m: usize) -> DMatrix<f64> {
        let s = self.matrix(m, m);
        let mut p = self.positive_definite(m) + (&s - s.transpose()) / (m as f64).sqrt();
        for mut column in p.column_iter_mut() {
            column *= 10.0_f64.powf(self.number());
        }
        p
    }

    /// Returns random intervals of every kind: free, one-sided, two-sided and points.
    fn intervals(&mut self, m: usize) -> ConvexSet {
        let mut set = ConvexSet::free(m);
        for i in 0..m {
            let (a, b) = (self.number(), self.number());
            (set.lower[i], set.upper[i]) = match self.next() % 6 {
                0 => (-INFINITY, INFINITY),
                1 => (a, INFINITY),
                2 => (-INFINITY, b),
                3 => (a, a),
                _ => (a.min(b), a.max(b)),
            };
        }
        set
    }

    /// Returns a random set of balls, cones, simplices and polyhedra of up to five dimensions, with intervals between
    /// them.
    fn blocks(&mut self, m: usize) -> ConvexSet {
        let mut set = self.intervals(m);
        let mut places: Vec<usize> = (0..m).collect();
        for i in (1..m).rev() {
            places.swap(i, (self.next() % (i as u64 + 1)) as usize);
        }
        let mut places = places.as_slice();
        while !places.is_empty() {
            let k = 1 + (self.next() % 5) as usize;
            let (members, rest) = places.split_at(k.min(places.len()));
            places = rest;
            let k = members.len();
            let shape = match self.next() % 5 {
                0 => Shape::Ball { radius: self.number().abs() },
                1 => Shape::SecondOrderCone,
                2 => Shape::Simplex,
                3 => {
                    let b: Vec<f64> = (0..2 * k).map(|_| self.number().abs()).collect();
                    Shape::Polyhedron(Polyhedron::new(k, &self.vector(2 * k * k), &b).expect("zero is inside"))
                }
                _ => continue,
            };
            set.bind(members.to_vec(), shape);
        }
        set
    }

    /// Returns a random point of `K` near zero.
    fn member(&mut self, set: &ConvexSet) -> Vec<f64> {
        let mut z: Vec<f64> = (0..set.dimension()).map(|_| 3.0 * self.number()).collect();
        set.project_all(&mut z, &mut Workspace::default());
        z
    }
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |largest, (a, b)| largest.max((a - b).abs()))
}
