//! Coverage of the 95 % confidence intervals of a fit. `cargo bench --bench fits`.
//!
//! The motion of a mass on a belt, which sticks and then slips, is measured a thousand times with normal errors, and
//! friction and belt speed are fitted to the data: with the standard deviation of the errors given, and without. Of a
//! thousand intervals, 95 % +- 2 % must contain the true value.

use dvi::problem::Control;
use dvi::specification::Specification;
use serde_json::json;
use std::f64::consts::TAU;

const FITS: u64 = 1000;
/// True values of the friction bound and of the belt speed.
const EXACT: [(&str, f64); 2] = [("f", 1.0), ("v_belt", 0.5)];
/// Standard deviation of the measurement errors.
const SD: f64 = 0.02;

/// Position of a mass that the belt carries until it slips at `x = f`; afterwards `x = f + v sin(t - f/v)`.
fn position(t: f64) -> f64 {
    let [(_, f), (_, v)] = EXACT;
    if t <= f / v { v * t } else { f + v * (t - f / v).sin() }
}

/// Returns, for each parameter, the number of confidence intervals that contain its true value.
fn covered(is_told: bool) -> [u64; 2] {
    let mut held = [0; 2];
    for seed in 0..FITS {
        let mut random = fastrand::Rng::with_seed(seed);
        // Normal numbers by the method of Box and Muller 1958.
        let mut normal = || (-2.0 * (1.0 - random.f64()).ln()).sqrt() * (TAU * random.f64()).cos();
        let t: Vec<f64> = (1..=20).map(|i| f64::from(i) * 0.375).collect();
        let x: Vec<f64> = t.iter().map(|&t| position(t) + SD * normal()).collect();
        let mut data = json!({"t": t, "x": x});
        if is_told {
            data["sd"] = json!(SD);
        }
        let specification = json!({
            "problem": {"dvi": {"parameters": {"f": 0.8, "v_belt": 0.6},
                "states": {"x": {"initial": 0, "rate": "v"}, "v": {"initial": "v_belt", "rate": "-x - F"}},
                "variables": {"F": {"inequality": "-(v - v_belt)"}},
                "set": [{"box": {"of": ["F"], "lower": "-f", "upper": "f"}}]}},
            "time": {"end": 7.5},
            "output": {"times": {"count": 2}},
            "fit": {"parameters": {"f": {}, "v_belt": {}}, "data": data},
        });
        let specification = Specification::from_json(specification.to_string().as_bytes()).expect("a specification");
        let solution = dvi::solve(&specification, &Control::new());
        let Some(fit) = solution.fit.filter(|_| solution.verdict.trusted) else {
            println!("seed {seed} has no fit: {:?} {:?}", solution.error, solution.verdict);
            continue;
        };
        for (held, (name, exact)) in held.iter_mut().zip(EXACT) {
            let found = fit.parameters[name];
            let ends = found.lower.zip(found.upper);
            *held += u64::from(ends.is_some_and(|(lower, upper)| (lower..=upper).contains(&exact)));
        }
    }
    held
}

fn main() {
    for is_told in [true, false] {
        let held = covered(is_told);
        for ((name, _), held) in EXACT.iter().zip(held) {
            println!("{name}, sd given: {is_told}: {held} of {FITS} intervals hold it");
            assert!(held.abs_diff(FITS * 95 / 100) <= FITS / 50, "95 % +- 2 %");
        }
    }
}
