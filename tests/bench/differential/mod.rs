//! The same problem solved in many ways must have the same answer.
//!
//! Random problems of every kind are solved at two tolerances, with every number of stages, with outputs at the steps and
//! between them, in other units, and to a later end; every tenth also by an independent method. Runs that disagree by more than
//! a hundred tolerances, times the growth of small changes that is measured beside them, are wrong: in silence where their
//! verdict trusts them, caught where it does not. What agrees and is not trusted is a false alarm.

mod experiment;
mod failures;
mod generators;
mod judgement;
pub mod linear;
mod problem;
mod random;
pub mod reference;
pub mod signal;
mod solving;
mod tally;

pub use problem::Kind;
pub use tally::Tally;

use experiment::{Conditions, experiment};
use failures::Failures;
use judgement::judge;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;
use std::time::Duration;

/// A number of random problems.
pub struct Campaign {
    pub count: u64,
    /// Of the first problem; each has the next.
    pub seed: u64,
    pub kinds: Vec<Kind>,
    /// Of each solve.
    pub time: Duration,
    /// Every so many problems are compared with an independent method.
    pub reference_every: u64,
    /// Where specifications of wrong runs are written.
    pub failures: Option<PathBuf>,
    /// Whether every problem with a finding is told as it is met.
    pub tells: bool,
    /// Problems that are solved at once.
    pub threads: usize,
}

impl Campaign {
    /// Solves all problems, the kinds in turn.
    pub fn run(&self) -> Tally {
        let (failures, next) = (Failures::new(self.failures.clone()), AtomicU64::new(0));
        let mut tally = Tally::default();
        thread::scope(|scope| {
            let workers: Vec<_> = (0..self.threads).map(|_| scope.spawn(|| self.work(&next, &failures))).collect();
            workers.into_iter().for_each(|worker| tally.merge(worker.join().expect("a worker that ends")));
        });
        tally
    }

    /// Takes one problem after the other while there are any.
    fn work(&self, next: &AtomicU64, failures: &Failures) -> Tally {
        let mut tally = Tally::default();
        loop {
            let k = next.fetch_add(1, Relaxed);
            if k >= self.count {
                return tally;
            }
            let seed = self.seed + k;
            let kind = self.kinds[(k % self.kinds.len() as u64) as usize];
            let problem = problem::generate(kind, seed);
            let reference = (k / self.kinds.len() as u64).is_multiple_of(self.reference_every);
            let mut experiment = experiment(problem.as_ref(), &Conditions { seed, time: self.time, reference });
            let mut judgement = judge(&experiment, problem.is_unique());
            // Where runs disagree most of them may be wrong: an independent method decides, if there is one.
            if judgement.has_wrong_runs() && experiment.reference.is_none() {
                experiment.reference = problem.reference(&[], &experiment.times);
                judgement = judge(&experiment, problem.is_unique());
            }
            let told = tally.add(kind, seed, &experiment, &judgement);
            if self.tells && !told.is_empty() {
                println!("{told}");
            }
            failures.keep(kind, seed, &experiment, &judgement);
        }
    }
}
