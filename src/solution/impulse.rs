//! Impulses: what functions of the outputs gain over a jump of the states that a bound forces.

/// A jump of the states by impulses, as the outputs of the problem with multiples of these impulses as their variables.
#[derive(Clone, Debug)]
pub struct Impulse {
    /// Time of the jump.
    pub at: f64,
    /// Time from which on the states are those behind the jump.
    pub t: f64,
    /// With the states before the jump: the impulses times 0 and 1.
    pub before: [Vec<f64>; 2],
    /// With the states behind it: the impulses times 0, 1 and 2.
    pub after: [Vec<f64>; 3],
}

/// Difference of the effects of one impulse that is rounding, relative to their terms.
pub(super) const SAME_IMPULSE: f64 = 1e-9;

impl Impulse {
    /// The integrals of `count` functions over the impulse; `evaluate` writes them for a time and outputs of the problem. A
    /// function has an integral if it is affine in the impulses, with the same slope on both sides of the jump; of others, as
    /// the square of a variable, the integral is undefined: `None`.
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
