//! Monitors (event functions) of a contact mode: quantities that stay positive along the solution while the mode
//! lasts.

use super::mode::Status;
use super::mode_equations::ModeEquations;
use nalgebra::Vector2;
use problem::MechanicalStructure;

/// The event that ends a contact mode, with the index of its contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ending {
    /// The gap of an open contact closes.
    Impact(usize),
    /// The normal force of a closed contact becomes negative.
    Detachment(usize),
    /// The friction of a sticking contact exceeds its bound; the slip begins in this direction.
    StickToSlip(usize, Vector2<f64>),
    /// The slip of a sliding contact stops.
    SlipToStick(usize),
}

/// The value of a monitor (event function) of a contact mode, with its noise level and rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitor {
    /// The value of the monitor, positive while the contact mode lasts.
    pub value: f64,
    /// The rounding error of the value: below `-noise` the monitor is violated.
    pub noise: f64,
    /// The rate of change of the value of the monitor, if known.
    pub rate: Option<f64>,
    /// The event that a violation of the monitor indicates.
    pub ending: Ending,
}

impl Monitor {
    /// Whether the value of the monitor (event function) is zero up to rounding, or negative.
    pub fn is_on_bound(&self) -> bool {
        self.value <= self.noise
    }
}

/// Rounding error of gaps and velocities relative to their terms, and of multipliers relative to the largest.
pub const ROUNDING_OF_VELOCITIES: f64 = 1e-13;
const ROUNDING_OF_FORCES: f64 = 1e-9;

/// Gaps and their velocities below this fraction of their terms count as zero: drift off the held constraints may be
/// as large.
const AT_REST: f64 = 1e-9;

/// Evaluates the monitors of a mode at a state `x` of a step. `reached` are the sizes that the states reach in the
/// step: the rounding errors of all interpolated states are relative to them. The number and order of the monitors
/// depend on the mode alone.
pub fn monitors(
    equations: &mut ModeEquations,
    structure: &MechanicalStructure,
    mode: &[Status],
    t: f64,
    (x, reached): (&[f64], &[f64]),
    out: &mut Vec<Monitor>,
) {
    let (q, v) = x.split_at(structure.coordinates);
    if equations.rows().is_empty() {
        equations.evaluate_constraints(t, q);
    } else {
        equations.evaluate_at(t, x);
    }
    let ticks = equations.problem().rounding_of_time(t);
    let (reached_q, reached_v) = reached.split_at(structure.coordinates);
    out.clear();
    let constraints = equations.constraints();
    let forces = (0..mode.len()).fold(0.0_f64, |most, k| most.max(equations.lambda[structure.normal(k)].abs()));
    let are_still = equations.rows().iter().all(|&row| constraints.drift[row] == 0.0);
    for (k, status) in mode.iter().enumerate() {
        let row = structure.normal(k);
        let force = equations.lambda[row];
        let noise = ROUNDING_OF_FORCES * forces;
        if *status == Status::Open {
            let value = constraints.values[structure.joints + k];
            let terms = constraints.size(row, q);
            let in_time =
                4.0 * (f64::EPSILON * t.abs() * constraints.size(row, v) + ticks * constraints.drift[row].abs());
            let size = terms.max(constraints.size(row, reached_q));
            let noise = in_time + ROUNDING_OF_VELOCITIES * size.max(f64::MIN_POSITIVE);
            let speed = constraints.velocity(row, v);
            // A gap that other constraints keep at zero, and that carries no force, cannot close. The velocities of
            // contacts that fixed constraints hold at rest are rounding errors.
            let is_slow =
                are_still && constraints.drift[row] == 0.0 || speed.abs() <= AT_REST * constraints.terms(row, v);
            let rests = is_slow && value <= AT_REST * terms.max(f64::MIN_POSITIVE);
            let value = if rests && equations.is_gap_held(k) { f64::INFINITY } else { value };
            let rate = Some(speed);
            out.push(Monitor { value, noise, rate, ending: Ending::Impact(k) });
            continue;
        }
        out.push(Monitor { value: force, noise, rate: None, ending: Ending::Detachment(k) });
        match *status {
            Status::Stick => {
                let mut friction = Vector2::zeros();
                for (friction, row) in friction.iter_mut().zip(structure.tangents(k)) {
                    *friction = equations.lambda[row];
                }
                let value = equations.mu[k] * force - friction.norm();
                let away = if friction.norm() > 0.0 { -friction.normalize() } else { Vector2::x() };
                out.push(Monitor { value, noise, rate: None, ending: Ending::StickToSlip(k, away) });
            }
            Status::Slip(direction) => {
                // A contact point that other constraints keep at rest does not slip, so that the event at which slip
                // stops cannot occur.
                let is_held = equations.is_slip_held(k, v);
                let value = if is_held { f64::INFINITY } else { equations.slip(k, v).dot(&direction) };
                let terms = |row| constraints.terms(row, v).max(constraints.size(row, reached_v));
                let size = structure.tangents(k).map(terms).fold(0.0, f64::max);
                let rate = Some(equations.slip_rate(k).dot(&direction));
                out.push(Monitor { value, noise: ROUNDING_OF_VELOCITIES * size, rate, ending: Ending::SlipToStick(k) });
            }
            Status::Open | Status::Frictionless => {}
        }
    }
}
