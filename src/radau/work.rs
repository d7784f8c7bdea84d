//! Counters of a run: evaluations, factorisations, Newton iterations and their convergence rates.

/// Counts of the work of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Number of evaluations of `F` and `G`.
    pub rates: u64,
    /// Number of evaluations of the derivatives of `F` and `G`.
    pub jacobians: u64,
    /// Number of factorisations; a real and a complex one of the stage equations count as one each.
    pub factorisations: u64,
    /// Number of Newton iterations on the stages.
    pub newton: u64,
    /// Convergence rates of the Newton iterations.
    pub contraction: Rates,
}

/// Convergence rates of Newton's method, observed in solves that took more than one iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    count: u64,
    sum: f64,
    largest: f64,
}

impl Rates {
    /// Records a convergence rate: the ratio of two successive increments.
    pub fn observe(&mut self, rate: f64) {
        self.count += 1;
        self.sum += rate;
        self.largest = self.largest.max(rate);
    }

    /// Returns the mean and the largest convergence rate; `None` if no rate was observed.
    pub fn summary(&self) -> Option<(f64, f64)> {
        (self.count > 0).then(|| (self.sum / self.count as f64, self.largest))
    }
}
