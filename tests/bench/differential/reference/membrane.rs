//! Reference for a membrane on an interval between two flat obstacles: `u_t = a u_xx - c u + f(t, x)`, by linear
//! elements with lumped masses, implicit Euler and projected Gauss-Seidel sweeps. Runs with three step sizes estimate
//! the error of the finest; the result is their extrapolation.

use super::Values;
use crate::differential::signal::Signal;

/// A membrane over the interval `[0, 1]`.
#[derive(Clone, Debug)]
pub struct Membrane {
    pub elements: usize,
    pub diffusion: f64,
    pub reaction: f64,
    /// Factor `source(t)` of the source term `f = source(t) (1 + bulge cos(pi x))`.
    pub source: Signal,
    pub bulge: f64,
    pub bounds: (f64, f64),
    /// Amplitude of the initial shape `u = initial sin(pi x)`.
    pub initial: f64,
    /// Whether the membrane is fixed at zero on the left and on the right; otherwise there is no flux.
    pub held: [bool; 2],
}

const COARSE: usize = 4_000;
const SWEEPS: usize = 2_000;
/// Factor by which the number of steps between two outputs may fall below the number for evenly spaced outputs.
const LEAST: f64 = 8.0;

impl Membrane {
    /// Returns the values of the membrane at the points `probes` and its integral over the interval, at `times`.
    pub fn solve(&self, probes: &[f64], times: &[f64]) -> Option<Values> {
        let coarse = self.run(probes, times, COARSE)?;
        let fine = self.run(probes, times, 2 * COARSE)?;
        let mut finest = self.run(probes, times, 4 * COARSE)?;
        let mut accuracy = Vec::new();
        for ((coarse, fine), finest) in coarse.iter().zip(&fine).zip(&mut finest) {
            let far = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let (first, second) = (far(coarse, fine), far(fine, finest));
            if second > 0.75 * first && second > 1e-9 {
                return None;
            }
            // The difference of the two finer runs bounds the error; the extrapolation is more accurate if the error is
            // smooth in the step size.
            accuracy.push(2.0 * second);
            finest.iter_mut().zip(fine).for_each(|(x, before)| *x += *x - before);
        }
        Some(Values { columns: finest, accuracy })
    }

    fn run(&self, probes: &[f64], times: &[f64], steps: usize) -> Option<Vec<Vec<f64>>> {
        let n = self.elements;
        let dx = 1.0 / n as f64;
        let x = |i: usize| i as f64 * dx;
        let mut u: Vec<f64> = (0..=n).map(|i| self.initial * (std::f64::consts::PI * x(i)).sin()).collect();
        let mass: Vec<f64> = (0..=n).map(|i| if i == 0 || i == n { dx / 2.0 } else { dx }).collect();
        // The mesh and the quadrature of the source belong to the problem, so that the source is evaluated at element
        // centres.
        let mut load = vec![0.0; n + 1];
        for i in 0..n {
            let half = 0.5 * dx * (1.0 + self.bulge * (std::f64::consts::PI * (i as f64 + 0.5) * dx).cos());
            load[i] += half;
            load[i + 1] += half;
        }
        let mut columns = vec![Vec::with_capacity(times.len()); probes.len() + 1];
        // The number of steps of each output interval is a multiple of the refinement, so that the runs have
        // different steps in every interval.
        let (h, refinement) = (times.last()? / COARSE as f64, (steps / COARSE) as f64);
        let least = COARSE as f64 / (LEAST * times.len() as f64);
        let (mut t, mut before) = (0.0, 0.0);
        for &time in times {
            let parts = refinement * ((time - before) / h).max(least).ceil();
            for _ in 0..parts as usize {
                let h = (time - before) / parts;
                t += h;
                self.step(&mut u, &mass, &load, (t, h, dx))?;
            }
            (t, before) = (time, time);
            for (column, probe) in columns.iter_mut().zip(probes) {
                let i = ((probe / dx).floor() as usize).min(n - 1);
                let part = probe / dx - i as f64;
                column.push((1.0 - part) * u[i] + part * u[i + 1]);
            }
            columns[probes.len()].push(u.iter().zip(&mass).map(|(u, mass)| u * mass).sum());
        }
        Some(columns)
    }

    fn step(&self, u: &mut [f64], mass: &[f64], load: &[f64], (t, h, dx): (f64, f64, f64)) -> Option<()> {
        let (n, pull) = (u.len() - 1, h * self.diffusion / dx);
        let source = self.source.at(t);
        let right: Vec<f64> = (0..=n).map(|i| mass[i] * u[i] + h * source * load[i]).collect();
        for _ in 0..SWEEPS {
            let mut change = 0.0_f64;
            for i in 0..=n {
                if i == 0 && self.held[0] || i == n && self.held[1] {
                    u[i] = 0.0;
                    continue;
                }
                let (mut sum, mut own) = (right[i], mass[i] * (1.0 + h * self.reaction));
                for neighbour in [i.checked_sub(1), (i < n).then_some(i + 1)].into_iter().flatten() {
                    sum += pull * u[neighbour];
                    own += pull;
                }
                let next = (sum / own).clamp(self.bounds.0, self.bounds.1);
                change = change.max((next - u[i]).abs());
                u[i] = next;
            }
            if change < 1e-13 {
                return Some(());
            }
        }
        None
    }
}
