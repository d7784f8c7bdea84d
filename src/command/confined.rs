//! `dvi solve --memory-mib`: a solve in a child process with a memory limit, so that exceeding the limit is reported as
//! an error of the solve.

use super::{BAD_SPECIFICATION, ENDED, Told, UNSERVABLE, report};
use dvi::problem::Control;
use dvi::service::worker::{
    Death, Event, Finished, Left, Limits, Origin, Prints, Solved, Supervisor, Task, Watch, program,
};
use dvi::solution::columnar::{Stored, write_whole};
use std::io;
use std::num::NonZeroUsize;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use tokio::runtime::Builder;
use tokio::select;
use tokio::sync::Notify;

/// Solves `document` in a child process; returns how the solve ended, and its results as JSON. Ctrl-C stops the
/// solve.
///
/// # Errors
/// The exit code, if there are no results; the reason is printed to standard error.
pub fn solve(
    file: &Path,
    document: &[u8],
    memory_mib: NonZeroUsize,
    control: &Control,
) -> Result<(Box<Solved>, Vec<u8>), ExitCode> {
    let memory = memory_mib.get().saturating_mul(1 << 20);
    let ended = |why: String| {
        eprintln!("dvi: {why}");
        ExitCode::from(ENDED)
    };
    let mut columns = Vec::new();
    let finished = finish(document, memory_mib.get(), memory, control, &mut columns).map_err(|error| {
        eprintln!("dvi: no process could be started to solve in: {error}");
        ExitCode::from(UNSERVABLE)
    })?;
    match finished {
        Ok(Finished::Solved(solved, Left::Text(json))) => Ok((solved, json)),
        Ok(Finished::Solved(solved, Left::Columns(prints))) => {
            let json = whole(columns, &prints).map_err(|error| ended(format!("defect: {error}")))?;
            Ok((solved, json))
        }
        Ok(Finished::Refused(errors, _)) => {
            let errors: Vec<Told> = serde_json::from_slice(&errors).unwrap_or_default();
            eprint!("{}", report(file, &errors));
            Err(ExitCode::from(BAD_SPECIFICATION))
        }
        Ok(Finished::TooMuchMemory(estimate)) => {
            let needed = estimate >> 20;
            Err(ended(format!("too_much_memory: about {needed} MiB are needed, and --memory-mib allows {memory_mib}")))
        }
        Ok(Finished::Checked(..) | Finished::TooLarge | Finished::Solved(_, Left::Rows(..))) => {
            Err(ended("defect: the answer is to another question".to_owned()))
        }
        Err(Death::TooMuchMemory(asked)) => {
            let asked = asked.map_or(String::new(), |bytes| format!(", with a last request of {} MiB", bytes >> 20));
            Err(ended(format!("too_much_memory: the solve took more than the {memory_mib} MiB of --memory-mib{asked}")))
        }
        Err(Death::Defect(words)) => Err(ended(format!("defect: {words}"))),
        Err(Death::Killed(signal)) => Err(ended(format!("killed: signal {signal} ended the process"))),
        Err(death @ (Death::StackOverflow | Death::Overran)) => {
            Err(ended(format!("{}: please report the specification", death.code())))
        }
    }
}

/// Converts the columns of a result, the binary form in which the child process stores it, to the JSON text of the
/// result.
fn whole(columns: Vec<u8>, prints: &Prints) -> io::Result<Vec<u8>> {
    let index = columns[columns.len().saturating_sub(prints.index.bytes)..].to_vec();
    let columns = Stored::open(columns, &index)?;
    let mut json = Vec::with_capacity(prints.json.bytes);
    write_whole(&columns, columns.skeleton(), &mut json)?;
    Ok(json)
}

fn finish(
    document: &[u8],
    memory_mib: usize,
    memory: usize,
    control: &Control,
    columns: &mut Vec<u8>,
) -> io::Result<Result<Finished, Death>> {
    let limits = Limits { steps: u64::MAX, memory, wall_seconds: None, result_bytes: usize::MAX };
    let runtime = Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let mut supervisor = Supervisor::new(program(None, memory_mib), u64::MAX, Arc::new(|_: Event<'_>| {}));
        supervisor.start().await?;
        let halted = Notify::new();
        let origin = Origin::default();
        let watch = Watch { origin: &origin, control, halted: &halted, is_unwanted: &|| false };
        let task = &mut Task {
            solve: true,
            members: None,
            document,
            limits,
            watch: &watch,
            long: columns,
            yields: false,
            slice: None,
        };
        let performed = supervisor.perform(task);
        let interrupted = async {
            if tokio::signal::ctrl_c().await.is_ok() {
                halted.notify_one();
            }
            std::future::pending().await
        };
        Ok(select! {
            performed = performed => performed,
            never = interrupted => never,
        })
    })
}
