//! A compiled specification, and its solution once it was solved inline: a solve depends on nothing but the
//! specification, so that a client that sends the specification again gets identical bytes. Another client does not get
//! the stored solution, since that would reveal that someone has sent the specification before.

use crate::jobs::{Client, Ended, Held, Results};
use crate::worker::Facts;
use solution::Verdict;
use specification::Specification;
use std::sync::{Arc, OnceLock};

/// The largest size of a stored solution as JSON, in bytes. With the number of stored specifications, that is four
/// megabytes in all.
const SHORT: usize = 16 << 10;

/// The largest estimated memory of a problem whose single steps take less time than an inline solve may, in bytes: some
/// ten unknowns.
pub const SMALL: usize = 32 << 10;

/// A compiled specification, and what is needed each time that it is posted.
#[derive(Debug)]
pub struct Known {
    /// The specification.
    pub specification: Specification,
    /// The facts of the specification: label, horizon, type and estimated memory.
    pub facts: Facts,
    is_small: bool,
    answer: OnceLock<Repeated>,
}

/// The stored solution of a solve that reached the end time.
#[derive(Clone, Debug)]
pub struct Repeated {
    /// The client that asked for the solve.
    client: Client,
    /// The number of accepted steps.
    pub steps: u64,
    /// The verdict on the solution.
    pub verdict: Option<Verdict>,
    /// The results.
    pub results: Arc<Results>,
}

impl Known {
    /// A specification without a stored solution.
    pub fn of(specification: Specification) -> Self {
        let facts = Facts::of(&specification);
        let is_plain =
            specification.model().dvi().is_some() && specification.study().is_none() && specification.sweep().is_none();
        Self { is_small: is_plain && facts.memory <= SMALL, facts, specification, answer: OnceLock::new() }
    }

    /// Whether no step of a solve takes longer than an inline solve may.
    pub fn is_small(&self) -> bool {
        self.is_small
    }

    /// The stored solution, if `client` asked for it.
    pub fn answer(&self, client: Client) -> Option<&Repeated> {
        self.answer.get().filter(|answer| answer.client == client)
    }

    /// Stores the solution, if it is short.
    pub fn keep(&self, client: Client, ended: &Ended) {
        if let Some(Held::Memory(results)) = &ended.held
            && results.text().is_some_and(|json| json.len() <= SHORT)
        {
            let (steps, verdict, results) = (ended.steps, ended.verdict.clone(), Arc::clone(results));
            // If a solution is stored already, it is identical.
            let _ = self.answer.set(Repeated { client, steps, verdict, results });
        }
    }
}
