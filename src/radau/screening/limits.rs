//! Magnitudes below which monitors count as zero over a part of a step.
//!
//! A monitor may be negative as far as errors of the unknowns within their tolerances can change its least value: to first
//! order by the sum of these errors times the derivatives *at the time of that value*, since the time itself does not
//! matter there (envelope theorem). Derivatives at another place say nothing: `u^2 - c` varies slowly where it is least,
//! and a state that runs through a band shorter than its tolerance passes it, whatever its error. Over a part, the least
//! magnitudes of the derivatives are used.

use super::reduced::Reduced;
use super::watched::Watched;
use crate::face::Activity;
use crate::newton_control::NewtonControl;
use crate::system::System;
use crate::uncertainties::Uncertainties;
use numerics::Interval;

/// Limits (infinite) of a block whose monitors are left out of the proof.
const LEFT_OUT: [f64; 2] = [f64::INFINITY; 2];

/// Limits below which monitors (event functions) count as zero, over the part of the step examined last.
#[derive(Debug, Default)]
pub(super) struct Limits {
    uncertainties: Uncertainties,
    /// The unknowns at the beginning of the step that is screened.
    begin: Vec<f64>,
    /// For each variable in an interval, the limits below which its distances from its bounds, and its `G`, count as
    /// zero.
    of_variables: Vec<[f64; 2]>,
    /// For each block, whether its monitors are left out of the proof.
    left_out: Vec<bool>,
    /// Least magnitudes of the derivatives of the rows of the problem over the part of the step.
    slopes: Vec<f64>,
}

impl Limits {
    /// Starts the screening of a step at the unknowns `y`, with the derivatives of the last differentiation and no
    /// block left out.
    pub fn start(&mut self, system: &System<'_>, control: &NewtonControl, uncertainties: Uncertainties, y: &[f64]) {
        self.uncertainties = uncertainties;
        self.begin.clear();
        self.begin.extend_from_slice(y);
        self.left_out.clear();
        self.left_out.resize(system.set.blocks().len(), false);
        self.slopes.clear();
        self.slopes.extend(system.derivatives.iter().map(|slope| slope.abs()));
        // If derivatives vary, each part of the step has limits of its own.
        if system.constant_jacobian() {
            self.update(system, control);
        }
    }

    /// Updates the limits to a part of the step over which the derivatives lie in the ranges `derivatives`; `None` if
    /// they are not known.
    pub fn follow(&mut self, system: &System<'_>, control: &NewtonControl, derivatives: Option<&[Interval]>) {
        match derivatives {
            None => self.slopes.fill(0.0),
            Some(jacobian) => {
                let least = jacobian.iter().map(|slope| slope.magnitudes().0);
                self.slopes.iter_mut().zip(least).for_each(|(slope, least)| *slope = least);
            }
        }
        self.update(system, control);
    }

    fn update(&mut self, system: &System<'_>, control: &NewtonControl) {
        let slope = |at: usize| self.slopes[at];
        let limits = (0..system.unknowns - system.states).map(|k| {
            let [of_z, of_g] = self.uncertainties.of(system, k, slope);
            let noise =
                [control.noise_of_z(system, k, &self.begin), control.noise_of_g_by(system, k, &self.begin, slope)];
            [of_z.max(noise[0]), of_g.max(noise[1])]
        });
        self.of_variables.clear();
        self.of_variables.extend(limits);
    }

    /// Returns the limit below which the monitor (event function) `monitor` counts as zero.
    pub fn of(&self, monitor: &Watched) -> f64 {
        let [of_z, of_g] = self.of_variables[monitor.variable];
        if monitor.place == Activity::Inactive { of_z } else { of_g }
    }

    /// Returns the change of a monitor (event function) by errors of the states within their tolerances; `form` is the
    /// monitor [reduced](Reduced) by the equations of the free variables, which follow the states.
    pub fn of_form(&self, system: &System<'_>, form: &Reduced) -> f64 {
        form.least_error(&self.uncertainties.errors[..system.states])
    }

    /// Returns the limits below which the distances and the multipliers of block `b` count as zero.
    pub fn of_block(&self, system: &System<'_>, b: usize) -> [f64; 2] {
        if self.left_out[b] {
            return LEFT_OUT;
        }
        let members = system.set.blocks()[b].members.iter().map(|&k| self.of_variables[k]);
        members.fold([0.0; 2], |sum, of| [sum[0].max(of[0]), sum[1] + of[1]])
    }

    /// Leaves blocks whose monitors are curved (nonlinear functions of `z` and `G`) on the face out of the proof;
    /// returns whether one of these blocks was not left out before.
    pub fn leave_out_curved(&mut self, system: &System<'_>) -> bool {
        let mut is_new = false;
        for (b, left_out) in self.left_out.iter_mut().enumerate() {
            is_new |= has_curved_monitors(system, b) && !std::mem::replace(left_out, true);
        }
        is_new
    }

    /// Whether block `b` is left out of the proof that monitors keep their signs.
    pub fn is_left_out(&self, b: usize) -> bool {
        self.left_out[b]
    }
}

/// Whether the monitors of block `b` on its face are curved: nonlinear functions of `z` and `G`.
pub(super) fn has_curved_monitors(system: &System<'_>, b: usize) -> bool {
    let (block, face) = (&system.set.blocks()[b], &system.face.blocks[b]);
    !block.shape.is_flat(face) && !system.face.holds(&block.members)
}
