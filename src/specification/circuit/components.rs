//! The components of a circuit as they are written.

use crate::expression::Expression;
use serde::Deserialize;
use utoipa::ToSchema;

/// A component between two nodes. Its voltage is that of the first node above the second; its current runs through it
/// from the first to the second.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Component {
    /// `v = R i`.
    Resistor(Resistor),
    /// `i = C v'`.
    Capacitor(Capacitor),
    /// `v = L i'`.
    Inductor(Inductor),
    /// `v` is given.
    VoltageSource(VoltageSource),
    /// `i` is given.
    CurrentSource(CurrentSource),
    /// An ideal diode from anode to cathode: `0 <= i`, `v <= forward_volts`, and one of them an equality.
    Diode(Diode),
    /// An ideal diode that also conducts backwards, at `v = -breakdown_volts`.
    Zener(Zener),
    /// An ideal switch that time decides: `v = 0` where it is closed, `i = 0` where it is open and `|v| < withstand_volts`.
    Switch(Switch),
}

/// A resistor.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Resistor {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// The nodes it is between.
    pub nodes: (String, String),
    /// Its resistance, above 0.
    pub ohms: Expression,
}

/// A capacitor.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Capacitor {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// The nodes it is between.
    pub nodes: (String, String),
    /// Its capacitance, above 0.
    pub farads: Expression,
    /// Its voltage at the start. Default 0, or in a loop of capacitors and voltage sources what the others say.
    pub volts: Option<Expression>,
}

/// An inductor.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Inductor {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// The nodes it is between.
    pub nodes: (String, String),
    /// Its inductance, above 0.
    pub henries: Expression,
    /// Its current at the start. Default 0, or where inductors and current sources alone meet what the others say.
    pub amperes: Option<Expression>,
}

/// A voltage source.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct VoltageSource {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// Its positive and its negative node.
    pub nodes: (String, String),
    /// Its voltage, in `t`.
    pub volts: Expression,
}

/// A current source.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CurrentSource {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// The node that it takes the current from, and the one that it gives it to.
    pub nodes: (String, String),
    /// Its current, in `t`.
    pub amperes: Expression,
}

/// A diode.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Diode {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// Anode and cathode.
    pub nodes: (String, String),
    /// The voltage across it where it conducts, not negative. Default 0.
    pub forward_volts: Option<Expression>,
}

/// A zener diode.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Zener {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// Anode and cathode.
    pub nodes: (String, String),
    /// The voltage across it where it conducts forwards, not negative. Default 0.
    pub forward_volts: Option<Expression>,
    /// The voltage from cathode to anode where it conducts backwards, above 0.
    pub breakdown_volts: Expression,
}

/// A switch.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Switch {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// The nodes it is between.
    pub nodes: (String, String),
    /// Closed where this expression in `t` is not negative, as in `sin(2*pi*f*t)`.
    pub closed: Expression,
    /// What it holds while it is open, above 0: at this voltage an arc conducts, as where it breaks the current of an
    /// inductor.
    pub withstand_volts: Expression,
}

impl Component {
    /// Its key in the document.
    pub(super) fn key(&self) -> &'static str {
        match self {
            Self::Resistor(_) => "resistor",
            Self::Capacitor(_) => "capacitor",
            Self::Inductor(_) => "inductor",
            Self::VoltageSource(_) => "voltage_source",
            Self::CurrentSource(_) => "current_source",
            Self::Diode(_) => "diode",
            Self::Zener(_) => "zener",
            Self::Switch(_) => "switch",
        }
    }

    /// Its name.
    pub(super) fn name(&self) -> &str {
        match self {
            Self::Resistor(Resistor { name, .. })
            | Self::Capacitor(Capacitor { name, .. })
            | Self::Inductor(Inductor { name, .. })
            | Self::VoltageSource(VoltageSource { name, .. })
            | Self::CurrentSource(CurrentSource { name, .. })
            | Self::Diode(Diode { name, .. })
            | Self::Zener(Zener { name, .. })
            | Self::Switch(Switch { name, .. }) => name,
        }
    }

    /// The nodes it is between.
    pub(super) fn nodes(&self) -> &(String, String) {
        match self {
            Self::Resistor(Resistor { nodes, .. })
            | Self::Capacitor(Capacitor { nodes, .. })
            | Self::Inductor(Inductor { nodes, .. })
            | Self::VoltageSource(VoltageSource { nodes, .. })
            | Self::CurrentSource(CurrentSource { nodes, .. })
            | Self::Diode(Diode { nodes, .. })
            | Self::Zener(Zener { nodes, .. })
            | Self::Switch(Switch { nodes, .. }) => nodes,
        }
    }
}
