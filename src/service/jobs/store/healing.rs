//! A store that could not be written, and is well again.

use super::Store;
use crate::jobs::change::Change;
use crate::jobs::ended::Ended;
use crate::jobs::job::Job;
use std::sync::Arc;

impl Store {
    /// Whether the disk, if there is one, takes changes, and has all that it is to have.
    pub fn is_writable(&self) -> bool {
        !self.disk.as_ref().is_some_and(|disk| disk.has_failed() || !self.unsaved.is_empty())
    }

    /// How often the database was built anew.
    pub fn rebuilds(&self) -> u64 {
        self.disk.as_ref().map_or(0, |disk| disk.rebuilds())
    }

    /// How many ends of jobs wait for room on the disk.
    pub fn unsaved(&self) -> usize {
        self.unsaved.len()
    }

    /// Tries to write again where the last change could not be made, and what could not be written where it could. Gives
    /// the jobs that are to be solved again.
    pub async fn heal(&self) -> Vec<Arc<Job>> {
        let Some(disk) = &self.disk else { return Vec::new() };
        if disk.has_failed()
            && let Ok(place) = disk.place().await
        {
            // What comes of it shows.
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
