//! The start of a run, or of a new face.
//!
//! The face and the variables at `(t, x)` are those of one implicit Euler step with the VI, so short that only the
//! directions at `t` matter. If the constraints do not admit the initial states, the states jump by an amount that does
//! not shrink with the step. If `K` has bounds, this jump is the impulse of the theory (`x+ = x + B p`, with `p` in `K`
//! complementary to `G(x+)`), and the run starts after it; if all variables are unbounded, it is an error of the user.

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

/// Size of the probe step that selects a face of `K`, relative to the steps of the run.
const PROBE: f64 = 1e-4;
/// Sizes of longer probe steps, relative to the steps of the run, taken if the first probe step does not decide the
/// sign of a monitor beyond noise.
const LONGER: [f64; 4] = [1e-3, 1e-2, 1e-1, 1.0];
/// Fraction of its distance from a switch by which an inequality may approach the switch within the probe step: after a
/// closer approach, a step only twice as long might have passed the switch.
const HALF_WAY: f64 = 0.5;
/// Factor by which the probe step is shortened after an inequality came too close to its switch, and the maximum
/// number of such reductions.
const SHORTER: f64 = 0.1;
const MOST_SHORTER: usize = 8;
/// Factor between the probe steps that look for the end of an accumulation of switches, and their maximum number:
/// together they span times from the last gap between switches to `1e9` times that gap.
pub(super) const LONGER_GAP: f64 = 4.0;
const MOST_GAPS: usize = 16;
/// Behind an accumulation of switches, states rest if the results of two probe steps differ by at most this fraction of the
/// change that the tolerances allow.
const AT_REST: f64 = 1e-3;
/// Sizes of the step that checks the consistency of a start, relative to the steps of the run: the shortest step whose
/// equations can be solved is used. Constraints hidden in combinations of the rows of `M x' = F` are lost to rounding
/// beside `M/h`.
const INSTANTS: [f64; 5] = [1e-12, 1e-10, 1e-8, 1e-6, 1e-4];

/// Factor by which the step that checks the consistency of a start is lengthened: a jump of the states stays the
/// same, while a steep change grows by this factor.
const MULTIPLE: f64 = 16.0;

/// The probe: an implicit Euler step that selects the active face of `K` for the following steps.
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

/// An instantaneous jump of the states: `x+ = x + M^-1 B p` with `p` in `K` complementary to `G(x+)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Jump {
    /// Time of the jump of the states.
    pub t: f64,
    /// Time from which on the states are those after the jump.
    pub behind: f64,
    /// The unknowns `(x, z)` before the jump of the states.
    pub before: Vec<f64>,
    /// The impulses `p`, the integrals of the variables over the jump.
    pub impulses: Vec<f64>,
}

impl Jump {
    /// Returns the unknowns `(x, z)` of a jump with the states `states`, and with `share` times the impulses as
    /// variables.
    pub fn unknowns(&self, states: &[f64], share: f64) -> Vec<f64> {
        states.iter().copied().chain(self.impulses.iter().map(|impulse| share * impulse)).collect()
    }
}

impl Radau<'_> {
    /// Finds the face and the variables at the start, and checks whether the start is consistent. States that
    /// constraints do not admit jump; `at` is the time recorded for the jump, that of the breakpoint if the run
    /// restarts behind one.
    pub(super) fn start(&mut self, at: f64) -> Result<(), StepError> {
        let n = self.system.states;
        if self.system.is_explicit_ode() {
            return Ok(());
        }
        // Variables have no initial guess; if they enter nonlinearly, the guess must not be far off.
        inequality::solve(&mut self.system, self.clock.t, &mut self.y);
        if self.system.bounded.is_empty()
            && let Some(consistent) = &mut self.consistent
        {
            consistent.solve(&mut self.system, &self.control, self.clock.t, &mut self.y);
        }
        let first = self.settings.step.and(self.settings.first_step);
        let h = self.before_break(first.map_or(self.h, |first| first.min(self.h)));
        let Some(instant) = INSTANTS.into_iter().find(|instant| self.probe(instant * h, false)) else {
            return Err(self.no_start());
        };
        // States without mass have no initial values of their own: if there are bounded variables, take the values
        // that the equations of the probe step give them.
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
            let probed = self.switching.probe.stages.z.clone();
            let (jump, variables) = probed.split_at(n);
            if !self.is_steep(state, jump[state], instant * h) {
                if self.system.bounded.is_empty() {
                    return Err(StepError::InconsistentStart { state, jump: jump[state] });
                }
                let impulses = self.y[n..].iter().zip(variables).map(|(y, z)| (y + z) * instant * h).collect();
                let before = self.y.clone();
                self.y.iter_mut().zip(jump).for_each(|(y, jump)| *y += jump);
                self.jumped.get_or_insert(self.clock.t);
                self.jumps.push(Jump { t: at, behind: self.clock.t, before, impulses });
            }
        }
        if self.choose_face(h) { Ok(()) } else { Err(self.no_start()) }
    }

    /// Whether a change of a state over a step of size `instant` grows with the step size: such a change is steep,
    /// but not a jump.
    fn is_steep(&mut self, state: usize, change: f64, instant: f64) -> bool {
        self.probe(MULTIPLE * instant, false)
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

    /// Selects the active face of `K` and the variables at `(t, y)` for steps of a size of about `h`; changes the
    /// states by noise only. Returns false, with nothing changed, if no solution is found.
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

    /// Takes over the result of the last probe step: a face of `K` whose equations determine the variables, and the
    /// unknowns from index `first` on; then removes noise from the states, and makes the variables consistent with
    /// them.
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

    /// Replaces the variables of the probe step by those consistent with the states, unless these leave their interval
    /// by more than its width: near a point at which the variables cease to drive the states, consistent variables are
    /// arbitrarily large.
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

    /// Whether the last probe step was too long to determine the face of `K` at `t`: over that step, some inequality
    /// `G_k` that contains no variables, and was nonzero at `t`, came half way to zero. If switches accumulate, the
    /// time between them is shorter than any fraction of the steps of the run.
    fn was_too_long(&mut self) -> bool {
        // A fixed step size resolves no times shorter than a step: give up.
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

    /// Passes an accumulation of switches, the last of them about `gap` apart, if that changes no state by more than
    /// its tolerance allows. The states are at rest behind the accumulation if two successive probe steps of increasing
    /// length end at the same states, on the same face, with more free variables than the face at `t`. Returns whether
    /// there are two such probe steps.
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

    /// Brings the states onto the equations of the face if they miss them by noise. Otherwise the first step would
    /// correct the states, by forces that grow as the step shrinks and look like a switch, and by a change that the
    /// error test detects in states whose tolerance is finer than the noise of others.
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

    /// Resolves variables within noise of switching: the probe step is lengthened, up to `h`, until the sign is
    /// decided. Returns whether one of the variables leaves its face.
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

    /// Solves one implicit Euler step of size `eta` from `(t, y)`, and leaves its increment in the stages of the probe;
    /// returns false if it is not solved. If `snap`, inequalities that are zero to within noise start from exactly
    /// zero.
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
