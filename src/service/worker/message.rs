//! The messages between the front and a worker, independent of their transport. A message may have a payload: a
//! document with an order, a piece of a result with a report.
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
//! Messages carry the number of their task: late ones are ignored.

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

/// The version of these messages: a worker of another version gets no orders.
pub const VERSION: u32 = 4;

/// An order to a worker.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// Solve the document in the payload.
    Solve {
        /// The number of the task.
        task: u64,
        /// The limits of the task.
        limits: Limits,
        /// The ids of the job, request and trace of the task.
        origin: Origin,
        /// The members to solve, if the task is a part of a sweep.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        members: Option<Members>,
    },
    /// Check the document in the payload.
    Check {
        /// The number of the task.
        task: u64,
        /// The limits of the task.
        limits: Limits,
        /// The ids of the request and trace of the task.
        origin: Origin,
    },
    /// Report the progress of the task.
    Look {
        /// The number of the task.
        task: u64,
    },
    /// Stop the task at its next step.
    Cancel {
        /// The number of the task.
        task: u64,
    },
}

/// A report of a worker.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Report {
    /// The worker takes orders.
    Ready {
        /// [`VERSION`].
        version: u32,
        /// The limits in force on the worker.
        confinement: Confinement,
    },
    /// The worker has received the document.
    Taken {
        /// The number of the task.
        task: u64,
    },
    /// The solve has begun.
    Begun {
        /// The number of the task.
        task: u64,
    },
    /// The progress of the task.
    Progress {
        /// The number of the task.
        task: u64,
        /// The progress.
        progress: Progress,
    },
    /// The next bytes of long results, as columns, are the payload.
    Piece {
        /// The number of the task.
        task: u64,
    },
    /// The solve has returned; the payload is short results as JSON, the last bytes of long ones, or the rows of members.
    Solved {
        /// The number of the task.
        task: u64,
        /// The fingerprints of long results; `None` for short ones.
        columns: Option<Prints>,
        /// The number of rows in the payload, if the task was a part of a sweep.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        rows: Option<usize>,
        /// The end of the solve.
        solved: Box<Solved>,
        /// The final progress.
        progress: Progress,
        /// The resident memory of the worker, in bytes.
        resident: u64,
    },
    /// The document is correct; the payload is its summary, as JSON.
    Checked {
        /// The number of the task.
        task: u64,
        /// The facts of the document that the front needs.
        facts: Facts,
        /// The resident memory of the worker, in bytes.
        resident: u64,
    },
    /// The document has errors; the payload lists them, as JSON.
    Refused {
        /// The number of the task.
        task: u64,
        /// The check was stopped before its end.
        interrupted: bool,
    },
    /// The solve was not begun, since its estimated memory exceeds the limit.
    TooMuchMemory {
        /// The number of the task.
        task: u64,
        /// The estimated memory, in bytes.
        estimate: usize,
    },
    /// The results exceed their size limit.
    TooLarge {
        /// The number of the task.
        task: u64,
    },
    /// The solver panicked, and the worker takes no more orders.
    Defect {
        /// The number of the task.
        task: u64,
        /// The message of the panic.
        message: String,
    },
}

impl Report {
    /// The number of the task that the report is about.
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

/// Members of a sweep as one task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Members {
    /// The first.
    pub first: usize,
    /// Behind the last.
    pub end: usize,
    /// Why they cannot be solved, if that is known: their rows say so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<Lost>,
    /// The time after which no further member is begun, in seconds.
    pub seconds: f64,
}

/// Why a member of a sweep has no solution: the worker that had it was lost.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lost {
    /// The code of the error in its row.
    pub code: String,
    /// The same in words.
    pub message: String,
}

/// The ids that connect the worker's log lines with those of the service.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// The job, if the task is a solve for one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub job: Option<String>,
    /// The request that posted the document, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request: Option<String>,
    /// The trace and the parent span, in the format of W3C Trace Context.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub traceparent: Option<String>,
}

impl Origin {
    /// The origin of a task for a job, or of a check, in the context of a request, with the trace of the request.
    pub fn of(job: Option<String>, context: &Context) -> Self {
        let request = Some(&*context.request).filter(|id| !id.is_empty()).map(str::to_owned);
        Self { job, request, traceparent: context.trace.map(|trace| trace.traceparent()) }
    }

    /// Makes the task's `span` part of the trace.
    pub fn join(&mut self, span: &Span) {
        let trace = self.traceparent.as_deref().and_then(Trace::read);
        self.traceparent = trace::join(span, trace).map(|trace| trace.traceparent());
    }

    /// A span with these ids.
    pub fn span(&self) -> Span {
        let trace = self.traceparent.as_deref().and_then(Trace::read);
        let trace = trace.map(tracing::field::display);
        match &self.job {
            Some(job) => tracing::info_span!("job", job.id = job, request.id = self.request, trace.id = trace),
            None => tracing::info_span!("check", request.id = self.request, trace.id = trace),
        }
    }
}

/// The limits of a task.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Limits {
    /// The number of accepted steps.
    pub steps: u64,
    /// The memory in bytes, as estimated before a solve or measured by it.
    pub memory: usize,
    /// The wall time in seconds, if it is bounded.
    pub wall_seconds: Option<f64>,
    /// The size of the results as JSON, in bytes.
    pub result_bytes: usize,
}

impl Limits {
    /// The wall time, if it is bounded.
    pub fn wall(&self) -> Option<Duration> {
        Duration::try_from_secs_f64(self.wall_seconds?).ok()
    }

    /// Parses and checks a document to be solved within these limits.
    ///
    /// # Errors
    /// All errors of the document.
    pub fn read(&self, document: &[u8], control: &Control) -> Result<Specification, Vec<SpecificationError>> {
        self.check(Draft::read(document)?, control)
    }

    /// Checks a parsed document to be solved within these limits.
    ///
    /// # Errors
    /// All errors of the document.
    pub fn check(&self, draft: Draft, control: &Control) -> Result<Specification, Vec<SpecificationError>> {
        Ok(draft.check_within(self.memory, control)?.within_steps(self.steps))
    }
}

/// One thing wrong with a specification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = SpecificationError)]
pub struct Finding {
    /// The JSON pointer (RFC 6901) of the offender.
    pub pointer: String,
    /// A stable word for programs, such as `unknown_key`.
    #[schema(value_type = String)]
    pub code: Cow<'static, str>,
    /// What is wrong, for people.
    pub detail: String,
    /// What would be right.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected: Option<String>,
    /// The nearest valid name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub did_you_mean: Option<String>,
}

impl From<SpecificationError> for Finding {
    fn from(error: SpecificationError) -> Self {
        let SpecificationError { pointer, code, detail, expected, did_you_mean } = error;
        Self { pointer, code: code.into(), detail, expected, did_you_mean }
    }
}

/// The fingerprints that identify long results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Prints {
    /// The fingerprint of the JSON that they encode.
    pub json: Fingerprint,
    /// The fingerprint of the index, at the end of the columns.
    pub index: Fingerprint,
}

/// The progress of a task.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Progress {
    /// The fraction of the time horizon that has been integrated, in `[0, 1]`.
    pub fraction: f64,
    /// The number of accepted steps.
    pub steps: u64,
    /// The events since the last report, each with its number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<(u64, Event)>,
}

impl Progress {
    /// The progress of the solve under `control`, with its events after number `told`, the last that was reported.
    pub fn of(control: &Control, told: u64) -> Self {
        Self { fraction: control.fraction(), steps: control.steps(), events: control.events_after(told) }
    }

    /// Reports this progress to `control`.
    pub fn relay(self, control: &Control) {
        control.relay(self.events);
        control.report(self.fraction, self.steps);
    }
}

/// Why a solve did not reach its end time.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Failed {
    /// The error code, for programs.
    pub code: String,
    /// A description, for people.
    pub message: String,
    /// The time that was reached.
    pub time: f64,
}

/// The end of a solve, without its results.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Solved {
    /// The problem type.
    pub problem: Cow<'static, str>,
    /// Whether the end time was reached.
    pub status: Status,
    /// Why the end time was not reached.
    pub failed: Option<Failed>,
    /// Whether the solution can be trusted.
    pub verdict: Verdict,
    /// The number of accepted steps.
    pub steps: u64,
    /// The number of variational inequalities solved at stages.
    pub vi_solves: Option<u64>,
}

impl Solved {
    /// The end of a solve of a problem of type `problem`.
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

/// Facts of a specification that is not in memory.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Facts {
    /// A label chosen by the client.
    pub label: Option<String>,
    /// The time horizon of the problem.
    pub horizon: Time,
    /// The problem type.
    pub problem: Cow<'static, str>,
    /// The estimated memory of a solve, in bytes.
    pub memory: usize,
    /// The sweep, if it is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sweep: Option<SweepFacts>,
}

/// Facts of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SweepFacts {
    /// The number of members.
    pub members: usize,
    /// The wall time that its client allows, in seconds, if it is bounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// The numbers of the trajectory of a member that are kept.
    #[serde(default)]
    pub kept: usize,
}

impl Facts {
    /// The facts of `specification`.
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
