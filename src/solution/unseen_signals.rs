//! Variations of signals (functions of time that drive joints and bodies) that the quadrature of a step does not see: a
//! smooth kick shorter than the step. Jumps and kinks are ends of the parts that are integrated.

use super::unseen_data::{InTime, UnseenData};
use expression::{IntervalWorkspace, Tape};
use models::rigid_bodies::{Angular, DriveLaw, Linear, MultibodySystem, Signals};
use numerics::Interval;

/// The integrals of signals that steps have missed so far. Signals that prescribe a position are not integrated, and
/// have none.
pub(super) struct UnseenSignals {
    program: Tape,
    boxes: IntervalWorkspace,
    data: UnseenData,
    /// For each signal, its value and its rate, with enclosures of both.
    values: Vec<f64>,
    ranges: Vec<Interval>,
    missed: Vec<Missed>,
}

/// What steps have missed of the integral of one signal.
struct Missed {
    /// The index of the signal.
    signal: usize,
    /// The integral minus that of the steps, and a bound on its error.
    by: [f64; 2],
    /// The sum over the steps of the absolute values of the integrals.
    size: f64,
}

/// The integrated signals as functions of time.
struct Integrated<'s> {
    program: &'s mut Tape,
    boxes: &'s mut IntervalWorkspace,
    values: &'s mut [f64],
    ranges: &'s mut [Interval],
    missed: &'s [Missed],
}

impl InTime for Integrated<'_> {
    fn at(&mut self, t: f64, out: &mut [f64]) {
        self.program.evaluate(t, &[], self.values);
        out.iter_mut().zip(self.missed).for_each(|(out, missed)| *out = self.values[2 * missed.signal]);
    }

    fn enclose(&mut self, t: Interval, out: &mut [Interval]) {
        self.program.enclose(t, &[], self.boxes, self.ranges);
        out.iter_mut().zip(self.missed).for_each(|(out, missed)| *out = self.ranges[2 * missed.signal]);
    }
}

impl UnseenSignals {
    /// Prepares the estimate for a multibody system; returns `None` if no step integrates a signal.
    pub fn of(scene: &MultibodySystem) -> Option<Self> {
        let mut signals: Vec<usize> = Vec::new();
        for drive in scene.joints.iter().filter_map(|joint| joint.drive.as_ref()) {
            match &drive.law {
                DriveLaw::Position(_) => {}
                DriveLaw::Velocity(signal) => signals.push(*signal),
                DriveLaw::Force(law) => {
                    signals.extend(law.effort.into_iter().chain(law.servo.as_ref().map(|servo| servo.target)));
                }
            }
        }
        for motion in scene.bodies.iter().filter_map(|body| body.motion.as_ref()) {
            if let Some(Linear::Velocity(of)) = motion.linear {
                signals.extend(of);
            }
            if let Some(Angular::Velocity(of)) = motion.angular {
                signals.extend(of);
            }
        }
        let missed = signals.into_iter().map(|signal| Missed { signal, by: [0.0; 2], size: 0.0 });
        let missed: Vec<Missed> = missed.collect();
        let program = scene.signals.program.clone();
        (!missed.is_empty()).then(|| Self {
            boxes: IntervalWorkspace::new(&program),
            program,
            data: UnseenData::default(),
            values: vec![0.0; 2 * scene.signals.count],
            ranges: vec![Interval::LINE; 2 * scene.signals.count],
            missed,
        })
    }

    /// Adds a step from `from` to `to`, and returns the largest part of the integral of a signal that steps have missed so
    /// far, relative to the sum of the absolute values of its integrals over the steps.
    pub fn step(&mut self, [from, to]: [f64; 2], signals: &Signals) -> f64 {
        let used = signals.over(from, to - from);
        let Self { program, boxes, data, values, ranges, missed } = self;
        let mut exact = vec![[0.0; 2]; missed.len()];
        for &part in &used.parts {
            let mut integrated = Integrated { program, boxes, values, ranges, missed };
            if data.integrate(missed.len(), part, &mut integrated) {
                for (sum, found) in exact.iter_mut().zip(&data.integrals) {
                    sum[0] += found[0];
                    sum[1] += found[1];
                }
            } else {
                let mut constant = vec![0.0; missed.len()];
                integrated.at(0.5 * (part[0] + part[1]), &mut constant);
                exact.iter_mut().zip(constant).for_each(|(sum, value)| sum[0] += (part[1] - part[0]) * value);
            }
        }
        let mut largest = 0.0_f64;
        for (missed, [integral, error]) in missed.iter_mut().zip(exact) {
            let by_steps = used.integrals[missed.signal];
            missed.by[0] += integral - by_steps;
            missed.by[1] += error;
            missed.size += integral.abs().max(by_steps.abs());
            let by = missed.by[0].abs() + missed.by[1];
            if by > 0.0 {
                largest = largest.max(by / missed.size);
            }
        }
        largest
    }
}
