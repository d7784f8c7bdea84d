//! Durable jobs: admitted jobs survive a kill of the process, and end exactly once.

use crate::harness::DECAY;
use crate::process::{DVI, Folder, Server, send};
use std::process::Command;
use std::thread;

/// Specification of a harmonic oscillator with the end time `end`.
fn oscillator(end: u32) -> String {
    format!(
        r#"{{"problem":{{"dvi":{{"states":{{"x":{{"initial":1,"rate":"v"}},"v":{{"initial":0,"rate":"-x"}}}}}}}},
            "time":{{"end":{end}}}}}"#
    )
}

/// End time of a specification that no solve of these tests reaches.
const ENDLESS: u32 = 100_000_000;

#[test]
fn what_was_accepted_survives_a_kill_and_what_had_ended_is_the_same_to_the_byte() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    let ended = server.accept(DECAY);
    let before = server.reaches(&ended, &["successful"]);
    assert_eq!(before["trusted"], true);
    let results = server.get(&format!("{ended}/results")).body;
    let running = server.accept(&oscillator(ENDLESS));
    server.reaches(&running, &["running"]);
    let waiting = server.accept(&DECAY.replace("-x", "-2*x"));
    server.kill();

    let server = Server::start(&folder, &["--workers", "2"]);
    assert_eq!(server.get(&ended).json(), before);
    assert_eq!(server.get(&format!("{ended}/results")).body, results);
    assert_eq!(server.get(&format!("{waiting}/specification")).body, DECAY.replace("-x", "-2*x"));
    let again = server.reaches(&running, &["running"]);
    assert_eq!(again["attempt"], 2);
    server.send("POST", &format!("{running}/cancel"), "", "");
    assert_eq!(server.reaches(&running, &["dismissed"])["attempt"], 2);
    server.reaches(&waiting, &["successful"]);
    let csv = server.send("GET", &format!("{waiting}/results"), "accept: text/csv\r\n", "").body;
    let last: f64 = csv.lines().last().unwrap().split(',').nth(1).unwrap().parse().unwrap();
    assert!((last - (-2.0_f64).exp()).abs() < 1e-6, "{last}");
}

#[test]
fn a_signal_to_stop_leaves_what_runs_and_what_waits_to_the_next_start() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--grace-seconds", "1"]);
    let running = server.accept(&oscillator(ENDLESS));
    server.reaches(&running, &["running"]);
    let waiting = server.accept(DECAY);
    let (status, told) = server.stop();
    assert!(status.success(), "{told}");

    let server = Server::start(&folder, &["--workers", "2"]);
    // A regular stop of the service does not count as a failed attempt of the job.
    assert_eq!(server.reaches(&running, &["running"])["attempt"], 1);
    server.reaches(&waiting, &["successful"]);
}

#[test]
fn who_waits_when_the_service_stops_is_told_where_to_ask_later() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--grace-seconds", "0"]);
    let address = server.address().to_owned();
    let keyed = "idempotency-key: one\r\n";
    let client = thread::spawn(move || {
        loop {
            let answer = send(&address, "POST", "/solve", keyed, &oscillator(ENDLESS)).expect("an answer");
            if answer.status != 409 {
                return answer;
            }
        }
    });
    // An asynchronous request with the idempotency key finds the job of the synchronous request, whichever of the two
    // comes first.
    let asynchronous = format!("{keyed}prefer: respond-async\r\n");
    let path = loop {
        let answer = server.send("POST", "/solve", &asynchronous, &oscillator(ENDLESS));
        if answer.status == 202 {
            break answer.header("location");
        }
        answer.problem(409, "key-in-use");
    };
    server.reaches(&path, &["running"]);
    let (status, told) = server.stop();
    assert!(status.success(), "{told}");
    let answer = client.join().unwrap();
    assert_eq!((answer.status, answer.header("location")), (202, path.clone()), "{}", answer.body);
    let server = Server::start(&folder, &[]);
    server.reaches(&path, &["running"]);
    let again = server.send("POST", "/solve", &asynchronous, &oscillator(ENDLESS));
    assert_eq!(again.header("location"), path, "a key survives the process");
    server.send("POST", "/solve", &asynchronous, DECAY).problem(422, "key-reused");
}

#[test]
fn a_job_that_ran_alone_at_many_kills_is_set_aside_and_another_is_not() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    let culprit = server.accept(&oscillator(ENDLESS));
    server.reaches(&culprit, &["running"]);
    let waiting = server.accept(&oscillator(ENDLESS));
    server.kill();
    for attempt in 2..=16 {
        let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
        assert_eq!(server.reaches(&culprit, &["running"])["attempt"], attempt);
        server.kill();
    }
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    let state = server.get(&culprit).json();
    assert_eq!(state["status"], "failed", "{state}");
    assert!(state["message"].as_str().unwrap().starts_with("poisoned"), "{state}");
    server.get(&format!("{culprit}/results")).problem(500, "poisoned");
    assert_eq!(server.reaches(&waiting, &["running"])["attempt"], 1);
}

#[test]
fn a_long_job_that_starts_again_after_a_kill_does_not_hold_up_the_others() {
    let folder = Folder::new();
    let many = ["--workers", "3", "--express", "0"];
    let server = Server::start(&folder, &many);
    let suspects = [server.accept(&oscillator(ENDLESS)), server.accept(&oscillator(ENDLESS))];
    suspects.iter().for_each(|path| drop(server.reaches(path, &["running"])));
    server.kill();
    let server = Server::start(&folder, &many);
    server.reaches(&suspects[0], &["running"]);
    // The job is too long for an inline solve and needs a worker. It is solved within the 30 s for which its client
    // waits, beside the jobs that were running when the service was killed.
    let answer =
        server.send("POST", "/solve", "", &DECAY.replace("{\"end\":1}", "{\"end\":1},\"method\":{\"step\":1e-5}"));
    assert_eq!(answer.status, 200, "{}", answer.body);
    suspects.iter().for_each(|path| drop(server.reaches(path, &["running"])));
}

#[test]
fn a_job_that_was_cancelled_or_deleted_stays_so_after_a_kill() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    let running = server.accept(&oscillator(ENDLESS));
    server.reaches(&running, &["running"]);
    let (cancelled, deleted) = (server.accept(DECAY), server.accept(DECAY));
    assert_eq!(server.send("POST", &format!("{cancelled}/cancel"), "", "").status, 200);
    assert_eq!(server.send("DELETE", &deleted, "", "").status, 204);
    assert_eq!(server.send("DELETE", &running, "", "").status, 204);
    server.kill();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    assert_eq!(server.get(&cancelled).json()["status"], "dismissed");
    server.get(&deleted).problem(404, "no-such-job");
    server.get(&running).problem(404, "no-such-job");
}

#[test]
fn the_past_is_kept_within_its_bounds_on_the_disk_too() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0", "--kept-jobs", "2"]);
    // Results of more than 64 KiB are stored in files.
    let long = r#"{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-x"}}}},"time":{"end":1},
        "output":{"times":{"count":5001}}}"#;
    let paths: Vec<String> = (0..4).map(|_| server.accept(long)).collect();
    paths.iter().skip(2).for_each(|path| drop(server.reaches(path, &["successful"])));
    let kept = server.get(&format!("{}/results", paths[3])).body;
    assert!(kept.len() > 64 << 10);
    server.kill();
    std::fs::write(folder.path().join("results/00000000-0000-7000-8000-000000000000.part"), "half").unwrap();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0", "--kept-jobs", "1"]);
    server.get(&paths[0]).problem(404, "no-such-job");
    server.get(&paths[2]).problem(404, "no-such-job");
    assert_eq!(server.get(&format!("{}/results", paths[3])).body, kept);
    let files: Vec<_> = std::fs::read_dir(folder.path().join("results")).unwrap().map(|file| file.unwrap()).collect();
    assert_eq!(files.len(), 1, "{files:?}");
}

#[test]
fn a_folder_in_use_is_named() {
    let folder = Folder::new();
    let _server = Server::start(&folder, &[]);
    let other = Command::new(DVI).args(["serve", "--listen", "127.0.0.1:0", "--data"]).arg(folder.path()).output();
    let other = other.unwrap();
    assert_eq!(other.status.code(), Some(5));
    let told = String::from_utf8(other.stderr).unwrap();
    assert!(told.contains(folder.path().to_str().unwrap()), "{told}");
}
