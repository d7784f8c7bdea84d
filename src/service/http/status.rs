//! The status of a job in responses: the `statusInfo` of OGC API - Processes, part 1.

use super::problem::Problem;
use crate::context::address;
use crate::jobs::{Ended, Ending, Fault, Job, Jobs, State};
use jiff::Timestamp;
use serde::Serialize;
use solution::Verdict;
use specification::Time;
use utoipa::ToSchema;

/// Where a job stands.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct StatusInfo {
    /// Its name.
    id: String,
    /// `accepted`, `running`, `successful` (the end time was reached), `failed` or `dismissed`.
    status: &'static str,
    /// Whether the answer may be relied upon; absent until there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    trusted: Option<bool>,
    /// Why the answer is not trusted, and what else should be known of it; absent until there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    verdict: Option<Verdict>,
    /// Why it did not reach its end time.
    #[serde(skip_serializing_if = "Option::is_none")]
    message: Option<String>,
    /// The label of its specification.
    #[serde(skip_serializing_if = "Option::is_none")]
    label: Option<String>,
    /// The part of the time horizon that is done, in per cent.
    #[schema(maximum = 100)]
    progress: u8,
    /// The members of a sweep, where it is one: how many have rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    members: Option<MembersDone>,
    /// Jobs that will be taken before this one.
    #[serde(skip_serializing_if = "Option::is_none")]
    queue_position: Option<usize>,
    /// Which attempt this is, from one: a job is started again when its process ended while it ran.
    attempt: u32,
    /// The time reached in the problem.
    time: f64,
    /// Accepted steps of the method.
    steps: u64,
    /// When it was accepted.
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// When a worker took it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    started: Option<Timestamp>,
    /// When it ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    finished: Option<Timestamp>,
    /// What can be done with it.
    links: Vec<Link>,
}

/// How far a sweep is.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
struct MembersDone {
    /// Members that have a row in the table.
    done: usize,
    /// All members.
    of: usize,
}

#[derive(Debug, PartialEq, Serialize, ToSchema)]
struct Link {
    /// The address.
    href: String,
    /// What the address is to this job.
    rel: &'static str,
    /// The same in a few words.
    title: &'static str,
}

impl StatusInfo {
    /// The status as one word.
    pub fn status(&self) -> &'static str {
        self.status
    }

    /// The present status of `job`.
    pub fn of(job: &Job, jobs: &Jobs) -> Self {
        let state = job.state();
        let (status, message) = match &state {
            State::Accepted(_) => ("accepted", None),
            State::Running { .. } => ("running", None),
            State::Ended(ended) => outcome(ended),
        };
        let verdict = match &state {
            State::Accepted(_) | State::Running { .. } => None,
            // Damaged results are not served, and neither is their verdict.
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
            // Rounded down: only a successful job has 100 per cent.
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
