//! The energy of contact runs: the defect of the energy balance of every example that has one, with tolerances and with
//! fixed steps.

use problem::Control;
use serde::{Deserialize, Serialize};
use solution::Status;
use specification::{By, EXAMPLES, Rung, Specification};
use std::time::{Duration, Instant};

/// Relative tolerances of the runs with adaptive steps.
const TOLERANCES: [f64; 2] = [1e-5, 1e-8];
/// Numbers of fixed steps over the horizon, of the runs with fixed steps.
const STEPS: [f64; 2] = [1e3, 1e4];
/// Time limit of one run, whose energy balance is measured.
const LONGEST: Duration = Duration::from_secs(5);

/// The energy balance of one run.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Balance {
    /// The name of the example system.
    pub name: String,
    /// The tolerance or step size of the run, as text.
    pub how: String,
    /// The status of the run: completed, stopped or failed.
    pub status: Status,
    /// The largest defect of the energy balance, relative to the largest of the energies at the ends of the run and the
    /// work of the forces.
    pub defect: f64,
    /// The largest energy gain of a step in impacts, relative to the largest kinetic energy.
    pub gain_in_impacts: f64,
}

/// Returns the energy balances of runs of every example that has one.
pub fn balances() -> Vec<Balance> {
    EXAMPLES.iter().flat_map(|example| of_example(example.name, example.text)).collect()
}

fn of_example(name: &str, text: &str) -> Vec<Balance> {
    let Ok(specification) = Specification::from_json(text.as_bytes()) else { return Vec::new() };
    let horizon = specification.time().end - specification.time().start;
    let rungs = specification.model().varied().balances.iter().flat_map(|by| match by {
        By::Tolerance => TOLERANCES.map(Rung::Tolerance),
        By::Step => STEPS.map(|steps| Rung::Step(horizon / steps)),
    });
    rungs.map_while(|rung| balance(name, &specification, rung)).collect()
}

/// Returns the energy balance of one run at the accuracy setting `rung`; `None` if the problem has none.
fn balance(name: &str, specification: &Specification, rung: Rung) -> Option<Balance> {
    let end = specification.time().end;
    let variant = specification.variant(rung, specification.method().stages, vec![end], Vec::new());
    let solution = crate::solve(&variant, &Control::with_deadline(Instant::now() + LONGEST));
    let energy = solution.diagnostics.energy?;
    let ends = [energy.kinetic_at_start, energy.potential_at_start, energy.kinetic_at_end, energy.potential_at_end];
    let size = ends.iter().fold(energy.work_of_forces.abs(), |size, part| size.max(part.abs()));
    let how = match rung {
        Rung::Tolerance(rtol) => format!("tolerance {rtol:e}"),
        Rung::Step(step) => format!("step {step:e}"),
    };
    Some(Balance {
        name: name.to_owned(),
        how,
        status: solution.status,
        defect: energy.largest_defect / if size > 0.0 { size } else { 1.0 },
        gain_in_impacts: energy.largest_gain_in_impacts,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impacts_of_a_ball_gain_nothing_and_its_balance_closes_with_the_tolerance() {
        let example = EXAMPLES.iter().find(|example| example.name == "bouncing_ball").expect("an example");
        let found = of_example(example.name, example.text);
        assert_eq!(found.len(), TOLERANCES.len() + STEPS.len());
        assert!(found.iter().all(|balance| balance.gain_in_impacts < 1e-12), "{found:?}");
        assert!(found[1].defect < 1e-8 && found[3].defect < 0.5 * found[2].defect, "{found:?}");
        let relay = EXAMPLES.iter().find(|example| example.name == "relay").expect("an example");
        assert!(of_example(relay.name, relay.text).is_empty());
    }
}
