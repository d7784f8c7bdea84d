//! Every problem, to `1e-8`.

use crate::collection::{natural_map, read};
use dvi::problem::Control;
use dvi::vi::Outcome;
use dvi::vi::coulomb::{Coulomb, Report};
use nalgebra::Vector3;

/// The bound on the relative natural map.
const BOUND: f64 = 1e-8;

fn solve(name: &str) -> Report {
    let instance = read(name);
    let mut r = vec![Vector3::zeros(); instance.problem.contacts()];
    let report = Coulomb::default().solve(&instance.problem, &mut r, &Control::new());
    let residual = natural_map(&instance.problem, &r);
    assert!(residual <= BOUND, "{name}: residual {residual:.1e}, {report:?}");
    assert_eq!(report.outcome, Outcome::Solved, "{name}: {report:?}");
    report
}

macro_rules! solved {
    ($($name:ident)*) => {$(
        #[test]
        fn $name() {
            solve(stringify!($name));
        }
    )*};
}

solved! {
    boxesstack_48
    capsules_286
    confeti_ex03
    fc3d_1c
    lmgc_global00046
    nespheres_10_1
    oneobject_138
    oneobject_316
    periobox_60
    rover1039
    rover11035
}
