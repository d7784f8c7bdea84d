//! Measurements of a Radau IIA run for its verdict: the residual of the law at the ends of steps and at outputs, events
//! between the stages, the integral of rates with kinks, accumulations of switches, and states below their tolerance.

use super::{CheckCode, Checks, Plan, Screening};
use hybrid::OneStep;
use radau::{ALLOWED, End, Excess, Radau, Screened};

/// A state whose maximum is below this multiple of its absolute tolerance is hardly distinguishable from zero.
const SMALL: f64 = 10.0;

/// Largest error of a run with steps of a given size, relative to the largest values of the states: three digits, as
/// for the other checks of such runs, which have no tolerance.
pub(super) const GIVEN_STEPS: f64 = 1e-3;

/// A state this small beside the others is rounding of zero.
fn rounding_of(largest: &[f64]) -> f64 {
    1e-12 * largest.iter().copied().fold(0.0, f64::max)
}

/// Records the sum of the estimated errors of steps of a given size, relative to the largest values of the states; NaN is
/// not trusted.
pub(super) fn record_given_steps(sum: f64, checks: &mut Checks) {
    checks.record(CheckCode::LocalError, sum, GIVEN_STEPS, || {
        format!(
            "the steps have the size that `method` gives, and their errors are estimated to add up to {sum:.1e} of the \
             largest values of the states; give a smaller `step`, or none, so that the tolerances choose it"
        )
    });
}

/// The measurements of a run in progress.
pub(super) struct Audit<'p> {
    plan: &'p Plan,
    /// Whether the rates have kinks in states, which the error estimate may miss.
    has_kinks: bool,
    screening: Screening,
    /// Number of steps that qualified for a proof of freedom from events and failed it.
    open: u32,
    /// Number of steps in which rates may vary between the stages more than their values there show.
    hidden: u32,
    /// Sum of the estimated errors of each state over steps of a given size, raised to the power that gives them the order
    /// of the method.
    given_steps: Vec<f64>,
    checks: Checks,
}

impl<'p> Audit<'p> {
    pub fn new(plan: &'p Plan, has_kinks: bool) -> Self {
        Self {
            plan,
            has_kinks,
            screening: Screening::default(),
            open: 0,
            hidden: 0,
            given_steps: Vec::new(),
            checks: Checks::default(),
        }
    }

    /// Measures an accepted step and the values at its end.
    pub fn step(&mut self, radau: &mut Radau<'_>) {
        let t = radau.t();
        if let Some(found) = radau.law_excess_at_end() {
            self.record_excess(CheckCode::LawResidual, found, t);
        }
        self.screen(radau);
        self.hidden += u32::from(!radau.are_rates_shown());
        if let Some(distance) = radau.unlocated_switch() {
            self.record_unlocated(t, distance, radau.accumulations() > 0);
        }
        let errors = radau.given_step_errors();
        self.given_steps.resize(errors.len(), 0.0);
        self.given_steps.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error);
        if self.has_kinks
            && let Some((state, defect)) = radau.defect()
        {
            let name = &self.plan.names[state];
            self.checks.record(CheckCode::LocalError, defect, 1.0, || {
                format!(
                    "before t = {t:?} the change of `{name}` over a step differs from the integral of its rate by \
                     {defect:.1e} times what the tolerances allow: the rates have kinks or infinite slopes there; \
                     write them as a set"
                )
            });
        }
    }

    /// Records a step across a switch that could not be located; `distance` is in units of the tolerance.
    fn record_unlocated(&mut self, t: f64, distance: f64, accumulates: bool) {
        let (code, why) = match accumulates {
            true => (CheckCode::AccumulationPassed, "an accumulation of switches was stepped over"),
            false => (CheckCode::EventsUnproven, "a switch could not be located and was stepped over"),
        };
        self.checks.record(code, distance, ALLOWED, || {
            format!(
                "before t = {t:?} {why}: within that step it may change a state by {distance:.1e} times its tolerance"
            )
        });
    }

    fn screen(&mut self, radau: &mut Radau<'_>) {
        match radau.screened() {
            None => {}
            Some(Screened::Proven) => self.screening.proven += 1,
            Some(Screened::Undecided) => self.screening.undecided += 1,
            Some(Screened::Open) => {
                self.screening.undecided += 1;
                self.open += 1;
                let (t, open) = (radau.t(), self.open);
                self.checks.record(CheckCode::EventsUnproven, f64::from(open), 0.0, || {
                    format!(
                        "{open} steps, the last before t = {t:?}, are not proven free of events, and an event that \
                         begins and ends within one would not be seen; a smaller `max_step` may help"
                    )
                });
            }
            Some(Screened::Missed(t, found)) => {
                self.screening.missed += 1;
                let name = self.variable(found);
                self.checks.record(CheckCode::EventsUnproven, self.screening.missed as f64, 0.0, || {
                    format!(
                        "between two steps near t = {t:?} the inequality of `{name}` is violated by {:.1e} times what \
                         the tolerances allow: an event was missed or located at a wrong time; a smaller `max_step` \
                         may help",
                        found.excess
                    )
                });
            }
        }
    }

    /// Measures the values `y` at an output time within a step.
    pub fn output(&mut self, radau: &mut Radau<'_>, t: f64, y: &[f64]) {
        // Within rounding of an end of the step, data that jump may be on the other side of their jump than the face. At the
        // end of a step the law is measured with the step.
        let t = match radau.end_at(t) {
            Some(End::After) => return,
            Some(End::Before) => radau.begin(),
            None => t,
        };
        if let Some(found) = radau.law_excess(t, y) {
            self.record_excess(CheckCode::ConstraintResidual, found, t);
        }
    }

    fn variable(&self, found: Excess) -> &'p str {
        self.plan.names.get(self.plan.initial.len() + found.variable).map_or("?", String::as_str)
    }

    fn record_excess(&mut self, code: CheckCode, found: Excess, t: f64) {
        let name = self.variable(found);
        self.checks.record(code, found.excess, ALLOWED, || {
            format!(
                "at t = {t:?} the inequality of `{name}` fails by {:.1e} times what the tolerances leave uncertain; a tighter \
                 `rtol`, a smaller `max_step` or outputs at steps may help",
                found.excess
            )
        });
    }

    /// Completes the measurements of a run with the given absolute tolerances.
    pub fn finish(&mut self, radau: &Radau<'_>, atol: &[f64], checks: &mut Checks) -> Option<Screening> {
        self.look_for_small_states(radau.largest(), atol);
        if !self.given_steps.is_empty() {
            let power = radau.error_power();
            let rounding = rounding_of(&radau.largest()[..atol.len()]);
            let sizes = radau.largest().iter().map(|largest| largest.max(rounding).powf(power));
            let relative =
                self.given_steps.iter().zip(sizes).filter(|(sum, _)| **sum != 0.0).map(|(sum, size)| sum / size);
            record_given_steps(relative.fold(0.0, f64::max), &mut self.checks);
        }
        let Screening { proven, undecided, missed } = self.screening;
        if undecided > 0 {
            let steps = proven + undecided + missed;
            self.checks.caveat(
                "events_not_proven",
                format!(
                    "{undecided} of {steps} steps are not proven free of events; none was seen at the points examined"
                ),
            );
        }
        if self.hidden > 0 {
            self.checks.caveat(
                "rates_not_proven",
                format!(
                    "in {} steps functions of the states may vary more than their values at the stages show: a feature \
                     much narrower than a step may have been missed; a smaller `max_step` may help",
                    self.hidden
                ),
            );
        }
        checks.absorb(std::mem::take(&mut self.checks));
        (proven + undecided + missed > 0).then_some(self.screening)
    }

    /// Records the state that is smallest relative to its absolute tolerance.
    fn look_for_small_states(&mut self, largest: &[f64], atol: &[f64]) {
        let states = &largest[..atol.len()];
        let rounding = rounding_of(states);
        for ((name, atol), &largest) in self.plan.names.iter().zip(atol).zip(states) {
            if largest > rounding {
                self.checks.record(CheckCode::LocalError, SMALL * atol / largest, 1.0, || {
                    format!(
                        "`{name}` was never larger than {largest:e}, with an absolute tolerance of {atol:e}: give an \
                         `atol` far below the values of interest"
                    )
                });
            }
        }
    }
}
