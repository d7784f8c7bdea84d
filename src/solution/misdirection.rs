//! How far bodies get from their ways by impacts whose directions are off: by the angle that an impact gives to the velocity, times
//! the way since. A body that comes to rest goes no further astray.

use nalgebra::Vector3;

/// Errors of the direction of a velocity, and what they make of the place. Errors of single impacts are independent: their squares
/// are summed, component by component.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Misdirection {
    /// The way of the body.
    way: f64,
    /// The sums of `e^2`, `e^2 s` and `e^2 s^2` over the impacts, with the relative errors `e` of the velocity and the ways `s` before
    /// them.
    sums: [Vector3<f64>; 3],
}

impl Misdirection {
    /// Adds a step of length `h`, at whose end the body has the velocity `velocity`, which impacts in the step have given an error.
    pub fn step(&mut self, h: f64, velocity: &Vector3<f64>, error: &Vector3<f64>) {
        let speed = velocity.norm();
        self.way += h * speed;
        if speed > 0.0 && *error != Vector3::zeros() {
            let square = (error / speed).map(|relative| relative * relative);
            for (sum, power) in self.sums.iter_mut().zip([1.0, self.way, self.way * self.way]) {
                *sum += square * power;
            }
        }
    }

    /// The error of the place.
    pub fn of_place(&self) -> Vector3<f64> {
        let [one, first, second] = &self.sums;
        let square = one * (self.way * self.way) - first * (2.0 * self.way) + second;
        square.map(|square| square.max(0.0).sqrt())
    }

    /// The error of a velocity of the given speed.
    pub fn of_velocity(&self, speed: f64) -> Vector3<f64> {
        self.sums[0].map(f64::sqrt) * speed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_of_direction_grows_with_the_way_and_stops_with_the_body() {
        let mut misdirection = Misdirection::default();
        let velocity = Vector3::new(2.0, 0.0, 0.0);
        misdirection.step(0.1, &velocity, &Vector3::zeros());
        misdirection.step(0.1, &velocity, &Vector3::new(0.0, 0.2, 0.0));
        for _ in 0..10 {
            misdirection.step(0.1, &velocity, &Vector3::zeros());
        }
        // A second at 0.2 across.
        assert!((misdirection.of_place() - Vector3::new(0.0, 0.2, 0.0)).norm() < 1e-12);
        assert!((misdirection.of_velocity(1.0) - Vector3::new(0.0, 0.1, 0.0)).norm() < 1e-12);
        misdirection.step(5.0, &Vector3::zeros(), &Vector3::zeros());
        assert!((misdirection.of_place() - Vector3::new(0.0, 0.2, 0.0)).norm() < 1e-12);
    }
}
