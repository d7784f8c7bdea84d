//! The supervision of one worker process: it is started, performs tasks, and is replaced when it has died or has
//! grown.

use super::launcher::Launcher;
use super::link::{Finished, Link, Task};
use super::{Confinement, Death};
use std::future::pending;
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// A callback for the events in the lives of worker processes, such as a start or a death.
pub type Notice = Arc<dyn Fn(Event<'_>) + Send + Sync>;

/// An event in the life of a worker process.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// The worker is ready for orders: its process id and start-up time.
    Started(u32, Duration),
    /// The worker was replaced because it held this many bytes of memory.
    Grown(u64),
    /// The worker with this process id was replaced after a long task, because its priority had been lowered.
    Lowered(u32),
    /// The worker with this process id was killed because it did not stop a task whose results are unwanted.
    Unwanted(u32),
    /// The worker with this process id died of this cause.
    Died(u32, &'a Death),
    /// The worker process could not be started.
    NotStarted(&'a io::Error),
}

/// The reason why a worker gave no answer to an order: its death, before or after it received the specification.
#[derive(Debug)]
pub enum Loss {
    /// The worker died before it had received the specification.
    NotTaken(Death),
    /// The worker died after it had received the specification.
    Died(Death),
}

/// The largest number of workers in a row that may die before they have received a given specification, which then is
/// not the cause of their death; the attempts must end all the same.
const MOST_NOT_TAKEN: u32 = 5;

/// The first and the longest pause between two attempts to start a worker.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(10);

/// A supervisor of one worker at a time, which replaces the worker if necessary.
pub struct Supervisor {
    launcher: Launcher,
    link: Option<Link>,
    /// The memory in bytes that a worker may hold between tasks; a worker that holds more is replaced.
    keep: u64,
    notice: Notice,
}

impl Supervisor {
    /// Creates a supervisor without a worker. A worker that holds more than `keep` bytes between tasks is replaced.
    pub fn new(launcher: Launcher, keep: u64, notice: Notice) -> Self {
        Self { launcher, link: None, keep, notice }
    }

    /// Starts a worker, and returns the limits in force on it.
    ///
    /// # Errors
    /// The worker cannot be started.
    pub async fn start(&mut self) -> io::Result<Confinement> {
        let begun = Instant::now();
        let link = Link::open((self.launcher)()?, begun).await?;
        (self.notice)(Event::Started(link.id, link.started_in));
        let confinement = link.confinement.clone();
        self.link = Some(link);
        Ok(confinement)
    }

    /// Starts a worker, if there is none, with further attempts until one succeeds.
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

    /// Waits until the process of the idle worker ends; without a worker, waits for ever.
    pub async fn idle(&mut self) {
        let Some(link) = &mut self.link else { return pending().await };
        link.closed().await;
        let death = link.death().await;
        self.lost(&death);
    }

    /// Has a worker perform a task, starting the worker if necessary.
    ///
    /// # Errors
    /// The cause of death of the worker that had the task.
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
