//! Measures the order of Radau IIA methods over a switch: a mass on a spring and a rough floor reverses at `t = pi`.
//! `cargo run --release --example order`.
//!
//! Until the reversal, the mass moves around the centre 1, and afterwards around -1: at `t = 3 pi/2` it passes -1
//! with the speed 1/2.

use dvi::{Problem, Set, Settings};
use std::f64::consts::PI;

/// For each Radau IIA method, its number of stages, a step size below which the theoretical order is observed, and that
/// order.
pub const LADDERS: [(usize, f64, f64); 3] = [(1, 0.01, 1.0), (3, 0.2, 5.0), (5, 0.8, 9.0)];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for (stages, step, order) in LADDERS {
        let errors = [error(stages, step)?, error(stages, step / 2.0)?];
        let measured = (errors[0] / errors[1]).log2();
        println!(
            "{stages} stages: errors {:.1e} and {:.1e}, order {measured:.2}, by theory {order}",
            errors[0], errors[1]
        );
    }
    Ok(())
}

/// Returns the error of position and speed of the mass at `t = 3 pi/2`, after a run with a fixed step size.
pub fn error(stages: usize, step: f64) -> Result<f64, Box<dyn std::error::Error>> {
    let floor = Problem::new()
        .state("x", 3.5)
        .state("v", 0.0)
        .variables(&["F"], Set::Box { lower: -1.0, upper: 1.0 })
        .equations(|_t, x, z, rates, inequality| {
            rates[0] = x[1];
            rates[1] = -x[0] - z[0];
            inequality[0] = -x[1];
        })
        .derivatives(|_t, _x, _z, of| of.copy_from_slice(&[0.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0, -1.0, 0.0]));
    let settings = Settings { stages: Some(stages), step: Some(step), ..Settings::default() };
    let solution = floor.solve(1.5 * PI, &settings)?;
    let end = |name: &str| solution.trajectory.field(name).and_then(<[f64]>::last).copied().ok_or("no such column");
    Ok((end("x")? + 1.0).hypot(end("v")? - 0.5))
}
