//! Tests of the motion of systems of rigid bodies against closed-form solutions.

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
        group: None,
        motion: None,
        tells_contacts: false,
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

fn scene(bodies: Vec<Body>, friction: f64, restitution: f64) -> MultibodySystem {
    let law = scene::Law { friction, restitution, ..scene::Law::default() };
    let laws = Laws::new(1, vec![law]);
    MultibodySystem {
        gravity: Vector3::new(0.0, 0.0, -G),
        bodies,
        laws,
        cone: Cone::Quadratic,
        joints: Vec::new(),
        apart: Default::default(),
        actions: Vec::new(),
        signals: Signals::default(),
        resolve: false,
        warnings: Vec::new(),
    }
}

fn run(simulation: &mut MoreauStepping<'_>, h: f64, steps: usize) {
    for _ in 0..steps {
        simulation.step(0.0, h, &Control::new()).unwrap();
    }
}

#[test]
fn a_sliding_sphere_comes_to_roll_with_five_sevenths_of_its_speed() {
    let mut ball = sphere(0.1, 1.0, [0.0, 0.0, 0.1]);
    ball.velocity = Vector3::new(2.0, 0.0, 0.0);
    let scene = scene(vec![ground(Vector3::z()), ball], 0.3, 0.0);
    let mut simulation = MoreauStepping::new(&scene, 0.0, &SETTINGS);
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
    let mut simulation = MoreauStepping::new(&scene, 0.0, &SETTINGS);
    for _ in 0..500 {
        simulation.step(0.0, 1e-3, &Control::new()).unwrap();
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
        let mut simulation = MoreauStepping::new(&scene, 0.0, &SETTINGS);
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

/// Returns a system of spheres in a square array on a movable tray, which lies on the ground.
fn on_a_tray(rows: u32) -> MultibodySystem {
    let mut bodies = vec![ground(Vector3::z())];
    let tray = Polyhedron::cuboid(Vector3::new(100.0, 100.0, 1.0));
    bodies.push(body(Shape::Polyhedron(tray), 10.0, [0.0, 0.0, 0.5]));
    let at = |k: u32| 2.5 * f64::from(k) - 20.0;
    let places = (0..rows * rows).map(|k| [at(k / rows), at(k % rows), 2.0]);
    bodies.extend(places.map(|at| sphere(1.0, 1.0, at)));
    scene(bodies, 0.3, 0.0)
}

#[test]
fn contacts_at_the_start_are_counted_as_a_step_finds_them() {
    let scene = on_a_tray(4);
    let load = scene.load(usize::MAX, &Control::new()).unwrap();
    // The contacts are those of the tray's four corners with the ground and of the sixteen spheres with the tray.
    assert_eq!((load.contacts, load.most_touched()), (20, Some((1, 20))));
    let mut simulation = MoreauStepping::new(&scene, 0.0, &SETTINGS);
    simulation.step(0.0, 1e-3, &Control::new()).unwrap();
    assert_eq!(simulation.contacts.len(), 20);
    // The Delassus matrix has blocks for all pairs of contacts on the tray, and one diagonal block per sphere for its
    // second body.
    let bytes = |blocks| {
        ::contact::law::Size { contacts: 20, blocks, has_factors: true, friction: Some(Cone::Quadratic) }.bytes()
    };
    let law = bytes(20 * 20 + 16);
    let rest = load.bytes() - law;
    assert!(rest < 20 * 2048, "{rest}");
}

#[test]
fn a_step_whose_contacts_would_take_too_much_memory_is_not_made() {
    let scene = on_a_tray(8);
    let mut simulation = MoreauStepping::new(&scene, 0.0, &SETTINGS);
    let needed = scene.load(usize::MAX, &Control::new()).unwrap().bytes();
    simulation.most_memory = needed / 2;
    let heights = |simulation: &MoreauStepping<'_>| -> Vec<f64> {
        simulation.ends.iter().map(|motion| motion.pose.translation.vector.z).collect()
    };
    let before = heights(&simulation);
    let Err(StepFailure::TooMuchMemory { contacts, most_touched: Some((body, of_body)), bytes }) =
        simulation.step(0.0, 1e-3, &Control::new())
    else {
        panic!("a step that takes {needed} bytes")
    };
    assert!((2..68).contains(&contacts) && of_body as usize == contacts && body == 1, "{contacts} {body} {of_body}");
    assert!(bytes > needed / 2 && bytes <= needed, "{bytes} of {needed}");
    assert_eq!(heights(&simulation), before);
}

#[test]
fn islands_count_apart_and_joints_bring_contacts_together() {
    let apart = |count: u32| {
        let balls = (0..count).map(|k| sphere(1.0, 1.0, [3.0 * f64::from(k), 0.0, 1.0]));
        scene([ground(Vector3::z())].into_iter().chain(balls).collect(), 0.3, 0.0)
    };
    let bytes = |scene: &MultibodySystem| scene.load(usize::MAX, &Control::new()).unwrap().bytes();
    // Islands without joints are solved one per thread, so that only a few of them are in memory at a time.
    assert!(bytes(&apart(100)) < 2 * bytes(&apart(50)));
    let mut chained = apart(100);
    for k in 1..100 {
        let at = Vector3::new(3.0 * k as f64 - 1.5, 0.0, 1.0);
        let joint = Joint::new(JointKind::Ball, (k, Some(k + 1)), &chained.bodies, at, Vector3::x_axis());
        chained.joints.push(joint);
    }
    assert!(bytes(&chained) > 10 * bytes(&apart(100)));
}

#[test]
fn nothing_is_detected_nor_assembled_for_one_who_went_away() {
    let scene = on_a_tray(4);
    let control = Control::new();
    control.cancel();
    assert!(scene.load(usize::MAX, &control).is_err());
    let mut simulation = MoreauStepping::new(&scene, 0.0, &SETTINGS);
    assert_eq!(simulation.step(0.0, 1e-3, &control), Err(StepFailure::Interrupted));
    assert_eq!(simulation.resolve(&control), Err(StepFailure::Interrupted));
}
