//! The grammar of infix text, by precedence climbing (Pratt 1973, *Top down operator precedence*). Terms go straight
//! into the graph; there is no syntax tree.
//!
//! Recursion is bounded: parentheses, signs and `^` chains each count towards [`DEEPEST`].

use super::conditions::{self, Comparison};
use super::derivative::MAXIMUM_TERMS;
use super::error::ExpressionError;
use super::function::{Function, synonym};
use super::graph::{Graph, Node};
use super::remedies::{self, found};
use super::scope::{PI, Scope, WORDS, excerpt, nearest};
use super::stepped::{OutOfRange, Stepped};
use super::table::Table;
use std::f64::consts;
use winnow::combinator::Infix::{Left, Neither, Right};
use winnow::combinator::{Infix, Prefix, alt, dispatch, expression, fail, not, opt, peek, preceded, terminated};
use winnow::error::ParserError;
use winnow::prelude::*;
use winnow::stream::Stateful;
use winnow::token::{any, one_of, take_while};

/// The longest text of one expression, in bytes.
const LONGEST: usize = 64 * 1024;

/// What to write in the place of a table of states that jumps.
const TABLE_AS_SET: &str = "\"linear\" or \"pchip\"; or a variable in a set for each jump: at a = k the table rises by its \
     height times z, with z in the box [0, 1] and the inequality k - a";

/// The deepest nesting.
const DEEPEST: usize = 200;

/// What the parsers carry along.
#[derive(Debug)]
struct State<'s> {
    graph: &'s mut Graph,
    scope: &'s Scope,
    /// The whole text.
    text: &'s str,
    depth: usize,
}

/// What was read.
#[derive(Clone, Copy, Debug)]
struct Read {
    node: Node,
    kind: Kind,
    /// Where it starts.
    start: usize,
}

/// What kind of a thing was read. A condition may stand for the number that it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Number,
    /// A comparison without parentheses, which by itself is mostly an inequality that someone means.
    Comparison,
    Condition,
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
        let state = State { graph: self, scope, text, depth: 0 };
        let mut input = Stateful { input: text, state };
        let parsed = term(&mut input).and_then(|read| {
            blank(&mut input)?;
            match (input.input.is_empty(), read.kind) {
                (false, _) => Err(missing_operator(&input, " or the end")),
                (true, Kind::Comparison) => Err(bare_comparison(read)),
                (true, _) => Ok(read.node),
            }
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

/// The loosest construct: conditions, and what they compare.
fn term(input: &mut Input) -> Result<Read, Failure> {
    expression(operand).prefix(sign).infix(operator).parse_next(input)
}

fn sign<'i, 's>(input: &mut Input<'i, 's>) -> Result<Prefix<Input<'i, 's>, Read, Failure>, Failure> {
    blank(input)?;
    let Some(sign) = opt(alt(("-", "+", word("not")))).parse_next(input)? else {
        return Err(syntax(input, "a number, a name or `(`"));
    };
    descend(input)?;
    Ok(match sign {
        "-" => Prefix(11, |input: &mut Input<'i, 's>, a| {
            input.state.depth -= 1;
            keep(input, a.start, |graph| graph.negate(a.node))
        }),
        "+" => Prefix(11, |input: &mut Input<'i, 's>, a| {
            input.state.depth -= 1;
            Ok(Read { kind: Kind::Number, ..a })
        }),
        _ => Prefix(3, |input: &mut Input<'i, 's>, a| {
            input.state.depth -= 1;
            let [a] = conditions("not", [a])?;
            condition(input, a.start, |graph| graph.not(a.node))
        }),
    })
}

fn operator<'i, 's>(input: &mut Input<'i, 's>) -> Result<Infix<Input<'i, 's>, Read, Failure>, Failure> {
    let arithmetic = alt(("**", "^", "*", "/", "+", "-"));
    let comparisons = alt(("<=", ">=", "==", "!=", "<", ">"));
    let symbol = preceded(blank, alt((arithmetic, comparisons, word("and"), word("or")))).parse_next(input)?;
    Ok(match symbol {
        "or" => Left(1, |input, a, b| {
            let [a, b] = conditions("or", [a, b])?;
            condition(input, a.start, |graph| graph.or(a.node, b.node))
        }),
        "and" => Left(2, |input, a, b| {
            let [a, b] = conditions("and", [a, b])?;
            condition(input, a.start, |graph| graph.multiply(a.node, b.node))
        }),
        "<" => Neither(4, |input, a, b| compare(input, Comparison::Less, a, b)),
        "<=" => Neither(4, |input, a, b| compare(input, Comparison::LessOrEqual, a, b)),
        ">" => Neither(4, |input, a, b| compare(input, Comparison::Greater, a, b)),
        ">=" => Neither(4, |input, a, b| compare(input, Comparison::GreaterOrEqual, a, b)),
        "==" => Neither(4, |input, a, b| compare(input, Comparison::Equal, a, b)),
        "!=" => Neither(4, |input, a, b| compare(input, Comparison::Unequal, a, b)),
        "+" => Left(5, |input, a, b| keep(input, a.start, |graph| graph.add(a.node, b.node))),
        "-" => Left(5, |input, a, b| keep(input, a.start, |graph| graph.subtract(a.node, b.node))),
        "*" => Left(7, |input, a, b| keep(input, a.start, |graph| graph.multiply(a.node, b.node))),
        "/" => Left(7, |input, a, b| keep(input, a.start, |graph| graph.divide(a.node, b.node))),
        _ => {
            descend(input)?;
            Right(13, |input, a, b| {
                input.state.depth -= 1;
                keep(input, a.start, |graph| graph.power(a.node, b.node))
            })
        }
    })
}

/// A word of the language, and not the beginning of a longer one.
fn word<'i, 's>(word: &'static str) -> impl Parser<Input<'i, 's>, &'i str, Failure> {
    terminated(word, not(one_of(('a'..='z', 'A'..='Z', '0'..='9', '_'))))
}

fn operand(input: &mut Input) -> Result<Read, Failure> {
    blank(input)?;
    dispatch! {peek(any);
        '0'..='9' | '.' => number,
        'a'..='z' | 'A'..='Z' | '_' => name,
        '(' => group,
        _ => fail,
    }
    .parse_next(input)
}

fn group(input: &mut Input) -> Result<Read, Failure> {
    let start = offset(input);
    open(input)?;
    let read = term(input)?;
    close(input, " or `)`")?;
    let kind = if read.kind == Kind::Comparison { Kind::Condition } else { read.kind };
    Ok(Read { kind, start, ..read })
}

fn compare(input: &mut Input, comparison: Comparison, a: Read, b: Read) -> Result<Read, Failure> {
    refuse_jump(input, a.start, "a comparison", &[a.node, b.node], conditions::AS_SET)?;
    let read = condition(input, a.start, |graph| comparison.apply(graph, a.node, b.node))?;
    Ok(Read { kind: Kind::Comparison, ..read })
}

/// What `joint` takes.
fn conditions<const N: usize>(joint: &str, found: [Read; N]) -> Result<[Read; N], Failure> {
    let Some(number) = found.iter().find(|read| read.kind == Kind::Number) else { return Ok(found) };
    let message = format!("`{joint}` takes conditions, and this is a number");
    let error = ExpressionError::new("misplaced_condition", number.start, message);
    Err(failure(error.expected("a comparison, such as `t > 1`")))
}

fn bare_comparison(read: Read) -> Failure {
    let message = "this is a condition and no number".to_owned();
    let error = ExpressionError::new("misplaced_condition", read.start, message);
    let expected =
        "of an inequality the left side alone, as `>= 0` is understood; a choice is written `if(t > 1, a, b)`";
    failure(error.expected(expected))
}

/// Refuses what jumps with something that is solved for.
fn refuse_jump(input: &Input, start: usize, what: &str, of: &[Node], as_set: &str) -> Result<(), Failure> {
    let State { graph, scope, .. } = &input.state;
    let Some(first) = scope.unknowns() else { return Ok(()) };
    let Some(unknown) = graph.inputs_of(of).into_iter().find(|input| *input >= first) else { return Ok(()) };
    let name = excerpt(scope.name_of_input(graph, unknown));
    let message =
        format!("{what} of `{name}` jumps with it, where no step of a solve ends: these are of time and parameters");
    Err(failure(ExpressionError::new("jump_of_unknown", start, message).expected(as_set)))
}

fn number(input: &mut Input) -> Result<Read, Failure> {
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
        return keep(input, start, |graph| graph.constant(value));
    }
    let message = format!("`{}` is out of the range of a double, 4.9e-324 to 1.8e308", excerpt(literal));
    Err(failure(ExpressionError::new("number_out_of_range", start, message)))
}

/// A name of the scope, or a function with its arguments.
fn name(input: &mut Input) -> Result<Read, Failure> {
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
    let (code, message, near) = if called {
        let names = Function::names().chain(scope.tables());
        ("unknown_function", format!("there is no function `{}`", excerpt(name)), nearest(name, names))
    } else {
        (
            "unknown_name",
            format!("nothing is called `{}` here", excerpt(name)),
            nearest(name, scope.names().chain([PI])),
        )
    };
    let did_you_mean = synonym(name, called).or(near).map(str::to_owned);
    Err(failure(ExpressionError { did_you_mean, ..ExpressionError::new(code, start, message) }))
}

fn call(input: &mut Input, start: usize, name: &str, function: Function) -> Result<Read, Failure> {
    blank(input)?;
    if !input.input.starts_with('(') {
        return Err(syntax(input, &format!("`(` after the function `{name}`")));
    }
    let arguments = arguments(input)?;
    let nodes: Vec<Node> = arguments.iter().map(|read| read.node).collect();
    if !function.takes(nodes.len()) {
        let message = format!("`{name}` takes {}, found {}", function.arity(), nodes.len());
        let error = ExpressionError::new("wrong_arity", start, message);
        return Err(failure(match function {
            Function::Stepped(stepped) => error.expected(stepped.usage()),
            _ => error,
        }));
    }
    if let Function::Stepped(stepped) = function {
        check_stepped(input, start, name, stepped, &arguments)?;
    }
    keep(input, start, |graph| function.apply(graph, &nodes))
}

/// A table at its argument.
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

/// Refuses arguments that a function that jumps does not take.
fn check_stepped(
    input: &mut Input,
    start: usize,
    name: &str,
    stepped: Stepped,
    arguments: &[Read],
) -> Result<(), Failure> {
    if stepped == Stepped::If {
        // What is compared was refused already if it jumps with an unknown.
        return conditions("if", [arguments[0]]).map(|_| ());
    }
    let nodes: Vec<Node> = arguments.iter().map(|read| read.node).collect();
    refuse_jump(input, start, &format!("`{name}`"), &nodes, stepped.as_set())?;
    stepped.check(input.state.graph, &nodes).map_err(|OutOfRange { argument, value, expected }| {
        let message = format!("the {argument} of `{name}` is {value}");
        failure(ExpressionError::new("out_of_range", start, message).expected(expected))
    })
}

/// Parenthesised, between commas; there may be none.
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

/// Adds a number to the graph, which is bounded.
fn keep(input: &mut Input, start: usize, add: impl FnOnce(&mut Graph) -> Node) -> Result<Read, Failure> {
    let node = add(input.state.graph);
    if input.state.graph.len() > MAXIMUM_TERMS {
        return Err(failure(ExpressionError::too_many_nodes(offset(input))));
    }
    Ok(Read { node, kind: Kind::Number, start })
}

/// The same of a condition.
fn condition(input: &mut Input, start: usize, add: impl FnOnce(&mut Graph) -> Node) -> Result<Read, Failure> {
    keep(input, start, add).map(|read| Read { kind: Kind::Condition, ..read })
}

fn offset(input: &Input) -> usize {
    input.state.text.len() - input.input.len()
}

fn failure(error: ExpressionError) -> Failure {
    Failure::Final(Box::new(error))
}

fn syntax(input: &Input, expected: &str) -> Failure {
    let (before, rest) = input.state.text.split_at(offset(input));
    let remedy = remedies::of_operand(before.trim_end(), rest).map(|remedy| format!("; {remedy}")).unwrap_or_default();
    let message = format!("expected {expected}, found {}{remedy}", found(rest));
    failure(ExpressionError::new("syntax", offset(input), message))
}

/// After an operand comes something that continues no expression.
fn missing_operator(input: &Input, otherwise: &str) -> Failure {
    let (before, rest) = input.state.text.split_at(offset(input));
    let remedy = remedies::of_operator(before, rest, input.state.scope);
    let remedy = remedy.map(|remedy| format!("; {remedy}")).unwrap_or_default();
    let message = format!("expected an operator{otherwise}, found {}{remedy}", found(rest));
    failure(ExpressionError::new("syntax", offset(input), message))
}
