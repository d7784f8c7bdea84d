//! What the forms of a circuit are sums over: `q = (x, z, 1, e, e')`.
//!
//! Where nothing stores energy, voltages and currents follow the sources alone. The states are then the integrals of the
//! sources, on which nothing depends: the steps that they need are those that see the sources.

use super::{Element, Law, NormalTree};

/// A variable, with the element that it belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Port {
    /// `z = forward - v >= 0`, `G = i`: a diode in the tree.
    Blocking(usize),
    /// `z = i >= 0`, `G = forward - v`: a diode that is a link, or the like part of a zener.
    Conducting(usize),
    /// `z = -i >= 0`, `G = breakdown + v`: the other part of a zener that is a link.
    BreakingDown(usize),
    /// `z = v` between bounds, `G = -i`: a zener or a switch in the tree.
    Voltage(usize),
    /// `z` is the voltage or current of a dependent source, `G` a law of its own.
    Source(usize),
}

impl Port {
    /// The element.
    pub fn element(self) -> usize {
        match self {
            Self::Blocking(k) | Self::Conducting(k) | Self::BreakingDown(k) | Self::Voltage(k) | Self::Source(k) => k,
        }
    }
}

/// The columns in their order.
#[derive(Clone, Debug)]
pub struct Columns {
    /// The capacitors of the tree and the inductors that are links: their voltage or current is a state.
    pub states: Vec<usize>,
    /// The sources whose integral is a state, where there is no other.
    pub integrals: Vec<usize>,
    /// The variables.
    pub ports: Vec<Port>,
    elements: usize,
}

/// A column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Column {
    /// A state or a variable, by its place in `(x, z)`.
    Unknown(usize),
    /// 1.
    One,
    /// The value of the source at that element.
    Source(usize),
    /// Its derivative by time.
    Derivative(usize),
}

impl Columns {
    /// The states and variables that the tree makes of the elements.
    pub fn new(elements: &[Element], tree: &NormalTree) -> Self {
        let (mut states, mut ports) = (Vec::new(), Vec::new());
        for (k, element) in elements.iter().enumerate() {
            match (&element.law, tree.contains[k]) {
                (Law::Capacitor(..), true) | (Law::Inductor(..), false) => states.push(k),
                (Law::Diode { .. }, true) => ports.push(Port::Blocking(k)),
                (Law::Diode { .. }, false) => ports.push(Port::Conducting(k)),
                (Law::Zener { .. }, false) => ports.extend([Port::Conducting(k), Port::BreakingDown(k)]),
                (Law::Zener { .. } | Law::Switch { .. } | Law::DependentSwitch, _) => ports.push(Port::Voltage(k)),
                (Law::DependentVoltage | Law::DependentCurrent, _) => ports.push(Port::Source(k)),
                _ => {}
            }
        }
        let is_source = |element: &Element| {
            matches!(
                element.law,
                Law::VoltageSource(_) | Law::CurrentSource(_) | Law::DependentVoltage | Law::DependentCurrent
            )
        };
        let sources = || (0..elements.len()).filter(|&k| is_source(&elements[k])).collect();
        let integrals = if states.is_empty() { sources() } else { Vec::new() };
        Self { states, integrals, ports, elements: elements.len() }
    }

    /// What stands in a column.
    pub fn at(&self, column: usize) -> Column {
        let Some(source) = column.checked_sub(self.one()) else { return Column::Unknown(column) };
        match source.checked_sub(1) {
            None => Column::One,
            Some(k) if k < self.elements => Column::Source(k),
            Some(k) => Column::Derivative(k - self.elements),
        }
    }

    pub(super) fn variable(&self, z: usize) -> usize {
        self.states.len() + self.integrals.len() + z
    }

    pub(super) fn one(&self) -> usize {
        self.variable(self.ports.len())
    }

    pub(super) fn source(&self, k: usize) -> usize {
        self.one() + 1 + k
    }

    pub(super) fn derivative(&self, k: usize) -> usize {
        self.source(k) + self.elements
    }
}
