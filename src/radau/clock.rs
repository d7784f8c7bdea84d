//! Time along a run, by compensated summation: the rounding error of a step is added to the next step, since the errors
//! of many short steps would add up (Kahan 1965, *Further remarks on reducing truncation errors*).

/// The time reached in a run, and its end time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    pub t: f64,
    /// Kahan compensation: the part of the steps that rounding removed from `t`.
    t_compensation: f64,
    end: f64,
}

impl Clock {
    pub fn new(t: f64, end: f64) -> Self {
        Self { t, t_compensation: 0.0, end }
    }

    /// Returns the time from the present time to the end of the run.
    pub fn remaining(&self) -> f64 {
        (self.end - self.t) - self.t_compensation
    }

    pub fn is_done(&self) -> bool {
        self.t >= self.end
    }

    /// Whether a step of size `h` from the present time ends at a later floating-point number.
    pub fn resolves(&self, h: f64) -> bool {
        self.t + (h + self.t_compensation) != self.t
    }

    /// Advances the time by `h`, but not beyond the end of the run.
    pub fn advance(&mut self, h: f64) {
        if h >= self.remaining() {
            (self.t, self.t_compensation) = (self.end, 0.0);
            return;
        }
        let (t, step) = (self.t, h + self.t_compensation);
        self.t = t + step;
        let taken = self.t - t;
        self.t_compensation = (t - (self.t - taken)) + (step - taken);
    }

    /// Sets the time reached to the end of the run if it is beyond that end.
    pub fn stay(&mut self) {
        self.t = self.t.min(self.end);
    }

    /// Sets the time reached to `t`, without a compensation for earlier rounding.
    pub fn set(&mut self, t: f64) {
        (self.t, self.t_compensation) = (t, 0.0);
    }

    /// Returns a bound on the rounding error of the time at the end of a step of size `h`.
    pub fn rounding(&self, h: f64) -> f64 {
        8.0 * f64::EPSILON * (self.t.abs() + h)
    }
}

#[cfg(test)]
mod tests {
    use super::Clock;

    #[test]
    fn a_million_short_steps_come_to_their_sum() {
        let mut clock = Clock::new(0.0, 1e6);
        (0..1_000_000).for_each(|_| clock.advance(0.1));
        assert_eq!(clock.t, 1e5);
        clock.advance(1e6);
        assert!(clock.is_done() && clock.t == 1e6);
    }
}
