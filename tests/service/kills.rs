//! Kills at any moment: of the service, of its workers, of both, during a start, and during deletions. Every admitted
//! job exists exactly once, with its own results; deleted jobs are gone.

use crate::harness::DECAY;
use crate::process::{Answer, DVI, Folder, Server, send};
use serde_json::Value;
use std::collections::HashMap;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

/// Number of kills; the environment variable `DVI_KILLS` sets a larger one.
const KILLS: u32 = 40;

/// Number of kills between two checks of all known jobs.
const BETWEEN: u32 = 500;

/// Time limit for a job, longer than the queueing and solving time of any job on a busy machine.
const SETTLED: Duration = Duration::from_secs(300);

/// What the client that has posted a job knows about the job.
#[derive(Default)]
struct Posted {
    /// The path of the job, if the client received it.
    path: Option<String>,
    /// Whether the service confirmed the deletion of the job; `None` if the deletion was not requested.
    deleted: Option<bool>,
}

/// Numbers of jobs by their outcome after all kills.
#[derive(Debug, Default)]
struct Tally {
    successful: u32,
    deleted: u32,
    /// Number of jobs that failed because their worker was killed.
    killed: u32,
    /// Number of jobs that the service set aside as suspect, since they were running at several kills.
    poisoned: u32,
}

#[test]
fn no_kill_of_the_service_or_its_workers_loses_doubles_or_spoils_a_job() {
    let kills = std::env::var("DVI_KILLS").map_or(KILLS, |text| text.parse().unwrap());
    let (folder, start) = (Folder::new(), Instant::now());
    let mut random = fastrand::Rng::with_seed(std::process::id().into());
    let (mut jobs, mut tally) = (HashMap::new(), Tally::default());
    let mut server = serve(&folder);
    for kill in 0..kills {
        let life = Duration::from_micros(random.u64(..100_000));
        let stop = AtomicBool::new(false);
        let address = server.address.clone();
        let clients = thread::scope(|scope| {
            let posting = scope.spawn(|| post_until(&stop, &address, kill * 10_000));
            let victims: Vec<String> = known(&jobs).take(20).collect();
            let deleting = (kill % 5 == 4).then(|| scope.spawn(|| delete_until(&stop, &address, victims)));
            thread::sleep(life);
            match kill % 5 {
                1 => kill_worker(&server, &mut random),
                2 => {
                    kill_worker(&server, &mut random);
                    server.child.kill().unwrap();
                }
                _ => server.child.kill().unwrap(),
            }
            if kill % 5 == 1 {
                // If only a worker was killed, the clients continue for a moment before they are stopped.
                thread::sleep(Duration::from_millis(20));
            }
            stop.store(true, Relaxed);
            (posting.join().unwrap(), deleting.map(|deleting| deleting.join().unwrap()).unwrap_or_default())
        });
        for (k, path) in clients.0 {
            jobs.insert(k, Posted { path, deleted: None });
        }
        for (path, confirmed) in clients.1 {
            let job = jobs.values_mut().find(|job| job.path.as_ref() == Some(&path)).unwrap();
            job.deleted = Some(confirmed);
        }
        if kill % 5 != 1 {
            // Reap the killed process, as a service manager does before it restarts a service.
            server.child.wait().unwrap();
            if kill % 5 == 3 {
                kill_a_start(&folder, Duration::from_micros(random.u64(..60_000)));
            }
            server = serve(&folder);
        }
        if kill % BETWEEN == BETWEEN - 1 || kill + 1 == kills {
            settle(&server, &mut jobs, &mut tally);
        }
    }
    println!("{kills} kills in {:?}: {tally:?}", start.elapsed());
    assert!(tally.successful > kills && tally.deleted > 0, "{tally:?}");
    assert_eq!((tally.killed, tally.poisoned), (0, 0), "innocent jobs were set aside: {tally:?}");
    let set_aside = std::fs::read_dir(folder.path().join("results.orphaned")).map_or(0, Iterator::count);
    println!("{set_aside} results were set aside");
    drop(server);
    let check = Command::new(DVI).args(["store", "check"]).arg(folder.path()).output().unwrap();
    assert!(check.status.success(), "{}", String::from_utf8_lossy(&check.stdout));
}

/// Starts a service whose limits on kept jobs are so high that it removes none.
fn serve(folder: &Folder) -> Server {
    let many = "1000000";
    Server::start(folder, &["--workers", "2", "--kept-jobs", many, "--queue", many, "--client-share", many])
}

/// Posts jobs, each with its number as idempotency key, until stopped; returns the paths in the responses.
fn post_until(stop: &AtomicBool, address: &str, first: u32) -> Vec<(u32, Option<String>)> {
    let mut told = Vec::new();
    for k in first.. {
        if stop.load(Relaxed) {
            break;
        }
        told.push((k, post(address, k).map(|answer| accepted(&answer))));
    }
    told
}

fn accepted(answer: &Answer) -> String {
    assert_eq!(answer.status, 202, "{}", answer.body);
    answer.field("location").unwrap().to_owned()
}

/// Posts the decay problem number `k` with the idempotency key `k`; `None` if the service disconnects. Every third
/// result is so long that it is stored in a file, and every fourth solve takes some time.
fn post(address: &str, k: u32) -> Option<Answer> {
    let headers = format!("prefer: respond-async\r\nidempotency-key: {k}\r\n");
    let mut document = DECAY.replace("-x", &format!("-{}*x", rate(k)));
    if k.is_multiple_of(4) {
        document.insert_str(document.len() - 1, r#","method":{"step":0.0001}"#);
    }
    if k.is_multiple_of(3) {
        document.insert_str(document.len() - 1, r#","output":{"times":{"count":3001}}"#);
    }
    send(address, "POST", "/solve", &headers, &document)
}

/// Returns the decay rate of job `k`, by which the results of the job are recognised.
fn rate(k: u32) -> f64 {
    1.0 + f64::from(k % 1000) / 1000.0
}

/// Deletes the given jobs until stopped; returns the jobs whose deletion was requested, each with whether the service
/// confirmed it.
fn delete_until(stop: &AtomicBool, address: &str, victims: Vec<String>) -> Vec<(String, bool)> {
    let unstopped = victims.into_iter().take_while(|_| !stop.load(Relaxed));
    let delete = |path: String| {
        let answer = send(address, "DELETE", &path, "", "");
        (path, answer.is_some_and(|answer| answer.status == 204))
    };
    unstopped.map(delete).collect()
}

/// Returns the paths of jobs whose deletion was not requested.
fn known(jobs: &HashMap<u32, Posted>) -> impl Iterator<Item = String> + '_ {
    jobs.values().filter(|job| job.deleted.is_none()).filter_map(|job| job.path.clone())
}

fn kill_worker(server: &Server, random: &mut fastrand::Rng) {
    let workers = server.workers();
    if let Some(pid) = random.choice(&workers) {
        // Killing may fail, since the worker may have ended meanwhile.
        let _ = Command::new("kill").args(["-9", &pid.to_string()]).stderr(Stdio::null()).status();
    }
}

/// Starts the service and kills it after the time `life`: before, during or after the recovery of the jobs in its
/// folder.
fn kill_a_start(folder: &Folder, life: Duration) {
    let mut start = Command::new(DVI)
        .args(["serve", "--listen", "127.0.0.1:0", "--workers", "2", "--data"])
        .arg(folder.path())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    thread::sleep(life);
    start.kill().unwrap();
    start.wait().unwrap();
}

/// Checks the outcome of every known job, and removes all of them from `jobs`.
fn settle(server: &Server, jobs: &mut HashMap<u32, Posted>, tally: &mut Tally) {
    let (mut numbers, start) = (HashMap::new(), Instant::now());
    for (k, job) in jobs.drain() {
        match job {
            Posted { path: Some(path), deleted: Some(confirmed) } => {
                let status = server.get(&path).status;
                assert!(status == 404 || (status == 200 && !confirmed), "job {k} was deleted, and is {status}");
                tally.deleted += u32::from(status == 404);
            }
            // A job that was being admitted when the service was killed may exist or not. If it is posted again with
            // its key, it exists exactly once.
            Posted { path, .. } => {
                let again = accepted(&post(&server.address, k).expect("an answer"));
                assert!(path.is_none_or(|path| path == again), "job {k} is {again} now");
                assert_eq!(numbers.insert(again, k), None, "two keys have one job");
            }
        }
    }
    for (path, k) in numbers {
        let state = loop {
            let state = server.get(&path).json();
            if ["successful", "failed", "dismissed"].iter().any(|end| state["status"] == *end) {
                break state;
            }
            assert!(start.elapsed() < SETTLED, "job {k}: {state}");
            thread::sleep(Duration::from_millis(2));
        };
        let message = state["message"].as_str().unwrap_or_default();
        match (state["status"].as_str().unwrap(), message.split(':').next().unwrap()) {
            ("successful", _) => {
                let results: Value = server.get(&format!("{path}/results")).json();
                let x = results["trajectory"]["fields"]["x"].as_array().unwrap();
                let (last, exact) = (x.last().unwrap().as_f64().unwrap(), (-rate(k)).exp());
                assert!((last - exact).abs() < 1e-5, "job {k}: {last} for {exact}");
                tally.successful += 1;
            }
            ("failed", "killed") => tally.killed += 1,
            ("failed", "poisoned") => tally.poisoned += 1,
            _ => panic!("job {k}: {state}"),
        }
    }
}
