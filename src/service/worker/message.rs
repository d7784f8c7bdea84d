//! What the front and a worker say to each other, apart from what carries it. A message may come with bytes: an order
//! with a document, a report with a piece of a result.
//!
//! ```text
//! worker: Ready                         once, before anything else
//! front:  Solve + document | Check + document
//! worker: Taken                         from here on its death is the document's doing
//! front:  Look                          as often as somebody may want to know
//! worker: Progress
//! front:  Cancel                        the end comes soon, with the trajectory so far
//! worker: Piece + bytes ..              a long result, as columns
//! worker: Solved + bytes | Checked + bytes | Refused + bytes | TooMuchMemory | TooLarge | Defect
//! ```
//!
//! Messages carry the number of their task: one that comes late is passed over.

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

/// The version of these messages: a worker of another is not given anything.
pub const VERSION: u32 = 2;

/// What a worker is asked.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// Solve the document that comes with it.
    Solve {
        /// The number of the task.
        task: u64,
        /// What it may take.
        limits: Limits,
        /// Whose it is.
        origin: Origin,
    },
    /// Check the document that comes with it.
    Check {
        /// The number of the task.
        task: u64,
        /// What it may take.
        limits: Limits,
        /// Whose it is.
        origin: Origin,
    },
    /// Report how far the task is.
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

/// What a worker reports.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Report {
    /// It takes orders.
    Ready {
        /// [`VERSION`].
        version: u32,
        /// The limits that hold for it.
        confinement: Confinement,
    },
    /// It has the document.
    Taken {
        /// The number of the task.
        task: u64,
    },
    /// How far the task is.
    Progress {
        /// The number of the task.
        task: u64,
        /// How far.
        progress: Progress,
    },
    /// The next bytes of a long result, as columns, come with it.
    Piece {
        /// The number of the task.
        task: u64,
    },
    /// The solve has returned; a short result, as JSON, comes with it, and the last bytes of a long one.
    Solved {
        /// The number of the task.
        task: u64,
        /// What the columns of a long result are known by.
        columns: Option<Prints>,
        /// How it ended.
        solved: Box<Solved>,
        /// How far it came.
        progress: Progress,
        /// The memory that the worker holds.
        resident: u64,
    },
    /// The document is correct; its summary, as JSON, comes with it.
    Checked {
        /// The number of the task.
        task: u64,
        /// What the front needs to know of it.
        facts: Facts,
        /// The memory that the worker holds.
        resident: u64,
    },
    /// The document has errors, which come with it as JSON.
    Refused {
        /// The number of the task.
        task: u64,
        /// The check was stopped before its end.
        interrupted: bool,
    },
    /// The solve was not begun, because it would take more memory than it may.
    TooMuchMemory {
        /// The number of the task.
        task: u64,
        /// The bytes that it would take.
        estimate: usize,
    },
    /// The result would be longer than it may be.
    TooLarge {
        /// The number of the task.
        task: u64,
    },
    /// The solver panicked, and the worker takes nothing more.
    Defect {
        /// The number of the task.
        task: u64,
        /// What the panic said.
        message: String,
    },
}

impl Report {
    /// The number of the task that it is about.
    pub fn task(&self) -> Option<u64> {
        match self {
            Self::Ready { .. } => None,
            Self::Taken { task }
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

/// Whose a task is: the ids by which the lines of a worker's log are joined with those of the service.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// The job that is solved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub job: Option<String>,
    /// The request that posted it, where that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request: Option<String>,
    /// The trace that it is part of, with its parent there, as W3C Trace Context writes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub traceparent: Option<String>,
}

impl Origin {
    /// That of a task for a job, or of a check, on behalf of a request. Its trace is still that of the request.
    pub fn of(job: Option<String>, context: &Context) -> Self {
        let request = Some(&*context.request).filter(|id| !id.is_empty()).map(str::to_owned);
        Self { job, request, traceparent: context.trace.map(|trace| trace.traceparent()) }
    }

    /// Makes `span`, which is the task's, part of the trace.
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

/// What a task may take.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Limits {
    /// Accepted steps.
    pub steps: u64,
    /// Bytes, as far as they are estimated or measured by the solve itself.
    pub memory: usize,
    /// Time, in seconds, if it is bounded.
    pub wall_seconds: Option<f64>,
    /// Bytes of the result as JSON.
    pub result_bytes: usize,
}

impl Limits {
    /// The time, if it is bounded.
    pub fn wall(&self) -> Option<Duration> {
        Duration::try_from_secs_f64(self.wall_seconds?).ok()
    }

    /// Reads and checks a document, to be solved within these limits.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub fn read(&self, document: &[u8], control: &Control) -> Result<Specification, Vec<SpecificationError>> {
        self.check(Draft::read(document)?, control)
    }

    /// Checks a document that has been read, to be solved within these limits.
    ///
    /// # Errors
    /// All that is wrong with it.
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

/// What the columns of a long result are known by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Prints {
    /// Of the JSON that they stand for.
    pub json: Fingerprint,
    /// Of their index, which is at their end.
    pub index: Fingerprint,
}

/// How far a task is.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Progress {
    /// The part of the time horizon that is done, in `[0, 1]`.
    pub fraction: f64,
    /// Accepted steps.
    pub steps: u64,
    /// Events since the last report, each with its number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<(u64, Event)>,
}

impl Progress {
    /// How far the solve under `control` is, with the events after the first `told`.
    pub fn of(control: &Control, told: u64) -> Self {
        Self { fraction: control.fraction(), steps: control.steps(), events: control.events_after(told) }
    }

    /// Brings `control` to where the solve is.
    pub fn relay(self, control: &Control) {
        control.relay(self.events);
        control.report(self.fraction, self.steps);
    }
}

/// Why a solve did not reach its end time.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Failed {
    /// A stable word for programs.
    pub code: String,
    /// What happened, for people.
    pub message: String,
    /// The time reached.
    pub time: f64,
}

/// How a solve ended, beside its result.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Solved {
    /// The type of the problem.
    pub problem: Cow<'static, str>,
    /// Whether the end was reached.
    pub status: Status,
    /// Why it was not.
    pub failed: Option<Failed>,
    /// Whether the answer may be relied upon.
    pub verdict: Verdict,
    /// Accepted steps of the method.
    pub steps: u64,
    /// Variational inequalities solved at stages.
    pub vi_solves: Option<u64>,
}

impl Solved {
    /// How the solve of such a problem ended.
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

/// What is known of a specification without having it in hand.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Facts {
    /// The client's own words for it.
    pub label: Option<String>,
    /// The time horizon of its problem.
    pub horizon: Time,
    /// The type of the problem.
    pub problem: Cow<'static, str>,
    /// Bytes that a solve is known to take before it runs.
    pub memory: usize,
}

impl Facts {
    /// Those of `specification`.
    pub fn of(specification: &Specification) -> Self {
        Self {
            label: specification.label().map(str::to_owned),
            horizon: specification.time(),
            problem: specification.problem().into(),
            memory: specification.memory_bytes(),
        }
    }
}
