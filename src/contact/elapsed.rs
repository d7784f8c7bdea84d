//! A mechanical system with time counted from the start of the run. Motion does not depend on the epoch of the clock,
//! but floating-point times are spaced by `EPSILON` times their distance from the epoch, too widely for impacts that
//! accumulate. Motion is therefore computed in the time since the start; the start time is added wherever the system
//! itself depends on time.

use nalgebra::DMatrix;
use numerics::Interval;
use problem::{Constraints, DynamicsRange, Energies, Mechanical, MechanicalStructure, Sensitivity, SensitivityRange};

/// A mechanical system whose time is zero at the start of the run.
pub struct Elapsed {
    problem: Box<dyn Mechanical>,
    start: f64,
}

impl Elapsed {
    /// Shifts the origin of time of a mechanical system to `start`, the start time of the run.
    pub fn new(problem: Box<dyn Mechanical>, start: f64) -> Self {
        Self { problem, start }
    }
}

impl Mechanical for Elapsed {
    fn structure(&self) -> &MechanicalStructure {
        self.problem.structure()
    }

    fn mass(&mut self, t: f64, q: &[f64], mass: &mut DMatrix<f64>) {
        self.problem.mass(self.start + t, q, mass);
    }

    fn forces(&mut self, t: f64, q: &[f64], v: &[f64], f: &mut [f64]) {
        self.problem.forces(self.start + t, q, v, f);
    }

    fn stiffness(&mut self, t: f64, q: &[f64], v: &[f64], by_q: &mut DMatrix<f64>, by_v: &mut DMatrix<f64>) {
        self.problem.stiffness(self.start + t, q, v, by_q, by_v);
    }

    fn constraints(&mut self, t: f64, q: &[f64], constraints: &mut Constraints) {
        self.problem.constraints(self.start + t, q, constraints);
    }

    fn positions(&mut self, t: f64, q: &[f64], values: &mut [f64]) {
        self.problem.positions(self.start + t, q, values);
    }

    fn enclose_positions(&mut self, t: Interval, q: &[Interval], values: &mut [Interval]) {
        self.problem.enclose_positions(Interval::point(self.start) + t, q, values);
    }

    fn enclose_velocities(&mut self, t: Interval, q: &[Interval], v: &[Interval], values: &mut [Interval]) {
        self.problem.enclose_velocities(Interval::point(self.start) + t, q, v, values);
    }

    fn enclose_in_time(&mut self, t: Interval, q: &[f64], v: &[f64], values: &mut [Interval]) {
        self.problem.enclose_in_time(Interval::point(self.start) + t, q, v, values);
    }

    fn enclose_forces(&mut self, t: Interval, q: &[Interval], v: &[Interval], f: &mut [Interval]) {
        self.problem.enclose_forces(Interval::point(self.start) + t, q, v, f);
    }

    fn enclose_dynamics(&mut self, t: Interval, q: &[Interval], v: &[Interval], range: &mut DynamicsRange) {
        self.problem.enclose_dynamics(Interval::point(self.start) + t, q, v, range);
    }

    fn enclose_sensitivity(
        &mut self,
        t: Interval,
        x: &[Interval],
        a: &[f64],
        lambda: &[f64],
        range: &mut SensitivityRange,
    ) {
        self.problem.enclose_sensitivity(Interval::point(self.start) + t, x, a, lambda, range);
    }

    fn may_jump(&mut self, t: Interval, x: &[Interval]) -> bool {
        self.problem.may_jump(Interval::point(self.start) + t, x)
    }

    fn may_pass_knot(&mut self, t: Interval, x: &[Interval]) -> bool {
        self.problem.may_pass_knot(Interval::point(self.start) + t, x)
    }

    fn breaks(&mut self, t: f64) -> &[f64] {
        self.problem.breaks(self.start + t)
    }

    fn break_courses(&mut self, t: f64) -> &[f64] {
        self.problem.break_courses(self.start + t)
    }

    fn enclose_breaks(&mut self, t: Interval) -> &[Interval] {
        self.problem.enclose_breaks(Interval::point(self.start) + t)
    }

    fn friction(&mut self, k: usize, t: f64, q: &[f64], v: &[f64], slip_speed: f64) -> f64 {
        self.problem.friction(k, self.start + t, q, v, slip_speed)
    }

    fn friction_slopes(&mut self, k: usize, t: f64, q: &[f64], v: &[f64], slip_speed: f64, slopes: &mut [f64]) {
        self.problem.friction_slopes(k, self.start + t, q, v, slip_speed, slopes);
    }

    fn enclose_friction(&mut self, k: usize, t: Interval, x: &[Interval], slip_speed: Interval) -> Interval {
        self.problem.enclose_friction(k, Interval::point(self.start) + t, x, slip_speed)
    }

    fn enclose_friction_slopes(
        &mut self,
        k: usize,
        t: Interval,
        x: &[Interval],
        slip_speed: Interval,
        slopes: &mut [Interval],
    ) {
        self.problem.enclose_friction_slopes(k, Interval::point(self.start) + t, x, slip_speed, slopes);
    }

    fn energies(&mut self, t: f64, q: &[f64], v: &[f64]) -> Energies {
        self.problem.energies(self.start + t, q, v)
    }

    fn bias(&mut self, t: f64, q: &[f64], v: &[f64], gamma: &mut [f64]) {
        self.problem.bias(self.start + t, q, v, gamma);
    }

    fn sensitivity(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &[f64], out: &mut Sensitivity) {
        self.problem.sensitivity(self.start + t, q, v, a, lambda, out);
    }

    fn sensitivity_in_time(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &[f64], out: &mut [f64]) {
        self.problem.sensitivity_in_time(self.start + t, q, v, a, lambda, out);
    }

    fn rounding_of_time(&self, t: f64) -> f64 {
        self.problem.rounding_of_time(self.start + t).max(f64::EPSILON * t.abs())
    }
}
