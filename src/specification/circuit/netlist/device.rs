//! Device models: `.model NAME D(..)`, `SW(..)` and `CSW(..)`. Diodes and switches are ideal: a model supplies their
//! voltages and resistances. The exponential characteristic and the charges of a model are ignored, with a warning.

use super::NetlistError;
use super::arithmetic::Scope;
use super::tokens::Token;
use super::value_in;
use std::collections::HashMap;

/// A kind of device model in a netlist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Diode,
    /// A model of switches that are controlled by a voltage.
    Switch,
    /// A model of switches that are controlled by a current.
    CurrentSwitch,
}

/// A device model: its kind, and its numerical values by keys in lower case.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub kind: Kind,
    values: HashMap<String, f64>,
}

/// The keys of a diode model that an ideal diode uses, in all spellings.
const OF_DIODES: [&str; 8] = ["vf", "vfwd", "bv", "vrev", "vb", "rs", "ron", "roff"];

impl Model {
    /// Reads the words of `.model` after its name; keys without a numerical value, such as a manufacturer, are ignored.
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

    /// Returns the value of the first of the given keys that the device model has.
    pub fn value(&self, keys: &[&str]) -> Option<f64> {
        keys.iter().find_map(|key| self.values.get(*key)).copied()
    }

    /// Returns the sorted keys of a diode model that an ideal diode ignores.
    pub fn left_out(&self) -> Vec<&str> {
        let mut keys: Vec<&str> =
            self.values.keys().map(String::as_str).filter(|key| !OF_DIODES.contains(key)).collect();
        keys.sort_unstable();
        keys
    }
}
