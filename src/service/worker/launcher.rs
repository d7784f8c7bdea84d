//! How a worker comes about: two pipes and something at their other ends.

use std::ffi::OsString;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;

/// A worker that has been started.
#[derive(Debug)]
pub struct Start {
    /// Where its orders go.
    pub orders: OwnedFd,
    /// Where its reports come from.
    pub reports: OwnedFd,
    /// Its process, with standard error in a pipe, where it is one of its own.
    pub process: Option<Child>,
}

/// Starts a worker.
pub type Launcher = Arc<dyn Fn() -> io::Result<Start> + Send + Sync>;

/// This program, whatever has become of its file meanwhile: a front and its workers are of one version.
pub const SELF: &str = "/proc/self/exe";

/// Workers that are processes of `program`, or else of this one, each with so many MiB for a solve.
pub fn program(program: Option<PathBuf>, memory_mib: usize) -> Launcher {
    let program = program.map_or_else(|| OsString::from(SELF), PathBuf::into_os_string);
    Arc::new(move || {
        let mut process = Command::new(&program)
            .arg0("dvi")
            .args(["worker", "--memory-mib", &memory_mib.to_string()])
            // What the front was told in its environment, tokens among it, is no business of a specification.
            .env_clear()
            .current_dir("/")
            // The allocator is to take address space as it needs it: what it takes ahead counts as taken.
            .env("MIMALLOC_ARENA_EAGER_COMMIT", "0")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            // A signal to the group of the front, such as Ctrl-C, is for the front to pass on.
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
