//! Recovery of a job store that could not be written, for instance on a full disk.

use super::Store;
use crate::jobs::change::Change;
use crate::jobs::ended::Ended;
use crate::jobs::job::Job;
use std::sync::Arc;

impl Store {
    /// Whether the disk, if there is one, accepts changes, and has the ends of all durable jobs.
    pub fn is_writable(&self) -> bool {
        !self.disk.as_ref().is_some_and(|disk| disk.has_failed() || !self.unsaved.is_empty())
    }

    /// Returns the number of times that the database of jobs was rebuilt.
    pub fn rebuilds(&self) -> u64 {
        self.disk.as_ref().map_or(0, |disk| disk.rebuilds())
    }

    /// Returns the number of ended jobs whose ends wait for space on the disk.
    pub fn unsaved(&self) -> usize {
        self.unsaved.len()
    }

    /// If the last change to the database could not be made, tries to write again; if the disk accepts changes, writes
    /// the ends of jobs that are only in memory. Returns the jobs that are to be solved again.
    pub async fn heal(&self) -> Vec<Arc<Job>> {
        let Some(disk) = &self.disk else { return Vec::new() };
        if disk.has_failed()
            && let Ok(place) = disk.place().await
        {
            // The change is empty, and is made only to see whether the disk accepts it, which `has_failed` then
            // shows.
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
