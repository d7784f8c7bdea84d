//! The derivatives of a motion with located impacts, on the way of a run.

use super::observed::{Jump, ObservedSlopes};
use super::{By, EventSlope, Sensitivities, SlopedEvent};
use crate::Plan;
use contact::tangents::{Directions, NoDerivative, ShiftedMotion, Tangents, TimedEvent};
use contact::{Elapsed, EventDriven, SmoothPhase};
use models::{ContactCoefficient, MechanicalModel};
use nalgebra::DMatrix;
use numerics::CENTRAL_DIFFERENCE;
use problem::{EventKind, Mechanical};

/// The most events of a run whose times are differentiated in the answer.
const MOST_EVENTS: usize = 10_000;

/// Derivatives on the way of a run.
pub(crate) struct FollowedMotion<'p> {
    tangents: Tangents,
    observed: Option<ObservedSlopes>,
    asked: &'p Sensitivities,
    outputs: usize,
    start: f64,
    /// The names of what the run is differentiated by.
    by: Vec<String>,
    names: &'p [String],
    pub events: Vec<EventSlope>,
    /// Events beyond the most.
    pub left_out: u64,
}

/// The states of a phase at a time within its last step.
fn states(phase: &mut SmoothPhase<'_, '_>, t: f64) -> Vec<f64> {
    let mut x = vec![0.0; 2 * phase.located.state.q.len()];
    phase.states_at(t, &mut x);
    x
}

impl<'p> FollowedMotion<'p> {
    /// Begins at the start of a run.
    ///
    /// # Errors
    /// Why there are no derivatives.
    pub fn new(
        model: &'p MechanicalModel,
        plan: &'p Plan,
        asked: &'p Sensitivities,
        located: &mut EventDriven<'_>,
    ) -> Result<Self, String> {
        let directions = directions(model, &asked.by, plan.start)?;
        let problem = Box::new(Elapsed::new(model.problem(), plan.start));
        let tangents = Tangents::new(problem, directions, located).map_err(|error| error.to_string())?;
        let outputs = plan.names.len();
        let is_observed = asked.of.iter().any(|&of| of >= outputs);
        Ok(Self {
            tangents,
            observed: is_observed.then(|| ObservedSlopes::new(&plan.observables, outputs, &asked.by, plan.start)),
            outputs,
            start: plan.start,
            by: asked.to.clone(),
            names: &model.contacts,
            events: Vec::new(),
            left_out: 0,
            asked,
        })
    }

    /// Takes up a smooth phase that begins.
    pub fn begin(&mut self, phase: &SmoothPhase<'_, '_>) {
        self.tangents.begin(phase);
    }

    /// Follows the last step of a phase.
    ///
    /// # Errors
    /// Why there is no derivative from its end on.
    pub fn step(&mut self, phase: &mut SmoothPhase<'_, '_>) -> Result<(), NoDerivative> {
        let begin = phase.located.last.t;
        let passed = self.tangents.follow(phase)?;
        let Self { tangents, observed, start, .. } = self;
        if let Some(observed) = observed {
            let end = passed.as_ref().map_or(phase.located.state.t, |passed| passed.t);
            let jump = passed.map(|passed| Jump {
                t: *start + passed.t,
                before: passed.before,
                after: passed.after,
                times: passed.times,
            });
            let along = |t: f64| (states(phase, t - *start), tangents.at(t - *start));
            observed.step((*start + begin, *start + end), along, jump.as_ref());
        }
        for event in self.tangents.take_events() {
            if self.events.len() == MOST_EVENTS {
                self.left_out += 1;
                continue;
            }
            self.events.push(EventSlope {
                t: self.start + event.t,
                kind: match event.kind {
                    TimedEvent::Accumulation => SlopedEvent::Accumulation,
                    TimedEvent::Contact(EventKind::LiftOff) => SlopedEvent::LiftOff,
                    TimedEvent::Contact(EventKind::Stick) => SlopedEvent::Stick,
                    TimedEvent::Contact(EventKind::Slip) => SlopedEvent::Slip,
                    TimedEvent::Contact(_) => SlopedEvent::Impact,
                },
                of: self.names.get(event.contact).cloned().unwrap_or_default(),
                slopes: self.by.iter().cloned().zip(event.slopes).collect(),
                transversality: event.transversality,
            });
        }
        Ok(())
    }

    /// Writes the columns at a time within the last step, by the clock of the user.
    pub fn write(&mut self, phase: &mut SmoothPhase<'_, '_>, t: f64, out: &mut [f64]) {
        let elapsed = t - self.start;
        let now = self.tangents.at(elapsed);
        let Self { tangents, observed, start, outputs, .. } = self;
        let observed = observed
            .as_mut()
            .map(|observed| observed.write(t, |t| (states(phase, t - *start), tangents.at(t - *start))));
        for (out, &of) in out.chunks_exact_mut(self.asked.by.len()).zip(&self.asked.of) {
            let row = match (of.checked_sub(*outputs), &observed) {
                (Some(own), Some(observed)) => observed.row(own),
                _ => now.row(of),
            };
            out.iter_mut().zip(row.iter()).for_each(|(out, value)| *out = *value);
        }
    }
}

/// The directions of parameters and initial values, of a motion in the time since its start.
pub(crate) fn directions(model: &MechanicalModel, by: &[By], start: f64) -> Result<Directions, String> {
    let structure = model.structure();
    let (n, contacts, count) = (2 * structure.coordinates, structure.contacts.len(), by.len());
    let slopes = model.slopes().map_err(|error| error.to_string())?;
    let mut directions = Directions {
        initial: DMatrix::zeros(n, count),
        terms: Box::new(|_: f64, _: &[f64], out: &mut DMatrix<f64>| out.fill(0.0)),
        mu: DMatrix::zeros(contacts, count),
        restitution: DMatrix::zeros(contacts, count),
        shifted: (0..count).map(|_| None).collect(),
    };
    for (direction, by) in by.iter().enumerate() {
        if let By::Initial(state) = *by {
            directions.initial[(state, direction)] = 1.0;
        }
    }
    let (Some(mut slopes), Some((parameters, coefficients))) = (slopes, &model.parameters) else {
        return Ok(directions);
    };
    // The direction of a parameter; each is named once.
    let column = |parameter: usize| by.iter().position(|by| *by == By::Parameter(parameter));
    for (state, parameter, value) in slopes.initial() {
        // An initial value that is a direction of its own does not follow parameters.
        if let Some(direction) = column(parameter).filter(|_| !by.contains(&By::Initial(state))) {
            directions.initial[(state, direction)] += value;
        }
    }
    for (coefficient, parameter, value) in slopes.contacts() {
        let Some(direction) = column(parameter) else { continue };
        match coefficients[coefficient] {
            ContactCoefficient::Friction(k) => directions.mu[(k, direction)] += value,
            ContactCoefficient::Restitution(k) => directions.restitution[(k, direction)] += value,
        }
    }
    if structure.depends_on_time {
        let values = parameters.values();
        for (direction, by) in by.iter().enumerate() {
            let By::Parameter(parameter) = *by else { continue };
            let size = if values[parameter] == 0.0 { 1.0 } else { values[parameter].abs() };
            let change = CENTRAL_DIFFERENCE * size;
            let system = |change: f64| -> Result<Box<dyn Mechanical>, String> {
                let mut values = values.to_vec();
                values[parameter] += change;
                let moved = model.with_parameters(&values).map_err(|error| error.to_string())?;
                Ok(Box::new(Elapsed::new(moved.problem(), start)))
            };
            let systems = [system(change)?, system(-change)?];
            directions.shifted[direction] = Some(ShiftedMotion { by: change, systems });
        }
    }
    let pattern = slopes.pattern().iter().enumerate();
    let places: Vec<(usize, usize, usize)> =
        pattern.filter_map(|(place, &(row, parameter))| Some((place, row, column(parameter)?))).collect();
    let mut values = vec![0.0; slopes.pattern().len()];
    directions.terms = Box::new(move |t: f64, y: &[f64], out: &mut DMatrix<f64>| {
        slopes.evaluate(start + t, y, &mut values);
        out.fill(0.0);
        places.iter().for_each(|&(place, row, direction)| out[(row, direction)] += values[place]);
    });
    Ok(directions)
}
