//! Worker processes: a job that brings down its worker affects neither other jobs nor the service.

use crate::harness::DECAY;
use crate::process::{DVI, Folder, Server};
use dvi::service::worker::{Confinement, Death};
use serde_json::Value;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread;
use std::time::{Duration, Instant};

/// Specification of a harmonic oscillator whose trajectory has a time and two values per step, with about two steps
/// per time unit.
fn oscillator(end: u32) -> String {
    format!(
        r#"{{"problem":{{"dvi":{{"states":{{"x":{{"initial":1,"rate":"v"}},"v":{{"initial":0,"rate":"-x"}}}}}}}},
            "time":{{"end":{end}}}}}"#
    )
}

/// End time of a specification that no solve of these tests reaches.
const ENDLESS: u32 = 100_000_000;

/// End time at which the trajectory of the oscillator takes some hundred MiB.
const LONG: u32 = 10_000_000;

/// Returns the process ids of the workers, which are child processes of the service.
fn workers(server: &Server) -> Vec<u32> {
    server.workers()
}

/// Returns the `status` file of a process, empty if the process has ended.
fn status(pid: u32) -> String {
    fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default()
}

/// Whether a process exists and is not a zombie.
fn lives(pid: u32) -> bool {
    let status = status(pid);
    !status.is_empty() && !status.contains("State:\tZ")
}

/// Whether a process uses CPU time.
fn works(pid: u32) -> bool {
    let ticks = || {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        stat.rsplit(") ").next().and_then(|rest| rest.split(' ').nth(11)?.parse::<u64>().ok()).unwrap_or(0)
    };
    let before = ticks();
    thread::sleep(Duration::from_millis(300));
    ticks() > before + 2
}

fn signal(name: &str, pid: u32) {
    assert!(Command::new("kill").args(["-s", name, &pid.to_string()]).status().unwrap().success());
}

fn message(state: &Value) -> &str {
    state["message"].as_str().unwrap_or_else(|| panic!("no message in {state}"))
}

/// Returns the value of a metric of the service, given by its name with labels.
fn figure(server: &Server, name: &str) -> Option<f64> {
    server.get("/metrics").body.lines().find_map(|line| line.strip_prefix(name)?.trim().parse().ok())
}

#[test]
fn a_job_that_takes_too_much_memory_ends_alone_and_says_how_much() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "2", "--express", "0", "--memory-mib", "1"]);
    let (greedy, other) = (server.accept(&oscillator(LONG)), server.accept(&oscillator(1000)));
    server.reaches(&other, &["successful"]);
    let state = server.reaches(&greedy, &["failed", "successful"]);
    let told = message(&state);
    assert!(told.starts_with("too-much-memory: the process exceeded its 1 MiB of memory"), "{told}");
    assert!(told.contains("with a last request of ") && told.contains("; the estimate was 0 MiB"), "{told}");
    server.get(&format!("{greedy}/results")).problem(422, "too-much-memory");
    assert_eq!(server.get("/healthz").status, 200);
    assert_eq!(server.send("POST", "/solve", "", &oscillator(100)).status, 200);
    assert_eq!(figure(&server, "dvi_workers_lost_total{reason=\"too_much_memory\"}"), Some(1.0));
    // Another worker must have replaced the lost one.
    server.reaches(&server.accept(DECAY), &["successful"]);
    let start = Instant::now();
    while figure(&server, "dvi_workers") != Some(2.0) {
        assert!(start.elapsed() < Duration::from_secs(20), "a worker is missing");
        thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_result_beyond_its_bound_is_not_gathered_in_memory() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0", "--result-mib", "1"]);
    // The measurement begins after a first job, so that one-time allocations are not counted.
    server.reaches(&server.accept(DECAY), &["successful"]);
    let mut held = Vec::new();
    for _ in 0..8 {
        // The trajectory has some hundred thousand steps: ten MiB as JSON.
        let path = server.accept(&oscillator(100_000));
        let state = server.reaches(&path, &["failed", "successful"]);
        assert!(message(&state).starts_with("result-too-large: "), "{state}");
        server.get(&format!("{path}/results")).problem(422, "result-too-large");
        held.push(server.resident_kib());
    }
    // A service that held each result in memory would take ten MiB more per job.
    assert!(held[7] < held[0] + (8 << 10), "{held:?} KiB after results of 1 MiB at most");
    assert_eq!(workers(&server).len(), 1);
    server.reaches(&server.accept(DECAY), &["successful"]);
}

#[test]
fn a_job_whose_worker_is_killed_begins_again_beside_others_but_not_for_ever() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "2", "--express", "0"]);
    let jobs = [server.accept(&oscillator(ENDLESS)), server.accept(&oscillator(ENDLESS))];
    jobs.iter().for_each(|path| drop(server.reaches(path, &["running"])));
    let (constant, mut victim) = (workers(&server)[0], workers(&server)[1]);
    let before = jobs.each_ref().map(|path| server.get(path).json());
    let start = Instant::now();
    let next = |last: u32| {
        loop {
            assert!(start.elapsed() < Duration::from_secs(60), "no other worker");
            let new = workers(&server).into_iter().find(|pid| *pid != constant && *pid != last);
            // Of the workers, the one that uses CPU time has the job.
            if let Some(pid) = new.filter(|pid| works(*pid)) {
                return pid;
            }
            thread::sleep(Duration::from_millis(5));
        }
    };
    for _ in 0..16 {
        signal("KILL", victim);
        victim = next(victim);
    }
    let states = jobs.each_ref().map(|path| server.get(path).json());
    for (state, before) in states.iter().zip(&before) {
        assert_eq!((&state["status"], &state["attempt"]), (&"running".into(), &1.into()), "{before}");
    }
    signal("KILL", victim);
    let (killed, other) = loop {
        let states = jobs.each_ref().map(|path| server.get(path).json());
        match states.each_ref().map(|state| state["status"] == "failed") {
            [true, false] => break (states[0].clone(), &jobs[1]),
            [false, true] => break (states[1].clone(), &jobs[0]),
            both => assert!(!both[0] && start.elapsed() < Duration::from_secs(60), "{states:?}"),
        }
        thread::sleep(Duration::from_millis(5));
    };
    assert!(message(&killed).starts_with("killed: signal 9"), "{killed}");
    assert_eq!(server.get("/healthz").status, 200);
    let before = server.get(other).json();
    thread::sleep(Duration::from_millis(500));
    let after = server.get(other).json();
    assert_eq!(after["status"], "running");
    assert!(after["steps"].as_u64() > before["steps"].as_u64(), "{before} {after}");
    server.reaches(&server.accept(DECAY), &["successful"]);
}

#[test]
fn a_worker_that_is_killed_at_rest_is_replaced_unnoticed() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    for _ in 0..5 {
        let before = workers(&server);
        signal("KILL", before[0]);
        server.reaches(&server.accept(DECAY), &["successful"]);
        // Inline solves do not wait until the killed worker is replaced, so that the test has to wait.
        let start = Instant::now();
        while workers(&server).is_empty() || workers(&server) == before {
            assert!(start.elapsed() < Duration::from_secs(20), "it is not replaced");
            thread::sleep(Duration::from_millis(1));
        }
    }
}

#[test]
fn no_worker_outlives_a_service_that_is_killed() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "2", "--express", "0"]);
    for path in [server.accept(&oscillator(ENDLESS)), server.accept(&oscillator(ENDLESS))] {
        server.reaches(&path, &["running"]);
    }
    let workers = workers(&server);
    assert!(workers.iter().all(|pid| works(*pid)), "{workers:?}");
    server.kill();
    thread::sleep(Duration::from_secs(1));
    assert!(!workers.iter().any(|pid| lives(*pid)), "{workers:?}");
}

#[test]
fn a_worker_confines_itself() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0", "--memory-mib", "100"]);
    let pid = workers(&server)[0];
    let limits = fs::read_to_string(format!("/proc/{pid}/limits")).unwrap();
    let hard = |name: &str| {
        let line = limits.lines().find(|line| line.starts_with(name)).unwrap();
        line.split_whitespace().rev().nth(1).unwrap().parse::<u64>().unwrap()
    };
    // The memory limit of a worker process is that of a solve plus some ten MiB for the program, eight for a stack,
    // and 64 for documents and messages.
    let data = hard("Max data size") >> 20;
    assert!((172..200).contains(&data), "{data} MiB");
    assert_eq!((hard("Max core file size"), hard("Max open files")), (0, 16));
    assert_eq!(fs::read_to_string(format!("/proc/{pid}/oom_score_adj")).unwrap().trim(), "1000");
    assert!(fs::read(format!("/proc/{pid}/environ")).unwrap().len() < 100, "no secrets of the service");
    // Landlock requires that the process has given up the right to gain privileges (`no_new_privs`).
    if has_landlock() {
        assert!(status(pid).contains("NoNewPrivs:\t1"), "{}", status(pid));
    }
}

/// Whether the kernel has Landlock; true if it does not report its security modules.
fn has_landlock() -> bool {
    fs::read_to_string("/sys/kernel/security/lsm").map_or(true, |modules| modules.contains("landlock"))
}

#[test]
fn a_job_that_does_not_heed_its_deadline_is_ended() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0", "--wall-seconds", "1"]);
    let path = server.accept(&oscillator(ENDLESS));
    server.reaches(&path, &["running"]);
    // A process that is suspended by a signal does not respond to its deadline.
    signal("STOP", workers(&server)[0]);
    assert!(message(&server.reaches(&path, &["failed"])).starts_with("overran: "));
    server.reaches(&server.accept(DECAY), &["successful"]);
}

#[test]
fn a_cancel_reaches_the_worker_and_brings_the_trajectory_so_far() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    let path = server.accept(&oscillator(ENDLESS));
    server.reaches(&path, &["running"]);
    thread::sleep(Duration::from_millis(300));
    let state = server.get(&path).json();
    assert!(state["steps"].as_u64() > Some(0), "{state}");
    let start = Instant::now();
    server.send("POST", &format!("{path}/cancel"), "", "");
    server.reaches(&path, &["dismissed"]);
    println!("cancelled after {:?}", start.elapsed());
    // On a busy machine the cancellation of a running solve may take a second.
    assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
    let result = server.get(&format!("{path}/results")).json();
    assert!(result["trajectory"]["t"].as_array().unwrap().len() > 10);
}

/// Specification of a heat equation above an obstacle in a cube, with a million nodes: some 200 bytes that take
/// seconds to check.
const CUBE: &str = r#"{"problem":{"obstacle":{"domain":{"x":[0,1],"y":[0,1],"z":[0,1]},"elements":100,"diffusion":"1+x*y",
"initial":"sin(x)*sin(y)","obstacle":"-x"}},"time":{"end":1}}"#;

#[test]
fn a_check_that_takes_too_much_memory_ends_alone() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0", "--memory-mib", "1"]);
    // Specification of spheres in a row: five MiB of text, which take some two hundred MiB in memory.
    let sphere = |k: u32| format!(r#"{{"shape":{{"sphere":{{"radius":1}}}},"density":1,"position":[{},0,0]}}"#, 3 * k);
    let row: Vec<String> = (0..60_000).map(sphere).collect();
    let document = format!(
        r#"{{"problem":{{"rigid_bodies":{{"bodies":[{}]}}}},"time":{{"end":1}},"method":{{"step":0.01}}}}"#,
        row.join(",")
    );
    let answer = server.send("POST", "/check", "", &document);
    answer.problem(422, "too-much-memory");
    assert!(answer.json()["detail"].as_str().unwrap().starts_with("the process exceeded its 1 MiB"), "{answer:?}");
    assert_eq!(server.send("POST", "/check", "", DECAY).status, 200);
    assert_eq!(server.send("POST", "/check", "", CUBE).status, 200);
}

#[test]
fn a_check_stops_when_its_client_goes_away() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    let at_rest = workers(&server);
    let mut stream = TcpStream::connect(&server.address).unwrap();
    // A long coefficient makes the check of the specification last until the test has found the worker that uses CPU
    // time for it.
    let cube = CUBE.replace("1+x*y", &format!("1{}", "+x*y*sin(x)".repeat(1000)));
    let length = cube.len();
    write!(stream, "POST /check HTTP/1.1\r\nhost: localhost\r\ncontent-length: {length}\r\n\r\n{cube}").unwrap();
    let start = Instant::now();
    let checker = loop {
        if let Some(pid) = workers(&server).into_iter().find(|pid| !at_rest.contains(pid) && works(*pid)) {
            break pid;
        }
        assert!(start.elapsed() < Duration::from_secs(20), "no worker checks");
    };
    drop(stream);
    // The check stops as soon as its worker is asked to stop; otherwise the worker is killed half a second later.
    thread::sleep(Duration::from_secs(1));
    assert!(!works(checker));
    assert_eq!(server.get("/healthz").status, 200);
}

/// Runs the test `name` of this file in a child process, whose environment contains `folder`.
fn run_apart(name: &str, folder: &Path) -> Output {
    let name = format!("workers::{name}");
    Command::new(std::env::current_exe().unwrap())
        .args([&name, "--exact", "--ignored", "--nocapture"])
        .env("DVI_TEST_FOLDER", folder)
        .output()
        .unwrap()
}

/// Runs the test `name` in a child process, and returns the cause of its death.
fn death_in(name: &str) -> Death {
    let run = run_apart(name, Path::new(""));
    Death::of(run.status, &String::from_utf8_lossy(&run.stderr))
}

#[test]
#[ignore = "its process has no files afterwards; another test runs it in one of its own"]
fn loses_its_files() {
    let folder = PathBuf::from(std::env::var_os("DVI_TEST_FOLDER").unwrap());
    let (database, made) = (folder.join("jobs.redb"), folder.join("made"));
    let begun = File::open(&database).unwrap();
    let confinement = Confinement::impose(64 << 20);
    assert!(confinement.no_files || !has_landlock(), "{confinement}");
    let refusals = [
        File::open(&database).map(drop),
        fs::read_dir(&folder).map(drop),
        fs::write(&made, "made"),
        fs::create_dir(&made),
        fs::remove_file(&database),
        fs::rename(&database, &made),
        OpenOptions::new().write(true).truncate(true).open(&database).map(drop),
        File::open("/etc/passwd").map(drop),
        Command::new("/bin/true").status().map(drop),
    ];
    if confinement.no_files {
        for (k, refusal) in refusals.iter().enumerate() {
            let refused = refusal.as_ref().is_err_and(|error| error.kind() == ErrorKind::PermissionDenied);
            assert!(refused, "attempt {k}: {refusal:?}");
        }
    }
    // Files that were opened before a process gave up its access to files stay usable, like the pipes of a worker.
    assert!(begun.metadata().unwrap().len() > 0);
}

#[test]
fn a_worker_has_no_access_to_the_store() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    server.reaches(&server.accept(DECAY), &["successful"]);
    server.kill();
    let run = run_apart("loses_its_files", folder.path());
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    // The log of `dvi serve` reports the limits that a worker has found to be enforced on it.
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    assert_eq!(server.confined_to.contains("no access to files"), has_landlock(), "{}", server.confined_to);
    assert_eq!(server.accept(DECAY).len(), "/jobs/".len() + 36);
}

fn descend(depth: u64) -> u64 {
    if depth == u64::MAX { 0 } else { 1 + descend(std::hint::black_box(depth + 1)) }
}

#[test]
#[ignore = "it takes its process down, to be looked at by another test"]
fn overflows() {
    println!("{}", descend(0));
}

#[test]
#[ignore = "it takes its process down, to be looked at by another test"]
fn takes_too_much() {
    Confinement::impose(1 << 20);
    println!("{:?}", vec![1_u8; 200 << 20].iter().max());
}

#[test]
fn the_last_words_of_a_process_tell_why_it_died() {
    assert_eq!(death_in("overflows"), Death::StackOverflow);
    assert_eq!(death_in("takes_too_much"), Death::TooMuchMemory(Some(200 << 20)));
}

/// Returns a result without its diagnostics, which contain run times.
fn without_evidence(json: &[u8]) -> Value {
    let mut result: Value = serde_json::from_slice(json).unwrap();
    result.as_object_mut().unwrap().remove("diagnostics");
    result
}

#[test]
fn results_have_the_bits_of_those_of_the_program() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "2", "--express", "0"]);
    for name in ["diode_bridge", "friction_belt", "bouncing_ball", "memory_abel", "rocking_block"] {
        let file = format!("{}/api/examples/{name}.json", env!("CARGO_MANIFEST_DIR"));
        let Ok(document) = fs::read_to_string(&file) else { panic!("{file}") };
        let path = server.accept(&document);
        server.reaches(&path, &["successful"]);
        let served = server.get(&format!("{path}/results")).body;
        let solved = Command::new(DVI).args(["solve", &file]).output().unwrap().stdout;
        assert!(without_evidence(served.as_bytes()) == without_evidence(&solved), "{name}");
    }
}
