//! The evidence that the death of a service process gives against the jobs that ran in it: the next process starts
//! them again, unless they seem to have caused the death.

use super::Record;
use super::ended::{Ended, Ending, Fault};

/// The number of deaths of the service process by lack of memory, with the job running alone, after which the job is
/// not started again. If other jobs ran as well, any of them may have used up the memory.
const MOST_SHORTAGES: u32 = 2;

/// The number of deaths of the service process for any reason, with the job running alone, after which the job is not
/// started again. A kill from outside or a power failure is no evidence against the job, but the number of attempts
/// must be bounded: a job that is running in two of five kills, as a short job is if the service is killed every 50
/// ms, is running in 16 successive kills with a probability of one in two million.
pub const MOST_KILLS: u32 = 16;

/// Updates the record of a job after the death of the service process. The job was `running` or not, alone if
/// `is_alone`, and the system was out of memory if `was_short`. Returns whether the record has changed.
pub fn recover(record: &mut Record, running: bool, is_alone: bool, was_short: bool) -> bool {
    if record.ended.is_some() {
        return false;
    }
    let crashed = running || record.underway;
    record.underway = false;
    record.crashes += u32::from(crashed);
    record.crashes_alone += u32::from(crashed && is_alone);
    record.shortages_alone += u32::from(crashed && is_alone && was_short);
    // A sweep that was dismissed is resumed, to end with the rows that it has.
    if record.dismissed && record.sweep().is_none() {
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
