//! Fuzzing of specifications: `cargo bench --bench fuzz` for ten minutes; `SECONDS=60 COUNT=100000 SEED=7` set other
//! limits, of which the first to be reached applies. Before that, a million fuzzed [`messages`] between the service
//! and its workers; `MESSAGES=1000` sets their number.
//!
//! The examples are changed by [`mutation`] and parsed. A document with errors not seen before is kept and changed
//! further, so that errors behind errors are reached. Correct documents are solved for a short time. The search ends
//! if parsing panics, or takes more time or memory than a document of its size may; the document is left in a file
//! whose name is printed, also after a stack overflow, which ends the process.

mod messages;
mod mutation;

use allocation_counter::measure;
use dvi::problem::Control;
use dvi::specification::{Specification, SpecificationError, document_of};
use mutation::Mutation;
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

/// Stack size of the threads on which the service parses documents, in bytes.
const STACK_BYTES: usize = 2 << 20;
/// CPU time that parsing may take, as a constant plus a time for each byte of the document.
const READING: Duration = Duration::from_secs(1);
const READING_A_BYTE: Duration = Duration::from_micros(20);
/// Memory in bytes that parsing may take, as a constant plus an amount for each byte of the document.
const MEMORY: u64 = 256 << 20;
const MEMORY_A_BYTE: u64 = 4096;
/// Time limit of each solve, and the time beyond the limit after which a solve counts as hung.
const SOLVE: Duration = Duration::from_millis(20);
const LATE: Duration = Duration::from_secs(5);
/// Size of the largest document that is kept for further mutation, in bytes: larger ones slow the search down.
const LARGEST: usize = 16 << 10;

fn main() {
    let number = |name: &str, default| std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default);
    let (seconds, count, seed) = (number("SECONDS", 600), number("COUNT", u64::MAX), number("SEED", 1));
    let (start, messages) = (Instant::now(), number("MESSAGES", 1_000_000));
    let met = messages::meet(messages, seed);
    println!("{met:?} in {:?}; no panic", start.elapsed());
    let current = std::env::temp_dir().join(format!("dvi-fuzz-{}.json", std::process::id()));
    println!("{seconds} s from seed {seed}; the document in hand stands in {}", current.display());
    let search = move || search(Duration::from_secs(seconds), count, seed, &current);
    let searching = thread::Builder::new().stack_size(STACK_BYTES).spawn(search).expect("a thread");
    if searching.join().is_err() {
        std::process::exit(1);
    }
}

fn search(time: Duration, count: u64, seed: u64, current: &Path) {
    // The corpus: correct documents, and documents with errors.
    let mut corpus = [examples(), Vec::new()];
    let mut mutation = Mutation::new(seed, &corpus[0]);
    let mut seen: HashSet<String> = HashSet::new();
    let (start, mut read, mut correct) = (Instant::now(), 0_u64, 0_u64);
    let mut told = Duration::ZERO;
    let (mut slowest, mut largest) = (Duration::ZERO, 0);
    while start.elapsed() < time && read < count {
        let document = mutation.change(&corpus);
        fs::write(current, &document).expect("a temporary file");
        let (outcome, spent, bytes) = attempt(&document);
        assert!(
            spent < READING + READING_A_BYTE * document.len() as u32,
            "{spent:?} for {} bytes in {}",
            document.len(),
            current.display()
        );
        assert!(
            bytes < MEMORY + MEMORY_A_BYTE * document.len() as u64,
            "{} MiB for {} bytes in {}",
            bytes >> 20,
            document.len(),
            current.display()
        );
        (slowest, largest) = (slowest.max(spent), largest.max(bytes));
        read += 1;
        correct += u64::from(outcome.is_correct);
        let new = outcome.marks.into_iter().filter(|mark| seen.insert(mark.clone())).count();
        if document.len() <= LARGEST && new > 0 {
            corpus[usize::from(!outcome.is_correct)].push(document);
        }
        if start.elapsed() >= told + Duration::from_secs(30) {
            told = start.elapsed();
            let (kept, mib) = (corpus[0].len() + corpus[1].len(), largest >> 20);
            println!(
                "{:>4} s: {read} read, {correct} correct, {kept} kept, {slowest:?} and {mib} MiB at most",
                told.as_secs()
            );
        }
    }
    println!("{read} read, {correct} correct and solved; no panic");
    // If the file of the current document cannot be removed, it stays in the temporary folder.
    let _ = fs::remove_file(current);
}

/// Outcome of parsing a document and, if it is correct, of solving it.
struct Outcome {
    is_correct: bool,
    /// Words that characterise the outcome, such as error codes. An outcome with words not seen before makes its
    /// document part of the corpus.
    marks: Vec<String>,
}

/// Parses a document and solves it if it is correct; returns the outcome, and the CPU time and the memory that
/// parsing took.
fn attempt(document: &[u8]) -> (Outcome, Duration, u64) {
    let (mut read, start) = (None, processor_time());
    let memory = measure(|| read = Some(Specification::from_json(document)));
    let spent = processor_time() - start;
    let outcome = match read.expect("it was read") {
        Ok(specification) => Outcome { is_correct: true, marks: vec![solve(&specification)] },
        Err(errors) => Outcome { is_correct: false, marks: errors.iter().map(place_and_code).collect() },
    };
    (outcome, spent, memory.bytes_max)
}

/// Returns the JSON pointer and the code of an error as one word. Names and numbers in the pointer are dropped, since
/// they would make too many outcomes distinct.
fn place_and_code(SpecificationError { pointer, code, .. }: &SpecificationError) -> String {
    let words = pointer.split('/').filter(|word| word.len() > 2 && word.bytes().all(|byte| byte.is_ascii_lowercase()));
    format!("{} {code}", words.collect::<Vec<_>>().join("/"))
}

fn solve(specification: &Specification) -> String {
    let deadline = Instant::now() + SOLVE;
    let solution = dvi::solve(specification, &Control::with_deadline(deadline));
    assert!(Instant::now() < deadline + LATE, "a solve did not stop for {:?}", deadline.elapsed());
    let steps = solution.diagnostics.steps.accepted.checked_ilog2();
    format!("{} {:?} {steps:?} {:?}", specification.problem(), solution.status, solution.error.map(|error| error.code))
}

/// Returns the CPU time of the current thread.
fn processor_time() -> Duration {
    let figures = fs::read_to_string("/proc/thread-self/schedstat").expect("Linux");
    let nanoseconds = figures.split(' ').next().and_then(|figure| figure.parse().ok());
    Duration::from_nanos(nanoseconds.expect("a time"))
}

fn examples() -> Vec<Vec<u8>> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("api/examples");
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).expect("examples").flatten().map(|entry| entry.path()).collect();
    paths.sort();
    let mut all: Vec<Vec<u8>> = paths.into_iter().map(|path| fs::read(path).expect("an example")).collect();
    for model in ["double_pendulum.urdf", "hopper.xml"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/systems/robots/models").join(model);
        all.push(document_of(&fs::read(path).expect("a robot")).into_owned());
    }
    all
}
