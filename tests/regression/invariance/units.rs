//! Results are the same in any units: each scene is written in units from 1e-9 to 1e9 of the reference units, with
//! absolute tolerances in proportion; states, events and verdict are compared after conversion to the reference
//! units.

use super::scenes::{MultibodySystem, SCENES, Units, unit};
use super::{Answer, incomplete, solve};
use crate::known::{Failure, Known, assert_known};

/// The factors by which one base unit of a scene is scaled while the other two are unchanged.
const SCALES: [f64; 4] = [1e-9, 1e-3, 1e4, 1e9];

/// Scalings of all three base units of a scene at once.
const MIXED: [Units; 3] = [[1e9, 1e-6, 1e3], [1e-6, 1e6, 1e-6], [1e-3, 1e-3, 1e9]];

/// Scenes whose results are known to depend on the units, each with the keyword of the failure.
const KNOWN: Known = &[];

/// Returns the scaled base units in which a scene is tested, each with a name.
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

/// Returns how the result in scaled units differs from that in the reference units, if it does: as a keyword, and
/// with the measured difference.
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
