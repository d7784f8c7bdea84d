//! Where the energy goes. Over a step with `M (v+ - v-) = p + J^T r`, with `p` the impulse of the forces,
//!
//! ```text
//! T+ - T- = <p, v+ + v->/2 + <r, u+ + u->/2
//! ```
//!
//! exactly where `M` is constant and `u = J v`. Where surfaces, belts or joints move by themselves, `u = J v + b`, and
//! `<J^T r, v> = <r, u> - <r, b>`: relative velocities tell what is lost, `-<r_t, u_t+ + u_t->/2` by friction and
//! `-<r_n, u_n+ + u_n->/2` in impacts, and `-<r, b>` is the work of what drives them. So is the integral of
//! `dV/dt - dT/dt`, at fixed `q` and `v`, where potential and masses depend on time: along `d/dt dL/dv - dL/dq = Q + J^T r`
//! with `L = T - V` the energy has the rate `Q v + r J v - dL/dt`. With the work of the forces that have no potential the
//! balance of a run is
//!
//! ```text
//! E(t) - E(0) = work of forces + work of drives - friction - viscosity - impacts + defect
//! ```
//!
//! and the defect, which an exact solution does not have, measures the discretisation.

use serde::Serialize;

/// The part of the energy that half a step may exchange between its forms. A longer step does not resolve the motion, and
/// what it lacks is no matter of the time at which velocities are taken.
const MOST_LAG: f64 = 0.1;

/// The balance of a run, in units of energy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Energy {
    /// Kinetic energy at the start.
    pub kinetic_at_start: f64,
    /// Potential energy at the start.
    pub potential_at_start: f64,
    /// Kinetic energy at the end.
    pub kinetic_at_end: f64,
    /// Potential energy at the end.
    pub potential_at_end: f64,
    /// Work of the forces that have no potential.
    pub work_of_forces: f64,
    /// Work of what moves or changes by itself: surfaces, belts and joints that depend on time, a potential and masses that do.
    pub work_of_drives: f64,
    /// Dissipated by friction.
    pub dissipated_by_friction: f64,
    /// Dissipated by viscosity; absent where there is none.
    #[serde(skip_serializing_if = "is_none")]
    pub dissipated_by_viscosity: f64,
    /// Lost in impacts.
    pub lost_in_impacts: f64,
    /// What the balance lacks at the end: the change of energy less all work, plus what was dissipated and lost.
    pub defect: f64,
    /// The largest defect of the run, in size.
    pub largest_defect: f64,
    /// The most energy that a step gained through impacts, which should be zero, as a share of the largest energy so
    /// far, kinetic or exchanged, with or without what contacts took.
    pub largest_gain_in_impacts: f64,
    /// Energy lost in impacts beyond what restitution takes: zero where every impulse obeys the law of impact.
    #[serde(skip)]
    pub lost_beyond_restitution: f64,
    /// The largest energy met, see [`Energy::size`].
    #[serde(skip)]
    largest: f64,
    /// The largest gain in impacts, in units of energy.
    #[serde(skip)]
    gain: f64,
    /// The largest defect with velocities taken for those of the middles of steps.
    #[serde(skip)]
    largest_at_middles: Option<f64>,
    /// The largest energy that half a step exchanged.
    #[serde(skip)]
    largest_lag: f64,
    /// All that was done and dissipated, each part by its size.
    #[serde(skip)]
    throughput: f64,
    /// The errors that steps of first order make in the energy, as far as forces and velocities tell them, by their sizes.
    #[serde(skip)]
    explained: f64,
    /// The most energy that forces of that size may exchange in a step.
    #[serde(skip)]
    exchanged: f64,
    /// The largest terms of the balance, which bound its rounding.
    #[serde(skip)]
    terms: f64,
}

/// Rounding of the balance, in parts of its terms.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

impl Energy {
    /// A balance that begins with these energies.
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

    /// Raises the largest energy met: to what the weights of a system hold over its own size, for one at rest.
    pub fn meet(&mut self, energy: f64) {
        self.largest = self.largest.max(energy);
    }

    /// The largest energy met, with which defects are compared: kinetic energy and the change of the potential together, or
    /// what forces give within a step to what contacts hold; with all work and dissipation so far.
    pub fn size(&self) -> f64 {
        self.largest + self.throughput
    }

    /// Takes a step of `q+ = q + h v+` into account whose potential changed by this: its velocity is that of its middle, to
    /// which the mean of the potentials at its ends belongs (as in the leapfrog). Half a step in time is no loss of energy.
    pub fn close_at_middle(&mut self, change_of_potential: f64) {
        let lag = 0.5 * change_of_potential;
        self.largest_lag = self.largest_lag.max(lag.abs());
        let defect = (self.defect - lag).abs();
        self.largest_at_middles = Some(self.largest_at_middles.map_or(defect, |largest| largest.max(defect)));
    }

    /// What the balance lacks at worst, with velocities at the ends of steps or, where they are told and a step is short
    /// beside the motion, in their middles.
    pub fn lacking(&self) -> f64 {
        let is_resolved = self.largest_lag <= MOST_LAG * self.size();
        self.largest_at_middles
            .filter(|_| is_resolved)
            .map_or(self.largest_defect, |largest| largest.min(self.largest_defect))
    }

    /// The part of the defect that is rounding: of the energies, and of the sums of what was booked.
    pub fn rounding(&self) -> f64 {
        ROUNDING * (self.terms + self.throughput)
    }

    /// Notes the error of a step of first order in the energy, and the most that forces of its size may exchange in it.
    pub fn explain(&mut self, error: f64, exchanged: f64) {
        self.explained += error;
        self.exchanged = self.exchanged.max(exchanged);
    }

    /// What steps of first order may lack together: their errors, as long as these leave the states within what they cover in
    /// so many steps. Positions that far off are worth `steps` exchanges of energy, and so are velocities; the errors are
    /// estimates of leading order, and may be twice as large. No order explains a step that does not resolve the motion.
    pub fn explained(&self, steps: f64) -> f64 {
        let is_resolved = 0.5 * self.exchanged <= MOST_LAG * self.size();
        if is_resolved { 2.0 * self.explained.min(steps * self.exchanged) } else { 0.0 }
    }

    /// Books what contacts took, by friction and by impacts, in a step whose largest kinetic energy is this.
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

    /// Books the work of forces without a potential, and of drives.
    pub fn work(&mut self, forces: f64, drives: f64) {
        self.work_of_forces += forces;
        self.work_of_drives += drives;
        self.throughput += forces.abs() + drives.abs();
    }

    /// Books what viscosity dissipated.
    pub fn dissipate_by_viscosity(&mut self, viscosity: f64) {
        self.dissipated_by_viscosity += viscosity;
        self.throughput += viscosity.abs();
    }

    /// What is booked at this part of the way to a later balance.
    #[must_use]
    pub fn towards(mut self, later: &Self, part: f64) -> Self {
        let booked = |energy: &mut f64, later: f64| *energy += part * (later - *energy);
        booked(&mut self.work_of_forces, later.work_of_forces);
        booked(&mut self.work_of_drives, later.work_of_drives);
        booked(&mut self.dissipated_by_friction, later.dissipated_by_friction);
        booked(&mut self.lost_in_impacts, later.lost_in_impacts);
        self
    }

    /// Takes over the energies at the end of a step, and closes the balance.
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
