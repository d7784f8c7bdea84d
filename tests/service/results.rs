//! Results in every representation, in part, compressed, and with conditional requests.

use crate::harness::{Call, DECAY, Reply, Site, halving, one_worker};
use crate::nats::on_both;
use crate::process::{Folder, Server};
use arrow_array::cast::AsArray;
use arrow_array::types::Float64Type;
use arrow_ipc::reader::StreamReader;
use axum::http::StatusCode;
use dvi::problem::{Event, EventKind};
use dvi::solution::{Field, Status};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;

on_both! {
    json_lines_have_an_object_a_time,
    a_part_has_the_fields_and_the_times_asked_for_in_every_form,
    a_client_that_has_the_results_is_not_sent_them_again,
}

/// Returns a service whose solver always returns `t = 0, 1, .., n - 1`, `x = t^2` and `i(R1,a) = -t`, and the path to
/// the results of a job.
async fn squares(n: u32) -> (Site, String) {
    let solver: dvi::service::jobs::Solver = Arc::new(move |_, _| {
        let mut solution = halving(Status::Completed);
        let t: Vec<f64> = (0..n).map(f64::from).collect();
        let column = |name: &str, values| Field { name: name.to_owned(), values };
        solution.trajectory.fields =
            vec![column("x", t.iter().map(|t| t * t).collect()), column("i(R1,a)", t.iter().map(|t| -t).collect())];
        solution.trajectory.events = vec![Event { t: 2.5, kind: EventKind::Activated, of: "z".to_owned() }];
        solution.trajectory.t = t;
        solution.diagnostics.switches = 77;
        solution
    });
    let site = Site::new(one_worker(), solver);
    let path = site.accept(1).await;
    site.ended(&path).await;
    (site, format!("{path}/results"))
}

async fn get(site: &Site, path: &str, accept: &str) -> Reply {
    let reply = Call::new("GET", path).header("accept", accept).send(site).await;
    assert_eq!(reply.status, StatusCode::OK, "{path}");
    reply
}

async fn json_lines_have_an_object_a_time() {
    let (site, path) = squares(5000).await;
    let reply = get(&site, &path, "application/x-ndjson").await;
    assert_eq!(reply.header("content-type"), "application/x-ndjson");
    assert_eq!(reply.text().lines().count(), 5000);
    assert_eq!(reply.text().lines().nth(3), Some("{\"t\":3.0,\"x\":9.0,\"i(R1,a)\":-3.0}"));
}

#[tokio::test]
async fn an_arrow_stream_has_the_columns() {
    let (site, path) = squares(5000).await;
    let reply = get(&site, &format!("{path}?fields=x"), "application/vnd.apache.arrow.stream").await;
    let reader = StreamReader::try_new(reply.body.as_slice(), None).unwrap();
    assert_eq!(reader.schema().fields().iter().map(|field| field.name()).collect::<Vec<_>>(), ["t", "x"]);
    let mut rows = 0;
    for batch in reader.map(Result::unwrap) {
        let (t, x) = (batch.column(0).as_primitive::<Float64Type>(), batch.column(1).as_primitive::<Float64Type>());
        assert!(t.values().iter().zip(x.values()).all(|(t, x)| x == &(t * t)));
        rows += batch.num_rows();
    }
    assert_eq!(rows, 5000);
}

#[cfg(feature = "parquet")]
#[tokio::test]
async fn a_file_of_parquet_is_that_of_the_program() {
    use dvi::solution::encodings::Form;
    use dvi::solution::{Solution, Trajectory};

    let (site, path) = squares(5000).await;
    let reply = get(&site, &format!("{path}?fields=x"), "application/vnd.apache.parquet").await;
    assert_eq!(reply.header("content-type"), "application/vnd.apache.parquet");
    let whole = dvi::solution::encodings::read_json(&get(&site, &path, "application/json").await.body).unwrap();
    let t: Vec<f64> = (0..5000).map(f64::from).collect();
    let fields = vec![Field { name: "x".to_owned(), values: t.iter().map(|t| t * t).collect() }];
    let mut file = Vec::new();
    Form::Parquet
        .write(&Solution { trajectory: Trajectory { t, fields, events: vec![] }, ..whole }, None, &mut file)
        .unwrap();
    assert!(reply.body == file, "{} of {} bytes", reply.body.len(), file.len());
}

async fn a_part_has_the_fields_and_the_times_asked_for_in_every_form() {
    let (site, path) = squares(10).await;
    let part = format!("{path}?fields=i(R1%2Ca)&from=1.5&to=8&every=3");
    assert_eq!(get(&site, &part, "text/csv").await.text(), "t,\"i(R1,a)\"\n2.0,-2.0\n5.0,-5.0\n8.0,-8.0\n");
    let json = get(&site, &part, "application/json").await.json();
    assert_eq!(json["trajectory"]["t"], serde_json::json!([2.0, 5.0, 8.0]));
    assert_eq!(json["trajectory"]["fields"], serde_json::json!({"i(R1,a)": [-2.0, -5.0, -8.0]}));
    assert_eq!(json["trajectory"]["events"][0]["t"], 2.5);
    assert_eq!((&json["status"], &json["diagnostics"]["switches"]), (&"completed".into(), &77.into()));
    let late = get(&site, &format!("{path}?from=3"), "application/json").await.json();
    assert_eq!(late["trajectory"]["events"], serde_json::json!([]));
    assert!(get(&site, &part, "image/svg+xml").await.text().contains("i(R1,a)"));
}

#[tokio::test]
async fn what_a_query_has_wrong_is_named() {
    let (site, path) = squares(10).await;
    for (query, told) in [
        ("fields=x,y", "there is no y; there are x, i(R1,a)"),
        ("every=0", "every is a whole number from one"),
        ("every=-1", "every is a whole number from one"),
        ("from=nan", "from is a finite number"),
        ("form=csv", "form is not a parameter here; the parameters are fields, from, to, every"),
        ("from=1&from=2", "from is repeated"),
        ("%ff=%00", "is not a parameter here"),
    ] {
        let problem = site.get(&format!("{path}?{query}")).await.problem(400, "bad-query");
        assert!(problem["detail"].as_str().unwrap().contains(told), "{query}: {problem}");
    }
    let every = format!("{path}?every=18446744073709551615");
    assert_eq!(get(&site, &every, "text/csv").await.text().lines().count(), 2);
}

async fn a_client_that_has_the_results_is_not_sent_them_again() {
    let (site, path) = squares(10).await;
    let first = get(&site, &path, "text/csv").await;
    let tag = first.header("etag").to_owned();
    assert_eq!(first.header("cache-control"), "private, no-cache");
    for known in [tag.clone(), format!("\"other\", {}", tag.trim_start_matches("W/")), "*".to_owned()] {
        let again = Call::new("GET", &path).header("accept", "text/csv").header("if-none-match", &known);
        let again = again.send(&site).await;
        assert_eq!((again.status, again.body.len()), (StatusCode::NOT_MODIFIED, 0), "{known}");
        assert_eq!((again.header("etag"), again.header("vary").contains("accept")), (tag.as_str(), true));
    }
    for (path, accept) in [(path.clone(), "application/json"), (format!("{path}?every=2"), "text/csv")] {
        let other = Call::new("GET", &path).header("accept", accept).header("if-none-match", &tag).send(&site).await;
        assert_eq!(other.status, StatusCode::OK, "{path} as {accept}");
        assert_ne!(other.header("etag"), tag);
    }
}

#[tokio::test]
async fn results_are_compressed_for_who_takes_them_so() {
    let (site, path) = squares(5000).await;
    let plain = get(&site, &path, "text/csv").await;
    assert!(!plain.headers.contains_key("content-encoding"));
    let call = Call::new("GET", &path).header("accept", "text/csv").header("accept-encoding", "br, gzip");
    let small = call.send(&site).await;
    assert_eq!(small.header("content-encoding"), "gzip");
    assert!(small.headers.get_all("vary").iter().any(|value| value.to_str().unwrap().contains("accept-encoding")));
    assert!(2 * small.body.len() < plain.body.len(), "{} of {}", small.body.len(), plain.body.len());
    let mut text = String::new();
    flate2::read::GzDecoder::new(small.body.as_slice()).read_to_string(&mut text).unwrap();
    assert_eq!(text, plain.text());
    assert_eq!(small.header("etag"), plain.header("etag"));
}

#[tokio::test]
async fn a_stream_of_events_is_not_compressed() {
    let (site, _) = squares(10).await;
    let call = Call::solve(DECAY).header("accept", "text/event-stream").header("accept-encoding", "gzip");
    assert!(!call.send(&site).await.headers.contains_key("content-encoding"));
}

/// Tests that twenty-four clients that read a long result slowly take little more memory than the service permits for
/// all responses, and far less than twenty-four whole responses.
#[test]
fn slow_readers_of_a_long_result_take_bounded_memory() {
    const READERS: usize = 24;
    const ANSWERS_MIB: u64 = 8;
    let folder = Folder::new();
    let server = Server::start(&folder, &["--answers-mib", &ANSWERS_MIB.to_string(), "--workers", "1"]);
    let states: serde_json::Map<String, Value> =
        (0..10).map(|k| (format!("x{k}"), json!({"initial": 1, "rate": format!("-x{k}")}))).collect();
    let document = json!({
        "problem": {"dvi": {"states": states}}, "time": {"end": 1}, "output": {"times": {"count": 400_000}},
    });
    let path = server.accept(&document.to_string());
    server.reaches(&path, &["successful"]);
    for (accept, query, whole_mib) in [("application/json", "", 60)] {
        let before = server.resident_kib() >> 10;
        let ask = |_| {
            let mut stream = TcpStream::connect(&server.address).unwrap();
            write!(stream, "GET {path}/results{query} HTTP/1.0\r\nhost: localhost\r\naccept: {accept}\r\n\r\n")
                .unwrap();
            stream
        };
        let mut readers: Vec<TcpStream> = (0..READERS).map(ask).collect();
        let (mut piece, mut most) = ([0; 4096], 0);
        for _ in 0..20 {
            for reader in &mut readers {
                assert!(reader.read(&mut piece).unwrap() > 0);
            }
            most = most.max(server.resident_kib() >> 10);
        }
        println!("{accept} {query}: {most} MiB at most, {before} before");
        // In addition to its limit for all responses, the service never holds a whole response in memory.
        assert!(most < before + ANSWERS_MIB + whole_mib, "{most} MiB, {before} before");
    }
}

#[test]
fn what_was_waited_for_takes_an_eighth_of_what_is_kept_and_nothing_from_the_disk() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--kept-mib", "8", "--workers", "1"]);
    let stored = server.accept(DECAY);
    server.reaches(&stored, &["successful"]);
    let solve = |k: u32| {
        let document = DECAY
            .replace("-x", &format!("-{k}*x"))
            .replace("{\"end\":1}}", "{\"end\":1},\"output\":{\"times\":{\"count\":1001}}}");
        let answer = server.send("POST", "/solve", "", &document);
        assert_eq!(answer.status, 200, "{}", answer.body);
        let link = answer.header("link");
        (link[1..].split('>').next().unwrap().to_owned(), answer.body.len())
    };
    let solved: Vec<(String, usize)> = (1..=60).map(solve).collect();
    let is_known = |path: &str| server.get(path).status == 200;
    let bytes: usize = solved.iter().filter(|(path, _)| is_known(path)).map(|(_, bytes)| bytes).sum();
    assert!((1 << 19..=1 << 20).contains(&bytes), "{bytes} bytes");
    assert!(!is_known(&solved[0].0) && is_known(&solved[59].0) && is_known(&stored));
}
