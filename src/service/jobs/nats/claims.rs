//! What a worker does with the message of a job, by the entry of the job and what has become of the worker that has
//! claimed it.
//!
//! JetStream gives a message again if it hears nothing of it for a while. The worker that had it may be lost; or it may be
//! cut off from the servers, or just slow, and still have the job. Only a worker that is lost is evidence against the job,
//! and only if the job ran alone on it: a job is set aside when it has taken [`MOST_LOST`] workers down so. A job that has
//! lost a worker runs alone from then on (for the first while: see `Jobs::apart`), so that a first loss says nothing yet.

use super::entry::{Claim, Entry};
use crate::jobs::{Ended, Ending, Fault};
use jiff::Timestamp;
use std::time::Duration;

/// The number of workers that a job may take down while it runs alone.
const MOST_LOST: u32 = 2;

/// What has become of a worker that has claimed a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holder {
    /// It says that it has the job.
    HasIt,
    /// It says that it does not have the job any more.
    LeftIt,
    /// It is not connected to the servers.
    Lost,
    /// It may be any of these.
    Unknown,
}

/// What to do with a message.
#[derive(Debug)]
pub enum Decision {
    /// Acknowledge it: the job has ended.
    Drop,
    /// Leave the job for so long.
    Wait(Duration),
    /// The job is over; the entry says how.
    End(Box<Entry>),
    /// Solve the job; the entry has the claim.
    Take(Box<Entry>),
}

/// Decides for the worker `name`, which hears nothing of lost workers for `lost_after`.
pub fn decide(entry: &Entry, name: &str, holder: Holder, lost_after: Duration) -> Decision {
    let mut entry = entry.clone();
    if entry.record.ended.is_some() {
        return Decision::Drop;
    }
    if let Some(claim) = entry.claim.take() {
        match holder {
            Holder::HasIt | Holder::Unknown => return Decision::Wait(lost_after),
            Holder::LeftIt => {}
            Holder::Lost => {
                entry.record.crashes += 1;
                entry.record.crashes_alone += u32::from(claim.alone);
            }
        }
    }
    let ending = if entry.record.crashes_alone >= MOST_LOST {
        Ending::Broken(Fault::Poisoned)
    } else if entry.record.dismissed && entry.record.sweep().is_none() {
        Ending::Dismissed
    } else {
        let alone = entry.record.crashes > 0;
        entry.claim = Some(Claim { worker: name.to_owned(), started: Timestamp::now(), alone });
        return Decision::Take(Box::new(entry));
    };
    entry.record.ended = Some(Ended::unsolved(ending));
    Decision::End(Box::new(entry))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digest::Fingerprint;
    use crate::jobs::{Held, Record};

    const LONG: Duration = Duration::from_secs(30);

    fn waiting() -> Entry {
        Entry::waiting(Record { ended: None, ..Record::example(Held::Table(Fingerprint::of(b""))) })
    }

    /// The entry after a worker has taken the job and become `holder`, and the next has decided.
    fn again(entry: &Entry, holder: Holder) -> Decision {
        let Decision::Take(taken) = decide(entry, "first", Holder::Unknown, LONG) else { panic!("not taken") };
        assert_eq!(taken.claim.as_ref().unwrap().worker, "first");
        decide(&taken, "second", holder, LONG)
    }

    #[test]
    fn a_job_that_another_worker_has_is_left_to_it() {
        for holder in [Holder::HasIt, Holder::Unknown] {
            assert!(matches!(again(&waiting(), holder), Decision::Wait(LONG)));
        }
    }

    #[test]
    fn a_job_whose_worker_left_it_in_order_begins_again_as_if_it_had_not_begun() {
        let Decision::Take(entry) = again(&waiting(), Holder::LeftIt) else { panic!("not taken") };
        assert_eq!((entry.record.crashes, entry.record.crashes_alone), (0, 0));
    }

    #[test]
    fn a_job_is_set_aside_after_two_workers_lost_while_it_ran_alone() {
        let (mut entry, mut lost) = (waiting(), 0);
        loop {
            lost += 1;
            match again(&entry, Holder::Lost) {
                Decision::Take(next) => entry = Entry { claim: None, ..*next },
                Decision::End(end) => {
                    assert_eq!(end.record.ended.unwrap().ending, Ending::Broken(Fault::Poisoned));
                    break;
                }
                other => panic!("{other:?}"),
            }
        }
        // The first was lost before it was known that the job had better run alone.
        assert_eq!(lost, 3);
    }

    #[test]
    fn a_job_cancelled_while_its_worker_was_lost_ends() {
        let mut entry = waiting();
        entry.record.dismissed = true;
        let Decision::End(end) = decide(&entry, "second", Holder::Lost, LONG) else { panic!("not ended") };
        assert_eq!(end.record.ended.as_ref().unwrap().ending, Ending::Dismissed);
        assert!(matches!(decide(&end, "third", Holder::Unknown, LONG), Decision::Drop));
    }
}
