//! The energy balance of a run. Over a step with `M (v+ - v-) = p + J^T r`, where `p` is the impulse of the forces,
//!
//! ```text
//! T+ - T- = <p, v+ + v->/2 + <r, u+ + u->/2
//! ```
//!
//! exactly if `M` is constant and `u = J v`. Where surfaces, belts or joints are driven, `u = J v + b` and
//! `<J^T r, v> = <r, u> - <r, b>`: contacts lose `-<r_t, u_t+ + u_t->/2` by friction and `-<r_n, u_n+ + u_n->/2` in
//! impacts, and the drives do the work `-<r, b>`. A potential or masses that depend on time do the work of the integral
//! of `dV/dt - dT/dt` at fixed `q` and `v`: along `d/dt dL/dv - dL/dq = Q + J^T r` with `L = T - V` the energy has the
//! rate `Q v + r J v - dL/dt`. With the work of the forces that have no potential the balance of a run is
//!
//! ```text
//! E(t) - E(0) = work of forces + work of drives - friction - viscosity - impacts + defect
//! ```
//!
//! The defect is zero for an exact solution and measures the discretisation error.

use serde::Serialize;

/// Resolved motion: largest energy that may change between kinetic and potential in half a step, relative to
/// [`Energy::size`]. The half-step offset of velocities does not explain the defect of longer steps.
const MOST_LAG: f64 = 0.1;

/// The energy balance of a run, in units of energy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Energy {
    /// Kinetic energy at the start of the run.
    pub kinetic_at_start: f64,
    /// Potential energy at the start of the run.
    pub potential_at_start: f64,
    /// Kinetic energy at the end of the run.
    pub kinetic_at_end: f64,
    /// Potential energy at the end of the run.
    pub potential_at_end: f64,
    /// Work in the run of the forces without a potential.
    pub work_of_forces: f64,
    /// Work of drives: surfaces, belts and joints that depend on time, and a potential or masses that depend on time.
    pub work_of_drives: f64,
    /// Energy dissipated by friction in the run.
    pub dissipated_by_friction: f64,
    /// Energy dissipated by viscosity; absent from the output if zero.
    #[serde(skip_serializing_if = "is_none")]
    pub dissipated_by_viscosity: f64,
    /// Energy lost in the impacts of the run.
    pub lost_in_impacts: f64,
    /// Defect of the energy balance at the end of the run: the change of energy less all work, plus dissipation and
    /// losses.
    pub defect: f64,
    /// The largest absolute defect of the energy balance at the end of any step of the run.
    pub largest_defect: f64,
    /// The largest energy gained through impacts in one step, which should be zero, relative to the largest energy of
    /// the run so far: kinetic with or without the contact impulses, or exchanged with the potential.
    pub largest_gain_in_impacts: f64,
    /// Energy lost in impacts beyond the effect of restitution: zero if every impulse obeys the law of impact.
    #[serde(skip)]
    pub lost_beyond_restitution: f64,
    /// The largest energy of the run so far, see [`Energy::size`].
    #[serde(skip)]
    largest: f64,
    /// The largest energy gained through impacts in one step, in units of energy.
    #[serde(skip)]
    gain: f64,
    /// The largest absolute defect of the energy balance with velocities taken at the middles of steps; `None` if not
    /// recorded.
    #[serde(skip)]
    largest_at_middles: Option<f64>,
    /// The largest change of potential energy in half a step of the run so far.
    #[serde(skip)]
    largest_lag: f64,
    /// The sum of the absolute values of all work and dissipation of the run so far.
    #[serde(skip)]
    throughput: f64,
    /// The sum of the absolute values of the estimated energy errors of first-order steps.
    #[serde(skip)]
    explained: f64,
    /// The largest energy that the forces may exchange between kinetic and potential energy in one first-order step.
    #[serde(skip)]
    exchanged: f64,
    /// The largest terms of the energy balance, which bound its rounding error.
    #[serde(skip)]
    terms: f64,
}

/// Rounding error of the energy balance, relative to its terms.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

impl Energy {
    /// Starts the energy balance of a run with the energies at the start of the run.
    pub fn new(kinetic: f64, potential: f64) -> Self {
        Self {
            kinetic_at_start: kinetic,
            potential_at_start: potential,
            kinetic_at_end: kinetic,
            potential_at_end: potential,
            largest: kinetic,
            terms: kinetic + potential.abs(),
            ..Self::default()
        }
    }

    /// Raises the recorded largest energy to at least `energy`. For a system at rest, `energy` is the work of its
    /// weights over a displacement of its own size.
    pub fn meet(&mut self, energy: f64) {
        self.largest = self.largest.max(energy);
    }

    /// Returns the energy scale for defects: the largest kinetic energy plus change of potential (for a system at
    /// rest, the energy given to [`Energy::meet`]), plus all work and dissipation so far.
    pub fn size(&self) -> f64 {
        self.largest + self.throughput
    }

    /// Records the defect with velocities taken at the middle of a step. In a step `q+ = q + h v+`, `v+` is the
    /// velocity at the middle of the step, to which the mean of the potentials at both ends belongs (as in the
    /// leapfrog scheme): an offset of half a step in time is no loss of energy.
    pub fn close_at_middle(&mut self, change_of_potential: f64) {
        let lag = 0.5 * change_of_potential;
        self.largest_lag = self.largest_lag.max(lag.abs());
        let defect = (self.defect - lag).abs();
        self.largest_at_middles = Some(self.largest_at_middles.map_or(defect, |largest| largest.max(defect)));
    }

    /// Returns the largest defect of the run, with velocities taken at the ends of steps or, if recorded and the
    /// motion is resolved, at their middles.
    pub fn lacking(&self) -> f64 {
        let is_resolved = self.largest_lag <= MOST_LAG * self.size();
        self.largest_at_middles
            .filter(|_| is_resolved)
            .map_or(self.largest_defect, |largest| largest.min(self.largest_defect))
    }

    /// Returns the rounding error of the defect: that of the energies and of the sums of work and dissipation.
    pub fn rounding(&self) -> f64 {
        ROUNDING * (self.terms + self.throughput)
    }

    /// Adds the energy error of a first-order step, and records the largest energy that its forces may exchange in
    /// the step.
    pub fn explain(&mut self, error: f64, exchanged: f64) {
        self.explained += error;
        self.exchanged = self.exchanged.max(exchanged);
    }

    /// Returns the largest defect that the first order of the steps explains: twice the accumulated error estimates,
    /// which are of leading order only. The estimates are capped at `steps` exchanges of energy, which corresponds to
    /// positions and velocities that are off by their change over `steps` steps. Returns zero if the steps do not
    /// resolve the motion.
    pub fn explained(&self, steps: f64) -> f64 {
        let is_resolved = 0.5 * self.exchanged <= MOST_LAG * self.size();
        if is_resolved { 2.0 * self.explained.min(steps * self.exchanged) } else { 0.0 }
    }

    /// Adds the dissipation by friction and the loss in impacts of a step whose largest kinetic energy is `kinetic`.
    pub fn dissipate(&mut self, friction: f64, impacts: f64, kinetic: f64) {
        self.dissipated_by_friction += friction;
        self.lost_in_impacts += impacts;
        self.throughput += friction.abs() + impacts.abs();
        self.meet(kinetic);
        self.gain = self.gain.max(-impacts);
        if self.gain > 0.0 && self.largest > 0.0 {
            self.largest_gain_in_impacts = self.gain / self.largest;
        }
    }

    /// Adds the work that forces without a potential, and drives, do in a step to the balance.
    pub fn work(&mut self, forces: f64, drives: f64) {
        self.work_of_forces += forces;
        self.work_of_drives += drives;
        self.throughput += forces.abs() + drives.abs();
    }

    /// Adds the energy that viscosity dissipates in a step to the balance.
    pub fn dissipate_by_viscosity(&mut self, viscosity: f64) {
        self.dissipated_by_viscosity += viscosity;
        self.throughput += viscosity.abs();
    }

    /// Interpolates the work and dissipation of an energy balance linearly towards those of a later balance; `part` of
    /// the interval runs from 0 to 1.
    #[must_use]
    pub fn towards(mut self, later: &Self, part: f64) -> Self {
        let booked = |energy: &mut f64, later: f64| *energy += part * (later - *energy);
        booked(&mut self.work_of_forces, later.work_of_forces);
        booked(&mut self.work_of_drives, later.work_of_drives);
        booked(&mut self.dissipated_by_friction, later.dissipated_by_friction);
        booked(&mut self.lost_in_impacts, later.lost_in_impacts);
        self
    }

    /// Sets the energies at the end of a step, and updates the defect of the balance.
    pub fn close(&mut self, kinetic: f64, potential: f64) {
        (self.kinetic_at_end, self.potential_at_end) = (kinetic, potential);
        let raised = potential - self.potential_at_start;
        let change = (kinetic - self.kinetic_at_start) + raised;
        self.meet(kinetic + raised.abs());
        self.terms = self.terms.max(kinetic + potential.abs());
        let dissipated = self.dissipated_by_friction + self.dissipated_by_viscosity + self.lost_in_impacts;
        self.defect = change - self.work_of_forces - self.work_of_drives + dissipated;
        self.largest_defect = self.largest_defect.max(self.defect.abs());
    }
}

fn is_none(energy: &f64) -> bool {
    *energy == 0.0
}
