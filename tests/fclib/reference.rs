//! The error measure of the FCLIB collection, applied to published contact impulses.

use crate::collection::{document, numbers, problem};
use crate::measure::natural_map;
use dvi::vi::coulomb::Evidence;
use nalgebra::Vector3;

const NAMES: [&str; 11] = [
    "boxesstack_48",
    "capsules_286",
    "confeti_ex03",
    "fc3d_1c",
    "lmgc_global00046",
    "nespheres_10_1",
    "oneobject_138",
    "oneobject_316",
    "periobox_60",
    "rover1039",
    "rover11035",
];

/// The contact impulses that Siconos has computed for a problem of the collection.
fn impulses(name: &str) -> Vec<Vector3<f64>> {
    numbers(&document(name)["reference"]["r"]).chunks_exact(3).map(Vector3::from_column_slice).collect()
}

#[test]
fn impulses_of_other_solvers_satisfy_the_law() {
    for name in NAMES {
        let (problem, reference) = (problem(name), impulses(name));
        let evidence = Evidence::of(&problem, &reference);
        assert!(evidence.relative < 1e-11, "{name}: {evidence:?}");
        let size = reference.iter().map(Vector3::norm).fold(0.0, f64::max);
        assert!(evidence.cone_violation <= 1e-11 * size, "{name}: {evidence:?}");
    }
}

#[test]
fn the_library_measures_as_an_independent_code_does() {
    for name in NAMES {
        let (problem, reference) = (problem(name), impulses(name));
        // Wrong contact impulses: zero, too large, tilted, or pulling.
        for (factor, tilt) in [(0.0, 0.0), (1.3, 0.0), (1.0, 0.9), (-0.5, 0.2)] {
            let r: Vec<_> = reference.iter().map(|r| r * factor + Vector3::new(0.0, tilt * r.x, -r.x * tilt)).collect();
            let (ours, theirs) = (Evidence::of(&problem, &r).relative, natural_map(&problem, &r));
            assert!((ours - theirs).abs() <= 1e-12 * (1.0 + theirs), "{name}: {ours} and {theirs}");
            assert!(ours > 1e-8, "{name}: wrong impulses measure {ours}");
        }
    }
}
