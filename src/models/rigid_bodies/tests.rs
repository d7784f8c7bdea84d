//! Bodies in motion against closed forms.

use super::collision::Collider;
use super::*;
use ::contact::law::Cone;
use ::contact::{ImpactLaw, Settings};
use nalgebra::{Isometry3, Matrix3, Vector3};
use problem::Control;

const G: f64 = 9.81;

const SETTINGS: Settings =
    Settings { step: 1e-3, default_step: false, impact_law: ImpactLaw::Simultaneous, tolerance: 1e-10 };

fn body(shape: Shape, mass: f64, at: [f64; 3]) -> Body {
    let (volume, centre, second) = shape.moments().unwrap();
    assert!(centre.norm() < 1e-12);
    let second = second / volume;
    Body {
        name: String::new(),
        collider: Collider::new(shape),
        material: 0,
        fixed: false,
        mass,
        inertia: (Matrix3::from_diagonal_element(second.trace()) - second) * mass,
        centre: Vector3::zeros(),
        pose: Isometry3::translation(at[0], at[1], at[2]),
        velocity: Vector3::zeros(),
        omega: Vector3::zeros(),
    }
}

fn ground(normal: Vector3<f64>) -> Body {
    let shape = Shape::HalfSpace { normal };
    Body {
        fixed: true,
        collider: Collider::new(shape),
        mass: 0.0,
        ..body(Shape::Sphere { radius: 1.0 }, 1.0, [0.0; 3])
    }
}

fn sphere(radius: f64, mass: f64, at: [f64; 3]) -> Body {
    body(Shape::Sphere { radius }, mass, at)
}

fn cube(side: f64, mass: f64, at: [f64; 3]) -> Body {
    body(Shape::Polyhedron(Polyhedron::cuboid(Vector3::repeat(0.5 * side))), mass, at)
}

fn scene(bodies: Vec<Body>, friction: f64, restitution: f64) -> Scene {
    let laws = Laws::of_materials(&[scene::Law { friction, restitution }]);
    Scene {
        gravity: Vector3::new(0.0, 0.0, -G),
        bodies,
        laws,
        cone: Cone::Quadratic,
        joints: Vec::new(),
        resolve: false,
        warnings: Vec::new(),
    }
}

fn run(simulation: &mut Simulation<'_>, h: f64, steps: usize) {
    for _ in 0..steps {
        simulation.step(h, &Control::new()).unwrap();
    }
}

#[test]
fn a_sliding_sphere_comes_to_roll_with_five_sevenths_of_its_speed() {
    let mut ball = sphere(0.1, 1.0, [0.0, 0.0, 0.1]);
    ball.velocity = Vector3::new(2.0, 0.0, 0.0);
    let scene = scene(vec![ground(Vector3::z()), ball], 0.3, 0.0);
    let mut simulation = Simulation::new(&scene, &SETTINGS);
    run(&mut simulation, 1e-3, 1000);
    let motion = simulation.ends[0];
    assert!((motion.velocity.x - 10.0 / 7.0).abs() < 1e-10, "{}", motion.velocity);
    assert!((motion.omega.y - 100.0 / 7.0).abs() < 1e-9);
    assert!((motion.pose.translation.x - 1.4840472376514315).abs() < 1e-3);
    assert!((motion.pose.translation.z - 0.1).abs() < 1e-10);
}

#[test]
fn a_fast_sliding_sphere_never_lifts_off() {
    let mut ball = sphere(0.1, 1.0, [0.0, 0.0, 0.1]);
    ball.velocity = Vector3::new(10.0, 0.0, 0.0);
    let scene = scene(vec![ground(Vector3::z()), ball], 0.3, 0.0);
    let mut simulation = Simulation::new(&scene, &SETTINGS);
    for _ in 0..500 {
        simulation.step(1e-3, &Control::new()).unwrap();
        assert!((simulation.ends[0].pose.translation.z - 0.1).abs() < 1e-10);
    }
    assert!((simulation.ends[0].velocity.x - 8.5285).abs() < 1e-9);
}

#[test]
fn a_stack_with_a_heavy_top_stands_still() {
    for load in [1.0, 1e3, 1e6] {
        let mut bodies = vec![ground(Vector3::z())];
        bodies.extend((0..10).map(|k| cube(1.0, if k == 9 { load } else { 1.0 }, [0.0, 0.0, 0.5 + f64::from(k)])));
        let scene = scene(bodies, 0.6, 0.0);
        let mut simulation = Simulation::new(&scene, &SETTINGS);
        let clock = std::time::Instant::now();
        run(&mut simulation, 1e-3, 2000);
        eprintln!("load {load}: {:?}, residual {:e}", clock.elapsed() / 2000, simulation.report.residual);
        for (k, motion) in simulation.ends.iter().enumerate() {
            let at = motion.pose.translation.vector;
            assert!((at.z - 0.5 - k as f64).abs() < 1e-6, "load {load}, cube {k}: {at}");
            assert!(at.xy().norm() < 1e-8, "load {load}, cube {k}: {at:?}");
        }
    }
}
