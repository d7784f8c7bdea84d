//! `dvi solve` of several files: all cores solve, one file each, and each result is written beside its specification.

use super::result::{Format, write};
use super::solve::on_interrupt;
use super::{BAD_SPECIFICATION, Told, UNFINISHED, UNREADABLE, UNWRITABLE, USAGE, bytes_of, report, verdict};
use dvi::problem::Control;
use dvi::solution::Status;
use dvi::specification::Specification;
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

/// Stack size of a thread in bytes: room for the deepest expression that a specification may hold.
const STACK_BYTES: usize = 8 << 20;

/// Result of one file: its lines for standard error, and the exit code that a solve of the file alone would have.
struct Outcome {
    told: String,
    code: u8,
}

/// The controls of the solves that Ctrl-C stops: of those that run, and of those that begin after Ctrl-C.
#[derive(Default)]
struct Running {
    stopped: AtomicBool,
    controls: Mutex<Vec<Arc<Control>>>,
}

impl Running {
    fn begin(&self, control: &Arc<Control>) {
        self.controls.lock().unwrap_or_else(PoisonError::into_inner).push(Arc::clone(control));
        if self.stopped.load(Ordering::SeqCst) {
            control.cancel();
        }
    }

    fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        self.controls.lock().unwrap_or_else(PoisonError::into_inner).iter().for_each(|control| control.cancel());
    }
}

/// Solves all files; returns the exit code of the first file, in the order given, whose exit code is not 0.
pub fn run(files: &[PathBuf], format: Format) -> ExitCode {
    if let Err(why) = distinct(files, format) {
        eprintln!("dvi: {why}");
        return ExitCode::from(USAGE);
    }
    let running = Arc::new(Running::default());
    let interrupted = Arc::clone(&running);
    on_interrupt(move || interrupted.stop());
    let (next, outcomes) = (AtomicUsize::new(0), Mutex::new(Vec::with_capacity(files.len())));
    let work = || {
        while let Some((place, file)) = take(&next, files).filter(|_| !running.stopped.load(Ordering::SeqCst)) {
            let outcome = solve(file, format, &running);
            eprint!("{}", outcome.told);
            outcomes.lock().unwrap_or_else(PoisonError::into_inner).push((place, outcome.code));
        }
    };
    let cores = thread::available_parallelism().map_or(1, NonZeroUsize::get).min(files.len());
    thread::scope(|scope| {
        for _ in 0..cores {
            let thread = thread::Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, work);
            if let Err(error) = thread {
                eprintln!("dvi: a thread could not be started, so that one fewer solves: {error}");
            }
        }
    });
    let mut codes = outcomes.into_inner().unwrap_or_else(PoisonError::into_inner);
    codes.sort_unstable();
    let unsolved = if codes.len() < files.len() { UNFINISHED } else { 0 };
    ExitCode::from(codes.into_iter().map(|(_, code)| code).find(|code| *code != 0).unwrap_or(unsolved))
}

fn take<'a>(next: &AtomicUsize, files: &'a [PathBuf]) -> Option<(usize, &'a Path)> {
    let place = next.fetch_add(1, Ordering::Relaxed);
    files.get(place).map(|file| (place, file.as_path()))
}

/// Refuses standard input, which has no name, and files whose results would have the same name.
fn distinct(files: &[PathBuf], format: Format) -> Result<(), String> {
    let mut results: HashMap<PathBuf, &Path> = HashMap::new();
    for file in files {
        if file == Path::new("-") {
            return Err("standard input (`-`) cannot be combined with files: give it alone".to_owned());
        }
        if let Some(other) = results.insert(beside(file, format), file) {
            let (other, file) = (other.display(), file.display());
            return Err(format!("the results of {other} and {file} would be the same file"));
        }
    }
    Ok(())
}

/// Returns the path of the result of a specification file, beside that file: `a.result.json` for `a.json`.
fn beside(file: &Path, format: Format) -> PathBuf {
    file.with_extension(format!("result.{}", format.extension()))
}

fn solve(file: &Path, format: Format, running: &Running) -> Outcome {
    let name = file.display();
    let text = match bytes_of(file) {
        Ok(text) => text,
        Err(error) => return Outcome { told: format!("dvi: cannot read {name}: {error}\n"), code: UNREADABLE },
    };
    let reading = Arc::new(Control::new());
    running.begin(&reading);
    let specification = match Specification::from_json_with(&text, &reading) {
        Ok(specification) => specification,
        Err(errors) => {
            let errors: Vec<Told> = errors.into_iter().map(Told::from).collect();
            return Outcome { told: report(file, &errors), code: BAD_SPECIFICATION };
        }
    };
    let control = Arc::new(specification.control());
    running.begin(&control);
    let solution = dvi::solve(&specification, &control);
    let result = beside(file, format);
    let mut told = format!("{name}: {}, {} steps", status(solution.status), solution.diagnostics.steps.accepted);
    let written = File::create(&result).and_then(|out| {
        let mut out = BufWriter::new(out);
        write(&solution, specification.label(), format, &mut out)?;
        out.flush()
    });
    let code = match written {
        Ok(()) => verdict::code(solution.status == Status::Completed, Some(&solution.verdict)),
        Err(error) => {
            told += &format!("; cannot write {}: {error}", result.display());
            UNWRITABLE
        }
    };
    told.push('\n');
    if let Some(error) = &solution.error {
        told += &format!("  {} at t = {}: {}\n", error.code, error.time, error.message);
    }
    told.extend(verdict::lines(&solution.verdict).lines().map(|line| format!("  {line}\n")));
    Outcome { told, code }
}

fn status(status: Status) -> &'static str {
    match status {
        Status::Completed => "completed",
        Status::Stopped => "stopped",
        Status::Failed => "failed",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_has_the_name_of_its_specification() {
        assert_eq!(beside(Path::new("a/spring.json"), Format::Csv), Path::new("a/spring.result.csv"));
        assert_eq!(beside(Path::new("spring"), Format::Json), Path::new("spring.result.json"));
    }

    #[test]
    fn no_result_replaces_another() {
        let files = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        assert!(distinct(&files(&["a/x.json", "b/x.json"]), Format::Csv).is_ok());
        assert!(distinct(&files(&["a/x.json", "a/x.spec"]), Format::Csv).is_err());
        assert!(distinct(&files(&["a/x.json", "-"]), Format::Csv).is_err());
    }
}
