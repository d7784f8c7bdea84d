//! Functions for tests of the service program: to stop it, to wait for its jobs, and to examine its responses.

use crate::process::{Answer, DVI, Folder, RESPONSE_TIMEOUT, Server};
use serde_json::Value;
use std::fs;
use std::io::Read;
use std::process::{Command, ExitStatus, Output};
use std::thread;
use std::time::{Duration, Instant};

impl Server {
    /// Returns the address on which the service listens.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Kills the service process, as a crash does.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Returns the process ids of the workers, which are child processes of the service.
    pub fn workers(&self) -> Vec<u32> {
        let parent = format!("PPid:\t{}\n", self.child.id());
        let processes = fs::read_dir("/proc").unwrap();
        let processes = processes.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
        let is_worker =
            |pid: &u32| fs::read_to_string(format!("/proc/{pid}/status")).is_ok_and(|it| it.contains(&parent));
        let mut workers: Vec<u32> = processes.filter(is_worker).collect();
        workers.sort_unstable();
        workers
    }

    /// Asks the service to stop; returns its exit status and its log.
    pub fn stop(mut self) -> (ExitStatus, String) {
        let sent = Command::new("kill").args(["-s", "TERM", &self.child.id().to_string()]).status().unwrap();
        assert!(sent.success());
        let mut told = String::new();
        self.log.read_to_string(&mut told).unwrap();
        (self.child.wait().unwrap(), told)
    }

    /// Posts `document` as an asynchronous job, and returns its path.
    pub fn accept(&self, document: &str) -> String {
        let answer = self.send("POST", "/solve", "prefer: respond-async\r\n", document);
        assert_eq!(answer.status, 202, "{}", answer.body);
        answer.header("location")
    }

    /// Waits until the job at `path` has one of the statuses `states`, and returns its status document.
    pub fn reaches(&self, path: &str, states: &[&str]) -> Value {
        let start = Instant::now();
        loop {
            let state = self.get(path).json();
            if states.iter().any(|name| state["status"] == *name) {
                return state;
            }
            assert!(start.elapsed() < RESPONSE_TIMEOUT, "{states:?} is not reached: {state}");
            thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Answer {
    pub fn header(&self, name: &str) -> String {
        self.field(name).unwrap_or_else(|| panic!("no {name} in {self:?}")).to_owned()
    }

    /// Asserts that the response is the problem (RFC 9457) with the given status and type.
    #[track_caller]
    pub fn problem(&self, status: u16, slug: &str) {
        assert_eq!((self.status, &self.json()["type"]), (status, &format!("/problems/{slug}").into()), "{self:?}");
    }
}

/// Runs `dvi token` on `folder`, and returns its output.
pub fn dvi_token(folder: &Folder, arguments: &[&str]) -> Output {
    Command::new(DVI).arg("token").args(arguments).arg("--data").arg(folder.path()).output().unwrap()
}
