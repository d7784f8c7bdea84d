//! Circuits with ideal diodes: detectors and clampers with long time constants, bridges and voltage multipliers in
//! which several diodes switch at the same time, coils with and without a freewheeling path, and ladders of random
//! components.

use super::growth_by_energy;
use super::network::{Network, Part};
use crate::differential::problem::{Field, Problem, View, Way};
use crate::differential::random::Random;
use crate::differential::reference::{Values, by_modes};
use crate::differential::signal::{Signal, Wave};
use serde_json::Value;
use std::f64::consts::TAU;

#[derive(Clone, Debug)]
pub struct Circuit {
    network: Network,
    end: f64,
    amplitude: f64,
}

/// Scales from which component values are drawn at random.
struct Scales {
    ohms: f64,
    period: f64,
    source: Signal,
}

impl Scales {
    fn resistor(&self, random: &mut Random, low: f64, high: f64) -> Part {
        Part::Resistor(self.ohms * random.scale(low, high))
    }

    /// Returns a capacitor whose time constant with the typical resistance is between `low` and `high` periods of the
    /// source.
    fn capacitor(&self, random: &mut Random, low: f64, high: f64, volts: f64) -> Part {
        Part::Capacitor(random.scale(low, high) * self.period / self.ohms, volts)
    }

    fn inductor(&self, random: &mut Random, low: f64, high: f64) -> Part {
        Part::Inductor(random.scale(low, high) * self.period * self.ohms, 0.0)
    }

    fn volts(&self) -> f64 {
        self.source.at(0.0)
    }
}

pub fn generate(random: &mut Random) -> Circuit {
    let amplitude = random.scale(0.1, 300.0);
    let period = random.scale(1e-5, 1.0);
    let scales = Scales { ohms: random.scale(10.0, 1e4), period, source: source(random, amplitude, period) };
    let network = match random.whole(0, 6) {
        0 => detector(random, &scales, amplitude),
        1 => clamper(random, &scales, amplitude),
        2 => bridge(random, &scales, amplitude),
        3 => multiplier(random, &scales, amplitude),
        4 => choke(random, &scales),
        5 => filter(random, &scales, amplitude),
        _ => ladder(random, &scales, amplitude),
    };
    Circuit { network, end: period * random.scale(4.0, 60.0), amplitude }
}

/// Returns a sine wave, possibly with another one of a very different frequency.
fn source(random: &mut Random, amplitude: f64, period: f64) -> Signal {
    let mut waves = vec![Wave { amplitude, omega: TAU / period, phase: random.uniform(0.0, TAU) }];
    if random.chance(0.4) {
        let ratio = if random.chance(0.5) { random.scale(0.02, 0.5) } else { random.scale(2.0, 30.0) };
        let amplitude = amplitude * random.scale(0.02, 1.0);
        waves.push(Wave { amplitude, omega: ratio * TAU / period, phase: random.uniform(0.0, TAU) });
    }
    Signal { constant: if random.chance(0.3) { amplitude * random.uniform(-0.5, 0.5) } else { 0.0 }, waves }
}

/// Adds a source to the network, with or without a series resistor, and returns the node that it feeds; the node with
/// the next number is unused.
fn fed(random: &mut Random, scales: &Scales, network: &mut Network) -> usize {
    network.add(Part::Voltage(scales.source.clone()), 1, 0);
    if random.chance(0.5) {
        return 1;
    }
    network.add(scales.resistor(random, 1e-4, 0.1), 1, 2);
    2
}

fn detector(random: &mut Random, scales: &Scales, amplitude: f64) -> Network {
    let mut network = Network::default();
    let from = fed(random, scales, &mut network);
    let held = from + 1;
    let volts = scales.volts() + amplitude * random.uniform(0.01, 0.5);
    network.add(Part::Diode, from, held);
    network.add(scales.capacitor(random, 0.3, 300.0, volts), held, 0);
    network.add(scales.resistor(random, 1.0, 100.0), held, 0);
    if random.chance(0.3) {
        // A second stage of the peak detector, which is fed by the first.
        network.add(Part::Diode, held, held + 1);
        network.add(scales.capacitor(random, 0.3, 300.0, volts + 0.01 * amplitude), held + 1, 0);
        network.add(scales.resistor(random, 1.0, 100.0), held + 1, 0);
    }
    network
}

fn clamper(random: &mut Random, scales: &Scales, amplitude: f64) -> Network {
    let mut network = Network::default();
    let from = fed(random, scales, &mut network);
    let clamped = from + 1;
    let volts = amplitude * random.uniform(0.01, 0.5);
    network.add(scales.capacitor(random, 0.3, 300.0, volts - scales.volts()), clamped, from);
    network.add(Part::Diode, 0, clamped);
    network.add(scales.resistor(random, 1.0, 1e3), clamped, 0);
    network
}

fn bridge(random: &mut Random, scales: &Scales, amplitude: f64) -> Network {
    let mut network = Network::default();
    // The source floats between nodes 1 and 2; the output voltage is that of node 3.
    network.add(Part::Voltage(scales.source.clone()), 1, 2);
    for (from, to) in [(1, 3), (2, 3), (0, 1), (0, 2)] {
        network.add(Part::Diode, from, to);
    }
    let volts = scales.volts().abs() + amplitude * random.uniform(0.01, 0.5);
    network.add(scales.capacitor(random, 0.3, 30.0, volts), 3, 0);
    network.add(scales.resistor(random, 0.3, 10.0), 3, 0);
    if random.chance(0.7) {
        let leak = scales.resistor(random, 1e2, 1e4);
        network.add(leak.clone(), 1, 0);
        network.add(leak, 2, 0);
    }
    network
}

/// A voltage multiplier of one or two stages (Cockcroft and Walton).
fn multiplier(random: &mut Random, scales: &Scales, amplitude: f64) -> Network {
    let mut network = Network::default();
    let from = fed(random, scales, &mut network);
    let stages = random.whole(1, 2);
    let (mut left, mut right) = (from, 0);
    let mut volts = (scales.volts(), 0.0);
    let mut next = from + 1;
    let mut level = 0.0;
    for _ in 0..stages {
        let (a, b) = (next, next + 1);
        next += 2;
        let at_a = level + amplitude * random.uniform(0.01, 0.2);
        let at_b = at_a + amplitude * random.uniform(0.01, 0.2);
        network.add(scales.capacitor(random, 0.3, 30.0, at_a - volts.0), a, left);
        network.add(Part::Diode, right, a);
        network.add(Part::Diode, a, b);
        network.add(scales.capacitor(random, 0.3, 30.0, at_b - volts.1), b, right);
        (left, right, volts, level) = (a, b, (at_a, at_b), at_b);
    }
    network.add(scales.resistor(random, 1.0, 100.0), right, 0);
    network
}

/// A rectifier that feeds a coil, with or without a freewheeling diode.
fn choke(random: &mut Random, scales: &Scales) -> Network {
    let mut network = Network::default();
    let from = fed(random, scales, &mut network);
    let node = from + 1;
    network.add(Part::Diode, from, node);
    if random.chance(0.6) {
        network.add(Part::Diode, 0, node);
    }
    network.add(scales.inductor(random, 0.03, 30.0), node, node + 1);
    network.add(scales.resistor(random, 0.1, 10.0), node + 1, 0);
    if random.chance(0.7) {
        network.add(scales.resistor(random, 1e2, 1e4), node, 0);
    }
    network
}

/// A rectifier behind a second-order low-pass filter.
fn filter(random: &mut Random, scales: &Scales, amplitude: f64) -> Network {
    let mut network = Network::default();
    network.add(Part::Voltage(scales.source.clone()), 1, 0);
    network.add(scales.resistor(random, 1e-3, 1.0), 1, 2);
    network.add(scales.inductor(random, 1e-3, 1.0), 2, 3);
    network.add(scales.capacitor(random, 1e-3, 1.0, 0.0), 3, 0);
    network.add(Part::Diode, 3, 4);
    let volts = amplitude * random.uniform(0.01, 0.5);
    network.add(scales.capacitor(random, 0.3, 100.0, volts), 4, 0);
    network.add(scales.resistor(random, 1.0, 100.0), 4, 0);
    network
}

fn ladder(random: &mut Random, scales: &Scales, amplitude: f64) -> Network {
    let mut network = Network::default();
    network.add(Part::Voltage(scales.source.clone()), 1, 0);
    let (mut volts, mut diodes) = (scales.volts(), 0);
    let last = random.whole(3, 5);
    for node in 2..=last {
        let step = random.sign() * random.uniform(0.01, 0.3);
        let here = volts + amplitude * step;
        let is_diode = random.chance(0.6) && diodes < 3;
        match is_diode {
            true => {
                let (from, to) = if here > volts { (node - 1, node) } else { (node, node - 1) };
                network.add(Part::Diode, from, to);
                diodes += 1;
            }
            false => network.add(scales.resistor(random, 0.01, 10.0), node - 1, node),
        }
        network.add(scales.capacitor(random, 0.01, 30.0, here), node, 0);
        network.add(scales.resistor(random, 0.3, 300.0), node, 0);
        volts = here;
    }
    if diodes == 0 {
        let (from, to) = if volts > 0.0 { (0, last) } else { (last, 0) };
        network.add(Part::Diode, from, to);
    }
    network
}

impl Problem for Circuit {
    fn document(&self, view: &View) -> Value {
        self.network.document(view)
    }

    fn fields(&self) -> Vec<Field> {
        self.network.states().into_iter().map(Field::sized).collect()
    }

    fn end(&self) -> f64 {
        self.end
    }

    fn way(&self) -> Way {
        Way::Stages
    }

    /// The smallest relevant magnitude of the states: that of voltages or, if there are coils, of their currents, which
    /// is a voltage divided by a resistance.
    fn smallest(&self) -> f64 {
        let coil = self.network.parts.iter().any(|(part, _, _)| matches!(part, Part::Inductor(..)));
        self.amplitude * if coil { 1e-4 } else { 1e-2 }
    }

    /// States are unique since the networks are passive: the stored energy of the difference of two solutions does
    /// not grow.
    fn is_unique(&self) -> bool {
        true
    }

    fn most_growth(&self, sizes: &[f64]) -> f64 {
        growth_by_energy(&self.network.energy(), sizes)
    }

    fn reference(&self, change: &[f64], times: &[f64]) -> Option<Values> {
        let (system, leaks) = self.network.system().map(|system| (system, 0.0)).or_else(|| self.network.leaking())?;
        let start: Vec<f64> =
            system.initial.iter().enumerate().map(|(i, x)| x + change.get(i).copied().unwrap_or(0.0)).collect();
        let mut values = by_modes(&system, &start, times)?;
        values.accuracy.iter_mut().for_each(|accuracy| *accuracy += leaks * self.amplitude);
        Some(values)
    }
}
