//! Impacts located: smooth motion by Radau IIA, a [mode](Status) at a time, cut where the mode ends.
//!
//! - A mode ends where a gap closes, a contact pulls, sticks no more or ceases to slip. The time is found on the
//!   collocation polynomial and refined by solving the step anew up to it, so that it has the order of the method.
//! - Where contacts approach each other, the law of impact acts at once.
//! - The next mode is read off a step at the level of velocities, so short that only directions count, with the same law:
//!   no mode is guessed, and where forces alone have no solution (Painleve 1895) or have too many, impulses decide.
//! - Where impacts accumulate (Zeno), an impact without restitution is what they come to.
//! - Where no mode goes on, steps of time stepping do, until one does again.

mod bursts;
mod closed;
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

pub use grazing::Grazed;
pub use mode::Status;
pub use smooth_phase::{ModeEvaluators, SmoothPhase};

use super::contact_event::ContactEvent;
use super::energy::Energy;
use super::settings::{ContactError, Settings};
use super::velocity_step::{Forces, Probed, State, VelocityStep};
use super::violations::Violations;
use grazing::Opening;
use mode::held;
use monitors::Ending;
use nalgebra::{Vector2, Vector3};
use problem::{Constraints, Control, EventKind, Mechanical, MechanicalStructure};

/// Velocities below this fraction of their terms are rounding.
const ROUNDING: f64 = 1e-11;

/// Relative slip tolerance: a contact sticks if its slip is below this fraction of the velocity change in the probe.
const STICK_TOL: f64 = 1e-7;

/// Slack in the friction bound, relative to `mu r_n`, below which a contact slips although others could hold for it.
const FRICTION_SLACK: f64 = 1e-4;

/// Impacts of one contact that follow each other in less than this fraction of the longest time between two of them
/// accumulate: what energy they have left is below rounding.
const ZENO: f64 = 1e-10;

/// Times below this multiple of the rounding of the clock are not told apart.
const ROUNDING_OF_TIME: f64 = 1e3 * f64::EPSILON;

/// What a step over what cannot be located is longer than the probe that has found no mode, or than the step before that
/// was not enough; and the longest, in units of the probe: forces change velocities by `1e-3` of their terms.
const GROWTH: f64 = 4.0;
const LONGEST_PASS: f64 = 1e4;

/// The first step where there was no probe, as a fraction of the time that is left.
const UNPROBED: f64 = 1e-9;

/// Events at one time after which time stepping goes on.
const MAX_EVENTS_AT_ONE_TIME: usize = 8;

/// A run with located impacts: what lasts from mode to mode.
pub struct EventDriven<'p> {
    /// Steps at the level of velocities.
    pub step: VelocityStep<'p>,
    /// Where it has come to.
    pub state: State,
    /// Where the last step began.
    pub last: State,
    /// Impulses of each contact since the start.
    pub impulses: Vec<Vector3<f64>>,
    /// Their values where the last step began.
    pub impulses_before: Vec<Vector3<f64>>,
    /// Where the energy went.
    pub energy: Energy,
    /// Where it had gone where the last step began.
    pub energy_before: Energy,
    /// What happened in the last step.
    pub new_events: Vec<ContactEvent>,
    /// Steps made.
    pub accepted: u64,
    /// Steps made by time stepping.
    pub passes: u64,
    /// Times at which impacts accumulated.
    pub accumulations: u64,
    /// How far joints and gaps were off.
    pub violations: Violations,
    /// What accumulations were passed over.
    pub passed: Option<Passed>,
    /// What the enclosures of steps told of events within.
    pub screening: Screening,
    /// The contact that grazed with the largest consequence.
    pub grazed: Option<Grazed>,
    /// How far each gap was open since its last contact.
    highest: Vec<Opening>,
    /// What each contact does; `None` where time stepping is to go on.
    mode: Option<Vec<Status>>,
    /// The force on each contact from which those of the mode are the nearest, where they are not unique: the normal force
    /// of the law; its friction too, where a share of friction has turned out to be too large.
    loads: Vec<Vector3<f64>>,
    structure: MechanicalStructure,
    constraints: Constraints,
    last_impact: Vec<f64>,
    /// The longest time between two impacts of each contact.
    longest_flight: Vec<f64>,
    radau: radau::Settings,
    /// The last step of Radau IIA, for the next mode to begin with.
    h: Option<f64>,
    /// The next step of time stepping; zero after smooth motion.
    pass: f64,
    stalls: usize,
    end: f64,
}

/// Steps of smooth motion, by what enclosures told of events within them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Screening {
    /// Steps proven free of events.
    pub proven: u64,
    /// Steps that are neither proven free of events nor seen to have one.
    pub undecided: u64,
    /// Steps with a violation that could not be located.
    pub missed: u64,
}

/// An accumulation of impacts that was passed over by one without restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed {
    /// When.
    pub t: f64,
    /// The contact that came back.
    pub contact: usize,
    /// The energy that was taken.
    pub energy: f64,
    /// Whether nothing takes energy in the contact, so that its impacts have no limit.
    pub is_elastic: bool,
}

impl<'p> EventDriven<'p> {
    /// Prepares a run from `state` to `end`: strikes what approaches, and finds the first mode.
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
        located.apply_impact_law(control)?;
        located.select_mode(None, control)?;
        Ok(located)
    }

    /// Whether the end is reached.
    pub fn is_done(&self) -> bool {
        self.state.t >= self.end
    }

    /// Goes on after the end of a mode.
    fn switch_mode(&mut self, ending: Ending, control: &Control) -> Result<(), ContactError> {
        self.stalls = if self.state.t > self.last.t { 0 } else { self.stalls + 1 };
        let before = self.mode.take().unwrap_or_default();
        let t = self.state.t;
        if self.stalls > MAX_EVENTS_AT_ONE_TIME {
            return Ok(());
        }
        // What was held has drifted by the tolerance, which is not to pass for a slip.
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
                    self.note_passed(k, self.energy.lost_in_impacts - lost);
                    // What closes in no time has no rebound.
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

    /// Keeps the accumulation that took the most energy, one of contacts that take none before others.
    fn note_passed(&mut self, contact: usize, energy: f64) {
        let is_elastic = self.structure.contacts[contact].restitution == 1.0;
        let passed = Passed { t: self.state.t, contact, energy, is_elastic };
        if self.passed.is_none_or(|worst| (is_elastic, energy) >= (worst.is_elastic, worst.energy)) {
            self.passed = Some(passed);
        }
    }

    /// Whether contact `k`, which closes, has come back in no time, or from no more than rounding of its gap.
    fn accumulates(&self, k: usize) -> bool {
        let State { t, q, v } = &self.state;
        let passed = t - self.last_impact[k];
        let terms = self.constraints.size(self.structure.normal(k), q);
        let height = 0.25 * passed * self.normal(k, v).abs();
        // Impacts that give all back follow each other fast, but have no limit.
        let zeno = if self.structure.contacts[k].restitution == 1.0 { 0.0 } else { ZENO * self.longest_flight[k] };
        passed < zeno.max(ROUNDING_OF_TIME * t.abs()) || height <= 4.0 * f64::EPSILON * terms
    }

    /// The law of impact for all contacts that are closed, if any of them approaches; whether one does.
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

    /// Lets contacts rest, also on surfaces that move or are curved: what velocity they have left is rounding.
    fn bring_to_rest(&mut self, contacts: &[usize]) -> Result<(), ContactError> {
        let mut mode = vec![Status::Open; self.structure.contacts.len()];
        contacts.iter().for_each(|&k| mode[k] = Status::Smooth);
        self.project_onto_constraints(&mode)
    }

    /// What the tolerances on velocities leave open of a slip.
    fn tolerance_of_slip(&self, k: usize, constraints: &Constraints, v: &[f64]) -> f64 {
        let tolerances = self.radau.tolerances(v.len(), v);
        self.structure.tangents(k).map(|row| constraints.size(row, &tolerances)).fold(0.0, f64::max)
    }

    /// The tolerances of the slips of all contacts at rest.
    fn tolerances_of_slips(&mut self) -> Vec<f64> {
        self.evaluate_constraints();
        let none = vec![0.0; self.structure.coordinates];
        (0..self.structure.contacts.len()).map(|k| self.tolerance_of_slip(k, &self.constraints, &none)).collect()
    }

    /// Takes drift out of what the mode holds.
    fn project_onto_constraints(&mut self, mode: &[Status]) -> Result<(), ContactError> {
        let rows = held(&self.structure, mode);
        if rows.is_empty() { Ok(()) } else { self.step.project(&mut self.state, &rows) }
    }

    /// A step at the level of velocities, or an impact with `h = 0`, that is part of the trajectory.
    fn velocity_step(&mut self, h: f64, forces: Forces, control: &Control) -> Result<(), ContactError> {
        let h = h.min(self.end - self.state.t);
        let State { t, q, v } = &self.state;
        let before = self.step.problem.energies(*t, q, v);
        self.step.advance(&mut self.state, h, forces, control)?;
        let State { t, q, v } = &self.state;
        let after = self.step.problem.energies(*t, q, v);
        self.impulses.iter_mut().zip(&self.step.contacted.r).for_each(|(sum, r)| *sum += r);
        self.step.contacted.book(h, &before, &after, &mut self.energy);
        Ok(())
    }

    /// One step of time stepping where no mode is known, and a look for one.
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

    /// Notes where a step begins.
    fn begin(&mut self) {
        self.last.clone_from(&self.state);
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

    /// What is rounding in the normal velocity of a contact.
    fn rounding(&self, k: usize, v: &[f64]) -> f64 {
        ROUNDING * self.constraints.terms(self.structure.normal(k), v)
    }

    /// Finds the mode in which motion goes on, and puts `q` and `v` exactly on what it holds.
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
            let (h, probed) = match self.step.probe(&self.state, (of_v, self.end - self.state.t), &candidates, control)
            {
                Ok(Some(found)) => found,
                // Friction that drives a contact into what it slides on, or a law without a solution at this scale.
                Ok(None) | Err(ContactError::Unsolved { .. }) => return Ok(()),
                Err(error) => return Err(error),
            };
            let largest = probed.iter().fold(0.0_f64, |most, probed| most.max(probed.r.x));
            for probed in probed.iter().filter(|probed| probed.r.x > ROUNDING * largest) {
                let k = probed.contact;
                mode[k] = self.status(k, probed, ending);
                let broke = matches!(ending, Some(Ending::StickToSlip(..)));
                self.loads[k] = if broke { probed.r / h } else { Vector3::x() * (probed.r.x / h) };
            }
        }
        self.project_onto_constraints(&mode)?;
        self.mode = Some(mode);
        Ok(())
    }

    fn status(&self, k: usize, probed: &Probed, ending: Option<Ending>) -> Status {
        if self.structure.contacts[k].slips == 0 {
            return Status::Smooth;
        }
        let tangent = |u: &Vector3<f64>| Vector2::new(u.y, u.z);
        // A contact that breaks slips, unless others can hold for it.
        let most = self.structure.contacts[k].mu * probed.r.x;
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
