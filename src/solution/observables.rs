//! User-defined quantities beside the outputs of a problem, evaluated along the dense output of any method:
//! definitions, which are further columns; integrals of expressions over time; and monitors, whose sign changes are
//! located and recorded, or end the run.

use super::quadrature::{self, Integrals};
use super::run::Stepper;
use super::{Event, EventKind};
use expression::{IntervalWorkspace, Sight, Tape};
use hybrid::{Crossing, Followed, Monitors};
use numerics::Interval;
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

    /// The number of definitions.
    pub(super) fn definitions(&self) -> usize {
        self.names.len() - self.integrals
    }
}

/// Observables during a run.
pub(super) struct Observed<'a> {
    of: &'a Observables,
    monitors: Monitors,
    place: EvaluationBuffer,
    /// The integrals up to the time `reached`.
    integrals: Integrals,
    /// The places of the integrands among the values, none of which is squared.
    integrands: Vec<(usize, bool)>,
    reached: f64,
    /// Impulses that the integrals have not passed, in the order of time.
    impulses: VecDeque<Impulse>,
    /// An integral that an impulse leaves undefined, and the time of that, if there is one.
    undefined: Option<(usize, f64)>,
    /// A monitor without a finite value, if there is one.
    lost: Option<usize>,
}

/// A jump of the states by impulses, as the outputs of the problem with multiples of these impulses as their variables.
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

/// Buffers for one evaluation.
struct EvaluationBuffer {
    program: Tape,
    sight: Sight,
    boxes: IntervalWorkspace,
    outputs: Vec<f64>,
    values: Vec<f64>,
    output_ranges: Vec<Interval>,
    ranges: Vec<Interval>,
    /// Index of the first monitor among the values.
    first: usize,
}

/// The monitors along the last step of a method.
struct Along<'a, S> {
    stepper: &'a mut S,
    place: &'a mut EvaluationBuffer,
}

impl<S: Stepper> Followed for Along<'_, S> {
    fn monitors(&mut self, t: f64, out: &mut [f64]) {
        let first = self.place.first;
        out.copy_from_slice(&self.place.at(self.stepper, t)[first..]);
    }

    fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
        let EvaluationBuffer { program, boxes, output_ranges, ranges, first, .. } = &mut *self.place;
        output_ranges.fill(Interval::LINE);
        if !self.stepper.enclose(from, to, output_ranges) {
            return false;
        }
        program.enclose(Interval::new(from, to), output_ranges, boxes, ranges);
        out.copy_from_slice(&ranges[*first..]);
        true
    }
}

impl EvaluationBuffer {
    /// Definitions, integrands and monitors at a time within the last step.
    fn at(&mut self, stepper: &mut impl Stepper, t: f64) -> &[f64] {
        stepper.values(t, &mut self.outputs);
        self.program.evaluate(t, &self.outputs, &mut self.values);
        &self.values
    }
}

impl<'a> Observed<'a> {
    /// Begins at the start of a run; `outputs` is the number of outputs of the problem.
    pub fn new(of: &'a Observables, outputs: usize, stepper: &mut impl Stepper) -> Self {
        let count = of.names.len() + of.monitors.len();
        let place = EvaluationBuffer {
            program: of.program.clone(),
            sight: if of.integrals > 0 { Sight::new(&of.program) } else { Sight::default() },
            boxes: IntervalWorkspace::new(&of.program),
            outputs: vec![0.0; outputs],
            values: vec![0.0; count],
            output_ranges: vec![Interval::LINE; outputs],
            ranges: vec![Interval::LINE; count],
            first: of.names.len(),
        };
        let t = stepper.t();
        let integrands = (of.definitions()..of.names.len()).map(|at| (at, false)).collect();
        Self {
            monitors: Monitors::new(of.monitors.len()),
            place,
            integrals: Integrals::new(of.integrals),
            integrands,
            reached: t,
            impulses: VecDeque::new(),
            undefined: None,
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
        let mut along = Along { stepper, place: &mut self.place };
        while goes_on(events.len())
            && let Some(Crossing { t, monitor, is_rising }) = self.monitors.next(&mut along, from, end)
        {
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
        let first = self.place.first;
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
        let EvaluationBuffer { program, values, .. } = &mut self.place;
        program.evaluate(t, outputs, values);
        out.copy_from_slice(&values[..out.len()]);
    }

    /// Announces the impulses at the end of the last step.
    pub fn expect(&mut self, impulses: Vec<Impulse>) {
        if self.of.integrals > 0 {
            self.impulses.extend(impulses);
        }
    }

    /// Continues the integrals up to a time within the last step.
    pub fn integrate(&mut self, stepper: &mut impl Stepper, t: f64) {
        if self.of.integrals == 0 {
            return;
        }
        while let Some(impulse) = self.impulses.pop_front_if(|impulse| impulse.at <= t) {
            self.integrate_smooth(stepper, impulse.t.min(t));
            self.pass(&impulse);
        }
        self.integrate_smooth(stepper, t);
    }

    /// Adds the integrals over an impulse. An integrand has one if it is affine in the impulses, with the same slope
    /// on both sides of the jump; of others, as the square of a variable, the integral is undefined.
    fn pass(&mut self, impulse: &Impulse) {
        let EvaluationBuffer { program, values, .. } = &mut self.place;
        let (first, count) = (self.of.definitions(), self.of.integrals);
        let mut at = |outputs: &[f64]| {
            program.evaluate(impulse.t, outputs, values);
            values[first..first + count].to_vec()
        };
        let [rest_before, once_before] = [0, 1].map(|share| at(&impulse.before[share]));
        let [rest, once, twice] = [0, 1, 2].map(|share| at(&impulse.after[share]));
        for k in 0..count {
            let over = once[k] - rest[k];
            let others = [once_before[k] - rest_before[k], twice[k] - once[k]];
            let sizes = [rest_before[k], once_before[k], rest[k], once[k], twice[k]];
            let size = sizes.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            let is_one = others.iter().all(|other| (over - other).abs() <= SAME_IMPULSE * size);
            if is_one {
                self.integrals.add(k, over);
            } else {
                self.undefined.get_or_insert((k, impulse.t));
            }
        }
    }

    fn integrate_smooth(&mut self, stepper: &mut impl Stepper, t: f64) {
        if t <= self.reached {
            return;
        }
        let Self { place, integrals, integrands, reached, .. } = self;
        let EvaluationBuffer { program, sight, outputs: inputs, values, .. } = place;
        let outputs = |t: f64, out: &mut [f64]| stepper.values(t, out);
        quadrature::integrate(
            *reached,
            t,
            integrals,
            quadrature::Along { outputs, program, sight, inputs, values, integrands },
        );
        self.reached = t;
    }

    /// The integral with the largest relative uncertainty, and that uncertainty.
    pub fn uncertainty(&self) -> Option<(&str, f64)> {
        let (integral, uncertainty) = self.integrals.uncertainty()?;
        Some((self.of.names.get(self.of.definitions() + integral)?, uncertainty))
    }

    /// The integral that an impulse leaves undefined, and the time of that.
    pub fn undefined(&self) -> Option<(&str, f64)> {
        let (integral, t) = self.undefined?;
        Some((self.of.names.get(self.of.definitions() + integral)?, t))
    }

    /// Number of steps in which a monitor may have changed sign twice without being noticed.
    pub fn open(&self) -> u64 {
        self.monitors.open
    }
}
