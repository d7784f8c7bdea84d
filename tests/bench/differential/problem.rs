//! A random problem: what it is called, how it is written in any units and from a slightly changed start, and what is known
//! of its solution.

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

/// How a problem is to be written.
#[derive(Clone, Debug)]
pub struct View {
    /// The unit of time, in that of the generator.
    pub time: f64,
    /// The unit of the states' size, in that of the generator: metres, or volts and amperes.
    pub size: f64,
    /// What is added to each state at the start, in the generator's units; nothing if empty.
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

/// An output that is compared between runs.
#[derive(Clone, Debug)]
pub struct Field {
    pub name: String,
    /// The powers of the units of size and time in its own unit.
    pub size: i32,
    pub time: i32,
    /// Whether events make it jump, so that it is not compared close to them.
    pub jumps: bool,
}

impl Field {
    /// One in the unit of size.
    pub fn sized(name: impl Into<String>) -> Self {
        Self { name: name.into(), size: 1, time: 0, jumps: false }
    }

    /// A variable with memory: behind a switch it jumps, or has an infinite slope.
    pub fn switching(name: impl Into<String>) -> Self {
        Self { jumps: true, ..Self::sized(name) }
    }

    /// A velocity, which jumps where there are impacts.
    pub fn velocity(name: impl Into<String>) -> Self {
        Self { name: name.into(), size: 1, time: -1, jumps: true }
    }

    /// Its unit in a view, in that of the generator.
    pub fn unit(&self, view: &View) -> f64 {
        view.size.powi(self.size) * view.time.powi(self.time)
    }
}

/// What a method can be asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Way {
    /// A tolerance and stages.
    Stages,
    /// A tolerance alone.
    Tolerance,
    /// A tolerance of the mean over time.
    Mean,
    /// A step.
    Step(f64),
}

/// A random problem.
pub trait Problem {
    /// The value of `problem` in a specification.
    fn document(&self, view: &View) -> Value;

    /// What is compared: the states, or what there is to see of them.
    fn fields(&self) -> Vec<Field>;

    /// The number of changes of the start that [`View::change`] takes, which belong to the first of the fields.
    fn starts(&self) -> usize {
        self.fields().len()
    }

    /// The end, long against the shortest time scale.
    fn end(&self) -> f64;

    fn way(&self) -> Way;

    /// The size of the smallest state that matters, of which the absolute tolerance is a part.
    fn smallest(&self) -> f64;

    /// Whether theory says that the states are unique, whether or not `dvi` certifies it.
    fn is_unique(&self) -> bool;

    /// A bound on the growth of small changes of the start, in the norm in which the size of each field is one, from theory.
    fn most_growth(&self, _sizes: &[f64]) -> f64 {
        f64::INFINITY
    }

    /// Whether the start lies on a bound, so that changes of it must not be negative.
    fn starts_on_bound(&self) -> bool {
        false
    }

    /// The fields at `times` by an independent method, from a changed start; `None` if there is none, or it gives up.
    fn reference(&self, _change: &[f64], _times: &[f64]) -> Option<Values> {
        None
    }
}

/// The problem of a kind with this seed.
pub fn generate(kind: Kind, seed: u64) -> Box<dyn Problem> {
    let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ kind as u64);
    super::generators::generate(kind, &mut random)
}
