//! A random problem: how it is written in any units and from perturbed initial values, and the known properties of its
//! solution.

use super::random::Random;
use super::reference::Values;
use serde_json::Value;

/// The kinds of problems, each a row of the table.
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
    /// The unit of time, in the generator's unit.
    pub time: f64,
    /// The unit of the states, in the generator's unit: metres, or volts and amperes.
    pub size: f64,
    /// The perturbation of each initial value, in the generator's units; none if empty.
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

/// An output field that is compared between runs.
#[derive(Clone, Debug)]
pub struct Field {
    pub name: String,
    /// The powers of the units of size and of time in the unit of the field.
    pub size: i32,
    pub time: i32,
    /// Whether the field jumps at events, so that it is not compared close to them.
    pub jumps: bool,
}

impl Field {
    /// A field in the unit of size.
    pub fn sized(name: impl Into<String>) -> Self {
        Self { name: name.into(), size: 1, time: 0, jumps: false }
    }

    /// A variable of a problem with memory: after a switch it jumps, or has an infinite slope.
    pub fn switching(name: impl Into<String>) -> Self {
        Self { jumps: true, ..Self::sized(name) }
    }

    /// A velocity, which jumps at impacts.
    pub fn velocity(name: impl Into<String>) -> Self {
        Self { name: name.into(), size: 1, time: -1, jumps: true }
    }

    /// The unit of the field in a view, in the generator's units.
    pub fn unit(&self, view: &View) -> f64 {
        view.size.powi(self.size) * view.time.powi(self.time)
    }
}

/// The settings that control the accuracy of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Way {
    /// A tolerance and the number of stages.
    Stages,
    /// A tolerance alone.
    Tolerance,
    /// A tolerance on the mean over time.
    Mean,
    /// A step size.
    Step(f64),
}

/// A random problem.
pub trait Problem {
    /// The value of `problem` in a specification.
    fn document(&self, view: &View) -> Value;

    /// The fields that are compared: the states, or functions of them.
    fn fields(&self) -> Vec<Field>;

    /// The number of initial values that [`View::change`] perturbs, which belong to the first fields.
    fn starts(&self) -> usize {
        self.fields().len()
    }

    /// The end time, many times the shortest time scale.
    fn end(&self) -> f64;

    fn way(&self) -> Way;

    /// The scale of the smallest relevant state, from which the absolute tolerance is derived.
    fn smallest(&self) -> f64;

    /// Whether the theory guarantees unique states, whether or not `dvi` certifies it.
    fn is_unique(&self) -> bool;

    /// A theoretical bound on the growth of small perturbations, in the norm in which each field is divided by its
    /// size.
    fn most_growth(&self, _sizes: &[f64]) -> f64 {
        f64::INFINITY
    }

    /// Whether the initial values lie on a bound, so that perturbations must not be negative.
    fn starts_on_bound(&self) -> bool {
        false
    }

    /// The fields at `times` by an independent method, from perturbed initial values; `None` if there is none, or it
    /// gives up.
    fn reference(&self, _change: &[f64], _times: &[f64]) -> Option<Values> {
        None
    }
}

/// The problem of a kind with this seed.
pub fn generate(kind: Kind, seed: u64) -> Box<dyn Problem> {
    let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ kind as u64);
    super::generators::generate(kind, &mut random)
}
