//! The unfinished chunks of shared sweeps, as a gateway sees them: those that wait for a worker, and those that a
//! worker has claimed.

use super::parts::{Part, PartId};
use crate::jobs::JobId;
use std::collections::HashMap;

/// The unfinished chunks of shared sweeps, by sweep; the value says whether a worker has claimed the chunk.
#[derive(Debug, Default)]
pub struct OpenParts(HashMap<JobId, HashMap<PartId, bool>>);

impl OpenParts {
    /// Updates the state of a chunk by its new entry; `None` if the entry was deleted.
    pub fn came(&mut self, id: PartId, part: Option<&Part>) {
        match part.filter(|part| part.done.is_none()) {
            Some(part) => {
                self.0.entry(id.sweep).or_default().insert(id, part.claim.is_some());
            }
            None => {
                if let Some(parts) = self.0.get_mut(&id.sweep) {
                    parts.remove(&id);
                }
            }
        }
    }

    /// Removes all chunks of a sweep that has ended or was deleted, and whose chunks get no further entries.
    pub fn end(&mut self, sweep: JobId) {
        self.0.remove(&sweep);
    }

    /// Returns the sweeps with chunks that wait for a worker.
    pub fn sweeps_that_wait(&self) -> impl Iterator<Item = JobId> {
        let waits = |parts: &HashMap<PartId, bool>| parts.values().any(|is_claimed| !is_claimed);
        self.0.iter().filter(move |(_, parts)| waits(parts)).map(|(sweep, _)| *sweep)
    }

    /// Returns the number of chunks of shared sweeps that wait, and the number of those that workers have claimed.
    pub fn count(&self) -> (usize, usize) {
        let parts = || self.0.values().flat_map(HashMap::values);
        let claimed = parts().filter(|is_claimed| **is_claimed).count();
        (parts().count() - claimed, claimed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::chunks::Chunk;
    use crate::jobs::nats::claims::{Decision, Holder, decide_part};
    use crate::jobs::nats::parts::Done;
    use std::time::Duration;

    #[test]
    fn chunks_wait_until_they_are_claimed_and_count_until_they_are_done() {
        let id = |number: u32| PartId { sweep: JobId::of_number(7), attempt: 1, number };
        let waiting = Part::waiting(&Chunk { members: 3..7, lost: None }, None);
        let decided = decide_part(&waiting, "worker", Holder::Unknown, Duration::ZERO);
        let Decision::Take(claimed) = decided else { panic!("{decided:?}") };
        let done = Part { done: Some(Done::Withdrawn), ..(*claimed).clone() };
        let mut parts = OpenParts::default();
        for number in 0..3 {
            parts.came(id(number), Some(&waiting));
        }
        parts.came(id(1), Some(&claimed));
        assert_eq!(parts.count(), (2, 1));
        assert!(parts.sweeps_that_wait().eq([JobId::of_number(7)]));
        parts.came(id(1), Some(&done));
        parts.came(id(2), None);
        assert_eq!(parts.count(), (1, 0));
        parts.came(id(0), Some(&claimed));
        assert_eq!(parts.sweeps_that_wait().count(), 0);
        parts.end(JobId::of_number(7));
        assert_eq!(parts.count(), (0, 0));
    }
}
