//! Time stepping over impacts (Moreau 1988; Stewart and Trinkle 1996): steps of constant size that are not cut at
//! impacts, so that any number of impacts, even infinitely many, costs nothing. First order.

use super::contact_event::ContactEvent;
use super::delassus::dot;
use super::energy::Energy;
use super::settings::{ContactError, Settings};
use super::velocity_step::{Forces, State, VelocityStep};
use super::violations::Violations;
use nalgebra::Vector3;
use problem::{Control, EventKind, Mechanical};

/// A time-stepping run with constant step size.
pub struct TimeStepping<'p> {
    /// The integrator of one step at the level of velocities.
    pub step: VelocityStep<'p>,
    /// The current state of the run.
    pub state: State,
    /// The state at the beginning of the last step.
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
    /// The largest violations of joints and gaps in the run so far.
    pub violations: Violations,
    /// The status (open, or closed for a while) of each contact after the last step.
    touching: Vec<Touch>,
    /// Forces and velocities at the beginning of the step before the last; `None` in the first step.
    before: Option<(Vec<f64>, Vec<f64>)>,
    settings: Settings,
    start: f64,
    end: f64,
    /// Workspace: coordinates at a time within a step, and the values of joints and gaps at these coordinates.
    between: (Vec<f64>, Vec<f64>),
}

/// Fractions of a step at which the values of joints and gaps are also checked for violations; multiples of the
/// golden ratio, to avoid multiples of a period of the motion.
const BETWEEN: [f64; 2] = [0.381_966_011_250_105, 0.763_932_022_500_210];

/// The status of a contact in a step: open, or closed for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Touch {
    Open,
    /// The contact has been closed for `steps` consecutive steps.
    Struck {
        steps: u64,
        slips: bool,
    },
}

/// Velocities and gaps below this fraction of the terms that add up to them count as zero.
const ZERO_TOL: f64 = 1e-10;

impl<'p> TimeStepping<'p> {
    /// Prepares a time-stepping run from `state` to the time `end`.
    pub fn new(problem: &'p mut dyn Mechanical, settings: Settings, state: State, end: f64) -> Self {
        let contacts = problem.structure().contacts.len();
        let energies = problem.energies(state.t, &state.q, &state.v);
        let violations = Violations::new(problem.structure(), &state.q);
        let between = (state.q.clone(), vec![0.0; problem.structure().joints + contacts]);
        Self {
            violations,
            between,
            step: VelocityStep::new(problem, settings.impact_law, settings.tolerance),
            last: state.clone(),
            start: state.t,
            state,
            impulses: vec![Vector3::zeros(); contacts],
            impulses_before: vec![Vector3::zeros(); contacts],
            energy: Energy::new(energies.kinetic, energies.potential),
            energy_before: Energy::new(energies.kinetic, energies.potential),
            new_events: Vec::new(),
            accepted: 0,
            touching: vec![Touch::Open; contacts],
            before: None,
            settings,
            end,
        }
    }

    /// Whether the run has reached its end time.
    pub fn is_done(&self) -> bool {
        self.state.t >= self.end
    }

    /// Makes one step of the constant step size, shortened at the end of the run.
    ///
    /// # Errors
    /// See [`VelocityStep::advance`].
    pub fn advance(&mut self, control: &Control) -> Result<(), ContactError> {
        // Count the time from the start, so that rounding does not accumulate.
        let next = self.start + (self.accepted + 1) as f64 * self.settings.step;
        let next = if next + 1e-6 * self.settings.step >= self.end { self.end } else { next };
        self.advance_to(next, control)
    }

    /// Makes one step, up to the time `next`.
    ///
    /// # Errors
    /// See [`VelocityStep::advance`].
    pub fn advance_to(&mut self, next: f64, control: &Control) -> Result<(), ContactError> {
        self.last.clone_from(&self.state);
        self.impulses_before.clone_from(&self.impulses);
        self.energy_before = self.energy;
        let h = next - self.state.t;
        let State { t, q, v } = &self.last;
        let before = self.step.problem.energies(*t, q, v);
        self.step.advance(&mut self.state, h, Forces::All, control)?;
        self.state.t = next;
        self.accepted += 1;
        for (sum, r) in self.impulses.iter_mut().zip(&self.step.contacted.r) {
            *sum += r;
        }
        let State { t, q, v } = &self.state;
        let after = self.step.problem.energies(*t, q, v);
        self.step.contacted.book(h, &before, &after, &mut self.energy);
        self.energy.close_at_middle(after.potential - before.potential);
        self.explain(h, before.kinetic.max(after.kinetic));
        self.record_events(h);
        self.measure(h);
        Ok(())
    }

    /// Returns the gap below which contact `k` is closed.
    pub fn closed(&self, k: usize) -> f64 {
        self.step.closed(self.step.structure.normal(k))
    }

    /// Whether contact `k` is closed after the last step, and does not open with its end velocity.
    pub fn stays_closed(&self, k: usize) -> bool {
        let contacted = &self.step.contacted;
        let terms = self.step.constraints.terms(self.step.structure.normal(k), &self.state.v) + contacted.change[k];
        self.touching[k] != Touch::Open && contacted.after[k].x <= ZERO_TOL * terms
    }

    /// Whether contact `k` is closed after the last step, and sticks.
    pub fn sticks(&self, k: usize) -> bool {
        matches!(self.touching[k], Touch::Struck { slips: false, .. }) && self.stays_closed(k)
    }

    /// Removes from a change of coordinates or velocities at the end of the last step the components that violate
    /// joints and closed contacts; from a change of velocities also the slips of sticking contacts.
    pub fn hold_back(&mut self, change: &mut [f64], is_of_velocities: bool) {
        let structure = &self.step.structure;
        let mut rows: Vec<usize> = (0..structure.joints).collect();
        for k in (0..structure.contacts.len()).filter(|&k| self.stays_closed(k)) {
            rows.push(structure.normal(k));
            if is_of_velocities && self.sticks(k) {
                rows.extend(structure.tangents(k));
            }
        }
        let constraints = &self.step.constraints;
        let off: Vec<f64> = rows.iter().map(|&row| dot(constraints.row(row), change)).collect();
        let mut held = change.to_vec();
        if off.iter().any(|off| *off != 0.0) && self.step.delassus.remove(constraints, &rows, &off, &mut held) {
            change.copy_from_slice(&held);
        }
    }

    /// Records the estimated energy error of the last step, with its largest kinetic energy. The scheme pairs forces
    /// at the beginning of a step with velocities at its end, whereas in the exact motion forces and velocities
    /// change together: `h/2 |<df, v>| + h/2 |<f, dv>|`. The joint forces are the part of `M dv/h` beyond `f`: with
    /// them a step loses the energy `<M dv, dv>/2`, which a motor that prescribes a speed supplies again.
    fn explain(&mut self, h: f64, kinetic: f64) {
        let (f, v) = (&self.step.f, &self.last.v);
        let (f_before, v_before) = self.before.get_or_insert_with(|| (f.clone(), v.clone()));
        let change = |now: &[f64], before: &[f64], with: &[f64]| -> f64 {
            now.iter().zip(before).zip(with).map(|((now, before), with)| (now - before) * with).sum()
        };
        let of_change = 0.5 * h * change(f, f_before, v).abs();
        let mut of_forces = 0.5 * h * change(v, v_before, f).abs();
        let mut kick = self.step.kick;
        if self.step.structure.joints > 0 && self.step.contacted.r.iter().all(|r| r.x == 0.0) {
            let dv: Vec<f64> = self.state.v.iter().zip(v).map(|(after, before)| after - before).collect();
            let lost = self.step.problem.energies(self.last.t, &self.last.q, &dv).kinetic;
            of_forces = of_forces.max(lost);
            kick = kick.max((2.0 * lost).sqrt());
        }
        self.energy.explain(of_change + of_forces, kick * (2.0 * kinetic).sqrt());
        f_before.copy_from_slice(f);
        v_before.copy_from_slice(v);
    }

    /// Records violations of joints and gaps at the end of the last step, and at points of the straight line from its
    /// beginning to its end.
    fn measure(&mut self, h: f64) {
        if self.violations.joints().is_empty() && self.violations.gaps().is_empty() {
            return;
        }
        self.violations.note(self.state.t, &self.state.q, &self.step.constraints, (&self.step.sizes, &[]), |_| false);
        if self.step.structure.affine_constraints {
            return;
        }
        let (q, values) = &mut self.between;
        for part in BETWEEN {
            for ((q, from), to) in q.iter_mut().zip(&self.last.q).zip(&self.state.q) {
                *q = from + part * (to - from);
            }
            let t = self.last.t + part * h;
            self.step.problem.positions(t, q, values);
            self.violations.note_values(t, values, |_| false);
        }
    }

    /// Records the events of the last step (impacts, lift-offs, sticks and slips) for changes of velocity and gap
    /// that exceed rounding.
    fn record_events(&mut self, h: f64) {
        self.new_events.clear();
        let State { t, q, v } = &self.state;
        let (t, step) = (*t, &self.step);
        let (contacted, constraints) = (&step.contacted, &step.constraints);
        let largest = contacted.change.iter().fold(0.0_f64, |most, change| most.max(*change));
        for (k, touch) in self.touching.iter_mut().enumerate() {
            let normal = step.structure.normal(k);
            let is_more = |speed: f64, terms: f64| speed > ZERO_TOL * (terms + contacted.change[k]);
            let carries = contacted.r[k].x > 0.0;
            let place = constraints.size(normal, q);
            let apart = constraints.values[normal] > ZERO_TOL * (place + h * largest);
            let slip = contacted.after[k].y.hypot(contacted.after[k].z);
            let slips = is_more(slip, step.size_of_slip(k, v));
            let now = match *touch {
                Touch::Open if carries => Touch::Struck { steps: 1, slips },
                Touch::Struck { steps, .. } if carries => Touch::Struck { steps: steps + 1, slips },
                Touch::Struck { steps, slips } if !apart => Touch::Struck { steps: steps + 1, slips },
                _ => Touch::Open,
            };
            let event = match (*touch, now) {
                (Touch::Open, Touch::Struck { .. })
                    if is_more(-contacted.before[k].x, constraints.terms(normal, v)) =>
                {
                    Some(ContactEvent { t, kind: EventKind::Impact, contact: k })
                }
                (Touch::Struck { steps, .. }, Touch::Open) if steps > 1 => {
                    Some(ContactEvent { t, kind: EventKind::LiftOff, contact: k })
                }
                (Touch::Struck { slips: true, .. }, Touch::Struck { slips: false, .. }) => {
                    Some(ContactEvent { t, kind: EventKind::Stick, contact: k })
                }
                (Touch::Struck { slips: false, .. }, Touch::Struck { slips: true, .. }) => {
                    Some(ContactEvent { t, kind: EventKind::Slip, contact: k })
                }
                _ => None,
            };
            self.new_events.extend(event);
            *touch = now;
        }
    }
}
