//! Simultaneous impacts of many spheres: the contact law is satisfied in every step, and bodies neither penetrate each
//! other nor gain energy.

use super::heap::{H, RADIUS, SETTINGS, scene};
use dvi::models::rigid_bodies::MoreauStepping;
use dvi::problem::Control;

#[test]
fn a_heap_of_spheres_that_falls_obeys_the_law_in_every_step() {
    let scene = scene(5);
    let mut simulation = MoreauStepping::new(&scene, 0.0, &SETTINGS);
    let mut last: f64 = simulation.energies().iter().sum();
    let (start, mut most) = (last, 0);
    for step in 0..250 {
        simulation.step(0.0, H, &Control::new()).expect("the spheres go on");
        let (report, energy) = (simulation.report, simulation.energies().iter().sum());
        assert!(report.residual <= SETTINGS.tolerance, "step {step}: {report:?}");
        assert!(report.penetration <= 1e-6 * RADIUS, "step {step}: {report:?}");
        assert!(energy <= last + 1e-9 * start, "step {step}: energy {last} becomes {energy}");
        (last, most) = (energy, most.max(report.closed));
    }
    // The heap has lost a quarter of its energy, and has more closed contacts than spheres.
    assert!(last < 0.75 * start && most > 150, "{last} of {start}, {most} contacts");
}

/// A heap with more contacts in one island (a set of bodies connected by contacts) than the solver factorises as a
/// whole, so that it satisfies the contact law with a proximal term. Momentum is balanced nevertheless: the ground
/// carries the weight, and any impulse that it lacks appears as a change of the spheres' momentum.
#[test]
fn a_large_heap_obeys_the_law_that_is_solved_and_stands_on_its_ground() {
    let scene = scene(8);
    let mut simulation = MoreauStepping::new(&scene, 0.0, &SETTINGS);
    let energy = |simulation: &MoreauStepping<'_>| -> f64 { simulation.energies().iter().sum() };
    let (start, mut last, mut most) = (energy(&simulation), energy(&simulation), 0);
    for step in 0..400 {
        simulation.step(0.0, H, &Control::new()).expect("the spheres go on");
        let (report, now) = (simulation.report, energy(&simulation));
        let solved = report.proximal_residual.unwrap_or(report.residual);
        assert!(solved <= SETTINGS.tolerance, "step {step}: {report:?}");
        assert!(report.residual <= 5e-3, "step {step}: {report:?}");
        assert!(report.penetration <= 1e-4 * RADIUS, "step {step}: {report:?}");
        assert!(now <= last + 1e-6 * start, "step {step}: energy {last} becomes {now}");
        (last, most) = (now, most.max(report.closed));
    }
    assert!(most > 700, "{most} contacts");
    // Compares the impulses of the ground and the walls over fifty steps with the change of the vertical momentum.
    let momentum = |simulation: &MoreauStepping<'_>| -> f64 {
        let bodies = 0..scene.bodies.len();
        bodies.filter_map(|body| simulation.motion(body)).map(|motion| motion.mass * motion.velocity.z).sum()
    };
    let (before, mut carried) = (momentum(&simulation), 0.0);
    for _ in 0..50 {
        simulation.step(0.0, H, &Control::new()).expect("the spheres go on");
        for contact in simulation.contacts.iter().filter(|contact| contact.bodies[0].is_none()) {
            carried += contact.frame.tr_mul(&contact.impulse).z;
        }
    }
    let weight = 512.0 * 9.81 * 50.0 * H;
    let missing = carried - weight - (momentum(&simulation) - before);
    assert!(missing.abs() <= 1e-6 * weight, "{carried} carried of {weight}, {missing} not accounted for");
}
