//! `dvi solve`: one solve, in this process or by a server. The results go to standard output, all else to standard
//! error.

use super::remote::{self, Server};
use super::result::{Format, destination, write};
use super::{UNWRITABLE, USAGE, bytes, confined, read_text, setting, several, verdict, with_settings};
use clap::Args;
use dvi::problem::Control;
use dvi::solution::{Status, Verdict, encodings};
use serde::Deserialize;
use std::io::{self, IsTerminal, Write};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// Solve a specification
///
/// The result goes to standard output, progress to standard error if that is a terminal.
/// If the solution is not trusted, standard error has a line for each reason, and the exit code is 7.
/// Ctrl-C stops the solve; the trajectory so far is written.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The specification, a JSON file; - is standard input. Several files are solved on all cores, and the result of
    /// each NAME.json is written beside it as NAME.result.FORMAT
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,

    /// The format of the result; by default that of the file extension, or JSON
    #[arg(long, value_enum)]
    format: Option<Format>,

    /// Write the result to this file instead of standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Replace a number: a parameter (m=2), an initial value (x.initial=1), a component (R1=100), or any number by its
    /// JSON pointer (/method/rtol=1e-9)
    #[arg(long, value_name = "NAME=VALUE", value_parser = setting)]
    set: Vec<(String, String)>,

    /// Memory limit of the solve, in MiB, in addition to the need of the program itself; a process that exceeds it is ended
    #[arg(long, value_name = "MIB", conflicts_with = "server")]
    memory_mib: Option<NonZeroUsize>,

    /// The address of a running service that solves instead of this process
    #[arg(long, env = "DVI_SERVER", value_name = "URL")]
    server: Option<Server>,

    /// The token for the server
    #[arg(long, env = "DVI_TOKEN", value_name = "TOKEN", hide_env_values = true, requires = "server")]
    token: Option<String>,
}

const HELP: &str = "\
Exit codes:
  0   the end time was reached, and the solution is trusted
  1   the solve failed or was stopped; the trajectory so far was written
  2   the specification has errors, listed on standard error with their JSON pointers
  3   the specification could not be read
  4   the result could not be written
  6   the server did not respond, or refused the request
  7   the end time was reached, but the solution is not trusted: a check (residuals, energy balance,
      undetected events, ...) exceeds its allowed value; the result was written
  8   the process that solved was ended; standard error has the reason: `too_much_memory` if it exceeded --memory-mib,
      `stack_overflow`, `killed` or `defect`; nothing was written
  64  the command line is invalid

The result contains the verdict too: in JSON as `verdict`, after `status`; in the schema of an Arrow stream as
the metadata `dvi.trusted` and `dvi.verdict`. CSV and JSON lines contain only the trajectory.

Examples:
  dvi solve api/examples/diode_bridge.json
  dvi solve --format csv spring.json | head
  dvi solve --format svg spring.json > spring.svg
  dvi solve --set k=2 --set x.initial=0.5 -o spring.csv spring.json
  dvi solve --format csv *.json                    spring.json becomes spring.result.csv, and so on
  generate-specification | dvi solve - > result.json
  dvi solve --memory-mib 4096 large.json
  dvi solve --server http://localhost:8080 spring.json";

/// The interval between two updates of the displayed progress of a solve.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Runs `dvi solve`: solves the specifications and writes the results; returns the exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    let format = match Format::of(arguments.format, arguments.output.as_deref()) {
        Ok(format) => format,
        Err(code) => return code,
    };
    let [file] = arguments.files.as_slice() else {
        let is_alone = arguments.server.is_some() || arguments.memory_mib.is_some();
        if is_alone || arguments.output.is_some() || !arguments.set.is_empty() {
            eprintln!("dvi: --server, --memory-mib, --output and --set cannot be combined with several files");
            return ExitCode::from(USAGE);
        }
        return several::run(&arguments.files, format);
    };
    run_alone(arguments, file, format)
}

fn run_alone(arguments: &Arguments, file: &Path, format: Format) -> ExitCode {
    let text = match bytes(file).and_then(|text| with_settings(file, text, &arguments.set)) {
        Ok(text) => text,
        Err(code) => return code,
    };
    if let Some(server) = &arguments.server {
        let server = server.clone().showing(arguments.token.as_deref());
        return remote::run(&server, file, text, format.media_type(), arguments.output.as_deref());
    }
    if let Some(memory_mib) = arguments.memory_mib {
        return solve_confined(arguments, file, format, &text, memory_mib).unwrap_or_else(|code| code);
    }
    let specification = match read_text(file, &text) {
        Ok(specification) => specification,
        Err(code) => return code,
    };
    let control = Arc::new(specification.control());
    let interrupted = Arc::clone(&control);
    on_interrupt(move || interrupted.cancel());
    let solution = with_progress(&control, || dvi::solve_on(threads(), &specification, &control));
    if let Some(error) = &solution.error {
        match solution.table {
            Some(_) => eprintln!("dvi: {}: {}", error.code, error.message),
            None => eprintln!("dvi: {} at t = {}: {}", error.code, error.time, error.message),
        }
    }
    eprint!("{}", verdict::lines(&solution.verdict));
    let output = arguments.output.as_deref();
    let written = destination(output).and_then(|mut out| write(&solution, specification.label(), format, &mut out));
    exit_code(written, solution.status, &solution.verdict)
}

pub(super) fn exit_code(written: io::Result<()>, status: Status, verdict: &Verdict) -> ExitCode {
    match written {
        // A broken pipe is not reported: the reader of the result, such as `head`, has closed its end early.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            eprintln!("dvi: cannot write the result: {error}");
            ExitCode::from(UNWRITABLE)
        }
        _ => verdict::exit_code(status == Status::Completed, Some(verdict)),
    }
}

/// Returns the number of threads of a solve: one per core.
pub(super) fn threads() -> NonZeroUsize {
    thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

/// The label in the text of a specification; all other keys are ignored.
#[derive(Deserialize)]
struct Labelled {
    label: Option<String>,
}

/// Solves in a child process with a memory limit of `memory_mib` MiB, and writes the results.
fn solve_confined(
    arguments: &Arguments,
    file: &Path,
    format: Format,
    document: &[u8],
    memory_mib: NonZeroUsize,
) -> Result<ExitCode, ExitCode> {
    let control = Control::new();
    let (solved, json) = with_progress(&control, || confined::solve(file, document, memory_mib, &control))?;
    if let Some(failed) = &solved.failed {
        eprintln!("dvi: {} at t = {}: {}", failed.code, failed.time, failed.message);
    }
    eprint!("{}", verdict::lines(&solved.verdict));
    let written = destination(arguments.output.as_deref()).and_then(|mut out| match format {
        Format::Json => out.write_all(&json).and_then(|()| out.write_all(b"\n")).and_then(|()| out.flush()),
        // The child process returns the results as JSON, from which all other formats are converted.
        _ => {
            let label = serde_json::from_slice::<Labelled>(document).ok().and_then(|document| document.label);
            encodings::read_json(&json).and_then(|solution| write(&solution, label.as_deref(), format, &mut out))
        }
    });
    Ok(exit_code(written, solved.status, &solved.verdict))
}

/// Calls `act` at Ctrl-C, on a thread of its own. If the thread cannot be started, Ctrl-C ends the process.
pub(super) fn on_interrupt(act: impl FnOnce() + Send + 'static) {
    let wait = move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
        runtime.block_on(tokio::signal::ctrl_c())?;
        act();
        io::Result::Ok(())
    };
    let thread = thread::Builder::new().name("dvi-interrupt".to_owned()).spawn(wait);
    if let Err(error) = thread {
        eprintln!("dvi: Ctrl-C cannot be handled and will discard the trajectory: {error}");
    }
}

/// Shows the progress of a solve on a terminal while it runs.
pub(super) fn with_progress<T>(control: &Control, solve: impl FnOnce() -> T) -> T {
    if !io::stderr().is_terminal() {
        return solve();
    }
    let (done, ended) = channel();
    thread::scope(|scope| {
        scope.spawn(move || show_progress(control, &ended));
        let solved = solve();
        drop(done);
        solved
    })
}

/// Draws the progress of a solve on the terminal until the sender of `ended` is dropped, then clears it.
fn show_progress(control: &Control, ended: &Receiver<()>) {
    let mut drawn = false;
    while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(POLL_INTERVAL) {
        let fraction = control.fraction().clamp(0.0, 1.0);
        let bar = "#".repeat((fraction * 40.0) as usize);
        // A write error on a closed terminal is ignored.
        let _ = write!(io::stderr(), "\r[{bar:<40}] {:5.1} %  {} steps", fraction * 100.0, control.steps());
        drawn = true;
    }
    if drawn {
        let _ = write!(io::stderr(), "\r\x1b[K");
    }
}
