//! The statements of a netlist other than components: `.param`, `.model`, `.ic`, `.tran` and `.subckt`. Subcircuits
//! are expanded where they are used, and their nodes and components are named as in `X1.R1`.

use super::arithmetic::Scope;
use super::device::Model;
use super::tokens::{Statement, Token};
use super::{NetlistError, value_in};
use std::collections::HashMap;

/// Commands for output or for numerical options of SPICE, ignored because they do not describe the circuit.
const SAY_NOTHING: [&str; 18] = [
    ".end",
    ".option",
    ".options",
    ".opt",
    ".print",
    ".plot",
    ".probe",
    ".save",
    ".width",
    ".temp",
    ".backanno",
    ".meas",
    ".measure",
    ".four",
    ".title",
    ".nodeset",
    ".endc",
    ".ends",
];
/// Analyses other than `.tran`; they are ignored, with a warning.
const OTHER_ANALYSES: [&str; 8] = [".ac", ".dc", ".op", ".noise", ".tf", ".disto", ".pz", ".sens"];

const COMMANDS: &str = ".tran, .param, .model, .ic, .subckt; analyses other than .tran and output commands are ignored";

/// The declaration `.subckt` of a subcircuit in a netlist.
#[derive(Clone, Debug)]
pub(super) struct Subcircuit<'a> {
    /// The names of the port nodes of the subcircuit, in lower case.
    pub ports: Vec<String>,
    /// The parameters of the subcircuit with their default values, as tokens.
    pub defaults: Vec<(Token<'a>, Token<'a>)>,
    pub body: Vec<Statement<'a>>,
}

/// The transient analysis that a netlist asks for by `.tran`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Transient {
    pub end: f64,
    /// Whether the start is given by `IC=` and `.ic` (`UIC`) instead of an operating point.
    pub from_initial: bool,
}

/// An initial voltage or current given by `.ic` in a netlist.
#[derive(Clone, Copy, Debug)]
pub(super) struct Given<'a> {
    /// The node whose initial voltage is given, or the inductor whose initial current is given.
    pub of: Token<'a>,
    pub is_current: bool,
    pub value: f64,
}

/// The statements of a netlist other than components, sorted by kind.
#[derive(Debug, Default)]
pub(super) struct Deck<'a> {
    pub title: Option<&'a str>,
    pub components: Vec<Statement<'a>>,
    pub subcircuits: HashMap<String, Subcircuit<'a>>,
    pub models: HashMap<String, Model>,
    pub scope: Scope,
    pub initial: Vec<Given<'a>>,
    pub transient: Option<Transient>,
    /// Analyses of the netlist other than `.tran`, which are ignored.
    pub passed_over: Vec<Token<'a>>,
}

/// Sorts the statements of a netlist by kind.
///
/// A netlist with `.tran` is a complete deck: its first line is the title, whatever it contains.
pub(super) fn sort<'a>(text: &'a str, statements: Vec<Statement<'a>>, errors: &mut Vec<NetlistError>) -> Deck<'a> {
    let is = |statement: &Statement<'_>, command: &str| {
        statement.tokens.first().is_some_and(|token| token.text.eq_ignore_ascii_case(command))
    };
    let mut deck = Deck::default();
    let mut statements = statements;
    let first_line = text.lines().next().unwrap_or_default();
    if statements.iter().any(|statement| is(statement, ".tran")) && !first_line.trim_start().starts_with('.') {
        deck.title = Some(first_line.trim().trim_start_matches('*').trim());
        if statements.first().is_some_and(|statement| statement.tokens.first().is_some_and(|token| token.line == 1)) {
            statements.remove(0);
        }
    }
    // Collect parameters and models first: they may be used before their definition.
    let mut parameters: Vec<(Token<'a>, Token<'a>)> = Vec::new();
    let (mut models, mut others): (Vec<Statement<'a>>, Vec<Statement<'a>>) = (Vec::new(), Vec::new());
    let mut open: Option<(Token<'a>, Subcircuit<'a>)> = None;
    let mut in_control = false;
    for statement in statements {
        let Some(&first) = statement.tokens.first() else { continue };
        let command = first.text.to_ascii_lowercase();
        if in_control || command == ".control" {
            in_control = command != ".endc";
            continue;
        }
        match (command.as_str(), &mut open) {
            (".end", None) => break,
            (".model", _) => models.push(statement),
            (".ends", Some(_)) => {
                if let Some((name, subcircuit)) = open.take() {
                    deck.subcircuits.insert(name.text.to_lowercase(), subcircuit);
                }
            }
            (".subckt", None) => match subcircuit(&statement) {
                Ok(begun) => open = Some(begun),
                Err(error) => errors.push(error),
            },
            (".subckt", Some(_)) => {
                let detail = "a subcircuit is declared within another".to_owned();
                errors.push(NetlistError::new(first, "unexpected_word", detail, ".ends before the next .subckt"));
            }
            (_, Some((_, subcircuit))) => subcircuit.body.push(statement),
            (".param" | ".parameter" | ".params", None) => match assignments(&statement.tokens[1..]) {
                Ok(given) => parameters.extend(given),
                Err(error) => errors.push(error),
            },
            (command, None) if command.starts_with('.') => others.push(statement),
            (_, None) => deck.components.push(statement),
        }
    }
    if let Some((name, _)) = open {
        let detail = format!("the subcircuit `{}` has no end", name.shown());
        errors.push(NetlistError::new(name, "incomplete_component", detail, ".ends after its last component"));
    }
    resolve(parameters, &mut deck.scope, errors);
    for statement in models {
        let name = statement.tokens.get(1).copied().unwrap_or(statement.tokens[0]);
        match Model::read(name, statement.tokens.get(2..).unwrap_or_default(), &deck.scope) {
            Ok(model) => drop(deck.models.insert(name.text.to_lowercase(), model)),
            Err(error) => errors.push(error),
        }
    }
    for statement in others {
        if let Err(error) = deck.command(&statement) {
            errors.push(error);
        }
    }
    deck
}

impl<'a> Deck<'a> {
    fn command(&mut self, statement: &Statement<'a>) -> Result<(), NetlistError> {
        let Some((&first, words)) = statement.tokens.split_first() else { return Ok(()) };
        let command = first.text.to_ascii_lowercase();
        match command.as_str() {
            ".tran" => self.transient = Some(transient(first, words, &self.scope)?),
            ".ic" => self.starts(words)?,
            known if SAY_NOTHING.contains(&known) => {}
            known if OTHER_ANALYSES.contains(&known) => self.passed_over.push(first),
            _ => {
                let detail = format!("the command `{}` has no meaning here", first.shown());
                return Err(NetlistError::new(first, "unknown_component", detail, COMMANDS));
            }
        }
        Ok(())
    }

    /// Reads the initial values `V(node)=volts` and `I(inductor)=amperes` of `.ic`; the tokeniser has removed the
    /// brackets.
    fn starts(&mut self, words: &[Token<'a>]) -> Result<(), NetlistError> {
        const EXPECTED: &str = "V(node)=volts or I(inductor)=amperes";
        for group in words.chunks(4) {
            let &[kind, of, equals, number] = group else {
                let detail = format!("`{}` is not an initial value", group[0].shown());
                return Err(NetlistError::new(group[0], "unexpected_word", detail, EXPECTED));
            };
            let is_current = kind.text.eq_ignore_ascii_case("i");
            if equals.text != "=" || !(is_current || kind.text.eq_ignore_ascii_case("v")) {
                let detail = format!("`{}` is not an initial value", kind.shown());
                return Err(NetlistError::new(kind, "unexpected_word", detail, EXPECTED));
            }
            self.initial.push(Given { of, is_current, value: value_in(number, &self.scope)? });
        }
        Ok(())
    }
}

/// Reads `.tran step end [start [largest step]] [UIC]`, or `.tran end` alone.
fn transient(first: Token<'_>, words: &[Token<'_>], scope: &Scope) -> Result<Transient, NetlistError> {
    const EXPECTED: &str = ".tran STEP END, followed by UIC if the initial values are those of IC=";
    let is_word = |token: &&Token<'_>| {
        token.text.starts_with(char::is_alphabetic) && !scope.contains_key(&token.text.to_lowercase())
    };
    let numbers: Vec<f64> =
        words.iter().filter(|token| !is_word(token)).map(|&token| value_in(token, scope)).collect::<Result<_, _>>()?;
    let from_initial = words.iter().filter(is_word).any(|token| token.text.eq_ignore_ascii_case("uic"));
    match numbers.as_slice() {
        &[end] | &[_, end, ..] if end > 0.0 => Ok(Transient { end, from_initial }),
        _ => Err(NetlistError::new(first, "malformed_source", ".tran has no end above zero".to_owned(), EXPECTED)),
    }
}

/// Reads the declaration `.subckt NAME nodes [PARAMS:] [key=default ..]`.
fn subcircuit<'a>(statement: &Statement<'a>) -> Result<(Token<'a>, Subcircuit<'a>), NetlistError> {
    const EXPECTED: &str = ".subckt NAME and its nodes";
    let first = statement.tokens[0];
    let Some(&name) = statement.tokens.get(1) else {
        let detail = "the subcircuit has no name".to_owned();
        return Err(NetlistError::new(first, "incomplete_component", detail, EXPECTED));
    };
    let (nodes, options) = nodes_and_options(&statement.tokens[2..]);
    let ports = nodes.iter().map(|token| token.text.to_lowercase()).collect();
    Ok((name, Subcircuit { ports, defaults: assignments(options)?, body: Vec::new() }))
}

/// Splits words at the first `key=` into nodes and options; an optional `PARAMS:` between nodes and options is
/// dropped.
pub(super) fn nodes_and_options<'t, 'a>(words: &'t [Token<'a>]) -> (&'t [Token<'a>], &'t [Token<'a>]) {
    let equals = words.iter().position(|token| token.text == "=").unwrap_or(words.len() + 1);
    let (nodes, options) = words.split_at(equals.saturating_sub(1).min(words.len()));
    match nodes.split_last() {
        Some((last, nodes)) if last.text.eq_ignore_ascii_case("params:") => (nodes, options),
        _ => (nodes, options),
    }
}

/// Reads the assignments `key=value ..` of a statement of a netlist.
pub(super) fn assignments<'a>(words: &[Token<'a>]) -> Result<Vec<(Token<'a>, Token<'a>)>, NetlistError> {
    let mut given = Vec::new();
    for group in words.chunks(3) {
        match *group {
            [key, equals, value] if equals.text == "=" => given.push((key, value)),
            _ => {
                let detail = format!("`{}` is not understood here", group[0].shown());
                return Err(NetlistError::new(
                    group[0],
                    "unexpected_word",
                    detail,
                    "name=value, expressions in braces",
                ));
            }
        }
    }
    Ok(given)
}

/// Evaluates parameters of a netlist into a scope; parameters may refer to each other in any order.
fn resolve<'a>(mut given: Vec<(Token<'a>, Token<'a>)>, scope: &mut Scope, errors: &mut Vec<NetlistError>) {
    loop {
        let before = given.len();
        let mut last = None;
        given.retain(|&(key, value)| match value_in(value, scope) {
            Ok(value) => {
                scope.insert(key.text.to_lowercase(), value);
                false
            }
            Err(error) => {
                last = Some(error);
                true
            }
        });
        match last {
            None => return,
            Some(error) if given.len() == before => return errors.push(error),
            Some(_) => {}
        }
    }
}
