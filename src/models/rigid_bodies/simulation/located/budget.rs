//! The number of smooth arcs that an event-driven run may make before time stepping takes over.
//!
//! An arc costs about as much as a step of time stepping. For a relative error `e = 0.01`, time stepping, of first
//! order, takes about ten times as many steps as arcs of second order are needed: `1/e` against `1/sqrt(e)`. Up to
//! ten arcs per step are therefore worth their cost. Impacts come in bursts, for example when a ball comes to rest:
//! arcs that steps do not use are saved for later steps. When no arcs are left, as in a heap that collapses, time
//! stepping takes over until as many arcs have been saved again; each further time for twice as long, so that the
//! attempts cost little however long there are many impacts.

/// The number of smooth arcs that each step of an event-driven run adds to the run's budget.
const ARCS_A_STEP: f64 = 10.0;

/// Maximum number of smooth arcs in the budget of an event-driven run: the first number, plus the second for each
/// moving body. A ball makes some tens of impacts before it rests.
const SAVED: [f64; 2] = [64.0, 1.0];

/// The budget of an event-driven run: the number of smooth arcs that it may still make.
#[derive(Clone, Copy, Debug)]
pub(super) struct Budget {
    /// The number of smooth arcs that the run may still make, and (in `most`) the maximum of this number.
    arcs: f64,
    most: f64,
    /// The step length for which the budget grows by [`ARCS_A_STEP`] smooth arcs in each step; a step of another
    /// length adds arcs in proportion. A comparison run with steps twice as long has the same value, so that it may
    /// make as many arcs per unit of time.
    step: f64,
    /// Whether the current step is made by time stepping, and (in `pause`) the time for which time stepping goes on
    /// after this step.
    is_paused: bool,
    pause: f64,
    /// The time for which time stepping takes over when the budget of smooth arcs is exhausted the next time.
    next: f64,
}

impl Budget {
    /// Creates a full budget of smooth arcs for a run with steps of length `step` and `bodies` moving bodies.
    pub fn new(step: f64, bodies: usize) -> Self {
        let [at_least, of_body] = SAVED;
        let most = at_least + of_body * bodies as f64;
        Self { arcs: most, most, step, is_paused: false, pause: 0.0, next: most / ARCS_A_STEP * step }
    }

    /// Returns the number of smooth arcs that the next step, of length `h`, may make; zero for time stepping.
    pub fn most(&mut self, h: f64) -> usize {
        self.arcs = (self.arcs + ARCS_A_STEP * h / self.step).min(self.most);
        // Compare the remaining time of time stepping with a tolerance, since the sum of step lengths has rounding
        // errors.
        self.is_paused = self.pause > 1e-6 * h;
        self.pause = (self.pause - h).max(0.0);
        if self.is_paused { 0 } else { self.arcs as usize }
    }

    /// Deducts the smooth arcs of a step of length `h` from the budget; `is_passed` states whether time stepping took
    /// over for the rest of the step.
    pub fn spend(&mut self, arcs: usize, h: f64, is_passed: bool) {
        if self.is_paused {
            return;
        }
        if is_passed {
            (self.arcs, self.pause) = (0.0, self.next);
            self.next *= 2.0;
            return;
        }
        self.arcs -= arcs as f64;
        if self.arcs + ARCS_A_STEP * h / self.step >= self.most {
            self.next = self.most / ARCS_A_STEP * self.step;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the number of smooth arcs that a run makes in `steps` steps if each step needs `needed` arcs.
    fn made(needed: usize, steps: usize) -> usize {
        let mut budget = Budget::new(0.1, 36);
        let of_step = |_| {
            let most = budget.most(0.1);
            let arcs = needed.min(most).max(1);
            budget.spend(arcs, 0.1, needed > most);
            arcs
        };
        (0..steps).map(of_step).sum()
    }

    #[test]
    fn impacts_that_are_worth_it_are_located_for_ever() {
        assert_eq!(made(10, 10_000), 100_000);
    }

    #[test]
    fn a_burst_is_located_and_a_heap_is_not() {
        assert_eq!(made(50, 2), 100);
        // The run makes a hundred smooth arcs (the full budget), and again after 10, 20, 40, .. steps: at most ten
        // times in ten thousand steps.
        let arcs = made(1000, 10_000);
        assert!(arcs <= 10_000 + 10 * 100, "{arcs}");
    }

    #[test]
    fn longer_steps_may_make_as_many_arcs_in_a_time() {
        let [mut one, mut two] = [Budget::new(0.1, 36); 2];
        for _ in 0..100 {
            for _ in 0..2 {
                let most = one.most(0.1);
                one.spend(8.min(most), 0.1, most < 8);
            }
            let most = two.most(0.2);
            two.spend(16.min(most), 0.2, most < 16);
        }
        assert_eq!([one, two].map(|budget| (budget.arcs, budget.pause)), [(92.0, 0.0), (84.0, 0.0)]);
    }
}
