//! What a worker does with the message of a job, by the entry of the job and what has become of the worker that has
//! claimed it.
//!
//! JetStream gives a message again if it hears nothing of it for a while. The worker that had it may be lost; or it may be
//! cut off from the servers, or just slow, and still have the job. Only a worker that is lost is evidence against the job,
//! and only if the job ran alone on it: a job is set aside when it has taken [`MOST_LOST`] workers down so. A job that has
//! lost a worker runs alone from then on (for the first while: see `Jobs::apart`), so that a first loss says nothing yet.

use super::entry::{Claim, Entry};
use super::parts::{Done, Part};
use crate::jobs::{Ended, Ending, Fault, Record};
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

/// What to do with a message, by the entry `E` of its job or chunk.
#[derive(Debug)]
pub enum Decision<E> {
    /// Acknowledge it: the job has ended.
    Drop,
    /// Leave the job for so long.
    Wait(Duration),
    /// The job is over; the entry says how.
    End(Box<E>),
    /// Solve the job; the entry has the claim.
    Take(Box<E>),
}

/// Decides for the worker `name`, which hears nothing of lost workers for `lost_after`.
pub fn decide(entry: &Entry, name: &str, holder: Holder, lost_after: Duration) -> Decision<Entry> {
    let mut entry = entry.clone();
    if entry.record.ended.is_some() {
        return Decision::Drop;
    }
    let Record { crashes, crashes_alone, .. } = &mut entry.record;
    if is_left_to_holder(entry.claim.take(), holder, crashes, crashes_alone) {
        return Decision::Wait(lost_after);
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

/// Decides likewise for a chunk of a sweep, which is set aside as a job is.
pub fn decide_part(part: &Part, name: &str, holder: Holder, lost_after: Duration) -> Decision<Part> {
    let mut part = part.clone();
    if part.done.is_some() {
        return Decision::Drop;
    }
    if is_left_to_holder(part.claim.take(), holder, &mut part.crashes, &mut part.crashes_alone) {
        return Decision::Wait(lost_after);
    }
    if part.crashes_alone >= MOST_LOST {
        part.done = Some(Done::Poisoned);
        return Decision::End(Box::new(part));
    }
    let alone = part.crashes > 0;
    part.claim = Some(Claim { worker: name.to_owned(), started: Timestamp::now(), alone });
    Decision::Take(Box::new(part))
}

/// Whether what a worker has claimed is left to it; otherwise, its loss is counted.
fn is_left_to_holder(claim: Option<Claim>, holder: Holder, crashes: &mut u32, crashes_alone: &mut u32) -> bool {
    let Some(claim) = claim else { return false };
    match holder {
        Holder::HasIt | Holder::Unknown => return true,
        Holder::LeftIt => {}
        Holder::Lost => {
            *crashes += 1;
            *crashes_alone += u32::from(claim.alone);
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digest::Fingerprint;
    use crate::jobs::Held;
    use crate::jobs::chunks::Chunk;

    const LONG: Duration = Duration::from_secs(30);

    fn waiting() -> Entry {
        Entry::waiting(Record { ended: None, ..Record::example(Held::Table(Fingerprint::of(b""))) })
    }

    /// The entry after a worker has taken the job and become `holder`, and the next has decided.
    fn again(entry: &Entry, holder: Holder) -> Decision<Entry> {
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
    fn a_chunk_is_set_aside_as_a_job_is() {
        let mut part = Part::waiting(&Chunk { members: 3..7, lost: None }, None);
        for lost in 0..3 {
            let Decision::Take(taken) = decide_part(&part, "first", Holder::Lost, LONG) else { panic!("{lost}") };
            assert!(matches!(decide_part(&taken, "second", Holder::HasIt, LONG), Decision::Wait(LONG)));
            part = *taken;
        }
        let Decision::End(end) = decide_part(&part, "fourth", Holder::Lost, LONG) else { panic!("not set aside") };
        assert!(matches!(end.done, Some(Done::Poisoned)) && end.crashes == 3);
        assert!(matches!(decide_part(&end, "fifth", Holder::Unknown, LONG), Decision::Drop));
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
