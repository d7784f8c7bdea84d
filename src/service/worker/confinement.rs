//! The limits that a worker sets itself before it takes anything, so that what a specification makes it do ends with it.

use super::solving::STACK_BYTES;
use rustix::param::page_size;
use rustix::process::{Resource, Rlimit, setrlimit};
use serde::{Deserialize, Serialize};
use std::{fmt, fs};

/// What a worker takes beside a solve: a document and its text, the message in hand, what the allocator holds in reserve.
/// Several times the largest document that is taken by default.
const OWN_BYTES: usize = 64 << 20;

/// Files that a worker may have open: its three streams, and one at a time in which it looks up how large it is.
const OPEN_FILES: u64 = 16;

/// What the kernel, when memory runs out, adds to the size of a worker in parts of a thousand of all memory: it takes
/// workers before anything else.
const OOM_SCORE: &str = "1000";

/// The limits that hold for a worker; one that could not be set is absent.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Confinement {
    /// Bytes of memory that it may write to, its stacks among them (`RLIMIT_DATA`).
    pub data: Option<u64>,
    /// Files that it may have open (`RLIMIT_NOFILE`).
    pub open_files: Option<u64>,
    /// It leaves no picture of its memory behind (`RLIMIT_CORE`).
    pub no_core: bool,
    /// The kernel takes it first when memory runs out (`oom_score_adj`).
    pub first_to_go: bool,
}

impl fmt::Display for Confinement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let limits = [
            self.data.map(|bytes| format!("{} MiB", bytes >> 20)),
            self.open_files.map(|files| format!("{files} open files")),
            self.no_core.then(|| "no core dump".to_owned()),
            self.first_to_go.then(|| "first to go when memory runs out".to_owned()),
        ];
        let held: Vec<String> = limits.into_iter().flatten().collect();
        f.write_str(if held.is_empty() { "nothing" } else { "" })?;
        f.write_str(&held.join(", "))
    }
}

impl Confinement {
    /// Confines this process to so many bytes for a solve, beside what the program itself takes.
    pub fn impose(memory: usize) -> Self {
        let data = memory.saturating_add(OWN_BYTES).saturating_add(STACK_BYTES) as u64 + written();
        Self {
            data: limit(Resource::Data, data),
            open_files: limit(Resource::Nofile, OPEN_FILES),
            no_core: limit(Resource::Core, 0).is_some(),
            first_to_go: fs::write("/proc/self/oom_score_adj", OOM_SCORE).is_ok(),
        }
    }
}

/// Sets a limit for good, or nothing.
fn limit(resource: Resource, value: u64) -> Option<u64> {
    setrlimit(resource, Rlimit { current: Some(value), maximum: Some(value) }).ok().map(|()| value)
}

/// The bytes of memory that this process has for writing, as `RLIMIT_DATA` counts them.
fn written() -> u64 {
    pages(5)
}

/// The bytes of memory that this process holds.
pub(super) fn resident() -> u64 {
    pages(1)
}

/// A field of `/proc/self/statm`, which counts in pages; zero where there is no such file.
fn pages(field: usize) -> u64 {
    let statm = fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: u64 = statm.split(' ').nth(field).and_then(|pages| pages.parse().ok()).unwrap_or(0);
    pages * page_size() as u64
}
