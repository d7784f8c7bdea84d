//! Tests of the faces of blocks of `K`, of distances from `K`, and of its boundedness.

use super::super::{ConvexSet, Face, FaceEquations, Monitor, Polyhedron, Shape, Workspace};
use proptest::prelude::{ProptestConfig, prop_assert, proptest};

fn triangle() -> Shape {
    Shape::Polyhedron(Polyhedron::new(2, &[-1.0, 0.0, 0.0, -1.0, 1.0, 1.0], &[0.0, 0.0, 1.0]).expect("not empty"))
}

fn face_is(shape: Shape, x: &[f64], expected: Face) {
    let mut set = ConvexSet::free(x.len());
    set.bind((0..x.len()).collect(), shape);
    assert_eq!(set.face(0, x, &mut Workspace::default()), expected);
}

#[test]
fn points_project_to_the_face_that_they_see() {
    face_is(Shape::Ball { radius: 1.0 }, &[0.6, 0.0], Face::Interior);
    face_is(Shape::Ball { radius: 1.0 }, &[0.6, 0.9], Face::Boundary(1));
    face_is(Shape::Ball { radius: 0.0 }, &[0.6, 0.9], Face::Vertex);
    face_is(Shape::SecondOrderCone, &[2.0, 1.0], Face::Interior);
    face_is(Shape::SecondOrderCone, &[1.0, 2.0], Face::Boundary(0));
    face_is(Shape::SecondOrderCone, &[-3.0, 2.0], Face::Vertex);
    face_is(Shape::Simplex, &[3.0, 0.0, 2.5], Face::Edge(vec![1]));
    face_is(Shape::Simplex, &[3.0, 0.0, 0.0], Face::Edge(vec![1, 2]));
    face_is(triangle(), &[0.2, 0.2], Face::Interior);
    face_is(triangle(), &[1.0, 1.0], Face::Edge(vec![2]));
    face_is(triangle(), &[-1.0, 0.5], Face::Edge(vec![0]));
}

#[test]
fn distances_are_those_of_the_factors_together() {
    let mut set = ConvexSet::nonnegative(3);
    set.bind(vec![1, 2], Shape::Ball { radius: 1.0 });
    assert!((set.distance(&[-3.0, 3.0, 4.0], &mut Workspace::default()) - 5.0).abs() < 1e-15);
}

#[test]
fn a_product_is_bounded_if_every_factor_is() {
    let mut work = Workspace::default();
    let mut set = ConvexSet::intervals(vec![0.0; 5], vec![1.0; 5]);
    assert!(set.is_bounded(&mut work));
    set.bind(vec![0, 1], triangle());
    assert!(set.is_bounded(&mut work));
    assert!((set.support(&[1.0, 2.0, -1.0, 3.0, 0.0], &mut work) - 5.0).abs() < 1e-12);
    set.bind(vec![2, 3], Shape::Polyhedron(Polyhedron::new(2, &[1.0, 1.0], &[1.0]).expect("not empty")));
    assert!(!set.is_bounded(&mut work));
    assert_eq!(set.support(&[0.0, 0.0, 1.0, -1.0, 0.0], &mut work), f64::INFINITY);
    assert!((set.support(&[0.0, 0.0, 2.0, 2.0, 0.0], &mut work) - 2.0).abs() < 1e-12);
    assert!(set.recedes(&[0.0, 0.0, 1.0, -1.0, 0.0], &mut work));
    assert!(!set.recedes(&[0.0, 0.0, 1.0, 1.0, 0.0], &mut work));
}

#[test]
fn a_vertex_with_more_rows_than_dimensions_is_reached() {
    // A pyramid with eight sides and its apex at (0, 0, 1), and points above the apex, whose projection is the apex.
    let mut rows = Vec::new();
    for k in 0..8 {
        let angle = f64::from(k) * std::f64::consts::FRAC_PI_4;
        rows.extend([angle.cos(), angle.sin(), 1.0]);
    }
    let shape = Shape::Polyhedron(Polyhedron::new(3, &rows, &[1.0; 8]).expect("not empty"));
    for x in [[0.0, 0.0, 9.0], [0.01, -0.02, 30.0]] {
        let p = super::project(&shape, &x);
        assert!(super::norm(&super::minus(&p, &[0.0, 0.0, 1.0])) < 1e-12, "{p:?}");
    }
}

/// Returns one shape of a block of `K` of each kind, with three components.
fn shapes() -> Vec<Shape> {
    let rows = [1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, -1.0, 2.0, -1.0, 0.0, 0.5];
    vec![
        Shape::Ball { radius: 1.5 },
        Shape::SecondOrderCone,
        Shape::Simplex,
        Shape::Polyhedron(Polyhedron::new(3, &rows, &[1.0, 2.0, 1.0, 0.5]).expect("not empty")),
    ]
}

/// Returns the residual `Phi` of the equations of a face of a block at `z` and `G`.
fn residual(shape: &Shape, face: &Face, z: &[f64], g: &[f64]) -> Vec<f64> {
    let mut equations = FaceEquations::default();
    equations.set(shape, face, z, g);
    (0..z.len()).map(|i| equations.value(i, g)).collect()
}

/// Returns the equivalent descriptions of a face of a block: two for the boundary of a cone (primal and dual form), one
/// otherwise.
fn descriptions(shape: &Shape, face: &Face) -> Vec<Face> {
    match (shape, face) {
        (Shape::SecondOrderCone, Face::Boundary(_)) => vec![Face::Boundary(0), Face::Boundary(1)],
        _ => vec![face.clone()],
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    /// Tests that the projection `z = P(x)` onto a block, which solves the variational inequality with `G = f (z - x)`
    /// for any `f > 0`, satisfies the equations of its face with nonnegative event functions.
    #[test]
    fn a_projection_solves_the_equations_of_its_face(
        x in proptest::collection::vec(-3.0..3.0_f64, 3),
        factor in 0.01..100.0_f64,
    ) {
        for shape in shapes() {
            let mut z = vec![0.0; 3];
            let found = shape.face(&x, &mut z, &mut Default::default());
            let g: Vec<f64> = z.iter().zip(&x).map(|(z, x)| factor * (z - x)).collect();
            let size = 1e-10 * (1.0 + factor);
            for face in descriptions(&shape, &found) {
                let phi = residual(&shape, &face, &z, &g);
                prop_assert!(phi.iter().all(|phi| phi.abs() <= size), "{shape:?} {face:?}: {phi:?}");
                let mut equations = FaceEquations::default();
                equations.set(&shape, &face, &z, &g);
                for monitor in &equations.monitors {
                    let (Monitor::Distance(value) | Monitor::Multiplier(value)) = monitor;
                    prop_assert!(*value >= -size, "{shape:?} {face:?}: {monitor:?}");
                }
            }
        }
    }

    #[test]
    fn the_derivatives_of_a_face_are_those_of_differences(x in proptest::collection::vec(-3.0..3.0_f64, 3)) {
        let h = 1e-6;
        for shape in shapes() {
            let mut z = vec![0.0; 3];
            let found = shape.face(&x, &mut z, &mut Default::default());
            let g: Vec<f64> = z.iter().zip(&x).map(|(z, x)| z - x).collect();
            // Near the apex of a cone, the curvature terms in the equations of the boundary face are unbounded.
            let is_curved = matches!(found, Face::Boundary(_));
            if is_curved && (z[0].abs() < 0.1 || g[0].abs() < 0.1) {
                continue;
            }
            for face in descriptions(&shape, &found) {
                let mut equations = FaceEquations::default();
                equations.set(&shape, &face, &z, &g);
                for j in 0..3 {
                    let moved = |x: &[f64], by: f64| {
                        let mut x = x.to_vec();
                        x[j] += by;
                        x
                    };
                    let slope = |ahead: Vec<f64>, behind: Vec<f64>, i: usize| (ahead[i] - behind[i]) / (2.0 * h);
                    let at_z = |by| residual(&shape, &face, &moved(&z, by), &g);
                    let at_g = |by| residual(&shape, &face, &z, &moved(&g, by));
                    for i in 0..3 {
                        let (by_z, by_g) = (equations.own[3 * i + j], equations.combination_of(i)[j]);
                        prop_assert!((slope(at_z(h), at_z(-h), i) - by_z).abs() <= 1e-5 * (1.0 + by_z.abs()), "{face:?}");
                        prop_assert!((slope(at_g(h), at_g(-h), i) - by_g).abs() <= 1e-5 * (1.0 + by_g.abs()), "{face:?}");
                    }
                }
            }
        }
    }
}
