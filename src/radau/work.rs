//! Counters of a run: evaluations, factorisations, Newton iterations and their convergence rates.

/// Counts of the work of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Number of evaluations of `F` and `G`.
    pub rates: u64,
    /// Number of evaluations of the derivatives (Jacobians) of `F` and `G`.
    pub jacobians: u64,
    /// Number of factorisations of matrices; a real and a complex one of the stage equations count as one each.
    pub factorisations: u64,
    /// Number of Newton iterations on the stages.
    pub newton: u64,
    /// Convergence rates of the Newton iterations on the stages.
    pub contraction: Rates,
}

/// Convergence rates of Newton's method on the stages, observed in solves that took more than one iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    count: u64,
    sum: f64,
    largest: f64,
}

impl Rates {
    /// Records a convergence rate: the ratio of the norms of two successive Newton increments.
    pub fn observe(&mut self, rate: f64) {
        self.count += 1;
        self.sum += rate;
        self.largest = self.largest.max(rate);
    }

    /// Returns the mean and the largest convergence rate of Newton's method; `None` if no rate was observed.
    pub fn summary(&self) -> Option<(f64, f64)> {
        (self.count > 0).then(|| (self.sum / self.count as f64, self.largest))
    }
}
