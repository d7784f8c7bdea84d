//! Limits of the service: requests beyond them are refused, and no client is starved by others.

use crate::harness::{Arrival, Call, DECAY, Gate, Scripted, Site, count, halving, instant, one_worker, within};
use axum::body::Body;
use axum::http::StatusCode;
use dvi::service::worker::{Confinement, Launcher, Order, Report, Start, VERSION, frame};
use dvi::service::{Options, Service};
use dvi::solution::Status;
use std::io;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;
use tokio::sync::watch;

#[tokio::test]
async fn a_late_client_runs_before_the_rest_of_a_busy_one() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    let mut busy = Vec::new();
    for _ in 0..4 {
        busy.push(site.accept(1).await);
    }
    gate.entered(1).await;
    let late = site.accept(2).await;
    assert_eq!(site.get(&late).await.json()["queue_position"], 1);
    for (served, expected) in [&busy[0], &busy[1], &late, &busy[2], &busy[3]].into_iter().enumerate() {
        gate.entered(served + 1).await;
        assert_eq!(site.get(expected).await.json()["status"], "running", "place {served}");
        gate.let_through(1);
        site.ended(expected).await;
    }
}

#[tokio::test]
async fn a_full_queue_says_when_to_come_back() {
    let gate = Gate::new();
    let site = Site::new(Options { queue: count(2), ..one_worker() }, gate.solver());
    let running = site.accept(1).await;
    gate.entered(1).await;
    let waiting = [site.accept(1).await, site.accept(2).await];
    let refused = Call::solve(DECAY).client(3).send(&site).await;
    refused.problem(429, "queue-full");
    assert!((1..=600).contains(&refused.header("retry-after").parse::<u64>().unwrap()));
    let cancelled = Call::new("POST", &format!("{}/cancel", waiting[0])).send(&site).await;
    assert_eq!(cancelled.json()["status"], "dismissed", "cancelling passes a full queue by");
    site.accept(3).await;
    gate.let_through(3);
    assert_eq!(site.ended(&running).await["status"], "successful");
    assert_eq!(site.ended(&waiting[1]).await["status"], "successful");
}

#[tokio::test]
async fn what_waits_is_bounded_in_bytes_too() {
    let gate = Gate::new();
    let site = Site::new(Options { queue_mib: count(1), ..one_worker() }, gate.solver());
    let large = format!("{DECAY}{}", " ".repeat(600 << 10));
    let post = async || Call::solve(large.clone()).header("prefer", "respond-async").send(&site).await;
    assert_eq!(post().await.status, StatusCode::ACCEPTED);
    gate.entered(1).await;
    assert_eq!(post().await.status, StatusCode::ACCEPTED, "what runs does not wait");
    let refused = post().await;
    refused.problem(429, "queue-bytes");
    assert!((1..=600).contains(&refused.header("retry-after").parse::<u64>().unwrap()));
    let small = site.accept(1).await;
    gate.let_through(3);
    assert_eq!(site.ended(&small).await["status"], "successful");
    assert_eq!(site.service.jobs().waiting_bytes(), 0);
}

#[tokio::test]
async fn a_solve_stops_at_the_steps_that_the_service_allows_unless_it_is_to_stop_before() {
    let site = Site::new(Options { steps: NonZeroU64::new(3).unwrap(), ..one_worker() }, Arc::new(dvi::solve));
    let fewer = DECAY.replacen('{', "{\"limits\":{\"steps\":2},", 1);
    let more = DECAY.replacen('{', "{\"limits\":{\"steps\":1000},", 1);
    for (document, steps) in [(DECAY, 3), (&fewer, 2), (&more, 3)] {
        let result = Call::solve(document.to_owned()).send(&site).await.json();
        assert_eq!((&result["status"], &result["error"]["code"]), (&"stopped".into(), &"steps".into()), "{result}");
        assert_eq!(result["diagnostics"]["steps"]["accepted"], steps);
    }
}

#[tokio::test]
async fn a_solve_that_would_take_too_much_memory_is_refused_with_what_it_would_take() {
    let site = Site::new(Options { memory_mib: count(2), ..one_worker() }, instant());
    let with_times =
        |count: u32| DECAY.replace("}}}},", &format!("}}}}}}}},\"output\":{{\"times\":{{\"count\":{count}}}}},"));
    let refused = Call::solve(with_times(400_000)).header("idempotency-key", "k").send(&site).await;
    let problem = refused.problem(422, "too-much-memory");
    // The memory estimate of the job covers 400,000 output times and as many values, of eight bytes each.
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("6 MiB") && detail.contains("--memory-mib"), "{detail}");
    assert_eq!(site.get("/jobs").await.json()["jobs"], serde_json::json!([]));
    let bytes = Call::check(with_times(400_000)).send(&site).await.json()["memory_bytes"].as_u64().unwrap();
    assert!((6_400_000..6_500_000).contains(&bytes), "{bytes}");
    let fits = Call::solve(with_times(100_000)).header("idempotency-key", "k").send(&site).await;
    assert_eq!(fits.status, StatusCode::OK, "a refused request does not use up its key");
}

#[tokio::test]
async fn one_client_cannot_have_the_whole_queue() {
    let gate = Gate::new();
    let site = Site::new(Options { queue: count(10), client_share: count(2), ..one_worker() }, gate.solver());
    site.accept(1).await;
    gate.entered(1).await;
    site.accept(1).await;
    site.accept(1).await;
    let refused = Call::solve(DECAY).client(1).send(&site).await;
    refused.problem(429, "client-share");
    assert!(refused.header("retry-after").parse::<u64>().unwrap() >= 1);
    site.accept(2).await;
}

#[tokio::test]
async fn a_service_that_stops_takes_nothing_on_but_answers_for_what_it_has() {
    let gate = Gate::new();
    let site = Site::new(one_worker(), gate.solver());
    assert_eq!(site.get("/readyz").await.status, StatusCode::OK);
    let path = site.accept(1).await;
    gate.entered(1).await;
    site.service.jobs().drain();
    site.get("/readyz").await.problem(503, "draining");
    let refused = Call::solve(DECAY).send(&site).await;
    refused.problem(503, "draining");
    assert!(refused.headers.contains_key("retry-after"));
    assert_eq!(site.get("/healthz").await.status, StatusCode::OK);
    gate.let_through(1);
    assert_eq!(site.ended(&path).await["status"], "successful");
    site.idle().await;
}

#[tokio::test]
async fn a_body_over_the_bound_is_refused_by_its_length_and_by_its_bytes() {
    let site = Site::new(Options { body_mib: count(1), ..one_worker() }, instant());
    let long = "x".repeat((1 << 20) + 1);
    Call::solve(long.clone()).send(&site).await.problem(413, "body-too-large");
    let (first, second) = long.split_at(1 << 19);
    let pieces = Scripted(vec![Arrival::Piece(second.to_owned()), Arrival::Piece(first.to_owned())]);
    Call::solve(Body::new(pieces)).send(&site).await.problem(413, "body-too-large");
}

#[tokio::test(start_paused = true)]
async fn a_body_that_does_not_come_is_waited_for_only_so_long() {
    let site = Site::new(one_worker(), instant());
    let stalls = Scripted(vec![Arrival::Never, Arrival::Piece("{".to_owned())]);
    Call::solve(Body::new(stalls)).send(&site).await.problem(408, "body-timeout");
}

#[tokio::test]
async fn a_body_that_breaks_off_is_said_to() {
    let site = Site::new(one_worker(), instant());
    let breaks = Scripted(vec![Arrival::Broken, Arrival::Piece("{".to_owned())]);
    Call::solve(Body::new(breaks)).send(&site).await.problem(400, "bad-request");
}

#[tokio::test]
async fn a_client_that_holds_every_worker_does_not_hold_up_another() {
    let gate = Gate::new();
    let options = Options { workers: count(2), relief: 1, ..Options::default() };
    let site = Site::new(options, labelled_or_held(&gate));
    let held: Vec<_> = [site.accept(1).await, site.accept(1).await, site.accept(1).await].into();
    gate.entered(2).await;
    // Short jobs of other clients are solved one after the other, although the first client has jobs on both workers
    // and a third one in the queue.
    for client in [2, 2, 3] {
        let path = short(&site, client).await;
        assert_eq!(site.ended(&path).await["status"], "successful");
        assert_eq!(site.get(&held[2]).await.json()["status"], "accepted", "it has its workers");
    }
    // One of the long jobs has been stopped at the end of its first time slice.
    gate.cancelled(1).await;
    gate.let_through(3);
    for path in &held {
        assert_eq!(site.ended(path).await["status"], "successful");
    }
}

#[tokio::test]
async fn a_long_job_of_a_client_who_has_none_runs_in_relief() {
    let gate = Gate::new();
    let options = Options { workers: count(1), express: 1, relief: 1, ..Options::default() };
    let site = Site::new(options, gate.solver());
    let first = site.accept(1).await;
    site.runs(&first).await;
    let held = [first, site.accept(1).await];
    let other = site.accept(2).await;
    site.runs(&other).await;
    assert_eq!(site.get(&held[1]).await.json()["status"], "accepted", "its client has a worker");
    // Two jobs have been stopped at the ends of their first time slices.
    gate.cancelled(2).await;
    gate.let_through(3);
    for path in held.iter().chain([&other]) {
        assert_eq!(site.ended(path).await["status"], "successful");
    }
}

/// Posts a short job for `client`, whose label exempts it from the gate that blocks solves, and returns its path.
async fn short(site: &Site, client: u8) -> String {
    let document = DECAY.replacen('{', "{\"label\":\"short\",", 1);
    let call = Call::solve(document).client(client).header("prefer", "respond-async");
    call.send(site).await.header("location").to_owned()
}

/// Returns a solver that is blocked until `gate` lets it through, except for jobs with a label, which are solved at
/// once.
fn labelled_or_held(gate: &Arc<Gate>) -> dvi::service::jobs::Solver {
    let held = gate.solver();
    Arc::new(move |specification, control| match specification.label() {
        Some(_) => halving(Status::Completed),
        None => held(specification, control),
    })
}

#[tokio::test]
async fn a_new_job_waits_for_no_job_that_has_had_its_first_slice() {
    let gate = Gate::new();
    let options = Options { workers: count(2), express: 1, relief: 0, ..Options::default() };
    let site = Site::new(options, labelled_or_held(&gate));
    let mut held = Vec::new();
    for client in [1, 1, 2, 3] {
        held.push(site.accept(client).await);
        if held.len() <= 2 {
            site.runs(&held[held.len() - 1]).await;
        }
    }
    // Each of the other jobs has used its first time slice and has given up its worker; its status is still
    // `accepted`.
    gate.cancelled(2).await;
    for path in &held[2..] {
        let state = site.get(path).await.json();
        assert_eq!((&state["status"], &state["steps"], state.get("started")), (&"accepted".into(), &0.into(), None));
    }
    for client in [1, 2, 4] {
        let short = short(&site, client).await;
        assert_eq!(site.ended(&short).await["status"], "successful");
        assert!(site.get("/metrics").await.text().contains("dvi_jobs_long 2\n"));
    }
    // Each interrupted job starts again when a worker is free, and none is lost.
    gate.let_through(4);
    for path in &held {
        assert_eq!(site.ended(path).await["status"], "successful");
    }
    site.idle().await;
    let figures = site.get("/metrics").await;
    let yielded = figures.text().lines().find_map(|line| line.strip_prefix("dvi_jobs_yielded_total ")).unwrap();
    assert_eq!(yielded, "2");
    assert!(figures.text().contains("dvi_jobs_long 0\n"));
}

/// Returns a launcher of workers that need some time to read a document, and then solve it until they are cancelled.
/// `early` counts the documents that are cancelled while they are read, `late` those that are cancelled during their
/// solve.
fn slow_readers(early: &watch::Sender<usize>, late: &watch::Sender<usize>) -> Launcher {
    let counts = (early.clone(), late.clone());
    Arc::new(move || {
        let ((mut input, orders), (reports, mut output)) = (io::pipe()?, io::pipe()?);
        let (early, late) = counts.clone();
        let (send, arrivals) = channel();
        thread::spawn(move || {
            while let Ok(Some((order, _))) = frame::read::<Order>(&mut input) {
                if !matches!(order, Order::Look { .. }) && send.send(order).is_err() {
                    break;
                }
            }
        });
        thread::spawn(move || -> io::Result<()> {
            let mut report = |report: &Report| frame::write(&mut output, report, b"[]");
            report(&Report::Ready { version: VERSION, confinement: Confinement::default() })?;
            while let Ok(order) = arrivals.recv() {
                // A request to stop may arrive after the end of the task that it is for, and is ignored.
                let Order::Solve { task, .. } = order else { continue };
                report(&Report::Taken { task })?;
                if arrivals.recv_timeout(READING).is_ok() {
                    early.send_modify(|n| *n += 1);
                } else {
                    report(&Report::Begun { task })?;
                    if arrivals.recv().is_ok() {
                        late.send_modify(|n| *n += 1);
                    }
                }
                report(&Report::Refused { task, interrupted: true })?;
            }
            Ok(())
        });
        Ok(Start { orders: orders.into(), reports: reports.into(), process: None })
    })
}

/// Time that a worker needs to read a document, longer than the first time slice of a job.
const READING: Duration = Duration::from_millis(500);

#[tokio::test]
async fn a_first_time_slice_is_not_over_before_the_solve_has_begun() {
    let (early, late) = (watch::Sender::new(0), watch::Sender::new(0));
    let options = Options { workers: count(1), express: 1, relief: 0, ..Options::default() };
    let stopped = Arc::new(|_: &_, _: &_| halving(Status::Stopped));
    let service = Service::start(options, stopped, &slow_readers(&early, &late)).unwrap();
    let site = Site::of(service);
    let first = site.accept(1).await;
    site.runs(&first).await;
    let second = site.accept(2).await;
    let mut late = late.subscribe();
    within("the second job yields".to_owned(), late.wait_for(|late| *late == 1)).await.unwrap();
    assert_eq!(*early.borrow(), 0, "a job was stopped that had not begun");
    assert_eq!(site.get(&second).await.json()["status"], "accepted");
}

#[tokio::test]
async fn a_job_that_makes_room_is_seen_to_start_and_to_switch_once() {
    let gate = Gate::new();
    let options = Options { workers: count(1), express: 1, relief: 0, ..Options::default() };
    let site = Site::new(options, gate.solver());
    let first = site.accept(1).await;
    site.runs(&first).await;
    let second = site.accept(2).await;
    let events = tokio::spawn(Call::new("GET", &format!("{second}/events")).client(2).send_to(site.router.clone()));
    gate.cancelled(1).await;
    assert_eq!(site.get(&second).await.json()["status"], "accepted");
    gate.let_through(1);
    site.ended(&first).await;
    site.runs(&second).await;
    gate.let_through(1);
    assert_eq!(site.ended(&second).await["attempt"], 1);
    let told = events.await.unwrap();
    let words = told.text().split("\"status\":\"").skip(1).filter_map(|rest| rest.split('"').next());
    let states = ["accepted", "running", "successful"];
    let seen: Vec<_> = words.map(|word| states.iter().position(|state| *state == word)).collect();
    // Polling may miss a state of the job, but must not report one twice.
    assert!(seen.is_sorted() && seen.last() == Some(&Some(2)), "{}", told.text());
}

#[tokio::test]
async fn a_job_that_made_room_can_be_cancelled_and_forgotten_where_it_waits() {
    let gate = Gate::new();
    let options = Options { workers: count(1), express: 1, relief: 0, ..Options::default() };
    let site = Site::new(options, gate.solver());
    let held = site.accept(1).await;
    site.runs(&held).await;
    let (cancelled, forgotten) = (site.accept(2).await, site.accept(3).await);
    gate.cancelled(2).await;
    let state = Call::new("POST", &format!("{cancelled}/cancel")).send(&site).await.json();
    assert_eq!(state["status"], "dismissed");
    assert_eq!(Call::new("DELETE", &forgotten).send(&site).await.status, StatusCode::NO_CONTENT);
    gate.let_through(1);
    assert_eq!(site.ended(&held).await["status"], "successful");
    site.idle().await;
    gate.entered(3).await;
    assert_eq!(site.get(&cancelled).await.json()["status"], "dismissed");
}
