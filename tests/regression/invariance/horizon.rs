//! The solution up to a time does not depend on how long the run goes on: the scenes are solved to their end and to a
//! hundred times their end, with the same output times, and states and events up to the end are compared.

use super::scenes::{MultibodySystem, SCENES, Tolerances};
use super::{Answer, solve};
use crate::known::{Failure, Known, assert_known};

/// Factor between the end times of the longer and the shorter run of a scene.
const BEYOND: f64 = 100.0;

/// Scenes whose results are known to depend on the horizon, each with the keyword of the failure.
const KNOWN: Known = &[("rigid bodies, default step: ball thrown with spin", "events")];

/// Fraction of the scene's end time up to which events are compared: an event at the end itself may occur in only one
/// of the two runs.
const BEFORE: f64 = 1.0 - 1e-6;

/// Returns the results up to the end time of the scene, from a run to `beyond` times that time.
fn answer(scene: &MultibodySystem, beyond: f64) -> Result<Answer, String> {
    let (specification, end) = scene.specification([1.0; 3], 21, beyond);
    let mut solution = solve(&specification)?;
    if let Some(error) = solution.error.as_ref().filter(|error| error.time < end) {
        return Err(format!("{} at t = {:e}", error.code, error.time));
    }
    solution.trajectory.events.retain(|event| event.t <= BEFORE * end);
    Ok(Answer::new(&solution, &vec![1.0; scene.fields.len()], end))
}

/// Returns how the longer run differs from the shorter one up to the end of the scene, if it does: as a keyword, and
/// with the measured difference.
fn difference(scene: &MultibodySystem, short: &Answer) -> Option<(&'static str, String)> {
    let long = match answer(scene, BEYOND) {
        Ok(long) => long,
        Err(cause) => return Some(("failed", cause)),
    };
    let distance = short.distance(&long);
    if let Some(apart) = short.events_apart(&long, scene.within) {
        return Some(("events", format!("{apart}; states differ by {distance:.1e}")));
    }
    // With fixed steps the shorter and the longer run make the same steps, so that results must agree to the last bit.
    let allowed = if matches!(scene.tolerances, Tolerances::None) { 0.0 } else { scene.within };
    (distance > allowed || distance.is_nan())
        .then(|| ("states", format!("differ by {distance:.1e} where {allowed:.0e} is allowed")))
}

#[test]
fn answers_do_not_depend_on_the_horizon() {
    let mut failures = Vec::new();
    for scene in &SCENES {
        let short = answer(scene, 1.0).unwrap_or_else(|cause| panic!("{}: {cause}", scene.name));
        if let Some((how, detail)) = difference(scene, &short) {
            println!("{}: {how}, {detail}", scene.name);
            failures.push(Failure { name: scene.name.to_owned(), how, detail });
        }
    }
    assert_known("KNOWN in tests/regression/invariance/horizon.rs", KNOWN, &failures);
}
