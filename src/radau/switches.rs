//! Switches: changes of the active face of `K`.
//!
//! A step keeps one face, which is the right one while its monitors stay nonnegative. Where a monitor becomes negative,
//! the step is cut ([`location`](super::location)). The next face is not guessed: it is that of an implicit Euler step
//! with the VI, in which variables at their switch start exactly there, so short that only the directions at the switch
//! matter.

use super::constraints::Constraints;
use super::face::{ActiveFace, Activity, Monitor};
use super::free_variables::FreeVariables;
use super::recurrence::Recurrence;
use super::screening::Screening;
use super::settings::{Settings, StepError, Switches};
use super::start::Probe;
use super::stepper::Radau;
use super::system::System;
use problem::{ConvexSet, Face};

/// A switch: a variable changed its activity (its position in its interval or block).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switch {
    /// Time of the switch: accurate to the order of the method if located, otherwise the end of the step in which it
    /// happened.
    pub t: f64,
    /// Index of the variable that switches, counted from 0.
    pub variable: usize,
    /// Activity of the variable before the switch.
    pub from: Activity,
    /// Activity of the variable after the switch.
    pub to: Activity,
}

/// Number of successive switches (changes of the active face of `K`), each after a shorter time than the last, that
/// count as an accumulation (Zeno).
const ACCUMULATION: u32 = 8;
/// State and workspace of the location of switches (changes of the active face of `K`).
pub(super) struct Switching {
    locate: bool,
    pub(super) probe: Probe,
    /// The active face of `K` before the present step.
    pub(super) before: ActiveFace,
    pub(super) history: History,
    pub(super) scratch: Vec<f64>,
    pub(super) inside: FreeVariables,
    pub(super) constraints: Constraints,
    pub(super) monitors: Vec<Monitor>,
    /// Workspace for the monitors (event functions) evaluated between the stages.
    pub(super) between: Vec<Monitor>,
    pub(super) screening: Screening,
    /// Recorded switches that the caller has not taken yet.
    pub(super) switches: Vec<Switch>,
}

/// Record of the switches of a run, in which accumulations of switches (Zeno) and switches within noise show.
#[derive(Clone)]
pub(super) struct History {
    /// The time of the last switch, the time between it and the switch before, and the number of successive decreases
    /// of that time.
    last: f64,
    gap: f64,
    shrinking: u32,
    pub recurrence: Recurrence,
    /// Number of accumulations of switches (Zeno) in the run so far.
    accumulations: u32,
}

impl History {
    fn new(variables: usize) -> Self {
        Self {
            last: f64::NEG_INFINITY,
            gap: f64::INFINITY,
            shrinking: 0,
            recurrence: Recurrence::new(variables),
            accumulations: 0,
        }
    }

    /// Records that the variables `variables` switch (change their activities) at time `t`.
    fn switched(&mut self, t: f64, variables: impl Iterator<Item = usize>) {
        if self.recurrence.switched(variables) {
            self.accumulations += 1;
        }
        let gap = t - self.last;
        self.shrinking = if gap < 0.95 * self.gap { self.shrinking + 1 } else { 0 };
        if self.shrinking == ACCUMULATION {
            self.accumulations += 1;
        }
        (self.last, self.gap) = (t, gap);
    }

    /// Whether switches (changes of the active face of `K`) follow each other too fast to be located.
    fn is_accumulating(&self) -> bool {
        self.shrinking >= ACCUMULATION || self.recurrence.is_pausing()
    }
}

impl Switching {
    pub(super) fn new(system: &System<'_>, settings: &Settings) -> Result<Self, StepError> {
        Ok(Self {
            locate: settings.switches == Switches::Locate,
            probe: Probe::new(system, settings)?,
            before: system.face.clone(),
            history: History::new(system.unknowns - system.states),
            scratch: vec![0.0; system.unknowns],
            inside: FreeVariables::new(system),
            constraints: Constraints::default(),
            monitors: Vec::new(),
            between: Vec::new(),
            screening: Screening::default(),
            switches: Vec::new(),
        })
    }

    pub(super) fn remember(&mut self, face: &ActiveFace) {
        self.before.clone_from(face);
    }

    /// Records as switches the variables whose activity on `face` differs from that on the face before the step, and
    /// those in `turned`, which are on the opposite side of the boundary of their block; returns whether there are
    /// any.
    pub(super) fn record(&mut self, t: f64, set: &ConvexSet, face: &ActiveFace, turned: &[usize]) -> bool {
        let mut changed = Vec::new();
        for (variable, (&from, &to)) in self.before.places.iter().zip(&face.places).enumerate() {
            if from != to || self.before.exchanges(face, set, variable) || turned.contains(&variable) {
                self.switches.push(Switch { t, variable, from, to });
                changed.push(variable);
            }
        }
        if !changed.is_empty() && self.locate {
            let in_interval = changed.iter().copied().filter(|&variable| set.block_of(variable).is_none());
            self.history.switched(t, in_interval);
        }
        !changed.is_empty()
    }

    /// Whether the settings ask to locate switches (changes of the active face of `K`).
    pub(super) fn is_to_locate(&self) -> bool {
        self.locate
    }

    /// Whether switches (changes of the active face of `K`) follow each other too fast to be located.
    pub(super) fn is_accumulating(&self) -> bool {
        self.history.is_accumulating()
    }

    /// Whether a step should end at a switch: the settings ask for it, and switches do not follow each other too fast.
    pub(super) fn locates(&self) -> bool {
        self.locate && !self.is_accumulating()
    }
}

impl Radau<'_> {
    /// Removes and returns the switches since the last call.
    pub fn take_switches(&mut self) -> std::vec::Drain<'_, Switch> {
        self.switching.switches.drain(..)
    }

    /// Returns how often switches accumulated, so that their location was suspended.
    pub fn accumulations(&self) -> u32 {
        self.switching.history.accumulations
    }

    /// Determines the active face of `K` at the end of an accepted step.
    pub(super) fn update_face(&mut self, coupled: bool, ends_at_switch: bool) {
        if self.system.bounded.is_empty() {
            return;
        }
        self.clear_switches();
        if self.system.evaluate(self.clock.t, &self.y) {
            self.system.put_on_bounds(&mut self.y);
            self.system.project(&mut self.y);
        }
        if ends_at_switch {
            let before = self.y[self.system.states..].to_vec();
            let h = self.before_break(self.h.max(self.last.h));
            self.choose_face(h);
            self.keep_better(&before);
            let turned = turned(&self.system, &self.switching.before, &before, &self.y[self.system.states..]);
            let changed = self.switching.record(self.clock.t, &self.system.set, &self.system.face, &turned);
            if !changed && self.switching.history.recurrence.within_noise() {
                self.switching.history.accumulations += 1;
            }
            self.rest();
            self.restart();
        } else if coupled {
            self.switching.record(self.clock.t, &self.system.set, &self.system.face, &[]);
            self.rest();
            self.restart();
        } else if self.switching.is_accumulating() {
            self.switching.history.shrinking = 0;
            self.switching.history.recurrence.kept_face();
        }
    }

    /// Ends an accumulation of switches if the states come to rest within their tolerances.
    fn rest(&mut self) {
        if !self.switching.is_accumulating() {
            return;
        }
        self.switching.remember(&self.system.face);
        if self.pass_accumulation(self.last.h) {
            self.switching.record(self.clock.t, &self.system.set, &self.system.face, &[]);
            self.switching.history.shrinking = 0;
            self.switching.history.recurrence.passed();
        }
    }

    /// Restores `before`, the variables of the step that ended at a switch, if they satisfy the inequality and the
    /// variables after the switch do not: at the apex of a cone, or where a bound is reached, the face alone need not
    /// determine the variables.
    fn keep_better(&mut self, before: &[f64]) {
        let n = self.system.states;
        let after = self.y[n..].to_vec();
        let found = self.natural_map();
        self.y[n..].copy_from_slice(before);
        self.system.put_on_bounds(&mut self.y);
        if self.natural_map() >= 0.1 * found {
            self.y[n..].copy_from_slice(&after);
        }
    }

    /// Returns the residual of the natural map at `(t, y)`: `max |z - P_K(z - G)|` over the variables whose `G`
    /// depends on variables. The residuals of the others give no information on `z`.
    fn natural_map(&mut self) -> f64 {
        let n = self.system.states;
        if !self.system.evaluate(self.clock.t, &self.y) {
            return f64::INFINITY;
        }
        let Self { system, switching, y, .. } = self;
        for ((moved, y), g) in switching.scratch.iter_mut().zip(y.iter()).zip(&system.values) {
            *moved = y - g;
        }
        system.project(&mut switching.scratch);
        let residuals =
            (0..y.len() - n).filter(|&k| system.has_variables(k)).map(|k| (y[n + k] - switching.scratch[n + k]).abs());
        residuals.fold(0.0, f64::max)
    }
}

/// Returns the members of blocks that stay on the boundary of their set between two values of the variables, but on its
/// opposite side: friction at a reversal of the motion.
pub(super) fn turned(system: &System<'_>, from: &ActiveFace, before: &[f64], after: &[f64]) -> Vec<usize> {
    let faces = from.blocks.iter().zip(&system.face.blocks);
    let turned = system.set.blocks().iter().zip(faces).filter(|(block, faces)| {
        let product: f64 = block.members.iter().map(|&k| before[k] * after[k]).sum();
        matches!(faces, (Face::Boundary(_), Face::Boundary(_))) && product < 0.0
    });
    turned.flat_map(|(block, _)| block.members.iter().copied()).collect()
}
