//! The state of a job on the wire: the `statusInfo` of OGC API - Processes, part 1.

use crate::service::jobs::{Ending, Fault, Job, Jobs, State};
use crate::solution::Status;
use crate::specification::Time;
use jiff::Timestamp;
use serde::Serialize;
use utoipa::ToSchema;

/// Where a job stands.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct StatusInfo {
    id: String,
    status: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    message: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    label: Option<String>,
    /// The part of the time horizon that is done, in per cent.
    #[schema(maximum = 100)]
    progress: u8,
    /// Jobs that will be taken before this one.
    #[serde(skip_serializing_if = "Option::is_none")]
    queue_position: Option<usize>,
    /// The time reached in the problem.
    time: f64,
    /// Accepted steps of the method.
    steps: u64,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    started: Option<Timestamp>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>, format = DateTime)]
    finished: Option<Timestamp>,
    links: Vec<Link>,
}

#[derive(Debug, PartialEq, Serialize, ToSchema)]
struct Link {
    href: String,
    rel: &'static str,
    title: &'static str,
}

impl StatusInfo {
    /// The word for where it stands.
    pub fn status(&self) -> &'static str {
        self.status
    }

    /// The state of `job` at this moment.
    pub fn of(job: &Job, jobs: &Jobs) -> Self {
        let state = job.state();
        let (status, message) = match &state {
            State::Accepted(_) => ("accepted", None),
            State::Running { .. } => ("running", None),
            State::Ended { ending, .. } => outcome(ending),
        };
        let (started, finished, control) = match &state {
            State::Accepted(_) => (None, None, None),
            State::Running { started, control } => (Some(*started), None, Some(control)),
            State::Ended { started, finished, control, .. } => (*started, Some(*finished), control.as_ref()),
        };
        let Time { start, end } = job.horizon;
        let (progress, time) = match &state {
            State::Ended { ending: Ending::Successful(_), .. } => (100, end),
            _ => {
                let done = control.map_or(0.0, |control| control.fraction().clamp(0.0, 1.0));
                // Rounded down: one hundred is said of nothing that is not done.
                ((done * 100.0).min(99.0) as u8, start + done * (end - start))
            }
        };
        let queue_position = matches!(state, State::Accepted(_)).then(|| jobs.position(job)).flatten();
        let path = format!("/jobs/{}", job.id);
        let link = |suffix, rel, title| Link { href: format!("{path}{suffix}"), rel, title };
        let mut links = vec![link("", "self", "this job")];
        if finished.is_some() {
            links.push(link("/results", "http://www.opengis.net/def/rel/ogc/1.0/results", "its results"));
        } else {
            links.push(link("/events", "monitor", "what happens, as server-sent events"));
            links.push(link("/cancel", "cancel", "POST here to stop it and keep the trajectory so far"));
        }
        Self {
            id: job.id.to_string(),
            status,
            message,
            label: job.label.clone(),
            progress,
            queue_position,
            time,
            steps: control.map_or(0, |control| control.steps()),
            created: job.created.date,
            started: started.map(|moment| moment.date),
            finished: finished.map(|moment| moment.date),
            links,
        }
    }
}

fn outcome(ending: &Ending) -> (&'static str, Option<String>) {
    match ending {
        Ending::Successful(_) => ("successful", None),
        Ending::Failed(results) => {
            let kept = "its results hold the trajectory so far";
            let why = match (&results.solution.error, results.solution.status) {
                (Some(error), _) => error.message.as_str(),
                (None, Status::Stopped) => "a limit stopped the solve",
                (None, _) => "the solve failed",
            };
            ("failed", Some(format!("{why}; {kept}")))
        }
        Ending::Broken(Fault::Panicked) => ("failed", Some("internal: the solver broke down".to_owned())),
        Ending::Broken(Fault::TooLarge { .. }) => ("failed", Some("result-too-large".to_owned())),
        Ending::Dismissed(Some(_)) => {
            ("dismissed", Some("cancelled; its results hold the trajectory so far".to_owned()))
        }
        Ending::Dismissed(None) => ("dismissed", Some("cancelled before it started".to_owned())),
    }
}
