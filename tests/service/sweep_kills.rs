//! Tests of sweeps that are interrupted by kills: they continue from the rows that they have, and their results have
//! the same bytes as without kills.

use crate::process::{Folder, Server};
use dvi::problem::Control;
use dvi::solution::encodings::write_json;
use dvi::specification::Specification;
use serde_json::Value;
use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

const TWO: NonZeroUsize = NonZeroUsize::new(2).unwrap();

/// Time limit, longer than any sweep of these tests takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// Specification of a sweep of oscillators over stiffness and initial value; each member takes some milliseconds.
pub fn oscillators(members: usize, end: u32) -> String {
    format!(
        r#"{{"problem": {{"dvi": {{"parameters": {{"k": 1}}, "states": {{"x": {{"initial": 1, "rate": "v"}}, "v": {{"initial": 0, "rate": "-k*x"}}}}}}}},
            "time": {{"end": {end}}}, "sweep": {{"over": {{"k": {{"uniform": [0.5, 2]}}, "x.initial": {{"normal": [0, 1]}}}},
            "design": "sobol", "count": {members}, "collect": {{"x": {{"final": "x"}}, "peak": {{"max": "abs(v)"}}}}}}}}"#
    )
}

pub fn undisturbed(document: &str) -> Vec<u8> {
    let specification = Specification::from_json(document.as_bytes()).unwrap();
    let mut json = Vec::new();
    write_json(&dvi::solve_on(TWO, &specification, &Control::new()), &mut json).unwrap();
    json
}

impl Server {
    /// Waits until the sweep at `path` has at least `least` rows, or has ended, and returns the number of rows.
    pub fn rows(&self, path: &str, least: u64) -> u64 {
        let start = Instant::now();
        loop {
            let status = self.get(path).json();
            let done = status["members"]["done"].as_u64().unwrap_or_default();
            if done >= least || status["status"] == "successful" {
                return done;
            }
            assert!(start.elapsed() < PATIENCE, "{status}");
            thread::sleep(Duration::from_millis(5));
        }
    }

    pub fn succeeds(&self, path: &str) -> Value {
        let start = Instant::now();
        loop {
            let status = self.get(path).json();
            if !["accepted", "running"].iter().any(|state| status["status"] == *state) {
                assert_eq!(status["status"], "successful", "{status}");
                return status;
            }
            assert!(start.elapsed() < PATIENCE, "{status}");
            thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Returns the path of the file with the rows of a sweep.
fn rows_of(folder: &Path, path: &str) -> PathBuf {
    folder.join("results").join(format!("{}.rows", path.rsplit('/').next().unwrap()))
}

#[test]
fn kills_in_the_middle_repeat_no_finished_chunk_and_change_no_byte() {
    let document = oscillators(4000, 150);
    let folder = Folder::new();
    let start = || Server::start(&folder, &["--workers", "2"]);
    let mut server = start();
    let path = server.accept(&document);
    let mut known = 0;
    for kill in 1..=3 {
        known = server.rows(&path, known + 300);
        if kill == 2 {
            // First the workers are killed: the chunks of the sweep that they were solving begin again, and the sweep
            // continues.
            for pid in server.workers() {
                let _ = Command::new("kill").args(["-9", &pid.to_string()]).stderr(Stdio::null()).status();
            }
            known = server.rows(&path, known + 1);
        }
        server.kill();
        assert!(known == 4000 || rows_of(folder.path(), &path).exists());
        server = start();
        let status = server.get(&path).json();
        let done = status["members"]["done"].as_u64().unwrap();
        assert!(done >= known, "{done} rows of {known} after kill {kill}: {status}");
    }
    let ended = server.succeeds(&path);
    assert_eq!(ended["members"]["done"], 4000);
    assert!(server.get(&format!("{path}/results")).body.into_bytes() == undisturbed(&document));
    assert!(!rows_of(folder.path(), &path).exists(), "the rows are in the table");
    assert!(ended["attempt"].as_u64() > Some(1), "{ended}");
    drop(server);
    let check = Command::new(crate::process::DVI).args(["store", "check"]).arg(folder.path()).output().unwrap();
    assert!(check.status.success(), "{}", String::from_utf8_lossy(&check.stdout));
}

#[test]
fn an_orderly_stop_parks_a_sweep_with_its_rows() {
    let document = oscillators(2000, 60);
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--grace-seconds", "0"]);
    let path = server.accept(&document);
    let known = server.rows(&path, 100);
    let (status, _) = server.stop();
    assert!(status.success());
    let server = Server::start(&folder, &["--workers", "2"]);
    assert!(server.get(&path).json()["members"]["done"].as_u64().unwrap() >= known);
    server.succeeds(&path);
    assert!(server.get(&format!("{path}/results")).body.into_bytes() == undisturbed(&document));
}

#[test]
fn rows_that_the_disk_has_changed_are_made_again() {
    let document = oscillators(2000, 60);
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    let path = server.accept(&document);
    let known = server.rows(&path, 300);
    server.kill();
    let file = rows_of(folder.path(), &path);
    let mut bytes = fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    fs::write(&file, bytes).unwrap();
    let server = Server::start(&folder, &["--workers", "2"]);
    let done = server.get(&path).json()["members"]["done"].as_u64().unwrap();
    assert!(done < known || known == 2000, "{done} of {known}");
    server.succeeds(&path);
    assert!(server.get(&format!("{path}/results")).body.into_bytes() == undisturbed(&document));
}

#[test]
fn rows_from_before_the_job_was_accepted_survive_a_kill() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    // The first chunk of the sweep is finished while the client waits for the response; until this wait ends, the job
    // is in memory only.
    let answer = server.send("POST", "/solve", "prefer: wait=1\r\n", &oscillators(100_000, 60));
    assert_eq!(answer.status, 202, "{}", answer.body);
    let path = answer.header("location");
    let known = server.rows(&path, 1);
    server.kill();
    let server = Server::start(&folder, &["--workers", "1"]);
    let done = server.get(&path).json()["members"]["done"].as_u64().unwrap();
    assert!(done >= known, "{done} of {known}");
    server.send("POST", &format!("{path}/cancel"), "", "");
}

#[test]
fn a_sweep_cancelled_while_it_waits_again_has_its_rows() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    let path = server.accept(&oscillators(100_000, 60));
    let known = server.rows(&path, 100);
    server.kill();
    // The client has two sweeps: one of them waits while the only worker solves the other.
    let server = Server::start(&folder, &["--workers", "1"]);
    server.accept(&oscillators(100_000, 60));
    server.send("POST", &format!("{path}/cancel"), "", "");
    let status = server.reaches(&path, &["dismissed"]);
    assert!(status["members"]["done"].as_u64().unwrap() >= known, "{status}");
}

#[test]
fn a_sweep_cancelled_before_a_kill_has_its_rows_after_it() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    let path = server.accept(&oscillators(100_000, 60));
    let known = server.rows(&path, 100);
    server.send("POST", &format!("{path}/cancel"), "", "");
    server.kill();
    let server = Server::start(&folder, &["--workers", "1"]);
    let status = server.reaches(&path, &["dismissed"]);
    assert!(status["members"]["done"].as_u64().unwrap() >= known, "{status}");
    let json = server.get(&format!("{path}/results")).json();
    assert!(json["table"]["columns"]["x"].as_array().unwrap().len() as u64 >= known);
}
