//! Tests of retrying failed jobs, and of continuing jobs that have reached their end to a later end time.

use crate::harness::{Call, DECAY, Gate, Reply, Site, halving, instant, one_worker};
use crate::nats::on_both;
use axum::http::StatusCode;
use dvi::service::jobs::Solver;
use dvi::solution::Status;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

on_both! {
    one_key_makes_one_new_job,
    what_has_not_ended_is_neither_tried_again_nor_continued,
    an_end_that_makes_no_sense_is_refused_with_the_reason,
}

async fn post(site: &Site, path: &str, body: &str) -> Reply {
    Call::post(path, body.to_owned()).send(site).await
}

/// Asserts that a job was accepted, and returns its path and its status once it has ended.
async fn accepted(site: &Site, reply: &Reply) -> (String, Value) {
    assert_eq!(reply.status, StatusCode::ACCEPTED, "{}", reply.text());
    let path = reply.header("location").to_owned();
    let status = site.ended(&path).await;
    (path, status)
}

async fn solved(site: &Site, document: &Value) -> (String, Value) {
    accepted(site, &Call::solve(document.to_string()).header("prefer", "respond-async").send(site).await).await
}

#[tokio::test]
async fn a_job_that_failed_is_tried_again_as_another() {
    // The solver panics in its first two calls: in the inline solve and in the worker.
    let calls = AtomicUsize::new(0);
    let solver: Solver = Arc::new(move |_, _| {
        assert!(calls.fetch_add(1, Relaxed) > 1, "on purpose");
        halving(Status::Completed)
    });
    let site = Site::new(one_worker(), solver);
    let path = site.accept(1).await;
    assert_eq!(site.ended(&path).await["status"], "failed");
    let reply = post(&site, &format!("{path}/retry"), "").await;
    assert_eq!(reply.header("link"), format!("<{path}>; rel=\"predecessor-version\""));
    let (again, status) = accepted(&site, &reply).await;
    assert!(again != path && status["status"] == "successful" && status["attempt"] == 1, "{status}");
    assert_eq!(site.ended(&path).await["status"], "failed");
    let specification = site.get(&format!("{again}/specification")).await;
    assert_eq!(specification.text(), DECAY);
    post(&site, &format!("{again}/retry"), "").await.problem(409, "already-successful");
}

async fn one_key_makes_one_new_job() {
    let site = Site::new(one_worker(), Arc::new(|_, _| panic!("on purpose")));
    let path = site.accept(1).await;
    site.ended(&path).await;
    let retry = || Call::new("POST", &format!("{path}/retry")).header("idempotency-key", "k").send(&site);
    let (first, second) = (retry().await, retry().await);
    assert_eq!(first.header("location"), second.header("location"));
}

async fn what_has_not_ended_is_neither_tried_again_nor_continued() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let path = site.accept(1).await;
    post(&site, &format!("{path}/retry"), "").await.problem(409, "not-ended");
    post(&site, &format!("{path}/continue"), r#"{"end":2}"#).await.problem(409, "not-ended");
    Call::new("POST", &format!("{path}/cancel")).send(&site).await;
    site.ended(&path).await;
    let again = post(&site, &format!("{path}/retry"), "").await;
    assert_eq!(again.status, StatusCode::ACCEPTED);
    gate.let_through(1);
    accepted(&site, &again).await;
}

async fn an_end_that_makes_no_sense_is_refused_with_the_reason() {
    let site = Site::new(one_worker(), instant());
    let path = site.accept(1).await;
    site.ended(&path).await;
    let path = format!("{path}/continue");
    for (body, pointer, code) in [
        ("{}", "", "invalid_value"),
        (r#"{"end":"later"}"#, "", "invalid_value"),
        (r#"{"end":2,"step":1}"#, "", "invalid_value"),
        (r#"{"end":1}"#, "/end", "end_before_start"),
    ] {
        let errors = post(&site, &path, body).await.problem(400, "invalid-specification")["errors"].clone();
        assert_eq!((&errors[0]["pointer"], &errors[0]["code"]), (&pointer.into(), &code.into()), "{body}: {errors}");
    }
}

/// Returns the last value of a column of the trajectory in the results.
fn last(results: &Value, column: &str) -> f64 {
    results["trajectory"]["fields"][column]
        .as_array()
        .unwrap_or_else(|| panic!("{column}: {results}"))
        .last()
        .unwrap()
        .as_f64()
        .unwrap()
}

/// Solves a problem as a whole and in two parts, and asserts that the columns have the same final values.
async fn assert_continues(problem: Value, method: Value, end: f64, columns: &[&str], tolerance: f64) {
    let site = Site::new(one_worker(), Arc::new(dvi::solve));
    let document = |end: f64| json!({"problem": problem, "method": method, "time": {"end": end}});
    let (whole, _) = solved(&site, &document(end)).await;
    let (half, status) = solved(&site, &document(end / 2.0)).await;
    assert_eq!(status["status"], "successful", "{status}");
    let reply = post(&site, &format!("{half}/continue"), &format!("{{\"end\": {end}}}")).await;
    let (rest, status) = accepted(&site, &reply).await;
    assert_eq!(status["status"], "successful", "{status}");
    let of = |path: String| {
        let site = &site;
        async move { site.get(&format!("{path}/results")).await.json() }
    };
    let (whole, half, rest) = (of(whole).await, of(half).await, of(rest).await);
    for column in columns {
        let begins = rest["trajectory"]["fields"][column][0].as_f64().unwrap();
        assert!((begins - last(&half, column)).abs() <= tolerance, "{column} begins at {begins}");
        let (expected, found) = (last(&whole, column), last(&rest, column));
        assert!((expected - found).abs() <= tolerance, "{column}: {found}, in one run {expected}");
    }
    assert_eq!(rest["trajectory"]["t"][0], end / 2.0);
}

#[tokio::test]
async fn two_halves_of_an_oscillation_with_a_bound_are_the_whole() {
    let problem = json!({"dvi": {"states": {"x": {"initial": 1, "rate": "v"}, "v": {"initial": 0, "rate": "-x + sin(t) - 0.3*z"}},
        "variables": {"z": {"inequality": "z - v"}}, "set": [{"box": {"of": ["z"], "lower": -0.5, "upper": 0.5}}]}});
    let written = format!("{{\"problem\": {problem}, \"time\": {{\"end\": 1}}}}");
    let site = Site::new(one_worker(), instant());
    let checked = Call::check(written).send(&site).await;
    assert_eq!(checked.status, StatusCode::OK, "{}", checked.text());
    assert_continues(problem, json!({"rtol": 1e-9, "atol": 1e-10}), 8.0, &["x", "v"], 1e-6).await;
}

#[tokio::test]
async fn a_ball_goes_on_bouncing() {
    let problem = json!({"mechanical": {"coordinates": {"y": {"initial": 1}}, "mass": [[1]], "potential": "9.81*y",
        "contacts": [{"name": "floor", "gap": "y", "restitution": 0.8}]}});
    assert_continues(problem, json!({"rtol": 1e-9}), 2.0, &["y", "y_dot"], 1e-6).await;
}

#[tokio::test]
async fn a_sliding_ball_goes_on_with_its_spin() {
    let problem = json!({"rigid_bodies": {"gravity": [0, 0, -9.81], "contacts": {"friction": 0.3}, "bodies": [
        {"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true},
        {"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0.1], "velocity": [2, 0, 0]}
    ]}});
    assert_continues(problem, json!({"step": 1e-3}), 0.4, &["ball.x", "ball.vx", "ball.wy"], 1e-6).await;
}

#[tokio::test]
async fn charge_and_flux_go_on_in_a_circuit() {
    let problem = json!({"circuit": {"components": [
        {"voltage_source": {"name": "V", "nodes": ["a", "0"], "volts": "sin(t)"}},
        {"inductor": {"name": "L", "nodes": ["a", "b"], "henries": 1}},
        {"capacitor": {"name": "C", "nodes": ["b", "0"], "farads": 1, "volts": 1}},
        {"resistor": {"name": "R", "nodes": ["b", "0"], "ohms": 2}}
    ]}});
    assert_continues(problem, json!({"rtol": 1e-9}), 6.0, &["v(C)", "i(L)"], 1e-6).await;
}

#[tokio::test]
async fn a_relay_goes_on_across_its_switches_and_along_them() {
    // The solution reaches the switching surface at about t = 1.3: in one run the first part ends before that time,
    // in the other while the solution slides.
    let problem = json!({"filippov": {"states": {"x": {"initial": 1.2, "plus": "-1 + 0.2*y", "minus": "1 + 0.2*y"},
        "y": {"initial": 0.5, "plus": "cos(t) - 0.1*x", "minus": "cos(t) + 1"}}, "surface": "x"}});
    let method = json!({"rtol": 1e-9, "atol": 1e-10});
    for end in [2.0, 4.0] {
        assert_continues(problem.clone(), method.clone(), end, &["x", "y"], 1e-6).await;
    }
    let three = json!({"filippov": {"states": {"x": {"initial": 0.9}, "y": {"initial": 0.4}}, "regions": [
        {"indicator": "-x", "rates": {"x": -1, "y": 0.1}},
        {"indicator": "x/2 - y", "rates": {"x": 0.5, "y": -0.8}},
        {"indicator": "x/2 + y", "rates": {"x": 0.5, "y": 0.8}}
    ]}});
    assert_continues(three, method, 1.0, &["x", "y"], 1e-6).await;
}

#[tokio::test]
async fn a_complementarity_system_goes_on_with_its_active_set() {
    // A mass on a spring with a stiff one-sided spring at the origin: in one run the first part ends with the
    // one-sided spring in contact, in the other without contact.
    let problem = json!({"lcs": {"initial": ["0.2", "0"], "A": [[0, 1], [-1, -0.1]], "B": [[0], [1]], "C": [[1, 0]], "D": [[0.05]],
        "set": [{"box": {"of": ["z1"], "lower": 0}}]}});
    for end in [3.6, 6.0] {
        assert_continues(problem.clone(), json!({"rtol": 1e-9, "atol": 1e-10}), end, &["x1", "x2"], 1e-6).await;
    }
}

#[tokio::test]
async fn what_its_states_do_not_determine_is_refused_with_the_reason() {
    let site = Site::new(one_worker(), instant());
    let example = |name: &str| {
        let example = dvi::specification::EXAMPLES.iter().find(|example| example.name == name).unwrap();
        serde_json::from_str::<Value>(example.text).unwrap()
    };
    for (name, reason) in [
        ("memory_abel", "its whole past"),
        ("string_obstacle", "in space"),
        ("diode_bridge_netlist", "netlist"),
        ("bouncing_ball_slopes", "its derivatives"),
        ("shaken_ball_branch", "a periodic orbit"),
        ("belt_fit", "a fit"),
        ("braess", "a static problem"),
    ] {
        let (path, _) = solved(&site, &example(name)).await;
        let reply = post(&site, &format!("{path}/continue"), r#"{"end": 1e6}"#).await;
        let problem = reply.problem(409, "not-continuable");
        assert!(problem["detail"].as_str().unwrap().contains(reason), "{problem}");
    }
    let two = json!({"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}, "w": {"initial": 1, "rate": "-w"}}}}, "time": {"end": 1}});
    let (path, _) = solved(&site, &two).await;
    let problem = post(&site, &format!("{path}/continue"), r#"{"end": 2}"#).await.problem(409, "not-continuable");
    assert!(problem["detail"].as_str().unwrap().contains("leave out `w`"), "{problem}");
}

/// Returns an example with a hundredth of its duration and with all its fields; an example that is no simulation over
/// time is returned unchanged.
fn shortened(text: &str) -> Value {
    let mut document: Value = serde_json::from_str(text).unwrap();
    if ["sweep", "fit", "periodic"].iter().any(|key| document.get(key).is_some()) {
        return document;
    }
    let start = document.pointer("/time/start").map_or(0.0, |start| start.as_f64().unwrap());
    if let Some(end) = document.pointer_mut("/time/end") {
        *end = json!(start + (end.as_f64().unwrap() - start) / 100.0);
    }
    document.as_object_mut().unwrap().remove("output");
    document.as_object_mut().unwrap().remove("study");
    document
}

#[tokio::test]
async fn every_example_is_continued_or_refused_with_one_reason() {
    let site = Site::new(one_worker(), Arc::new(dvi::solve));
    let mut continued = BTreeSet::new();
    for example in dvi::specification::EXAMPLES {
        let (path, status) = solved(&site, &shortened(example.text)).await;
        assert_eq!(status["status"], "successful", "{}: {status}", example.name);
        let reply = post(&site, &format!("{path}/continue"), r#"{"end": 1e15}"#).await;
        if reply.status == StatusCode::ACCEPTED {
            continued.insert(example.name);
            Call::new("DELETE", reply.header("location")).send(&site).await;
            continue;
        }
        let problem = reply.problem(409, "not-continuable");
        assert!(problem.get("errors").is_none(), "{}: {problem}", example.name);
        let told = problem["detail"].as_str().unwrap();
        assert!(
            told.starts_with("the job cannot be continued: ") && !told.contains("empty"),
            "{}: {told}",
            example.name
        );
    }
    assert!(continued.len() > 25, "{continued:?}");
    for never in ["bounce_slope", "bouncing_ball_slopes", "torn_off", "shaken_ball_branch", "buck_orbit", "belt_fit"] {
        assert!(!continued.contains(never), "{never}");
    }
}
