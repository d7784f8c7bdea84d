//! The derivatives of an event-driven motion with respect to its parameters and initial values: along smooth arcs
//! those of the stages (`Arc`), and at the end of an arc those of its event and of the state after it (saltation;
//! Aizerman and Gantmakher 1958; Hiskens and Pai 2000). With a monitor `phi` of the event and the impact or the new
//! mode as a map `R` from the state before to the state after,
//!
//! ```text
//! dtau = -(phi_x dx + phi_p)/phi',    dx+ = R_x (dx- + x'- dtau) + R_p + R_t dtau - x'+ dtau
//! ```
//!
//! An impact with friction is differentiated with the statuses of contacts after it held fixed: closed contacts have
//! their target velocities, sticking ones no slip, slipping ones friction at its bound. On the border between two
//! statuses there is no derivative, and none is reported; nor if several contacts meet at one time in an order that
//! depends on the direction.
//!
//! Where impacts accumulate, the run replaces them by one impact without restitution, at the last of them. By the
//! balance of momentum the tangential motion after it is that after infinitely many impacts, along all directions.
//! The time of the limit is that of the last impact plus the geometric series `T rho/(1 - rho)` of the flights, with
//! the length `T` of the last flight and the ratio `rho` of successive lengths.

mod adjoint;
mod arc;
mod event;
mod forced;
mod impact;
mod linearised;
mod no_derivative;
mod transition;

pub use adjoint::{Adjoint, IntegrandJump};
pub use event::{EventSlope, TimedEvent};
pub use no_derivative::NoDerivative;

use super::locate::{EventDriven, ModeEquations, SmoothPhase, Transition};
use super::velocity_step::State;
use arc::Arc;
use event::Flights;
use hybrid::OneStep;
use nalgebra::DMatrix;
use problem::{Mechanical, MechanicalStructure};
use radau::DirectionSize;
use transition::Instant;

/// A jump of the accelerations below this fraction of their terms counts as zero.
const CONTINUOUS: f64 = 1e-9;

/// Writes the derivatives of the terms of the equations of motion with respect to each direction (a parameter) at `t`
/// and `(q, v, a, lambda)`: of the balance `M a - f - J^T lambda`, of the contact and joint accelerations `u'`, of
/// the velocities `u`, and of the values of joints and gaps, one row each.
pub type TermsBy = Box<dyn FnMut(f64, &[f64], &mut DMatrix<f64>) + Send>;

/// The directions of differentiation (parameters and initial values), one per column.
pub struct Directions {
    /// The derivatives of the initial `q` and `v`, one direction per column.
    pub initial: DMatrix<f64>,
    /// Writes the derivatives of the terms of the equations of motion (balance of forces, accelerations and
    /// velocities of contacts and joints, their values) with respect to the directions.
    pub terms: TermsBy,
    /// The derivatives of the coefficients of friction, one contact per row.
    pub mu: DMatrix<f64>,
    /// The derivatives of the coefficients of restitution, one contact per row.
    pub restitution: DMatrix<f64>,
    /// For each direction, the size of its parameter; zero for initial values, or if it is unknown.
    pub sizes: Vec<f64>,
    /// For each direction, the system with the parameter of the direction shifted, used to differentiate event
    /// functions of time; `None` if these do not depend on the parameter.
    pub shifted: Vec<Option<ShiftedMotion>>,
}

/// A mechanical system with one parameter shifted above and below its value.
pub struct ShiftedMotion {
    /// Size of the shift of the parameter, in its unit.
    pub by: f64,
    /// The systems with the parameter above and below its value.
    pub systems: [Box<dyn Mechanical>; 2],
}

impl Directions {
    fn count(&self) -> usize {
        self.initial.ncols()
    }

    fn size_of(&self, direction: usize) -> DirectionSize<'_> {
        DirectionSize::new(self.sizes[direction], &self.initial, direction)
    }

    fn evaluate(&mut self, t: f64, y: &[f64], out: &mut DMatrix<f64>) {
        (self.terms)(t, y, out);
    }
}

/// A jump of the states at an event whose time may depend on the directions.
#[derive(Clone, Debug)]
pub struct Jumped {
    /// The time of the jump of the states.
    pub t: f64,
    /// The states `q` and `v` before the jump.
    pub before: Vec<f64>,
    /// The states `q` and `v` after the jump.
    pub after: Vec<f64>,
    /// The derivatives of the event time, one state per row: islands of bodies have their own events.
    pub times: DMatrix<f64>,
}

/// The derivatives of the states along an event-driven run.
pub struct Tangents {
    equations: ModeEquations,
    directions: Directions,
    structure: MechanicalStructure,
    /// The derivatives of `q` and `v` at the time reached, one direction per column.
    now: DMatrix<f64>,
    /// The largest absolute derivatives of `q` and `v` so far: a scale for rounding errors.
    largest: DMatrix<f64>,
    /// The absolute values of the terms that add up to the derivatives of `q` and `v` in the last step and the
    /// transition at its end.
    terms: DMatrix<f64>,
    /// The derivatives of the states along the last smooth arc.
    arc: Option<Arc>,
    reached: f64,
    /// The transition between contact modes at the time reached, if there was one.
    instant: Option<Instant>,
    flights: Vec<Flights>,
    events: Vec<EventSlope>,
    /// Whether the directions are a basis of the states and parameters. Some directions of a basis violate contacts and
    /// joints that hold: the monitors (event functions) of one event need not agree along them.
    is_basis: bool,
    /// Number of central differences, one for each direction, at breakpoints in time.
    differences: u64,
}

impl Tangents {
    /// Begins the derivatives at the start of a run of `problem`.
    ///
    /// # Errors
    /// The reason why there is no derivative from the start on.
    pub fn new(
        problem: Box<dyn Mechanical>,
        directions: Directions,
        located: &mut EventDriven<'_>,
    ) -> Result<Self, NoDerivative> {
        let transition = located.transition.take();
        Self::begin_along(problem, (directions, false), (located, transition.as_ref()))
    }

    /// Begins the derivatives at the start of a run, along directions that may be a basis of the states and parameters.
    fn begin_along(
        problem: Box<dyn Mechanical>,
        (directions, is_basis): (Directions, bool),
        (located, transition): (&mut EventDriven<'_>, Option<&Transition>),
    ) -> Result<Self, NoDerivative> {
        let structure = problem.structure().clone();
        let now = directions.initial.clone();
        let (n, count) = (structure.coordinates, directions.count());
        // The start counts as a transition whose time does not depend on the directions.
        let start = Instant { times: DMatrix::zeros(n, count), happened: vec![true; n] };
        let mut tangents = Self {
            instant: Some(start),
            equations: ModeEquations::new(problem),
            largest: now.abs(),
            terms: now.abs(),
            flights: vec![Flights::default(); structure.contacts.len()],
            now,
            directions,
            structure,
            arc: None,
            reached: located.state.t,
            events: Vec::new(),
            is_basis,
            differences: 0,
        };
        if let Some(transition) = transition {
            tangents.check_start(located, transition)?;
            tangents.pass(located, transition)?;
            tangents.keep_largest();
        }
        Ok(tangents)
    }

    /// Sets the contact mode of the derivatives to that of a smooth phase that begins, and bounds the first step of the
    /// phase by the slopes of the derivatives.
    pub fn begin(&mut self, phase: &mut SmoothPhase<'_, '_>) {
        self.adopt_mode(phase);
        let Some(radau) = &mut phase.method else { return };
        let State { t, q, v } = &phase.located.state;
        let x = [q.as_slice(), v].concat();
        if let Some(slopes) = arc::slopes_at(&mut self.equations, (*t, &x), &mut self.directions, &self.now) {
            radau.limit_first_step(&slopes, &self.largest, |direction| self.directions.size_of(direction));
        }
    }

    fn adopt_mode(&mut self, phase: &SmoothPhase<'_, '_>) {
        self.equations.adopt(phase.watch.setting());
        self.arc = None;
    }

    /// Updates the derivatives over the last step of a phase, and returns the jump of the states at its end, if a
    /// smooth arc ended there.
    ///
    /// # Errors
    /// The reason why there is no derivative from the end of the step on.
    pub fn follow(&mut self, phase: &mut SmoothPhase<'_, '_>) -> Result<Option<Jumped>, NoDerivative> {
        let Some(radau) = &mut phase.method else { return Err(NoDerivative::SteppedOver) };
        let located = &*phase.located;
        let (begin, end) = located.last_arc();
        if end > begin {
            self.instant = None;
            let step = radau.last_step();
            let arc = Arc::new(step, &self.now, &mut self.equations, &mut self.directions)?;
            self.now = arc.at(end);
            self.terms.copy_from(&arc.terms);
            self.keep_largest();
            radau.limit_next_step(&arc.lacking, &self.largest, |direction| self.directions.size_of(direction));
            self.arc = Some(arc);
        }
        self.pass_end(phase)
    }

    /// Continues the derivatives across the end of the last step of a phase, and returns the jump of the states
    /// there, if a smooth arc ended there.
    fn pass_end(&mut self, phase: &mut SmoothPhase<'_, '_>) -> Result<Option<Jumped>, NoDerivative> {
        let Some(radau) = &phase.method else { return Err(NoDerivative::SteppedOver) };
        let located = &*phase.located;
        let (begin, end) = located.last_arc();
        if end > begin && located.transition.is_none() && radau.begins_anew() && !radau.is_done() && end == radau.t() {
            let step = radau.last_step();
            let (ends, x) = ([step.t + step.h, end], [located.state.q.as_slice(), &located.state.v].concat());
            self.pass_break(ends, &x)?;
        }
        self.reached = located.state.t;
        if located.grazes {
            return Err(NoDerivative::Grazing);
        }
        let Some(transition) = phase.located.transition.clone() else { return Ok(None) };
        let times = match self.pass_forced(phase.located, &transition)? {
            Some(times) => times,
            None if transition.ending.is_none() && end > begin => return Err(NoDerivative::AtBreak),
            None => self.pass(phase.located, &transition)?,
        };
        self.keep_largest();
        let (State { t, q, v }, after) = (transition.before, &phase.located.state);
        let n = self.structure.coordinates;
        let times = DMatrix::from_fn(2 * n, times.ncols(), |i, j| times[(i % n, j)]);
        Ok(Some(Jumped { t, before: [q, v].concat(), after: [after.q.as_slice(), &after.v].concat(), times }))
    }

    /// Returns the derivatives of `q` and `v` at a time within the last step, one state per row.
    pub fn at(&self, t: f64) -> DMatrix<f64> {
        match &self.arc {
            Some(arc) if t < self.reached => arc.at(t),
            _ => self.now.clone(),
        }
    }

    /// Returns the rates `(v, a)` of a state in the current mode, at the time reached.
    pub fn rates(&mut self, x: &[f64]) -> Vec<f64> {
        self.equations.evaluate_at(self.reached, x);
        [&x[self.structure.coordinates..], &self.equations.a].concat()
    }

    /// Returns the absolute values of the terms that add up to the derivatives of `q` and `v` in the last step and
    /// the transition at its end, one direction per column.
    pub fn terms(&self) -> &DMatrix<f64> {
        &self.terms
    }

    /// Removes and returns the derivatives of event times recorded since the last call.
    pub fn take_events(&mut self) -> std::vec::Drain<'_, EventSlope> {
        self.events.drain(..)
    }

    fn keep_largest(&mut self) {
        self.largest.zip_apply(&self.now, |largest, now| *largest = largest.max(now.abs()));
    }

    /// Continues the derivatives across a breakpoint in time, at which forces may jump.
    fn pass_break(&mut self, [before, after]: [f64; 2], x: &[f64]) -> Result<(), NoDerivative> {
        let n = self.structure.coordinates;
        let mut at = |t: f64| {
            self.equations.evaluate_at(t, x);
            self.equations.a.clone()
        };
        let (left, right) = (at(before), at(after));
        let size = left.iter().chain(&right).fold(0.0_f64, |most, a| most.max(a.abs()));
        let jump: Vec<f64> = left.iter().zip(&right).map(|(left, right)| left - right).collect();
        if jump.iter().all(|jump| jump.abs() <= CONTINUOUS * size) {
            return Ok(());
        }
        let Some(slopes) = self.break_slopes([before, after]) else { return Ok(()) };
        let slopes = slopes?;
        for (direction, time) in slopes.into_iter().enumerate() {
            jump.iter().enumerate().for_each(|(i, jump)| self.now[(n + i, direction)] += jump * time);
        }
        Ok(())
    }
}
