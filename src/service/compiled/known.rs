//! A specification that was read, and the answer to it once it was solved at a solve_inline: a solve depends on nothing but the
//! specification, so that who sends it again is given the same bytes. Who sends what another has sent is not: that somebody
//! did is nobody's business.

use crate::jobs::{Client, Ended, Held, Results};
use crate::worker::Facts;
use solution::Verdict;
use specification::Specification;
use std::sync::{Arc, OnceLock};

/// The bytes of an answer that is kept. With as many as are kept of specifications that is four megabytes in all.
const SHORT: usize = 16 << 10;

/// The bytes of a problem of which a step takes less time than a solve_inline: some ten unknowns.
const SMALL: usize = 32 << 10;

/// A specification, with what is asked of it whenever it comes again.
#[derive(Debug)]
pub struct Known {
    /// Itself.
    pub specification: Specification,
    /// What is to be known of it before it runs.
    pub facts: Facts,
    is_small: bool,
    answer: OnceLock<Repeated>,
}

/// The answer to it, of a solve that reached the end.
#[derive(Clone, Debug)]
pub struct Repeated {
    /// Who asked.
    client: Client,
    /// Steps that it took.
    pub steps: u64,
    /// The verdict on it.
    pub verdict: Option<Verdict>,
    /// Its results.
    pub results: Arc<Results>,
}

impl Known {
    /// Nothing is known of its answer.
    pub fn of(specification: Specification) -> Self {
        let facts = Facts::of(&specification);
        let is_plain =
            specification.model().dvi().is_some() && specification.study().is_none() && specification.sweep().is_none();
        Self { is_small: is_plain && facts.memory <= SMALL, facts, specification, answer: OnceLock::new() }
    }

    /// Whether no step of it takes longer than a glance.
    pub fn is_small(&self) -> bool {
        self.is_small
    }

    /// The answer to it, if there was one to that client.
    pub fn answer(&self, client: Client) -> Option<&Repeated> {
        self.answer.get().filter(|answer| answer.client == client)
    }

    /// Keeps the answer to it, if it is short.
    pub fn keep(&self, client: Client, ended: &Ended) {
        if let Some(Held::Memory(results)) = &ended.held
            && results.text().is_some_and(|json| json.len() <= SHORT)
        {
            let (steps, verdict, results) = (ended.steps, ended.verdict.clone(), Arc::clone(results));
            // Another solve of it gave the same.
            let _ = self.answer.set(Repeated { client, steps, verdict, results });
        }
    }
}
