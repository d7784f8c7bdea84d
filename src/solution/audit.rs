//! Measurements of a Radau IIA run for its verdict: the residual of the variational inequality at the ends of steps
//! and at outputs, events between the stages, the integral of rates with kinks, accumulations of switches, and states
//! below their tolerance.

use super::given_steps::{GivenSteps, rounding_of};
use super::{CheckCode, Checks, Plan, Screening};
use hybrid::OneStep;
use radau::{ALLOWED, End, Excess, Radau, Screened};

/// Multiple of the absolute tolerance of a state below which the largest value of the state is hardly distinguishable
/// from zero.
pub(super) const SMALL: f64 = 10.0;

/// The measurements of a run in progress for its verdict.
pub(super) struct Audit<'p> {
    plan: &'p Plan,
    /// Whether the rates, as functions of the states, have kinks, which the error estimate may miss.
    has_kinks: bool,
    screening: Screening,
    /// Number of steps that could not be proven free of events although the states determine every monitor (event
    /// function).
    open: u32,
    /// Number of steps in which rates may vary between the stages more than their values at the stages show.
    hidden: u32,
    given_steps: GivenSteps,
    /// Whether values interpolated within steps are used in every step of the run, and not only at output times.
    is_dense: bool,
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
            given_steps: GivenSteps::default(),
            is_dense: plan.statistics
                || plan.interpolants.is_some()
                || plan.reducers.as_ref().is_some_and(|reducers| reducers.is_dense())
                || plan.observables.is_followed(),
            checks: Checks::default(),
        }
    }

    /// Measures an accepted step of Radau IIA and the values at its end.
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
        self.given_steps.add(radau);
        if self.is_dense {
            self.given_steps.use_within(radau.given_step());
        }
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

    /// Records the check of a step across a switch that could not be located; `distance` is in units of the
    /// tolerance.
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

    /// Measures the residual of the variational inequality for the states and variables `y` at an output time within a
    /// step.
    pub fn output(&mut self, radau: &mut Radau<'_>, t: f64, y: &[f64]) {
        // If the output time is an end of the step up to rounding, data that jump there may already have the values
        // after the jump while the active face is the one before it, or the reverse. The residual at the end of a
        // step is measured when the step is accepted.
        let t = match radau.end_at(t) {
            Some(End::After) => return,
            Some(End::Before) => radau.begin(),
            None => {
                self.given_steps.use_within(radau.given_step());
                t
            }
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

    /// Completes the measurements of a run with the given absolute tolerances, and moves them to `checks`.
    pub fn finish(&mut self, radau: &Radau<'_>, atol: &[f64], checks: &mut Checks) -> Option<Screening> {
        self.look_for_small_states(radau, atol);
        self.given_steps.judge(|| radau.held_at_zero(), &mut self.checks);
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

    /// Records the check of the state that is smallest relative to its absolute tolerance.
    fn look_for_small_states(&mut self, radau: &Radau<'_>, atol: &[f64]) {
        let largest = radau.largest();
        for state in states_above_zero(radau, atol) {
            let (name, atol, largest) = (&self.plan.names[state], atol[state], largest[state]);
            self.checks.record(CheckCode::LocalError, SMALL * atol / largest, 1.0, || {
                format!(
                    "`{name}` was never larger than {largest:e}, with an absolute tolerance of {atol:e}: give an `atol` far \
                     below the values of interest"
                )
            });
        }
    }
}

/// Returns the indices of the states that were larger than rounding errors at some time of the run, and are not known
/// to be held at zero.
pub(super) fn states_above_zero(radau: &Radau<'_>, atol: &[f64]) -> Vec<usize> {
    let states = &radau.largest()[..atol.len()];
    let rounding = rounding_of(states);
    let is_small = |state: usize| states[state] < SMALL * atol[state];
    let zero = if (0..states.len()).any(is_small) { radau.held_at_zero() } else { vec![false; states.len()] };
    (0..states.len()).filter(|&state| states[state] > rounding && !zero[state]).collect()
}
