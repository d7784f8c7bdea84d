//! The time gained by leaving parts of the solver out that a problem does not need, such as friction or the
//! variational inequality (`diagnostics.left_out`). Each system is solved as it is, and with an inert addition to the
//! specification that forces the solver to include the part. `cargo bench --bench left_out`.
//!
//! The additions do not change the solution: a variable that stays at zero, a mass of two with twice the rates,
//! friction and restitution of 1e-12, a term of 1e-300, an obstacle far below. The two runs take turns, and the last
//! column is the difference of their final values.
//!
//! | forced in                                                             | times the run without |
//! |-----------------------------------------------------------------------|-----------------------|
//! | new matrices of a membrane                                            | 16                    |
//! | friction of coordinates                                               | 2.2                   |
//! | variational inequality and switches                                   | 1.7                   |
//! | moving bounds of memory                                               | 1.6                   |
//! | restitution, friction of bodies, Jacobians, masses, a far obstacle    | 1, within the noise   |

use dvi::problem::Control;
use dvi::specification::Specification;
use serde_json::{Value, json};
use std::time::Instant;

/// Number of runs of each system; their medians are printed.
const TURNS: usize = 15;

fn main() {
    println!("{:<34} {:>12} {:>12} {:>7} {:>9}", "part", "left out", "forced in", "ratio", "apart");
    for (part, lean, full) in scenes() {
        let [lean, full] = [lean, full].map(|document| {
            Specification::from_json(document.to_string().as_bytes())
                .unwrap_or_else(|errors| panic!("{part}: {errors:#?}"))
        });
        let (mut times, mut apart) = ([Vec::new(), Vec::new()], 0.0_f64);
        for _ in 0..TURNS {
            let [a, b] = [(&lean, 0), (&full, 1)].map(|(specification, k)| {
                let clock = Instant::now();
                let solution = dvi::solve(specification, &Control::new());
                times[k].push(clock.elapsed().as_secs_f64());
                solution.trajectory
            });
            for field in &a.fields {
                let other = b.field(&field.name).expect("the same outputs");
                apart = apart.max((field.values.last().expect("an end") - other.last().expect("an end")).abs());
            }
        }
        let [lean, full] = times.map(median);
        println!("{part:<34} {:>9.3} ms {:>9.3} ms {:>7.2} {apart:>9.1e}", lean * 1e3, full * 1e3, full / lean);
    }
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Returns, for each optional part of the solver, the name of the part, a system that does not need it, and that
/// system with an inert addition that forces the part in.
fn scenes() -> [(&'static str, Value, Value); 9] {
    let van_der_pol = |factor: u32| {
        json!({"states": {"x": {"initial": 2, "rate": format!("{factor}*y")},
                          "y": {"initial": 0, "rate": format!("{factor}*1e6*((1 - x^2)*y - x)")}}})
    };
    let smooth = |dvi: Value| json!({"problem": {"dvi": dvi}, "time": {"end": 2}, "output": {"times": [2], "fields": ["x", "y"]}});
    let mut inert = van_der_pol(1);
    inert["variables"] = json!({"z": {"inequality": "z + 1"}});
    inert["set"] = json!([{"nonnegative": ["z"]}]);
    let mut heavy = van_der_pol(2);
    heavy["mass"] = json!([[2, 0], [0, 2]]);
    let chain = |term: &str| {
        let n = 40;
        let rate = |k: usize| format!("-2*x{k} + x{} + x{}{term}", (k + 1) % n, (k + n - 1) % n);
        let states: serde_json::Map<String, Value> =
            (0..n).map(|k| (format!("x{k}"), json!({"initial": (k % 7) as f64, "rate": rate(k)}))).collect();
        json!({"problem": {"dvi": {"states": states}}, "time": {"end": 10}, "output": {"times": [10]}})
    };
    let pile = |contacts: Value| {
        let mut bodies = vec![json!({"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true})];
        bodies.extend((0..12).map(|k| {
            json!({"name": format!("b{k}"), "shape": {"box": {"size": [1, 1, 1]}}, "mass": 1, "position": [0, 0, 0.5 + k as f64]})
        }));
        json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -9.81], "bodies": bodies, "contacts": contacts}},
            "time": {"end": 0.1}, "method": {"step": 1e-3}, "output": {"times": [0.1], "fields": ["b11.z"]}})
    };
    let tower = |friction: bool, restitution: f64| {
        let coordinates: serde_json::Map<String, Value> = (0..8)
            .flat_map(|k| [(format!("x{k}"), json!({"initial": 0})), (format!("y{k}"), json!({"initial": k}))])
            .collect();
        let mass: Vec<Vec<u32>> = (0..16).map(|i| (0..16).map(|j| u32::from(i == j)).collect()).collect();
        let potential: Vec<String> = (0..8).map(|k| format!("9.81*y{k}")).collect();
        let contact = |k: usize| {
            let gap = if k == 0 { "y0".to_owned() } else { format!("y{k} - y{} - 1", k - 1) };
            let mut contact = json!({"name": format!("c{k}"), "gap": gap, "restitution": restitution});
            if friction {
                contact["friction"] = json!({"coefficient": 1e-12, "slip": [format!("x{k}_dot")]});
            }
            contact
        };
        let contacts: Vec<Value> = (0..8).map(contact).collect();
        json!({"problem": {"mechanical": {"coordinates": coordinates, "mass": mass, "potential": potential.join(" + "), "contacts": contacts}},
            "time": {"end": 1}, "method": {"step": 1e-3}, "output": {"times": [1], "fields": ["y7"]}})
    };
    let supports = |upper: Value| {
        json!({"problem": {"convolution": {
                "variables": {"left": {"q": "-sin(2*t)"}, "right": {"q": "cos(3*t) - 1"}},
                "kernel": {"entries": [["exp(-2*t)", "0.3*exp(-t)"], ["0.3*exp(-t)", "exp(-2*t)"]]},
                "set": [{"box": {"of": ["left", "right"], "lower": 0, "upper": upper}}]}},
            "time": {"end": 5}, "method": {"step": 2.5e-3}, "output": {"times": [5], "fields": ["left", "right"]}})
    };
    let membrane = |diffusion: &str, obstacle: Option<f64>| {
        let side = json!({"dirichlet": 0});
        let mut problem = json!({"domain": {"x": [-2, 2], "y": [-2, 2]}, "elements": 48, "diffusion": diffusion, "source": 1,
            "initial": 0, "boundary": {"x_min": side, "x_max": side, "y_min": side, "y_max": side}, "probes": {"top": [0, 0]}});
        if let Some(obstacle) = obstacle {
            problem["obstacle"] = json!(obstacle);
        }
        json!({"problem": {"obstacle": problem}, "time": {"end": 1}, "method": {"step": 0.02},
            "output": {"times": [1], "fields": ["top"]}})
    };
    [
        ("variational inequality, switches", smooth(van_der_pol(1)), smooth(inert)),
        ("mass matrix", smooth(van_der_pol(1)), smooth(heavy)),
        ("new Jacobians", chain(""), chain(" - 1e-300*x0^2")),
        ("friction of coordinates", tower(false, 0.0), tower(true, 0.0)),
        ("restitution of coordinates", tower(false, 0.0), tower(false, 1e-12)),
        ("friction of bodies", pile(json!({})), pile(json!({"friction": 1e-12}))),
        ("moving bounds of memory", supports(json!(2.5)), supports(json!("2.5 + 1e-300*t"))),
        ("obstacle of a membrane", membrane("1", None), membrane("1", Some(-1e3))),
        ("new matrices of a membrane", membrane("1", None), membrane("1 + 1e-300*t", None)),
    ]
}
