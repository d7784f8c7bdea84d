use super::*;
use crate::report::{Conditions, Errors, Ladder, Outcome, Reference, Reported, Run, Source};
use crate::stability::{Finding, Outcome as Case};
use serde_json::json;

fn run(outcome: Outcome, error: Option<f64>) -> Run {
    Run {
        rtol: None,
        step: Some(0.1),
        outcome,
        trusted: Some(false),
        steps: 7,
        seconds: 1e-3,
        spread: (9e-4, 2e-3),
        errors: error.map(|error| Errors { end: Some(error), states: Some(error), ..Errors::default() }),
        change: Some(0.97),
        message: (outcome == Outcome::Failed).then(|| "step_too_small at t = 1".to_owned()),
    }
}

fn chapter(name: &str, runs: Vec<Run>) -> Chapter {
    Chapter {
        name: name.to_owned(),
        title: "<script>alert(1)</script>".to_owned(),
        equations: vec!["x′ < 1".to_owned()],
        specification: json!({"problem": {"dvi": {"parameters": {"mu": 0.5}}}, "time": {"end": 4}}),
        start: vec![("x".to_owned(), 0.25)],
        atol: (1e-3, 1e-3),
        solution: String::new(),
        source: Some(Source { what: "closed form".to_owned(), digits: "all digits".to_owned(), file: None }),
        reported: Some(Reported {
            what: "it hangs".to_owned(),
            title: "Elsewhere 1: it <hangs>".to_owned(),
            address: "https://example.org/1".to_owned(),
        }),
        reference: Reference {
            times: vec![4.0],
            names: vec!["x".to_owned()],
            states: 1,
            columns: vec![vec![1.0]],
            outside: vec![(0, 1.0)],
            switches: vec![2.0],
            located: vec![2.0],
            switches_outside: true,
            run: Some("the tolerance 1e-13".to_owned()),
            agreement: Some(3e-14),
            coarser: Some(2e-5),
            horizon: 4.0,
            compared: 1,
            zero: 1e-12,
        },
        semidiscrete: false,
        meshes: Vec::new(),
        ladders: vec![Ladder { method: "1 stage at fixed steps".to_owned(), runs }],
        peers: Vec::new(),
        conditions: Conditions { date: "2026-11-23".to_owned(), ..Conditions::default() },
    }
}

#[test]
fn a_page_states_its_systems_and_shows_every_run_and_no_markup_of_a_title() {
    let runs = vec![run(Outcome::Completed, Some(1e-3)), run(Outcome::Failed, None)];
    let peers = [Peer { name: "Siconos".to_owned(), install: Some("apt install python3-siconos".to_owned()) }];
    let page = html(&[chapter("relay", runs)], None, &peers, false);
    assert!(!page.contains("<script"), "{page}");
    for told in [
        "x′ &lt; 1",
        "mu = 0.5, t from 0 to 4",
        "Closed form; all digits",
        "differs from it by 3.0e-14",
        "steps twice as long differs from it by 2.0e-5",
        "At the start: x = 0.25.",
        "Absolute tolerances: 1e-3 times",
        "<h2>Fails elsewhere</h2>",
        "1 switch known from outside",
        "1 of 2 runs have no answer (1 stage at fixed steps at step 1.00e-1: step_too_small at t = 1)",
        "class=\"cross line0\"",
        "1.0e-3 (9.0e-4 to 2.0e-3)",
        "h<sup>0.97</sup>",
        "not installed</span>: apt install python3-siconos",
        "2026-11-23",
        "<a href=\"https://example.org/1\">Elsewhere 1: it &lt;hangs&gt;</a>",
    ] {
        assert!(page.contains(told), "{told}\n{page}");
    }
}

#[test]
fn a_fixed_page_has_no_time_and_no_day() {
    let page = html(&[chapter("relay", vec![run(Outcome::Completed, Some(1e-3))])], None, &[], true);
    for told in ["2026", "1.0e-3 (", "run time in s"] {
        assert!(!page.contains(told), "{told}\n{page}");
    }
}

#[test]
fn systems_that_implicit_euler_solves_to_rounding_stand_apart() {
    let exact = chapter("exact", vec![run(Outcome::Completed, Some(1e-15))]);
    let telling = chapter("telling", vec![run(Outcome::Completed, Some(1e-2))]);
    let page = html(&[exact, telling], None, &[], false);
    let apart = page.find("solves to rounding").expect("a part of their own");
    let figure = &page[..page.find("</svg>").expect("a figure")];
    assert!(figure.contains("\ntelling\n") && !figure.contains("\nexact\n"), "{figure}");
    assert!(page.find("#telling").expect("a row") < apart && apart < page.find("#exact").expect("a row"), "{page}");
}

#[test]
fn what_fails_is_shown_as_failed_and_counted() {
    let outcome = |name: &str, passed: bool| Case {
        part: "stiff".to_owned(),
        name: name.to_owned(),
        title: String::new(),
        findings: vec![Finding { expected: "9 digits".to_owned(), found: "3 digits".to_owned(), passed }],
        trusted: (name != "refused").then_some(name == "good"),
        seconds: 0.1,
    };
    let outcomes = ["good", "doubted", "refused"].map(|name| outcome(name, true));
    let outcomes = outcomes.into_iter().chain([outcome("bad", false)]).collect();
    let limits = Stability { outcomes, ..Stability::default() };
    let page = html(&[], Some(&limits), &[], false);
    assert!(page.contains("3 of 4") && page.contains("class=\"failed\""), "{page}");
    assert!(page.contains("<strong>1 of 2</strong> are trusted, of the wrong ones 0 of 1"), "{page}");
    let csv = limits.csv();
    assert!(csv.contains("\"good\",\"9 digits\",\"3 digits\",true,true,0.1\n"), "{csv}");
    assert!(csv.contains("\"refused\",\"9 digits\",\"3 digits\",true,,0.1\n"), "{csv}");
}
