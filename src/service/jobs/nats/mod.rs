//! Jobs shared by several machines: gateways and workers exchange them over NATS JetStream, while a service on one
//! machine has a queue in memory and a data folder.
//!
//! ```text
//! stream  NAME_jobs     NAME.jobs.CLIENT.JOB   a message per job that no worker has ended, with its entry (`errand`);
//!                                              work-queue retention
//!                       NAME.jobs.CLIENT.PART  a message per chunk of a sweep that workers share
//! bucket  NAME_state    job.JOB                its entry: the row of the job, the claim of the worker that has it, and
//!                                              its specification and its results if they are short
//!                       part.JOB.NUMBER        the entry of a chunk: its members, its claim, and what became of it
//!                       key.CLIENT.DIGEST      the job of an idempotency key
//!                       client.CLIENT          a client whose subject has a consumer
//!                       cancel.JOB             a running job that is to stop
//!                       progress.JOB           the progress and the latest switches of a long solve
//! bucket  NAME_data     document.JOB           the specification, if it is longer
//!                       results.JOB.ATTEMPT    the results, if they are longer
//!                       rows.JOB.NUMBER.ATTEMPT  the rows of a chunk
//! objects NAME_objects                         those that are longer than a message may be
//! core    NAME.progress.JOB                    progress and switches, as they come
//!         NAME.arrival.CLIENT                  announces a job to one of the workers that have nothing to do
//!         NAME.lines.all                       asks a gateway which clients have jobs that wait
//!         NAME.ended.JOB                       the entry of a job that has just ended, for who waits for it
//!         NAME.worker.WORKER                   asks a worker whether it still has a job
//! ```
//!
//! 1. A gateway writes the specification and the entry of a job, and then its message, which puts it into the queue;
//!    then it responds 202. A gateway has all entries in memory, as a mirror of the bucket, so that requests for jobs
//!    are answered without NATS (see `mirror`); everything in the mirror is also on the servers.
//! 2. A worker takes a message of the next client in turn (`lines`; announcements report messages to idle workers,
//!    see `announcements`), and claims the job by a compare-and-set of the entry. As long as it solves the job it
//!    sends signs of life to JetStream, which otherwise gives the message to another worker (`worker`). A small job
//!    is solved instead of claimed, and its end is then the only change of its entry.
//! 3. The results are completely written before the entry says that the job has ended, or are stored in the entry, by
//!    a compare-and-set that fails if another worker has claimed the job meanwhile. The message is acknowledged last.
//!    So a message that is delivered twice, at whatever moment its worker died, does no harm: its job has ended, or
//!    begins again.
//! 4. The worker that has claimed a sweep divides it, and makes its table in the end; the chunks are solved by the
//!    workers that take their messages (`sweeps`, `parts`).

mod announcements;
mod claims;
mod entry;
mod errand;
mod following;
mod gateway;
mod hearing;
mod lines;
mod mirror;
mod open_parts;
mod options;
mod parts;
mod servers;
mod sweeps;
mod texts;
mod work_options;
mod worker;

pub use gateway::{Far, Gateway};
pub use options::Nats;
pub use servers::Away;
pub use work_options::WorkOptions;
pub use worker::work;
