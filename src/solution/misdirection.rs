//! How far a motion gets from its way by impacts whose directions or speeds are off: by the part of the velocity that an impact
//! gives in error, times the way since. What comes to rest goes no further astray, unless an impact has stopped it in error.

/// Errors of the direction of a velocity, and the errors of the place that follow. Errors of single impacts are independent: their squares
/// are summed, component by component.
#[derive(Clone, Debug, Default)]
pub(super) struct Misdirection {
    /// The way so far, in the norm of the speeds given.
    way: f64,
    /// The speed that impacts have taken in error and that is not lost otherwise since.
    taken: f64,
    /// For each component the sums of `e^2`, `e^2 s` and `e^2 s^2` over the impacts, with the errors `e` of the velocity relative
    /// to the speed and the ways `s` before them.
    sums: Vec<[f64; 3]>,
}

impl Misdirection {
    /// Adds a step of length `h` with the speed `speed` at its end, and the error that impacts in the step gave each component of the
    /// velocity. They took the speed `taken` in error; a body with that speed would have lost `lost` of it in the step.
    pub fn step(&mut self, h: f64, speed: f64, [taken, lost]: [f64; 2], error: &[f64]) {
        self.sums.resize(error.len(), [0.0; 3]);
        self.taken = (self.taken - lost).max(taken).max(0.0);
        let possible = speed.max(self.taken);
        self.way += h * possible;
        self.err(error, possible, self.way);
    }

    /// Adds an error that an impact gave each component of the velocity some time `ago`, and that is known only now, where the speed
    /// is `speed`. It took as much of the speed in error as it may have changed of it.
    pub fn mistake(&mut self, ago: f64, speed: f64, error: &[f64]) {
        self.sums.resize(error.len(), [0.0; 3]);
        self.taken = self.taken.max(size_of(error));
        let possible = speed.max(self.taken);
        self.err(error, possible, self.way - ago * possible);
    }

    /// Adds an error that each component of the velocity has, at a speed, from a way on.
    fn err(&mut self, error: &[f64], speed: f64, since: f64) {
        // A direction is off by no more than all of it.
        let speed = size_of(error).max(speed);
        if speed <= 0.0 {
            return;
        }
        for (sums, error) in self.sums.iter_mut().zip(error) {
            let square = (error / speed).powi(2);
            sums.iter_mut().zip([1.0, since, since * since]).for_each(|(sum, power)| *sum += square * power);
        }
    }

    /// Whether a velocity is off.
    pub fn is_any(&self) -> bool {
        self.sums.iter().any(|[one, ..]| *one > 0.0)
    }

    /// Clears the errors of the components that contacts hold: a body rests in such a direction, whatever earlier impacts were off by.
    pub fn hold(&mut self, held: &[bool]) {
        self.sums.iter_mut().zip(held).filter(|(_, held)| **held).for_each(|(sums, _)| *sums = [0.0; 3]);
    }

    /// The errors of the components of the place.
    pub fn of_place(&self) -> impl Iterator<Item = f64> {
        let way = self.way;
        self.sums.iter().map(move |[one, first, second]| (one * way * way - 2.0 * first * way + second).max(0.0).sqrt())
    }

    /// The errors of the components of a velocity of the given speed.
    pub fn of_velocity(&self, speed: f64) -> impl Iterator<Item = f64> {
        let speed = speed.max(self.taken);
        self.sums.iter().map(move |[one, ..]| one.sqrt() * speed)
    }
}

fn size_of(error: &[f64]) -> f64 {
    error.iter().map(|error| error * error).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_near(found: impl Iterator<Item = f64>, wanted: [f64; 2]) {
        let found: Vec<f64> = found.collect();
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn an_error_of_direction_grows_with_the_way_and_stops_with_the_body() {
        let mut misdirection = Misdirection::default();
        misdirection.step(0.1, 2.0, [0.0; 2], &[0.0, 0.0]);
        misdirection.step(0.1, 2.0, [0.0; 2], &[0.0, 0.2]);
        for _ in 0..10 {
            misdirection.step(0.1, 2.0, [0.0; 2], &[0.0, 0.0]);
        }
        // A second at 0.2 across.
        assert_near(misdirection.of_place(), [0.0, 0.2]);
        assert_near(misdirection.of_velocity(1.0), [0.0, 0.1]);
        misdirection.step(5.0, 0.0, [0.0; 2], &[0.0, 0.0]);
        assert_near(misdirection.of_place(), [0.0, 0.2]);
    }

    #[test]
    fn a_mistake_known_late_counts_from_the_time_of_the_impact_on() {
        let mut misdirection = Misdirection::default();
        for _ in 0..4 {
            misdirection.step(0.1, 2.0, [0.0; 2], &[0.0, 0.0]);
        }
        misdirection.mistake(0.3, 2.0, &[0.0, 0.2]);
        assert_near(misdirection.of_place(), [0.0, 0.06]);
        for _ in 0..7 {
            misdirection.step(0.1, 2.0, [0.0; 2], &[0.0, 0.0]);
        }
        // A second at 0.2 across.
        assert_near(misdirection.of_place(), [0.0, 0.2]);
    }

    #[test]
    fn what_an_impact_stops_in_error_is_off_until_it_would_have_come_to_rest() {
        let mut misdirection = Misdirection::default();
        misdirection.step(0.1, 0.0, [3.0, 0.0], &[3.0, 0.0]);
        for _ in 0..10 {
            misdirection.step(0.1, 0.0, [0.0; 2], &[0.0, 0.0]);
        }
        assert_near(misdirection.of_place(), [3.0, 0.0]);
        assert_near(misdirection.of_velocity(0.0), [3.0, 0.0]);
        for _ in 0..10 {
            misdirection.step(0.1, 0.0, [0.0, 0.5], &[0.0, 0.0]);
        }
        // 2.5, 2, .., 0 in steps of 0.1.
        assert_near(misdirection.of_place(), [3.75, 0.0]);
        assert_near(misdirection.of_velocity(0.0), [0.0, 0.0]);
    }
}
