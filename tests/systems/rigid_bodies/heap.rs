//! A heap of spheres: layers of radius 0.1 m that start in a loose grid with small random displacements, and fall
//! between four walls; friction 0.5, no restitution, steps of 2 ms.

use dvi::contact::law::Cone;
use dvi::contact::{ImpactLaw, Settings};
use dvi::models::rigid_bodies::{Body, Collider, Law, Laws, MultibodySystem, Shape, Signals};
use nalgebra::{Isometry3, Matrix3, Vector3};
use std::collections::HashSet;

/// Radius of every sphere of the heap, in metres.
pub const RADIUS: f64 = 0.1;

/// Time step of every run of the heap, in seconds.
pub const H: f64 = 2e-3;

/// Settings of the time stepping in every run of the heap.
pub const SETTINGS: Settings =
    Settings { step: H, default_step: false, impact_law: ImpactLaw::Simultaneous, tolerance: 1e-6 };

fn body(shape: Shape, at: Vector3<f64>, mass: f64) -> Body {
    Body {
        name: String::new(),
        collider: Collider::new(shape),
        material: 0,
        fixed: mass == 0.0,
        tells_contacts: false,
        motion: None,
        group: None,
        mass,
        inertia: Matrix3::from_diagonal_element(0.4 * mass * RADIUS * RADIUS),
        centre: Vector3::zeros(),
        pose: Isometry3::translation(at.x, at.y, at.z),
        velocity: Vector3::zeros(),
        omega: Vector3::zeros(),
    }
}

/// A heap with `side` spheres in each of the three directions, between its ground and walls.
pub fn scene(side: usize) -> MultibodySystem {
    let mut random = 1_u64;
    let mut jitter = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((random >> 33) as f64 / f64::from(u32::MAX >> 1) - 0.5) * 0.2 * RADIUS
    };
    let width = 2.2 * RADIUS * side as f64;
    let mut bodies = vec![
        body(Shape::HalfSpace { normal: Vector3::z() }, Vector3::zeros(), 0.0),
        body(Shape::HalfSpace { normal: Vector3::x() }, Vector3::zeros(), 0.0),
        body(Shape::HalfSpace { normal: Vector3::y() }, Vector3::zeros(), 0.0),
        body(Shape::HalfSpace { normal: -Vector3::x() }, Vector3::x() * width, 0.0),
        body(Shape::HalfSpace { normal: -Vector3::y() }, Vector3::y() * width, 0.0),
    ];
    for k in 0..side * side * side {
        let place = Vector3::new((k % side) as f64, (k / side % side) as f64, (k / side / side) as f64);
        let at = (place * 2.2 + Vector3::repeat(1.1)) * RADIUS + Vector3::new(jitter(), jitter(), jitter() + 0.1);
        bodies.push(body(Shape::Sphere { radius: RADIUS }, at, 1.0));
    }
    let law = Law { friction: 0.5, ..Law::default() };
    let laws = Laws::new(1, vec![law]);
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    MultibodySystem {
        gravity,
        bodies,
        laws,
        cone: Cone::Quadratic,
        apart: HashSet::new(),
        joints: Vec::new(),
        actions: Vec::new(),
        signals: Signals::default(),
        resolve: false,
        warnings: Vec::new(),
    }
}
