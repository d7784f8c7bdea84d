//! Netlists in the syntax of SPICE (Nagel 1975, *SPICE2*; the ngspice manual, chapters 2 to 4), with ideal components:
//! one component per line, whose first letter is its kind.
//!
//! ```text
//! V1 in 0 SIN(0 10 50)   ; offset, amplitude, hertz, delay, damping, phase in degrees
//! D1 in out DX           ; ideal; of a model VF= volts forward, BV= volts of breakdown, RS= ohms
//! S1 in out c 0 SX       ; closed where the voltage between c and 0 is above VT= of its model
//! C1 out 0 100u IC=0
//! R1 out 0 {2*load}      ; .param load=1k
//! K1 L1 L2 0.99          ; coupled inductors, two or more
//! X1 in out filter       ; .subckt filter a b .. .ends
//! ```
//!
//! Case is ignored; a name is reported as it is first written. `gnd` also means ground. The first line of a netlist
//! with `.tran` is its title.

mod arithmetic;
mod component;
mod coupling;
mod deck;
mod device;
mod expansion;
mod tokens;
mod value;
mod waveform;
mod windings;

use super::components::Component;
use crate::error::SpecificationError;
use crate::pointer::Pointer;
use arithmetic::Scope;
use component::Rest;
pub(crate) use deck::Transient;
use std::collections::HashMap;
use tokens::{Token, statements};
use value::value;

/// Maximum length of a netlist, in bytes.
const LONGEST: usize = 64 * 1024;

/// The content of a netlist: components, title, transient analysis.
pub(crate) struct Netlist {
    pub components: Vec<Component>,
    /// The line of the netlist on which each component begins.
    pub lines: Vec<usize>,
    /// The title of the netlist, if there is a `.tran`.
    pub title: Option<String>,
    /// The transient analysis of the netlist, if there is a `.tran`.
    pub transient: Option<Transient>,
    /// Warnings about parts of the netlist that are read differently from SPICE.
    pub remarks: Vec<String>,
}

/// An error in a netlist.
#[derive(Clone, Debug)]
pub(crate) struct NetlistError {
    /// Line of the error in the netlist, counted from 1; the column is counted in characters.
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

    /// Converts the error to a specification error at the JSON pointer of the netlist.
    pub fn at(self, place: &Pointer<'_>) -> SpecificationError {
        let detail = format!("line {}, column {}: {}", self.line, self.column, self.detail);
        SpecificationError::new(place.to_string(), self.code, detail).expected(self.expected)
    }
}

/// Reads a netlist.
///
/// # Errors
/// The first error of each faulty line.
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

/// Returns the value of a token of a netlist: a number, an expression or the name of a parameter.
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

/// The spelling of each name in a netlist as first written, by its lower-case form.
#[derive(Default)]
struct Names {
    spelled: HashMap<String, String>,
}

impl Names {
    fn of(&mut self, name: String) -> String {
        self.spelled.entry(name.to_lowercase()).or_insert(name).clone()
    }
}
