//! Recovery of a store that could not be written.

use super::Store;
use crate::jobs::change::Change;
use crate::jobs::ended::Ended;
use crate::jobs::job::Job;
use std::sync::Arc;

impl Store {
    /// Whether the disk, if there is one, accepts changes, and has all ends of durable jobs.
    pub fn is_writable(&self) -> bool {
        !self.disk.as_ref().is_some_and(|disk| disk.has_failed() || !self.unsaved.is_empty())
    }

    /// The number of times the database was rebuilt.
    pub fn rebuilds(&self) -> u64 {
        self.disk.as_ref().map_or(0, |disk| disk.rebuilds())
    }

    /// The number of ended jobs whose ends wait for room on the disk.
    pub fn unsaved(&self) -> usize {
        self.unsaved.len()
    }

    /// If the last change could not be made, tries to write again; if the disk accepts changes, writes the ends kept in
    /// memory. Returns the jobs that are to be solved again.
    pub async fn heal(&self) -> Vec<Arc<Job>> {
        let Some(disk) = &self.disk else { return Vec::new() };
        if disk.has_failed()
            && let Ok(place) = disk.place().await
        {
            // An empty change: its outcome shows in `has_failed`.
            let _ = place.send(Change::default(), drop).written().await;
        }
        if disk.has_failed() {
            return Vec::new();
        }
        for job in self.unsaved.jobs() {
            let ended = job.lock().ended().map(|ended| Ended::clone(ended));
            if let Some(ended) = ended {
                self.conclude_on_disk(disk, &job, ended).await;
            }
        }
        self.unsaved.take_again()
    }
}
