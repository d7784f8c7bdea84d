//! The status of a job in responses: the `statusInfo` of OGC API - Processes, part 1.

use super::problem::Problem;
use crate::context::address;
use crate::jobs::{Ended, Ending, Fault, Job, Jobs, State};
use jiff::Timestamp;
use serde::Serialize;
use solution::Verdict;
use specification::Time;
use utoipa::ToSchema;

/// The status of a job, as responses report it.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct StatusInfo {
    /// The id of the job.
    id: String,
    /// `accepted`, `running`, `successful` (the end time was reached), `failed` or `dismissed`.
    status: &'static str,
    /// Whether the solution can be trusted; absent until there is a solution.
    #[serde(skip_serializing_if = "Option::is_none")]
    trusted: Option<bool>,
    /// Why the solution is not trusted, and further remarks on it; absent until there is a solution.
    #[serde(skip_serializing_if = "Option::is_none")]
    verdict: Option<Verdict>,
    /// Why the job did not reach its end time.
    #[serde(skip_serializing_if = "Option::is_none")]
    message: Option<String>,
    /// The label of the job's specification.
    #[serde(skip_serializing_if = "Option::is_none")]
    label: Option<String>,
    /// The part of the time horizon that has been integrated, in per cent.
    #[schema(maximum = 100)]
    progress: u8,
    /// The number of finished members, if the job is a sweep.
    #[serde(skip_serializing_if = "Option::is_none")]
    members: Option<MembersDone>,
    /// The number of jobs that will be started before this one.
    #[serde(skip_serializing_if = "Option::is_none")]
    queue_position: Option<usize>,
    /// The number of the attempt to run the job, from one: a job is started again if its process ended while it ran.
    attempt: u32,
    /// The time that the solve has reached in the problem.
    time: f64,
    /// The number of accepted steps of the method.
    steps: u64,
    /// The time at which the job was accepted.
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// The time at which a worker started the job.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    started: Option<Timestamp>,
    /// The time at which the job ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    finished: Option<Timestamp>,
    /// Links to the resources of the job and to what can be done with it.
    links: Vec<Link>,
}

/// The progress of a sweep.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
struct MembersDone {
    /// The number of members that have a row in the table.
    done: usize,
    /// The number of all members of the sweep.
    of: usize,
}

#[derive(Debug, PartialEq, Serialize, ToSchema)]
struct Link {
    /// The URL of the linked resource.
    href: String,
    /// The relation of the linked resource to the job.
    rel: &'static str,
    /// A description of the relation in a few words.
    title: &'static str,
}

impl StatusInfo {
    /// Returns the status as one word, such as `accepted`.
    pub fn status(&self) -> &'static str {
        self.status
    }

    /// Returns the current status of `job`.
    pub fn of(job: &Job, jobs: &Jobs) -> Self {
        let state = job.state();
        let (status, message) = match &state {
            State::Accepted(_) => ("accepted", None),
            State::Running { .. } => ("running", None),
            State::Ended(ended) => outcome(ended),
        };
        let verdict = match &state {
            State::Accepted(_) | State::Running { .. } => None,
            // Results that were found damaged on the disk are not served, and neither is the verdict on them.
            State::Ended(ended) => ended.verdict.clone().filter(|_| !ended.damaged),
        };
        let (started, finished) = match &state {
            State::Accepted(_) => (None, None),
            State::Running { started, .. } => (Some(started.date), None),
            State::Ended(ended) => (ended.started, Some(ended.finished)),
        };
        let (done, steps) = match &state {
            State::Accepted(_) => (0.0, 0),
            State::Running { control, .. } => (control.fraction(), control.steps()),
            State::Ended(ended) => (ended.fraction, ended.steps),
        };
        let Time { start, end } = job.horizon;
        let (progress, time) = if status == "successful" {
            (100, end)
        } else {
            let done = done.clamp(0.0, 1.0);
            // The percentage is rounded down and limited to 99: only a successful job has 100 per cent.
            ((done * 100.0).min(99.0) as u8, start + done * (end - start))
        };
        let queue_position = matches!(state, State::Accepted(_)).then(|| jobs.position(job)).flatten();
        let path = address(format_args!("/jobs/{}", job.id));
        let link = |suffix, rel, title| Link { href: format!("{path}{suffix}"), rel, title };
        let mut links = vec![link("", "self", "this job")];
        if finished.is_some() {
            links.push(link("/results", "http://www.opengis.net/def/rel/ogc/1.0/results", "its results"));
            if status != "successful" {
                links.push(link("/retry", "retry", "POST here to send it to the queue again, as a new job"));
            }
            links.push(link("/continue", "continue", "POST {\"end\": T} here to go on from its end, as a new job"));
        } else {
            links.push(link("/events", "monitor", "what happens, as server-sent events"));
            links.push(link("/cancel", "cancel", "POST here to stop it and keep the trajectory so far"));
        }
        Self {
            id: job.id.to_string(),
            status,
            trusted: verdict.as_ref().map(|verdict| verdict.trusted),
            verdict,
            message,
            label: job.label.clone(),
            progress,
            members: job.members().map(|(done, of)| MembersDone { done, of }),
            queue_position,
            attempt: job.attempt(),
            time,
            steps,
            created: job.created.date,
            started,
            finished,
            links,
        }
    }
}

fn outcome(ended: &Ended) -> (&'static str, Option<String>) {
    let kept = "its results hold the trajectory so far";
    let broken = |fault| {
        let problem = Box::<Problem>::from(fault);
        ("failed", Some(format!("{}: {}", problem.kind().slug(), problem.detail())))
    };
    if ended.damaged {
        return broken(Fault::Damaged);
    }
    match &ended.ending {
        Ending::Successful => ("successful", None),
        Ending::Failed(why) => ("failed", Some(format!("{why}; {kept}"))),
        Ending::Broken(fault) => broken(*fault),
        Ending::Dismissed if ended.held.is_some() => ("dismissed", Some(format!("cancelled; {kept}"))),
        Ending::Dismissed if ended.started.is_some() => ("dismissed", Some("cancelled".to_owned())),
        Ending::Dismissed => ("dismissed", Some("cancelled before it started".to_owned())),
    }
}
