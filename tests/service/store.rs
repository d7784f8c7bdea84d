//! `dvi store check` and `dvi store repair`: intact, damaged and busy stores.

use crate::harness::DECAY;
use crate::process::{DVI, Folder, Server};
use std::fs;
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::Duration;

fn check(folder: &Folder) -> Output {
    Command::new(DVI).args(["store", "check"]).arg(folder.path()).output().unwrap()
}

fn told(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_store_is_left_alone_while_it_is_in_use_and_what_is_damaged_is_named() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    let long = DECAY.replace("{\"end\":1}}", "{\"end\":1},\"output\":{\"times\":{\"count\":5001}}}");
    let paths = [&long, DECAY].map(|document| server.accept(document));
    paths.iter().for_each(|path| drop(server.reaches(path, &["successful"])));
    let used = check(&folder);
    assert_eq!(used.status.code(), Some(3));
    assert!(told(&used.stderr).contains("in use by another process; check a copy of it"), "{used:?}");
    server.kill();

    // The database was not closed properly, since the service was killed; the check must not change it.
    let database = folder.path().join("jobs.redb");
    let before = fs::read(&database).unwrap();
    let whole = check(&folder);
    assert_eq!((whole.status.code(), fs::read(&database).unwrap() == before), (Some(0), true), "{whole:?}");
    for line in ["  jobs        2, of which 2 have ended\n", "  damaged     0\n", "  format      4\n"] {
        assert!(told(&whole.stdout).contains(line), "{whole:?}");
    }

    let id = paths[0].rsplit('/').next().unwrap();
    let file = folder.path().join("results").join(format!("{id}.columns"));
    let mut json = fs::read(&file).unwrap();
    json[1000] ^= 4;
    fs::write(&file, json).unwrap();
    let at = before.windows(DECAY.len()).position(|bytes| bytes == DECAY.as_bytes()).unwrap();
    let mut rotten = before;
    rotten[at + 30] ^= 4;
    fs::write(&database, rotten).unwrap();
    let damaged = check(&folder);
    assert_eq!(damaged.status.code(), Some(1), "{damaged:?}");
    let second = paths[1].rsplit('/').next().unwrap();
    for line in [format!("damaged: {id}: results\n"), format!("damaged: {second}: specification\n")] {
        assert!(told(&damaged.stdout).contains(&line), "{damaged:?}");
    }
}

#[test]
fn a_start_waits_for_a_database_that_a_process_about_to_end_still_holds() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    let path = server.accept(DECAY);
    server.reaches(&path, &["successful"]);
    server.kill();
    // Hold the lock on the database, as a child process does between its fork and the execution of its program.
    let database = fs::File::options().read(true).write(true).open(folder.path().join("jobs.redb")).unwrap();
    database.try_lock().unwrap();
    let holder = thread::spawn(move || {
        thread::sleep(Duration::from_millis(1500));
        drop(database);
    });
    let server = Server::try_start_at("127.0.0.1:0", &folder, &["--workers", "1"]).unwrap();
    assert!(holder.is_finished(), "the database was opened while it was locked");
    assert!(server.beginning.contains("waiting until it ends"), "{}", server.beginning);
    assert_eq!(server.get(&path).json()["status"], "successful");
    // A start does not wait for a store that is in use by a running service; it fails.
    let refused = Server::try_start_at("127.0.0.1:0", &folder, &["--workers", "1"]).err().unwrap();
    assert!(refused.contains("the store is in use by another process") && !refused.contains("waiting"), "{refused}");
    assert_eq!(server.get("/readyz").status, 200);
}

#[test]
fn a_process_that_examines_a_store_ends_with_the_service_that_started_it() {
    let folder = Folder::new();
    fs::create_dir_all(folder.path()).unwrap();
    // A named pipe without a writer takes the place of the database: reading it blocks forever.
    assert!(Command::new("mkfifo").arg(folder.path().join("jobs.redb")).status().unwrap().success());
    for action in ["examine", "repair"] {
        let mut process = Command::new(DVI)
            .args(["store", action, "--attended"])
            .arg(folder.path())
            .stdin(Stdio::piped())
            .spawn()
            .unwrap();
        thread::sleep(Duration::from_millis(100));
        assert_eq!(process.try_wait().unwrap(), None, "it does not read the store");
        drop(process.stdin.take());
        assert_eq!(process.wait().unwrap().code(), Some(3));
    }
}

#[test]
fn a_damaged_store_is_built_anew_and_one_that_is_whole_is_left_alone() {
    let folder = Folder::new();
    let repair = || Command::new(DVI).args(["store", "repair"]).arg(folder.path()).output().unwrap();
    let server = Server::start(&folder, &["--workers", "1"]);
    let paths = ["-x", "-2*x", "-3*x"].map(|rate| server.accept(&DECAY.replace("-x", rate)));
    paths.iter().for_each(|path| drop(server.reaches(path, &["successful"])));
    assert_eq!(repair().status.code(), Some(3));
    assert!(server.stop().0.success());
    let database = folder.path().join("jobs.redb");
    let before = fs::read(&database).unwrap();
    let whole = repair();
    assert_eq!((whole.status.code(), fs::read(&database).unwrap() == before), (Some(0), true), "{whole:?}");

    let mut rotten = before.clone();
    let text = DECAY.replace("-x", "-2*x");
    let places = before.windows(text.len()).enumerate().filter(|(_, bytes)| *bytes == text.as_bytes());
    places.for_each(|(at, _)| rotten[at + 30] ^= 4);
    fs::write(&database, &rotten).unwrap();
    let mended = repair();
    let id = paths[1].rsplit('/').next().unwrap();
    assert_eq!(mended.status.code(), Some(1), "{mended:?}");
    assert!(told(&mended.stdout).contains(&format!("lost: {id}: specification\n")), "{mended:?}");
    let aside = told(&mended.stdout).lines().find_map(|line| Some(line.split_once("file is ")?.1.to_owned())).unwrap();
    let rot: Vec<u8> = text.bytes().enumerate().map(|(at, byte)| if at == 30 { byte ^ 4 } else { byte }).collect();
    assert!(fs::read(aside).unwrap().windows(rot.len()).any(|bytes| bytes == rot));
    let server = Server::start(&folder, &["--workers", "1"]);
    for path in &paths {
        assert_eq!(server.get(path).json()["status"], "successful");
        assert_eq!(server.get(&format!("{path}/results")).status, 200);
    }
    assert_eq!(server.get(&format!("{}/specification", paths[0])).status, 200);
    server.get(&format!("{}/specification", paths[1])).problem(500, "damaged");
}

#[test]
fn where_there_is_no_store_nothing_is_made() {
    let folder = Folder::new();
    let output = check(&folder);
    assert_eq!((output.status.code(), folder.path().exists()), (Some(3), false));
    assert!(told(&output.stderr).starts_with("dvi: cannot check "), "{output:?}");
}
