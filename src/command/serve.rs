//! `dvi serve`: the service in this process, until a signal stops it.

use super::data::Data;
use super::spans::Spans;
use super::{UNSERVABLE, USAGE};
use clap::{Args, ValueEnum};
use dvi::service::{Log, Options, PlainFields, Service, worker};
use std::env::{self, VarError};
use std::io::{self, IsTerminal};
use std::net::SocketAddr;
use std::panic;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc::{Receiver, channel};
use tokio::time::sleep;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Serve the solver over HTTP
///
/// Every bound has a flag and an environment variable; the flag takes precedence.
#[derive(Args)]
#[command(after_help = HELP, verbatim_doc_comment)]
pub struct Arguments {
    #[command(flatten)]
    options: Options,

    #[command(flatten)]
    data: Data,

    /// The format of the log on standard error; `RUST_LOG` filters it, for example `dvi=debug`
    #[arg(long, env = "DVI_LOG_FORMAT", value_enum, default_value_t = LogFormat::Text)]
    log_format: LogFormat,
}

const HELP: &str = "\
Examples:
  dvi serve
  dvi serve --ephemeral
  dvi serve --data /var/lib/dvi
  dvi serve --listen 127.0.0.1:9000 --workers 2 --wall-seconds 60
  dvi serve --listen 0.0.0.0:8080                     asks for tokens: dvi token create
  dvi serve --nats nats://host:4222                   a gateway: jobs are solved by dvi worker --nats nats://host:4222
  DVI_QUEUE=100 dvi serve --log-format json

  curl -d @api/examples/diode_bridge.json localhost:8080/solve
  curl -d @long.json -H 'Prefer: respond-async' -i localhost:8080/solve
  curl -H 'Accept: text/csv' localhost:8080/jobs/ID/results
  curl -H 'Accept: image/svg+xml' localhost:8080/jobs/ID/results

Solves run in worker processes (`dvi worker`), which are reused for further jobs and limit their memory to --memory-mib
plus the need of the program itself. A job that exceeds the limit, overflows the stack, meets a defect of the program,
or whose worker is killed, fails with the problem `too-much-memory`, `stack-overflow`, `defect` or `killed`; the service
and the other jobs continue. Each of the --workers, --express and --relief processes and of the processes that check
specifications (half as many as --workers) may take --memory-mib and about 100 MiB more. The memory of the service itself
is bounded mostly by --queue-mib, --answers-mib and, with --ephemeral, --kept-mib.

No job waits behind a long job before it has run for a first time slice, a few times as long as the start of a worker:
--express workers run first slices, in addition to the --workers, which solve to the end. A job that does not end in its
slice continues if a worker is free; otherwise it starts again when one becomes free, and is reported as accepted until
then.

A job that was accepted with 202 is on the disk. The next start of the service runs the jobs that have not ended;
a job that was the only one running when the service ended, twice for lack of memory or sixteen times for any reason,
is set aside. Jobs that were running when it ended run alone for their first 10 s.

With --nats the jobs are on the NATS servers, and not in a folder: any number of gateways may serve them, and any number
of `dvi worker --nats` solve them, on other machines. --workers, --express and --relief have no meaning then; --queue and
--client-share bound the jobs of all gateways together. A gateway that is stopped answers who waits with 202 and the
address of the job, at which any other answers.

SIGTERM or Ctrl-C: no more jobs are accepted; running jobs have the grace time to end,
then they are stopped, and the next start runs them again. A second signal stops them at once.

Exit codes:
  0   a signal stopped the service, in order
  5   the service could not start, for example because the address or the folder is in use
  64  the command line or RUST_LOG is invalid";

/// Time limit for writing the last lines of the log when the service exits.
const LAST_LINES: Duration = Duration::from_secs(1);

/// Time for which the service retries to bind an address in use, and time between two attempts.
const REBINDING: Duration = Duration::from_secs(1);
const BETWEEN_BINDINGS: Duration = Duration::from_millis(5);

/// A format of the log.
#[derive(Clone, Copy, ValueEnum)]
pub enum LogFormat {
    /// For people
    Text,
    /// For programs, one JSON object per line
    Json,
}

/// Runs `dvi serve` until it is stopped; returns the exit code.
pub fn run(arguments: Arguments) -> ExitCode {
    logged(arguments.log_format, |log| start(arguments, log))
}

/// Runs a service and returns its exit code. The log goes to standard error, trace spans to the collector if there is
/// one.
pub fn logged(format: LogFormat, service: impl FnOnce(&Log) -> ExitCode) -> ExitCode {
    let spans = match Spans::start() {
        Ok(spans) => spans,
        Err(error) => {
            eprintln!("dvi: the collector of spans: {error}");
            return ExitCode::from(USAGE);
        }
    };
    let log = match log(format, &spans) {
        Ok(log) => log,
        Err(error) => {
            eprintln!("dvi: RUST_LOG: {error}");
            return ExitCode::from(USAGE);
        }
    };
    let code = service(&log);
    spans.end();
    log.close(LAST_LINES);
    code
}

fn start(arguments: Arguments, log: &Log) -> ExitCode {
    let listen = arguments.options.listen;
    let data = arguments.data.folder();
    let keeps_jobs = !arguments.options.ephemeral && !arguments.options.nats.is_used();
    if data.is_none() && (keeps_jobs || arguments.options.asks_tokens()) {
        eprintln!("dvi: there is no home directory to keep jobs in: give --data DIR, or --ephemeral");
        return ExitCode::from(USAGE);
    }
    match serve(Options { data, program: Some(worker::SELF.into()), ..arguments.options }, log) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!(%listen, %error, "cannot serve on {listen}: {error}");
            ExitCode::from(UNSERVABLE)
        }
    }
}

fn serve(options: Options, log: &Log) -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .thread_name("dvi-http")
        .max_blocking_threads(blocking_threads(options.workers.get()))
        .enable_all()
        .build()?;
    runtime.block_on(async {
        let listener = bind(options.listen).await?;
        let (address, workers) = (listener.local_addr()?, options.workers);
        let mut stop = signals()?;
        let nats = options.nats.clone();
        let data = match options.jobs_folder() {
            Some(folder) => folder.display().to_string(),
            None if nats.is_used() => nats.servers.join(", "),
            None => "memory".to_owned(),
        };
        let asks_tokens = options.asks_tokens();
        let launcher = worker::program(None, options.memory_mib.get());
        let service = if nats.is_used() {
            tokio::select! {
                service = Service::join(options, Arc::new(dvi::solve), &launcher) => service?,
                _ = stop.recv() => return Ok(()),
            }
        } else {
            Service::start(options, Arc::new(dvi::solve), &launcher)?
        };
        service.count_lost_lines(log);
        let confined_to = service.confinement();
        tracing::info!(%address, workers, %confined_to, data, asks_tokens, "serving on http://{address}");
        service.serve(listener, stop).await;
        io::Result::Ok(())
    })?;
    // A thread that still checks a specification, whose client is gone, must not delay the exit.
    runtime.shutdown_background();
    Ok(())
}

/// Returns the number of threads for blocking tasks: reading and writing the text of responses, and waiting for the
/// exit of killed worker processes. Each thread keeps some memory of its own between two tasks, so a small number of
/// threads keeps the memory for many slow clients small. No blocking task waits for a client.
fn blocking_threads(workers: usize) -> usize {
    4 + 2 * workers.min(usize::from(u16::MAX))
}

/// Binds the address. If it is in use, binding is retried for a moment, because a child process of a service that was
/// just killed keeps the socket open until it executes its own program.
async fn bind(address: SocketAddr) -> io::Result<TcpListener> {
    let begun = Instant::now();
    loop {
        match TcpListener::bind(address).await {
            Err(error) if error.kind() == io::ErrorKind::AddrInUse && begun.elapsed() < REBINDING => {
                sleep(BETWEEN_BINDINGS).await;
            }
            bound => return bound,
        }
    }
}

/// Returns a channel that receives a message for every SIGTERM and SIGINT that this process receives.
pub fn signals() -> io::Result<Receiver<()>> {
    let (mut terminate, mut interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
    let (sender, stop) = channel(2);
    tokio::spawn(async move {
        loop {
            tokio::select! {
                _ = terminate.recv() => {}
                _ = interrupt.recv() => {}
            }
            if sender.send(()).await.is_err() {
                return;
            }
        }
    });
    Ok(stop)
}

/// Starts the log of the service on standard error.
fn log(format: LogFormat, spans: &Spans) -> Result<Log, Box<dyn std::error::Error>> {
    let filter: Targets = match env::var("RUST_LOG") {
        Ok(chosen) if !chosen.is_empty() => chosen.parse()?,
        Ok(_) | Err(VarError::NotPresent) => Targets::new().with_default(LevelFilter::INFO),
        Err(error) => return Err(error.into()),
    };
    let log = Log::start(io::stderr())?;
    let lines = log.clone();
    let is_terminal = io::stderr().is_terminal();
    let lines = tracing_subscriber::fmt::layer().with_writer(move || lines.line()).with_ansi(is_terminal);
    let lines = match format {
        LogFormat::Text if is_terminal => lines.with_filter(filter).boxed(),
        LogFormat::Text => lines.fmt_fields(PlainFields).with_filter(filter).boxed(),
        LogFormat::Json => lines.json().with_filter(filter).boxed(),
    };
    tracing_subscriber::registry().with(lines).with(spans.layer()).init();
    // Report panics as log lines, so that a log in JSON contains nothing else. Only the panic hook knows the location
    // of a panic; the tracing span that the line belongs to names the job.
    panic::set_hook(Box::new(|panic| {
        let place = panic.location().map(ToString::to_string).unwrap_or_default();
        tracing::error!(panic.place = place, "panicked at {place}");
    }));
    Ok(log)
}
