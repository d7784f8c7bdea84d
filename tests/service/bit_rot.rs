//! Flipped bits on the disk: the affected data are reported as damaged, and never served as intact.

use crate::harness::DECAY;
use crate::process::{Folder, Server};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Number of single-bit flips; the environment variable `DVI_FLIPS` sets a larger one.
const FLIPS: usize = 200;

/// Number of bit flips between two starts of the service.
const AT_ONCE: usize = 10;

/// Suffixes of the paths that are requested for every job.
const PARTS: [&str; 3] = ["", "/specification", "/results"];

#[test]
fn no_flipped_bit_is_served_as_truth() {
    let flips = std::env::var("DVI_FLIPS").map_or(FLIPS, |text| text.parse().unwrap());
    let at_once = std::env::var("DVI_FLIPS_AT_ONCE").map_or(AT_ONCE, |text| text.parse().unwrap());
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    let accept = |k: usize| {
        // Every fifth result is so long that it is stored in a file; the others are stored in the database.
        let times = if k.is_multiple_of(5) { r#","output":{"times":{"count":5001}}"# } else { "" };
        let document =
            DECAY.replace("-x", &format!("-{}*x", 1 + k)).replace("\"time\"", "\"label\":\"a decay\",\"time\"");
        server.accept(&format!("{}{times}}}", document.strip_suffix('}').unwrap()))
    };
    let paths: Vec<String> = (0..24).map(accept).collect();
    let told: Vec<[String; 3]> = paths
        .iter()
        .map(|path| {
            server.reaches(path, &["successful"]);
            PARTS.map(|part| server.get(&format!("{path}{part}")).body)
        })
        .collect();
    assert!(server.stop().0.success());
    let whole = files(folder.path());
    let bytes: usize = whole.values().map(Vec::len).sum();

    let mut random = Random(std::process::id().into());
    let (mut served, mut damaged, mut unknown, mut rebuilt) = (0, 0, 0, 0);
    for round in 0..flips / at_once {
        let rotten = Folder::new();
        let mut files = whole.clone();
        for _ in 0..at_once {
            let mut place = random.next() as usize % bytes;
            let file = files.values_mut().find(|file| {
                let is_here = place < file.len();
                place -= if is_here { 0 } else { file.len() };
                is_here
            });
            file.unwrap()[place] ^= 1 << (random.next() % 8);
        }
        for (name, bytes) in &files {
            let path = rotten.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        let server = Server::start(&rotten, &["--workers", "1"]);
        for (path, told) in paths.iter().zip(&told) {
            for (part, told) in PARTS.iter().zip(told) {
                let answer = server.get(&format!("{path}{part}"));
                match answer.status {
                    // In the status of a job, the message names the damaged parts of the job.
                    200 if answer.body.contains("damaged: ") && part.is_empty() => damaged += 1,
                    200 => {
                        assert_eq!(answer.body, *told, "round {round}: {path}{part} is wrong");
                        served += 1;
                    }
                    404 => unknown += 1,
                    _ => {
                        answer.problem(500, "damaged");
                        damaged += 1;
                    }
                }
            }
        }
        // The service must still work: a new job is solved, even if its row is on a damaged page.
        server.reaches(&server.accept(DECAY), &["successful"]);
        rebuilt += u32::from(!server.get("/metrics").body.contains("dvi_store_rebuilds_total 0\n"));
    }
    println!("{served} served as they were, {damaged} told as damaged, {unknown} unknown, {rebuilt} stores built anew");
    assert!(served > 0 && damaged > 0, "{served} served, {damaged} damaged");
}

#[test]
fn damaged_results_stay_where_they_are_and_are_shown_again_when_they_are_put_back() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "1"]);
    let document = DECAY.replace("{\"end\":1}}", "{\"end\":1},\"output\":{\"times\":{\"count\":5001}}}");
    let path = server.accept(&document);
    server.reaches(&path, &["successful"]);
    let results = server.get(&format!("{path}/results"));
    let file = folder.path().join("results").join(format!("{}.columns", path.rsplit('/').next().unwrap()));
    let whole = fs::read(&file).unwrap();
    let mut rotten = whole.clone();
    rotten[40_000] ^= 1;
    fs::write(&file, &rotten).unwrap();
    server.get(&format!("{path}/results")).problem(500, "damaged");
    for _ in 0..2 {
        let state = server.get(&path).json();
        assert_eq!((&state["status"], state.get("trusted")), (&"failed".into(), None), "{state}");
        assert!(state["message"].as_str().unwrap().starts_with("damaged: "), "{state}");
    }
    assert!(server.get("/metrics").body.contains("dvi_damaged_jobs 1\n"));
    server.stop();
    let server = Server::start(&folder, &["--workers", "1"]);
    assert_eq!(server.get(&path).json()["status"], "failed");
    assert_eq!(fs::read(&file).unwrap(), rotten);
    server.stop();
    fs::write(&file, &whole).unwrap();
    let server = Server::start(&folder, &["--workers", "1"]);
    let again = server.get(&format!("{path}/results"));
    assert_eq!((again.body == results.body, again.header("etag")), (true, results.header("etag")));
    assert_eq!(server.get(&path).json()["trusted"], true);
}

/// Size of a page of the redb database in bytes, and the first byte of a leaf page.
const PAGE: usize = 4096;
const LEAF: u8 = 1;

/// Corrupts the leaf pages whose rows contain the bytes `held`, and returns the number of such pages; `latest` selects
/// pages with the newest job, or without it.
///
/// A leaf begins with its kind and, from the third byte, the number of its rows; then come the end offsets of their
/// values, which the library follows without checking, and the keys. One offset is set beyond the page.
fn spoil(folder: &Folder, paths: &[String], held: &[u8], latest: bool) -> usize {
    let file = folder.path().join("jobs.redb");
    let mut pages = fs::read(&file).unwrap();
    let names = paths.iter().map(|path| u128::from_str_radix(&path["/jobs/".len()..].replace('-', ""), 16).unwrap());
    let last = names.max().unwrap().to_le_bytes();
    let mut spoiled = 0;
    for page in pages.chunks_mut(PAGE) {
        let rows = usize::from(u16::from_le_bytes([page[2], page[3]]));
        let is_held = page.windows(held.len()).any(|part| part == held);
        let has_latest = page.windows(16).any(|part| part == last);
        if page[0] == LEAF && is_held && has_latest == latest && (3..PAGE / 24).contains(&rows) {
            let end = 4 + 4 * (rows / 2);
            page[end..end + 4].copy_from_slice(&u32::MAX.to_le_bytes());
            spoiled += 1;
        }
    }
    assert!(spoiled > 0, "no page holds such rows");
    fs::write(&file, &pages).unwrap();
    spoiled
}

/// Solves the decay problem `count` times; returns the paths and the statuses of the jobs.
fn solve_many(server: &Server, count: usize) -> (Vec<String>, Vec<String>) {
    let paths: Vec<String> = (0..count).map(|_| server.accept(DECAY)).collect();
    paths.iter().for_each(|path| drop(server.reaches(path, &["successful"])));
    let told = paths.iter().map(|path| server.get(path).body).collect();
    (paths, told)
}

/// Returns the damaged database files, which each rebuild of a database keeps beside it.
fn aside(folder: &Folder) -> Vec<PathBuf> {
    let names = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
    names.filter(|path| path.to_string_lossy().contains("jobs.redb.damaged-")).collect()
}

#[test]
fn rows_on_a_page_over_which_its_reader_panics_are_set_aside_alone() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "2"]);
    let (paths, told) = solve_many(&server, 60);
    assert!(server.stop().0.success());
    let spoiled = spoil(&folder, &paths, b"\"client\":", false);
    // The first start after the corruption rebuilds the database, and the second start finds it intact.
    for start in 0..2 {
        let server = Server::start(&folder, &["--workers", "1"]);
        let answers: Vec<_> = paths.iter().map(|path| server.get(path)).collect();
        let whole =
            answers.iter().zip(&told).filter(|(answer, told)| answer.status == 200 && answer.body == **told).count();
        // On each corrupted page, the rows on both sides of the corrupted offset are lost.
        let lost = answers.iter().filter(|answer| answer.status != 200 || answer.body.contains("damaged: ")).count();
        println!("{whole} of {} rows are shown, {lost} are lost, after {spoiled} pages were spoiled", paths.len());
        assert_eq!(whole + lost, paths.len(), "{answers:?}");
        assert!((1..=2 * spoiled).contains(&lost), "{lost} are lost");
        let figures = server.get("/metrics").body;
        assert!(figures.contains(&format!("dvi_damaged_jobs {lost}\n")), "{figures}");
        assert!(figures.contains(&format!("dvi_store_rebuilds_total {}\n", 1 - start)), "{figures}");
        server.reaches(&server.accept(DECAY), &["successful"]);
        let is_told = server.beginning.contains("pages of the database are damaged; it is built anew");
        assert_eq!((is_told, aside(&folder).len()), (start == 0, 1));
        assert!(server.stop().0.success());
    }
}

#[test]
fn a_damaged_page_of_specifications_is_healed_before_a_new_job_is_written_beside_it() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "2"]);
    let (paths, told) = solve_many(&server, 60);
    assert!(server.stop().0.success());
    spoil(&folder, &paths, b"\"dvi\":{\"states\"", true);
    let rotten = fs::read(folder.path().join("jobs.redb")).unwrap();
    let server = Server::start(&folder, &["--workers", "1"]);
    server.reaches(&server.accept(DECAY), &["successful"]);
    assert!(server.get("/metrics").body.contains("dvi_store_rebuilds_total 1\n"));
    assert_eq!(server.get("/readyz").status, 200);
    for (path, told) in paths.iter().zip(&told) {
        assert_eq!(server.get(path).body, *told);
        assert_eq!(server.get(&format!("{path}/results")).status, 200);
    }
    let lost = paths.iter().filter(|path| server.get(&format!("{path}/specification")).status == 500).count();
    assert!((1..60).contains(&lost), "{lost} specifications are lost");
    // The rebuild keeps the damaged file; more than half of its pages, without the free pages at the end, must be
    // those of the file before the start.
    let kept = fs::read(&aside(&folder)[0]).unwrap();
    let is_same = |place: usize| kept.get(place..place + PAGE) == rotten.get(place..place + PAGE);
    let same = (0..kept.len()).step_by(PAGE).filter(|place| is_same(*place)).count();
    assert!(aside(&folder).len() == 1 && 2 * same > kept.len() / PAGE, "{same} of {} pages", kept.len() / PAGE);
    assert!(server.beginning.contains("have lost parts"), "{}", server.beginning);
    assert!(server.beginning.contains(": specification") && server.stop().0.success());
    let server = Server::start(&folder, &["--workers", "1"]);
    assert!(paths.iter().zip(&told).all(|(path, told)| server.get(path).body == *told));
}

/// Offsets in the header of a redb file: the magic number, the flags of a clean shutdown, and the page size.
const HEADER: [usize; 4] = [0, 8, 9, 13];

#[test]
fn a_store_whose_header_is_damaged_is_built_anew_from_its_pages() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "2"]);
    let (paths, told) = solve_many(&server, 30);
    assert!(server.stop().0.success());
    let database = folder.path().join("jobs.redb");
    let whole = fs::read(&database).unwrap();
    for place in HEADER {
        let mut rotten = whole.clone();
        rotten[place] ^= 1;
        fs::write(&database, &rotten).unwrap();
        let server = Server::start(&folder, &["--workers", "1"]);
        for (path, told) in paths.iter().zip(&told) {
            assert_eq!(server.get(path).body, *told, "byte {place}");
            for part in ["/specification", "/results"] {
                assert_eq!(server.get(&format!("{path}{part}")).status, 200, "byte {place}");
            }
        }
        server.reaches(&server.accept(DECAY), &["successful"]);
        assert!(server.stop().0.success());
    }
}

/// First byte of a branch page of the redb database, and the sizes of its parts in bytes: the head, then a checksum
/// and a page number for each child.
const BRANCH: u8 = 2;
const BRANCH_HEAD: usize = 8;
const CHECKSUM: usize = 16;
const NUMBER: usize = 8;

#[test]
fn pages_that_lead_in_a_circle_end_no_service() {
    let folder = Folder::new();
    let server = Server::start(&folder, &["--workers", "2"]);
    let (paths, told) = solve_many(&server, 60);
    assert!(server.stop().0.success());
    let database = folder.path().join("jobs.redb");
    // Replace the children of each branch page by the page itself.
    let mut circles = fs::read(&database).unwrap();
    let mut count = 0;
    for (number, page) in circles.chunks_mut(PAGE).enumerate().skip(1) {
        let others = usize::from(u16::from_le_bytes([page[2], page[3]])) + 1;
        let numbers = BRANCH_HEAD + CHECKSUM * others;
        if page[0] == BRANCH && numbers + NUMBER * others <= PAGE {
            let own = (number as u64 - 1).to_le_bytes();
            page[numbers..][..NUMBER * others].chunks_mut(NUMBER).for_each(|other| other.copy_from_slice(&own));
            count += 1;
        }
    }
    assert!(count > 0, "no page leads to others");
    fs::write(&database, circles).unwrap();
    let server = Server::start(&folder, &["--workers", "1"]);
    for (path, told) in paths.iter().zip(&told) {
        assert_eq!(server.get(path).body, *told);
        assert_eq!(server.get(&format!("{path}/specification")).status, 200);
    }
    server.reaches(&server.accept(DECAY), &["successful"]);
    assert_eq!(server.get("/readyz").status, 200);
    assert!(server.get("/metrics").body.contains("dvi_store_rebuilds_total 1\n"));
    assert!(server.stop().0.success());
}

/// Returns all files in a folder and its subfolders by relative path, without the file `reserve`.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = PathBuf::from(path.file_name().unwrap());
        if path.is_dir() {
            found.extend(files(&path).into_iter().map(|(below, bytes)| (name.join(below), bytes)));
        } else if name != Path::new("reserve") {
            found.insert(name, fs::read(&path).unwrap());
        }
    }
    found
}

/// Pseudorandom numbers of `SplitMix64` (Steele, Lea & Flood 2014, "Fast splittable pseudorandom number generators").
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }
}
