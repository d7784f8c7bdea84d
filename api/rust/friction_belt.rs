//! A mass on a spring and a moving belt with friction, given by Rust functions: `cargo run --release --example
//! friction_belt`.
//!
//! In the plane of displacement and speed, the motion ends on a circle around `x = f/k`, the displacement at which
//! the spring balances the friction; the radius of the circle is the belt speed over the frequency.

use dvi::{Problem, Set, Settings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let radius = radius_of_cycle(1.0, 1.0, 0.5)?;
    println!("radius of the cycle: {radius}, by theory 0.5");
    Ok(())
}

/// Returns the radius of the limit cycle of a unit mass on the belt, from a run of 40 units of time.
pub fn radius_of_cycle(stiffness: f64, friction: f64, speed: f64) -> Result<f64, Box<dyn std::error::Error>> {
    let belt = Problem::new()
        .state("x", 4.0)
        .state("v", 0.0)
        .variables(&["F"], Set::Box { lower: -friction, upper: friction })
        .equations(move |_t, x, z, rates, inequality| {
            rates[0] = x[1];
            rates[1] = -stiffness * x[0] - z[0];
            inequality[0] = speed - x[1];
        });
    let solution = belt.solve(40.0, &Settings { rtol: 1e-9, ..Settings::default() })?;

    for event in solution.trajectory.events.iter().take(5) {
        println!("t = {:.9}: {} {:?}", event.t, event.of, event.kind);
    }
    println!("trusted: {}; of functions, it cannot be proven that", solution.verdict.trusted);
    for caveat in &solution.verdict.caveats {
        println!("- {}", caveat.message);
    }
    let end = |name: &str| solution.trajectory.field(name).and_then(<[f64]>::last).copied().ok_or("no such column");
    Ok((end("x")? - friction / stiffness).hypot(end("v")? / stiffness.sqrt()))
}
