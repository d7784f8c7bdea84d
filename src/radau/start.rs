//! Where a run, or a new face, begins.
//!
//! The face and the variables at `(t, x)` are those of one implicit Euler step with the VI, so short that only the
//! directions at `t` count. A start that the constraints do not allow shows as a jump of the states that does not
//! shrink with the step: where `K` has bounds it is the impulse that the theory names (`x+ = x + B p`, with `p` in `K`
//! complementary to `G(x+)`), and the run starts after it; where all variables are free it is an error of the user.

use super::consistent_variables::inequality;
use super::face::{ActiveFace, Activity, undecided};
use super::factors::Factors;
use super::screening::ALLOWED;
use super::settings::{Settings, StepError};
use super::stage_vi::StageVi;
use super::stages::{Contraction, Newton, Stages};
use super::stepper::Radau;
use super::system::System;
use super::tableau::Tableau;

/// How long the step that finds a face is, beside the steps of the run.
const PROBE: f64 = 1e-4;
/// The same where that is too short to tell.
const LONGER: [f64; 4] = [1e-3, 1e-2, 1e-1, 1.0];
/// The part of its distance from a switch by which an inequality may come nearer within that step: one that came further might
/// have passed the switch within a step only twice as long.
const HALF_WAY: f64 = 0.5;
/// The factor by which the step is shortened for that, and the most times.
const SHORTER: f64 = 0.1;
const MOST_SHORTER: usize = 8;
/// The factor between the steps that look for the end of an accumulation, and the most of them: together they span gaps of
/// switches from the last to `1e9` times as long.
const LONGER_GAP: f64 = 4.0;
const MOST_GAPS: usize = 16;
/// The part of what is allowed by which states at rest may differ between two of these steps.
const AT_REST: f64 = 1e-3;
/// How long the step is that shows whether a start is consistent, beside the steps of the run: the shortest of these whose
/// equations are solved. Constraints hidden in combinations of the rows of `M x' = F` are lost to rounding beside `M/h`.
const INSTANTS: [f64; 5] = [1e-12, 1e-10, 1e-8, 1e-6, 1e-4];

/// The multiple of such an instant over which a jump remains as it is, while a steep change grows as often.
const MULTIPLE: f64 = 16.0;

/// The implicit Euler step that finds a face.
pub(super) struct Probe {
    euler: &'static Tableau,
    stages: Stages,
    pub(super) vi: Option<StageVi>,
    factors: Factors,
}

impl Probe {
    pub(super) fn new(system: &System<'_>, settings: &Settings) -> Result<Self, StepError> {
        let mut vi = None;
        if !system.bounded.is_empty() {
            let vi = vi.insert(StageVi::new(system, 1, settings.vi_solver)?);
            vi.relinearise = !system.constant_jacobian();
        }
        Ok(Self { euler: Tableau::of(1), stages: Stages::new(1, system.unknowns), vi, factors: Factors::new(system) })
    }
}

impl Radau<'_> {
    /// Finds the face and the variables at the start, and whether the start is consistent.
    pub(super) fn start(&mut self) -> Result<(), StepError> {
        let n = self.system.states;
        if self.system.is_explicit_ode() {
            return Ok(());
        }
        // Variables have no guess; where they enter nonlinearly, theirs must not be far off.
        inequality::solve(&mut self.system, self.clock.t, &mut self.y);
        if self.system.bounded.is_empty()
            && let Some(consistent) = &mut self.consistent
        {
            consistent.solve(&mut self.system, &self.control, self.clock.t, &mut self.y);
        }
        let Some(instant) = INSTANTS.into_iter().find(|instant| self.probe(instant * self.h, false)) else {
            return Err(self.no_start());
        };
        // States without mass have no past: beside bounded variables they start where their equations put them.
        for (state, (y, z)) in self.y.iter_mut().zip(&mut self.switching.probe.stages.z[..n]).enumerate() {
            if !self.system.bounded.is_empty() && !self.system.layout.has_mass[state] {
                *y += std::mem::take(z);
            }
        }
        let jumps = self.switching.probe.stages.z[..n].iter().zip(&self.control.weight).map(|(z, w)| (z * w).abs());
        let worst = jumps.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((state, size)) = worst
            && size > 1.0
        {
            if self.system.bounded.is_empty() {
                let jump = self.switching.probe.stages.z[state];
                return Err(StepError::InconsistentStart { state, jump });
            }
            let jump = self.switching.probe.stages.z[..n].to_vec();
            if !self.is_steep(state, jump[state], instant) {
                self.y.iter_mut().zip(&jump).for_each(|(y, jump)| *y += jump);
                self.jumped.get_or_insert(self.clock.t);
            }
        }
        if self.choose_face(self.h) { Ok(()) } else { Err(self.no_start()) }
    }

    /// Whether a change of a state within an instant grows with the instant: then it is steep, and no jump.
    fn is_steep(&mut self, state: usize, change: f64, instant: f64) -> bool {
        self.probe(MULTIPLE * instant * self.h, false)
            && self.switching.probe.stages.z[state].abs() > MULTIPLE.sqrt() * change.abs()
    }

    fn no_start(&self) -> StepError {
        match self.switching.probe.vi.as_ref().and_then(|vi| vi.contradiction) {
            Some(variable) => {
                StepError::NoSolution { t: self.clock.t, variable, linear: self.system.constant_jacobian() }
            }
            None => StepError::NoStart { t: self.clock.t },
        }
    }

    /// The face and the variables at `(t, y)`, where steps are about `h` long; the states stay, but for noise. False
    /// if no solution was found, with nothing changed.
    pub(super) fn choose_face(&mut self, h: f64) -> bool {
        let n = self.system.states;
        let mut length = PROBE * h;
        for _ in 0..MOST_SHORTER {
            let before = self.system.face.clone();
            if !self.probe(length, true) {
                return false;
            }
            if !self.was_too_long() || length <= self.clock.rounding(0.0) {
                break;
            }
            self.system.face = before;
            length *= SHORTER;
        }
        self.take_probe(n);
        true
    }

    /// Takes the face of the last probe, and of its unknowns those from number `first` on.
    fn take_probe(&mut self, first: usize) {
        let Self { system, switching, y, .. } = self;
        if let Probe { vi: Some(vi), stages, .. } = &mut switching.probe {
            vi.regularise(system, stages, y);
        }
        for (y, z) in self.y[first..].iter_mut().zip(&self.switching.probe.stages.z[first..]) {
            *y += z;
        }
        self.remove_noise();
        self.make_consistent();
    }

    /// Takes the variables that belong to the states for those of the step that found the face, where they stay within the
    /// width of their interval beside it: near a point at which the states are no longer driven by them, they would be of any size.
    fn make_consistent(&mut self) {
        let n = self.system.states;
        let Some(consistent) = &mut self.consistent else { return };
        let before = self.y[n..].to_vec();
        consistent.solve(&mut self.system, &self.control, self.clock.t, &mut self.y);
        let is_beyond = |k: usize| {
            let (lower, upper, z) = (self.system.set.lower[k], self.system.set.upper[k], self.y[n + k]);
            (lower - z).max(z - upper) > upper - lower
        };
        if self.system.intervals.iter().any(|&k| is_beyond(k)) {
            self.y[n..].copy_from_slice(&before);
        }
    }

    /// Whether the last probe was too long to show the face at `t`: over it an inequality that was off its switch, and has no
    /// variables, came half way to it. Where switches accumulate they follow each other in less than any part of the steps
    /// of the run.
    fn was_too_long(&mut self) -> bool {
        // Steps of one size resolve nothing shorter.
        if self.settings.step.is_some() {
            return false;
        }
        let n = self.system.states;
        let Self { system, switching, control, y, clock, .. } = self;
        if !system.evaluate(clock.t, y) {
            return false;
        }
        system.intervals.iter().filter(|&&k| !system.has_variables(k)).any(|&k| {
            let (g, change) = (system.values[n + k], system.slope(k, |j| switching.probe.stages.z[j]));
            g.abs() > control.noise_of_g(system, k, y) && change * g < 0.0 && change.abs() > HALF_WAY * g.abs()
        })
    }

    /// Passes an accumulation of switches, the last of them about `gap` apart, where that changes no state by more than its
    /// tolerances allow: an implicit Euler step that holds more variables inside than the face at `t`
    /// does, and holds the same, at the same states, where it is longer, ends where they rest. Whether there is such a step.
    pub(super) fn pass_accumulation(&mut self, gap: f64) -> bool {
        let n = self.system.states;
        let count = |face: &ActiveFace| face.places.iter().filter(|place| **place == Activity::Inactive).count();
        let before = self.system.face.clone();
        let mut last: Option<(ActiveFace, Vec<f64>)> = None;
        let mut length = gap;
        for _ in 0..MOST_GAPS {
            self.system.face.clone_from(&before);
            if !self.probe(length, false) {
                break;
            }
            let found = self.switching.probe.stages.z.clone();
            let allowed = |j: usize| ALLOWED * self.uncertainty(j);
            if !(0..n).all(|j| found[j].abs() <= allowed(j)) {
                break;
            }
            let face = self.system.face.clone();
            if let Some((same, end)) = &last
                && *same == face
                && (0..n).all(|j| (end[j] - found[j]).abs() <= AT_REST * allowed(j))
            {
                self.take_probe(0);
                return true;
            }
            last = Some((face, found)).filter(|(face, _)| count(face) > count(&before));
            length *= LONGER_GAP;
        }
        self.system.face = before;
        false
    }

    /// Brings the states onto the equations of the face where they are off them by noise. The first step would else do it,
    /// by forces that grow as it is made shorter and pass for a switch, and by a change that its error test sees in states
    /// whose own tolerance is finer than the noise of others.
    fn remove_noise(&mut self) {
        let n = self.system.states;
        let Self { system, switching, control, y, clock, .. } = self;
        let is_inside = |system: &System<'_>, k: usize| system.face.places[k] == Activity::Inactive;
        if !system.intervals.iter().any(|&k| is_inside(system, k)) || !system.evaluate(clock.t, y) {
            return;
        }
        let mut residuals =
            system.intervals.iter().filter(|&&k| is_inside(system, k)).map(|&k| (k, system.values[n + k]));
        if !residuals.all(|(k, residual)| residual.abs() <= control.noise_of_g(system, k, y)) {
            return;
        }
        switching.scratch.copy_from_slice(y);
        if switching.constraints.correct(system, control, clock.t, &mut switching.scratch) {
            y.copy_from_slice(&switching.scratch);
        }
    }

    /// The face at `(t, y)` of variables that are at their switch, to within noise, and of which the first moment does not
    /// tell whether they stay: an ever longer step, up to `h`, is taken until it does. Whether one of them leaves.
    pub(super) fn choose_face_beyond_noise(&mut self, h: f64) -> bool {
        let n = self.system.states;
        if !self.system.evaluate(self.clock.t, &self.y) {
            return false;
        }
        let mut open = undecided(&mut self.system, &self.control, &self.y);
        let before = self.system.face.clone();
        for part in LONGER {
            if !open.contains(&true) || !self.probe(part * h, true) || self.was_too_long() {
                break;
            }
            let end: Vec<f64> = self.y.iter().zip(&self.switching.probe.stages.z).map(|(y, z)| y + z).collect();
            if !self.system.evaluate(self.clock.t + part * h, &end) {
                break;
            }
            let still = undecided(&mut self.system, &self.control, &end);
            let chosen = std::mem::replace(&mut self.system.face, before.clone());
            for (k, (open, still)) in open.iter_mut().zip(still).enumerate() {
                if *open && !still && chosen.places[k] != before.places[k] {
                    self.system.face.places[k] = chosen.places[k];
                    self.y[n + k] = end[n + k];
                }
                *open &= still;
            }
            for b in 0..before.blocks.len() {
                let members = self.system.set.blocks()[b].members.clone();
                if members.iter().any(|&k| self.system.face.places[k] != before.places[k]) {
                    self.system.face.set_block(&self.system.set, b, chosen.blocks[b].clone());
                    members.iter().for_each(|&k| self.y[n + k] = end[n + k]);
                }
            }
            if self.system.face != before {
                if let Some(consistent) = &mut self.consistent {
                    consistent.solve(&mut self.system, &self.control, self.clock.t, &mut self.y);
                }
                return true;
            }
        }
        self.system.face = before;
        false
    }

    /// One Euler step of size `eta` from `(t, y)`; its increment is left in the stages of the probe. If `snap`,
    /// inequalities that are zero to the tolerance start from zero exactly.
    fn probe(&mut self, eta: f64, snap: bool) -> bool {
        let n = self.system.states;
        if !self.system.differentiate(self.clock.t, &self.y) || !self.system.evaluate(self.clock.t, &self.y) {
            return false;
        }
        self.set_tolerances(eta);
        let probe = &mut self.switching.probe;
        probe.stages.z.fill(0.0);
        probe.stages.w.fill(0.0);
        let Some(vi) = &mut probe.vi else {
            probe.factors.compute(&self.system, &self.system.face, probe.euler, eta);
            self.system.work.factorisations += 1;
            let newton = probe.stages.newton(
                &mut self.system,
                probe.euler,
                &mut probe.factors,
                self.clock.t,
                eta,
                &self.y,
                &self.control,
                &mut Contraction::default(),
            );
            return matches!(newton, Newton::Converged { .. });
        };
        for &k in &self.system.bounded {
            let g = self.system.values[n + k];
            let noise = self.control.noise_of_g(&self.system, k, &self.y);
            vi.offset[k] = if snap && g.abs() <= noise { -g } else { 0.0 };
        }
        vi.solve(&mut self.system, probe.euler, &mut probe.stages, self.clock.t, eta, &self.y, &self.control).is_ok()
    }
}
