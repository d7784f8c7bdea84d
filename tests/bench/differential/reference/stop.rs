//! Reference for a driven oscillator with a stop, from impact to impact: `q'' = -k q - c q' + f(t)`, `q >= wall`, and
//! `v+ = -e v-` at an impact. The oscillator rests at the stop while the force presses it there.

use super::Values;
use super::flow::{Driven, Flow, Monitor, ZERO, lexicographic_sign};
use crate::differential::signal::Signal;
use nalgebra::RowDVector;

/// A driven oscillator of unit mass with a stop.
#[derive(Clone, Debug)]
pub struct Stop {
    pub stiffness: f64,
    pub damping: f64,
    pub force: Signal,
    pub wall: f64,
    pub restitution: f64,
    /// Initial position and velocity of the oscillator.
    pub initial: [f64; 2],
}

const MOST_EVENTS: usize = 20_000;
const MOST_STEPS: f64 = 3e6;
/// A rebound slower than this fraction of the largest speed so far counts as rest, if the force presses the body to
/// the stop: the relative height of the rebound is the square of this fraction.
const REST: f64 = 1e-6;

impl Stop {
    /// Returns position and velocity of the oscillator at `times`.
    pub fn solve(&self, times: &[f64]) -> Option<Values> {
        let driven = Driven::new(2, std::iter::once(&self.force));
        let none = Signal::default();
        let velocity = driven.row(&[0.0, 1.0], &none);
        let pull = driven.row(&[-self.stiffness, -self.damping], &self.force);
        let still = driven.row(&[0.0, 0.0], &none);
        let gap = driven.row(&[1.0, 0.0], &Signal::constant(-self.wall));
        let end = *times.last()?;
        let flows: [Flow; 2] = [[velocity, pull.clone()], [still.clone(), still]]
            .map(|rows: [RowDVector<f64>; 2]| Flow::new(driven.rates(&rows), end / 200.0));
        let (mut t, mut y) = (0.0, driven.start(&self.initial));
        let mut sizes = y.map(|x| x.abs().max(f64::MIN_POSITIVE));
        let mut columns = vec![Vec::new(); 2];
        let (mut next, mut steps) = (0, 0.0);
        for _ in 0..MOST_EVENTS {
            let touches = lexicographic_sign(&gap, &flows[0].m, &y, &sizes, ZERO) < 0.0
                || (gap.clone() * &y)[0] <= 1e-12 * (self.wall.abs() + sizes[0])
                    && y[1] == 0.0
                    && lexicographic_sign(&pull, &flows[1].m, &y, &sizes, ZERO) <= 0.0;
            // Either the gap would close at once, or the body rests at the stop and is pressed to it.
            if touches {
                y[0] = self.wall;
                y[1] = -self.restitution * y[1].min(0.0);
                let presses = lexicographic_sign(&pull, &flows[1].m, &y, &sizes, ZERO) <= 0.0;
                if y[1] <= REST * sizes[1] && presses {
                    y[1] = 0.0;
                }
            }
            let rests = touches && y[1] == 0.0;
            let flow = &flows[usize::from(rests)];
            let monitor = Monitor::new(if rests { -pull.clone() } else { gap.clone() }, &flow.m);
            if steps + (end - t) / flow.h > MOST_STEPS {
                return None;
            }
            loop {
                let after = flow.step(&y);
                let event = monitor.leaves(flow, &y, &after, &sizes, 1e-3).unwrap_or(f64::INFINITY);
                let reached = flow.h.min(event);
                while let Some(time) = times.get(next).filter(|time| **time <= t + reached) {
                    let at = flow.advance(&y, time - t);
                    columns.iter_mut().zip(at.iter()).for_each(|(column, x)| column.push(*x));
                    next += 1;
                }
                if next == times.len() {
                    return Some(Values { columns, accuracy: vec![1e-8 * sizes[0], 10.0 * REST * sizes[1]] });
                }
                t += reached;
                steps += 1.0;
                y = if event < f64::INFINITY { flow.advance(&y, event) } else { after };
                sizes.iter_mut().zip(y.iter()).for_each(|(size, x)| *size = size.max(x.abs()));
                if event < f64::INFINITY {
                    break;
                }
            }
        }
        None
    }
}
