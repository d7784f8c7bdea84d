//! Time along a run. The rounding errors of many short steps would else add up, so what rounding takes from one is added to the
//! next (Kahan 1965, *Further remarks on reducing truncation errors*).

/// The time reached and the end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    pub t: f64,
    /// What rounding took from `t`.
    lag: f64,
    end: f64,
}

impl Clock {
    pub fn new(t: f64, end: f64) -> Self {
        Self { t, lag: 0.0, end }
    }

    /// The time left.
    pub fn remaining(&self) -> f64 {
        (self.end - self.t) - self.lag
    }

    pub fn is_done(&self) -> bool {
        self.t >= self.end
    }

    /// Whether a step of size `h` ends at a later number.
    pub fn resolves(&self, h: f64) -> bool {
        self.t + (h + self.lag) != self.t
    }

    /// Goes on by `h`, not beyond the end.
    pub fn advance(&mut self, h: f64) {
        if h >= self.remaining() {
            (self.t, self.lag) = (self.end, 0.0);
            return;
        }
        let (t, step) = (self.t, h + self.lag);
        self.t = t + step;
        let taken = self.t - t;
        self.lag = (t - (self.t - taken)) + (step - taken);
    }

    /// Goes on from `t`.
    pub fn set(&mut self, t: f64) {
        (self.t, self.lag) = (t, 0.0);
    }

    /// What rounding makes of the end of a step of this size.
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
