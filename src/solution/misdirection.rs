//! Displacement of a body by impacts with an error of direction or speed: the relative error of the velocity after an
//! impact, times the path length since the impact. The error of a body at rest does not grow, unless an impact has
//! stopped the body in error.

/// Errors of the direction of a body's velocity due to impacts, and the position errors that follow. Errors of single
/// impacts are independent: their squares are summed, component by component.
#[derive(Clone, Debug, Default)]
pub(super) struct Misdirection {
    /// The path length of the body so far, measured in the norm of the given speeds.
    way: f64,
    /// The speed that impacts have removed from the body in error, less the speed that the body would have lost since
    /// without the error.
    taken: f64,
    /// For each component, the sums of `e^2`, `e^2 s` and `e^2 s^2` over the impacts, where `e` is the error of the
    /// velocity relative to the speed and `s` is the path length before the impact.
    sums: Vec<[f64; 3]>,
}

impl Misdirection {
    /// Adds a step of length `h` with the speed `speed` at its end, and the error of each velocity component by
    /// impacts in the step. These impacts removed the speed `taken` in error; a body with that speed would have lost
    /// `lost` of it in the step.
    pub fn step(&mut self, h: f64, speed: f64, [taken, lost]: [f64; 2], error: &[f64]) {
        self.sums.resize(error.len(), [0.0; 3]);
        self.taken = (self.taken - lost).max(taken).max(0.0);
        let possible = speed.max(self.taken);
        self.way += h * possible;
        self.err(error, possible, self.way);
    }

    /// Adds an error of each velocity component by an impact that lies `ago` in the past, when the error becomes
    /// known only at the current time, where the speed is `speed`. The impact may have removed as much speed in error
    /// as the norm of the error.
    pub fn mistake(&mut self, ago: f64, speed: f64, error: &[f64]) {
        self.sums.resize(error.len(), [0.0; 3]);
        self.taken = self.taken.max(size_of(error));
        let possible = speed.max(self.taken);
        self.err(error, possible, self.way - ago * possible);
    }

    /// Adds an error of each velocity component of the body, at the speed `speed`, from the path length `since` on.
    fn err(&mut self, error: &[f64], speed: f64, since: f64) {
        // The relative error of a direction is at most one.
        let speed = size_of(error).max(speed);
        if speed <= 0.0 {
            return;
        }
        for (sums, error) in self.sums.iter_mut().zip(error) {
            let square = (error / speed).powi(2);
            sums.iter_mut().zip([1.0, since, since * since]).for_each(|(sum, power)| *sum += square * power);
        }
    }

    /// Whether any velocity component of the body has an error due to impacts.
    pub fn is_any(&self) -> bool {
        self.sums.iter().any(|[one, ..]| *one > 0.0)
    }

    /// Clears the errors of the components that contacts hold fixed: a body at rest in a direction forgets the errors
    /// of earlier impacts.
    pub fn hold(&mut self, held: &[bool]) {
        self.sums.iter_mut().zip(held).filter(|(_, held)| **held).for_each(|(sums, _)| *sums = [0.0; 3]);
    }

    /// Returns the errors of the position components of the body that impacts with errors have caused.
    pub fn of_place(&self) -> impl Iterator<Item = f64> {
        let way = self.way;
        self.sums.iter().map(move |[one, first, second]| (one * way * way - 2.0 * first * way + second).max(0.0).sqrt())
    }

    /// Returns the errors that impacts have caused in the velocity components of a body with the given speed.
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
        // The second velocity component has an error of 0.2 for one second.
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
        // The second velocity component has an error of 0.2 for one second.
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
        // Sum of the speeds 2.5, 2, .., 0 over steps of 0.1.
        assert_near(misdirection.of_place(), [3.75, 0.0]);
        assert_near(misdirection.of_velocity(0.0), [0.0, 0.0]);
    }
}
