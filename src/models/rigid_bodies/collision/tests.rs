//! Tests of contact points against closed forms and against the collision library.

use super::*;
use crate::rigid_bodies::polyhedron::Polyhedron;
use nalgebra::{Translation3, UnitQuaternion};
use problem::{Control, Interrupted};

fn at(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::translation(x, y, z)
}

fn turned(x: f64, y: f64, z: f64, axis: Vector3<f64>, angle: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(axis), angle);
    Isometry3::from_parts(Translation3::new(x, y, z), turn)
}

fn found(a: Shape, at_a: Isometry3<f64>, b: Shape, at_b: Isometry3<f64>, margin: f64) -> Vec<ContactPoint> {
    let mut points = Vec::new();
    contacts((&Collider::new(a), &at_a), (&Collider::new(b), &at_b), margin, &mut points);
    points
}

fn ground() -> Shape {
    Shape::HalfSpace { normal: Vector3::z() }
}

fn cuboid(a: f64, b: f64, c: f64) -> Shape {
    Shape::Polyhedron(Polyhedron::cuboid(Vector3::new(a, b, c)))
}

#[test]
fn a_sphere_meets_a_plane_below_its_centre() {
    for (first, z) in [(true, 0.09), (false, 0.1 + 1e-9)] {
        let (sphere, place) = (Shape::Sphere { radius: 0.1 }, at(3.0, -2.0, z));
        let points = if first {
            found(sphere, place, ground(), at(0.0, 0.0, 0.0), 0.01)
        } else {
            found(ground(), at(0.0, 0.0, 0.0), sphere, place, 0.01)
        };
        let [point] = points[..] else { panic!("{points:?}") };
        assert!((point.gap - (z - 0.1)).abs() < 1e-16);
        assert_eq!(point.normal, Vector3::z() * if first { -1.0 } else { 1.0 });
        assert!((point.position - Vector3::new(3.0, -2.0, 0.5 * (z - 0.1))).amax() < 1e-15);
    }
}

#[test]
fn spheres_meet_on_the_line_of_their_centres() {
    let points =
        found(Shape::Sphere { radius: 1.0 }, at(0.0, 0.0, 0.0), Shape::Sphere { radius: 2.0 }, at(3.0, 4.0, 0.0), 3.0);
    let [point] = points[..] else { panic!("{points:?}") };
    assert!((point.gap - 2.0).abs() < 1e-15 && (point.normal - Vector3::new(0.6, 0.8, 0.0)).amax() < 1e-15);
    assert!((point.position - Vector3::new(1.2, 1.6, 0.0)).amax() < 1e-15);
}

#[test]
fn a_box_stands_on_four_corners_and_on_those_that_are_near() {
    let points = found(ground(), at(0.0, 0.0, 0.0), cuboid(1.0, 2.0, 0.5), at(0.0, 0.0, 0.5), 0.1);
    assert_eq!(points.len(), 4);
    assert!(points.iter().all(|point| point.gap.abs() < 1e-16));
    let tilted = turned(0.0, 0.0, 1.0, Vector3::y(), 0.3);
    let points = found(ground(), at(0.0, 0.0, 0.0), cuboid(1.0, 2.0, 0.5), tilted, 0.4);
    let lowest = 1.0 - 1.0 * 0.3_f64.sin() - 0.5 * 0.3_f64.cos();
    assert!(points.len() == 2 && points.iter().all(|point| (point.gap - lowest).abs() < 1e-15), "{points:?}");
}

#[test]
fn a_box_on_a_box_touches_in_the_corners_of_the_common_patch() {
    let points = found(cuboid(1.0, 1.0, 1.0), at(0.0, 0.0, 0.0), cuboid(1.0, 1.0, 1.0), at(0.5, 0.25, 2.0), 1e-3);
    let mut corners: Vec<_> = points.iter().map(|p| (p.position.x, p.position.y)).collect();
    corners.sort_by(|a, b| a.partial_cmp(b).unwrap());
    assert_eq!(corners, [(-0.5, -0.75), (-0.5, 1.0), (1.0, -0.75), (1.0, 1.0)]);
    assert!(points.iter().all(|p| p.gap.abs() < 1e-15 && (p.normal - Vector3::z()).amax() < 1e-15));
    let mut ids: Vec<u64> = points.iter().map(|p| p.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), 4);
}

#[test]
fn crossed_edges_touch_in_one_point() {
    // Two cubes, each balanced on an edge, one above the other, with the touching edges crossed at right angles.
    let root = 2.0_f64.sqrt();
    let lower = turned(0.0, 0.0, 0.0, Vector3::x(), std::f64::consts::FRAC_PI_4);
    let upper = turned(0.2, 0.1, 2.0 * root + 1e-7, Vector3::y(), std::f64::consts::FRAC_PI_4);
    let points = found(cuboid(1.0, 1.0, 1.0), lower, cuboid(1.0, 1.0, 1.0), upper, 1e-3);
    let [point] = points[..] else { panic!("{points:?}") };
    assert!((point.gap - 1e-7).abs() < 1e-15 && (point.normal - Vector3::z()).amax() < 1e-15, "{point:?}");
    assert!((point.position - Vector3::new(0.2, 0.0, root + 5e-8)).amax() < 1e-14, "{point:?}");
}

#[test]
fn separating_axes_agree_with_the_library_where_boxes_overlap() {
    let mut tested = 0;
    for k in 0..200 {
        let k = f64::from(k);
        let axis = Vector3::new((1.3 * k).sin(), (0.7 * k).cos(), 0.4);
        let place = turned(1.4 * (0.9 * k).sin(), 1.1 * (1.7 * k).cos(), 1.2, axis, k);
        let (a, b) = (Collider::new(cuboid(1.0, 0.8, 0.6)), Collider::new(cuboid(0.5, 0.7, 0.9)));
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        contacts((&a, &at(0.0, 0.0, 0.0)), (&b, &place), 1e-9, &mut ours);
        library::contacts((&a.parts[0], &at(0.0, 0.0, 0.0)), (&b.parts[0], &place), 1e-9, &mut theirs);
        let depth = |points: &[ContactPoint]| points.iter().map(|p| p.gap).fold(f64::INFINITY, f64::min);
        if depth(&theirs) < -1e-6 {
            tested += 1;
            assert!((depth(&ours) - depth(&theirs)).abs() < 1e-6, "{k}: {ours:?} {theirs:?}");
        }
    }
    assert!(tested > 40, "{tested}");
}

#[test]
fn capsules_touch_once_crossed_and_twice_side_by_side() {
    let capsule = || Shape::Capsule { radius: 0.1, half_height: 1.0 };
    let across = turned(0.3, 0.0, 0.25, Vector3::y(), std::f64::consts::FRAC_PI_2);
    let lying = turned(0.0, 0.0, 0.0, Vector3::x(), std::f64::consts::FRAC_PI_2);
    let [point] = found(capsule(), lying, capsule(), across, 0.1)[..] else { panic!() };
    assert!((point.gap - 0.05).abs() < 1e-15 && (point.normal - Vector3::z()).amax() < 1e-15);
    assert!((point.position - Vector3::new(0.0, 0.0, 0.125)).amax() < 1e-15);
    let points = found(capsule(), at(0.0, 0.0, 0.0), capsule(), at(0.2, 0.0, 0.5), 0.1);
    let mut heights: Vec<f64> = points.iter().map(|p| p.position.z).collect();
    heights.sort_by(f64::total_cmp);
    assert_eq!(heights, [-0.5, 1.0]);
}

#[test]
fn a_cylinder_stands_on_its_rim_and_lies_on_its_side() {
    let cylinder = || Shape::Cylinder { radius: 0.5, half_height: 1.0 };
    let points = found(ground(), at(0.0, 0.0, 0.0), cylinder(), at(0.0, 0.0, 1.0), 1e-3);
    assert!(points.len() == 4 && points.iter().all(|p| p.gap.abs() < 1e-15));
    assert!(points.iter().map(|p| p.position).sum::<Vector3<f64>>().norm() < 1e-14);
    let lying = turned(0.0, 0.0, 0.5, Vector3::y(), std::f64::consts::FRAC_PI_2);
    let points = found(ground(), at(0.0, 0.0, 0.0), cylinder(), lying, 1e-3);
    assert!(points.len() == 2 && points.iter().all(|p| p.gap.abs() < 1e-15), "{points:?}");
}

#[test]
fn a_sphere_meets_the_side_the_base_and_the_rim_of_a_cylinder() {
    let cylinder = || Shape::Cylinder { radius: 1.0, half_height: 2.0 };
    let cases = [
        (Vector3::new(2.0, 0.0, 1.0), Vector3::x(), 0.5),
        (Vector3::new(0.0, 0.5, -3.0), -Vector3::z(), 0.5),
        (Vector3::new(0.0, 1.3, 2.4), Vector3::new(0.0, 0.6, 0.8), 0.0),
    ];
    for (centre, normal, gap) in cases {
        let place = Isometry3::from_parts(centre.into(), UnitQuaternion::identity());
        let [point] = found(cylinder(), at(0.0, 0.0, 0.0), Shape::Sphere { radius: 0.5 }, place, 1.0)[..] else {
            panic!()
        };
        assert!((point.gap - gap).abs() < 1e-15 && (point.normal - normal).amax() < 1e-15, "{point:?}");
    }
}

#[test]
fn a_mesh_holds_spheres_and_boxes_up() {
    let corners = [[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]].map(|[x, y]| Vector3::new(x, y, 0.0));
    let mesh = || Shape::mesh(&corners, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
    let points = found(mesh(), at(0.0, 0.0, 0.0), Shape::Sphere { radius: 0.5 }, at(1.0, 0.3, 0.499), 0.01);
    assert!(!points.is_empty());
    for point in points {
        assert!((point.gap + 1e-3).abs() < 1e-12 && (point.normal - Vector3::z()).amax() < 1e-9, "{point:?}");
    }
    let points = found(mesh(), at(0.0, 0.0, 0.0), cuboid(0.5, 0.5, 0.5), at(2.0, 0.3, 0.499), 0.01);
    assert!(points.len() >= 4 && points.iter().all(|p| (p.gap + 1e-3).abs() < 1e-9), "{points:?}");
}

#[test]
fn the_sweep_finds_the_pairs_that_overlap_and_no_others() {
    let centre = |k: usize| Vector3::new((1.7 * k as f64).sin(), (2.9 * k as f64).cos(), (0.3 * k as f64).sin()) * 3.0;
    let bounds = |k: usize| (centre(k) - Vector3::repeat(0.4), centre(k) + Vector3::repeat(0.4));
    let moves = |k: usize| !k.is_multiple_of(5);
    let mut pairs = Vec::new();
    let mut sweep = BroadPhase::default();
    for _ in 0..2 {
        pairs.clear();
        let found = |a, b| {
            pairs.push((a, b));
            Ok::<(), Interrupted>(())
        };
        sweep.sweep(100, bounds, moves, &Control::new(), found).unwrap();
        pairs.sort_unstable();
        let near = |i: usize, j: usize| (centre(i) - centre(j)).amax() <= 0.8 && (moves(i) || moves(j));
        let expected: Vec<(u32, u32)> = (0..100)
            .flat_map(|i| (i + 1..100).filter(move |&j| near(i, j)).map(move |j| (i as u32, j as u32)))
            .collect();
        assert_eq!(pairs, expected);
        assert!(pairs.len() > 20);
    }
}
