//! Evidence of the error of a run whose step size is given by the user, without control by a tolerance.

use super::{CheckCode, Checks};
use radau::{GivenStep, Radau};

/// Largest error of a run with steps of a given size, relative to the largest values of the states: three digits, as
/// for the other checks of runs without a tolerance.
pub(super) const GIVEN_STEPS: f64 = 1e-3;

/// Returns the size of a state, derived from the largest values of all states, below which the state counts as a
/// rounding error of zero.
pub(super) fn rounding_of(largest: &[f64]) -> f64 {
    1e-12 * largest.iter().copied().fold(0.0, f64::max)
}

/// Whether an error exceeds the largest error so far, `most`; NaN exceeds any number.
pub(super) fn is_worse(error: f64, most: f64) -> bool {
    error > most || error.is_nan()
}

/// Records the check of the sum of the estimated errors of steps of a given size, relative to the largest values of
/// the states; a sum of NaN is not trusted.
pub(super) fn record_given_steps(sum: f64, checks: &mut Checks) {
    checks.record(CheckCode::LocalError, sum, GIVEN_STEPS, || {
        format!(
            "the steps have the size that `method` gives, and their errors are estimated to add up to {sum:.1e} of the \
             largest values of the states; give a smaller `step`, or none, so that the tolerances choose it"
        )
    });
}

/// Evidence of the error of a run with steps of a given size, for each state.
#[derive(Default)]
pub(super) struct GivenSteps {
    /// For each state, the sum over the steps of the estimated errors at their ends. Each estimate is raised to the
    /// power `power`, which raises its order to the order of the method.
    at_ends: Vec<f64>,
    /// For each state, the largest estimated error within a step, over the steps whose interpolated values are in use.
    within: Vec<f64>,
    /// For each state, the sum over the steps of the errors due to variations of the rates between the stages of a
    /// step.
    missed: Vec<f64>,
    /// Number of steps with a switch in which functions of time vary by more than their values at the ends and in the
    /// middle of the step show.
    blind: u32,
    /// The largest absolute value of each state in the run so far.
    largest: Vec<f64>,
    /// The power to which the estimated errors of states at the ends of steps are raised, so that their order becomes
    /// that of the method.
    power: f64,
}

impl GivenSteps {
    /// Adds the last step of the method `radau`; successive calls may pass different methods, such as one for each
    /// phase of a motion.
    pub fn add(&mut self, radau: &Radau<'_>) {
        let step = radau.given_step();
        let states = step.at_end.len();
        let Self { at_ends, missed, .. } = self;
        for (sums, errors) in [(at_ends, &step.at_end), (missed, &step.missed)] {
            sums.resize(states, 0.0);
            sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error);
        }
        self.within.resize(states, 0.0);
        self.blind += u32::from(step.is_blind);
        self.largest.resize(states, 0.0);
        self.largest.iter_mut().zip(radau.largest()).for_each(|(most, largest)| *most = most.max(*largest));
        self.power = radau.error_power();
    }

    /// Records that values interpolated within this step are in use, so that the estimated errors of the interpolation
    /// count.
    pub fn use_within(&mut self, step: &GivenStep) {
        self.within.resize(step.within.len(), 0.0);
        let errors = self.within.iter_mut().zip(&step.within);
        errors.filter(|(most, error)| is_worse(**error, **most)).for_each(|(most, error)| *most = *error);
    }

    /// Records checks of the largest errors of steps of a given size relative to the largest values of the states,
    /// except for states that are held at zero; records nothing if no step had a given size.
    pub fn judge(&self, held_at_zero: impl FnOnce() -> Vec<bool>, checks: &mut Checks) {
        if self.at_ends.is_empty() {
            return;
        }
        let held_at_zero = held_at_zero();
        let Self { largest, power, .. } = self;
        let rounding = rounding_of(largest);
        let worst = |errors: &[f64], power: f64| {
            let states = (0..largest.len())
                .filter(|&state| errors[state] != 0.0 && !held_at_zero.get(state).is_some_and(|zero| *zero));
            let relative = states.map(|state| errors[state] / largest[state].max(rounding).powf(power));
            relative.fold(0.0, |most: f64, error| if is_worse(error, most) { error } else { most })
        };
        record_given_steps(worst(&self.at_ends, *power), checks);
        let within = worst(&self.within, 1.0);
        checks.record(CheckCode::LocalError, within, GIVEN_STEPS, || {
            format!(
                "the steps have the size that `method` gives, and values between their ends are estimated to be off by up to \
                 {within:.1e} of the largest values of the states; give outputs at the ends of steps, a smaller `step`, or none"
            )
        });
        let missed = worst(&self.missed, 1.0);
        checks.record(CheckCode::LocalError, missed, GIVEN_STEPS, || {
            format!(
                "the steps have the size that `method` gives, and their stages miss variations of the rates between them \
                 that are worth {missed:.1e} of the largest values of the states; give a smaller `step`, or none"
            )
        });
        let blind = self.blind;
        checks.record(CheckCode::EventsUnproven, f64::from(blind), 0.0, || {
            format!(
                "within {blind} steps of the size that `method` gives a variable switches, and data vary by more than \
                 the ends and the middle of the step show; give a smaller `step`, or none"
            )
        });
    }
}
