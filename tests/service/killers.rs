//! Short requests that declare or imply a lot of work: the service keeps answering other clients, within its memory.

use crate::harness::{Call, Site, count, one_worker};
use crate::process::{Folder, Server};
use axum::http::StatusCode;
use dvi::service::Options;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

/// Specification of a heat equation above an obstacle in a cube with `elements` elements in each direction, in some
/// 200 bytes.
fn cube(elements: u32) -> String {
    format!(
        r#"{{"problem":{{"obstacle":{{"domain":{{"x":[0,1],"y":[0,1],"z":[0,1]}},"elements":{elements},"diffusion":"1+x*y",
            "initial":"sin(x)*sin(y)","obstacle":"-x"}}}},"time":{{"end":1}}}}"#
    )
}

/// Specification of spheres at one and the same place, so that each sphere touches all others.
fn coincident(spheres: usize) -> String {
    let sphere = r#"{"shape":{"sphere":{"radius":1}},"density":1}"#;
    let bodies = vec![sphere; spheres].join(",");
    format!(
        r#"{{"problem":{{"rigid_bodies":{{"bodies":[{bodies}],"interpenetration":"resolve"}}}},"time":{{"end":1}},
            "method":{{"step":0.01}}}}"#
    )
}

#[test]
fn few_words_that_declare_much_keep_nobody_waiting() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "2"]);
    let checked = AtomicBool::new(false);
    let (mut slowest, mut most) = (Duration::ZERO, 0);
    thread::scope(|scope| {
        let check = || {
            let answers = (0..4).map(|_| scope.spawn(|| server.send("POST", "/check", "", &cube(100))));
            let spheres = scope.spawn(|| server.send("POST", "/check", "", &coincident(700)));
            answers.collect::<Vec<_>>().into_iter().chain([spheres]).map(|answer| answer.join().unwrap().status)
        };
        let checks: Vec<_> = {
            let watch = scope.spawn(|| {
                let (mut slowest, mut most) = (Duration::ZERO, 0);
                while !checked.load(Relaxed) {
                    let start = Instant::now();
                    assert_eq!(server.get("/healthz").status, 200);
                    slowest = slowest.max(start.elapsed());
                    most = most.max(server.resident_kib());
                    thread::sleep(Duration::from_millis(5));
                }
                (slowest, most)
            });
            let checks = check().collect();
            checked.store(true, Relaxed);
            (slowest, most) = watch.join().unwrap();
            checks
        };
        assert_eq!(checks, [200; 5]);
    });
    println!("the slowest answer took {slowest:?}; {} MiB at most", most >> 10);
    // On a busy machine a response may take a second without any load on the service.
    assert!(slowest < Duration::from_secs(5), "{slowest:?}");
    assert!(most < 1 << 20, "{most} KiB");
}

#[tokio::test]
async fn contacts_that_would_take_too_much_memory_are_refused_before_they_do() {
    let site = Site::new(Options { memory_mib: count(512), ..one_worker() }, Arc::new(dvi::solve));
    let problem = Call::solve(coincident(1000)).send(&site).await.problem(422, "too-much-memory");
    // Each of 1000 spheres has 999 contacts: 1000 * 999 / 2 contacts of some 1400 bytes, and further storage per
    // contact.
    let mib: f64 = problem["detail"].as_str().unwrap().split(' ').nth(1).unwrap().parse().unwrap();
    assert!((650.0..2_000.0).contains(&mib), "{problem}");
    let bytes = Call::check(coincident(1000)).send(&site).await.json()["memory_bytes"].as_f64().unwrap();
    assert!((bytes / f64::from(1 << 20) - mib).abs() < 1.0, "{bytes} bytes are not {mib} MiB");
    let fits = Call::check(coincident(30)).send(&site).await.json()["memory_bytes"].as_u64().unwrap();
    assert!(fits < 512 << 20, "{fits}");
}

#[tokio::test]
async fn a_check_takes_no_longer_than_a_job_may() {
    let options = Options { wall_seconds: NonZeroU64::MIN, ..one_worker() };
    let site = Site::new(options, Arc::new(dvi::solve));
    // A row of 9,000 spheres whose bounding boxes overlap and whose surfaces do not: forty million pairs to examine.
    let along = |k: u32| f64::from(k) * 1e-6;
    let sphere = |k: u32| {
        let (x, y) = (along(k), if k.is_multiple_of(2) { 0.0 } else { 1.9 });
        format!(r#"{{"shape":{{"sphere":{{"radius":1}}}},"density":1,"position":[{x},{y},{y}]}}"#)
    };
    let bodies: Vec<String> = (0..9_000).map(sphere).collect();
    let document = format!(
        r#"{{"problem":{{"rigid_bodies":{{"bodies":[{}],"interpenetration":"resolve"}}}},"time":{{"end":1}},
            "method":{{"step":0.01}}}}"#,
        bodies.join(",")
    );
    let start = Instant::now();
    let reply = Call::check(document).send(&site).await;
    if reply.status != StatusCode::OK {
        reply.problem(422, "check-time");
    }
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
}

#[test]
fn a_worker_is_free_soon_after_its_job_of_many_contacts_is_deleted() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    // The job fits into the memory limit of a job, and is far from its end when the test deletes it.
    let path = server.accept(&coincident(120));
    server.reaches(&path, &["running"]);
    thread::sleep(Duration::from_millis(500));
    assert_eq!(server.send("DELETE", &path, "", "").status, 204);
    let start = Instant::now();
    while !server.get("/metrics").body.contains("dvi_jobs_running 0\n") {
        assert!(start.elapsed() < Duration::from_secs(20), "the worker is still at it");
        thread::sleep(Duration::from_millis(5));
    }
    println!("free after {:?}", start.elapsed());
}
