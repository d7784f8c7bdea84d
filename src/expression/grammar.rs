//! The grammar of infix text, by precedence climbing (Pratt 1973, *Top down operator precedence*). Terms go straight
//! into the graph; there is no syntax tree.
//!
//! Recursion is bounded: parentheses, signs and `^` chains each count towards [`DEEPEST`].

use super::derivative::MAXIMUM_TERMS;
use super::error::ExpressionError;
use super::function::{Function, synonym};
use super::graph::{Graph, Node};
use super::scope::{PI, Scope, excerpt, nearest};
use std::f64::consts;
use winnow::combinator::Infix::{Left, Right};
use winnow::combinator::{Infix, Prefix, alt, dispatch, expression, fail, opt, peek, preceded};
use winnow::error::ParserError;
use winnow::prelude::*;
use winnow::stream::Stateful;
use winnow::token::{any, one_of, take_while};

/// The longest text of one expression, in bytes.
const LONGEST: usize = 64 * 1024;

/// The deepest nesting.
const DEEPEST: usize = 200;

/// What the parsers carry along.
#[derive(Debug)]
struct State<'s> {
    graph: &'s mut Graph,
    scope: &'s Scope,
    /// The length of the whole text.
    length: usize,
    depth: usize,
}

type Input<'i, 's> = Stateful<&'i str, State<'s>>;

/// Why a parser did not go on.
#[derive(Debug)]
enum Failure {
    /// Something else may stand here.
    Elsewhere,
    /// Nothing may.
    Final(Box<ExpressionError>),
}

impl<'i, 's> ParserError<Input<'i, 's>> for Failure {
    type Inner = Self;

    fn from_input(_input: &Input<'i, 's>) -> Self {
        Self::Elsewhere
    }

    fn is_backtrack(&self) -> bool {
        matches!(self, Self::Elsewhere)
    }

    fn into_inner(self) -> Result<Self, Self> {
        Ok(self)
    }
}

impl Graph {
    /// Reads an infix expression in the names of `scope`.
    ///
    /// # Errors
    /// The first thing in the text that cannot be, with its place.
    pub fn parse(&mut self, text: &str, scope: &Scope) -> Result<Node, ExpressionError> {
        check_characters(text)?;
        let state = State { graph: self, scope, length: text.len(), depth: 0 };
        let mut input = Stateful { input: text, state };
        let parsed = term(&mut input).and_then(|node| {
            blank(&mut input)?;
            if input.input.is_empty() { Ok(node) } else { Err(missing_operator(&input, " or the end")) }
        });
        parsed.map_err(|failure| match failure {
            Failure::Final(error) => *error,
            Failure::Elsewhere => ExpressionError::new("syntax", offset(&input), "expected an expression".to_owned()),
        })
    }
}

fn check_characters(text: &str) -> Result<(), ExpressionError> {
    if text.len() > LONGEST {
        let message = format!("an expression has at most {LONGEST} bytes, this one has {}", text.len());
        return Err(ExpressionError::new("too_long", LONGEST, message));
    }
    let Some((offset, character)) = text.char_indices().find(|(_, character)| !character.is_ascii()) else {
        return Ok(());
    };
    let message = format!("an expression is written in ASCII, found U+{:04X}", u32::from(character));
    let did_you_mean = match character {
        '\u{2212}' | '\u{2013}' => Some("-"),
        '\u{d7}' | '\u{b7}' | '\u{22c5}' => Some("*"),
        '\u{f7}' => Some("/"),
        '\u{b2}' => Some("^2"),
        '\u{b3}' => Some("^3"),
        '\u{3c0}' => Some(PI),
        _ => None,
    };
    let did_you_mean = did_you_mean.map(str::to_owned);
    Err(ExpressionError { did_you_mean, ..ExpressionError::new("not_ascii", offset, message) })
}

/// A sum, the loosest construct.
fn term(input: &mut Input) -> Result<Node, Failure> {
    expression(operand).prefix(sign).infix(operator).parse_next(input)
}

fn sign<'i, 's>(input: &mut Input<'i, 's>) -> Result<Prefix<Input<'i, 's>, Node, Failure>, Failure> {
    blank(input)?;
    match opt(one_of(['-', '+'])).parse_next(input)? {
        None => Err(syntax(input, "a number, a name or `(`")),
        Some(sign) => {
            descend(input)?;
            let apply: fn(&mut Input<'i, 's>, Node) -> Result<Node, Failure> = match sign {
                '-' => |input, a| {
                    input.state.depth -= 1;
                    keep(input, |graph| graph.negate(a))
                },
                _ => |input, a| {
                    input.state.depth -= 1;
                    Ok(a)
                },
            };
            Ok(Prefix(11, apply))
        }
    }
}

fn operator<'i, 's>(input: &mut Input<'i, 's>) -> Result<Infix<Input<'i, 's>, Node, Failure>, Failure> {
    let symbol = preceded(blank, alt(("**", "^", "*", "/", "+", "-"))).parse_next(input)?;
    Ok(match symbol {
        "+" => Left(5, |input, a, b| keep(input, |graph| graph.add(a, b))),
        "-" => Left(5, |input, a, b| keep(input, |graph| graph.subtract(a, b))),
        "*" => Left(7, |input, a, b| keep(input, |graph| graph.multiply(a, b))),
        "/" => Left(7, |input, a, b| keep(input, |graph| graph.divide(a, b))),
        _ => {
            descend(input)?;
            Right(13, |input, a, b| {
                input.state.depth -= 1;
                keep(input, |graph| graph.power(a, b))
            })
        }
    })
}

fn operand(input: &mut Input) -> Result<Node, Failure> {
    blank(input)?;
    dispatch! {peek(any);
        '0'..='9' | '.' => number,
        'a'..='z' | 'A'..='Z' | '_' => name,
        '(' => group,
        _ => fail,
    }
    .parse_next(input)
}

fn group(input: &mut Input) -> Result<Node, Failure> {
    open(input)?;
    let node = term(input)?;
    close(input, " or `)`")?;
    Ok(node)
}

fn number(input: &mut Input) -> Result<Node, Failure> {
    let start = offset(input);
    let whole = input.input;
    let mantissa = (digits(0), opt(('.', digits(0)))).take().parse_next(input)?;
    if mantissa == "." {
        return Err(syntax(input, "a digit"));
    }
    opt((one_of(['e', 'E']), opt(one_of(['+', '-'])), digits(1))).void().parse_next(input)?;
    let literal = &whole[..offset(input) - start];
    // The form is that of a number already.
    let value: f64 = literal.parse().unwrap_or(f64::NAN);
    if value.is_finite() && (value != 0.0 || mantissa.bytes().all(|byte| matches!(byte, b'0' | b'.'))) {
        return keep(input, |graph| graph.constant(value));
    }
    let message = format!("`{}` is out of the range of a double, 4.9e-324 to 1.8e308", excerpt(literal));
    Err(failure(ExpressionError::new("number_out_of_range", start, message)))
}

/// A name of the scope, or a function with its arguments.
fn name(input: &mut Input) -> Result<Node, Failure> {
    let start = offset(input);
    if let Some(output) = input.state.scope.output_at(input.input) {
        let node = input.state.scope.get(output);
        take_while(output.len()..=output.len(), |_| true).void().parse_next(input)?;
        return node.ok_or(Failure::Elsewhere);
    }
    let name = identifier.parse_next(input)?;
    if let Some(function) = Function::named(name) {
        return call(input, start, name, function);
    }
    if name == PI {
        return keep(input, |graph| graph.constant(consts::PI));
    }
    if let Some(node) = input.state.scope.get(name) {
        return Ok(node);
    }
    blank(input)?;
    let called = input.input.starts_with('(');
    let (code, message, near) = if called {
        ("unknown_function", format!("there is no function `{}`", excerpt(name)), nearest(name, Function::names()))
    } else {
        let names = input.state.scope.names().chain([PI]);
        ("unknown_name", format!("nothing is called `{}` here", excerpt(name)), nearest(name, names))
    };
    let did_you_mean = synonym(name, called).or(near).map(str::to_owned);
    Err(failure(ExpressionError { did_you_mean, ..ExpressionError::new(code, start, message) }))
}

fn call(input: &mut Input, start: usize, name: &str, function: Function) -> Result<Node, Failure> {
    blank(input)?;
    if !input.input.starts_with('(') {
        return Err(syntax(input, &format!("`(` after the function `{name}`")));
    }
    let arguments = arguments(input)?;
    if !function.takes(arguments.len()) {
        let message = format!("`{name}` takes {}, found {}", function.arity(), arguments.len());
        return Err(failure(ExpressionError::new("wrong_arity", start, message)));
    }
    keep(input, |graph| function.apply(graph, &arguments))
}

/// Parenthesised, between commas; there may be none.
fn arguments(input: &mut Input) -> Result<Vec<Node>, Failure> {
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

fn open(input: &mut Input) -> Result<(), Failure> {
    descend(input)?;
    '('.void().parse_next(input)
}

fn close(input: &mut Input, otherwise: &str) -> Result<(), Failure> {
    blank(input)?;
    if opt(')').parse_next(input)?.is_none() {
        return Err(missing_operator(input, otherwise));
    }
    input.state.depth -= 1;
    Ok(())
}

fn blank(input: &mut Input) -> Result<(), Failure> {
    take_while(0.., [' ', '\t', '\n', '\r']).void().parse_next(input)
}

fn digits<'i, 's>(least: usize) -> impl Parser<Input<'i, 's>, &'i str, Failure> {
    take_while(least.., '0'..='9')
}

fn identifier<'i>(input: &mut Input<'i, '_>) -> Result<&'i str, Failure> {
    take_while(1.., ('a'..='z', 'A'..='Z', '0'..='9', '_')).parse_next(input)
}

/// One level deeper. Whoever ascends again takes the level back.
fn descend(input: &mut Input) -> Result<(), Failure> {
    input.state.depth += 1;
    if input.state.depth <= DEEPEST {
        return Ok(());
    }
    let message = format!("parentheses, signs and powers nest deeper than {DEEPEST}");
    Err(failure(ExpressionError::new("too_deep", offset(input), message)))
}

/// Adds to the graph, which is bounded.
fn keep(input: &mut Input, add: impl FnOnce(&mut Graph) -> Node) -> Result<Node, Failure> {
    let node = add(input.state.graph);
    if input.state.graph.len() > MAXIMUM_TERMS {
        return Err(failure(ExpressionError::too_many_nodes(offset(input))));
    }
    Ok(node)
}

fn offset(input: &Input) -> usize {
    input.state.length - input.input.len()
}

fn failure(error: ExpressionError) -> Failure {
    Failure::Final(Box::new(error))
}

fn syntax(input: &Input, expected: &str) -> Failure {
    failure(ExpressionError::new("syntax", offset(input), format!("expected {expected}, found {}", found(input.input))))
}

/// After an operand comes something that continues no expression.
fn missing_operator(input: &Input, otherwise: &str) -> Failure {
    let operand_follows = |next: char| next.is_ascii_alphanumeric() || matches!(next, '_' | '(' | '.');
    let remedy = if input.input.starts_with(operand_follows) { "; a product is written with `*`" } else { "" };
    let found = found(input.input);
    let message = format!("expected an operator{otherwise}, found {found}{remedy}");
    failure(ExpressionError::new("syntax", offset(input), message))
}

/// The next token, as people would name it.
fn found(rest: &str) -> String {
    let in_word = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'.');
    match rest.chars().next() {
        None => "the end".to_owned(),
        Some(control) if control.is_control() => format!("the control character U+{:04X}", u32::from(control)),
        Some(first) => match rest.bytes().take_while(in_word).count() {
            0 => format!("`{first}`"),
            length => format!("`{}`", excerpt(&rest[..length])),
        },
    }
}
