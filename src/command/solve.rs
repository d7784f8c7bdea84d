//! `dvi solve`: one solve in this process, or by a server. The result goes to standard output, all else to standard error.

use super::remote::{self, Server};
use super::{UNWRITABLE, bytes, confined, read, several, verdict};
use clap::{Args, ValueEnum};
use dvi::problem::Control;
use dvi::solution::{Solution, Status, Verdict, encodings, pictures};
use serde::Deserialize;
use std::io::{self, BufWriter, IsTerminal, Write};
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
/// If the answer is not trusted, standard error says why, a line for each reason, and so does the exit code.
/// Ctrl-C stops the solve; the trajectory so far is written all the same.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// The specification, a JSON file; - is standard input. Of several files each result is written beside its specification,
    /// of NAME.json as NAME.result.FORMAT, and all cores solve
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,

    /// The form of the result
    #[arg(long, value_enum, default_value_t = Format::Json)]
    format: Format,

    /// Memory that the solve may take, in MiB, beside what the program itself needs; a process that takes more is ended
    #[arg(long, value_name = "MIB", conflicts_with = "server")]
    memory_mib: Option<NonZeroUsize>,

    /// The address of a running service that is to solve it in place of this process
    #[arg(long, env = "DVI_SERVER", value_name = "URL")]
    server: Option<Server>,

    /// The token to show to the server
    #[arg(long, env = "DVI_TOKEN", value_name = "TOKEN", hide_env_values = true, requires = "server")]
    token: Option<String>,
}

const HELP: &str = "\
Exit codes:
  0   the end time was reached, and the answer is trusted
  1   the solve failed or was stopped; the trajectory so far was written
  2   the specification has errors, told on standard error with their JSON pointers
  3   the specification could not be read
  4   the result could not be written
  6   the server did not answer, or refused
  7   the end time was reached, but the answer is not trusted: a check (residuals, balance of energy,
      undetected events, ...) exceeds what the tolerances allow; the result was written
  8   the process that solved was ended, for which standard error has a word: `too_much_memory` where it took more than
      --memory-mib allows, `stack_overflow`, `killed` or `defect`; nothing was written
  64  the command line makes no sense

The verdict also stands in the result: in JSON as `verdict`, right after `status`; in the schema of an Arrow
stream as the metadata `dvi.trusted` and `dvi.verdict`. CSV and JSON lines hold the trajectory alone.

Examples:
  dvi solve api/examples/diode_bridge.json
  dvi solve --format csv spring.json | head
  dvi solve --format svg spring.json > spring.svg
  dvi solve --format csv *.json                    spring.json becomes spring.result.csv, and so on
  generate-specification | dvi solve - > result.json
  dvi solve --memory-mib 4096 large.json
  dvi solve --server http://localhost:8080 spring.json";

/// A form of the result.
#[derive(Clone, Copy, ValueEnum)]
pub(super) enum Format {
    /// Verdict, trajectory, events and diagnostics
    Json,
    /// The trajectory as a table
    Csv,
    /// The trajectory as JSON lines, an object a time
    Ndjson,
    /// The trajectory as an Arrow stream
    Arrow,
    /// The trajectory as a picture
    Svg,
}

impl Format {
    /// The end of the name of a file that has it.
    pub(super) fn extension(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Csv => "csv",
            Self::Ndjson => "ndjson",
            Self::Arrow => "arrow",
            Self::Svg => "svg",
        }
    }

    fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv",
            Self::Ndjson => "application/x-ndjson",
            Self::Arrow => "application/vnd.apache.arrow.stream",
            Self::Svg => "image/svg+xml",
        }
    }
}

/// The time between two looks at the progress.
const GLANCE: Duration = Duration::from_millis(100);

/// Solves and writes; the exit code says how it went.
pub fn run(arguments: &Arguments) -> ExitCode {
    let [file] = arguments.files.as_slice() else {
        return several::run(
            &arguments.files,
            arguments.format,
            arguments.server.is_some() || arguments.memory_mib.is_some(),
        );
    };
    run_alone(arguments, file)
}

fn run_alone(arguments: &Arguments, file: &Path) -> ExitCode {
    if let Some(server) = &arguments.server {
        return match bytes(file) {
            Ok(specification) => {
                let server = server.clone().showing(arguments.token.as_deref());
                remote::run(&server, file, specification, arguments.format.media_type())
            }
            Err(code) => code,
        };
    }
    if let Some(memory_mib) = arguments.memory_mib {
        return solve_confined(arguments, file, memory_mib).unwrap_or_else(|code| code);
    }
    let specification = match read(file) {
        Ok(specification) => specification,
        Err(code) => return code,
    };
    let control = Arc::new(specification.control());
    let interrupted = Arc::clone(&control);
    on_interrupt(move || interrupted.cancel());
    let solution = with_progress(&control, || dvi::solve(&specification, &control));
    if let Some(error) = &solution.error {
        eprintln!("dvi: {} at t = {}: {}", error.code, error.time, error.message);
    }
    eprint!("{}", verdict::lines(&solution.verdict));
    let written = write_to_standard_output(&solution, specification.label(), arguments.format);
    exit_code(written, solution.status, &solution.verdict)
}

fn exit_code(written: io::Result<()>, status: Status, verdict: &Verdict) -> ExitCode {
    match written {
        // The reader has seen enough, as `head` does.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            eprintln!("dvi: cannot write the result: {error}");
            ExitCode::from(UNWRITABLE)
        }
        _ => verdict::exit_code(status == Status::Completed, Some(verdict)),
    }
}

/// The label of a specification, whatever else it says.
#[derive(Deserialize)]
struct Labelled {
    label: Option<String>,
}

/// The same in a process of its own, which may take so much memory.
fn solve_confined(arguments: &Arguments, file: &Path, memory_mib: NonZeroUsize) -> Result<ExitCode, ExitCode> {
    let document = bytes(file)?;
    let control = Control::new();
    let (solved, json) = with_progress(&control, || confined::solve(file, &document, memory_mib, &control))?;
    if let Some(failed) = &solved.failed {
        eprintln!("dvi: {} at t = {}: {}", failed.code, failed.time, failed.message);
    }
    eprint!("{}", verdict::lines(&solved.verdict));
    let written = match arguments.format {
        Format::Json => {
            let mut out = io::stdout().lock();
            out.write_all(&json).and_then(|()| out.write_all(b"\n"))
        }
        Format::Csv | Format::Ndjson | Format::Arrow | Format::Svg => {
            let label = serde_json::from_slice::<Labelled>(&document).ok().and_then(|document| document.label);
            encodings::read_json(&json)
                .and_then(|solution| write_to_standard_output(&solution, label.as_deref(), arguments.format))
        }
    };
    Ok(exit_code(written, solved.status, &solved.verdict))
}

/// Waits for Ctrl-C on a thread of its own. Where that cannot be had, Ctrl-C ends the process, as it always did.
pub(super) fn on_interrupt(act: impl FnOnce() + Send + 'static) {
    let wait = move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
        runtime.block_on(tokio::signal::ctrl_c())?;
        act();
        io::Result::Ok(())
    };
    let thread = thread::Builder::new().name("dvi-interrupt".to_owned()).spawn(wait);
    if let Err(error) = thread {
        eprintln!("dvi: Ctrl-C will not keep the trajectory so far: {error}");
    }
}

/// Shows the progress of a solve on a terminal while it runs.
fn with_progress<T>(control: &Control, solve: impl FnOnce() -> T) -> T {
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

/// Draws the progress until the other end of `ended` is dropped, then wipes it away.
fn show_progress(control: &Control, ended: &Receiver<()>) {
    let mut drawn = false;
    while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(GLANCE) {
        let fraction = control.fraction().clamp(0.0, 1.0);
        let bar = "#".repeat((fraction * 40.0) as usize);
        // A terminal that is gone needs no progress.
        let _ = write!(io::stderr(), "\r[{bar:<40}] {:5.1} %  {} steps", fraction * 100.0, control.steps());
        drawn = true;
    }
    if drawn {
        let _ = write!(io::stderr(), "\r\x1b[K");
    }
}

fn write_to_standard_output(solution: &Solution, label: Option<&str>, format: Format) -> io::Result<()> {
    write(solution, label, format, &mut BufWriter::new(io::stdout().lock()))
}

/// Writes a result in a form.
pub(super) fn write(
    solution: &Solution,
    label: Option<&str>,
    format: Format,
    mut out: &mut impl Write,
) -> io::Result<()> {
    match format {
        Format::Json => {
            encodings::write_json(solution, &mut out)?;
            out.write_all(b"\n")?;
        }
        Format::Csv => encodings::write_table(&mut encodings::Csv, &solution.trajectory, &mut out)?,
        Format::Ndjson => encodings::write_table(&mut encodings::Lines, &solution.trajectory, &mut out)?,
        Format::Arrow => {
            let mut table = encodings::Arrow::with(&solution.verdict).of(solution.provenance.as_ref());
            encodings::write_table(&mut table, &solution.trajectory, &mut out)?;
        }
        Format::Svg => pictures::write_svg(solution, label, &mut out)?,
    }
    out.flush()
}
