//! Property tests of projections onto every shape of block: the nearest-point property and its consequences.

mod blocks;
mod faces;
mod intervals;

use super::{Polyhedron, Shape};
use proptest::prelude::*;

/// Generates every shape of a block of `K` in up to five dimensions, with its dimension.
fn shapes() -> impl Strategy<Value = (usize, Shape)> {
    let polyhedron = (1_usize..5, 1_usize..9).prop_flat_map(|(n, rows)| {
        let entries = proptest::collection::vec(-1.0..1.0_f64, n * rows);
        (Just(n), entries, proptest::collection::vec(0.0..1.0_f64, rows))
    });
    prop_oneof![
        (1_usize..6, 0.0..3.0_f64).prop_map(|(n, radius)| (n, Shape::Ball { radius })),
        (1_usize..6).prop_map(|n| (n, Shape::SecondOrderCone)),
        (1_usize..6).prop_map(|n| (n, Shape::Simplex)),
        // The generated polyhedron contains the origin, so that it is nonempty.
        polyhedron.prop_map(|(n, a, b)| (n, Shape::Polyhedron(Polyhedron::new(n, &a, &b).expect("zero is inside")))),
    ]
}

/// Generates the shape of a block and `count` points of its space, some of them far from the origin.
fn shape_and_points(count: usize) -> impl Strategy<Value = (Shape, Vec<Vec<f64>>)> {
    shapes().prop_flat_map(move |(n, shape)| {
        let point = (proptest::collection::vec(-1.0..1.0_f64, n), prop_oneof![Just(0.3), Just(1.0), Just(10.0)])
            .prop_map(|(x, size)| x.into_iter().map(|x| size * x).collect::<Vec<f64>>());
        (Just(shape), proptest::collection::vec(point, count))
    })
}

fn project(shape: &Shape, x: &[f64]) -> Vec<f64> {
    let mut p = vec![0.0; x.len()];
    shape.project(x, &mut p, &mut Default::default());
    p
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}
