//! A compiled specification, and its solution once a client has had it solved. A solve depends on nothing but the
//! specification, so that the client that sends the specification again gets identical bytes. Other clients do not
//! get the stored solution, since that would reveal that someone has sent the specification before.

use crate::jobs::{Client, Ended, Held, Results};
use crate::worker::Facts;
use solution::Verdict;
use specification::Specification;
use std::sync::{Arc, OnceLock};

/// The largest size in bytes of a solution, as JSON, that is stored to be sent again. With the largest number of cached
/// specifications, stored solutions take at most four megabytes in all.
const SHORT: usize = 16 << 10;

/// The largest estimated memory, in bytes, of a problem (some ten unknowns) whose single steps are sure to be shorter
/// than the time limit of an inline solve, which is a solve in the serving process.
pub const SMALL: usize = 32 << 10;

/// A compiled specification in the cache, with the data that each further request for it needs.
#[derive(Debug)]
pub struct Known {
    /// The specification, compiled to programs that evaluate its equations.
    pub specification: Specification,
    /// The label, time horizon, problem type and estimated memory of the specification.
    pub facts: Facts,
    is_small: bool,
    answer: OnceLock<Repeated>,
}

/// The stored solution of a solve that reached its end time, ready to be sent again.
#[derive(Clone, Debug)]
pub struct Repeated {
    /// The client that asked for the solve; no other client gets the stored solution.
    client: Client,
    /// The number of accepted steps of the solve.
    pub steps: u64,
    /// The verdict on the solution.
    pub verdict: Option<Verdict>,
    /// The results of the solve, as they are sent to clients.
    pub results: Arc<Results>,
}

impl Known {
    /// Creates the cache entry of a compiled specification, without a solution.
    pub fn of(specification: Specification) -> Self {
        let facts = Facts::of(&specification);
        let is_plain =
            specification.model().dvi().is_some() && specification.study().is_none() && specification.sweep().is_none();
        Self { is_small: is_plain && facts.memory <= SMALL, facts, specification, answer: OnceLock::new() }
    }

    /// Whether the problem is small enough that no step of a solve takes longer than an inline solve may.
    pub fn is_small(&self) -> bool {
        self.is_small
    }

    /// Returns the stored solution, if `client` is the one that asked for it.
    pub fn answer(&self, client: Client) -> Option<&Repeated> {
        self.answer.get().filter(|answer| answer.client == client)
    }

    /// Stores the results of a solve for `client`, if they are short, to be sent again when the client repeats the
    /// request.
    pub fn keep(&self, client: Client, ended: &Ended) {
        if let Some(Held::Memory(results)) = &ended.held
            && results.text().is_some_and(|json| json.len() <= SHORT)
        {
            let (steps, verdict, results) = (ended.steps, ended.verdict.clone(), Arc::clone(results));
            // `set` fails if a solution is stored already, which is harmless: the two are identical.
            let _ = self.answer.set(Repeated { client, steps, verdict, results });
        }
    }
}
