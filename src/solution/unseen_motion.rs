//! Bodies with a prescribed motion that goes further within a step than its ends show: a paddle whose period equals
//! the step size, or a rotor that turns by half a turn. Steps evaluate contacts at single times only, and miss bodies
//! that would be struck in the swept volume.

use super::unseen_data::{InTime, UnseenData};
use expression::{IntervalWorkspace, Tape};
use models::rigid_bodies::{Angular, Linear, MoreauStepping, MultibodySystem, Prescription};
use nalgebra::Vector3;
use numerics::Interval;
use std::f64::consts::PI;

/// Largest distance that a body may cover within a step beyond what its positions at the ends of the step show,
/// relative to the largest mean speed of the body over a step, times the step size. An oscillation with six steps per
/// period reaches this value; the comparison run with steps twice as long detects such a motion too.
const MOST_UNSEEN: f64 = 0.25;

/// Largest velocity that an impact transfers from a moving surface to a body, relative to the speed of the surface: 2
/// for an elastic impact.
const OF_SURFACE: f64 = 2.0;

/// The bodies with a prescribed motion, and the possible displacements of other bodies by motion between the ends of
/// steps.
pub(super) struct UnseenMotion {
    program: Tape,
    boxes: IntervalWorkspace,
    data: UnseenData,
    /// The values and rates of all signals that prescribe motions, and enclosures of both.
    values: Vec<f64>,
    ranges: Vec<Interval>,
    given: Vec<Given>,
    /// For each moving body, its possible displacement and the possible error of its velocity by prescribed motion
    /// between the ends of steps.
    pub displaced: Vec<[f64; 2]>,
}

/// A body with a prescribed motion.
struct Given {
    body: usize,
    motion: Prescription,
    /// The largest mean speed over a step that the body with the prescribed motion has had so far.
    fastest: f64,
}

/// The magnitudes of the prescribed velocity components, three of the position and three of the rotation for each
/// body.
struct Magnitudes<'s> {
    program: &'s mut Tape,
    boxes: &'s mut IntervalWorkspace,
    values: &'s mut [f64],
    ranges: &'s mut [Interval],
    given: &'s [Given],
}

impl Given {
    /// Returns the indices of the components of velocity and angular velocity among the values and rates of all
    /// signals; `None` for components that are zero.
    fn velocities(&self) -> [Option<usize>; 6] {
        let linear = match self.motion.linear {
            None => [None; 3],
            Some(Linear::Position(of)) => of.map(|signal| Some(2 * signal + 1)),
            Some(Linear::Velocity(of)) => of.map(|signal| Some(2 * signal)),
        };
        let angular = match self.motion.angular {
            None => [None; 3],
            Some(Angular::Rotation(of, _)) => of.map(|signal| Some(2 * signal + 1)),
            Some(Angular::Velocity(of)) => of.map(|signal| Some(2 * signal)),
        };
        [linear[0], linear[1], linear[2], angular[0], angular[1], angular[2]]
    }
}

impl InTime for Magnitudes<'_> {
    fn at(&mut self, t: f64, out: &mut [f64]) {
        self.program.evaluate(t, &[], self.values);
        let places = self.given.iter().flat_map(Given::velocities);
        out.iter_mut().zip(places).for_each(|(out, place)| *out = place.map_or(0.0, |place| self.values[place].abs()));
    }

    fn enclose(&mut self, t: Interval, out: &mut [Interval]) {
        self.program.enclose(t, &[], self.boxes, self.ranges);
        let places = self.given.iter().flat_map(Given::velocities);
        for (out, place) in out.iter_mut().zip(places) {
            *out = place.map_or(Interval::point(0.0), |place| {
                let (least, most) = self.ranges[place].magnitudes();
                Interval { defined: self.ranges[place].defined, ..Interval::new(least, most) }
            });
        }
    }
}

impl UnseenMotion {
    /// Prepares the estimate for the bodies of a scene with a prescribed motion; returns `None` if there is none.
    pub fn of(scene: &MultibodySystem) -> Option<Self> {
        let given = scene
            .bodies
            .iter()
            .enumerate()
            .filter_map(|(body, of)| of.motion.map(|motion| Given { body, motion, fastest: 0.0 }));
        let given: Vec<Given> = given.collect();
        let count = 2 * scene.signals.count;
        let program = scene.signals.program.clone();
        (!given.is_empty() && count > 0).then(|| Self {
            boxes: IntervalWorkspace::new(&program),
            program,
            data: UnseenData::default(),
            values: vec![0.0; count],
            ranges: vec![Interval::LINE; count],
            given,
            displaced: vec![[0.0; 2]; scene.bodies.iter().filter(|body| !body.fixed).count()],
        })
    }

    /// Adds a step from `from` to `to` to the possible displacements of bodies near those with a prescribed motion.
    pub fn step(&mut self, [from, to]: [f64; 2], scene: &MultibodySystem, simulation: &MoreauStepping<'_>) {
        let h = to - from;
        let Self { program, boxes, data, values, ranges, given, displaced } = self;
        let count = 6 * given.len();
        let mut magnitudes = Magnitudes { program, boxes, values, ranges, given };
        // `integrate` returns false if no speed varies significantly: the integrals are then the speeds times the
        // step size.
        if !data.integrate(count, [from, to], &mut magnitudes) {
            let mut constant = vec![0.0; count];
            magnitudes.at(from, &mut constant);
            data.integrals = constant.into_iter().map(|speed| [h * speed, 0.0]).collect();
        }
        let signals = scene.signals.over(from, h);
        for (own, ways) in given.iter_mut().zip(data.integrals.chunks_exact(6)) {
            let way = |k: usize| Vector3::from_fn(|i, _| ways[3 * k + i][0] + ways[3 * k + i][1]);
            let shown = match own.motion.linear {
                None => Vector3::zeros(),
                Some(Linear::Position(of)) => {
                    Vector3::from(of.map(|signal| signals.end[signal] - signals.start[signal]))
                }
                Some(Linear::Velocity(of)) => Vector3::from(of.map(|signal| signals.integrals[signal])),
            };
            let collider = &scene.bodies[own.body].collider;
            let pose = simulation.pose(own.body);
            own.fastest = own.fastest.max(way(0).norm() / h);
            let mut hidden = (way(0) - shown.abs()).norm();
            if hidden <= MOST_UNSEEN * own.fastest * h {
                hidden = 0.0;
            }
            let turn = way(1);
            let about = pose.rotation.inverse() * turn;
            if turn != Vector3::zeros() && collider.reach().is_finite() && !collider.is_round_about(&about) {
                // A point moves along an arc, of which the step has the chord; within half a turn it reaches every
                // distance from the chord.
                let angle = turn.norm().min(PI);
                let beside = 1.0 - (0.5 * angle).cos();
                if beside > MOST_UNSEEN * angle {
                    hidden += collider.reach() * beside;
                }
            }
            if hidden == 0.0 {
                continue;
            }
            let moving = scene.bodies.iter().filter(|body| !body.fixed);
            for ((body, motion), displaced) in moving.zip(&simulation.ends).zip(displaced.iter_mut()) {
                let apart = (motion.pose.translation.vector - pose.translation.vector).norm();
                let reach = body.collider.reach() + h * motion.velocity.norm();
                if apart <= collider.reach() + reach + hidden {
                    displaced[1] += OF_SURFACE * hidden / h;
                }
            }
        }
        displaced.iter_mut().for_each(|displaced| displaced[0] += h * displaced[1]);
    }
}
