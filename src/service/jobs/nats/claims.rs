//! The decision of a worker about the NATS message of a job, by the stored entry of the job and the state of the
//! worker that has claimed it.
//!
//! JetStream delivers a message again if it hears nothing of it for a while. The worker that got it first may be
//! lost; or it may be cut off from the servers, or slow, and still be solving the job. Only the loss of a worker is
//! evidence against the job, and only if the job ran alone on it: a job is set aside when it has made [`MOST_LOST`]
//! workers die in that way. A job that has lost a worker runs alone from then on (at first: see `Jobs::apart`), so
//! that a first loss is no evidence.

use super::entry::{Claim, Entry};
use super::parts::{Done, Part};
use crate::jobs::{Ended, Ending, Fault, Record};
use jiff::Timestamp;
use std::time::Duration;

/// The number of workers lost while a job ran alone on them, at which the job is set aside.
const MOST_LOST: u32 = 2;

/// The state of the worker that has claimed a job, as far as another worker can find out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holder {
    /// The worker answers that it is solving the job.
    HasIt,
    /// The worker answers that it is not solving the job any more.
    LeftIt,
    /// The worker is not connected to the NATS servers.
    Lost,
    /// The state of the worker is unknown: it has not answered, or has not been asked.
    Unknown,
}

/// The decision of a worker about the message of a job or chunk, by its entry `E` in the bucket of states.
#[derive(Debug)]
pub enum Decision<E> {
    /// Acknowledge the message: the job has ended.
    Drop,
    /// Leave the job to the worker that has claimed it, and decide again about the message after this time.
    Wait(Duration),
    /// End the job without a solve; the new entry of the job says how it ended.
    End(Box<E>),
    /// Solve the job; the new entry of the job contains the claim of this worker.
    Take(Box<E>),
}

/// Decides about the message of a job, for the worker `name`. A lost worker is noticed after `lost_after`.
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

/// Decides about the message of a chunk of a sweep, as [`decide`] does for a job.
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

/// Whether a job or chunk is left to the worker that has claimed it; if that worker is lost, counts the loss.
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

    /// Returns the decision of a second worker, after a first one has claimed the job and got the state `holder`.
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
        // The first worker did not run the job alone, so that its loss is no evidence against the job.
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
