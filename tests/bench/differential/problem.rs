//! The interface of a random problem: how it is written in any units and from perturbed initial values, and the known
//! properties of its solution.

use super::random::Random;
use super::reference::Values;
use serde_json::Value;

/// Kinds of random problems, each a row of the table of results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    Complementarity,
    Circuit,
    Filippov,
    Sets,
    Mechanical,
    TimeStepping,
    Bodies,
    Obstacle,
    Memory,
}

impl Kind {
    pub const ALL: [Self; 9] = [
        Self::Complementarity,
        Self::Circuit,
        Self::Filippov,
        Self::Sets,
        Self::Mechanical,
        Self::TimeStepping,
        Self::Bodies,
        Self::Obstacle,
        Self::Memory,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Complementarity => "complementarity",
            Self::Circuit => "circuit",
            Self::Filippov => "filippov",
            Self::Sets => "sets",
            Self::Mechanical => "mechanical",
            Self::TimeStepping => "time_stepping",
            Self::Bodies => "bodies",
            Self::Obstacle => "obstacle",
            Self::Memory => "memory",
        }
    }
}

/// The units and the initial values in which a problem is written.
#[derive(Clone, Debug)]
pub struct View {
    /// The unit of time, as a multiple of the generator's unit.
    pub time: f64,
    /// The unit of the states, as a multiple of the generator's unit: metres, or volts and amperes.
    pub size: f64,
    /// The perturbation of each initial value, in the generator's units; empty without perturbations.
    pub change: Vec<f64>,
}

impl Default for View {
    fn default() -> Self {
        Self { time: 1.0, size: 1.0, change: Vec::new() }
    }
}

impl View {
    pub fn change(&self, state: usize) -> f64 {
        self.change.get(state).copied().unwrap_or(0.0)
    }
}

/// An output field whose values are compared between runs.
#[derive(Clone, Debug)]
pub struct Field {
    pub name: String,
    /// The exponents of the unit of size and of the unit of time in the unit of the field.
    pub size: i32,
    pub time: i32,
    /// Whether the field jumps at events, so that it is not compared close to them.
    pub jumps: bool,
}

impl Field {
    /// Returns a field that has the unit of size.
    pub fn sized(name: impl Into<String>) -> Self {
        Self { name: name.into(), size: 1, time: 0, jumps: false }
    }

    /// Returns the field of a variable of a problem with memory: after a switch it jumps, or has an infinite slope.
    pub fn switching(name: impl Into<String>) -> Self {
        Self { jumps: true, ..Self::sized(name) }
    }

    /// Returns the field of a velocity, which jumps at impacts.
    pub fn velocity(name: impl Into<String>) -> Self {
        Self { name: name.into(), size: 1, time: -1, jumps: true }
    }

    /// Returns the unit of the field in the units of `view`, as a multiple of the generator's unit.
    pub fn unit(&self, view: &View) -> f64 {
        view.size.powi(self.size) * view.time.powi(self.time)
    }
}

/// The settings that control the accuracy of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Way {
    /// Accuracy set by a relative tolerance and the number of Radau IIA stages.
    Stages,
    /// Accuracy set by a relative tolerance alone.
    Tolerance,
    /// Accuracy set by a tolerance on the mean error over time, as for problems with memory.
    Mean,
    /// Accuracy set by a fixed step size, which is held.
    Step(f64),
}

/// A random problem and the known properties of its solution.
pub trait Problem {
    /// Returns the problem as the member `problem` of a specification.
    fn document(&self, view: &View) -> Value;

    /// Returns the fields that are compared: the states, or functions of them.
    fn fields(&self) -> Vec<Field>;

    /// Returns the number of initial values that [`View::change`] perturbs; they are those of the first fields.
    fn starts(&self) -> usize {
        self.fields().len()
    }

    /// Returns the end time of the run, many times the shortest time scale of the problem.
    fn end(&self) -> f64;

    fn way(&self) -> Way;

    /// Returns the scale of the smallest relevant state, from which the absolute tolerance is derived.
    fn smallest(&self) -> f64;

    /// Whether the theory guarantees unique states, even if `dvi` does not certify it.
    fn is_unique(&self) -> bool;

    /// Returns a theoretical bound on the growth of small perturbations, in the norm in which each field is divided
    /// by its size.
    fn most_growth(&self, _sizes: &[f64]) -> f64 {
        f64::INFINITY
    }

    /// Whether the initial values lie on a bound, so that perturbations must not be negative.
    fn starts_on_bound(&self) -> bool {
        false
    }

    /// Returns the fields at `times` by an independent method, from perturbed initial values; `None` if there is no
    /// such method, or it fails.
    fn reference(&self, _change: &[f64], _times: &[f64]) -> Option<Values> {
        None
    }
}

/// Returns the random problem of the given kind that belongs to a seed.
pub fn generate(kind: Kind, seed: u64) -> Box<dyn Problem> {
    let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ kind as u64);
    super::generators::generate(kind, &mut random)
}
