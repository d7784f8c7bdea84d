//! What a worker receives over NATS beside its jobs: new clients, jobs that are to stop, and questions of other
//! workers.

use super::claims::Holder;
use super::parts::Work;
use super::worker::{PAUSE, Worker};
use crate::jobs::{Job, JobId};
use async_nats::client::RequestErrorKind;
use futures_util::StreamExt;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

/// The time limit for another worker to answer whether it is solving a job.
const ANSWER: Duration = Duration::from_secs(2);

impl Worker {
    /// Starts the tasks by which the worker receives new clients, requests to stop jobs and questions of other
    /// workers; dropping the returned set ends the tasks.
    pub fn start_tasks(self: &Arc<Self>) -> JoinSet<()> {
        let [clients, cancels, questions] = [0; 3].map(|_| Arc::clone(self));
        let mut tasks = JoinSet::new();
        tasks.spawn(async move {
            let came = |key: &str, _: Option<&[u8]>| clients.lines.add(last(key));
            clients.exchange.follow("client.*", came).await;
        });
        tasks.spawn(async move {
            let came = |key: &str, is: Option<&[u8]>| cancels.cancel(last(key), is.is_some());
            cancels.exchange.follow("cancel.*", came).await;
        });
        tasks.spawn(async move { questions.answer().await });
        tasks
    }

    /// Answers the questions of other workers whether this worker is solving a job or chunk.
    async fn answer(&self) {
        loop {
            let mut questions = self.exchange.hear("worker", &self.name).await;
            while let Some(question) = questions.next().await {
                let work = str::from_utf8(&question.payload).ok().and_then(|work| work.parse::<Work>().ok());
                let has_it = work.is_some_and(|work| self.mine().contains_key(&work));
                if let Some(reply) = question.reply {
                    let _ = self.exchange.client.publish(reply, if has_it { "yes" } else { "no" }.into()).await;
                }
            }
            sleep(PAUSE).await;
        }
    }

    /// Asks the worker `holder`, which has claimed a job or chunk, whether it is still solving it.
    pub async fn ask(&self, holder: &str, work: Work, lost_after: Duration) -> Holder {
        let question = self.exchange.client.request(self.exchange.subject("worker", holder), work.to_string().into());
        match timeout(ANSWER, question).await {
            Ok(Ok(answer)) if &*answer.payload == b"yes" => Holder::HasIt,
            Ok(Ok(_)) => Holder::LeftIt,
            // The worker that was asked is not connected. It counts as lost only if this worker has been connected
            // for a while, since after an outage both have to reconnect.
            Ok(Err(error))
                if error.kind() == RequestErrorKind::NoResponders && self.exchange.connected_for() > lost_after =>
            {
                Holder::Lost
            }
            Ok(Err(_)) | Err(_) => Holder::Unknown,
        }
    }

    /// If `is` is true, records the request of a client to stop the job `key`, and stops the job; otherwise forgets the
    /// request, since the job has ended.
    fn cancel(&self, key: &str, is: bool) {
        let Ok(id) = key.parse::<JobId>() else { return };
        if !is {
            self.cancelled().remove(&id);
            return;
        }
        self.cancelled().insert(id);
        let of_job = |(work, job): (&Work, &Option<Arc<Job>>)| job.clone().filter(|_| work.job() == id);
        let jobs: Vec<_> = self.mine().iter().filter_map(of_job).collect();
        for job in jobs {
            let jobs = Arc::clone(&self.jobs);
            tokio::spawn(async move { jobs.cancel(&job).await });
        }
    }
}

/// Returns the last token of a NATS subject, or of a key of the bucket of states.
fn last(key: &str) -> &str {
    key.rsplit_once('.').map_or(key, |(_, last)| last)
}
