//! Sweeps over HTTP: a table in every format, computed in chunks by any number of workers, with the same bytes in
//! every case.

use crate::harness::{Call, Site, count, one_worker};
use crate::nats::{is_shared, on_both};
use arrow_array::Array;
use arrow_ipc::reader::StreamReader;
use axum::http::StatusCode;
use dvi::problem::Control;
use dvi::service::Options;
use dvi::service::jobs::Solver;
use dvi::solution::encodings::write_json;
use dvi::specification::Specification;
use serde_json::Value;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

on_both! {
    the_answer_is_a_table_with_a_row_a_member,
    it_comes_in_every_form_and_is_the_same_again,
    any_number_of_workers_makes_the_same_bytes,
    a_sweep_goes_on_between_jobs_of_others_and_tells_its_rows,
    a_member_that_never_ends_fails_as_a_row,
    a_sweep_cancelled_or_deleted_at_once_leaves_nothing_running,
    a_member_that_takes_its_worker_down_fails_as_a_row_and_no_other_does,
    events_tell_the_rows_that_are_done,
}

const SWEEP: &str = r#"{"problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*sqrt(x)"}}}},
    "time": {"end": 1}, "sweep": {"over": {"k": [0, 1], "x.initial": [1, -1]}}}"#;

fn site() -> Site {
    Site::new(one_worker(), solver())
}

fn solver() -> Solver {
    Arc::new(dvi::solve)
}

/// A sweep with `members` members of an oscillator with a relay, over its stiffness and the force of the relay; the
/// members switch at different times.
fn relays(members: usize) -> String {
    format!(
        r#"{{"label": "relays", "problem": {{"dvi": {{"parameters": {{"k": 1, "f": 0.1}},
            "states": {{"x": {{"initial": 1, "rate": "v"}}, "v": {{"initial": 0, "rate": "-k*x - s"}}}},
            "variables": {{"s": {{"inequality": "-v"}}}}, "set": [{{"box": {{"of": ["s"], "lower": "-f", "upper": "f"}}}}]}}}},
            "time": {{"end": 5}},
            "sweep": {{"over": {{"k": {{"uniform": [0.5, 2]}}, "f": {{"lognormal": [-2, 1]}}}}, "design": "random", "count": {members},
            "collect": {{"x": {{"final": "x"}}, "energy": {{"mean": "x^2 + v^2"}}, "modes": "mode_word"}}}}}}"#
    )
}

/// Solves a document on one thread, and returns the result as JSON.
fn undisturbed(document: &str) -> Vec<u8> {
    let specification = Specification::from_json(document.as_bytes()).unwrap();
    let mut json = Vec::new();
    write_json(&dvi::solve(&specification, &Control::new()), &mut json).unwrap();
    json
}

impl Site {
    /// Posts `document` for `client` as an asynchronous job, and returns its path.
    async fn post(&self, client: u8, document: &str) -> String {
        let call = Call::solve(document.to_owned()).client(client).header("prefer", "respond-async");
        let reply = call.send(self).await;
        assert_eq!(reply.status, StatusCode::ACCEPTED, "{:?}", reply.json());
        reply.header("location").to_owned()
    }

    /// Waits until the sweep at `path` has at least the given number of rows, and returns its status.
    async fn has_rows(&self, path: &str, rows: u64) -> Value {
        let start = Instant::now();
        loop {
            let status = self.get(path).await.json();
            if status["members"]["done"].as_u64() >= Some(rows) {
                return status;
            }
            assert!(start.elapsed() < Duration::from_secs(60), "{status}");
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    }
}

async fn the_answer_is_a_table_with_a_row_a_member() {
    let reply = Call::solve(SWEEP).send(&site()).await;
    assert_eq!(reply.status, StatusCode::OK, "{}", reply.text());
    let json = reply.json();
    assert_eq!(json["table"]["members"], 4);
    assert_eq!(json["table"]["columns"]["member"], serde_json::json!([0, 1, 2, 3]));
    let x = json["table"]["columns"]["x"].as_array().unwrap();
    // The solution of x' = -k sqrt(x) is sqrt(x) = 1 - k t/2, which decreases by k/2 per unit of time.
    assert!(x[0] == 1.0 && (x[2].as_f64().unwrap() - 0.25).abs() < 1e-5, "{x:?}");
    assert!(x[3].is_null() && json["table"]["columns"]["status"][3] == "failed", "{json}");
    assert!(json["summary"]["x"]["count"].as_u64().unwrap() >= 2);
}

async fn it_comes_in_every_form_and_is_the_same_again() {
    let site = site();
    let form = async |accept: &str| {
        let reply = Call::solve(SWEEP).header("accept", accept).send(&site).await;
        assert_eq!(reply.status, StatusCode::OK, "{accept}: {}", reply.text());
        reply
    };
    let csv = form("text/csv").await;
    assert!(csv.text().starts_with("member,k,x.initial,x,status,trusted,error,"), "{}", csv.text());
    assert_eq!(csv.text().lines().count(), 5);
    assert_eq!(form("application/x-ndjson").await.text().lines().count(), 4);
    let arrow = form("application/vnd.apache.arrow.stream").await;
    let batch = StreamReader::try_new(arrow.body.as_slice(), None).unwrap().next().unwrap().unwrap();
    assert!(batch.num_rows() == 4 && batch.column_by_name("x").unwrap().null_count() > 0);
    #[cfg(feature = "parquet")]
    {
        let file = form("application/vnd.apache.parquet").await.body;
        assert!(file.starts_with(b"PAR1") && file.ends_with(b"PAR1"));
    }
    assert!(form("image/svg+xml").await.text().contains("<svg"));
    let path = site.accept(1).await;
    site.ended(&path).await;
    let (one, other) = (form("application/json").await, form("application/json").await);
    assert_eq!(one.body, other.body);
}

async fn any_number_of_workers_makes_the_same_bytes() {
    for (members, workers, express) in [(1, 1, 0), (7, 2, 1), (700, 1, 0), (700, 2, 1), (700, 16, 1)] {
        let document = relays(members);
        let options = Options { workers: count(workers), express, ..one_worker() };
        let site = Site::new(options, solver());
        let path = site.post(1, &document).await;
        let ended = site.ended(&path).await;
        assert_eq!(ended["status"], "successful", "{ended}");
        assert_eq!(ended["members"], serde_json::json!({"done": members, "of": members}));
        let reply = site.get(&format!("{path}/results")).await;
        assert!(reply.body == undisturbed(&document), "{members} members by {workers} workers");
    }
}

async fn a_sweep_goes_on_between_jobs_of_others_and_tells_its_rows() {
    let site = site();
    let path = site.post(1, &relays(1_000_000)).await;
    let status = site.has_rows(&path, 1).await;
    assert_eq!((&status["status"], &status["members"]["of"]), (&"running".into(), &1_000_000.into()));
    // There is a single worker, which the sweep would occupy for minutes.
    let other = Call::solve(relays(3)).client(2).send(&site).await;
    assert_eq!(other.status, StatusCode::OK, "{}", other.text());
    let own = Call::solve(relays(2)).client(1).send(&site).await;
    assert_eq!(own.status, StatusCode::OK, "{}", own.text());
    let before = status["members"]["done"].as_u64().unwrap();
    let after = site.has_rows(&path, before + 1).await;
    assert_eq!(after["status"], "running");
    // A sweep that is cancelled keeps the rows that it has.
    assert_eq!(Call::post(&format!("{path}/cancel"), "").send(&site).await.status, StatusCode::OK);
    let ended = site.ended(&path).await;
    assert_eq!(ended["status"], "dismissed", "{ended}");
    let json = site.get(&format!("{path}/results")).await.json();
    let rows = json["table"]["columns"]["member"].as_array().unwrap();
    assert_eq!(
        (Some(rows.len() as u64), &json["error"]["code"]),
        (ended["members"]["done"].as_u64(), &"cancelled".into())
    );
    assert!(rows.len() as u64 > before && json["status"] == "stopped");
    // Over NATS, chunks of a sweep are solved in any order, so that an unfinished chunk may leave a gap in the rows.
    let are_all = rows.iter().enumerate().all(|(k, member)| *member == k);
    assert!(are_all || is_shared() && rows.iter().map(Value::as_u64).is_sorted_by(|one, next| one < next));
    // After the cancellation of the sweep, the worker is free for another job.
    assert_eq!(Call::solve(relays(2)).client(1).send(&site).await.status, StatusCode::OK);
}

async fn a_sweep_cancelled_or_deleted_at_once_leaves_nothing_running() {
    let site = Site::new(Options { workers: count(2), ..one_worker() }, solver());
    for k in 0..20 {
        let path = site.post(1, &relays(1_000_000)).await;
        if k % 3 > 0 {
            tokio::time::sleep(Duration::from_millis(k)).await;
        }
        if k % 2 == 0 {
            Call::post(&format!("{path}/cancel"), "").send(&site).await;
            assert_eq!(site.ended(&path).await["status"], "dismissed");
        } else {
            let reply = Call::new("DELETE", &path).send(&site).await;
            assert_eq!(reply.status, StatusCode::NO_CONTENT);
        }
    }
    site.idle().await;
    assert_eq!(Call::solve(relays(2)).send(&site).await.status, StatusCode::OK);
}

async fn a_member_that_takes_its_worker_down_fails_as_a_row_and_no_other_does() {
    const BAD: [usize; 3] = [0, 123, 124];
    let deaths = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&deaths);
    let solver: Solver = Arc::new(move |specification, control| {
        let chunk = specification.sweep().unwrap().chunk();
        if chunk.lost.is_none() && BAD.iter().any(|bad| chunk.members.contains(bad)) {
            counted.fetch_add(1, Relaxed);
            panic!("a defect that the test made");
        }
        dvi::solve(specification, control)
    });
    let site = Site::new(Options { workers: count(3), ..one_worker() }, solver);
    let document = relays(300);
    let json = Call::solve(document.clone()).send(&site).await.json();
    let whole: Value = serde_json::from_slice(&undisturbed(&document)).unwrap();
    let (columns, expected) = (&json["table"]["columns"], &whole["table"]["columns"]);
    for k in 0..300 {
        if BAD.contains(&k) {
            assert_eq!(columns["error"][k], "defect: the member took its worker down");
            assert_eq!((&columns["status"][k], &columns["trusted"][k]), (&"failed".into(), &false.into()));
            assert!(columns["x"][k].is_null() && columns["k"][k] == expected["k"][k]);
        } else {
            for (name, values) in expected.as_object().unwrap() {
                assert_eq!(columns[name][k], values[k], "{name} of member {k}");
            }
        }
    }
    assert_eq!(json["table"]["failed"], BAD.len());
    let deaths = deaths.load(Relaxed);
    assert!(deaths <= 10 * BAD.len(), "{deaths} workers for {} members", BAD.len());
}

async fn a_member_that_never_ends_fails_as_a_row() {
    let options = Options { wall_seconds: NonZeroU64::MIN, workers: count(2), ..one_worker() };
    let site = Site::new(options, solver());
    // The member with w = 1e8 needs steps of a millionth of the end time and smaller ones.
    let document = r#"{"problem": {"dvi": {"parameters": {"w": 1}, "states": {"x": {"initial": 0, "rate": "cos(w*t)"}}}}, "time": {"end": 1},
        "sweep": {"over": {"w": [1, 1e8, 2, 3]}}}"#;
    let json = Call::solve(document).send(&site).await.json();
    let columns = &json["table"]["columns"];
    assert_eq!(columns["error"], serde_json::json!([null, "wall_time: the member took more than 1 s", null, null]));
    for (k, w) in [(0, 1.0), (2, 2.0), (3, 3.0_f64)] {
        let x = columns["x"][k].as_f64().unwrap();
        assert!((x - w.sin() / w).abs() < 1e-5, "{x} of {w}");
    }
    // A time limit in the specification applies to the whole sweep; the rows that are finished by then are kept.
    let document = relays(1_000_000).replace("\"time\"", "\"limits\": {\"wall_seconds\": 1.5}, \"time\"");
    let path = site.post(1, &document).await;
    let ended = site.ended(&path).await;
    assert_eq!(ended["status"], "failed", "{ended}");
    let json = site.get(&format!("{path}/results")).await.json();
    assert_eq!(json["error"]["code"], "wall_time");
    assert!(json["table"]["columns"]["x"].as_array().unwrap().len() > 1);
}

async fn events_tell_the_rows_that_are_done() {
    let site = site();
    let path = site.post(1, &relays(3000)).await;
    let reply = site.get(&format!("{path}/events")).await;
    let told: Vec<Value> = reply
        .text()
        .lines()
        .filter_map(|line| line.strip_prefix("data: "))
        .map(|data| serde_json::from_str(data).unwrap())
        .collect();
    let done: Vec<u64> = told.iter().map(|status| status["members"]["done"].as_u64().unwrap()).collect();
    assert!(done.is_sorted() && done.last() == Some(&3000), "{done:?}");
    assert_eq!(told.last().unwrap()["progress"], 100);
}
