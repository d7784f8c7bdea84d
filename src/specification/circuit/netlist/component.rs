//! Reads one line of a netlist as a component.

use super::arithmetic::Scope;
use super::device::{Kind, Model};
use super::expansion::Frame;
use super::tokens::{Statement, Token};
use super::{Names, NetlistError, value_in, waveform};
use crate::circuit::components::*;
use crate::circuit::lowering::GROUND;
use crate::expression::Expression;
use std::collections::HashMap;

const KINDS: &str =
    "a component: a name that begins with R, C, L, V, I, D, E, F, G, H, S, W, K or X; a comment begins with `*`";

/// The unread tokens of a statement of a netlist, and the last token read.
pub(super) struct Rest<'a, 's> {
    tokens: std::vec::IntoIter<Token<'a>>,
    last: Token<'a>,
    scope: &'s Scope,
}

impl<'a, 's> Rest<'a, 's> {
    /// Creates a reader that begins after the first token of a statement of a netlist.
    pub fn new(statement: &Statement<'a>, scope: &'s Scope) -> Self {
        let mut tokens = statement.tokens.clone().into_iter();
        let last = tokens.next().unwrap_or(Token { text: "", line: 1, column: 1 });
        Self { tokens, last, scope }
    }

    pub fn next(&mut self, expected: &str) -> Result<Token<'a>, NetlistError> {
        let Some(token) = self.tokens.next() else {
            let detail = format!("something is missing after `{}`", self.last.text);
            return Err(NetlistError::new(self.last, "incomplete_component", detail, expected));
        };
        self.last = token;
        Ok(token)
    }

    pub fn peek(&self) -> Option<Token<'a>> {
        self.tokens.as_slice().first().copied()
    }

    /// The unread tokens of the statement of the netlist.
    pub fn words(&self) -> &[Token<'a>] {
        self.tokens.as_slice()
    }

    /// Whether a token of a netlist is a number, an expression or the name of a parameter.
    pub fn is_value(&self, token: Token<'_>) -> bool {
        token.is_like_a_number() || self.scope.contains_key(&token.text.to_lowercase())
    }

    pub fn number(&self, token: Token<'_>) -> Result<f64, NetlistError> {
        value_in(token, self.scope)
    }

    pub fn value(&mut self, expected: &str) -> Result<f64, NetlistError> {
        let token = self.next(expected)?;
        self.number(token)
    }

    /// Reads values (numbers, expressions, names of parameters) until a token that is none, or the end of the
    /// statement.
    pub fn values(&mut self) -> Result<Vec<Token<'a>>, NetlistError> {
        let mut values = Vec::new();
        while let Some(token) = self.peek().filter(|token| self.is_value(*token)) {
            self.number(token)?;
            values.push(self.next("a value")?);
        }
        Ok(values)
    }

    /// Reads `KEY=value` pairs for the given keys, in any order, up to the end of the statement.
    pub fn options<const N: usize>(&mut self, keys: [&str; N]) -> Result<[Option<f64>; N], NetlistError> {
        let mut found = [None; N];
        let expected = match keys.as_slice() {
            [] => "the end of the line".to_owned(),
            keys => format!("{}=, or the end of the line", keys.join("=, ")),
        };
        while self.peek().is_some() {
            let token = self.next(&expected)?;
            let Some(k) = keys.iter().position(|key| token.text.eq_ignore_ascii_case(key)) else {
                let detail = format!("`{}` is not understood here", token.shown());
                return Err(NetlistError::new(token, "unexpected_word", detail, &expected));
            };
            let equals = self.next("`=`")?;
            if equals.text != "=" {
                let detail = format!("found `{}` where `=` is expected", equals.shown());
                return Err(NetlistError::new(equals, "unexpected_word", detail, "`=`"));
            }
            found[k] = Some(self.value("a value")?);
        }
        Ok(found)
    }
}

/// Reads the components that one line describes: the component itself, and the series and parallel resistances of its
/// model.
pub(super) fn read<'a>(
    statement: &Statement<'a>,
    frame: &Frame<'_>,
    models: &HashMap<String, Model>,
    names: &mut Names,
) -> Result<Vec<Component>, NetlistError> {
    let mut rest = Rest::new(statement, &frame.scope);
    let first = rest.last;
    let kind = first.text.chars().next().unwrap_or(' ').to_ascii_uppercase();
    if !"RCLVIDEFGHSW".contains(kind) {
        let detail = match kind {
            '.' => format!("the command `{}` has no meaning here", first.shown()),
            _ => format!("`{}` is not a known component", first.shown()),
        };
        return Err(NetlistError::new(first, "unknown_component", detail, KINDS));
    }
    let name = frame.component(first, names);
    let nodes = (frame.node(rest.next("two nodes")?, names), frame.node(rest.next("a second node")?, names));
    Ok(vec![match kind {
        'R' => {
            let ohms = rest.value("a resistance in ohms")?.into();
            rest.options([])?;
            Component::Resistor(Resistor { name, nodes, ohms })
        }
        'C' => {
            let farads = rest.value("a capacitance in farads")?.into();
            let [volts] = rest.options(["IC"])?;
            Component::Capacitor(Capacitor { name, nodes, farads, volts: volts.map(Expression::Number) })
        }
        'L' => {
            let henries = rest.value("an inductance in henries")?.into();
            let [amperes] = rest.options(["IC"])?;
            Component::Inductor(Inductor { name, nodes, henries, amperes: amperes.map(Expression::Number) })
        }
        'V' => Component::VoltageSource(VoltageSource { name, nodes, volts: waveform::read(&mut rest)?, limits: None }),
        'I' => {
            Component::CurrentSource(CurrentSource { name, nodes, amperes: waveform::read(&mut rest)?, limits: None })
        }
        'E' | 'F' | 'G' | 'H' => {
            let follows = if matches!(kind, 'E' | 'G') {
                let plus = frame.node(rest.next("the two nodes of the voltage that it follows")?, names);
                let minus = frame.node(rest.next("a second node of the voltage that it follows")?, names);
                format!("(v({plus}) - v({minus}))")
            } else {
                format!("i({})", frame.component(rest.next("the component whose current it follows")?, names))
            };
            let gain = rest.value("a gain")?;
            rest.options([])?;
            let follows = Expression::Text(format!("{gain:?}*{follows}"));
            match kind {
                'E' | 'H' => Component::VoltageSource(VoltageSource { name, nodes, volts: follows, limits: None }),
                _ => Component::CurrentSource(CurrentSource { name, nodes, amperes: follows, limits: None }),
            }
        }
        'S' | 'W' => return switch(kind, (name, nodes), &mut rest, frame, models, names),
        _ => return diode((name, nodes), &mut rest, models),
    }])
}

/// Reads a diode, with the values on its line or else those of its model.
fn diode(
    (name, nodes): (String, (String, String)),
    rest: &mut Rest<'_, '_>,
    models: &HashMap<String, Model>,
) -> Result<Vec<Component>, NetlistError> {
    let is_option = rest.words().get(1).is_none_or(|token| token.text == "=") && rest.words().len() != 1;
    let model = match rest.peek() {
        Some(token) if !is_option => {
            rest.next("a model")?;
            Some(model(token, Kind::Diode, models)?)
        }
        _ => None,
    };
    // Skip the number for the junction area on the line of a diode, which an ideal diode does not have.
    rest.values()?;
    let [forward, breakdown] = rest.options(["VF", "BV"])?;
    let of_model = |keys: &[&str]| model.and_then(|model| model.value(keys));
    let forward = forward.or_else(|| of_model(&["vf", "vfwd"]));
    let breakdown = breakdown.or_else(|| of_model(&["bv", "vrev", "vb"]));
    let resistance = of_model(&["rs", "ron"]).filter(|ohms| *ohms > 0.0);
    let leakage = of_model(&["roff"]).filter(|ohms| *ohms > 0.0);
    let mut components = Vec::new();
    let across = nodes.clone();
    let nodes = series(&mut components, (&name, nodes), resistance);
    parallel(&mut components, (&name, across), leakage);
    let forward_volts = forward.map(Expression::Number);
    components.push(match breakdown {
        Some(volts) => {
            let breakdown_volts = Expression::Number(volts);
            Component::Zener(Zener { name, nodes, forward_volts, breakdown_volts })
        }
        None => Component::Diode(Diode { name, nodes, forward_volts }),
    });
    Ok(components)
}

/// Reads a switch controlled by a voltage or a current, with the resistances of its model.
fn switch(
    kind: char,
    (name, nodes): (String, (String, String)),
    rest: &mut Rest<'_, '_>,
    frame: &Frame<'_>,
    models: &HashMap<String, Model>,
    names: &mut Names,
) -> Result<Vec<Component>, NetlistError> {
    let (follows, of, threshold, hysteresis) = if kind == 'S' {
        let plus = frame.node(rest.next("the two nodes of the voltage that closes it")?, names);
        let minus = frame.node(rest.next("a second node of the voltage that closes it")?, names);
        (format!("v({plus}) - v({minus})"), Kind::Switch, ["vt", "von"], "vh")
    } else {
        let source = frame.component(rest.next("the source whose current closes it")?, names);
        (format!("i({source})"), Kind::CurrentSwitch, ["it", "ion"], "ih")
    };
    let token = rest.next("a model of a switch")?;
    let model = model(token, of, models)?;
    let initially = match rest.peek() {
        Some(word) if word.text.eq_ignore_ascii_case("on") => rest.next("ON").map(|_| true)?,
        Some(word) if word.text.eq_ignore_ascii_case("off") => rest.next("OFF").map(|_| false)?,
        _ => false,
    };
    rest.options([])?;
    // PSpice's thresholds VON and VOFF are a hysteresis around their mean.
    let on_and_off = model.value(&threshold[1..]).zip(model.value(&["voff", "ioff"]));
    let (at, half) = match on_and_off {
        Some((on, off)) => (0.5 * (on + off), 0.5 * (on - off)),
        None => (model.value(&threshold[..1]).unwrap_or(0.0), model.value(&[hysteresis]).unwrap_or(0.0)),
    };
    if half < 0.0 {
        let detail = format!("the hysteresis of `{}` is below zero, which is a smooth switch", token.shown());
        return Err(NetlistError::new(token, "out_of_range", detail, "a hysteresis of zero or more"));
    }
    let mut components = Vec::new();
    let across = nodes.clone();
    // The default on-resistance of a switch in SPICE is 1 ohm.
    let resistance = model.value(&["ron"]).or(Some(1.0)).filter(|ohms| *ohms > 0.0);
    let nodes = series(&mut components, (&name, nodes), resistance);
    parallel(&mut components, (&name, across), model.value(&["roff"]).filter(|ohms| *ohms > 0.0));
    components.push(Component::Switch(Switch {
        name,
        nodes,
        closed: Expression::Text(format!("{follows} - ({at:?})")),
        withstand_volts: None,
        hysteresis: Some(Expression::Number(half)),
        initially,
    }));
    Ok(components)
}

/// Finds the device model of the given name, which must be of the given kind.
fn model<'m>(token: Token<'_>, kind: Kind, models: &'m HashMap<String, Model>) -> Result<&'m Model, NetlistError> {
    let written = match kind {
        Kind::Diode => "D",
        Kind::Switch => "SW(Ron=1m Vt=0.5)",
        Kind::CurrentSwitch => "CSW(Ron=1m It=1m)",
    };
    let shown = token.shown();
    let expected = format!(".model {shown} {written}");
    match models.get(&token.text.to_lowercase()) {
        Some(model) if model.kind == kind => Ok(model),
        Some(_) => {
            let detail = format!("the model `{shown}` is one of another kind");
            Err(NetlistError::new(token, "unknown_name", detail, &expected))
        }
        None => Err(NetlistError::new(token, "unknown_name", format!("there is no model `{shown}`"), &expected)),
    }
}

/// Adds a resistor in series with a component, if a resistance is given; returns the nodes that remain for the
/// component.
fn series(
    components: &mut Vec<Component>,
    (name, (a, b)): (&str, (String, String)),
    ohms: Option<f64>,
) -> (String, String) {
    let Some(ohms) = ohms else { return (a, b) };
    let between = format!("{name}.on");
    let nodes = (a, between.clone());
    components.push(Component::Resistor(Resistor { name: format!("{name}.ron"), nodes, ohms: ohms.into() }));
    (between, b)
}

/// Adds a resistor in parallel with a component, if a resistance is given.
fn parallel(components: &mut Vec<Component>, (name, nodes): (&str, (String, String)), ohms: Option<f64>) {
    if let Some(ohms) = ohms {
        components.push(Component::Resistor(Resistor { name: format!("{name}.roff"), nodes, ohms: ohms.into() }));
    }
}

/// Whether the name of a node of a netlist means ground.
pub(super) fn is_ground(name: &str) -> bool {
    name == GROUND || name.eq_ignore_ascii_case("gnd")
}
