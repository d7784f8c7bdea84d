//! Impulses of the variables at jumps of the states: the integrals of functions of the outputs over a jump that a
//! bound forces.

/// A jump of the states by an impulse, given by the outputs of the problem with multiples of the impulse as its
/// variables.
#[derive(Clone, Debug)]
pub struct Impulse {
    /// Time of the jump of the states.
    pub at: f64,
    /// First time at which the states are those after the jump.
    pub t: f64,
    /// The outputs of the problem for the states before the jump, with 0 and 1 times the impulse as variables.
    pub before: [Vec<f64>; 2],
    /// The outputs of the problem for the states after the jump, with 0, 1 and 2 times the impulse as variables.
    pub after: [Vec<f64>; 3],
}

/// Relative difference of the effects of an impulse before and after a jump below which they count as equal, the level
/// of rounding errors.
pub(super) const SAME_IMPULSE: f64 = 1e-9;

impl Impulse {
    /// Returns the integrals of `count` functions over the impulse; `evaluate` writes the functions for a time and
    /// outputs of the problem. The integral of a function exists if the function is affine in the impulse, with equal
    /// slopes on both sides of the jump; for others, such as the square of a variable, it is undefined: `None`.
    pub(super) fn integrals(
        &self,
        count: usize,
        mut evaluate: impl FnMut(f64, &[f64], &mut [f64]),
    ) -> impl Iterator<Item = Option<f64>> {
        let mut at = |outputs: &[f64]| {
            let mut values = vec![0.0; count];
            evaluate(self.t, outputs, &mut values);
            values
        };
        let [rest_before, once_before] = [0, 1].map(|share| at(&self.before[share]));
        let [rest, once, twice] = [0, 1, 2].map(|share| at(&self.after[share]));
        (0..count).map(move |k| {
            let over = once[k] - rest[k];
            let others = [once_before[k] - rest_before[k], twice[k] - once[k]];
            let sizes = [rest_before[k], once_before[k], rest[k], once[k], twice[k]];
            let size = sizes.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            others.iter().all(|other| (over - other).abs() <= SAME_IMPULSE * size).then_some(over)
        })
    }
}
