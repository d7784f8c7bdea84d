//! The numbers of elements, by name.

use super::form::Coefficient;
use super::{Element, Law};
use rustc_hash::FxHashMap;

/// What a number of an element is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// Its ohms, farads or henries.
    Size,
    /// Its volts or amperes at the start.
    Start,
    /// The voltage at which it conducts.
    Forward,
    /// That at which it conducts backwards.
    Breakdown,
    /// That which it holds while it is open.
    Withstand,
}

impl Element {
    /// A number of its, where it has one.
    pub fn quantity(&self, quantity: Quantity) -> Option<f64> {
        let mut law = self.law.clone();
        law.quantity_mut(quantity).map(|value| *value)
    }

    /// Sets a number that it has.
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

/// A direction in which the numbers of elements are differentiated; none by default.
#[derive(Clone, Debug, Default)]
pub struct Direction(pub FxHashMap<(usize, Quantity), f64>);

impl Direction {
    /// A number of element `k`, zero where it has none, with its derivative.
    pub(super) fn at(&self, elements: &[Element], k: usize, quantity: Quantity) -> Coefficient {
        let slope = if self.0.is_empty() { 0.0 } else { self.0.get(&(k, quantity)).copied().unwrap_or(0.0) };
        Coefficient { value: elements[k].quantity(quantity).unwrap_or(0.0), slope }
    }
}
