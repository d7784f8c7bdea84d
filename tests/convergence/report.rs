//! Chapters of the report on test systems with closed-form solutions: the orders, switch times and comparisons with
//! other programs in its tables.

use dvi::specification::{EXAMPLES, Example};
use dvi::study::report::{Answer, Chapter, Ladder, Outcome, chapter, request};
use serde_json::{Value, json};

fn example(name: &str) -> &'static Example {
    EXAMPLES.iter().find(|example| example.name == name).expect("an example")
}

fn of(name: &str) -> Chapter {
    chapter(example(name), "2026-11-23").expect("a chapter")
}

fn ladder<'a>(chapter: &'a Chapter, method: &str) -> &'a Ladder {
    chapter.ladders.iter().find(|ladder| ladder.method == method).unwrap_or_else(|| panic!("no ladder {method}"))
}

#[test]
fn a_rectifier_switches_at_the_time_of_its_closed_form_and_implicit_euler_is_of_first_order() {
    let chapter = of("rectifier");
    assert!(chapter.outside() && chapter.reference.agreement.expect("a run of reference") < 1e-11, "{chapter:?}");
    assert_eq!(chapter.reference.switches, [0.011790323194208857]);
    let chosen = ladder(&chapter, "stages chosen");
    let finest = chosen.runs.last().and_then(|run| run.errors.as_ref()).expect("errors");
    assert!(finest.switches.expect("a switch") < 1e-7 && finest.end.expect("an end") < 1e-7, "{finest:?}");
    let euler = ladder(&chapter, "1 stage at fixed steps");
    for run in &euler.runs[1..] {
        let power = run.change.expect("a power");
        assert!((power - 1.0).abs() < 0.2, "order {power} of implicit Euler");
    }
    // The reported error of the states over the whole run is at least that at its end, and an error of the
    // complementarity variables is reported as well.
    for run in euler.runs.iter().filter_map(|run| run.errors.as_ref()) {
        assert!(run.states >= run.end && run.variables.is_some(), "{run:?}");
    }
    assert!(chapter.ladders.iter().all(|ladder| ladder.runs.len() == 4));
    assert!(!chapter.is_exact_for_all());
    assert!(chapter.solution.contains("<svg") && !chapter.equations.is_empty());
}

#[test]
fn a_relay_that_implicit_euler_solves_to_rounding_is_told_apart() {
    let chapter = of("relay");
    assert!(chapter.is_exact_for_all());
    assert_eq!(Chapter::lost(&chapter.ladders), (0, 24));
}

/// Returns the runs of another program ("peer") as the report on test systems stores them: one run completed and one
/// stopped.
fn peer(chapter: &Chapter, fields: Value, switches: Value) -> Ladder {
    let answer = json!({"method": "Peer", "runs": [
        {"rtol": 1e-6, "steps": 12, "seconds": [3e-3, 1e-3, 2e-3], "fields": fields, "switches": switches},
        {"rtol": 1e-9, "seconds": [20], "message": "stopped after 20 s"}]});
    serde_json::from_value::<Answer>(answer).expect("an answer").ladder(chapter)
}

#[test]
fn a_peer_is_measured_at_the_same_times_in_the_same_norm() {
    let chapter = of("coulomb_slope");
    let asked = request(&chapter);
    let times: Vec<f64> = serde_json::from_value(asked["times"].clone()).expect("times");
    assert_eq!(asked["specification"]["problem"]["dvi"]["parameters"]["mu"], 0.5);
    let stop = chapter.reference.switches[0];
    assert!(times.iter().all(|t| (t - stop).abs() > 1e-3), "a time of comparison is at the jump of the friction");
    // The exact velocity v falls linearly from 2 to rest; the values that the peer program returns differ from it by
    // 1/500 of the largest value among the compared times.
    let rate = 2.0 / stop;
    let exact: Vec<f64> = times.iter().map(|t| f64::max(2.0 - rate * t, 0.0)).collect();
    let largest = exact.iter().copied().fold(0.0, f64::max);
    let off: Vec<f64> = exact.iter().map(|v| v + largest / 500.0).collect();
    let found = peer(&chapter, json!({"v": off}), json!([stop + 0.03]));
    let errors = found.runs[0].errors.as_ref().expect("errors");
    assert!((errors.end.expect("an end") - 2e-3).abs() < 1e-9 && (errors.states.expect("states") - 2e-3).abs() < 1e-9);
    assert!((errors.switches.expect("switches") - 0.01).abs() < 1e-9, "{errors:?}");
    assert!(errors.variables.is_none(), "what was not returned has no error");
    assert_eq!((found.runs[0].seconds, found.runs[0].spread), (2e-3, (1e-3, 3e-3)));
    assert_eq!((found.runs[1].outcome, Chapter::lost(std::slice::from_ref(&found))), (Outcome::Failed, (1, 2)));
    // If a peer program returns no values, the report states no error at all, rather than a small one.
    let nothing: Vec<Option<f64>> = vec![None; times.len()];
    assert!(peer(&chapter, json!({"v": nothing}), json!(null)).runs[0].errors.as_ref().expect("errors").end.is_none());
}

/// A peer program that is not installed still states its name and how to install it, without any of the packages that
/// it needs.
#[test]
fn every_peer_has_a_name_and_a_way_to_install_it_without_being_installed() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peers");
    let files = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let peers: Vec<_> = files.filter(|path| path.to_string_lossy().ends_with("_peer.py")).collect();
    assert!(peers.len() >= 7, "{peers:?}");
    for peer in peers {
        let told = std::process::Command::new("python3")
            .args(["-S".as_ref(), peer.as_os_str(), "--install".as_ref()])
            .output();
        let told = told.expect("python3");
        let text = String::from_utf8_lossy(&told.stdout);
        let lines: Vec<&str> = text.trim().lines().collect();
        assert!(lines.len() == 2 && lines[1].contains("tests/peers/install"), "{peer:?}: {text}{told:?}");
    }
}

#[test]
fn a_mesh_is_measured_apart_from_the_steps() {
    let chapter = of("oxygen_diffusion");
    assert!(chapter.semidiscrete && chapter.reference.outside.is_empty());
    // Linear finite elements are of second order, as in the table of Hansen and Hougaard.
    let orders: Vec<f64> = chapter.meshes.iter().filter_map(|mesh| mesh.order).collect();
    assert!(orders.len() == 3 && orders[..2].iter().all(|order| (order - 2.0).abs() < 0.3), "{:?}", chapter.meshes);
    // The report states the time integration error apart from the mesh error, also if it is much smaller.
    let chosen = ladder(&chapter, "tr_bdf2");
    let finest =
        chosen.runs.last().and_then(|run| run.errors.as_ref()).and_then(|errors| errors.end).expect("an error");
    let mesh = chapter.meshes[2].error.expect("an error");
    assert!(finest < 0.1 * mesh, "{finest} in time, {mesh} of the mesh");
}
