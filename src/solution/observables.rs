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

/// The definitions, integrals and monitors of a user.
#[derive(Clone, Debug, Default)]
pub struct Observables {
    /// The names of the definitions, then of the integrals.
    pub names: Vec<String>,
    /// The number of integrals.
    pub integrals: usize,
    /// For each definition, the number of outputs of the problem up to the last one that it depends on.
    pub reach: Vec<usize>,
    /// For each definition, integrand and monitor, the outputs of the problem that it depends on.
    pub inputs: Vec<Vec<usize>>,
    /// The monitors.
    pub monitors: Vec<Monitored>,
    /// Definitions, integrands and monitors compiled as functions of `t` and all outputs of the problem.
    pub program: Tape,
    /// The derivatives of definitions and integrands; empty where none are asked for.
    pub slopes: ObservableSlopes,
}

/// The derivatives of definitions and integrands by states and parameters.
#[derive(Clone, Debug, Default)]
pub struct ObservableSlopes {
    /// The structural nonzeros, as the observable and by what.
    pub pattern: Vec<(usize, Argument)>,
    /// Their values as a program in `t` and the states.
    pub program: Tape,
    /// Why an observable has no derivative, if it has none.
    pub refused: Vec<Option<&'static str>>,
}

/// What an observable depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Argument {
    /// A state.
    State(usize),
    /// A parameter.
    Parameter(usize),
}

/// A monitor (event function) of the user.
#[derive(Clone, Debug)]
pub struct Monitored {
    /// The label of its events.
    pub label: String,
    /// The sign changes that count.
    pub direction: Direction,
    /// Whether its events end the run.
    pub ends: bool,
}

/// The direction of the sign changes that count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// From below zero to zero or above.
    Rising,
    /// From above zero to zero or below.
    Falling,
    /// Both.
    #[default]
    Either,
}

/// The monitor that ended a run.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct EndedBy {
    /// The label of the monitor, or else its expression.
    pub label: String,
    /// The time of its event.
    pub t: f64,
}

impl Observables {
    /// Whether something is evaluated within steps, independently of the output times.
    pub fn is_followed(&self) -> bool {
        self.integrals > 0 || !self.monitors.is_empty()
    }

    /// Binds other values of the parameters.
    pub fn bind(&mut self, parameters: &[f64]) {
        self.program.bind(parameters);
        self.slopes.program.bind(parameters);
    }

    /// The number of values of the program.
    pub(super) fn values(&self) -> usize {
        self.names.len() + self.monitors.len()
    }

    /// The number of definitions.
    pub(super) fn definitions(&self) -> usize {
        self.names.len() - self.integrals
    }
}

/// Observables during a run.
pub(super) struct Observed<'a> {
    of: &'a Observables,
    monitors: Monitors,
    touches: Touches,
    place: EvaluationBuffer,
    /// The places of the monitors among the outputs of the problem, then the values of the program.
    watched: Vec<usize>,
    /// The integrals up to the time `reached`.
    integrals: Integrals,
    /// The places of the integrands there, none of which is squared.
    integrands: Vec<(usize, bool)>,
    reached: f64,
    /// Impulses that the integrals have not passed, in the order of time.
    impulses: VecDeque<Impulse>,
    /// A monitor without a finite value, if there is one.
    lost: Option<usize>,
}

impl<'a> Observed<'a> {
    /// Begins at the start of a run; `outputs` is the number of outputs of the problem.
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

    /// The monitor without a finite value at a time within the last step.
    fn lost_at(&mut self, stepper: &mut impl Stepper, t: f64) -> Option<usize> {
        let first = self.of.names.len();
        self.place.at(stepper, t)[first..].iter().position(|value| !value.is_finite())
    }

    /// The label of a monitor without a finite value at the end of the last step.
    pub fn lost(&self) -> Option<&str> {
        self.lost.map(|monitor| self.of.monitors[monitor].label.as_str())
    }

    /// Writes definitions and integrals at a time within the last step, where the problem has the given outputs. Times
    /// must increase from call to call.
    pub fn write(&mut self, stepper: &mut impl Stepper, t: f64, outputs: &[f64], out: &mut [f64]) {
        self.integrate(stepper, t);
        let (of_definitions, of_integrals) = out.split_at_mut(self.of.definitions());
        self.define(t, outputs, of_definitions);
        of_integrals.copy_from_slice(&self.integrals.values);
    }

    /// Writes the definitions at a time where the problem has the given outputs.
    pub fn define(&mut self, t: f64, outputs: &[f64], out: &mut [f64]) {
        self.place.take(t, outputs);
        out.copy_from_slice(&self.place.values[..out.len()]);
    }

    /// Announces the impulses at the end of the last step.
    pub fn expect(&mut self, impulses: &[Impulse]) {
        if self.of.integrals > 0 {
            self.impulses.extend(impulses.iter().cloned());
        }
    }

    /// Continues the integrals up to a time within the last step.
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

    /// The integral with the largest relative uncertainty, and that uncertainty.
    pub fn uncertainty(&self) -> Option<(&str, f64)> {
        let (integral, uncertainty) = self.integrals.uncertainty()?;
        Some((self.of.names.get(self.of.definitions() + integral)?, uncertainty))
    }

    /// The integral that an impulse leaves undefined, and the time of that.
    pub fn undefined(&self) -> Option<(&str, f64)> {
        let (integral, t) = self.integrals.undefined()?;
        Some((self.of.names.get(self.of.definitions() + integral)?, t))
    }

    /// The first monitor that touches zero within the tolerances, and the time of that.
    pub fn touched(&self) -> Option<(&str, f64)> {
        let (monitor, t) = self.touches.found?;
        Some((&self.of.monitors[monitor].label, t))
    }

    /// Number of steps in which a monitor may have changed sign twice without being noticed.
    pub fn open(&self) -> u64 {
        self.monitors.open
    }
}
