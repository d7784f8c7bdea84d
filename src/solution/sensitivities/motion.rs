//! Derivatives of a motion with located impacts, propagated along a run.

use super::adjoint::{Gradient, MOST_STORED, SweptBack};
use super::observed::{Jump, ObservedSlopes};
use super::{By, EventSlope, Sensitivities, SlopedEvent, size_of};
use crate::Plan;
use contact::tangents::{Adjoint, Directions, Jumped, NoDerivative, ShiftedMotion, Tangents, TimedEvent};
use contact::{Elapsed, EventDriven, SmoothPhase};
use models::{ContactCoefficient, MechanicalModel};
use nalgebra::DMatrix;
use numerics::CENTRAL_DIFFERENCE;
use problem::{EventKind, Mechanical};

/// Largest number of events with derivatives of their times in an answer.
const MOST_EVENTS: usize = 10_000;

/// Derivatives of the states that are propagated along a motion with located impacts.
pub(crate) struct FollowedMotion<'p> {
    tangents: Tangents,
    observed: Option<ObservedSlopes>,
    asked: &'p Sensitivities,
    outputs: usize,
    start: f64,
    /// The names of the parameters and initial values with respect to which the run is differentiated.
    by: Vec<String>,
    names: &'p [String],
    pub events: Vec<EventSlope>,
    /// Number of events whose times are differentiated, but which the answer leaves out since it contains the largest
    /// number already.
    pub left_out: u64,
    /// The stored steps and the objective (the quantity whose gradient is requested), in adjoint mode; derivatives are
    /// then propagated in a single direction, in which all parameters and initial values move together.
    swept: Option<Swept>,
}

/// The stored steps of a motion in adjoint mode, and its objective.
struct Swept {
    adjoint: Adjoint,
    back: SweptBack,
    /// If the objective is an integral, the derivatives of its integrand with respect to all states and directions,
    /// for the changes of the derivatives at jumps of the states.
    jumps: ObservedSlopes,
}

impl Jump {
    /// Converts a jump of the states, whose time counts from the start of the motion, to the user's time.
    fn of(start: f64, passed: Jumped) -> Self {
        Self { t: start + passed.t, before: passed.before, after: passed.after, times: passed.times }
    }
}

/// Returns the states of a smooth phase at a time within its last step.
fn states(phase: &mut SmoothPhase<'_, '_>, t: f64) -> Vec<f64> {
    let mut x = vec![0.0; 2 * phase.located.state.q.len()];
    phase.states_at(t, &mut x);
    x
}

impl<'p> FollowedMotion<'p> {
    /// Prepares the propagation of derivatives at the start of a run.
    ///
    /// # Errors
    /// The reason why there are no derivatives.
    pub fn new(
        model: &'p MechanicalModel,
        plan: &'p Plan,
        asked: &'p Sensitivities,
        located: &mut EventDriven<'_>,
        tolerances: (f64, &[f64]),
    ) -> Result<Self, String> {
        if let Some(objective) = &asked.objective {
            let values = model.parameters.as_ref().map_or(&[][..], |(parameters, _)| parameters.values());
            let back = SweptBack::new(plan, (asked, objective), values, tolerances, plan.start);
            let problem = || Box::new(Elapsed::new(model.problem(), plan.start));
            let adjoint = Adjoint::new(problem(), directions(model, &asked.by, plan.start)?, located);
            let adjoint = adjoint.map_err(|error| error.to_string())?;
            let together = together(model, &asked.by, &back.direction, plan.start)?;
            let tangents = Tangents::new(problem(), together, located).map_err(|error| error.to_string())?;
            let outputs = plan.names.len();
            let speeds = (asked.by.as_slice(), back.direction.as_slice());
            let observed = ObservedSlopes::together(&objective.observables, outputs, speeds, plan.start);
            let basis = plan.initial.len() + asked.by.len();
            let jumps = ObservedSlopes::of_states(&objective.observables, outputs, basis, plan.start);
            return Ok(Self {
                tangents,
                observed: Some(observed),
                outputs,
                start: plan.start,
                by: Vec::new(),
                names: &model.contacts,
                events: Vec::new(),
                left_out: 0,
                asked,
                swept: Some(Swept { adjoint, back, jumps }),
            });
        }
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
            swept: None,
        })
    }

    /// Continues the propagation of derivatives into a smooth phase that begins.
    pub fn begin(&mut self, phase: &mut SmoothPhase<'_, '_>) {
        self.tangents.begin(phase);
        if let Some(Swept { adjoint, .. }) = &mut self.swept {
            adjoint.begin(phase);
        }
    }

    /// Propagates the derivatives over the last step of a smooth phase.
    ///
    /// # Errors
    /// The reason why there is no derivative after this step.
    pub fn step(&mut self, phase: &mut SmoothPhase<'_, '_>) -> Result<(), NoDerivative> {
        let begin = phase.located.last.t;
        let passed = self.tangents.follow(phase)?;
        let Self { tangents, observed, start, swept, .. } = self;
        if let Some(Swept { adjoint, back, jumps }) = swept {
            adjoint.store(phase, tangents, &mut |passed: &Jumped| jumps.gained(&Jump::of(*start, passed.clone())))?;
            back.watch(adjoint.bytes());
            if adjoint.bytes() > MOST_STORED {
                return Err(NoDerivative::TooLong { mebibytes: MOST_STORED >> 20 });
            }
        }
        if let Some(observed) = observed {
            let end = passed.as_ref().map_or(phase.located.state.t, |passed| passed.t);
            let jump = passed.map(|passed| Jump::of(*start, passed));
            let along = |t: f64| (states(phase, t - *start), tangents.at(t - *start));
            observed.step((*start + begin, *start + end), along, jump.as_ref());
        }
        let events = self.tangents.take_events();
        if swept.is_some() {
            return Ok(());
        }
        for event in events {
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

    /// Returns the gradient of the objective (the quantity to differentiate) after the last step, in adjoint mode.
    pub fn gradient(&mut self, located: &EventDriven<'_>) -> Option<Result<Gradient, String>> {
        let Self { tangents, observed: Some(observed), start, swept: Some(swept), .. } = self else { return None };
        let Swept { adjoint, back, .. } = swept;
        let (t, x) = (located.state.t, [located.state.q.as_slice(), &located.state.v].concat());
        let along = observed.write(*start + t, |t| (x.clone(), tangents.at(t - *start)));
        Some(back.sweep((*start + t, &x), along[(0, 0)], |by_states, by_directions, integral| {
            let slopes = adjoint.sweep(by_states, by_directions, integral).map_err(|why| why.to_string())?;
            Ok((slopes, adjoint.work.into()))
        }))
    }

    /// Writes the columns of derivatives of a motion at the user's time `t`, within the last step.
    pub fn write(&mut self, phase: &mut SmoothPhase<'_, '_>, t: f64, out: &mut [f64]) {
        if self.swept.is_some() {
            return;
        }
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

/// Returns a single direction of differentiation, along which each parameter and initial value moves at its own speed.
fn together(model: &MechanicalModel, by: &[By], speeds: &[f64], start: f64) -> Result<Directions, String> {
    let Directions { initial, mut terms, mu, restitution, .. } = unshifted(model, by, start)?;
    let speeds = DMatrix::from_column_slice(speeds.len(), 1, speeds);
    let moves = |parameter: usize| {
        by.iter().position(|by| *by == By::Parameter(parameter)).map_or(0.0, |direction| speeds[direction])
    };
    let is_parametric = by.iter().any(|by| matches!(by, By::Parameter(_)));
    let is_shifted = is_parametric && model.structure().depends_on_time && model.parameters.is_some();
    let shifted = is_shifted.then(|| shifted_by(model, CENTRAL_DIFFERENCE, moves, start)).transpose()?;
    let (of_initial, of_mu, of_restitution) = (&initial * &speeds, &mu * &speeds, &restitution * &speeds);
    let mut own = DMatrix::zeros(0, 0);
    let along = move |t: f64, y: &[f64], out: &mut DMatrix<f64>| {
        if own.nrows() != out.nrows() {
            own = DMatrix::zeros(out.nrows(), speeds.nrows());
        }
        terms(t, y, &mut own);
        out.copy_from(&(&own * &speeds));
    };
    Ok(Directions {
        initial: of_initial,
        terms: Box::new(along),
        mu: of_mu,
        restitution: of_restitution,
        // The speed of each parameter along the direction already contains the size of the parameter, so that the
        // size of the direction is 1.
        sizes: vec![1.0],
        shifted: vec![shifted],
    })
}

/// Returns two mechanical systems for central differences, in which each parameter `k` is increased and decreased by
/// `by * speed(k)`.
fn shifted_by(
    model: &MechanicalModel,
    by: f64,
    speed: impl Fn(usize) -> f64,
    start: f64,
) -> Result<ShiftedMotion, String> {
    let values = model.parameters.as_ref().map_or(&[][..], |(parameters, _)| parameters.values());
    let system = |by: f64| -> Result<Box<dyn Mechanical>, String> {
        let values: Vec<f64> = values.iter().enumerate().map(|(k, value)| value + by * speed(k)).collect();
        let moved = model.with_parameters(&values).map_err(|error| error.to_string())?;
        Ok(Box::new(Elapsed::new(moved.problem(), start)))
    };
    Ok(ShiftedMotion { by, systems: [system(by)?, system(-by)?] })
}

/// Returns the directions of differentiation that belong to parameters and initial values, for a motion whose time
/// counts from its start.
pub(crate) fn directions(model: &MechanicalModel, by: &[By], start: f64) -> Result<Directions, String> {
    let mut directions = unshifted(model, by, start)?;
    if model.parameters.is_none() || !model.structure().depends_on_time {
        return Ok(directions);
    }
    for (direction, by) in by.iter().enumerate() {
        let By::Parameter(parameter) = *by else { continue };
        let size = directions.sizes[direction];
        let moves = |k: usize| if k == parameter { 1.0 } else { 0.0 };
        directions.shifted[direction] = Some(shifted_by(model, CENTRAL_DIFFERENCE * size, moves, start)?);
    }
    Ok(directions)
}

/// Returns the directions of differentiation that belong to parameters and initial values, without mechanical systems
/// at changed parameter values.
fn unshifted(model: &MechanicalModel, by: &[By], start: f64) -> Result<Directions, String> {
    let structure = model.structure();
    let (n, contacts, count) = (2 * structure.coordinates, structure.contacts.len(), by.len());
    let slopes = model.slopes().map_err(|error| error.to_string())?;
    let values = model.parameters.as_ref().map_or(&[][..], |(parameters, _)| parameters.values());
    let size = |by: &By| match *by {
        By::Parameter(parameter) => values.get(parameter).map_or(0.0, |value| size_of(*value)),
        By::Initial(_) => 0.0,
    };
    let mut directions = Directions {
        initial: DMatrix::zeros(n, count),
        terms: Box::new(|_: f64, _: &[f64], out: &mut DMatrix<f64>| out.fill(0.0)),
        mu: DMatrix::zeros(contacts, count),
        restitution: DMatrix::zeros(contacts, count),
        sizes: by.iter().map(size).collect(),
        shifted: (0..count).map(|_| None).collect(),
    };
    for (direction, by) in by.iter().enumerate() {
        if let By::Initial(state) = *by {
            directions.initial[(state, direction)] = 1.0;
        }
    }
    let (Some(mut slopes), Some((_, coefficients))) = (slopes, &model.parameters) else {
        return Ok(directions);
    };
    // The index of the direction of differentiation that belongs to a parameter; each parameter occurs at most once.
    let column = |parameter: usize| by.iter().position(|by| *by == By::Parameter(parameter));
    for (state, parameter, value) in slopes.initial() {
        // An initial value with respect to which the run is differentiated does not follow the parameters.
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
