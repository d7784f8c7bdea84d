//! Event-driven integration (Acary and Brogliato 2008, *Numerical Methods for Nonsmooth Dynamical Systems*): smooth
//! motion by Radau IIA, one [mode](Status) at a time, cut where the mode ends.
//!
//! - A mode ends at an impact, a detachment, a stick-slip or a slip-stick transition. The time is found on the
//!   collocation polynomial and refined by solving the step anew up to it, so that it has the order of the method.
//! - Where contacts approach each other, the law of impact acts instantaneously.
//! - The next mode is determined by a probe: a step at the level of velocities, with the contact law, so short that
//!   only directions count. No mode is guessed, and where forces alone have no solution (Painleve 1895) or several,
//!   impulses decide.
//! - Where impacts accumulate (Zeno), they are replaced by their limit, one impact without restitution.
//! - Where no mode is found, time stepping continues until one is.

mod automaton;
mod bursts;
mod closed;
mod driven;
mod enclosed_forces;
mod gradient;
mod grazing;
mod hidden;
mod integrals;
mod mode;
mod mode_equations;
mod monitors;
mod search;
mod smooth_phase;
mod transition;

pub use grazing::Grazed;
pub use mode::Status;
pub(crate) use mode::held;
pub(crate) use mode_equations::{ModeEquations, ModeSetting};
pub(crate) use monitors::{Ending, ROUNDING_OF_VELOCITIES};
pub use smooth_phase::{ModeEvaluators, SmoothPhase};
pub(crate) use transition::{Impact, Transition};

use super::contact_event::ContactEvent;
use super::energy::Energy;
use super::settings::{ContactError, Settings};
use super::velocity_step::{Forces, Probed, Scales, State, VelocityStep};
use super::violations::Violations;
use grazing::Opening;
use nalgebra::{Vector2, Vector3};
use problem::{Constraints, Control, EventKind, Mechanical, MechanicalStructure};

/// The one-step method for smooth motion between events: Radau IIA.
pub(crate) type Method<'l> = radau::Radau<'l>;

/// Velocities below this fraction of the sum of the absolute values of their terms are rounding errors.
const ROUNDING: f64 = 1e-11;

/// Relative slip tolerance: a contact sticks if its slip is below this fraction of the velocity change in the probe
/// step.
const STICK_TOL: f64 = 1e-7;

/// Slack in the friction bound, relative to `mu r_n`: a contact whose friction reached the bound slips if its slack
/// in the probe step is smaller; with more slack, redundant contacts take over its load.
const FRICTION_SLACK: f64 = 1e-4;

/// Impacts of one contact accumulate if they follow each other within this fraction of the longest time between two of
/// them: the remaining energy is below rounding.
const ZENO: f64 = 1e-10;

/// Intervals of time below this multiple of the rounding of the clock count as zero.
const ROUNDING_OF_TIME: f64 = 1e3 * f64::EPSILON;

/// Steps of time stepping without a mode: their growth (`GROWTH`), relative to the preceding step or to the probe
/// step that found no mode; and their largest size (`LONGEST_PASS`) in units of the probe step, for which forces
/// change velocities by `1e-3` of their terms.
const GROWTH: f64 = 4.0;
const LONGEST_PASS: f64 = 1e4;

/// The first step of time stepping without a mode if there was no probe step, as a fraction of the remaining time.
const UNPROBED: f64 = 1e-9;

/// Number of events at one and the same time after which time stepping takes over.
const MAX_EVENTS_AT_ONE_TIME: usize = 8;

/// An event-driven run: the data that persist from mode to mode.
pub struct EventDriven<'p> {
    /// The integrator of steps at the level of velocities.
    pub step: VelocityStep<'p>,
    /// The current state of the run.
    pub state: State,
    /// The state at the beginning of the last step of the run.
    pub last: State,
    /// Accumulated impulse of each contact since the start of the run.
    pub impulses: Vec<Vector3<f64>>,
    /// Accumulated impulse of each contact at the beginning of the last step.
    pub impulses_before: Vec<Vector3<f64>>,
    /// The energy balance of the run.
    pub energy: Energy,
    /// The energy balance at the beginning of the last step.
    pub energy_before: Energy,
    /// The contact events (impact, lift-off, stick or slip) of the last step.
    pub new_events: Vec<ContactEvent>,
    /// The number of steps that the run has made.
    pub accepted: u64,
    /// The number of steps made by time stepping.
    pub passes: u64,
    /// The number of accumulations of impacts.
    pub accumulations: u64,
    /// The largest violations of joints and gaps in the run so far.
    pub violations: Violations,
    /// The accumulation of impacts whose replacement by one impact without restitution removed the most energy, if any.
    pub passed: Option<Passed>,
    /// Counts of steps by the result of enclosing events within them.
    pub screening: Screening,
    /// The grazing contact with the largest possible error of its normal velocity, if any.
    pub grazed: Option<Grazed>,
    /// The transition at the end of the last step, if a smooth arc ended at that time or the run began.
    pub(crate) transition: Option<Transition>,
    /// Whether a contact grazed within the last step or at its end.
    pub(crate) grazes: bool,
    /// The largest opening of each gap since the contact was last closed.
    highest: Vec<Opening>,
    /// The status of each contact; `None` where time stepping takes over.
    pub(crate) mode: Option<Vec<Status>>,
    /// Reference forces on contacts: if multipliers are not unique, those nearest to the reference are used. The
    /// reference is the normal force of the probe; after a stick-slip transition, where a contact took too large a
    /// share of the friction, it includes the friction of the probe.
    pub(crate) loads: Vec<Vector3<f64>>,
    /// The coefficient of friction of each contact at the beginning of the mode.
    pub(crate) coefficients: Vec<f64>,
    pub(crate) structure: MechanicalStructure,
    constraints: Constraints,
    last_impact: Vec<f64>,
    /// The longest time between two successive impacts of each contact so far.
    longest_flight: Vec<f64>,
    pub(crate) radau: radau::Settings,
    /// The last step size of Radau IIA, with which the next mode starts.
    h: Option<f64>,
    /// The next step size of time stepping; zero if the last step was smooth motion.
    pass: f64,
    stalls: usize,
    end: f64,
}

/// Counts of steps of smooth motion, by the result of enclosing events within them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Screening {
    /// The number of steps proven free of events.
    pub proven: u64,
    /// The number of steps that are neither proven free of events nor found to have one.
    pub undecided: u64,
    /// The number of steps with a violation that could not be located, or with forces that the law of contact excludes.
    pub missed: u64,
}

/// An accumulation of impacts that was replaced by one impact without restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed {
    /// The time of the accumulation of impacts.
    pub t: f64,
    /// The index of the contact with the repeated impacts.
    pub contact: usize,
    /// The energy that the replacement by one impact without restitution removed.
    pub energy: f64,
    /// Whether the contact has restitution 1: its impacts lose no energy and have no limit.
    pub is_elastic: bool,
}

impl<'p> EventDriven<'p> {
    /// Prepares a run from `state` to `end`: applies the law of impact to contacts that approach, and selects the first
    /// mode.
    ///
    /// # Errors
    /// See [`VelocityStep::advance`].
    pub fn new(
        problem: &'p mut dyn Mechanical,
        settings: &Settings,
        radau: radau::Settings,
        state: State,
        end: f64,
        control: &Control,
    ) -> Result<Self, ContactError> {
        let structure = problem.structure().clone();
        let contacts = structure.contacts.len();
        let energies = problem.energies(state.t, &state.q, &state.v);
        let violations = Violations::new(&structure, &state.q);
        let mut located = Self {
            violations,
            passed: None,
            screening: Screening::default(),
            grazed: None,
            transition: None,
            grazes: false,
            highest: vec![Opening::default(); contacts],
            step: VelocityStep::new(problem, settings.impact_law, settings.tolerance),
            last: state.clone(),
            state,
            impulses: vec![Vector3::zeros(); contacts],
            impulses_before: vec![Vector3::zeros(); contacts],
            energy: Energy::new(energies.kinetic, energies.potential),
            energy_before: Energy::new(energies.kinetic, energies.potential),
            new_events: Vec::new(),
            accepted: 0,
            passes: 0,
            accumulations: 0,
            mode: None,
            loads: vec![Vector3::zeros(); contacts],
            coefficients: vec![0.0; contacts],
            constraints: Constraints::new(&structure),
            structure,
            last_impact: vec![f64::NEG_INFINITY; contacts],
            longest_flight: vec![0.0; contacts],
            radau,
            h: None,
            pass: 0.0,
            stalls: 0,
            end,
        };
        located.step.atol = located.radau.atol[located.structure.coordinates..].to_vec();
        located.note_transition(vec![Status::Open; contacts], None);
        located.apply_impact_law(control)?;
        located.select_mode(None, control)?;
        Ok(located)
    }

    /// Whether the run has reached its end time.
    pub fn is_done(&self) -> bool {
        self.state.t >= self.end
    }

    /// Returns the relative tolerance of smooth motion, and the absolute tolerances of `q` and `v`; `None` for a
    /// constant step size.
    pub fn tolerances(&self) -> Option<(f64, &[f64])> {
        self.radau.step.is_none().then_some((self.radau.rtol, &self.radau.atol))
    }

    /// Returns the times at which the last step began, and at which its smooth arc ended: before the transition, if
    /// there was one.
    pub(crate) fn last_arc(&self) -> (f64, f64) {
        let end = self.transition.as_ref().map_or(self.state.t, |transition| transition.before.t);
        (self.last.t, end)
    }

    /// Handles the event that ends a contact mode: applies the law of impact, records events, and selects the next
    /// mode.
    fn switch_mode(&mut self, ending: Ending, control: &Control) -> Result<(), ContactError> {
        self.stalls = if self.state.t > self.last.t { 0 } else { self.stalls + 1 };
        let before = self.mode.take().unwrap_or_default();
        let t = self.state.t;
        self.note_transition(before.clone(), Some(ending));
        if self.stalls > MAX_EVENTS_AT_ONE_TIME {
            return Ok(());
        }
        // Remove the drift of held constraints, which would be mistaken for a slip.
        let mut kept = before.clone();
        if let Ending::SlipToStick(k) = ending {
            kept[k] = Status::Stick;
        }
        self.project_onto_constraints(&kept)?;
        match ending {
            Ending::Impact(k) => {
                self.evaluate_constraints();
                self.step.closing = Some(k);
                if self.is_gradient_lost(k) {
                    return Err(ContactError::Gradient { contact: k, t });
                }
                if self.accumulates(k) {
                    self.accumulations += 1;
                    let lost = self.energy.lost_in_impacts;
                    self.velocity_step(0.0, Forces::Inelastic, control)?;
                    if let Some(Transition { impact: Some(impact), .. }) = &mut self.transition {
                        impact.accumulates = Some(k);
                    }
                    self.note_passed(k, self.energy.lost_in_impacts - lost);
                    // The contact of the impact is brought to rest even without an impulse if it closes again at the
                    // time of the last event.
                    let rests = |&i: &usize| self.step.contacted.r[i].x > 0.0 || i == k && self.stalls > 0;
                    let resting: Vec<usize> = (0..self.structure.contacts.len()).filter(rests).collect();
                    self.bring_to_rest(&resting)?;
                } else if !self.apply_impact_law(control)? {
                    self.bring_to_rest(&[k])?;
                }
            }
            Ending::Detachment(k) => self.new_events.push(ContactEvent { t, kind: EventKind::LiftOff, contact: k }),
            Ending::StickToSlip(k, _) => self.new_events.push(ContactEvent { t, kind: EventKind::Slip, contact: k }),
            Ending::SlipToStick(_) => {}
        }
        self.step.closing = None;
        self.select_mode(Some(ending), control)?;
        let mode = self.mode.iter().flatten().zip(&before).enumerate();
        let stops = matches!(ending, Ending::SlipToStick(_));
        let stopped = mode.filter(|(_, pair)| stops && matches!(pair, (Status::Stick, Status::Slip(_))));
        self.new_events.extend(stopped.map(|(contact, _)| ContactEvent { t, kind: EventKind::Stick, contact }));
        Ok(())
    }

    /// Handles a breakpoint in time that a mode with closed contacts reached: velocities of surfaces may jump or have
    /// a corner there, so that contacts approach, detach or begin to slip while no monitor of the mode crosses zero.
    fn pass_break(&mut self, before: &[Status], control: &Control) -> Result<(), ContactError> {
        self.note_transition(before.to_vec(), None);
        let is_struck = self.apply_impact_law(control)?;
        self.select_mode(None, control)?;
        let mode = self.mode.as_deref().unwrap_or_default();
        if !is_struck && mode.len() == before.len() && mode.iter().zip(before).all(|(a, b)| a.continues(b)) {
            self.transition = None;
        }
        let t = self.state.t;
        let kind = |pair: (&Status, &Status)| match pair {
            (Status::Stick, Status::Slip(_)) => Some(EventKind::Slip),
            (Status::Slip(_), Status::Stick) => Some(EventKind::Stick),
            (before, Status::Open) if before.is_closed() => Some(EventKind::LiftOff),
            _ => None,
        };
        let changes = before.iter().zip(mode).map(kind).enumerate();
        let events = changes.filter_map(|(contact, kind)| Some(ContactEvent { t, kind: kind?, contact }));
        self.new_events.extend(events);
        Ok(())
    }

    /// Records the transition between contact modes that begins at the current state; `mode` is the contact mode before
    /// it.
    fn note_transition(&mut self, mode: Vec<Status>, ending: Option<Ending>) {
        let (before, grazes) = (self.state.clone(), self.grazes);
        self.transition = Some(Transition { before, mode, ending, impact: None, grazes });
    }

    /// Records an accumulation of impacts, keeping the one whose replacement removed the most energy; contacts with
    /// restitution 1 take precedence.
    fn note_passed(&mut self, contact: usize, energy: f64) {
        let is_elastic = self.structure.contacts[contact].restitution == 1.0;
        let passed = Passed { t: self.state.t, contact, energy, is_elastic };
        if self.passed.is_none_or(|worst| (is_elastic, energy) >= (worst.is_elastic, worst.energy)) {
            self.passed = Some(passed);
        }
    }

    /// Whether impacts of the closing contact `k` accumulate: it returned after no time, or from a height within the
    /// rounding error of its gap.
    fn accumulates(&self, k: usize) -> bool {
        let State { t, q, v } = &self.state;
        let passed = t - self.last_impact[k];
        let terms = self.constraints.size(self.structure.normal(k), q);
        let height = 0.25 * passed * self.normal(k, v).abs();
        // Impacts with restitution 1 may follow each other fast, but have no limit.
        let zeno = if self.structure.contacts[k].restitution == 1.0 { 0.0 } else { ZENO * self.longest_flight[k] };
        passed < zeno.max(ROUNDING_OF_TIME * t.abs()) || height <= 4.0 * f64::EPSILON * terms
    }

    /// Applies the impact law to all closed contacts if one of them approaches; returns whether one approaches.
    fn apply_impact_law(&mut self, control: &Control) -> Result<bool, ContactError> {
        self.evaluate_constraints();
        let State { t, v, .. } = &self.state;
        let approaching: Vec<usize> = (0..self.structure.contacts.len())
            .filter(|&k| (self.is_closed(k) || self.step.closing == Some(k)) && self.normal(k, v) < 0.0)
            .collect();
        if approaching.iter().all(|&k| -self.normal(k, v) <= self.rounding(k, v)) {
            return Ok(false);
        }
        let t = *t;
        self.velocity_step(0.0, Forces::Impact, control)?;
        for k in approaching {
            if self.step.contacted.r[k].x > 0.0 {
                let passed = t - std::mem::replace(&mut self.last_impact[k], t);
                if passed.is_finite() {
                    self.longest_flight[k] = self.longest_flight[k].max(passed);
                }
                self.new_events.push(ContactEvent { t, kind: EventKind::Impact, contact: k });
            }
        }
        Ok(true)
    }

    /// Brings contacts to rest in the normal direction, also on moving or curved surfaces: their remaining normal
    /// velocity is rounding.
    fn bring_to_rest(&mut self, contacts: &[usize]) -> Result<(), ContactError> {
        let mut mode = vec![Status::Open; self.structure.contacts.len()];
        contacts.iter().for_each(|&k| mode[k] = Status::Frictionless);
        self.project_onto_constraints(&mode)
    }

    /// Returns the tolerance of the slip of contact `k` that follows from the tolerances of velocities.
    fn tolerance_of_slip(&self, k: usize, constraints: &Constraints, v: &[f64]) -> f64 {
        let tolerances = self.radau.tolerances(v.len(), v);
        self.structure.tangents(k).map(|row| constraints.size(row, &tolerances)).fold(0.0, f64::max)
    }

    /// Returns the slip tolerances of all contacts at zero velocity.
    pub(crate) fn tolerances_of_slips(&mut self) -> Vec<f64> {
        self.evaluate_constraints();
        let none = vec![0.0; self.structure.coordinates];
        (0..self.structure.contacts.len()).map(|k| self.tolerance_of_slip(k, &self.constraints, &none)).collect()
    }

    /// Projects the state onto the constraints that a contact mode holds at zero: joints, closed gaps, and slips of
    /// sticking contacts.
    fn project_onto_constraints(&mut self, mode: &[Status]) -> Result<(), ContactError> {
        let rows = held(&self.structure, mode);
        if rows.is_empty() { Ok(()) } else { self.step.project(&mut self.state, &rows) }
    }

    /// Makes a step at the level of velocities, or an impact with `h = 0`, as part of the trajectory.
    fn velocity_step(&mut self, h: f64, forces: Forces, control: &Control) -> Result<(), ContactError> {
        let h = h.min(self.end - self.state.t);
        let State { t, q, v } = &self.state;
        let before = self.step.problem.energies(*t, q, v);
        let limited = self.step.work.limited;
        self.step.advance(&mut self.state, h, forces, control)?;
        if let Some(transition) = self.transition.as_mut().filter(|_| forces != Forces::All) {
            transition.impact = Some(Impact {
                strikes: std::mem::take(&mut self.step.strikes),
                contacted: self.step.contacted.clone(),
                rebounds: forces == Forces::Impact,
                is_limited: self.step.work.limited > limited,
                accumulates: None,
            });
        }
        let State { t, q, v } = &self.state;
        let after = self.step.problem.energies(*t, q, v);
        self.impulses.iter_mut().zip(&self.step.contacted.r).for_each(|(sum, r)| *sum += r);
        self.step.contacted.book(h, &before, &after, &mut self.energy);
        Ok(())
    }

    /// Makes one step of time stepping where no contact mode is known, and tries to select the mode of the motion after
    /// it.
    fn step_over(&mut self, control: &Control) -> Result<(), ContactError> {
        self.begin();
        let left = self.end - self.state.t;
        let (first, longest) = self.step.instant.map_or((UNPROBED * left, left), |h| (GROWTH * h, LONGEST_PASS * h));
        let h = self.pass.max(first).min(longest).max(16.0 * f64::EPSILON * self.state.t.abs());
        self.pass = GROWTH * h;
        self.velocity_step(h, Forces::All, control)?;
        if self.end - self.state.t <= 4.0 * f64::EPSILON * self.end.abs() {
            self.state.t = self.end;
        }
        self.accepted += 1;
        self.passes += 1;
        self.stalls = 0;
        self.select_mode(None, control)
    }

    /// Saves the state, impulses and energy at the beginning of a step.
    fn begin(&mut self) {
        self.last.clone_from(&self.state);
        (self.transition, self.grazes) = (None, false);
        self.impulses_before.clone_from(&self.impulses);
        self.energy_before = self.energy;
    }

    fn evaluate_constraints(&mut self) {
        self.step.problem.constraints(self.state.t, &self.state.q, &mut self.constraints);
        let (of_q, _) = self.radau.atol.split_at(self.structure.coordinates);
        self.step.meet(&self.constraints, &self.state.q, of_q);
    }

    fn is_closed(&self, k: usize) -> bool {
        self.constraints.values[self.structure.joints + k] <= self.step.closed(self.structure.joints + k)
    }

    fn normal(&self, k: usize, v: &[f64]) -> f64 {
        self.constraints.velocity(self.structure.normal(k), v)
    }

    /// Returns the rounding error of the normal velocity of contact `k` at velocities `v`.
    fn rounding(&self, k: usize, v: &[f64]) -> f64 {
        ROUNDING * self.constraints.terms(self.structure.normal(k), v)
    }

    /// Selects the mode of the motion after the event by a probe step, and projects `q` and `v` onto its constraints;
    /// leaves the mode unset if there is none.
    fn select_mode(&mut self, ending: Option<Ending>, control: &Control) -> Result<(), ContactError> {
        self.mode = None;
        self.evaluate_constraints();
        let contacts = self.structure.contacts.len();
        let candidates: Vec<usize> =
            (0..contacts).filter(|&k| ending != Some(Ending::Detachment(k)) && self.is_closed(k)).collect();
        let mut mode = vec![Status::Open; contacts];
        self.loads = vec![Vector3::zeros(); contacts];
        if !candidates.is_empty() {
            let (_, of_v) = self.radau.atol.split_at(self.structure.coordinates);
            let before = self.transition.as_ref().map_or(&self.state, |transition| &transition.before);
            let pairs = self.state.v.iter().zip(&before.v);
            let reached: Vec<f64> = pairs.map(|(v, before)| v.abs().max(before.abs())).collect();
            let scales = Scales { atol: of_v, reached: &reached, left: self.end - self.state.t };
            let (h, probed) = match self.step.probe(&self.state, scales, &candidates, control) {
                Ok(Some(found)) => found,
                // No mode: Painleve's paradox, or a contact law without a solution for steps of the length of the
                // probe.
                Ok(None) | Err(ContactError::Unsolved { .. }) => return Ok(()),
                Err(error) => return Err(error),
            };
            let largest = probed.iter().fold(0.0_f64, |most, probed| most.max(probed.r.x));
            for probed in probed.iter().filter(|probed| probed.r.x > ROUNDING * largest) {
                let k = probed.contact;
                mode[k] = self.status(probed, ending);
                self.coefficients[k] = probed.mu;
                let broke = matches!(ending, Some(Ending::StickToSlip(..)));
                self.loads[k] = if broke { probed.r / h } else { Vector3::x() * (probed.r.x / h) };
            }
            if self.stalls == 0 {
                self.release_driven(&probed, &mut mode);
            }
        }
        self.project_onto_constraints(&mode)?;
        self.mode = Some(mode);
        Ok(())
    }

    fn status(&self, probed: &Probed, ending: Option<Ending>) -> Status {
        let k = probed.contact;
        if self.structure.contacts[k].slips == 0 {
            return Status::Frictionless;
        }
        let tangent = |u: &Vector3<f64>| Vector2::new(u.y, u.z);
        // A contact at its friction bound slips, unless redundant contacts take over its load.
        let most = probed.mu * probed.r.x;
        if let Some(Ending::StickToSlip(contact, direction)) = ending
            && contact == k
            && tangent(&probed.r).norm() > (1.0 - FRICTION_SLACK) * most
        {
            return Status::Slip(direction);
        }
        let (before, after) = (tangent(&probed.before), tangent(&probed.after));
        let stopped = matches!(ending, Some(Ending::SlipToStick(contact)) if contact == k);
        if before.norm() > probed.rounding && !stopped {
            Status::Slip(before.normalize())
        } else if after.norm() <= STICK_TOL * probed.change {
            Status::Stick
        } else {
            Status::Slip(after.normalize())
        }
    }
}
