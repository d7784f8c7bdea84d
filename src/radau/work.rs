//! The counters of a run: evaluations, factorisations, Newton iterations and how fast these converged.

/// What was evaluated, and how often.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Evaluations of `F` and `G`.
    pub rates: u64,
    /// Evaluations of their derivatives.
    pub jacobians: u64,
    /// Factorisations, a real and a complex one counted as one each.
    pub factorisations: u64,
    /// Newton iterations on the stages.
    pub newton: u64,
    /// How fast its increments shrank.
    pub contraction: Rates,
}

/// The rates of convergence of Newton's method, where it took more than one iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    count: u64,
    sum: f64,
    largest: f64,
}

impl Rates {
    /// Takes a rate into account: the factor from one increment to the next.
    pub fn observe(&mut self, rate: f64) {
        self.count += 1;
        self.sum += rate;
        self.largest = self.largest.max(rate);
    }

    /// The mean and the largest; none where no rate was seen.
    pub fn summary(&self) -> Option<(f64, f64)> {
        (self.count > 0).then(|| (self.sum / self.count as f64, self.largest))
    }
}
