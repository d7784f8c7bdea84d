//! Variations of the forces on rigid bodies between the times at which steps evaluate them: in time, with all bodies
//! as at the end of the step, and along the path of the step.

use super::unseen_data::{InTime, OfStates, OnWay, UnseenData};
use expression::{IntervalWorkspace, Tape};
use models::rigid_bodies::{Action, Motion, MultibodySystem, OF_BODY, OUTPUTS, state};
use nalgebra::{Quaternion, Vector3};
use numerics::Interval;

/// The variations of one force on a body between the times at which steps evaluate it, and the resulting displacement
/// of the body.
pub(super) struct UnseenAction {
    program: Tape,
    boxes: IntervalWorkspace,
    data: UnseenData,
    of_way: UnseenData,
    /// The index of the moving body on which the force acts.
    pub own: usize,
    /// The states of the bodies on which the force depends, at the end (`inputs`) and at the beginning (`before`) of
    /// a step.
    inputs: Vec<f64>,
    before: Vec<f64>,
    out: Vec<f64>,
    ranges: Vec<Interval>,
    /// The displacement of the body (`displaced`): translation and its rate, then rotation and its rate; and bounds
    /// on the errors of these numbers (`unknown`).
    displaced: [[Vector3<f64>; 2]; 2],
    unknown: [[f64; 2]; 2],
}

/// The force and the torque of an action (applied load) on a body, as functions of the states of the bodies on which
/// they depend.
struct ActionOfStates<'s> {
    program: &'s mut Tape,
    boxes: &'s mut IntervalWorkspace,
    out: &'s mut [f64],
    ranges: &'s mut [Interval],
}

impl OfStates for ActionOfStates<'_> {
    fn at(&mut self, t: f64, states: &[f64], out: &mut [f64]) {
        self.program.evaluate(t, states, self.out);
        out.copy_from_slice(&self.out[..out.len()]);
    }

    fn enclose(&mut self, t: Interval, states: &[Interval], out: &mut [Interval]) {
        self.program.enclose(t, states, self.boxes, self.ranges);
        out.copy_from_slice(&self.ranges[..out.len()]);
    }
}

impl UnseenAction {
    /// Prepares the estimates for all forces and torques (actions) on moving bodies of a scene.
    pub fn all(scene: &MultibodySystem) -> Vec<Self> {
        let moving: Vec<usize> = (0..scene.bodies.len()).filter(|&body| !scene.bodies[body].fixed).collect();
        let new = |action: &Action| {
            let own = moving.binary_search(&action.bodies.first()?.0).ok()?;
            let at = |(body, centre): &(usize, Vector3<f64>)| {
                let body = &scene.bodies[*body];
                state(centre, &body.pose, &body.velocity, &body.omega)
            };
            let inputs: Vec<f64> = action.bodies.iter().flat_map(at).collect();
            Some(Self {
                program: action.program.clone(),
                boxes: IntervalWorkspace::new(&action.program),
                data: UnseenData::default(),
                of_way: UnseenData::of_way(),
                own,
                before: inputs.clone(),
                inputs,
                out: vec![0.0; OUTPUTS],
                ranges: vec![Interval::LINE; OUTPUTS],
                displaced: [[Vector3::zeros(); 2]; 2],
                unknown: [[0.0; 2]; 2],
            })
        };
        scene.actions.iter().filter_map(new).collect()
    }

    /// Adds a step of the run, at whose end the body has the given motion. The changes by missed forces of velocity
    /// components that contacts hold fixed (`held`) are set to zero.
    pub fn step(
        &mut self,
        [from, to]: [f64; 2],
        motion: &Motion,
        (is_local, at): (bool, &Vector3<f64>),
        held: &[bool; 6],
    ) {
        let h = to - from;
        let Self { program, boxes, data, of_way, inputs, before, out, ranges, displaced, unknown, .. } = self;
        let (mut missed, mut left) = ([Vector3::zeros(); 2], [0.0; 2]);
        let turn = |of: Vector3<f64>| if is_local { motion.pose.rotation * of } else { of };
        let arm = motion.pose.rotation * at;
        let mut of_states = ActionOfStates { program, boxes, out, ranges };
        let mut in_time = OnWay::new(&mut of_states, [from, to], [inputs, inputs]);
        if data.integrate(6, [from, to], &mut in_time) {
            let bound = |k: usize| (0..3).map(|i| data.integrals[3 * k + i][1]).sum::<f64>();
            left = [bound(0) / motion.mass, motion.mobility.norm() * (bound(1) + arm.norm() * bound(0))];
        }
        let mut on_way = OnWay::new(&mut of_states, [from, to], [before, inputs]);
        if of_way.integrate(6, [from, to], &mut on_way) {
            // A step uses the forces at its midpoint in time.
            let mut used = [0.0; 6];
            on_way.at(from + 0.5 * h, &mut used);
            let part = |k: usize| Vector3::from_fn(|i, _| of_way.integrals[3 * k + i][0] - h * used[3 * k + i]);
            let force = turn(part(0));
            missed = [force / motion.mass, motion.mobility * (turn(part(1)) + arm.cross(&force))];
        }
        before.copy_from_slice(inputs);
        for k in 0..2 {
            let change = displaced[k][1] + missed[k] * 0.5;
            displaced[k][0] += change * h;
            displaced[k][1] += missed[k];
            unknown[k][0] += h * (unknown[k][1] + 0.5 * left[k]);
            unknown[k][1] += left[k];
            let held = &held[3 * k..3 * k + 3];
            displaced[k][1].iter_mut().zip(held).filter(|(_, held)| **held).for_each(|(velocity, _)| *velocity = 0.0);
            if held.iter().all(|held| *held) {
                unknown[k][1] = 0.0;
            }
        }
    }

    /// Reads from `states`, the states of all moving bodies, those of the bodies on which the force depends at the end
    /// of a step.
    pub fn read(&mut self, action: &Action, scene: &MultibodySystem, states: &[f64]) {
        for ((body, _), inputs) in action.bodies.iter().zip(self.inputs.chunks_exact_mut(OF_BODY.len())) {
            let place = scene.bodies[..*body].iter().filter(|body| !body.fixed).count();
            if !scene.bodies[*body].fixed {
                inputs.copy_from_slice(&states[OF_BODY.len() * place..][..OF_BODY.len()]);
            }
        }
    }

    /// Adds the displacement of the body by missed forces, and bounds on the error of the displacement, to the outputs
    /// of the body.
    pub fn displace(&self, motion: &Motion, out: &mut [f64]) {
        for i in 0..3 {
            out[i] += self.displaced[0][0][i] + self.unknown[0][0];
            out[7 + i] += self.displaced[0][1][i] + self.unknown[0][1];
            out[10 + i] += self.displaced[1][1][i] + self.unknown[1][1];
        }
        let turned = Quaternion::from_parts(0.0, 0.5 * self.displaced[1][0]) * motion.pose.rotation.into_inner();
        for (out, turned) in out[3..7].iter_mut().zip([turned.w, turned.i, turned.j, turned.k]) {
            *out += turned + 0.5 * self.unknown[1][0];
        }
    }
}
