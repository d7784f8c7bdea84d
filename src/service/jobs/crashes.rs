//! What the end of a process says against the jobs that ran in it: they start again with the next, unless they seem to be what
//! ended it.

use super::Record;
use super::ended::{Ended, Ending, Fault};

/// A job that was the only one running this often when its process ended, and the system had run out of memory, is not started
/// again: beside others, any of them may have taken it.
const MOST_SHORTAGES: u32 = 2;

/// The same where nothing says that it had: who ends a process from outside, by a signal or the power, says nothing of the
/// job that runs. One that is met by two kills of five, as short jobs are where a service is killed every 50 ms, is met by
/// so many in a row once in two million times.
pub const MOST_KILLS: u32 = 16;

/// Brings a row up to date after the end of its process, in which the job was `running` or not, no other if it `is_alone`, and
/// memory `was_short` or not; says whether it has changed.
pub fn recover(record: &mut Record, running: bool, is_alone: bool, was_short: bool) -> bool {
    if record.ended.is_some() {
        return false;
    }
    let crashed = running || record.underway;
    record.underway = false;
    record.crashes += u32::from(crashed);
    record.crashes_alone += u32::from(crashed && is_alone);
    record.shortages_alone += u32::from(crashed && is_alone && was_short);
    if record.dismissed {
        record.ended = Some(Ended::unsolved(Ending::Dismissed));
    } else if record.shortages_alone >= MOST_SHORTAGES || record.crashes_alone >= MOST_KILLS {
        record.ended = Some(Ended::unsolved(Ending::Broken(Fault::Poisoned)));
    }
    crashed || record.ended.is_some()
}

#[cfg(test)]
mod tests {
    use super::super::Held;
    use super::*;
    use crate::digest::Fingerprint;

    #[test]
    fn kills_say_less_against_a_job_than_want_of_memory() {
        let crashes_until_aside = |is_alone: bool, was_short: bool| {
            let mut record = Record { ended: None, ..Record::example(Held::Table(Fingerprint::of(b""))) };
            (1..100).find(|_| recover(&mut record, true, is_alone, was_short) && record.ended.is_some())
        };
        assert_eq!(crashes_until_aside(true, true), Some(2));
        assert_eq!(crashes_until_aside(true, false), Some(16));
        assert_eq!(crashes_until_aside(false, true), None);
    }
}
