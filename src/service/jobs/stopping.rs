//! The stop of the service: it admits no more jobs, and leaves unfinished ones to the next process.

use super::Jobs;
use super::job::Halt;

impl Jobs {
    /// Stops admitting jobs. Running jobs and jobs that clients wait for continue; waiting durable jobs are left to
    /// the next process.
    pub fn drain(&self) {
        let mut intake = self.lock();
        intake.draining = true;
        if self.far.is_some() {
            return;
        }
        intake.queue.retain(|job| !job.is_durable());
        self.announce_if_idle(&intake);
    }

    /// Leaves every unfinished job to the next process, asking running jobs to stop. A job that cannot be stored on a
    /// disk is dismissed.
    pub async fn park_all(&self) {
        if self.far.is_some() {
            return self.leave_far();
        }
        for job in self.store.index().all() {
            // A job that the disk refuses is dismissed below, like a job of a service without a disk.
            let _ = self.store.outlive(&job).await;
            if !job.is_durable() {
                let _ = self.cancel(&job).await;
            } else if !job.halt(Halt::Park) {
                self.take_out(&job);
                self.store.park(&job).await;
            } else {
                self.stop_chunks(&job, Halt::Park).await;
            }
        }
    }

    /// Waits until all pending writes of the job store are on the disk.
    pub async fn flush(&self) {
        self.store.flush().await;
    }

    /// Waits until no job is waiting or running.
    pub async fn idle(&self) {
        loop {
            let idle = self.idle.notified();
            // Jobs that are shared with other machines continue without this process.
            if self.far.is_some() || self.lock().is_idle() {
                return;
            }
            idle.await;
        }
    }
}
