//! Access to the numerical values of a circuit element by name.

use super::form::Coefficient;
use super::{Element, Law};
use rustc_hash::FxHashMap;

/// The name of a numerical value of a circuit element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// The resistance, capacitance or inductance of the element, in ohms, farads or henries.
    Size,
    /// The initial voltage of a capacitor or current of an inductor, in volts or amperes.
    Start,
    /// The forward voltage at which a diode conducts.
    Forward,
    /// The breakdown voltage at which a zener conducts backwards.
    Breakdown,
    /// The withstand voltage of an open switch.
    Withstand,
}

impl Element {
    /// Returns the value of a quantity, if the element has this quantity.
    pub fn quantity(&self, quantity: Quantity) -> Option<f64> {
        let mut law = self.law.clone();
        law.quantity_mut(quantity).map(|value| *value)
    }

    /// Sets the value of a quantity, if the element has this quantity.
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

/// A direction of differentiation in the space of element values, by `(index of the element, quantity)`; zero by
/// default.
#[derive(Clone, Debug, Default)]
pub struct Direction(pub FxHashMap<(usize, Quantity), f64>);

impl Direction {
    /// Returns a quantity of element `k` (zero if the element does not have it), with its derivative along the
    /// direction.
    pub(super) fn at(&self, elements: &[Element], k: usize, quantity: Quantity) -> Coefficient {
        let slope = if self.0.is_empty() { 0.0 } else { self.0.get(&(k, quantity)).copied().unwrap_or(0.0) };
        Coefficient { value: elements[k].quantity(quantity).unwrap_or(0.0), slope }
    }
}
