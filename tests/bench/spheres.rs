//! A thousand spheres settle in a box: time a step, depth of overlaps, residual of the contact law, over three seconds,
//! each against its bar. `cargo bench --bench spheres -- 5` has five spheres a side instead of ten.
//!
//! Layers of spheres of radius 0.1 m start in a loose grid, each a little off its place, and fall between four walls;
//! friction 0.5, no restitution, steps of 2 ms. The residual is the relative natural map of Coulomb's law,
//! `|r - P_K(r - u - mu |u_t| n)|` over the largest of `|q|`, `|r|` and `|u|`.

use dvi::contact::law::Cone;
use dvi::contact::{ImpactLaw, Settings};
use dvi::models::rigid_bodies::{Body, Collider, Law, Laws, Scene, Shape, Simulation};
use dvi::problem::Control;
use nalgebra::{Isometry3, Matrix3, Vector3};
use std::time::Instant;

const RADIUS: f64 = 0.1;
const H: f64 = 2e-3;
const SETTINGS: Settings =
    Settings { step: H, default_step: false, impact_law: ImpactLaw::Simultaneous, tolerance: 1e-6 };

fn body(shape: Shape, at: Vector3<f64>, mass: f64) -> Body {
    Body {
        name: String::new(),
        collider: Collider::new(shape),
        material: 0,
        fixed: mass == 0.0,
        mass,
        inertia: Matrix3::from_diagonal_element(0.4 * mass * RADIUS * RADIUS),
        centre: Vector3::zeros(),
        pose: Isometry3::translation(at.x, at.y, at.z),
        velocity: Vector3::zeros(),
        omega: Vector3::zeros(),
    }
}

fn scene(side: usize) -> Scene {
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
    let laws = Laws::of_materials(&[Law { friction: 0.5, restitution: 0.0 }]);
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    Scene { gravity, bodies, laws, cone: Cone::Quadratic, joints: Vec::new(), resolve: false, warnings: Vec::new() }
}

/// What a step is to keep: milliseconds, the deepest overlap in radii, the residual.
const BARS: [f64; 3] = [30.0, 1e-4, 1e-6];

fn main() {
    let side = std::env::args().find_map(|argument| argument.parse().ok()).unwrap_or(10);
    let scene = scene(side);
    let mut simulation = Simulation::new(&scene, &SETTINGS);
    println!("{} spheres; bars: {} ms a step, depth {:.0e} R, residual {:.0e}", side.pow(3), BARS[0], BARS[1], BARS[2]);
    println!(
        "{:>6} {:>9} {:>9} {:>9} {:>9} {:>10} {:>10}",
        "t/s", "ms/step", "worst/ms", "contacts", "depth/R", "residual", "median"
    );
    let control = Control::new();
    let mut within = [0; 3];
    let mut steps = 0;
    for tenth in 1..=30 {
        let (mut times, mut residuals, mut depth) = (Vec::new(), Vec::new(), 0.0_f64);
        for _ in 0..50 {
            let clock = Instant::now();
            simulation.step(H, &control).expect("the spheres go on");
            times.push(clock.elapsed().as_secs_f64() * 1e3);
            residuals.push(simulation.report.residual);
            let overlap = simulation.report.penetration / RADIUS;
            depth = depth.max(overlap);
            steps += 1;
            for (within, (value, bar)) in
                within.iter_mut().zip([times[times.len() - 1], overlap, simulation.report.residual].iter().zip(&BARS))
            {
                *within += usize::from(value <= bar);
            }
        }
        times.sort_by(f64::total_cmp);
        residuals.sort_by(f64::total_cmp);
        println!(
            "{:>6.1} {:>9.2} {:>9.2} {:>9} {:>9.1e} {:>10.1e} {:>10.1e}",
            f64::from(tenth) * 0.1,
            times.iter().sum::<f64>() / times.len() as f64,
            times[times.len() - 1],
            simulation.report.closed,
            depth,
            residuals[residuals.len() - 1],
            residuals[residuals.len() / 2]
        );
    }
    for (name, within) in ["time", "depth", "residual"].iter().zip(within) {
        println!("{name} within its bar in {:.1} % of the steps", 100.0 * f64::from(within as u32) / f64::from(steps));
    }
}
