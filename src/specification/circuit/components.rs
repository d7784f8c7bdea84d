//! The components of a circuit as the user writes them.

use crate::expression::Expression;
use serde::Deserialize;
use utoipa::ToSchema;

/// A component between two nodes. Its voltage is the potential of the first node minus that of the second; its current
/// is positive from the first node through the component to the second.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Component {
    /// A resistor: voltage `v = R i`, with the current `i`.
    Resistor(Resistor),
    /// A capacitor: current `i = C v'`, with the voltage `v`.
    Capacitor(Capacitor),
    /// An inductor: voltage `v = L i'`, with the current `i`.
    Inductor(Inductor),
    /// A source with prescribed voltage `v`.
    VoltageSource(VoltageSource),
    /// A source with prescribed current `i`.
    CurrentSource(CurrentSource),
    /// An ideal diode from anode to cathode: `i >= 0`, `v <= forward_volts`, and at least one holds with equality.
    Diode(Diode),
    /// An ideal diode that also conducts in reverse, at `v = -breakdown_volts`.
    Zener(Zener),
    /// An ideal switch: voltage `v = 0` while it is closed, current `i = 0` while it is open.
    Switch(Switch),
    /// An ideal operational amplifier: zero voltage between the inputs, or the output at a limit.
    OpAmp(OpAmp),
    /// An ideal comparator: the output is high or low, by the sign of the voltage between the inputs.
    Comparator(Comparator),
    /// An ideal transformer: `v_primary = ratio v_secondary`, `i_secondary = -ratio i_primary`.
    Transformer(Transformer),
}

/// A resistor between two nodes.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Resistor {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// The two nodes that the component connects.
    pub nodes: (String, String),
    /// Resistance in ohms, above 0.
    pub ohms: Expression,
}

/// A capacitor between two nodes.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Capacitor {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// The two nodes that the component connects.
    pub nodes: (String, String),
    /// Capacitance in farads, above 0.
    pub farads: Expression,
    /// Initial voltage. Default 0; in a loop of capacitors and voltage sources, the voltage that the rest of the loop
    /// implies.
    pub volts: Option<Expression>,
}

/// An inductor between two nodes.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Inductor {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// The two nodes that the component connects.
    pub nodes: (String, String),
    /// Inductance in henries, above 0.
    pub henries: Expression,
    /// Initial current. Default 0; in a cut set of inductors and current sources, the current that the rest of the
    /// set implies.
    pub amperes: Option<Expression>,
}

/// A voltage source, prescribed or controlled, with optional saturation.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct VoltageSource {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// The positive node of the source, then the negative node.
    pub nodes: (String, String),
    /// Voltage, as an expression in `t`, and for a controlled source also in voltages `v(node)`, `v(component)` and
    /// currents `i(component)`.
    pub volts: Expression,
    /// Minimum and maximum voltage, at which the source saturates.
    pub limits: Option<(Expression, Expression)>,
}

/// A current source, prescribed or controlled, with optional saturation.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CurrentSource {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// The node that the current is drawn from, then the node that it is delivered to.
    pub nodes: (String, String),
    /// Current, as an expression in `t`, and for a controlled source also in voltages `v(node)`, `v(component)` and
    /// currents `i(component)`.
    pub amperes: Expression,
    /// Minimum and maximum current, at which the source saturates.
    pub limits: Option<(Expression, Expression)>,
}

/// An ideal diode with an optional forward voltage.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Diode {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// Nodes of the anode and of the cathode.
    pub nodes: (String, String),
    /// Forward voltage of the conducting diode, not negative. Default 0.
    pub forward_volts: Option<Expression>,
}

/// An ideal zener diode, which conducts in reverse at its breakdown voltage.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Zener {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// Nodes of the anode and of the cathode.
    pub nodes: (String, String),
    /// Forward voltage of the diode that conducts forwards, not negative. Default 0.
    pub forward_volts: Option<Expression>,
    /// Breakdown voltage, from cathode to anode, at which the diode conducts in reverse; above 0.
    pub breakdown_volts: Expression,
}

/// An ideal switch, controlled by time or by voltages and currents.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Switch {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// The two nodes that the component connects.
    pub nodes: (String, String),
    /// The switch is closed while this expression is not negative: an expression in `t`, as in `sin(2*pi*f*t)`, or also
    /// in voltages `v(node)`, `v(component)` and currents `i(component)`, as in `v(control) - sawtooth(t, period)`.
    pub closed: Expression,
    /// Withstand voltage of the open switch, above 0: at this voltage an arc conducts, as when the switch interrupts
    /// the current of an inductor. Required where `closed` depends on `t` alone; not allowed otherwise, since a switch
    /// controlled by voltages and currents withstands any voltage.
    pub withstand_volts: Option<Expression>,
    /// Hysteresis of a switch controlled by voltages and currents: the switch closes when `closed` rises to this
    /// value, and opens when `closed` falls to minus this value. Not negative. Default 0.
    pub hysteresis: Option<Expression>,
    /// Whether the switch is closed at the start, if hysteresis leaves that undetermined. Default false.
    #[serde(default)]
    pub initially: bool,
}

/// An ideal operational amplifier with optional limits of the output voltage.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct OpAmp {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// The input nodes, `+` and `-`, which draw no current.
    pub inputs: (String, String),
    /// The output node, and the node that the output voltage is measured against.
    pub nodes: (String, String),
    /// Minimum and maximum output voltage. Default: unlimited.
    pub limits: Option<(Expression, Expression)>,
}

/// An ideal comparator with optional hysteresis.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Comparator {
    /// Name of the component, different from the names of all other components and nodes.
    pub name: String,
    /// The input nodes, `+` and `-`, which draw no current.
    pub inputs: (String, String),
    /// The output node, and the node that the output voltage is measured against.
    pub nodes: (String, String),
    /// Output voltage while the first input is below the second. Default 0.
    pub low: Option<Expression>,
    /// Output voltage while the first input is above the second; above `low`. Default 1.
    pub high: Option<Expression>,
    /// Hysteresis in volts: the output goes high when the first input rises this far above the second, and low when it
    /// falls this far below. Not negative. Default 0.
    pub hysteresis: Option<Expression>,
    /// Whether the output is high at the start, if hysteresis leaves that undetermined. Default false.
    #[serde(default)]
    pub initially: bool,
}

/// An ideal transformer with two windings.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Transformer {
    /// Name of the transformer, different from the names of all other components and nodes. The winding currents are
    /// `i(name.primary)` and `i(name.secondary)`.
    pub name: String,
    /// The nodes of the primary winding, the dotted end first.
    pub primary: (String, String),
    /// The nodes of the secondary winding, the dotted end first.
    pub secondary: (String, String),
    /// Turns of the primary winding divided by turns of the secondary; not 0.
    pub ratio: Expression,
}

impl Component {
    /// Returns the key of the kind of component in a specification, such as `resistor`.
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

    /// Returns the name that the user gave to the component.
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

    /// Returns the pairs of nodes that the component connects, one pair per circuit element.
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

    /// Returns the input nodes, whose voltage is sensed without drawing current.
    pub(super) fn inputs(&self) -> Option<&(String, String)> {
        match self {
            Self::OpAmp(OpAmp { inputs, .. }) | Self::Comparator(Comparator { inputs, .. }) => Some(inputs),
            _ => None,
        }
    }
}
