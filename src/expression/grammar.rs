//! The grammar of infix expressions, by precedence climbing (Pratt 1973, *Top down operator precedence*). Terms are
//! added to the graph directly; there is no syntax tree.
//!
//! Recursion is bounded: parentheses, signs and chains of `^` all count towards [`DEEPEST`].

use super::calls::{name, refuse_jump};
use super::conditions::{self, Comparison};
use super::derivative::MAXIMUM_TERMS;
use super::error::ExpressionError;
use super::graph::{Graph, Node};
use super::remedies::{self, found};
use super::scope::{PI, Scope, excerpt};
use super::vectors::Index;
use winnow::combinator::Infix::{Left, Neither, Right};
use winnow::combinator::{Infix, Prefix, alt, dispatch, expression, fail, not, opt, peek, preceded, terminated};
use winnow::error::ParserError;
use winnow::prelude::*;
use winnow::stream::Stateful;
use winnow::token::{any, one_of, take_while};

/// The maximum length of an expression, in bytes.
const LONGEST: usize = 64 * 1024;

/// Greek letters with their names in ASCII.
const GREEK: [(char, &str); 20] = [
    ('\u{3b1}', "alpha"),
    ('\u{3b2}', "beta"),
    ('\u{3b3}', "gamma"),
    ('\u{3b4}', "delta"),
    ('\u{3b5}', "epsilon"),
    ('\u{3b6}', "zeta"),
    ('\u{3b7}', "eta"),
    ('\u{3b8}', "theta"),
    ('\u{3ba}', "kappa"),
    ('\u{3bb}', "lambda"),
    ('\u{3bc}', "mu"),
    ('\u{b5}', "mu"),
    ('\u{3bd}', "nu"),
    ('\u{3be}', "xi"),
    ('\u{3c1}', "rho"),
    ('\u{3c3}', "sigma"),
    ('\u{3c4}', "tau"),
    ('\u{3c6}', "phi"),
    ('\u{3c8}', "psi"),
    ('\u{3c9}', "omega"),
];

/// The maximum nesting depth of an expression: parentheses, signs and chains of `^` count.
const DEEPEST: usize = 200;

/// The state that the parsers share while they parse one text.
#[derive(Debug)]
pub(super) struct State<'s> {
    pub graph: &'s mut Graph,
    pub scope: &'s Scope,
    /// The whole text of the expression that is parsed.
    text: &'s str,
    pub depth: usize,
    /// The index variables of the `sum` calls that enclose the current position of the parser, with their current
    /// values.
    pub indices: Vec<Index>,
}

/// A parsed term, with its position in the text.
#[derive(Clone, Copy, Debug)]
pub(super) struct Read {
    pub node: Node,
    pub kind: Kind,
    /// The byte offset of the start of the term in the text of the expression.
    pub start: usize,
}

/// The kind of a parsed term. Conditions may be used as numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Number,
    /// A comparison without parentheses; if it is the whole expression, the user usually means an inequality.
    Comparison,
    Condition,
}

pub(super) type Input<'i, 's> = Stateful<&'i str, State<'s>>;

/// The failure of a parser at its position in the text.
#[derive(Debug)]
pub(super) enum Failure {
    /// A recoverable failure: the parser may try an alternative.
    Elsewhere,
    /// A final failure: the error is reported.
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
    /// Parses an infix expression with the names bound in `scope`.
    ///
    /// # Errors
    /// The first error in the text, with its position.
    pub fn parse(&mut self, text: &str, scope: &Scope) -> Result<Node, ExpressionError> {
        check_characters(text)?;
        let state = State { graph: self, scope, text, depth: 0, indices: Vec::new() };
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
            Failure::Final(error) => of_inequality(*error, text),
            Failure::Elsewhere => ExpressionError::new("syntax", offset(&input), "expected an expression".to_owned()),
        })
    }
}

/// Extends the error of a text that may be meant as an inequality by the correct form of an inequality.
fn of_inequality(error: ExpressionError, text: &str) -> ExpressionError {
    let difference = if matches!(error.code, "misplaced_condition" | "jump_of_unknown") {
        remedies::of_inequality(text)
    } else {
        None
    };
    let Some(difference) = difference else { return error };
    let otherwise = error.expected.as_deref().map(|otherwise| format!("; otherwise {otherwise}")).unwrap_or_default();
    let expected = format!("the left side of the inequality only, since `>= 0` is implied: {difference}{otherwise}");
    ExpressionError { expected: Some(expected), ..error }
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
        '\u{221a}' => Some("sqrt(x)"),
        '\u{2264}' => Some("<="),
        '\u{2265}' => Some(">="),
        '\u{2260}' => Some("!="),
        _ => GREEK.iter().find(|(letter, _)| *letter == character).map(|(_, name)| *name),
    };
    let did_you_mean = did_you_mean.map(str::to_owned);
    Err(ExpressionError { did_you_mean, ..ExpressionError::new("not_ascii", offset, message) })
}

/// Parses a term of lowest precedence: conditions and their operands.
pub(super) fn term(input: &mut Input) -> Result<Read, Failure> {
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

/// Parses a keyword that is not the prefix of a longer word.
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

/// Checks that the operands of the operator `joint` (`if`, `and`, `or`, `not`) are conditions.
pub(super) fn conditions<const N: usize>(joint: &str, found: [Read; N]) -> Result<[Read; N], Failure> {
    let Some(number) = found.iter().find(|read| read.kind == Kind::Number) else { return Ok(found) };
    let message = format!("`{joint}` takes conditions, and this is a number");
    let error = ExpressionError::new("misplaced_condition", number.start, message);
    Err(failure(error.expected("a comparison, such as `t > 1`")))
}

fn bare_comparison(read: Read) -> Failure {
    let message = "this is a condition, not a number".to_owned();
    let error = ExpressionError::new("misplaced_condition", read.start, message);
    failure(error.expected("a number; a choice is written `if(t > 1, a, b)`"))
}

fn number(input: &mut Input) -> Result<Read, Failure> {
    let start = offset(input);
    let whole = input.input;
    let mantissa = (digits(0), opt(('.', not('.'), digits(0)))).take().parse_next(input)?;
    if mantissa == "." {
        return Err(syntax(input, "a digit"));
    }
    opt((one_of(['e', 'E']), opt(one_of(['+', '-'])), digits(1))).void().parse_next(input)?;
    let literal = &whole[..offset(input) - start];
    // The number literal has the form of a Rust number, so that its conversion cannot fail.
    let value: f64 = literal.parse().unwrap_or(f64::NAN);
    if value.is_finite() && (value != 0.0 || mantissa.bytes().all(|byte| matches!(byte, b'0' | b'.'))) {
        return keep(input, start, |graph| graph.constant(value));
    }
    let message = format!("`{}` is out of the range of a double, 4.9e-324 to 1.8e308", excerpt(literal));
    Err(failure(ExpressionError::new("number_out_of_range", start, message)))
}

pub(super) fn open(input: &mut Input) -> Result<(), Failure> {
    descend(input)?;
    '('.void().parse_next(input)
}

pub(super) fn close(input: &mut Input, otherwise: &str) -> Result<(), Failure> {
    blank(input)?;
    if opt(')').parse_next(input)?.is_none() {
        return Err(missing_operator(input, otherwise));
    }
    input.state.depth -= 1;
    Ok(())
}

pub(super) fn blank(input: &mut Input) -> Result<(), Failure> {
    take_while(0.., [' ', '\t', '\n', '\r']).void().parse_next(input)
}

fn digits<'i, 's>(least: usize) -> impl Parser<Input<'i, 's>, &'i str, Failure> {
    take_while(least.., '0'..='9')
}

pub(super) fn identifier<'i>(input: &mut Input<'i, '_>) -> Result<&'i str, Failure> {
    take_while(1.., ('a'..='z', 'A'..='Z', '0'..='9', '_')).parse_next(input)
}

/// Increases the nesting depth of the expression that is parsed; the caller decreases it at the end of the construct.
/// Fails beyond the limit.
pub(super) fn descend(input: &mut Input) -> Result<(), Failure> {
    input.state.depth += 1;
    if input.state.depth <= DEEPEST {
        return Ok(());
    }
    let message = format!("parentheses, signs and powers nest deeper than {DEEPEST}");
    Err(failure(ExpressionError::new("too_deep", offset(input), message)))
}

/// Adds the term of a number to the graph of expressions; fails if the graph exceeds its size limit.
pub(super) fn keep(input: &mut Input, start: usize, add: impl FnOnce(&mut Graph) -> Node) -> Result<Read, Failure> {
    let node = add(input.state.graph);
    if input.state.graph.len() > MAXIMUM_TERMS {
        return Err(failure(ExpressionError::too_many_nodes(offset(input))));
    }
    Ok(Read { node, kind: Kind::Number, start })
}

/// Adds the term of a condition to the graph of expressions; fails if the graph exceeds its size limit.
fn condition(input: &mut Input, start: usize, add: impl FnOnce(&mut Graph) -> Node) -> Result<Read, Failure> {
    keep(input, start, add).map(|read| Read { kind: Kind::Condition, ..read })
}

pub(super) fn offset(input: &Input) -> usize {
    input.state.text.len() - input.input.len()
}

pub(super) fn failure(error: ExpressionError) -> Failure {
    Failure::Final(Box::new(error))
}

pub(super) fn syntax(input: &Input, expected: &str) -> Failure {
    let (before, rest) = input.state.text.split_at(offset(input));
    let remedy = remedies::of_operand(before.trim_end(), rest).map(|remedy| format!("; {remedy}")).unwrap_or_default();
    let message = format!("expected {expected}, found {}{remedy}", found(rest));
    let error = ExpressionError::new("syntax", offset(input), message);
    failure(if input.state.text.trim().is_empty() {
        error.expected("an expression, such as `-k*x`, or a number")
    } else {
        error
    })
}

/// Returns the error for text after an operand that does not continue the expression.
fn missing_operator(input: &Input, otherwise: &str) -> Failure {
    let (before, rest) = input.state.text.split_at(offset(input));
    let remedy = remedies::of_operator(before, rest, input.state.scope);
    let remedy = remedy.map(|remedy| format!("; {remedy}")).unwrap_or_default();
    let message = format!("expected an operator{otherwise}, found {}{remedy}", found(rest));
    failure(ExpressionError::new("syntax", offset(input), message))
}
