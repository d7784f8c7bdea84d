//! Access to the numerical values of a circuit element (resistance, initial voltage, ..) by name.

use super::form::Coefficient;
use super::{Element, Law};
use rustc_hash::FxHashMap;

/// The kind of a numerical value of a circuit element, by which the value is read and set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// The resistance, capacitance or inductance of the circuit element, in ohms, farads or henries.
    Size,
    /// The initial voltage of a capacitor or current of an inductor, in volts or amperes.
    Start,
    /// The forward voltage at which a diode conducts, in volts.
    Forward,
    /// The breakdown voltage at which a zener diode conducts backwards, in volts.
    Breakdown,
    /// The withstand voltage of an open switch, in volts.
    Withstand,
}

impl Element {
    /// Returns a numerical value of the circuit element, such as its resistance; `None` if the element does not have
    /// it.
    pub fn quantity(&self, quantity: Quantity) -> Option<f64> {
        let mut law = self.law.clone();
        law.quantity_mut(quantity).map(|value| *value)
    }

    /// Sets a numerical value of the circuit element, such as its resistance; has no effect if the element does not
    /// have it.
    pub fn set(&mut self, quantity: Quantity, value: f64) {
        if let Some(place) = self.law.quantity_mut(quantity) {
            *place = value;
        }
    }
}

impl Law {
    fn quantity_mut(&mut self, quantity: Quantity) -> Option<&mut f64> {
        match (quantity, self) {
            (Quantity::Size, Self::Resistor(size) | Self::Capacitor(size, _) | Self::Inductor(size, _)) => Some(size),
            (Quantity::Start, Self::Capacitor(_, start) | Self::Inductor(_, start)) => start.as_mut(),
            (Quantity::Forward, Self::Diode { forward } | Self::Zener { forward, .. }) => Some(forward),
            (Quantity::Breakdown, Self::Zener { breakdown, .. }) => Some(breakdown),
            (Quantity::Withstand, Self::Switch { withstand, .. }) => Some(withstand),
            _ => None,
        }
    }
}

/// A direction of differentiation in the space of element values of a circuit, by `(index of the element, quantity)`;
/// zero by default.
#[derive(Clone, Debug, Default)]
pub struct Direction(pub FxHashMap<(usize, Quantity), f64>);

impl Direction {
    /// Returns a numerical value of circuit element `k` (zero if the element does not have it), with its derivative
    /// along this direction in the space of element values.
    pub(super) fn at(&self, elements: &[Element], k: usize, quantity: Quantity) -> Coefficient {
        let slope = if self.0.is_empty() { 0.0 } else { self.0.get(&(k, quantity)).copied().unwrap_or(0.0) };
        Coefficient { value: elements[k].quantity(quantity).unwrap_or(0.0), slope }
    }
}
