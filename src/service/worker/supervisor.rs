//! Keeps one worker: starts it, has it solve, and starts another when it is lost or has grown.

use super::launcher::Launcher;
use super::link::{Finished, Link, Task};
use super::{Confinement, Death};
use std::future::pending;
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// Called with what becomes of workers.
pub type Notice = Arc<dyn Fn(Event<'_>) + Send + Sync>;

/// What becomes of a worker.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// It takes orders, after this time.
    Started(u32, Duration),
    /// It was replaced because it held so many bytes.
    Grown(u64),
    /// It was replaced because others go before it since it has had a long task.
    Lowered(u32),
    /// It was replaced because it did not stop what nobody wants any more.
    Unwanted(u32),
    /// It died.
    Died(u32, &'a Death),
    /// None could be started.
    NotStarted(&'a io::Error),
}

/// Why there is no answer from a worker.
#[derive(Debug)]
pub enum Loss {
    /// It died before it had the document.
    NotTaken(Death),
    /// It died while it had the document.
    Died(Death),
}

/// Workers that die in a row before they take a document that was for them. It is none of the document's doing, but
/// there may be no end to it.
const MOST_NOT_TAKEN: u32 = 5;

/// The pauses between attempts to start a worker, from the first to the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(10);

/// One place for a worker.
pub struct Supervisor {
    launcher: Launcher,
    link: Option<Link>,
    /// The bytes that a worker may hold between tasks.
    keep: u64,
    notice: Notice,
}

impl Supervisor {
    /// No worker yet. One that holds more than `keep` bytes between tasks is replaced.
    pub fn new(launcher: Launcher, keep: u64, notice: Notice) -> Self {
        Self { launcher, link: None, keep, notice }
    }

    /// Starts a worker, and gives the limits that hold for it.
    ///
    /// # Errors
    /// It cannot be started.
    pub async fn start(&mut self) -> io::Result<Confinement> {
        let begun = Instant::now();
        let link = Link::open((self.launcher)()?, begun).await?;
        (self.notice)(Event::Started(link.id, link.started_in));
        let confinement = link.confinement.clone();
        self.link = Some(link);
        Ok(confinement)
    }

    /// Returns when there is a worker.
    pub async fn ready(&mut self) {
        let mut pause = FIRST_PAUSE;
        while self.link.is_none() {
            if let Err(error) = self.start().await {
                (self.notice)(Event::NotStarted(&error));
                sleep(pause).await;
                pause = (2 * pause).min(LONGEST_PAUSE);
            }
        }
    }

    /// Returns when the worker, which has nothing to do, is gone.
    pub async fn idle(&mut self) {
        let Some(link) = &mut self.link else { return pending().await };
        link.closed().await;
        let death = link.death().await;
        self.lost(&death);
    }

    /// Has a task done.
    ///
    /// # Errors
    /// Why the worker that had it died.
    pub async fn perform(&mut self, task: &mut Task<'_>) -> Result<Finished, Death> {
        let mut attempts = 0;
        loop {
            self.ready().await;
            let Some(link) = &mut self.link else { continue };
            match link.perform(task).await {
                Ok(finished) => {
                    let resident = link.resident;
                    if link.is_lowered {
                        (self.notice)(Event::Lowered(link.id));
                        self.link = None;
                    } else if resident > self.keep {
                        (self.notice)(Event::Grown(resident));
                        self.link = None;
                    }
                    return Ok(finished);
                }
                Err(Loss::NotTaken(death)) if attempts < MOST_NOT_TAKEN => {
                    attempts += 1;
                    self.lost(&death);
                }
                Err(Loss::NotTaken(death) | Loss::Died(death)) => {
                    if death == Death::Overran && (task.watch.is_unwanted)() {
                        (self.notice)(Event::Unwanted(link.id));
                        self.link = None;
                    }
                    self.lost(&death);
                    return Err(death);
                }
            }
        }
    }

    fn lost(&mut self, death: &Death) {
        if let Some(link) = self.link.take() {
            (self.notice)(Event::Died(link.id, death));
        }
    }
}
