//! The resource and access limits that a worker process imposes on itself before it takes orders, so that a harmful
//! specification affects no other process.

use super::solving::STACK_BYTES;
#[cfg(target_os = "linux")]
use landlock::{ABI, Access, AccessFs, LandlockStatus, Ruleset, RulesetAttr, RulesetError};
use rustix::param::page_size;
use rustix::process::{Resource, Rlimit, setrlimit};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::sync::LazyLock;
use std::{fmt, str};

/// The memory that a worker process needs in addition to a solve, in bytes: a specification as bytes and as text, the
/// current message, and the reserve of the allocator. Several times the largest specification that is accepted by
/// default.
const OWN_BYTES: usize = 64 << 20;

/// The largest number of open files of a worker process: standard input, output and error, the file in which the
/// worker reads its own size, and some in reserve.
const OPEN_FILES: u64 = 16;

/// The value of the kernel's `oom_score_adj` for workers, in thousandths of all memory, which is added to the size of
/// a process when memory runs out: workers are killed before any other process.
const OOM_SCORE: &str = "1000";

/// The first version of Landlock that denies every way to change a file, truncation by path included (Linux 6.2).
#[cfg(target_os = "linux")]
const WHOLE: ABI = ABI::V3;

/// The file with the sizes of this process, in pages. A worker process opens it at its start, before it gives up
/// access to files.
static SIZES: LazyLock<Option<File>> = LazyLock::new(|| File::open("/proc/self/statm").ok());

/// The size in bytes of a buffer for the text of `/proc/self/statm`, seven numbers of pages.
const SIZES_BYTES: usize = 256;

/// The limits in force on a worker process; a limit that could not be set is absent.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Confinement {
    /// The limit of writable memory in bytes, stacks included (`RLIMIT_DATA`).
    pub data: Option<u64>,
    /// The limit of open files (`RLIMIT_NOFILE`).
    pub open_files: Option<u64>,
    /// Whether the worker process writes no core file (`RLIMIT_CORE`).
    pub no_core: bool,
    /// Whether the kernel kills the worker process first when memory runs out (`oom_score_adj`).
    pub first_to_go: bool,
    /// Whether the worker process may open, create, change or remove no file (Landlock); its inherited pipes stay
    /// usable.
    pub no_files: bool,
}

impl fmt::Display for Confinement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let limits = [
            self.data.map(|bytes| format!("{} MiB", bytes >> 20)),
            self.open_files.map(|files| format!("{files} open files")),
            self.no_core.then(|| "no core dump".to_owned()),
            self.first_to_go.then(|| "first to go when memory runs out".to_owned()),
            self.no_files.then(|| "no access to files".to_owned()),
        ];
        let held: Vec<String> = limits.into_iter().flatten().collect();
        f.write_str(if held.is_empty() { "nothing" } else { "" })?;
        f.write_str(&held.join(", "))
    }
}

impl Confinement {
    /// Limits this process to `memory` bytes for a solve, in addition to the memory of the program itself, and denies
    /// it access to files.
    pub fn impose(memory: usize) -> Self {
        let data = memory.saturating_add(OWN_BYTES).saturating_add(STACK_BYTES) as u64 + written();
        Self {
            data: limit(Resource::Data, data),
            open_files: limit(Resource::Nofile, OPEN_FILES),
            no_core: limit(Resource::Core, 0).is_some(),
            first_to_go: fs::write("/proc/self/oom_score_adj", OOM_SCORE).is_ok(),
            // Access to files is denied last, since setting the other limits opens files.
            no_files: deny_files(),
        }
    }
}

/// Sets the soft and the hard limit of a resource of this process to `value`; returns the limit, or `None` if the
/// system refuses.
fn limit(resource: Resource, value: u64) -> Option<u64> {
    setrlimit(resource, Rlimit { current: Some(value), maximum: Some(value) }).ok().map(|()| value)
}

/// Denies this thread and the threads that it starts all access to files; returns whether every kind of access is
/// denied.
#[cfg(target_os = "linux")]
fn deny_files() -> bool {
    let deny = || -> Result<_, RulesetError> {
        // The rights of later Landlock versions are requested too; a kernel that does not know them ignores them.
        Ruleset::default().handle_access(AccessFs::from_all(ABI::V7))?.create()?.restrict_self()
    };
    let status = deny().map(|status| status.landlock);
    matches!(status, Ok(LandlockStatus::Available { effective_abi, .. }) if effective_abi >= WHOLE)
}

/// Returns false: Landlock exists on Linux only.
#[cfg(not(target_os = "linux"))]
fn deny_files() -> bool {
    false
}

/// Returns the writable memory of this process in bytes, as `RLIMIT_DATA` counts it.
fn written() -> u64 {
    pages(5)
}

/// Returns the resident memory of this process, in bytes.
pub(super) fn resident() -> u64 {
    pages(1)
}

/// Returns a field of `/proc/self/statm`, converted from pages to bytes; zero if there is no such file.
fn pages(field: usize) -> u64 {
    let mut text = [0; SIZES_BYTES];
    let length = SIZES.as_ref().and_then(|sizes| sizes.read_at(&mut text, 0).ok()).unwrap_or(0);
    let sizes = str::from_utf8(&text[..length]).unwrap_or_default();
    let pages: u64 = sizes.split(' ').nth(field).and_then(|pages| pages.parse().ok()).unwrap_or(0);
    pages * page_size() as u64
}
