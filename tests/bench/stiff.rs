//! Small stiff problems of `tests/reference/smooth.json`: the time to parse, check and solve each from its text.
//! `cargo bench --bench stiff`.

use divan::{Bencher, black_box};
use dvi::problem::Control;
use dvi::specification::Specification;
use serde_json::{Map, Value, json};

fn main() {
    divan::main();
}

fn specification(name: &str, rtol: f64) -> Specification {
    let text = include_str!("../reference/smooth.json");
    let problems: Value = serde_json::from_str(text).expect("JSON");
    let problems = problems["problems"].as_array().expect("problems");
    let problem = problems.iter().find(|problem| problem["name"] == name).expect("a problem of that name");
    let equations = problem["equations"].as_array().expect("equations").iter().enumerate();
    let states: Map<String, Value> = equations
        .map(|(i, rate)| (format!("y{}", i + 1), json!({"initial": problem["y0"][i], "rate": rate})))
        .collect();
    let atol = rtol * problem["atol_factor"].as_f64().expect("a factor");
    let specification = json!({
        "problem": {"dvi": {"parameters": problem["params"], "states": states}},
        "time": {"start": problem["t0"], "end": problem["t1"]},
        "method": {"rtol": rtol, "atol": atol},
        "output": {"times": [problem["t1"]]},
    });
    Specification::from_json(specification.to_string().as_bytes()).expect("a valid specification")
}

fn run(bencher: Bencher, name: &str, exponent: i32) {
    let specification = specification(name, 10.0_f64.powi(-exponent));
    bencher.bench_local(|| black_box(dvi::solve(black_box(&specification), &Control::new())));
}

#[divan::bench(args = [5, 7])]
fn van_der_pol(bencher: Bencher, exponent: i32) {
    run(bencher, "vdp6", exponent);
}

#[divan::bench(args = [5, 7])]
fn hires(bencher: Bencher, exponent: i32) {
    run(bencher, "hires", exponent);
}

#[divan::bench(args = [5, 7])]
fn pollu(bencher: Bencher, exponent: i32) {
    run(bencher, "pollu", exponent);
}
