//! How jobs come to rest when the service stops.

use super::Jobs;
use super::job::Halt;

impl Jobs {
    /// Stops the intake. Jobs that run or are waited for go on; those that the disk keeps are left to the next process.
    pub fn drain(&self) {
        let mut intake = self.lock();
        intake.draining = true;
        intake.queue.retain(|job| !job.is_lasting());
        self.announce_if_idle(&intake);
    }

    /// Leaves every job that has not ended to the next process, asking those that run to stop. Without a disk, dismisses
    /// them.
    pub async fn park_all(&self) {
        for job in self.store.index().all() {
            // What the disk does not take is dismissed like what has no disk.
            let _ = self.store.outlive(&job).await;
            if !job.is_lasting() {
                let _ = self.cancel(&job).await;
            } else if !job.halt(Halt::Park) {
                self.take_out(&job);
                self.store.park(&job).await;
            }
        }
    }

    /// Returns when all that has happened is on the disk.
    pub async fn flush(&self) {
        self.store.flush().await;
    }

    /// Returns when no job waits or runs.
    pub async fn idle(&self) {
        loop {
            let idle = self.idle.notified();
            if self.lock().is_idle() {
                return;
            }
            idle.await;
        }
    }
}
