//! Time to bind new values to the parameters of a problem, compared with compiling the problem again with these
//! values: the diode bridge with its components as parameters, as matrices and as expressions, and a dense nonlinear
//! system of 100 states. `cargo bench --bench parameters`.
//!
//! The table has the times for the model alone (`with_parameters` of a model, as used for each member of a sweep) and
//! for the specification with its checks at the start and its analysis, each compared with compiling the text; and
//! the ratios of the times to evaluate rows and Jacobian, and to compile, with the parameters as inputs and with
//! numbers in their place.

use dvi::specification::Specification;
use serde_json::{Value, json};
use std::hint::black_box;
use std::time::Instant;

/// Number of runs of each measurement; their medians are printed.
const TURNS: usize = 31;

fn main() {
    println!(
        "{:<26} {:>11} {:>11} {:>11} {:>9} {:>9} {:>11} {:>8}",
        "problem", "anew", "specific.", "model", "anew/spec", "anew/mod", "evaluation", "reading"
    );
    for (name, document, parameter) in problems() {
        let text = document.to_string();
        let specification = read(&text);
        let text_of_numbers = folded(document).to_string();
        let numbers = read(&text_of_numbers);
        let parameters = specification.model().parameters().expect("parameters").clone();
        let k = parameters.names().iter().position(|known| known == parameter).expect("a parameter");
        let mut times = [(); 6].map(|()| Vec::new());
        for turn in 0..TURNS {
            let value = parameters.values()[k] * (1.0 + 0.001 * turn as f64);
            let mut values = parameters.values().to_vec();
            values[k] = value;
            times[0].push(seconds(|| black_box(read(&text)).time()));
            times[1]
                .push(seconds(|| specification.with_parameters(&[(parameter, value)]).expect("the same structure")));
            times[2].push(seconds(|| specification.model().with_parameters(&values).expect("the same structure")));
            times[3].push(evaluations(&specification));
            times[4].push(evaluations(&numbers));
            times[5].push(seconds(|| black_box(read(&text_of_numbers)).time()));
        }
        let [anew, whole, model, inputs, folded, anew_folded] = times.map(median);
        println!(
            "{name:<26} {:>8.1} us {:>8.1} us {:>8.1} us {:>9.1} {:>9.1} {:>11.3} {:>8.2}",
            anew * 1e6,
            whole * 1e6,
            model * 1e6,
            anew / whole,
            anew / model,
            inputs / folded,
            anew / anew_folded
        );
    }
}

fn read(text: &str) -> Specification {
    Specification::from_json(text.as_bytes()).unwrap_or_else(|errors| panic!("{errors:#?}"))
}

fn seconds<T>(run: impl FnOnce() -> T) -> f64 {
    let clock = Instant::now();
    let result = run();
    let seconds = clock.elapsed().as_secs_f64();
    drop(black_box(result));
    seconds
}

/// Returns the seconds that a thousand evaluations of the model's equations and their Jacobian take.
fn evaluations(specification: &Specification) -> f64 {
    let model = specification.model().dvi().expect("a problem");
    let (structure, mut problem) = (model.structure(), model.problem());
    let y: Vec<f64> = (0..structure.unknowns()).map(|i| 0.1 + 0.001 * i as f64).collect();
    let (mut rows, mut jacobian) = (vec![0.0; structure.rows()], vec![0.0; structure.pattern.len()]);
    seconds(|| {
        for turn in 0..1000 {
            let t = 1e-6 * f64::from(turn);
            problem.evaluate(t, black_box(&y), &mut rows);
            problem.jacobian(t, black_box(&y), &mut jacobian);
        }
        black_box((&rows, &jacobian));
    })
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Returns the document with the values of its numeric parameters written into all expressions.
fn folded(document: Value) -> Value {
    let problem = document["problem"].as_object().and_then(|problem| problem.values().next()).expect("a type");
    let parameters: Vec<(String, f64)> = problem["parameters"]
        .as_object()
        .map(|all| all.iter().map(|(name, value)| (name.clone(), value.as_f64().expect("a number"))).collect())
        .unwrap_or_default();
    fn replace(value: &mut Value, parameters: &[(String, f64)]) {
        match value {
            Value::String(text) => {
                let mut words = String::new();
                let mut word = String::new();
                for c in text.chars().chain([' ']) {
                    if c.is_ascii_alphanumeric() || c == '_' {
                        word.push(c);
                        continue;
                    }
                    match parameters.iter().find(|(name, _)| *name == word) {
                        Some((_, value)) => words.push_str(&format!("({value:?})")),
                        None => words.push_str(&word),
                    }
                    word.clear();
                    words.push(c);
                }
                *text = words.trim_end().to_owned();
            }
            Value::Array(items) => items.iter_mut().for_each(|item| replace(item, parameters)),
            Value::Object(members) => {
                members
                    .iter_mut()
                    .filter(|(key, _)| *key != "parameters")
                    .for_each(|(_, item)| replace(item, parameters));
            }
            _ => {}
        }
    }
    let mut document = document;
    replace(&mut document["problem"], &parameters);
    document
}

/// Returns the benchmark problems, each with its name and the parameter that is varied.
fn problems() -> [(&'static str, Value, &'static str); 3] {
    let parameters = json!({"R": 1000, "C": 1e-6, "L": 0.01, "v0": 10});
    let time = json!({"end": 0.005});
    let bridge = json!({"problem": {"lcs": {
        "parameters": parameters.clone(),
        "initial": ["v0", 0],
        "A": [[0, "-1/C"], ["1/L", 0]],
        "B": [[0, 0, "-1/C", "1/C"], [0, 0, 0, 0]],
        "C": [[0, 0], [0, 0], [-1, 0], [1, 0]],
        "D": [["1/R", "1/R", -1, 0], ["1/R", "1/R", 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]],
        "set": [{"nonnegative": ["z1", "z2", "z3", "z4"]}]}}, "time": time.clone()});
    let expressions = json!({"problem": {"dvi": {
        "parameters": parameters,
        "states": {"v": {"initial": "v0", "rate": "(i_R2 - i_F1 - i)/C"}, "i": {"initial": 0, "rate": "v/L"}},
        "variables": {
            "v_R1": {"inequality": "(v_R1 + v_F2)/R - i_F1"}, "v_F2": {"inequality": "(v_R1 + v_F2)/R - i_R2"},
            "i_F1": {"inequality": "v_R1 - v"}, "i_R2": {"inequality": "v_F2 + v"}},
        "set": [{"nonnegative": ["v_R1", "v_F2", "i_F1", "i_R2"]}]}}, "time": time});
    const N: usize = 100;
    let rate = |i: usize| {
        let terms = (1..=N).map(|j| format!("{:?}*k*x{j}", ((7 * i + 3 * j) as f64).sin() / N as f64));
        format!("{} - c*x{i}^3 + a*sin(w*t)", terms.collect::<Vec<_>>().join(" + "))
    };
    let states: serde_json::Map<String, Value> =
        (1..=N).map(|i| (format!("x{i}"), json!({"initial": "x0", "rate": rate(i)}))).collect();
    let dense = json!({"problem": {"dvi": {
        "parameters": {"k": 1.7, "c": 0.3, "a": 1.1, "w": 3.3, "x0": 0.2}, "states": states}}, "time": {"end": 1}});
    [
        ("diode bridge, matrices", bridge, "R"),
        ("diode bridge, expressions", expressions, "R"),
        ("100 states, dense", dense, "k"),
    ]
}
