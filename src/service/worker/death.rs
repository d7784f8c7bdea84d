//! The cause of death of a worker process, found from its exit status and its last output on standard error.

use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

/// The cause of death of a worker process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Death {
    /// A memory allocation of the worker failed; its size in bytes, if it was reported.
    TooMuchMemory(Option<u64>),
    /// The stack of the worker process overflowed.
    StackOverflow,
    /// The worker was killed by this signal: by another process, or by the kernel for lack of memory.
    Killed(i32),
    /// The worker did not stop at its deadline or when cancelled, and was killed.
    Overran,
    /// The worker panicked, or violated the message protocol.
    Defect(String),
}

impl Death {
    /// Finds the cause of death from the exit status of the worker and its last output on standard error.
    pub fn of(status: ExitStatus, last_words: &str) -> Self {
        // The text is that of the message that the Rust standard library writes before it aborts.
        if let Some((_, after)) = last_words.rsplit_once("memory allocation of ") {
            return Self::TooMuchMemory(after.split(' ').next().and_then(|bytes| bytes.parse().ok()));
        }
        if last_words.contains("has overflowed its stack") {
            return Self::StackOverflow;
        }
        match status.signal() {
            Some(signal @ (KILL | TERM | INT | HUP)) => Self::Killed(signal),
            _ => Self::Defect(format!("{status}: {}", last_words.trim())),
        }
    }

    /// Returns the code of the cause of death of the worker, for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::TooMuchMemory(_) => "too_much_memory",
            Self::StackOverflow => "stack_overflow",
            Self::Killed(_) => "killed",
            Self::Overran => "overran",
            Self::Defect(_) => "defect",
        }
    }
}

/// The signals that other processes send. Signals that a process causes itself count as defects.
const HUP: i32 = 1;
const INT: i32 = 2;
const KILL: i32 = 9;
const TERM: i32 = 15;

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_death(raw: i32, last_words: &str, death: &Death) {
        assert_eq!(&Death::of(ExitStatus::from_raw(raw), last_words), death);
    }

    #[test]
    fn last_words_tell_apart_what_the_signal_does_not() {
        const ABORT: i32 = 6;
        let refused = "memory allocation of 5626368000 bytes failed\n";
        assert_death(ABORT, refused, &Death::TooMuchMemory(Some(5_626_368_000)));
        let overflowed = "\nthread 'dvi-solver' (7) has overflowed its stack\nfatal runtime error: stack overflow\n";
        assert_death(ABORT, overflowed, &Death::StackOverflow);
        assert_death(KILL, "", &Death::Killed(9));
        assert_death(TERM, "", &Death::Killed(15));
        assert_eq!(Death::of(ExitStatus::from_raw(ABORT), "thread panicked").code(), "defect");
        assert_eq!(Death::of(ExitStatus::from_raw(101 << 8), "").code(), "defect");
    }
}
