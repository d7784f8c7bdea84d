//! The limits that a worker sets itself before it takes anything, so that what a specification makes it do ends with it.

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

/// What a worker takes beside a solve: a document and its text, the message in hand, what the allocator holds in reserve.
/// Several times the largest document that is taken by default.
const OWN_BYTES: usize = 64 << 20;

/// Files that a worker may have open: its three streams, and that in which it looks up how large it is.
const OPEN_FILES: u64 = 16;

/// What the kernel, when memory runs out, adds to the size of a worker in parts of a thousand of all memory: it takes
/// workers before anything else.
const OOM_SCORE: &str = "1000";

/// The first version of Landlock that refuses every way to change a file, shortening it by its path among them (Linux 6.2).
#[cfg(target_os = "linux")]
const WHOLE: ABI = ABI::V3;

/// How large this process is, in pages. Open from the start: a worker opens no file later.
static SIZES: LazyLock<Option<File>> = LazyLock::new(|| File::open("/proc/self/statm").ok());

/// More than seven numbers of pages take as text.
const SIZES_BYTES: usize = 256;

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
    /// It may open, make, change and remove no file (Landlock); it has the pipes that it was given.
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
    /// Confines this process to so many bytes for a solve, beside what the program itself takes.
    pub fn impose(memory: usize) -> Self {
        let data = memory.saturating_add(OWN_BYTES).saturating_add(STACK_BYTES) as u64 + written();
        Self {
            data: limit(Resource::Data, data),
            open_files: limit(Resource::Nofile, OPEN_FILES),
            no_core: limit(Resource::Core, 0).is_some(),
            first_to_go: fs::write("/proc/self/oom_score_adj", OOM_SCORE).is_ok(),
            // Last: what stands above opens files.
            no_files: deny_files(),
        }
    }
}

/// Sets a limit for good, or nothing.
fn limit(resource: Resource, value: u64) -> Option<u64> {
    setrlimit(resource, Rlimit { current: Some(value), maximum: Some(value) }).ok().map(|()| value)
}

/// Takes all access to files from this thread and those that it starts, and says whether all of it is taken.
#[cfg(target_os = "linux")]
fn deny_files() -> bool {
    let deny = || -> Result<_, RulesetError> {
        // Later versions have further rights; a kernel that does not know them leaves them out.
        Ruleset::default().handle_access(AccessFs::from_all(ABI::V7))?.create()?.restrict_self()
    };
    let status = deny().map(|status| status.landlock);
    matches!(status, Ok(LandlockStatus::Available { effective_abi, .. }) if effective_abi >= WHOLE)
}

/// There is no Landlock.
#[cfg(not(target_os = "linux"))]
fn deny_files() -> bool {
    false
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
    let mut text = [0; SIZES_BYTES];
    let length = SIZES.as_ref().and_then(|sizes| sizes.read_at(&mut text, 0).ok()).unwrap_or(0);
    let sizes = str::from_utf8(&text[..length]).unwrap_or_default();
    let pages: u64 = sizes.split(' ').nth(field).and_then(|pages| pages.parse().ok()).unwrap_or(0);
    pages * page_size() as u64
}
