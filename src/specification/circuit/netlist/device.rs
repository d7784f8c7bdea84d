//! Models of devices: `.model NAME D(..)`, `SW(..)` and `CSW(..)`. Diodes and switches are ideal: of what a model says, their
//! voltages and resistances are taken, and what it says of their exponential and of charges is told to be left out.

use super::NetlistError;
use super::arithmetic::Scope;
use super::tokens::Token;
use super::value_in;
use std::collections::HashMap;

/// A kind of device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Diode,
    /// Closed by a voltage.
    Switch,
    /// Closed by a current.
    CurrentSwitch,
}

/// What a model says, by keys in small letters.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub kind: Kind,
    values: HashMap<String, f64>,
}

/// What is read of a diode, in all spellings.
const OF_DIODES: [&str; 8] = ["vf", "vfwd", "bv", "vrev", "vb", "rs", "ron", "roff"];

impl Model {
    /// Reads the words of `.model` behind its name; keys without numbers, such as a maker, say nothing.
    pub fn read(first: Token<'_>, words: &[Token<'_>], scope: &Scope) -> Result<Self, NetlistError> {
        const KINDS: &str = "a kind of model: D, SW or CSW";
        let Some((kind, words)) = words.split_first() else {
            let detail = format!("`{}` has no kind", first.shown());
            return Err(NetlistError::new(first, "incomplete_component", detail, KINDS));
        };
        let known = match kind.text.to_ascii_lowercase().as_str() {
            "d" => Kind::Diode,
            "sw" | "vswitch" => Kind::Switch,
            "csw" | "iswitch" => Kind::CurrentSwitch,
            _ => {
                let detail = format!("models of `{}` are not known here", kind.shown());
                return Err(NetlistError::new(*kind, "unknown_component", detail, KINDS));
            }
        };
        let mut values = HashMap::new();
        for window in words.windows(3) {
            if window[1].text == "="
                && let Ok(value) = value_in(window[2], scope)
            {
                values.insert(window[0].text.to_lowercase(), value);
            }
        }
        Ok(Self { kind: known, values })
    }

    /// The value of the first of these keys that it has.
    pub fn value(&self, keys: &[&str]) -> Option<f64> {
        keys.iter().find_map(|key| self.values.get(*key)).copied()
    }

    /// The keys of a diode that an ideal one has no use for, in order.
    pub fn left_out(&self) -> Vec<&str> {
        let mut keys: Vec<&str> =
            self.values.keys().map(String::as_str).filter(|key| !OF_DIODES.contains(key)).collect();
        keys.sort_unstable();
        keys
    }
}
