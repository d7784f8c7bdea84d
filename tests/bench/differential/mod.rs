//! Differential testing: the solution of a problem must not depend on how it is solved.
//!
//! Random problems of every kind are solved at two tolerances, with every number of stages, with output at the steps
//! and between them, in other units, and to a later end; every tenth problem also by an independent method. A run is
//! wrong if it disagrees by more than a hundred tolerances, times the measured growth of small perturbations:
//! silently wrong if its verdict trusts it, caught otherwise. A correct run that is not trusted is a false alarm. A
//! run to a later end is compared up to the end of the others only, so that it is a false alarm only if runs with the
//! same method that end there are not trusted either.

pub mod derivatives;
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

/// A campaign of random problems, each solved by several runs that are compared with each other.
pub struct Campaign {
    pub count: u64,
    /// The seed of the first problem; each further problem has the next seed.
    pub seed: u64,
    pub kinds: Vec<Kind>,
    /// The time limit of each solve.
    pub time: Duration,
    /// The ratio of all problems to those that are compared with an independent method.
    pub reference_every: u64,
    /// The folder for specifications of wrong runs.
    pub failures: Option<PathBuf>,
    /// Whether each wrong run is reported immediately.
    pub tells: bool,
    /// The number of problems solved in parallel.
    pub threads: usize,
}

impl Campaign {
    /// Solves all problems of the campaign, cycling through the kinds of problems.
    pub fn run(&self) -> Tally {
        let (failures, next) = (Failures::new(self.failures.clone()), AtomicU64::new(0));
        let mut tally = Tally::default();
        thread::scope(|scope| {
            let workers: Vec<_> = (0..self.threads).map(|_| scope.spawn(|| self.work(&next, &failures))).collect();
            workers.into_iter().for_each(|worker| tally.merge(worker.join().expect("a worker that ends")));
        });
        tally
    }

    /// Solves problems of the campaign in one thread until none is left.
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
            // If runs disagree, most of them may be wrong: an independent method decides, if there is one.
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
