//! A thousand spheres settle in a box: the time per step, the depth of penetration and the residual of the contact
//! law, over three seconds, each compared with its bound. Residuals are those of the law that is solved, which has a
//! proximal term if there are many contacts, and of Coulomb's law itself. `cargo bench --bench spheres -- 5` has five
//! spheres per side instead of ten.
//!
//! A residual is the relative natural map of the law, `|r - P_K(r - u - mu |u_t| n)|` over the largest of `|q|`,
//! `|r|` and `|u|`.

#[path = "../systems/rigid_bodies/heap.rs"]
mod heap;

use dvi::models::rigid_bodies::MoreauStepping;
use dvi::problem::Control;
use heap::{H, RADIUS, SETTINGS};
use std::time::Instant;

/// Upper bounds for each step: the time in milliseconds, the deepest penetration in radii, and the residual of the
/// contact law.
const BARS: [f64; 3] = [30.0, 1e-4, 1e-6];

fn main() {
    let side = std::env::args().find_map(|argument| argument.parse().ok()).unwrap_or(10);
    let scene = heap::scene(side);
    let mut simulation = MoreauStepping::new(&scene, 0.0, &SETTINGS);
    println!(
        "{} spheres; bars: {} ms a step, depth {:.0e} R, residual of the solved law {:.0e}",
        side.pow(3),
        BARS[0],
        BARS[1],
        BARS[2]
    );
    println!(
        "{:>6} {:>9} {:>9} {:>9} {:>9} {:>10} {:>10} {:>10}",
        "t/s", "ms/step", "median/ms", "contacts", "depth/R", "solved", "Coulomb", "median"
    );
    let control = Control::new();
    let mut within = [0; 3];
    let mut steps = 0;
    for tenth in 1..=30 {
        let (mut times, mut residuals, mut depth, mut largest) = (Vec::new(), Vec::new(), 0.0_f64, 0.0_f64);
        for _ in 0..50 {
            let clock = Instant::now();
            simulation.step(0.0, H, &control).expect("the spheres go on");
            times.push(clock.elapsed().as_secs_f64() * 1e3);
            residuals.push(simulation.report.residual);
            let solved = simulation.report.proximal_residual.unwrap_or(simulation.report.residual);
            largest = largest.max(solved);
            let overlap = simulation.report.penetration / RADIUS;
            depth = depth.max(overlap);
            steps += 1;
            for (within, (value, bar)) in
                within.iter_mut().zip([times[times.len() - 1], overlap, solved].iter().zip(&BARS))
            {
                *within += usize::from(value <= bar);
            }
        }
        times.sort_by(f64::total_cmp);
        residuals.sort_by(f64::total_cmp);
        println!(
            "{:>6.1} {:>9.2} {:>9.2} {:>9} {:>9.1e} {:>10.1e} {:>10.1e} {:>10.1e}",
            f64::from(tenth) * 0.1,
            times.iter().sum::<f64>() / times.len() as f64,
            times[times.len() / 2],
            simulation.report.closed,
            depth,
            largest,
            residuals[residuals.len() - 1],
            residuals[residuals.len() / 2]
        );
    }
    for (name, within) in ["time", "depth", "residual"].iter().zip(within) {
        println!("{name} within its bar in {:.1} % of the steps", 100.0 * f64::from(within as u32) / f64::from(steps));
    }
}
