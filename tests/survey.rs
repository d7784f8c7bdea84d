//! Scratch.
use dvi::problem::Control;
use dvi::solution::Status;
use dvi::specification::{EXAMPLES, Specification};
use std::time::{Duration, Instant};

fn tell(
    name: &str,
    text: &str,
    right: impl Fn(&Result<dvi::solution::Solution, Vec<dvi::specification::SpecificationError>>) -> Option<bool>,
) {
    let start = Instant::now();
    let specification = Specification::from_json(text.as_bytes());
    let Ok(specification) = specification else { return };
    let solution = dvi::solve(&specification, &Control::with_deadline(Instant::now() + Duration::from_secs(40)));
    let solution = Ok(solution);
    let right = right(&solution);
    let Ok(s) = &solution else { return };
    let method = s.diagnostics.method;
    let v = &s.verdict;
    let checks = serde_json::to_value(&s.diagnostics.checks).unwrap();
    let mark = match (right, v.trusted) {
        (Some(true) | None, true) => "  ",
        (Some(true), false) => "FA",
        (Some(false), true) => "!!",
        _ => "un",
    };
    println!(
        "{mark} {name} | {method} {:?} right {right:?} trusted {} steps {} {:.2}s",
        s.status,
        v.trusted,
        s.diagnostics.steps.accepted,
        start.elapsed().as_secs_f64()
    );
    for (code, c) in checks.as_object().unwrap() {
        let (a, b) = (c["value"].as_f64().unwrap(), c["allowed"].as_f64().unwrap());
        println!("      {code}: {a:.2e} / {b:.2e} = {:.2e}", a / b);
    }
    for r in &v.because {
        println!("      - {}", r.message);
    }
    for w in &s.diagnostics.warnings {
        println!("      w {}", w.code);
    }
    let _ = Status::Completed;
    if std::env::var("SHOW").is_ok() {
        println!("      t {:?}", s.trajectory.t);
        for f in &s.trajectory.fields {
            println!("      {} {:?}", f.name, f.values);
        }
        println!("      events {}", s.trajectory.events.len());
    }
}

#[test]
fn survey() {
    let what = std::env::var("WHAT").unwrap_or_default();
    let only = std::env::var("ONLY").unwrap_or_default();
    if what.contains('e') {
        for example in EXAMPLES.iter().filter(|e| e.name.contains(&only)) {
            tell(example.name, example.text, |_| None);
        }
    }
    if what.contains('s') {
        for case in dvi::study::stability::cases() {
            if !case.name.contains(&only) {
                continue;
            }
            let problem = case.specification["problem"].as_object().unwrap().keys().next().unwrap().clone();
            if !["mechanical", "rigid_bodies", "elastic", "obstacle", "convolution"].contains(&problem.as_str()) {
                continue;
            }
            tell(&case.name, &case.specification.to_string(), |s| {
                Some(case.expect.iter().all(|e| e.judge(&case, s).passed))
            });
        }
    }
    if what.contains('f') {
        for entry in std::fs::read_dir(std::env::var("DIR").unwrap()).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            if !name.ends_with(".json") || !name.contains(&only) {
                continue;
            }
            let v: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
            let spec = v.get("spec").unwrap_or(&v);
            println!("truth {}", v["truth"]);
            tell(&name, &spec.to_string(), |_| None);
        }
    }
}
