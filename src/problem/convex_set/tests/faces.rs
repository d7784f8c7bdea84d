//! Faces, distances and boundedness.

use super::super::{ConvexSet, Face, Polyhedron, Shape, Workspace};

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
    // A pyramid of eight sides, its apex at (0, 0, 1), seen from right above it.
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
