//! Electrical circuits as linear complementarity systems of minimal size.
//!
//! State variables are the capacitor voltages of a normal tree and the inductor currents of its links (Bryant 1959, The
//! order of complexity of electrical networks; Kuh and Rohrer 1965, The state-variable approach to network analysis).
//! The other unknowns of modified nodal analysis (node voltages, resistor and source currents) are eliminated and
//! available as outputs. Each ideal diode (Acary, Bonnefon and Brogliato 2011, *Nonsmooth Modeling and Simulation for
//! Switched Circuits*) is a port of the reduced circuit: a diode in the tree has its voltage as variable `z` and its
//! current as `G`, a diode that is a link the other way round. In both cases `z G` is a power, so that a passive
//! circuit has a positive semidefinite matrix `D`.
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

/// The constitutive law of a circuit element, a relation between its voltage `v` and its current `i`.
#[derive(Clone, Debug)]
pub enum Law {
    /// A resistor: `v = R i`, with `R > 0` in ohms.
    Resistor(f64),
    /// A capacitor: `i = C v'`, with `C > 0` in farads; optionally the initial voltage in volts.
    Capacitor(f64, Option<f64>),
    /// An inductor: `v = L i'`, with `L > 0` in henries; optionally the initial current in amperes.
    Inductor(f64, Option<f64>),
    /// An independent voltage source: `v = E(t)`.
    VoltageSource(Node),
    /// An independent current source: `i = J(t)`.
    CurrentSource(Node),
    /// An ideal diode: `0 <= i perp forward - v >= 0`.
    Diode {
        /// The forward voltage at which the ideal diode conducts, in volts, nonnegative.
        forward: f64,
    },
    /// A zener diode: a diode that also conducts backwards, at `v = -breakdown`.
    Zener {
        /// The forward voltage at which the zener diode conducts, in volts, nonnegative.
        forward: f64,
        /// The breakdown voltage at which the zener diode conducts backwards, in volts, positive.
        breakdown: f64,
    },
    /// A switch controlled by time: `v = 0` if closed; if open, `i = 0` unless an arc keeps `|v| <= withstand`.
    Switch {
        /// A function of `t` alone: the switch is closed while the value of the function is nonnegative.
        closed: Node,
        /// The withstand voltage of the open switch in volts, positive.
        withstand: f64,
    },
    /// A voltage source whose voltage `v` is a variable, given by a [`Dependent`] law in any voltages and currents of
    /// the circuit.
    DependentVoltage,
    /// A current source whose current `i` is a variable, given by a [`Dependent`] law in any voltages and currents of
    /// the circuit.
    DependentCurrent,
    /// A switch controlled by voltages and currents, whose voltage `v` is a variable: `v = 0` if closed, `i = 0` if
    /// open.
    DependentSwitch,
}

/// A circuit element between two nodes; node 0 is ground.
#[derive(Clone, Debug)]
pub struct Element {
    /// The nodes `(a, b)` of the circuit element: its voltage is `v_a - v_b`, and its current runs from `a` to `b`.
    pub nodes: (usize, usize),
    /// The constitutive law of the circuit element.
    pub law: Law,
}

impl Law {
    /// Returns the priority of a circuit element for the normal tree, lowest rank first. In loops of capacitors and cut
    /// sets of inductors, elements with a given initial value become states first.
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
