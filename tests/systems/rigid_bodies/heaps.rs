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
    // A quarter of the energy is dissipated, and there are more closed contacts than spheres.
    assert!(last < 0.75 * start && most > 150, "{last} of {start}, {most} contacts");
}
