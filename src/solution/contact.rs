//! A mechanical system from start to end: its contacts, energies and failures by name.

use super::run::{Plan, Stepper, run};
use super::{Diagnostics, Evaluations, Event, EventKind, Failure, Solution, Steps, ViCounts, Warning};
use crate::analysis::Analysis;
use crate::contact::{ContactError, Happening, Settings, State, TimeStepping};
use crate::models::{ENERGIES, MechanicalModel};
use crate::problem::{Constraints, Control};

/// Integrates a mechanical system over impacts.
pub fn integrate_contact(
    model: &MechanicalModel,
    plan: &Plan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let mut problem = model.problem();
    let structure = problem.structure().clone();
    let (q, v) = plan.initial.split_at(structure.coordinates);
    let state = State { t: plan.start, q: q.to_vec(), v: v.to_vec() };
    let diagnostics = describe_contact(model, settings, analysis);
    run(plan, control, diagnostics, || {
        let stepper = TimeStepping::new(&mut *problem, *settings, state, plan.end);
        let constraints = Constraints::new(&structure);
        Ok(Course { stepper, model, control, constraints, states: plan.initial.clone() })
    })
}

/// A run with the names that its columns go by.
struct Course<'p> {
    stepper: TimeStepping<'p>,
    model: &'p MechanicalModel,
    control: &'p Control,
    constraints: Constraints,
    states: Vec<f64>,
}

impl Stepper for Course<'_> {
    fn t(&self) -> f64 {
        self.stepper.state.t
    }

    fn is_done(&self) -> bool {
        self.stepper.is_done()
    }

    fn accepted(&self) -> u64 {
        self.stepper.accepted
    }

    fn states(&self) -> &[f64] {
        &self.states
    }

    fn step(&mut self) -> Result<(), Failure> {
        let made = self.stepper.advance(self.control);
        let State { t, q, v } = &self.stepper.state;
        let (first, rest) = self.states.split_at_mut(q.len());
        first.copy_from_slice(q);
        rest.copy_from_slice(v);
        made.map_err(|error| {
            let message = match error {
                ContactError::Force { component, t } => format!(
                    "the force on `{}` is not finite at t = {t}: a division by zero, a function outside its domain, or a \
                     number too large",
                    self.model.coordinates[component]
                ),
                _ => error.to_string(),
            };
            Failure { code: error.code(), message, time: *t, state: self.states.clone() }
        })
    }

    /// Within a step velocities are those of its end, as the scheme has it: `q+ = q + h v+`.
    fn outputs(&mut self, t: f64, out: &mut [f64]) {
        let TimeStepping { state, last, impulses, impulses_before, energy, step, .. } = &mut self.stepper;
        let h = state.t - last.t;
        let part = if h > 0.0 { (t - last.t) / h } else { 1.0 };
        let n = state.q.len();
        for i in 0..n {
            out[i] = if part == 1.0 { state.q[i] } else { last.q[i] + part * (state.q[i] - last.q[i]) };
            out[n + i] = state.v[i];
        }
        step.problem.constraints(t, &out[..n], &mut self.constraints);
        let structure = step.problem.structure();
        let mut place = 2 * n;
        for (k, contact) in structure.contacts.iter().enumerate() {
            out[place] = self.constraints.values[structure.joints + k];
            let given = impulses_before[k] + (impulses[k] - impulses_before[k]) * part;
            out[place + 1..=place + 1 + contact.slips].copy_from_slice(&given.as_slice()[..=contact.slips]);
            place += 2 + contact.slips;
        }
        let energies = step.problem.energies(t, &out[..n], &state.v);
        out[place..place + ENERGIES.len()].copy_from_slice(&[
            energies.kinetic,
            energies.potential,
            energy.work_of_forces,
            energy.dissipated_by_friction,
            energy.lost_in_impacts,
        ]);
    }

    fn take_events(&mut self, events: &mut Vec<Event>) {
        events.extend(self.stepper.happenings.drain(..).map(|happening| {
            let (t, kind, contact) = match happening {
                Happening::Impact { t, contact } => (t, EventKind::Impact, contact),
                Happening::LiftOff { t, contact } => (t, EventKind::LiftOff, contact),
                Happening::Stick { t, contact } => (t, EventKind::Stick, contact),
                Happening::Slip { t, contact } => (t, EventKind::Slip, contact),
            };
            Event { t, kind, of: self.model.contacts[contact].clone() }
        }));
    }

    fn observe(&mut self, _: bool, diagnostics: &mut Diagnostics) {
        diagnostics.energy = Some(self.stepper.energy);
    }

    fn finish(&mut self, diagnostics: &mut Diagnostics) {
        let work = &self.stepper.step.work;
        diagnostics.steps = Steps { accepted: self.stepper.accepted, ..Steps::default() };
        diagnostics.evaluations = Evaluations {
            rates: work.forces,
            jacobians: work.jacobians,
            factorisations: self.stepper.step.factorisations(),
        };
        if let Some(counts) = &mut diagnostics.vi {
            *counts = ViCounts {
                solver: work.solver,
                solves: work.solves,
                pivots: work.iterations,
                largest_residual: work.residual,
                tried: Vec::new(),
            };
        }
        if let Some((t, contact)) = work.painleve {
            diagnostics.warnings.push(Warning {
                code: "painleve",
                message: format!(
                    "at t = {t} friction drives `{}` into what it slides on (the paradox of Painleve): forces alone have no \
                     solution there, or several; impulses, which have one, went on",
                    self.model.contacts[contact]
                ),
            });
        }
        if work.limited > 0 {
            diagnostics.warnings.push(Warning {
                code: "restitution_limited",
                message: format!(
                    "in {} steps the whole restitution would have added energy; as much was taken as adds none",
                    work.limited
                ),
            });
        }
    }
}

/// What is known before the run: what the theory says, what is built, what is left out and why.
pub fn describe_contact(model: &MechanicalModel, settings: &Settings, analysis: &Analysis) -> Diagnostics {
    let structure = model.structure();
    let contacts = &structure.contacts;
    let mut diagnostics = Diagnostics {
        method: "contact",
        built: vec!["time stepping"],
        analysis: Some(analysis.clone()),
        ..Diagnostics::default()
    };
    let mut leave = |what: &str| diagnostics.left_out.push(what.to_owned());
    if contacts.is_empty() {
        leave("variational inequality: there are no contacts");
    } else if structure.slips() == 0 {
        leave("friction: no contact has a coefficient");
    }
    if !contacts.is_empty() && contacts.iter().all(|contact| contact.restitution == 0.0) {
        leave("restitution: every coefficient is zero");
    }
    if structure.joints == 0 {
        leave("joints: there are none");
    }
    if structure.constant_mass && structure.constant_forces {
        leave("new factorisations: mass and forces are constant");
    }
    if !contacts.is_empty() {
        diagnostics.vi = Some(ViCounts::default());
        diagnostics.built.push("law of impact");
    }
    if contacts.iter().any(|contact| contact.slips > 0) {
        diagnostics.built.push("friction");
    }
    if structure.joints > 0 {
        diagnostics.built.push("joints");
    }
    if settings.default_step {
        let message = format!("no `step` was given: time stepping takes {} of them, each {}", 10_000, settings.step);
        diagnostics.warnings.push(Warning { code: "default_step", message });
    }
    diagnostics
}
