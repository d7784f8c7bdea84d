//! The start of a worker: two pipes, and at their other ends a process (in tests, threads of this process).

use std::ffi::OsString;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;

/// A worker that has been started, with the pipes that lead to it.
#[derive(Debug)]
pub struct Start {
    /// The pipe that carries orders to the worker.
    pub orders: OwnedFd,
    /// The pipe that carries reports from the worker.
    pub reports: OwnedFd,
    /// The process of the worker, with its standard error in a pipe; `None` if the worker is a thread of this
    /// process.
    pub process: Option<Child>,
}

/// A function that starts a worker.
pub type Launcher = Arc<dyn Fn() -> io::Result<Start> + Send + Sync>;

/// The executable of this process, even if its file has been replaced, so that the front process (which serves HTTP)
/// and its workers are of one version.
pub const SELF: &str = "/proc/self/exe";

/// Returns a launcher of worker processes of `program`, or else of the executable of this process, each with
/// `memory_mib` MiB for a solve.
pub fn program(program: Option<PathBuf>, memory_mib: usize) -> Launcher {
    let program = program.map_or_else(|| OsString::from(SELF), PathBuf::into_os_string);
    Arc::new(move || {
        let mut process = Command::new(&program)
            .arg0("dvi")
            .args(["worker", "--memory-mib", &memory_mib.to_string()])
            // Workers do not inherit the environment of the front process, which may contain tokens.
            .env_clear()
            .current_dir("/")
            // The allocator must commit address space on demand, since `RLIMIT_DATA` counts what is committed ahead.
            .env("MIMALLOC_ARENA_EAGER_COMMIT", "0")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            // The worker gets a process group of its own: a signal to the group of the front process, such as Ctrl-C,
            // must reach only the front process, which then stops its workers.
            .process_group(0)
            .spawn()?;
        match (process.stdin.take(), process.stdout.take()) {
            (Some(orders), Some(reports)) => {
                Ok(Start { orders: orders.into(), reports: reports.into(), process: Some(process) })
            }
            _ => Err(io::ErrorKind::BrokenPipe.into()),
        }
    })
}
