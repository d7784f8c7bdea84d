//! Signals: functions of time that are a constant plus sine waves. They can be written as expressions in any units, and
//! a linear system driven by them is an autonomous linear system in more unknowns.

use super::random::Random;
use std::fmt::Write;

/// A sine wave, `amplitude sin(omega t + phase)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    pub amplitude: f64,
    pub omega: f64,
    pub phase: f64,
}

/// A function of time: a constant plus sine waves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Signal {
    pub constant: f64,
    pub waves: Vec<Wave>,
}

impl Signal {
    pub fn constant(constant: f64) -> Self {
        Self { constant, waves: Vec::new() }
    }

    /// Returns up to `most` waves and a constant, of magnitude up to `size`; the frequencies of several waves may lie
    /// far apart.
    pub fn random(random: &mut Random, size: f64, omega: f64, most: usize) -> Self {
        let waves = (0..random.whole(0, most))
            .map(|k| Wave {
                amplitude: size * random.uniform(0.2, 1.0),
                omega: omega * if k > 0 { random.scale(0.03, 30.0) } else { random.scale(0.5, 2.0) },
                phase: random.uniform(0.0, std::f64::consts::TAU),
            })
            .collect();
        Self { constant: size * random.uniform(-0.7, 0.7), waves }
    }

    pub fn at(&self, t: f64) -> f64 {
        let wave = |wave: &Wave| wave.amplitude * (wave.omega * t + wave.phase).sin();
        self.constant + self.waves.iter().map(wave).sum::<f64>()
    }

    /// Adds `factor` times another signal to this one.
    pub fn add(&mut self, factor: f64, other: &Self) {
        self.constant += factor * other.constant;
        for wave in &other.waves {
            let same = |own: &&mut Wave| own.omega == wave.omega && own.phase == wave.phase;
            match self.waves.iter_mut().find(same) {
                Some(own) => own.amplitude += factor * wave.amplitude,
                None => self.waves.push(Wave { amplitude: factor * wave.amplitude, ..*wave }),
            }
        }
    }

    /// Returns `factor` times the signal as an expression, with the time in units of `unit`.
    pub fn expression(&self, factor: f64, unit: f64) -> String {
        let mut text = format!("{:?}", factor * self.constant);
        for Wave { amplitude, omega, phase } in &self.waves {
            write!(text, " + ({:?})*sin({:?}*t + {phase:?})", factor * amplitude, omega * unit).expect("a string");
        }
        text
    }
}
