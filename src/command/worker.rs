//! `dvi worker`: a process that takes orders over its standard input and output from the process that started it,
//! `dvi serve` or `dvi solve --memory-mib`; with `--nats`, the supervisor of such processes, which takes jobs from
//! NATS servers.

use super::serve::{LogFormat, logged, signals};
use super::{UNANSWERED, UNSERVABLE};
use clap::Args;
use dvi::service::jobs::{WorkOptions, work};
use dvi::service::worker::{Confinement, program, serve};
use std::fs::File;
use std::io;
use std::num::NonZeroUsize;
use std::os::fd::AsFd;
use std::panic;
use std::process::ExitCode;
use std::sync::Arc;

/// Solve jobs that gateways (`dvi serve --nats`) have put on NATS servers
///
/// Without --nats: a process of `dvi serve`. It takes framed orders on standard input, and ends with it.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    /// Memory limit of a solve, in MiB, in addition to the need of the program itself; a process that exceeds it ends
    #[arg(long, env = "DVI_MEMORY_MIB", value_name = "MIB", default_value = "2048")]
    memory_mib: NonZeroUsize,

    #[command(flatten)]
    options: WorkOptions,

    /// The format of the log on standard error; `RUST_LOG` filters it, for example `dvi=debug`
    #[arg(long, env = "DVI_LOG_FORMAT", value_enum, default_value_t = LogFormat::Text)]
    log_format: LogFormat,
}

const HELP: &str = "\
Examples:
  dvi worker --nats nats://host:4222
  dvi worker --nats tls://host:4222 --nats-credentials worker.creds
  dvi worker --nats nats://host:4222 --workers 4 --until-idle 10m

A worker only connects to the servers, and nothing connects to it. Any number of workers may run, and each may be killed at any
moment: what it had is given to another worker when nothing has been heard of it for the time that the gateways set with
--nats-lost-seconds. A job is set aside (the problem `poisoned`) if it takes down two workers on which it runs alone.

SIGTERM or Ctrl-C: no more jobs are taken; running jobs have the grace time to end, then they are left to other workers.
A second signal leaves them at once.

Exit codes:
  0   it was stopped, or --until-idle is over
  5   it could not start, for example because the servers do not answer
  64  the command line or RUST_LOG is invalid";

/// Runs `dvi worker`: checks and solves specifications as ordered on standard input until it ends; with `--nats`,
/// supervises such processes. Returns the exit code.
pub fn run(arguments: Arguments) -> ExitCode {
    if arguments.options.nats.is_used() {
        return join(arguments);
    }
    let confinement = Confinement::impose(arguments.memory_mib.get().saturating_mul(1 << 20));
    log_plainly();
    match perform(confinement) {
        // Standard input has ended: a solve that is still running ends with the process.
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("dvi: {error}");
            ExitCode::from(UNANSWERED)
        }
    }
}

/// Takes jobs from NATS servers until stopped; returns the exit code.
fn join(arguments: Arguments) -> ExitCode {
    let Arguments { memory_mib, options, log_format } = arguments;
    logged(log_format, |_| match work_on(memory_mib, options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!(%error, "cannot work: {error}");
            ExitCode::from(UNSERVABLE)
        }
    })
}

fn work_on(memory_mib: NonZeroUsize, options: WorkOptions) -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_multi_thread().thread_name("dvi-nats").enable_all().build()?;
    runtime.block_on(async {
        let launcher = program(None, memory_mib.get());
        work(options, memory_mib, Arc::new(dvi::solve), &launcher, signals()?).await
    })?;
    // A thread that still reads the result of a job must not delay the exit of the worker.
    runtime.shutdown_background();
    Ok(())
}

fn perform(confinement: Confinement) -> io::Result<()> {
    // Bypass the buffer of standard output, which is flushed at line ends.
    let output = File::from(io::stdout().as_fd().try_clone_to_owned()?);
    serve(io::stdin().lock(), output, Arc::new(dvi::solve), confinement)
}

/// Starts the log on standard error; the process that started the worker keeps the last bytes of the log.
fn log_plainly() {
    tracing_subscriber::fmt().with_writer(io::stderr).with_ansi(false).without_time().init();
    panic::set_hook(Box::new(|panic| {
        let place = panic.location().map(ToString::to_string).unwrap_or_default();
        tracing::error!("panicked at {place}: {}", panic.payload_as_str().unwrap_or("no message"));
    }));
}
