//! Vectors: names with integer indices, `x[3]` and `x[i + 1, j]`, and sums over index ranges,
//! `sum(c[i]*x[i] for i in 1..n)`. An index is an expression in numbers, indices and parameters with an integer value;
//! values of parameters in indices are recorded as assumptions. A sum is expanded to a chain of additions.

use super::error::ExpressionError;
use super::grammar::{
    Failure, Input, Kind, Read, blank, close, descend, failure, identifier, keep, offset, open, syntax, term,
};
use super::graph::Node;
use super::parameters::Assumption;
use super::scope::{excerpt, nearest};
use std::fmt::Write;
use winnow::combinator::opt;
use winnow::prelude::*;

/// Limit on the bytes parsed repeatedly for the summands of all sums of a graph, which bounds the parsing time of
/// short texts.
const MOST_READ: usize = 16 << 20;

/// The index variable of a sum that encloses the parsed text, with its current value.
#[derive(Clone, Debug)]
pub(super) struct Index {
    name: String,
    value: i64,
}

/// Returns the value of the innermost index variable of a sum with this name.
pub(super) fn index(indices: &[Index], name: &str) -> Option<f64> {
    indices.iter().rev().find(|index| index.name == name).map(|index| index.value as f64)
}

/// Parses an element of a vector, starting at the bracket after its name.
pub(super) fn element(input: &mut Input, start: usize, name: &str) -> Result<Read, Failure> {
    descend(input)?;
    '['.void().parse_next(input)?;
    let mut key = format!("{name}[");
    loop {
        let read = term(input)?;
        // Formatting an integer into a string cannot fail.
        let _ = write!(key, "{}", whole(input, read)?);
        blank(input)?;
        if opt(']').parse_next(input)?.is_some() {
            break;
        }
        if opt(',').parse_next(input)?.is_none() {
            return Err(syntax(input, "an operator, `,` or `]`"));
        }
        key.push(',');
    }
    key.push(']');
    input.state.depth -= 1;
    match input.state.scope.get(&key) {
        Some(node) => Ok(Read { node, kind: Kind::Number, start }),
        None => Err(failure(missing(input, start, name, &key))),
    }
}

/// Returns the error for an unknown element of a vector.
fn missing(input: &Input, start: usize, name: &str, key: &str) -> ExpressionError {
    let scope = input.state.scope;
    let elements = scope.vector(name).len();
    if elements == 0 {
        let message = format!("there is no name `{}` here", excerpt(key));
        let vectors = scope.vectors();
        let near = nearest(name, vectors).map(str::to_owned);
        let expected = format!("names with indices, declared as `\"{}[1..n]\"`", excerpt(name));
        return ExpressionError { did_you_mean: near, ..ExpressionError::new("unknown_name", start, message) }
            .expected(&expected);
    }
    let indices = |other: &str| {
        let inside = other.strip_prefix(name)?.strip_prefix('[')?.strip_suffix(']')?;
        inside.split(',').map(|index| index.parse::<i64>().ok()).collect::<Option<Vec<i64>>>()
    };
    let all = || scope.names().filter_map(|other| Some((indices(other)?, other)));
    let ends = [all().min(), all().max()].map(|end| end.map_or(String::new(), |(_, name)| excerpt(name)));
    let message = format!("there is no `{}`", excerpt(key));
    let expected = match ends {
        [first, last] if first == last => format!("`{first}`"),
        [first, last] => format!("one of the {elements} elements `{first}` to `{last}`"),
    };
    ExpressionError::new("index_out_of_range", start, message).expected(&expected)
}

/// Parses a sum, starting at the parenthesis after its name: the sum of all elements of a vector, or of a term over
/// indices.
pub(super) fn sum(input: &mut Input, start: usize) -> Result<Read, Failure> {
    blank(input)?;
    open(input)?;
    blank(input)?;
    let body = input.input;
    if let Some(nodes) = whole_vector(input)? {
        close(input, " or `)`")?;
        return add_up(input, start, &nodes);
    }
    // The indices of a sum are declared after its term, but are needed to parse the term.
    let Some(binders) = behind_for(body) else {
        let message = "a sum takes a vector or a term with its indices".to_owned();
        let error = ExpressionError::new("wrong_arity", start, message);
        return Err(failure(error.expected("`sum(x)`, or `sum(x[i] for i in 1..n)`")));
    };
    input.input = &body[binders..];
    let ranges = self::binders(input)?;
    close(input, ", `,` or `)`")?;
    let after = input.input;
    let outer = input.state.indices.len();
    let nodes = summands(input, start, (body, binders), &ranges);
    input.state.indices.truncate(outer);
    input.input = after;
    add_up(input, start, &nodes?)
}

/// Parses the term of a sum once for each value of its indices, which are declared from byte `binders` on; returns the
/// summands.
fn summands<'i>(
    input: &mut Input<'i, '_>,
    start: usize,
    (body, binders): (&'i str, usize),
    ranges: &[(String, i64, i64)],
) -> Result<Vec<Node>, Failure> {
    let mut nodes = Vec::new();
    if ranges.iter().any(|(_, first, last)| first > last) {
        return Ok(nodes);
    }
    let outer = input.state.indices.len();
    input.state.indices.extend(ranges.iter().map(|(name, first, _)| Index { name: name.clone(), value: *first }));
    loop {
        input.state.graph.read_again += binders;
        if input.state.graph.read_again > MOST_READ {
            let message = "the sums of all expressions together have too many terms".to_owned();
            return Err(failure(ExpressionError::new("too_many_nodes", start, message)));
        }
        input.input = body;
        nodes.push(term(input)?.node);
        blank(input)?;
        if !input.input.starts_with("for") {
            return Err(syntax(input, "an operator or `for`"));
        }
        // Of several indices of a sum, the last one varies fastest.
        let next = (0..ranges.len()).rev().find(|&k| input.state.indices[outer + k].value < ranges[k].2);
        let Some(k) = next else { return Ok(nodes) };
        input.state.indices[outer + k].value += 1;
        (k + 1..ranges.len()).for_each(|k| input.state.indices[outer + k].value = ranges[k].1);
    }
}

fn add_up(input: &mut Input, start: usize, nodes: &[Node]) -> Result<Read, Failure> {
    let Some((&first, rest)) = nodes.split_first() else {
        return keep(input, start, |graph| graph.constant(0.0));
    };
    rest.iter().try_fold(Read { node: first, kind: Kind::Number, start }, |sum, &node| {
        keep(input, start, |graph| graph.add(sum.node, node))
    })
}

/// Returns the elements of a vector, if the argument is the name of a vector alone.
fn whole_vector(input: &mut Input) -> Result<Option<Vec<Node>>, Failure> {
    let before = input.input;
    let name = opt(identifier).parse_next(input)?.unwrap_or_default();
    blank(input)?;
    let nodes = input.state.scope.vector(name);
    if input.input.starts_with(')') && !nodes.is_empty() {
        return Ok(Some(nodes.to_vec()));
    }
    input.input = before;
    Ok(None)
}

/// Returns the byte offset after the keyword `for` of the innermost sum at the beginning of the text.
fn behind_for(text: &str) -> Option<usize> {
    let mut depth = 0_usize;
    let mut after_word = false;
    for (at, byte) in text.bytes().enumerate() {
        match byte {
            b'(' | b'[' => depth += 1,
            b')' | b']' if depth == 0 => return None,
            b')' | b']' => depth -= 1,
            b'f' if depth == 0 && !after_word && text[at..].starts_with("for") => {
                let end = text.as_bytes().get(at + 3);
                if end.is_some_and(|byte| byte.is_ascii_whitespace()) {
                    return Some(at + 3);
                }
            }
            _ => {}
        }
        after_word = byte.is_ascii_alphanumeric() || byte == b'_';
    }
    None
}

/// Parses the indices of a sum with their first and last values.
fn binders(input: &mut Input) -> Result<Vec<(String, i64, i64)>, Failure> {
    let mut found: Vec<(String, i64, i64)> = Vec::new();
    loop {
        blank(input)?;
        let start = offset(input);
        let name = opt(identifier).parse_next(input)?.unwrap_or_default().to_owned();
        let is_taken = index(&input.state.indices, &name).is_some() || found.iter().any(|(other, ..)| *other == name);
        if name.is_empty() || name.starts_with(|c: char| c.is_ascii_digit()) || is_taken {
            let message = "the index of a sum must be a name that is not an index already".to_owned();
            return Err(failure(
                ExpressionError::new("syntax", start, message).expected("such as `sum(x[k] for k in 1..n)`"),
            ));
        }
        blank(input)?;
        if opt("in").parse_next(input)?.is_none() && opt("=").parse_next(input)?.is_none() {
            return Err(syntax(input, "`in` and a range such as `1..n`"));
        }
        let read = term(input)?;
        let first = whole(input, read)?;
        blank(input)?;
        if opt("..").parse_next(input)?.is_none() && opt(":").parse_next(input)?.is_none() {
            return Err(syntax(input, "`..` and the last value of the index"));
        }
        let read = term(input)?;
        found.push((name, first, whole(input, read)?));
        blank(input)?;
        if opt(',').parse_next(input)?.is_none() {
            return Ok(found);
        }
    }
}

/// Returns the integer value of a parsed index of a vector element or of a sum.
fn whole(input: &mut Input, read: Read) -> Result<i64, Failure> {
    const MOST: f64 = 1e9;
    let graph = &mut *input.state.graph;
    let value = graph.value(read.node);
    graph.assume(read.node, Assumption::Value);
    match value {
        Some(value) if value.fract() == 0.0 && value.abs() <= MOST => Ok(value as i64),
        value => {
            let message = match value {
                Some(value) => format!("an index must be a whole number, found {value}"),
                None => "an index must be a constant whole number".to_owned(),
            };
            let error = ExpressionError::new("index_out_of_range", read.start, message);
            Err(failure(error.expected("whole numbers, indices, and parameters with whole values")))
        }
    }
}
