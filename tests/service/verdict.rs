//! The verdict on a solution: in the status of its job, in the last event, with every representation of the results,
//! and as an exit code.

use crate::connections::Running;
use crate::harness::{Call, DECAY, Gate, Site, halving, instant, one_worker};
use crate::nats::on_both;
use arrow_ipc::reader::StreamReader;
use axum::http::StatusCode;
use dvi::service::jobs::Solver;
use dvi::solution::{Caveat, CheckCode, Reason, Status, Verdict};
use serde_json::{Value, json};
use std::io::Write;
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

on_both! {
    a_job_says_whether_its_answer_is_trusted_once_there_is_one,
    a_job_that_left_no_answer_has_no_verdict,
    what_speaks_against_an_answer_stands_in_the_job_the_list_and_the_last_event,
    a_part_of_the_results_has_the_whole_verdict,
}

const FORMS: [&str; 5] =
    ["application/json", "text/csv", "application/x-ndjson", "application/vnd.apache.arrow.stream", "image/svg+xml"];

/// Returns a solver whose solution reaches the end time, but has a verdict of not trusted (a joint came apart) and a
/// caveat.
fn doubted() -> Solver {
    let message = "the hinge of `arm` is 3.12 cm apart at t = 0.5".to_owned();
    let reason = Reason { code: CheckCode::JointDrift, value: 0.0312, allowed: 1e-3, message };
    let caveat =
        Caveat { code: "not_certified".to_owned(), message: "a solution, not certified to be unique".to_owned() };
    let verdict = Verdict { trusted: false, because: vec![reason], caveats: vec![caveat] };
    Arc::new(move |_, _| dvi::solution::Solution { verdict: verdict.clone(), ..halving(Status::Completed) })
}

fn doubt() -> Value {
    json!({
        "trusted": false,
        "because": [{
            "code": "joint_drift",
            "value": 0.0312,
            "allowed": 1e-3,
            "message": "the hinge of `arm` is 3.12 cm apart at t = 0.5"
        }],
        "caveats": [{"code": "not_certified", "message": "a solution, not certified to be unique"}]
    })
}

async fn a_job_says_whether_its_answer_is_trusted_once_there_is_one() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let path = site.accept(1).await;
    gate.entered(1).await;
    let running = site.get(&path).await.json();
    assert_eq!((&running["status"], running.get("trusted"), running.get("verdict")), (&json!("running"), None, None));
    gate.let_through(1);
    let ended = site.ended(&path).await;
    assert_eq!((&ended["status"], &ended["trusted"]), (&json!("successful"), &json!(true)));
    assert_eq!(ended["verdict"], json!({"trusted": true, "because": [], "caveats": []}));
}

async fn a_job_that_left_no_answer_has_no_verdict() {
    let site = Site::new(one_worker(), Arc::new(|_, _| panic!("on purpose")));
    let path = site.accept(1).await;
    let ended = site.ended(&path).await;
    assert_eq!((&ended["status"], ended.get("trusted"), ended.get("verdict")), (&json!("failed"), None, None));
}

async fn what_speaks_against_an_answer_stands_in_the_job_the_list_and_the_last_event() {
    let site = Site::new(one_worker(), doubted());
    let path = site.accept(1).await;
    let ended = site.ended(&path).await;
    assert_eq!((&ended["status"], &ended["trusted"]), (&json!("successful"), &json!(false)));
    assert_eq!(ended["verdict"], doubt());
    let list = Call::new("GET", "/jobs").client(1).send(&site).await.json();
    assert_eq!(list["jobs"], json!([ended]));
    let stream = site.get(&format!("{path}/events")).await;
    let (_, done) = stream.text().split_once("event: done\n").unwrap();
    let data = done.lines().find_map(|line| line.strip_prefix("data: ")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(data).unwrap(), ended);
}

#[tokio::test]
async fn every_form_of_the_results_comes_with_the_verdict() {
    for (solver, trusted) in [(doubted(), "false"), (instant(), "true")] {
        let site = Site::new(one_worker(), solver);
        let path = site.accept(1).await;
        site.ended(&path).await;
        for form in FORMS {
            for call in [
                Call::solve(DECAY),
                Call::new("GET", &format!("{path}/results")),
                Call::new("GET", &format!("{path}/results?fields=x&from=0.5")),
            ] {
                let reply = call.header("accept", form).send(&site).await;
                assert_eq!((reply.status, reply.header("dvi-trusted")), (StatusCode::OK, trusted), "{form}");
                if form == "application/json" {
                    assert_eq!(reply.json()["verdict"]["trusted"].to_string(), trusted);
                }
            }
        }
    }
}

async fn a_part_of_the_results_has_the_whole_verdict() {
    let site = Site::new(one_worker(), doubted());
    let path = site.accept(1).await;
    site.ended(&path).await;
    let part = format!("{path}/results?fields=x&from=0.5");
    let get = async |form: &str| Call::new("GET", &part).header("accept", form).send(&site).await;
    assert_eq!(get("application/json").await.json()["verdict"], doubt());
    let stream = get("application/vnd.apache.arrow.stream").await;
    let schema = StreamReader::try_new(stream.body.as_slice(), None).unwrap().schema();
    assert_eq!(schema.metadata()["dvi.trusted"], "false");
    assert_eq!(serde_json::from_str::<Value>(&schema.metadata()["dvi.verdict"]).unwrap(), doubt());
    assert!(get("image/svg+xml").await.text().contains("not trusted: joint drift"));
}

#[tokio::test]
async fn tables_hold_rows_and_nothing_else() {
    let site = Site::new(one_worker(), doubted());
    let table = Call::solve(DECAY).header("accept", "text/csv").send(&site).await;
    assert_eq!(table.text(), "t,x\n0.0,1.0\n1.0,0.5\n");
    let lines = Call::solve(DECAY).header("accept", "application/x-ndjson").send(&site).await;
    assert_eq!(lines.text(), "{\"t\":0.0,\"x\":1.0}\n{\"t\":1.0,\"x\":0.5}\n");
}

#[test]
fn the_description_explains_every_code() {
    let description = dvi::service::http::description();
    let codes = description.pointer("/components/schemas/CheckCode/oneOf").unwrap().as_array().unwrap();
    let explained: Vec<&Value> = codes.iter().map(|code| &code["enum"][0]).collect();
    assert_eq!(explained, CheckCode::ALL.map(CheckCode::name));
    assert!(codes.iter().all(|code| code["description"].as_str().is_some_and(|text| text.len() > 20)), "{codes:#?}");
    // In the API description, the schema of the diagnostics is composed of two: the analysis, and the one named
    // `allOf/1`.
    for schema in ["Verdict", "Reason", "Caveat", "Diagnostics/allOf/1", "Measured", "StatusInfo", "StudyRun"] {
        let properties = description.pointer(&format!("/components/schemas/{schema}/properties"));
        let properties = properties.unwrap_or_else(|| panic!("no {schema}")).as_object().unwrap();
        for (name, property) in properties {
            assert!(property.to_string().contains("\"description\""), "{schema}: {name} is not explained");
        }
    }
    assert_eq!(
        description.pointer("/components/schemas/Solution/properties/verdict/$ref"),
        Some(&json!("#/components/schemas/Verdict"))
    );
}

/// Runs `dvi solve` as the client of a service with the given solver, and returns its output.
async fn solved_by(solver: Solver, format: &'static str) -> Output {
    let running = Running::start(one_worker(), solver).await;
    let url = format!("http://{}", running.address);
    let solve = move || {
        let mut child = Command::new(env!("CARGO_BIN_EXE_dvi"))
            .args(["solve", "--server", &url, "--format", format, "-"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(DECAY.as_bytes()).unwrap();
        child.wait_with_output().unwrap()
    };
    tokio::task::spawn_blocking(solve).await.unwrap()
}

#[tokio::test]
async fn an_answer_of_a_server_that_is_not_trusted_is_written_and_has_its_own_exit_code() {
    let told = "\
dvi: not trusted: joint drift 3.12e-2, allowed 1e-3: the hinge of `arm` is 3.12 cm apart at t = 0.5
dvi: caveat: a solution, not certified to be unique
";
    for format in ["json", "csv"] {
        let output = solved_by(doubted(), format).await;
        assert_eq!(output.status.code(), Some(7), "{output:?}");
        assert_eq!(String::from_utf8(output.stderr).unwrap(), told);
        assert!(String::from_utf8(output.stdout).unwrap().contains("0.5"));
    }
    let output = solved_by(instant(), "csv").await;
    assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), b"".as_slice()), "{output:?}");
}
