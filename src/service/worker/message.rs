//! The messages between the front process (which serves HTTP) and a worker, independent of their transport. A message
//! may have a payload: a specification document with an order, a piece of a result with a report.
//!
//! ```text
//! worker: Ready                         once, before anything else
//! front:  Solve + document | Check + document
//! worker: Taken                         from here on, its death is attributed to the document
//! worker: Begun                         the document is read; from here on, it is solved
//! front:  Look                          at intervals, to follow the progress
//! worker: Progress
//! front:  Cancel                        the end comes soon, with the trajectory so far
//! worker: Piece + bytes ..              long results, as columns
//! worker: Solved + bytes | Checked + bytes | Refused + bytes | TooMuchMemory | TooLarge | Defect
//! ```
//!
//! A message carries the number of its task, by which late messages about earlier tasks are recognized and ignored.

use super::Confinement;
use crate::context::Context;
use crate::digest::Fingerprint;
use crate::trace::{self, Trace};
use problem::{Control, Event};
use serde::{Deserialize, Serialize};
use solution::{Failure, Solution, Status, Verdict};
use specification::{Draft, Specification, SpecificationError, Time};
use std::borrow::Cow;
use std::time::Duration;
use tracing::Span;
use utoipa::ToSchema;

/// The version of the messages between the front process and its workers: a worker of another version gets no orders.
pub const VERSION: u32 = 4;

/// An order of the front process to a worker.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// An order to solve the specification document in the payload.
    Solve {
        /// The number of the task to begin, repeated in all reports about the task.
        task: u64,
        /// The limits of steps, memory, time and result size of the task.
        limits: Limits,
        /// The ids of the job, request and trace of the task, for the log.
        origin: Origin,
        /// The members of the sweep to solve, if the task is a part of a sweep.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        members: Option<Members>,
    },
    /// An order to check the specification document in the payload.
    Check {
        /// The number of the task to begin, repeated in all reports about the task.
        task: u64,
        /// The limits of steps, memory, time and result size of the task.
        limits: Limits,
        /// The ids of the request and trace of the task, for the log.
        origin: Origin,
    },
    /// An order to report the progress of the worker's task.
    Look {
        /// The number of the task whose progress is asked for.
        task: u64,
    },
    /// An order to stop the worker's task at its next step.
    Cancel {
        /// The number of the task to stop.
        task: u64,
    },
}

/// A report of a worker to the front process.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Report {
    /// The worker has started and is ready to take orders.
    Ready {
        /// The version of the messages, [`VERSION`].
        version: u32,
        /// The resource and access limits in force on the worker process.
        confinement: Confinement,
    },
    /// The worker has received the specification document.
    Taken {
        /// The number of the worker's task that is reported on.
        task: u64,
    },
    /// The worker has read the specification, and its solve has begun.
    Begun {
        /// The number of the worker's task that is reported on.
        task: u64,
    },
    /// The worker reports the progress of its task.
    Progress {
        /// The number of the worker's task that is reported on.
        task: u64,
        /// The steps, the time and the events of the solve so far.
        progress: Progress,
    },
    /// The payload is the next bytes of a long result in the columnar format.
    Piece {
        /// The number of the worker's task that is reported on.
        task: u64,
    },
    /// The solve has returned; the payload is short results as JSON, the last bytes of long ones, or the rows of
    /// members of a sweep.
    Solved {
        /// The number of the worker's task that is reported on.
        task: u64,
        /// The fingerprints (length and digest) of long results; `None` for short results.
        columns: Option<Prints>,
        /// The number of rows in the payload, if the task was a part of a sweep.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        rows: Option<usize>,
        /// How the solve ended, without its results.
        solved: Box<Solved>,
        /// The final progress of the solve.
        progress: Progress,
        /// The resident memory of the worker after the task, in bytes.
        resident: u64,
    },
    /// The specification is correct; the payload is its summary, as JSON.
    Checked {
        /// The number of the worker's task that is reported on.
        task: u64,
        /// The properties of the specification that the front process needs.
        facts: Facts,
        /// The resident memory of the worker after the task, in bytes.
        resident: u64,
    },
    /// The specification has errors; the payload lists them, as JSON.
    Refused {
        /// The number of the worker's task that is reported on.
        task: u64,
        /// Whether the check of the specification was stopped before its end.
        interrupted: bool,
    },
    /// The solve was not begun, since its estimated memory exceeds the limit.
    TooMuchMemory {
        /// The number of the worker's task that is reported on.
        task: u64,
        /// The estimated memory of the solve, in bytes.
        estimate: usize,
    },
    /// The results of the solve exceed their size limit.
    TooLarge {
        /// The number of the worker's task that is reported on.
        task: u64,
    },
    /// The solver panicked, and the worker takes no more orders.
    Defect {
        /// The number of the worker's task that is reported on.
        task: u64,
        /// The message of the solver's panic.
        message: String,
    },
}

impl Report {
    /// Returns the number of the task that the report is about; `None` for the report that the worker is ready.
    pub fn task(&self) -> Option<u64> {
        match self {
            Self::Ready { .. } => None,
            Self::Taken { task }
            | Self::Begun { task }
            | Self::Progress { task, .. }
            | Self::Piece { task }
            | Self::Solved { task, .. }
            | Self::Checked { task, .. }
            | Self::Refused { task, .. }
            | Self::TooMuchMemory { task, .. }
            | Self::TooLarge { task }
            | Self::Defect { task, .. } => Some(*task),
        }
    }
}

/// A range of members of a sweep, solved as one task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Members {
    /// The index of the first member of the sweep in the range.
    pub first: usize,
    /// The index behind the last member of the sweep in the range.
    pub end: usize,
    /// The reason, if known, for which these members of the sweep cannot be solved; their rows report it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<Lost>,
    /// The time in seconds after which no further member of the sweep is begun.
    pub seconds: f64,
}

/// The reason why a member of a sweep has no solution: the worker that was solving it was lost.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lost {
    /// The code of the error in the row of the member.
    pub code: String,
    /// The message of the error in the row of the member.
    pub message: String,
}

/// The ids that connect the log lines of a worker with those of the service.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// The id of the job, if the task is a solve for a job.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub job: Option<String>,
    /// The id of the request that posted the specification, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request: Option<String>,
    /// The trace and the parent span, in the format of W3C Trace Context.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub traceparent: Option<String>,
}

impl Origin {
    /// Returns the ids of a task for `job`, or of a check, with the request and the trace of `context`.
    pub fn of(job: Option<String>, context: &Context) -> Self {
        let request = Some(&*context.request).filter(|id| !id.is_empty()).map(str::to_owned);
        Self { job, request, traceparent: context.trace.map(|trace| trace.traceparent()) }
    }

    /// Makes `span`, the logging span of the task, a part of the trace that these ids name.
    pub fn join(&mut self, span: &Span) {
        let trace = self.traceparent.as_deref().and_then(Trace::read);
        self.traceparent = trace::join(span, trace).map(|trace| trace.traceparent());
    }

    /// Creates a span for log lines with the ids of the job, the request and the trace.
    pub fn span(&self) -> Span {
        let trace = self.traceparent.as_deref().and_then(Trace::read);
        let trace = trace.map(tracing::field::display);
        match &self.job {
            Some(job) => tracing::info_span!("job", job.id = job, request.id = self.request, trace.id = trace),
            None => tracing::info_span!("check", request.id = self.request, trace.id = trace),
        }
    }
}

/// The limits of a task of a worker.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Limits {
    /// The largest number of accepted steps of a solve.
    pub steps: u64,
    /// The largest memory of a solve in bytes, as estimated before it or measured by it.
    pub memory: usize,
    /// The largest wall-clock time of the task in seconds, if it is limited.
    pub wall_seconds: Option<f64>,
    /// The largest size of the results of a solve as JSON, in bytes.
    pub result_bytes: usize,
}

impl Limits {
    /// Returns the limit of the wall-clock time of a task, if it has one.
    pub fn wall(&self) -> Option<Duration> {
        Duration::try_from_secs_f64(self.wall_seconds?).ok()
    }

    /// Parses a specification document and checks it for a solve within these limits.
    ///
    /// # Errors
    /// All errors of the specification.
    pub fn read(&self, document: &[u8], control: &Control) -> Result<Specification, Vec<SpecificationError>> {
        self.check(Draft::read(document)?, control)
    }

    /// Checks a parsed specification for a solve within these limits.
    ///
    /// # Errors
    /// All errors of the specification.
    pub fn check(&self, draft: Draft, control: &Control) -> Result<Specification, Vec<SpecificationError>> {
        Ok(draft.check_within(self.memory, control)?.within_steps(self.steps))
    }
}

/// An error of a specification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = SpecificationError)]
pub struct Finding {
    /// The JSON pointer (RFC 6901) of the value with the error.
    pub pointer: String,
    /// A stable word for programs, such as `unknown_key`.
    #[schema(value_type = String)]
    pub code: Cow<'static, str>,
    /// A description of the error, for people.
    pub detail: String,
    /// What would be valid in place of the value with the error.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected: Option<String>,
    /// The valid name that is nearest to an unknown one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub did_you_mean: Option<String>,
}

impl From<SpecificationError> for Finding {
    fn from(error: SpecificationError) -> Self {
        let SpecificationError { pointer, code, detail, expected, did_you_mean } = error;
        Self { pointer, code: code.into(), detail, expected, did_you_mean }
    }
}

/// The fingerprints (length and digest) that identify a long result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Prints {
    /// The fingerprint of the result as JSON, which the columns encode.
    pub json: Fingerprint,
    /// The fingerprint of the index, which stands at the end of the columnar file.
    pub index: Fingerprint,
}

/// The progress of a solve, as its worker reports it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Progress {
    /// The fraction of the time horizon that has been integrated, in `[0, 1]`.
    pub fraction: f64,
    /// The number of accepted steps of the solve.
    pub steps: u64,
    /// The events of the trajectory since the last report, each with its number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<(u64, Event)>,
}

impl Progress {
    /// Returns the progress of the solve under `control`, with its events after number `told`, the last that was
    /// reported.
    pub fn of(control: &Control, told: u64) -> Self {
        Self { fraction: control.fraction(), steps: control.steps(), events: control.events_after(told) }
    }

    /// Reports this progress of a worker's solve, with its events, to `control`.
    pub fn relay(self, control: &Control) {
        control.relay(self.events);
        control.report(self.fraction, self.steps);
    }
}

/// The reason why a solve did not reach its end time.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Failed {
    /// The code of the error with which the solve failed, for programs.
    pub code: String,
    /// A description of the error, for people.
    pub message: String,
    /// The time of the problem that the solve had reached when it failed.
    pub time: f64,
}

/// How a solve ended, without its results.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Solved {
    /// The problem type, such as `dvi` or `circuit`.
    pub problem: Cow<'static, str>,
    /// Whether the solve reached its end time.
    pub status: Status,
    /// Why the solve did not reach its end time.
    pub failed: Option<Failed>,
    /// Whether the solution can be trusted, and the reasons if not.
    pub verdict: Verdict,
    /// The number of accepted steps of the solve.
    pub steps: u64,
    /// The number of variational inequalities solved at the stages of the steps.
    pub vi_solves: Option<u64>,
}

impl Solved {
    /// Summarizes the solution of a problem of type `problem`.
    pub fn of(problem: &'static str, solution: &Solution) -> Self {
        let failed = solution.error.as_ref();
        Self {
            problem: problem.into(),
            status: solution.status,
            failed: failed.map(|Failure { code, message, time, .. }| Failed {
                code: code.to_string(),
                message: message.clone(),
                time: *time,
            }),
            verdict: solution.verdict.clone(),
            steps: solution.diagnostics.steps.accepted,
            vi_solves: solution.diagnostics.vi.as_ref().map(|vi| vi.solves),
        }
    }
}

/// The properties of a specification that the front process needs, which may not have parsed it itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Facts {
    /// The label of the specification, chosen by the client.
    pub label: Option<String>,
    /// The start and the end time of the problem.
    pub horizon: Time,
    /// The problem type, such as `dvi` or `circuit`.
    pub problem: Cow<'static, str>,
    /// The estimated memory of a solve, in bytes.
    pub memory: usize,
    /// The properties of the sweep, if the specification is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sweep: Option<SweepFacts>,
}

/// The properties of a parameter sweep that the front process needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SweepFacts {
    /// The number of members of the sweep.
    pub members: usize,
    /// The wall-clock time in seconds that the client allows for the whole sweep, if it is bounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// The number of values that are kept of the trajectory of each member of the sweep.
    #[serde(default)]
    pub kept: usize,
}

impl Facts {
    /// Returns the properties of `specification` that the front process needs.
    pub fn of(specification: &Specification) -> Self {
        Self {
            label: specification.label().map(str::to_owned),
            horizon: specification.time(),
            problem: specification.problem().into(),
            memory: specification.memory_bytes(),
            sweep: specification.sweep().map(|sweep| SweepFacts {
                members: sweep.members(),
                seconds: specification.wall_seconds(),
                kept: sweep.numbers_kept(),
            }),
        }
    }
}
