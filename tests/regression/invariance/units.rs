//! An answer is the same in any units: the scenes are written anew in units from 1e-9 to 1e9 of the plain ones, with
//! absolute tolerances that follow, and states, events and verdict are compared after they are scaled back.

use super::scenes::{MultibodySystem, SCENES, Units, unit};
use super::{Answer, incomplete, solve};
use crate::known::{Failure, Known, assert_known};

/// The scales of one unit, the others as they are.
const SCALES: [f64; 4] = [1e-9, 1e-3, 1e4, 1e9];

/// Units that are scaled together.
const MIXED: [Units; 3] = [[1e9, 1e-6, 1e3], [1e-6, 1e6, 1e-6], [1e-3, 1e-3, 1e9]];

/// What depends on the units.
const KNOWN: Known = &[];

/// The units to try, each with a name.
fn units(scene: &MultibodySystem) -> Vec<(String, Units)> {
    let single = (0..3).flat_map(|axis| {
        SCALES.map(|scale| {
            let mut units = [1.0; 3];
            units[axis] = scale;
            (format!("{} {scale:e}", scene.axes[axis]), units)
        })
    });
    let mixed = MIXED.map(|units| (format!("units {:e} {:e} {:e}", units[0], units[1], units[2]), units));
    single.chain(mixed).collect()
}

fn answer(scene: &MultibodySystem, units: Units) -> Result<Answer, String> {
    let (specification, end) = scene.specification(units, 21, 1.0);
    let solution = solve(&specification)?;
    if let Some(cause) = incomplete(&solution) {
        return Err(cause);
    }
    let of: Vec<f64> = scene.fields.iter().map(|(_, dimension)| unit(*dimension, units)).collect();
    Ok(Answer::new(&solution, &of, end))
}

/// How the answer in some units is not the plain one, if it is not: in a word, and with what was measured.
fn difference(scene: &MultibodySystem, plain: &Answer, units: Units) -> Option<(&'static str, String)> {
    let found = match answer(scene, units) {
        Ok(found) => found,
        Err(cause) => return Some(("failed", cause)),
    };
    let distance = plain.distance(&found);
    if let Some(apart) = plain.events_apart(&found, scene.within) {
        return Some(("events", format!("{apart}; states differ by {distance:.1e}")));
    }
    if distance > scene.within || distance.is_nan() {
        return Some(("states", format!("differ by {distance:.1e} where {:.0e} is allowed", scene.within)));
    }
    let same = (plain.trusted, &plain.because) == (found.trusted, &found.because);
    (!same).then(|| ("verdict", format!("{:?}, not {:?}", found.because, plain.because)))
}

#[test]
fn answers_are_the_same_in_all_units() {
    let mut failures = Vec::new();
    for scene in &SCENES {
        let plain = answer(scene, [1.0; 3]).unwrap_or_else(|cause| panic!("{}: {cause}", scene.name));
        for (name, units) in units(scene) {
            if let Some((how, detail)) = difference(scene, &plain, units) {
                let name = format!("{}; {name}", scene.name);
                println!("{name}: {how}, {detail}");
                failures.push(Failure { name, how, detail });
            }
        }
    }
    assert_known("KNOWN in tests/regression/invariance/units.rs", KNOWN, &failures);
}
