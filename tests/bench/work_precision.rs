//! Error versus run time: stiff problems without complementarity variables, and systems with switches. Radau IIA with
//! adaptive order is compared with implicit Euler with the variational inequality at every step and without event
//! location (the first-order time-stepping method).
//!
//! `cargo bench --bench work_precision [-- NAME..]` prints a row per run, then the time in which each method reaches
//! an error, interpolated between runs. Times are the least of several, in milliseconds.

#[path = "../systems/reference.rs"]
mod reference;

use dvi::problem::Control;
use dvi::specification::Specification;
use mimalloc::MiMalloc;
use reference::{digits, example, read, switching};
use serde_json::{Value, json};

/// The memory allocator that the `dvi` program uses.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// A problem with its exact solution.
struct Case {
    name: String,
    specification: Value,
    /// Ratio of the absolute tolerance `atol` to the relative tolerance `rtol`.
    atol_factor: f64,
    /// For each state: its name, its exact final value, and a lower bound on the scale by which its error is divided.
    end: Vec<(String, f64, f64)>,
}

/// Error of a run, and its run time in milliseconds.
type Point = (f64, f64);

fn smooth() -> Vec<Case> {
    let problems = read("tests/reference/smooth.json")["problems"].take();
    let case = |problem: &Value| {
        let number = |key: &str, i: usize| problem[key][i].as_f64().expect("a number");
        let states = problem["equations"].as_array().expect("equations").len();
        Case {
            name: problem["name"].as_str().expect("a name").to_owned(),
            specification: reference::smooth(problem),
            atol_factor: problem["atol_factor"].as_f64().expect("a factor"),
            end: (0..states)
                .map(|i| (format!("y{}", i + 1), digits(&problem["reference"][i]), number("floor", i)))
                .collect(),
        }
    };
    problems.as_array().expect("problems").iter().map(case).collect()
}

fn with_switches() -> Vec<Case> {
    let systems: [(&str, &str, &[&str]); 4] = [
        ("diode_bridge", "diode_bridge", &["v", "i"]),
        ("diode_bridge_filter", "diode_bridge_filter", &["v", "i", "v_filter"]),
        ("friction_belt", "friction_oscillator_belt", &["x", "v"]),
        ("sliding_mode", "sliding_mode", &["x1", "x2"]),
    ];
    let case = |(name, reference, states): (&str, &str, &[&str])| {
        let exact = switching(reference);
        let end: Vec<f64> = (0..states.len()).map(|i| digits(&exact["x_T"][i])).collect();
        let scale = end.iter().fold(0.0_f64, |scale, value| scale.max(value.abs()));
        Case {
            name: name.to_owned(),
            specification: example(name),
            atol_factor: 1e-3,
            end: states.iter().zip(end).map(|(state, value)| ((*state).to_owned(), value, scale)).collect(),
        }
    };
    systems.into_iter().map(case).collect()
}

/// Solves a problem with the given method settings, and returns the error and the run time.
fn measure(case: &Case, method: Value) -> Option<(Point, u64)> {
    let mut document = case.specification.clone();
    document["method"] = method;
    document["output"] = json!({"times": [document["time"]["end"]]});
    let specification = Specification::from_json(document.to_string().as_bytes()).expect("a specification");
    let mut least = f64::INFINITY;
    let mut spent = 0.0;
    loop {
        let solution = dvi::solve(&specification, &Control::new());
        let seconds = solution.diagnostics.wall_seconds;
        least = least.min(seconds);
        spent += seconds;
        if solution.error.is_some() {
            return None;
        }
        if spent > 0.2 {
            let relative = |(name, exact, floor): &(String, f64, f64)| {
                let values = solution.trajectory.field(name).expect("a state");
                (values[values.len() - 1] - exact).abs() / exact.abs().max(*floor)
            };
            let error = case.end.iter().map(relative).fold(0.0, f64::max);
            return Some(((error, 1e3 * least), solution.diagnostics.steps.accepted));
        }
    }
}

/// Returns the run time at which a method reaches the given error, by log-log interpolation between two runs whose
/// errors enclose it; the least such time if there are several pairs of runs.
fn time_at(points: &[Point], target: f64) -> Option<f64> {
    let crossing = |pair: &[Point]| {
        let ((e0, t0), (e1, t1)) = (pair[0], pair[1]);
        (e0 > target && e1 <= target).then(|| {
            let fraction = (e0 / target).ln() / (e0 / e1).ln();
            t0 * (t1 / t0).powf(fraction)
        })
    };
    let first = points.first().filter(|(error, _)| *error <= target).map(|(_, time)| *time);
    points.windows(2).filter_map(crossing).chain(first).min_by(f64::total_cmp)
}

fn ladder(case: &Case, title: &str, methods: impl Iterator<Item = (String, Value)>) {
    let mut points = Vec::new();
    println!("\n{} ({title})\n  {:>10} {:>12} {:>12} {:>10}", case.name, "", "error", "ms", "steps");
    for (label, method) in methods {
        match measure(case, method) {
            None => println!("  {label:>10} {:>12}", "failed"),
            Some((point, steps)) => {
                println!("  {label:>10} {:>12.3e} {:>12.4} {steps:>10}", point.0, point.1);
                points.push(point);
            }
        }
    }
    for target in [1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10] {
        if let Some(time) = time_at(&points, target) {
            println!("  reaches {target:.0e} in {time:.4} ms");
        }
    }
}

fn main() {
    let names: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let wanted = |case: &Case| names.is_empty() || names.contains(&case.name);
    let radau = |case: &Case| {
        let factor = case.atol_factor;
        (6..=22).map(move |k| {
            let rtol = 10.0_f64.powf(-f64::from(k) / 2.0);
            (format!("{rtol:.1e}"), json!({"rtol": rtol, "atol": rtol * factor}))
        })
    };
    for case in smooth().iter().filter(|case| wanted(case)) {
        ladder(case, "radau, auto", radau(case));
    }
    for case in with_switches().iter().filter(|case| wanted(case)) {
        ladder(case, "radau, auto, switches located", radau(case));
        let end = case.specification["time"]["end"].as_f64().expect("an end");
        let euler = (8..=18).step_by(2).map(|k| {
            let steps = 1_u64 << k;
            let method = json!({"stages": 1, "step": end / steps as f64, "switches": "step_over", "rtol": 1e-10});
            (steps.to_string(), method)
        });
        ladder(case, "implicit Euler, first order", euler);
    }
}
