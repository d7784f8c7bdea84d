//! Parsing of names, and of calls of functions and tables with their arguments.

use super::discontinuous::{Discontinuous, OutOfRange};
use super::error::ExpressionError;
use super::function::{Function, synonym};
use super::grammar::{
    Failure, Input, Kind, Read, State, blank, close, conditions, failure, identifier, keep, offset, open, syntax, term,
};
use super::graph::Node;
use super::remedies;
use super::scope::{PI, Scope, WORDS, excerpt, nearest};
use super::table::Table;
use super::vectors;
use std::f64::consts;
use winnow::combinator::{opt, peek, preceded};
use winnow::prelude::*;
use winnow::token::take_while;

/// Remedy for a discontinuous table of states, as text for messages.
const TABLE_AS_SET: &str = "\"linear\" or \"pchip\"; or a variable in a set for each jump: at a = k the table rises by its \
     height times z, with z in the box [0, 1] and the inequality k - a";

/// The name of the function that sums the elements of a vector, or a term over a range of indices.
const SUM: &str = "sum";

/// Parses a name of the scope, or a function with its arguments.
pub(super) fn name(input: &mut Input) -> Result<Read, Failure> {
    let start = offset(input);
    if let Some(output) = input.state.scope.output_at(input.input) {
        let node = input.state.scope.get(output);
        take_while(output.len()..=output.len(), |_| true).void().parse_next(input)?;
        return node.map(|node| Read { node, kind: Kind::Number, start }).ok_or(Failure::Elsewhere);
    }
    let name = identifier.parse_next(input)?;
    if WORDS.contains(&name) {
        return Err(Failure::Elsewhere);
    }
    let called = input.input.trim_start().starts_with('(');
    if let Some(value) = vectors::index(&input.state.indices, name).filter(|_| !called) {
        return keep(input, start, |graph| graph.constant(value));
    }
    if input.input.starts_with('[') {
        return vectors::element(input, start, name);
    }
    if called && name == SUM && input.state.scope.table(name).is_none() {
        return vectors::sum(input, start);
    }
    let bound = input.state.scope.get(name);
    if let Some(function) = Function::named(name)
        && (called || bound.is_none())
    {
        return call(input, start, name, function);
    }
    let scope = input.state.scope;
    if let Some(table) = scope.table(name) {
        return look_up(input, start, name, table);
    }
    if name == PI {
        return keep(input, start, |graph| graph.constant(consts::PI));
    }
    if let Some(node) = bound {
        return Ok(Read { node, kind: Kind::Number, start });
    }
    blank(input)?;
    let elements = scope.vector(name).len();
    if elements > 0 && !called {
        let message =
            format!("`{}` is a vector of {elements} elements, where a single value is expected", excerpt(name));
        let expected = format!("`{0}[1]`, or `sum({0})`", excerpt(name));
        return Err(failure(ExpressionError::new("unknown_name", start, message).expected(&expected)));
    }
    if called && let Some(error) = no_output(scope, name, input.input) {
        return Err(failure(ExpressionError { offset: start, ..error }));
    }
    let (code, message, near) = if called {
        let names = Function::names().chain(scope.tables());
        ("unknown_function", format!("there is no function `{}`", excerpt(name)), nearest(name, names))
    } else {
        ("unknown_name", format!("there is no name `{}` here", excerpt(name)), nearest(name, scope.names().chain([PI])))
    };
    let did_you_mean = synonym(name, called).or(near).map(str::to_owned);
    let remedy = if called { remedies::of_call(name) } else { remedies::of_name(name) };
    let expected = remedy.map(str::to_owned).or_else(|| (!called && did_you_mean.is_none()).then(|| names_of(scope)));
    Err(failure(ExpressionError { did_you_mean, expected, ..ExpressionError::new(code, start, message) }))
}

/// Returns the error for an unknown output such as `v(R1)`, if the scope has other outputs of this name; `rest` is
/// the text after the name.
fn no_output(scope: &Scope, name: &str, rest: &str) -> Option<ExpressionError> {
    const SHOWN: usize = 12;
    let is_like = |other: &&str| other.strip_prefix(name).is_some_and(|rest| rest.starts_with('('));
    let mut others = scope.names().filter(is_like).peekable();
    others.peek()?;
    let output = format!("{name}{}", &rest[..rest.find(')').map_or(rest.len(), |end| end + 1)]);
    let did_you_mean = nearest(&output, scope.names().filter(is_like)).map(str::to_owned);
    let mut list: Vec<String> = others.by_ref().take(SHOWN).map(|name| format!("`{}`", excerpt(name))).collect();
    list.extend(others.next().map(|_| "...".to_owned()));
    let message = format!("there is no `{}`", excerpt(&output));
    let error = ExpressionError { did_you_mean, ..ExpressionError::new("unknown_name", 0, message) };
    Some(error.expected(&list.join(", ")))
}

/// Lists the available names for messages, shortened if there are too many.
fn names_of(scope: &Scope) -> String {
    const SHOWN: usize = 12;
    let mut names = scope.names();
    let mut list: Vec<String> = names.by_ref().take(SHOWN).map(|name| format!("`{}`", excerpt(name))).collect();
    list.push(if names.next().is_some() { "...".to_owned() } else { format!("`{PI}`") });
    format!("a name: {}", list.join(", "))
}

fn call(input: &mut Input, start: usize, name: &str, function: Function) -> Result<Read, Failure> {
    blank(input)?;
    if !input.input.starts_with('(') {
        let write = remedies::of_function(name, input.input);
        return Err(match syntax(input, &format!("`(` after the function `{name}`")) {
            Failure::Final(error) => failure(error.expected(&write)),
            other => other,
        });
    }
    let arguments = arguments(input)?;
    let nodes: Vec<Node> = arguments.iter().map(|read| read.node).collect();
    if !function.takes(nodes.len()) {
        let message = format!("`{name}` takes {}, found {}", function.arity(), nodes.len());
        let error = ExpressionError::new("wrong_arity", start, message);
        return Err(failure(match function {
            Function::Discontinuous(stepped) => error.expected(stepped.usage()),
            _ => error,
        }));
    }
    if let Function::Discontinuous(stepped) = function {
        check_stepped(input, start, name, stepped, &arguments)?;
    }
    keep(input, start, |graph| function.apply(graph, &nodes))
}

/// Parses the value of a table at an argument, such as `f(x)` for a table `f`.
fn look_up(input: &mut Input, start: usize, name: &str, table: &Table) -> Result<Read, Failure> {
    blank(input)?;
    if !input.input.starts_with('(') {
        return Err(syntax(input, &format!("`(` and the argument of the table `{}`", excerpt(name))));
    }
    let arguments = arguments(input)?;
    let [argument] = arguments[..] else {
        let message = format!("the table `{}` takes one argument, found {}", excerpt(name), arguments.len());
        return Err(failure(ExpressionError::new("wrong_arity", start, message)));
    };
    if table.jumps() {
        let what = format!("the table `{}`, with its interpolation \"previous\",", excerpt(name));
        refuse_jump(input, start, &what, &[argument.node], TABLE_AS_SET)?;
    }
    keep(input, start, |graph| graph.lookup(table, argument.node))
}

/// Rejects arguments of a discontinuous function (such as a pulse) that are out of their admissible ranges.
fn check_stepped(
    input: &mut Input,
    start: usize,
    name: &str,
    stepped: Discontinuous,
    arguments: &[Read],
) -> Result<(), Failure> {
    if stepped == Discontinuous::If {
        // Comparisons of unknowns have been rejected by the parser already.
        return conditions("if", [arguments[0]]).map(|_| ());
    }
    let nodes: Vec<Node> = arguments.iter().map(|read| read.node).collect();
    refuse_jump(input, start, &format!("`{name}`"), &nodes, stepped.as_set())?;
    stepped.check(input.state.graph, &nodes).map_err(|OutOfRange { argument, value, expected }| {
        let message = format!("the {argument} of `{name}` is {value}");
        failure(ExpressionError::new("out_of_range", start, message).expected(expected))
    })
}

/// Parses the parenthesised, comma-separated list of arguments of a call, which may be empty.
fn arguments(input: &mut Input) -> Result<Vec<Read>, Failure> {
    open(input)?;
    let mut arguments = Vec::new();
    if preceded(blank, peek(opt(')'))).parse_next(input)?.is_none() {
        arguments.push(term(input)?);
        while preceded(blank, opt(',')).parse_next(input)?.is_some() {
            arguments.push(term(input)?);
        }
    }
    close(input, ", `,` or `)`")?;
    Ok(arguments)
}

/// Rejects a discontinuous function of an unknown (state or variable).
pub(super) fn refuse_jump(input: &Input, start: usize, what: &str, of: &[Node], as_set: &str) -> Result<(), Failure> {
    let State { graph, scope, .. } = &input.state;
    let Some(first) = scope.unknowns() else { return Ok(()) };
    let Some(unknown) = graph.inputs_of(of).into_iter().find(|input| *input >= first) else { return Ok(()) };
    let name = excerpt(scope.name_of_input(graph, unknown));
    let message =
        format!("{what} of `{name}` jumps where no step can end: such functions take only time and parameters");
    Err(failure(ExpressionError::new("jump_of_unknown", start, message).expected(as_set)))
}
