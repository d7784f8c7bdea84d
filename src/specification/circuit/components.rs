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
    /// An ideal switch: `v = 0` where it is closed, `i = 0` where it is open.
    Switch(Switch),
    /// An ideal operational amplifier: `v(inputs) = 0`, or the output at a limit.
    OpAmp(OpAmp),
    /// An ideal comparator: the output is high or low, as its inputs say.
    Comparator(Comparator),
    /// An ideal transformer: `v_primary = ratio v_secondary`, `i_secondary = -ratio i_primary`.
    Transformer(Transformer),
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
    /// Its voltage, in `t`, or in voltages `v(node)`, `v(component)` and currents `i(component)` as well: a controlled source.
    pub volts: Expression,
    /// The least and the largest voltage: beyond them it stays there.
    pub limits: Option<(Expression, Expression)>,
}

/// A current source.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CurrentSource {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// The node that it takes the current from, and the one that it gives it to.
    pub nodes: (String, String),
    /// Its current, in `t`, or in voltages `v(node)`, `v(component)` and currents `i(component)` as well: a controlled source.
    pub amperes: Expression,
    /// The least and the largest current: beyond them it stays there.
    pub limits: Option<(Expression, Expression)>,
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
    /// Closed where this expression is not negative: in `t`, as in `sin(2*pi*f*t)`, or in voltages `v(node)`, `v(component)` and
    /// currents `i(component)` as well, as in `v(control) - sawtooth(t, period)`.
    pub closed: Expression,
    /// What it holds while it is open, above 0: at this voltage an arc conducts, as where it breaks the current of an
    /// inductor. Of a switch that `t` alone decides, which must have it; others hold any voltage.
    pub withstand_volts: Option<Expression>,
    /// Of a switch that voltages and currents decide: it closes where `closed` rises to this, and opens where it falls to minus
    /// this. Not negative. Default 0.
    pub hysteresis: Option<Expression>,
    /// Whether it is closed before the start, where hysteresis leaves that open. Default false.
    #[serde(default)]
    pub initially: bool,
}

/// An operational amplifier.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct OpAmp {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// The inputs, `+` and `-`, which take no current.
    pub inputs: (String, String),
    /// The output, and the node that its voltage is above.
    pub nodes: (String, String),
    /// The least and the largest voltage of the output. Default none.
    pub limits: Option<(Expression, Expression)>,
}

/// A comparator.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Comparator {
    /// Its name, which no other component and no node has.
    pub name: String,
    /// The inputs, `+` and `-`, which take no current.
    pub inputs: (String, String),
    /// The output, and the node that its voltage is above.
    pub nodes: (String, String),
    /// The voltage of the output where the first input is below the second. Default 0.
    pub low: Option<Expression>,
    /// That where it is above, larger. Default 1.
    pub high: Option<Expression>,
    /// The output goes high where the first input rises this far above the second, in volts, and low where it falls this far
    /// below. Not negative. Default 0.
    pub hysteresis: Option<Expression>,
    /// Whether it is high before the start, where hysteresis leaves that open. Default false.
    #[serde(default)]
    pub initially: bool,
}

/// A transformer.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Transformer {
    /// Its name, which no other component and no node has. Its currents are `i(name.primary)` and `i(name.secondary)`.
    pub name: String,
    /// The nodes of the primary winding.
    pub primary: (String, String),
    /// The nodes of the secondary winding; the first ones have the dots.
    pub secondary: (String, String),
    /// The turns of the primary winding over those of the secondary; not 0.
    pub ratio: Expression,
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
            Self::OpAmp(_) => "op_amp",
            Self::Comparator(_) => "comparator",
            Self::Transformer(_) => "transformer",
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
            | Self::Switch(Switch { name, .. })
            | Self::OpAmp(OpAmp { name, .. })
            | Self::Comparator(Comparator { name, .. })
            | Self::Transformer(Transformer { name, .. }) => name,
        }
    }

    /// The pairs of nodes it is between, one an element.
    pub(super) fn nodes(&self) -> Vec<&(String, String)> {
        match self {
            Self::Resistor(Resistor { nodes, .. })
            | Self::Capacitor(Capacitor { nodes, .. })
            | Self::Inductor(Inductor { nodes, .. })
            | Self::VoltageSource(VoltageSource { nodes, .. })
            | Self::CurrentSource(CurrentSource { nodes, .. })
            | Self::Diode(Diode { nodes, .. })
            | Self::Zener(Zener { nodes, .. })
            | Self::Switch(Switch { nodes, .. })
            | Self::OpAmp(OpAmp { nodes, .. })
            | Self::Comparator(Comparator { nodes, .. }) => vec![nodes],
            Self::Transformer(Transformer { primary, secondary, .. }) => vec![primary, secondary],
        }
    }

    /// The nodes that it looks at without a current.
    pub(super) fn inputs(&self) -> Option<&(String, String)> {
        match self {
            Self::OpAmp(OpAmp { inputs, .. }) | Self::Comparator(Comparator { inputs, .. }) => Some(inputs),
            _ => None,
        }
    }
}
