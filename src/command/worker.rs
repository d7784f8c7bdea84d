//! `dvi worker`: a process that takes orders from the front over its standard input and output. It is started by
//! `dvi serve` and by `dvi solve --memory-mib`.

use super::UNANSWERED;
use clap::Args;
use dvi::service::worker::{Confinement, serve};
use std::fs::File;
use std::io;
use std::num::NonZeroUsize;
use std::os::fd::AsFd;
use std::panic;
use std::process::ExitCode;
use std::sync::Arc;

/// Solve the orders on standard input, as a worker process of `dvi serve`
///
/// Orders on standard input and reports on standard output are framed. The process ends with its standard input.
#[derive(Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Memory limit of a solve, in MiB, in addition to the need of the program itself; a process that exceeds it ends
    #[arg(long, value_name = "MIB")]
    memory_mib: NonZeroUsize,
}

/// Performs orders until there are no more.
pub fn run(arguments: &Arguments) -> ExitCode {
    let confinement = Confinement::impose(arguments.memory_mib.get().saturating_mul(1 << 20));
    log();
    match work(confinement) {
        // A solve that is still running ends with the process.
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("dvi: {error}");
            ExitCode::from(UNANSWERED)
        }
    }
}

fn work(confinement: Confinement) -> io::Result<()> {
    // Bypass the buffer of standard output, which is flushed at line ends.
    let output = File::from(io::stdout().as_fd().try_clone_to_owned()?);
    serve(io::stdin().lock(), output, Arc::new(dvi::solve), confinement)
}

/// Starts the log on standard error; the front keeps its last bytes.
fn log() {
    tracing_subscriber::fmt().with_writer(io::stderr).with_ansi(false).without_time().init();
    panic::set_hook(Box::new(|panic| {
        let place = panic.location().map(ToString::to_string).unwrap_or_default();
        tracing::error!("panicked at {place}: {}", panic.payload_as_str().unwrap_or("no message"));
    }));
}
