//! The columns `q = (x, z, 1, e, e')` of the linear forms of a circuit: states `x`, variables `z`, the constant 1,
//! source values `e` and their time derivatives `e'`.
//!
//! If no element stores energy, voltages and currents are functions of the sources alone. The integrals of the sources
//! are then added as states. The equations do not depend on them, but the error control of the integrals makes the step
//! size resolve the sources.

use super::{Element, Law, NormalTree};

/// A variable `z` of the circuit (a port of the reduced circuit), with the index of its circuit element; `v` and `i`
/// are the voltage and the current of the element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Port {
    /// A diode in the normal tree: `z = forward - v >= 0`, `G = i`.
    Blocking(usize),
    /// A diode that is a link (outside the normal tree), or the forward direction of a zener diode that is a link: `z
    /// = i >= 0`, `G = forward - v`.
    Conducting(usize),
    /// The breakdown direction of a zener diode that is a link (outside the normal tree): `z = -i >= 0`, `G =
    /// breakdown + v`.
    BreakingDown(usize),
    /// A zener diode in the normal tree, or a switch: `z = v` in an interval, `G = -i`.
    Voltage(usize),
    /// A dependent source: `z` is its voltage or current, and `G` is given by its [`Dependent`](super::Dependent)
    /// law.
    Source(usize),
}

impl Port {
    /// Returns the index of the circuit element of the port.
    pub fn element(self) -> usize {
        match self {
            Self::Blocking(k) | Self::Conducting(k) | Self::BreakingDown(k) | Self::Voltage(k) | Self::Source(k) => k,
        }
    }
}

/// The columns of the linear forms of a circuit, in order: states, variables, the constant 1, sources and their
/// derivatives.
#[derive(Clone, Debug)]
pub struct Columns {
    /// The elements of the circuit whose voltage or current is a state: capacitors in the normal tree, and inductors
    /// outside it.
    pub states: Vec<usize>,
    /// The sources whose time integral is a state, so that there is a state if no element stores energy.
    pub integrals: Vec<usize>,
    /// The ports of the reduced circuit, whose variables `z` are columns of the linear forms.
    pub ports: Vec<Port>,
    elements: usize,
}

/// The meaning of one column of the linear forms of a circuit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Column {
    /// A state or a variable of the circuit, by its index in `(x, z)`.
    Unknown(usize),
    /// The constant 1, by which constant terms of a linear form are multiplied.
    One,
    /// The value of the independent source whose element has this index.
    Source(usize),
    /// The time derivative of the independent source whose element has this index.
    Derivative(usize),
}

impl Columns {
    /// Chooses the states and variables of a circuit according to its normal tree.
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

    /// Returns the meaning of a column of the linear forms, given by the number of the column.
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
