//! Stacks of unit cubes with four contacts on each face: twice as many unknowns as degrees of freedom, and a load
//! that may be a million times the weight of the cubes that carry it. Statics determines the sum of the normal
//! impulses at every face.

use super::super::{Coulomb, CoulombProblem};
use super::{Random, problem};
use crate::Outcome;
use nalgebra::{DMatrix, DVector, Vector3};
use problem::Control;

/// Velocity that a body in free fall gains in one time step of 0.01 s, in m/s.
const FALL: f64 = 0.0981;

/// Returns the problem of a stack of cubes of mass one, the top one of mass `load`, after one step of free fall, with
/// random velocities of the fraction `push` of that of the fall.
fn stack(cubes: usize, load: f64, push: f64) -> CoulombProblem {
    let mut random = Random(8);
    let mut jacobian = DMatrix::zeros(12 * cubes, 6 * cubes);
    let mut inverse_mass = DVector::zeros(6 * cubes);
    let mut velocity = DVector::from_fn(6 * cubes, |_, _| push * FALL * random.number());
    for cube in 0..cubes {
        let mass = if cube + 1 == cubes { load } else { 1.0 };
        // A solid cube of side one has the moment of inertia m / 6.
        for axis in 0..3 {
            inverse_mass[6 * cube + axis] = 1.0 / mass;
            inverse_mass[6 * cube + 3 + axis] = 6.0 / mass;
        }
        velocity[6 * cube + 2] -= FALL;
        for corner in 0..4 {
            let (x, y) = ([-0.5, 0.5][corner % 2], [-0.5, 0.5][corner / 2]);
            let mut touch = |body: usize, sign: f64, z: f64| {
                // Rows of the contact point velocity v + omega x (x, y, z): normal along z, tangents along x and y.
                let rows = [[0., 0., 1., y, -x, 0.], [1., 0., 0., 0., z, -y], [0., 1., 0., -z, 0., x]];
                for (axis, row) in rows.iter().enumerate() {
                    for (column, value) in row.iter().enumerate() {
                        jacobian[(12 * cube + 3 * corner + axis, 6 * body + column)] = sign * value;
                    }
                }
            };
            touch(cube, 1.0, -0.5);
            if cube > 0 {
                touch(cube - 1, -1.0, 0.5);
            }
        }
    }
    let dense = &jacobian * DMatrix::from_diagonal(&inverse_mass) * jacobian.transpose();
    let q = (jacobian * velocity).as_slice().chunks_exact(3).map(Vector3::from_column_slice).collect();
    problem(&dense, q, vec![0.6; 4 * cubes])
}

#[test]
fn a_stack_at_rest_carries_its_weight_whatever_its_load() {
    for load in [1.0, 1e3, 1e6] {
        let cubes = 10;
        let problem = stack(cubes, load, 0.0);
        let mut r = vec![Vector3::zeros(); 4 * cubes];
        let report = Coulomb::default().solve(&problem, &mut r, &Control::new());
        assert_eq!(report.outcome, Outcome::Solved, "load {load}: {report:?}");
        for face in 0..cubes {
            let carried: Vector3<f64> = r[4 * face..4 * face + 4].iter().sum();
            let weight = ((cubes - 1 - face) as f64 + load) * FALL;
            assert!((carried.x / weight - 1.0).abs() < 1e-8, "load {load}, face {face}: {carried} for {weight}");
            assert!(
                carried.y.hypot(carried.z) < 1e-8 * weight,
                "load {load}, face {face}: {carried} for {weight}, {report:?}"
            );
        }
    }
}

#[test]
fn a_stack_that_is_pushed_over_is_solved() {
    for cubes in [2, 5, 10] {
        for load in [1.0, 1e3] {
            for push in [0.1, 0.5, 2.0] {
                let problem = stack(cubes, load, push);
                let mut r = vec![Vector3::zeros(); 4 * cubes];
                let report = Coulomb::default().solve(&problem, &mut r, &Control::new());
                assert_eq!(report.outcome, Outcome::Solved, "{cubes} cubes, load {load}, push {push}: {report:?}");
            }
        }
    }
}
