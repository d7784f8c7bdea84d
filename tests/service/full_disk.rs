//! A disk that is full, or removed, and becomes usable again: nothing is lost, jobs can be deleted meanwhile, and no
//! restart is needed.

use crate::harness::DECAY;
use crate::process::{DVI, Folder, Server};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

/// Time within which the service must work again after the disk has become usable.
const HEALED: Duration = Duration::from_secs(10);

/// Specification of a harmonic oscillator that runs until it is cancelled.
const ENDLESS: &str = r#"{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"v"},"v":{"initial":0,"rate":"-x"}}}},
    "time":{"end":100000000}}"#;

/// Number of rounds, in each of which the disk is filled once; the environment variable `DVI_FULL_DISKS` sets a
/// larger one.
const ROUNDS: usize = 3;

#[test]
fn a_full_disk_heals_and_nothing_is_lost() {
    let rounds = std::env::var("DVI_FULL_DISKS").map_or(ROUNDS, |text| text.parse().unwrap());
    let folder = Folder::new();
    let Some(server) = on_a_small_disk(&folder) else {
        println!("no disk can be mounted here: nothing is tried");
        return;
    };
    let disk = PathBuf::from(format!("/proc/{}/root{}", server.child.id(), folder.path().display()));
    let long = DECAY.replace("{\"end\":1}}", "{\"end\":1},\"output\":{\"times\":{\"count\":3001}}}");
    let mut kept = Vec::new();
    let mut slowest = Duration::ZERO;
    for round in 0..rounds {
        let old = server.accept(DECAY);
        server.reaches(&old, &["successful"]);
        let blocker = server.accept(ENDLESS);
        server.reaches(&blocker, &["running"]);
        let waiting = [&long, DECAY].map(|document| server.accept(document));
        fill(&disk.join("filler"));
        // Jobs that still fit into free pages of the database are accepted until a write fails.
        let late: Vec<_> = until_full(&server);
        server.send("POST", &format!("{blocker}/cancel"), "", "");
        // Jobs that have been admitted are solved although the disk is full, and their results are served from
        // memory.
        for path in waiting.iter().chain(&late) {
            server.reaches(path, &["successful"]);
            assert_eq!(server.get(&format!("{path}/results")).status, 200);
        }
        assert!(!server.get("/metrics").body.contains("dvi_unsaved_results 0\n"), "round {round}");
        server.get("/readyz").problem(503, "unwritable");
        assert!(server.get("/metrics").body.contains("dvi_store_writable 0\n"));
        server.send("POST", "/solve", "prefer: respond-async\r\n", DECAY).problem(503, "unwritable");
        assert_eq!(server.send("POST", "/solve", "", DECAY).status, 200);
        for path in [&old, &blocker] {
            assert_eq!(server.send("DELETE", path, "", "").status, 204);
        }
        fs::remove_file(disk.join("filler")).unwrap();
        let room = Instant::now();
        while server.get("/readyz").status != 200 || !server.get("/metrics").body.contains("dvi_unsaved_results 0\n") {
            assert!(room.elapsed() < HEALED, "round {round}: not well after {:?}", room.elapsed());
            thread::sleep(Duration::from_millis(20));
        }
        slowest = slowest.max(room.elapsed());
        let [first, second] = waiting;
        server.get(&old).problem(404, "no-such-job");
        kept.push((second.clone(), server.get(&format!("{second}/results")).body));
        // Deleting the large jobs of this round makes room for the next one.
        kept.push((first.clone(), server.get(&format!("{first}/results")).body));
        for path in &late {
            assert_eq!(server.get(&format!("{path}/specification")).status, 200);
            assert_eq!(server.send("DELETE", path, "", "").status, 204);
        }
    }
    println!("well again after {slowest:?} at most");

    // A copy of the data folder of a suspended process has the state that a crash would leave.
    let copy = Folder::new();
    signal(&server, "STOP");
    copy_folder(&disk, copy.path());
    signal(&server, "CONT");
    assert!(Command::new(DVI).args(["store", "check"]).arg(copy.path()).output().unwrap().status.success());
    let restored = Server::start(&copy, &[]);
    for (path, results) in kept {
        assert!(restored.get(&format!("{path}/results")).body == results, "{path}");
    }
}

#[test]
fn a_folder_that_is_removed_is_noticed_and_so_is_its_return() {
    let (folder, elsewhere) = (Folder::new(), Folder::new());
    let server = Server::start(&folder, &["--workers", "1", "--express", "0"]);
    let before = server.accept(DECAY);
    server.reaches(&before, &["successful"]);
    fs::rename(folder.path(), elsewhere.path()).unwrap();
    server.get("/readyz").problem(503, "unwritable");
    server.send("POST", "/solve", "prefer: respond-async\r\n", DECAY).problem(503, "unwritable");
    assert_eq!(server.send("POST", "/solve", "", DECAY).status, 200);
    // A new folder at the path of the removed data folder is not accepted as the data folder of the service.
    fs::create_dir(folder.path()).unwrap();
    server.get("/readyz").problem(503, "unwritable");
    fs::remove_dir(folder.path()).unwrap();
    fs::rename(elsewhere.path(), folder.path()).unwrap();
    let back = Instant::now();
    while server.get("/readyz").status != 200 {
        assert!(back.elapsed() < HEALED);
        thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(server.get(&format!("{before}/results")).status, 200);
    let after = server.accept(DECAY);
    server.reaches(&after, &["successful"]);
}

#[test]
fn a_disk_full_of_jobs_heals_when_they_are_deleted() {
    let folder = Folder::new();
    let Some(server) = on_a_small_disk(&folder) else {
        println!("no disk can be mounted here: nothing is tried");
        return;
    };
    let jobs = until_full(&server);
    assert!(jobs.len() > 10, "{}", jobs.len());
    server.get("/readyz").problem(503, "unwritable");
    for path in &jobs {
        assert_eq!(server.send("DELETE", path, "", "").status, 204);
    }
    let room = Instant::now();
    while server.get("/readyz").status != 200 {
        assert!(room.elapsed() < HEALED, "not well after {:?}", room.elapsed());
        thread::sleep(Duration::from_millis(20));
    }
    println!("{} jobs deleted; well again after {:?}", jobs.len(), room.elapsed());
    let after = server.accept(DECAY);
    server.reaches(&after, &["successful"]);
}

/// Posts jobs of 200 KiB until the service refuses one because the disk is full, and returns the paths of the
/// accepted ones.
fn until_full(server: &Server) -> Vec<String> {
    let document = format!("{DECAY}{}", " ".repeat(200 << 10));
    let mut accepted = Vec::new();
    loop {
        let answer = server.send("POST", "/solve", "prefer: respond-async\r\n", &document);
        if answer.status != 202 {
            answer.problem(503, "unwritable");
            return accepted;
        }
        accepted.push(answer.header("location"));
    }
}

/// Starts a service whose folder is a private mount of a disk of 16 MiB, which disappears with the service; `None` if
/// mounting is not permitted.
fn on_a_small_disk(folder: &Folder) -> Option<Server> {
    fs::create_dir_all(folder.path()).unwrap();
    let mount = "mount -t tmpfs -o size=16m none \"$1\"";
    let inside = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["-rm", "sh", "-c", script, "sh"]).arg(folder.path());
        command
    };
    inside(mount).status().ok()?.success().then_some(())?;
    let serve = format!(
        "{mount} && exec \"$2\" serve --listen 127.0.0.1:0 --log-format json --workers 1 --express 0 --data \"$1\""
    );
    Some(Server::of(inside(&serve).arg(DVI)).unwrap())
}

/// Writes to a file until the disk is full.
fn fill(path: &Path) {
    let mut file = File::create(path).unwrap();
    while file.write_all(&[1; 4096]).is_ok() {}
    while file.write_all(&[1]).is_ok() {}
}

fn signal(server: &Server, name: &str) {
    let sent = Command::new("kill").args(["-s", name, &server.child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let (path, to) = (entry.as_ref().unwrap().path(), to.join(entry.unwrap().file_name()));
        if path.is_dir() {
            copy_folder(&path, &to);
        } else {
            fs::copy(&path, to).unwrap();
        }
    }
}
