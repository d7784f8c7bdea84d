//! Rewriting of kinks as a set: calls of `abs`, `sign`, `heaviside`, `min` and `max` that depend on unknowns, in rates,
//! inequalities and definitions, become variables in `K`. An error message about a kink can then show what to write
//! instead, in the user's own names.
//!
//! ```text
//! sign(a) = z,          z in [-1, 1],  G = -a            heaviside(a) = z,     z in [0, 1],  G = -a
//! abs(a) = a z,         z in [-1, 1],  G = -a
//! min(a, b) = a - z,    z >= 0,        G = z - (a - b)   max(a, b) = a + z,    z >= 0,       G = z - (b - a)
//! ```
//! For `sign(a)`: `z` is in `Sgn(a)` if and only if `a` is normal to `[-1, 1]` at `z`: `-a (z~ - z) >= 0` for all
//! `z~` in `[-1, 1]`.

use super::dvi::{DviProblem, State, Variable};
use super::expression::Expression;
use super::set::{Block, BoxBlock};
use std::collections::HashSet;

/// Largest number of calls of functions with a kink that are rewritten in one problem: the result is meant to be read
/// by a person.
const MOST: usize = 64;

/// Names of the functions with a kink or a jump that can be rewritten as a set.
const FUNCTIONS: [&str; 5] = ["abs", "sign", "heaviside", "min", "max"];

/// A call of a function with a kink that has been replaced by a variable.
struct Replaced {
    call: String,
    /// Name of the variable introduced for the call of the function with a kink.
    name: String,
    value: String,
    inequality: String,
    interval: Option<(f64, f64)>,
}

/// Rewrites the kinks of rates, inequalities and definitions as a set. Returns `None` if there are no kinks, more
/// than `MOST`, or a call that cannot be written as a set.
pub(super) fn rewritten(problem: &DviProblem) -> Option<DviProblem> {
    let names = problem.states.names().chain(problem.variables.names()).chain(problem.definitions.names());
    let mut rewriting = Rewriting {
        unknowns: names.map(str::to_owned).collect(),
        parameters: problem.parameters.names().chain(problem.tables.names()).map(str::to_owned).collect(),
        replaced: Vec::new(),
    };
    let mut states = Vec::with_capacity(problem.states.len());
    for (name, state) in problem.states.iter() {
        let rate = rewriting.expression(&state.rate)?;
        states.push((name.to_owned(), State { initial: state.initial.clone(), rate }));
    }
    let mut variables = Vec::with_capacity(problem.variables.len());
    for (name, variable) in problem.variables.iter() {
        variables.push((name.to_owned(), Variable { inequality: rewriting.expression(&variable.inequality)? }));
    }
    let mut definitions = Vec::with_capacity(problem.definitions.len());
    for (name, definition) in problem.definitions.iter() {
        definitions.push((name.to_owned(), rewriting.expression(definition)?));
    }
    let mut set = problem.set.clone().unwrap_or_default();
    if rewriting.replaced.is_empty() {
        return None;
    }
    for Replaced { name, inequality, interval, .. } in rewriting.replaced {
        set.push(match interval {
            Some((lower, upper)) => {
                Block::Box(BoxBlock { of: vec![name.clone()], lower: Some(lower.into()), upper: Some(upper.into()) })
            }
            None => Block::Nonnegative(vec![name.clone()]),
        });
        variables.push((name, Variable { inequality: Expression::Text(inequality) }));
    }
    Some(DviProblem {
        parameters: problem.parameters.clone(),
        tables: problem.tables.clone(),
        definitions: definitions.into_iter().collect(),
        integrals: problem.integrals.clone(),
        states: states.into_iter().collect(),
        variables: variables.into_iter().collect(),
        set: Some(set),
        mass: problem.mass.clone(),
    })
}

/// State of the rewriting of a problem: the names in use, and the calls of functions with a kink replaced so far.
struct Rewriting {
    unknowns: HashSet<String>,
    parameters: HashSet<String>,
    replaced: Vec<Replaced>,
}

impl Rewriting {
    fn expression(&mut self, expression: &Expression) -> Option<Expression> {
        let Expression::Text(text) = expression else { return Some(expression.clone()) };
        let mut text = text.clone();
        while let Some(call) = self.innermost(&text) {
            let value = self.value_of(&text[call.start..call.end], call.function, &call.arguments)?;
            text.replace_range(call.start..call.end, &value);
        }
        Some(Expression::Text(text))
    }

    /// Finds the last call of a function with a kink that depends on an unknown. Because it begins last, it contains
    /// no other call of such a function.
    fn innermost(&self, text: &str) -> Option<Call> {
        let words = words(text);
        words.iter().rev().find_map(|&(start, word)| {
            let function = FUNCTIONS.into_iter().find(|function| *function == word)?;
            let call = Call::read(text, start, function)?;
            let depends = words
                .iter()
                .any(|&(at, word)| (start + function.len()..call.end).contains(&at) && self.unknowns.contains(word));
            depends.then_some(call)
        })
    }

    /// Returns the expression that replaces a call of a function with a kink, introducing a variable for it if the call
    /// is new.
    fn value_of(&mut self, call: &str, function: &str, arguments: &[String]) -> Option<String> {
        let call: String = call.split_whitespace().collect();
        if let Some(known) = self.replaced.iter().find(|replaced| replaced.call == call) {
            return Some(known.value.clone());
        }
        if self.replaced.len() == MOST {
            return None;
        }
        let name = self.new_name();
        let (value, inequality, interval) = match (function, arguments) {
            ("sign", [a]) => (name.clone(), negated(a), Some((-1.0, 1.0))),
            ("heaviside", [a]) => (name.clone(), negated(a), Some((0.0, 1.0))),
            ("abs", [a]) => (format!("(({a})*{name})"), negated(a), Some((-1.0, 1.0))),
            ("min", [a, b]) => (format!("({a} - {name})"), format!("{name} - (({a}) - ({b}))"), None),
            ("max", [a, b]) => (format!("({a} + {name})"), format!("{name} - (({b}) - ({a}))"), None),
            // A call of `min` or `max` with three or more arguments is nested: its first two arguments form a call of
            // their own.
            ("min" | "max", [a, b, rest @ ..]) => {
                return Some(format!("{function}({function}({a}, {b}), {})", rest.join(", ")));
            }
            _ => return None,
        };
        self.unknowns.insert(name.clone());
        self.replaced.push(Replaced { call, name, value: value.clone(), inequality, interval });
        Some(value)
    }

    fn new_name(&self) -> String {
        let is_free = |name: &String| name != "t" && !self.unknowns.contains(name) && !self.parameters.contains(name);
        let mut names = ["u".to_owned()].into_iter().chain((2_usize..).map(|k| format!("u{k}")));
        names.find(is_free).unwrap_or_default()
    }
}

/// A call of a function with a kink, within the text of an expression.
struct Call {
    function: &'static str,
    start: usize,
    /// Byte index in the text after the closing parenthesis of the call.
    end: usize,
    arguments: Vec<String>,
}

impl Call {
    fn read(text: &str, start: usize, function: &'static str) -> Option<Self> {
        let open = start + function.len() + text[start + function.len()..].find(|c: char| !c.is_whitespace())?;
        let (mut depth, mut first, mut arguments) = (0_usize, open + 1, Vec::new());
        for (at, c) in text[open..].char_indices().map(|(at, c)| (open + at, c)) {
            match c {
                '(' => depth += 1,
                ')' => depth = depth.checked_sub(1)?,
                ',' if depth == 1 => {
                    arguments.push(text[first..at].trim().to_owned());
                    first = at + 1;
                }
                _ if depth == 0 => return None,
                _ => {}
            }
            if depth == 0 {
                arguments.push(text[first..at].trim().to_owned());
                return Some(Self { function, start, end: at + 1, arguments });
            }
        }
        None
    }
}

fn negated(a: &str) -> String {
    let is_word = a.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if is_word { format!("-{a}") } else { format!("-({a})") }
}

/// Splits the text of an expression into names with their byte offsets; the exponent `e` of a number is not a name.
fn words(text: &str) -> Vec<(usize, &str)> {
    let mut words = Vec::new();
    let mut start = None;
    for (at, c) in text.char_indices().chain([(text.len(), ' ')]) {
        let continues = c.is_ascii_alphanumeric() || c == '_' || c == '.';
        match (start, continues) {
            (None, true) => start = Some(at),
            (Some(first), false) => {
                let word = &text[first..at];
                if !word.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
                    words.push((first, word));
                }
                start = None;
            }
            _ => {}
        }
    }
    words
}
