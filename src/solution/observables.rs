//! User-defined quantities beside the outputs of a problem, evaluated along the dense output of any method:
//! definitions, which are further columns; integrals of expressions over time; and monitors, whose sign changes are
//! located and recorded, or end the run.

use super::evaluation::{Along, EvaluationBuffer};
use super::impulse::Impulse;
use super::quadrature::{self, Integrals};
use super::run::Stepper;
use super::touches::Touches;
use super::{Event, EventKind};
use expression::Tape;
use hybrid::{Crossing, Monitors};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use utoipa::ToSchema;

/// The user's definitions, integrals and monitors (event functions).
#[derive(Clone, Debug, Default)]
pub struct Observables {
    /// The names of the user's definitions, then of the integrals.
    pub names: Vec<String>,
    /// The number of the user's integrals.
    pub integrals: usize,
    /// For each of the user's definitions, the number of outputs of the problem up to the last one that it depends on.
    pub reach: Vec<usize>,
    /// For each definition, integrand and monitor, the outputs of the problem that it depends on.
    pub inputs: Vec<Vec<usize>>,
    /// The monitors, whose sign changes are events.
    pub monitors: Vec<Monitored>,
    /// Definitions, integrands and monitors, compiled as functions of `t` and all outputs of the problem.
    pub program: Tape,
    /// The derivatives of the user's definitions and integrands; empty if none are requested.
    pub slopes: ObservableSlopes,
}

/// The partial derivatives of the user's definitions and integrands with respect to states and parameters.
#[derive(Clone, Debug, Default)]
pub struct ObservableSlopes {
    /// The structural nonzeros of the derivatives: the index of the definition or integrand, and the argument of the
    /// partial derivative.
    pub pattern: Vec<(usize, Argument)>,
    /// The partial derivatives, compiled as functions of `t` and the states.
    pub program: Tape,
    /// For each definition and integrand, the reason why it has no derivative; `None` if it has one.
    pub refused: Vec<Option<&'static str>>,
}

/// An argument of a partial derivative of a definition or integrand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Argument {
    /// A state, given by its index.
    State(usize),
    /// A parameter, given by its index.
    Parameter(usize),
}

/// A monitor (event function) of the user.
#[derive(Clone, Debug)]
pub struct Monitored {
    /// The label of the events at sign changes of the monitor.
    pub label: String,
    /// The direction of the sign changes that count as events.
    pub direction: Direction,
    /// Whether an event of the monitor ends the run.
    pub ends: bool,
}

/// The direction of the sign changes of a monitor that count as events.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// A change of a monitor from below zero to zero or above.
    Rising,
    /// A change of a monitor from above zero to zero or below.
    Falling,
    /// Changes of a monitor's sign in both directions.
    #[default]
    Either,
}

/// The monitor that ended a run.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct EndedBy {
    /// The label of the monitor, or else its expression.
    pub label: String,
    /// The time of the event that ended the run.
    pub t: f64,
}

impl Observables {
    /// Whether integrals or monitors must be evaluated within steps, independently of the output times.
    pub fn is_followed(&self) -> bool {
        self.integrals > 0 || !self.monitors.is_empty()
    }

    /// Binds new values of the parameters to the definitions, integrands and monitors.
    pub fn bind(&mut self, parameters: &[f64]) {
        self.program.bind(parameters);
        self.slopes.program.bind(parameters);
    }

    /// Returns the number of values that the program computes: definitions, integrands and monitors.
    pub(super) fn values(&self) -> usize {
        self.names.len() + self.monitors.len()
    }

    /// Returns the number of definitions of the user.
    pub(super) fn definitions(&self) -> usize {
        self.names.len() - self.integrals
    }
}

/// The state of a user's definitions, integrals and monitors during a run.
pub(super) struct Observed<'a> {
    of: &'a Observables,
    monitors: Monitors,
    touches: Touches,
    place: EvaluationBuffer,
    /// The indices of the user's monitors, in the outputs of the problem followed by the values of the program.
    watched: Vec<usize>,
    /// The user's integrals from the start up to the time `reached`.
    integrals: Integrals,
    /// The indices of the user's integrands, in the outputs of the problem followed by the values of the program; none
    /// of them is squared.
    integrands: Vec<(usize, bool)>,
    reached: f64,
    /// Impulses at jumps of the states after the time `reached`, in the order of time.
    impulses: VecDeque<Impulse>,
    /// The index of a monitor whose value is not finite, if there is one.
    lost: Option<usize>,
}

impl<'a> Observed<'a> {
    /// Creates the state of the user's definitions, integrals and monitors at the start of a run; `outputs` is the
    /// number of outputs of the problem.
    pub fn new(of: &'a Observables, outputs: usize, stepper: &mut impl Stepper) -> Self {
        let place = EvaluationBuffer::new(&of.program, [outputs, of.values()], of.integrals > 0);
        let t = stepper.t();
        let integrands = (of.definitions()..of.names.len()).map(|at| (outputs + at, false)).collect();
        Self {
            monitors: Monitors::new(of.monitors.len()),
            touches: Touches::new(of.monitors.len(), t),
            place,
            watched: (outputs + of.names.len()..outputs + of.values()).collect(),
            integrals: Integrals::new(of.integrals),
            integrands,
            reached: t,
            impulses: VecDeque::new(),
            lost: None,
            of,
        }
    }

    /// Locates the events of the monitors over the last step, from `begin` on, and appends them to `events` as long as
    /// `goes_on` allows their number. Returns the event that ends the run, after which there are no others.
    pub fn follow(
        &mut self,
        stepper: &mut impl Stepper,
        begin: f64,
        events: &mut Vec<Event>,
        goes_on: impl Fn(usize) -> bool,
    ) -> Option<EndedBy> {
        if self.of.monitors.is_empty() {
            return None;
        }
        let end = stepper.t();
        let (mut from, first) = (begin, events.len());
        let mut ended = None;
        let mut along = Along { stepper, place: &mut self.place, places: &self.watched, uncertain: &[] };
        while goes_on(events.len())
            && let Some(crossing) = self.monitors.next(&mut along, from, end)
        {
            self.touches.note(&crossing);
            let Crossing { t, monitor, is_rising, .. } = crossing;
            from = t;
            let Monitored { label, direction, ends } = &self.of.monitors[monitor];
            let counts = match direction {
                Direction::Rising => is_rising,
                Direction::Falling => !is_rising,
                Direction::Either => true,
            };
            if !counts {
                continue;
            }
            events.push(Event { t, kind: EventKind::Crossed, of: label.clone() });
            if *ends {
                ended = Some(EndedBy { label: label.clone(), t });
                break;
            }
        }
        self.touches.follow(stepper, &mut self.place, &self.watched, begin);
        self.lost = ended.is_none().then(|| self.lost_at(stepper, end)).flatten();
        if events.len() > first {
            events.sort_by(|a, b| a.t.total_cmp(&b.t));
        }
        if let Some(EndedBy { t, .. }) = &ended {
            events.retain(|event| event.t <= *t);
        }
        ended
    }

    /// Returns the index of a monitor whose value is not finite at a time within the last step, if there is one.
    fn lost_at(&mut self, stepper: &mut impl Stepper, t: f64) -> Option<usize> {
        let first = self.of.names.len();
        self.place.at(stepper, t)[first..].iter().position(|value| !value.is_finite())
    }

    /// Returns the label of a monitor whose value is not finite at the end of the last step, if there is one.
    pub fn lost(&self) -> Option<&str> {
        self.lost.map(|monitor| self.of.monitors[monitor].label.as_str())
    }

    /// Writes the user's definitions and integrals at a time within the last step; `outputs` are the outputs of the
    /// problem at this time. Times must increase from call to call.
    pub fn write(&mut self, stepper: &mut impl Stepper, t: f64, outputs: &[f64], out: &mut [f64]) {
        self.integrate(stepper, t);
        let (of_definitions, of_integrals) = out.split_at_mut(self.of.definitions());
        self.define(t, outputs, of_definitions);
        of_integrals.copy_from_slice(&self.integrals.values);
    }

    /// Writes the user's definitions at the time `t`; `outputs` are the outputs of the problem at this time.
    pub fn define(&mut self, t: f64, outputs: &[f64], out: &mut [f64]) {
        self.place.take(t, outputs);
        out.copy_from_slice(&self.place.values[..out.len()]);
    }

    /// Stores the impulses of jumps at the end of the last step, which are added to the integrals when these reach
    /// their time.
    pub fn expect(&mut self, impulses: &[Impulse]) {
        if self.of.integrals > 0 {
            self.impulses.extend(impulses.iter().cloned());
        }
    }

    /// Continues the user's integrals up to a time within the last step.
    pub fn integrate(&mut self, stepper: &mut impl Stepper, t: f64) {
        if self.of.integrals == 0 {
            return;
        }
        while let Some(impulse) = self.impulses.pop_front_if(|impulse| impulse.at <= t) {
            self.integrate_smooth(stepper, impulse.t.min(t));
            self.integrals.pass(&impulse, &mut self.place, &self.integrands);
        }
        self.integrate_smooth(stepper, t);
    }

    fn integrate_smooth(&mut self, stepper: &mut impl Stepper, t: f64) {
        if t <= self.reached {
            return;
        }
        let Self { place, integrals, integrands, reached, .. } = self;
        quadrature::integrate(*reached, t, integrals, quadrature::Along { stepper, place, integrands });
        self.reached = t;
    }

    /// Returns the name of the integral with the largest relative uncertainty, and this uncertainty.
    pub fn uncertainty(&self) -> Option<(&str, f64)> {
        let (integral, uncertainty) = self.integrals.uncertainty()?;
        Some((self.of.names.get(self.of.definitions() + integral)?, uncertainty))
    }

    /// Returns the name of the first integral that is undefined because of an impulse, and the time of the impulse.
    pub fn undefined(&self) -> Option<(&str, f64)> {
        let (integral, t) = self.integrals.undefined()?;
        Some((self.of.names.get(self.of.definitions() + integral)?, t))
    }

    /// Returns the label of the first monitor that touches zero within the tolerances, and the time at which it leaves
    /// the band around zero.
    pub fn touched(&self) -> Option<(&str, f64)> {
        let (monitor, t) = self.touches.found?;
        Some((&self.of.monitors[monitor].label, t))
    }

    /// Returns the number of steps in which a monitor may have changed sign twice without being noticed.
    pub fn open(&self) -> u64 {
        self.monitors.open
    }
}
