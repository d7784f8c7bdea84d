//! Each frictional contact problem of the FCLIB collection is solved to the relative error `1e-8`.

use crate::collection::problem;
use crate::measure::natural_map;
use dvi::problem::Control;
use dvi::vi::Outcome;
use dvi::vi::coulomb::Coulomb;
use nalgebra::Vector3;

/// Upper bound of the relative residual of the natural map at the computed impulses.
const BOUND: f64 = 1e-8;

fn solve(name: &str) {
    let problem = problem(name);
    let mut r = vec![Vector3::zeros(); problem.contacts()];
    let report = Coulomb::default().solve(&problem, &mut r, &Control::new());
    let residual = natural_map(&problem, &r);
    assert!(residual <= BOUND, "{name}: residual {residual:.1e}, {report:?}");
    assert_eq!(report.outcome, Outcome::Solved, "{name}: {report:?}");
    // The errors of the Signorini condition and of the friction law, each relative to the largest impulses and
    // velocities in it.
    let u: Vec<_> = (0..r.len()).map(|k| problem.velocity(k, &r)).collect();
    let largest = |v: &[Vector3<f64>]| v.iter().chain(problem.q()).map(Vector3::norm).fold(0.0, f64::max);
    let (r_size, u_size) = (largest(&r), largest(&u));
    let evidence = report.evidence;
    assert!(evidence.signorini <= BOUND * r_size.max(u_size), "{name}: {evidence:?}");
    assert!(evidence.cone_violation <= BOUND * r_size, "{name}: {evidence:?}");
    assert!(evidence.dissipation_gap <= BOUND * r_size * u_size, "{name}: {evidence:?}");
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
