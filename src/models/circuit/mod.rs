//! Electrical circuits as linear complementarity systems of the least size.
//!
//! State variables are the capacitor voltages of a normal tree and the inductor currents of its links (Bryant 1959, The
//! order of complexity of electrical networks; Kuh and Rohrer 1965, The state-variable approach to network analysis).
//! What the equations of modified nodal analysis hold beside them - node voltages, resistor and source currents - is
//! eliminated, and given back as outputs. Each ideal diode (Acary, Bonnefon and Brogliato 2011, *Nonsmooth Modeling and
//! Simulation for Switched Circuits*) is a port of what is left: of the tree, it is given its voltage and answers with
//! its current, of the links the other way round. Either way `z G` is a power, so that a passive circuit has `D`
//! positive semidefinite.
//!
//! The voltage `v` across an element between nodes `(a, b)` is `v_a - v_b`, and its current `i` runs through it from
//! `a` to `b`.

mod columns;
mod dependent;
mod equations;
mod faults;
mod form;
mod parameters;
mod quantity;
mod solve;
mod system;
#[cfg(test)]
mod tests;
mod tree;

pub use columns::{Column, Columns, Port};
pub use dependent::{Dependent, DependentLaw};
pub use equations::Equations;
pub use faults::Fault;
pub use form::{Coefficient, Form};
pub use parameters::{CircuitParameters, Refused, Terms};
pub use quantity::{Direction, Quantity};
pub use system::System;
pub use tree::NormalTree;

use expression::Node;

/// What an element does.
#[derive(Clone, Debug)]
pub enum Law {
    /// `v = R i`, with `R > 0` in ohms.
    Resistor(f64),
    /// `i = C v'`, with `C > 0` in farads; the volts at the start, where they are given.
    Capacitor(f64, Option<f64>),
    /// `v = L i'`, with `L > 0` in henries; the amperes at the start, where they are given.
    Inductor(f64, Option<f64>),
    /// `v = E(t)`.
    VoltageSource(Node),
    /// `i = J(t)`.
    CurrentSource(Node),
    /// `0 <= i`, `0 <= forward - v`, and one of them zero.
    Diode {
        /// The voltage at which it conducts, not negative.
        forward: f64,
    },
    /// As a diode, and it conducts backwards at `v = -breakdown`.
    Zener {
        /// The voltage at which it conducts forwards, not negative.
        forward: f64,
        /// That at which it conducts backwards, positive.
        breakdown: f64,
    },
    /// `v = 0` where it is closed. Where it is open `i = 0`, but for an arc which keeps `|v| <= withstand`.
    Switch {
        /// Closed where this is not negative, in `t` alone.
        closed: Node,
        /// Volts, positive.
        withstand: f64,
    },
    /// `v` is a variable, with a law of its own that may take all voltages and currents.
    DependentVoltage,
    /// `i` is such a variable.
    DependentCurrent,
    /// A switch that voltages and currents decide, whose `v` is a variable: `v = 0` where it is closed, `i = 0` where it is open.
    DependentSwitch,
}

/// An element between two nodes; node 0 is ground.
#[derive(Clone, Debug)]
pub struct Element {
    /// Where it begins and ends.
    pub nodes: (usize, usize),
    /// What it does.
    pub law: Law,
}

impl Law {
    /// The order in which elements are taken into the tree. Where capacitors close a loop, or inductors are a cut set, the
    /// states are those whose start is given.
    fn rank(&self) -> u8 {
        match self {
            Self::VoltageSource(_) | Self::DependentVoltage => 0,
            Self::Capacitor(_, Some(_)) => 1,
            Self::Capacitor(_, None) => 2,
            Self::Switch { .. } | Self::DependentSwitch => 3,
            Self::Zener { .. } => 4,
            Self::Diode { .. } => 5,
            Self::Resistor(_) => 6,
            Self::Inductor(_, None) => 7,
            Self::Inductor(_, Some(_)) => 8,
            Self::CurrentSource(_) | Self::DependentCurrent => 9,
        }
    }
}
