//! Netlists as SPICE reads them (Nagel 1975, *SPICE2*; the ngspice manual, chapters 2 to 4), of ideal components and
//! without a title line: a component a line, its first letter its kind.
//!
//! ```text
//! V1 in 0 SIN(0 10 50)   ; offset, amplitude, hertz, delay, damping, phase in degrees
//! D1 in out              ; ideal; VF= volts forward, BV= volts of breakdown
//! C1 out 0 100u IC=0
//! R1 out 0 1k
//! ```
//!
//! Letters are the same in either case; a name is told as it is written first. `gnd` is ground as well.

mod tokens;
mod value;
mod waveform;

use super::components::*;
use super::lowering::GROUND;
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::place::Place;
use std::collections::HashMap;
use tokens::{Token, statements};
use value::value;

/// The longest netlist, in bytes.
const LONGEST: usize = 64 * 1024;

/// What a netlist holds.
pub(super) struct Netlist {
    pub components: Vec<Component>,
    /// The line that each begins on.
    pub lines: Vec<usize>,
}

/// Something wrong in a netlist.
#[derive(Clone, Debug)]
pub(super) struct NetlistError {
    /// Counted from 1; columns in characters.
    line: usize,
    column: usize,
    code: &'static str,
    detail: String,
    expected: String,
}

impl NetlistError {
    fn new(token: Token<'_>, code: &'static str, detail: String, expected: &str) -> Self {
        Self { line: token.line, column: token.column, code, detail, expected: expected.to_owned() }
    }

    /// The error at the place of the netlist.
    pub fn at(self, place: &Place<'_>) -> SpecificationError {
        let detail = format!("line {}, column {}: {}", self.line, self.column, self.detail);
        SpecificationError::new(place.to_string(), self.code, detail).expected(self.expected)
    }
}

/// Reads a netlist.
///
/// # Errors
/// The first error of every line that has one.
pub(super) fn read(text: &str) -> Result<Netlist, Vec<NetlistError>> {
    if text.len() > LONGEST {
        let detail = format!("the netlist has {} bytes", text.len());
        let token = Token { text: "", line: 1, column: 1 };
        return Err(vec![NetlistError::new(token, "too_long", detail, "at most 64 KiB")]);
    }
    let (mut netlist, mut errors) = (Netlist { components: Vec::new(), lines: Vec::new() }, Vec::new());
    let mut names = Names { spelled: HashMap::from([("gnd".to_owned(), GROUND)]) };
    for statement in statements(text) {
        if statement.tokens.first().is_some_and(|token| token.text.eq_ignore_ascii_case(".end")) {
            break;
        }
        let line = statement.tokens.first().map_or(0, |token| token.line);
        match component(statement, &mut names) {
            Ok(component) => {
                netlist.components.push(component);
                netlist.lines.push(line);
            }
            Err(error) => errors.push(error),
        }
    }
    if errors.is_empty() { Ok(netlist) } else { Err(errors) }
}

/// Names, each as it is written first.
struct Names<'a> {
    spelled: HashMap<String, &'a str>,
}

impl<'a> Names<'a> {
    fn of(&mut self, token: Token<'a>) -> String {
        (*self.spelled.entry(token.text.to_lowercase()).or_insert(token.text)).to_owned()
    }
}

/// The tokens of a component that have not been read, and the last that was.
pub(super) struct Rest<'a> {
    tokens: std::vec::IntoIter<Token<'a>>,
    last: Token<'a>,
}

impl<'a> Rest<'a> {
    fn next(&mut self, expected: &str) -> Result<Token<'a>, NetlistError> {
        let Some(token) = self.tokens.next() else {
            let detail = format!("something is missing after `{}`", self.last.text);
            return Err(NetlistError::new(self.last, "incomplete_component", detail, expected));
        };
        self.last = token;
        Ok(token)
    }

    fn peek(&self) -> Option<Token<'a>> {
        self.tokens.as_slice().first().copied()
    }

    fn value(&mut self, expected: &str) -> Result<f64, NetlistError> {
        value(self.next(expected)?)
    }

    /// All values up to a word or the end.
    fn values(&mut self) -> Result<Vec<Token<'a>>, NetlistError> {
        let mut values = Vec::new();
        while let Some(token) = self.peek().filter(|token| token.is_like_a_number()) {
            value(token)?;
            values.push(self.next("a value")?);
        }
        Ok(values)
    }

    /// `KEY=value` for any of the keys, in any order, up to the end.
    fn options<const N: usize>(&mut self, keys: [&str; N]) -> Result<[Option<f64>; N], NetlistError> {
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
                let detail = format!("`{}` stands where `=` belongs", equals.shown());
                return Err(NetlistError::new(equals, "unexpected_word", detail, "`=`"));
            }
            found[k] = Some(self.value("a value")?);
        }
        Ok(found)
    }
}

fn component<'a>(statement: tokens::Statement<'a>, names: &mut Names<'a>) -> Result<Component, NetlistError> {
    const KINDS: &str = "a component: a name that begins with R, C, L, V, I, D, E, F, G or H";
    let mut tokens = statement.tokens.into_iter();
    let first = tokens.next().unwrap_or(Token { text: "", line: 1, column: 1 });
    let mut rest = Rest { tokens, last: first };
    let kind = first.text.chars().next().unwrap_or(' ').to_ascii_uppercase();
    if !"RCLVIDEFGH".contains(kind) {
        let detail = match kind {
            '.' => format!("the command `{}` has no meaning here", first.shown()),
            _ => format!("`{}` is no component known here", first.shown()),
        };
        return Err(NetlistError::new(first, "unknown_component", detail, KINDS));
    }
    let name = names.of(first);
    let nodes = (names.of(rest.next("two nodes")?), names.of(rest.next("a second node")?));
    Ok(match kind {
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
                let plus = names.of(rest.next("the two nodes of the voltage that it follows")?);
                let minus = names.of(rest.next("a second node of the voltage that it follows")?);
                format!("(v({plus}) - v({minus}))")
            } else {
                format!("i({})", names.of(rest.next("the component whose current it follows")?))
            };
            let gain = rest.value("a gain")?;
            rest.options([])?;
            let follows = Expression::Text(format!("{gain:?}*{follows}"));
            match kind {
                'E' | 'H' => Component::VoltageSource(VoltageSource { name, nodes, volts: follows, limits: None }),
                _ => Component::CurrentSource(CurrentSource { name, nodes, amperes: follows, limits: None }),
            }
        }
        _ => {
            let [forward, breakdown] = rest.options(["VF", "BV"])?;
            let forward_volts = forward.map(Expression::Number);
            match breakdown {
                Some(volts) => {
                    let breakdown_volts = Expression::Number(volts);
                    Component::Zener(Zener { name, nodes, forward_volts, breakdown_volts })
                }
                None => Component::Diode(Diode { name, nodes, forward_volts }),
            }
        }
    })
}
