//! Netlists as SPICE reads them (Nagel 1975, *SPICE2*; the ngspice manual, chapters 2 to 4), of ideal components: a component
//! a line, its first letter its kind.
//!
//! ```text
//! V1 in 0 SIN(0 10 50)   ; offset, amplitude, hertz, delay, damping, phase in degrees
//! D1 in out DX           ; ideal; of a model VF= volts forward, BV= volts of breakdown, RS= ohms
//! S1 in out c 0 SX       ; closed where the voltage between c and 0 is above VT= of its model
//! C1 out 0 100u IC=0
//! R1 out 0 {2*load}      ; .param load=1k
//! K1 L1 L2 0.99          ; two coupled inductors
//! X1 in out filter       ; .subckt filter a b .. .ends
//! ```
//!
//! Letters are the same in either case; a name is told as it is written first. `gnd` is ground as well. A netlist with `.tran`
//! is a deck, whose first line is its title.

mod arithmetic;
mod component;
mod coupling;
mod deck;
mod device;
mod expansion;
mod tokens;
mod value;
mod waveform;

use super::components::Component;
use crate::error::SpecificationError;
use crate::pointer::Pointer;
use arithmetic::Scope;
use component::Rest;
pub(crate) use deck::Transient;
use std::collections::HashMap;
use tokens::{Token, statements};
use value::value;

/// The longest netlist, in bytes.
const LONGEST: usize = 64 * 1024;

/// What a netlist holds.
pub(crate) struct Netlist {
    pub components: Vec<Component>,
    /// The line that each begins on.
    pub lines: Vec<usize>,
    /// The title of a deck.
    pub title: Option<String>,
    /// The horizon of a deck.
    pub transient: Option<Transient>,
    /// What SPICE would read otherwise.
    pub remarks: Vec<String>,
}

/// Something wrong in a netlist.
#[derive(Clone, Debug)]
pub(crate) struct NetlistError {
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
    pub fn at(self, place: &Pointer<'_>) -> SpecificationError {
        let detail = format!("line {}, column {}: {}", self.line, self.column, self.detail);
        SpecificationError::new(place.to_string(), self.code, detail).expected(self.expected)
    }
}

/// Reads a netlist.
///
/// # Errors
/// The first error of every line that has one.
pub(crate) fn read(text: &str) -> Result<Netlist, Vec<NetlistError>> {
    if text.len() > LONGEST {
        let detail = format!("the netlist has {} bytes", text.len());
        let token = Token { text: "", line: 1, column: 1 };
        return Err(vec![NetlistError::new(token, "too_long", detail, "at most 64 KiB")]);
    }
    let mut errors = Vec::new();
    let deck = deck::sort(text, statements(text), &mut errors);
    expansion::expand(&deck, errors)
}

/// The number that a word is, or the value of the expression or the parameter.
fn value_in(token: Token<'_>, scope: &Scope) -> Result<f64, NetlistError> {
    if let Some(expression) = token.expression() {
        return arithmetic::evaluate(expression, scope).map_err(|why| {
            NetlistError::new(
                token,
                "malformed_number",
                format!("`{}`: {why}", token.shown()),
                "an expression in numbers and .param",
            )
        });
    }
    match scope.get(&token.text.to_lowercase()) {
        Some(value) => Ok(*value),
        None => value(token),
    }
}

/// Names, each as it is written first.
#[derive(Default)]
struct Names {
    spelled: HashMap<String, String>,
}

impl Names {
    fn of(&mut self, name: String) -> String {
        self.spelled.entry(name.to_lowercase()).or_insert(name).clone()
    }
}
