//! An expression as the user writes it: a number, or text in infix notation.

use serde::Serialize;
use serde::de::{Deserialize, Deserializer, Error, Visitor};
use std::fmt;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// An expression of a specification: a number, or a string in infix notation.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Expression {
    /// An expression that is a constant number.
    Number(f64),
    /// The text of an expression in infix notation, not parsed yet.
    Text(String),
}

impl From<f64> for Expression {
    fn from(value: f64) -> Self {
        Self::Number(value)
    }
}

const DESCRIPTION: &str = "A number, or a string in infix notation: `+ - * / ^`, parentheses, the names in scope, `t`, \
    `pi`, and `sin cos tan asin acos atan atan2 sinh cosh tanh exp ln log10 sqrt cbrt abs sign min max heaviside pow`. \
    Of time, space and parameters also what jumps, and a step ends there: `floor(a)`, `ceil(a)`, `round(a)`, \
    `mod(a, b)` with the sign of `b`, `if(c, a, b)` with a condition `c` of `< <= > >= == !=`, `and`, `or`, `not`; \
    `pwm(t, period, duty)`, 1 in the first share `duty` of each period, else 0; `sawtooth(t, period)` from 0 to 1; \
    `triangle(t, period)` from 0 to 1 and back; `pulse(t, start, width)`, 1 from `start` on for `width`, else 0; \
    and the tables by their names, `load(t)`. \
    Elements of vectors as `x[3]` or `x[i + 1]`, and sums as `sum(x)` or `sum(c[k]*x[k] for k in 1..n)`; an index is \
    made of whole numbers, other indices and parameters with whole values. \
    At most 64 KiB long and 200 levels deep.";

impl PartialSchema for Expression {
    fn schema() -> RefOr<Schema> {
        OneOfBuilder::new()
            .item(ObjectBuilder::new().schema_type(Type::Number))
            .item(ObjectBuilder::new().schema_type(Type::String))
            .description(Some(DESCRIPTION))
            .into()
    }
}

impl ToSchema for Expression {}

impl<'de> Deserialize<'de> for Expression {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ExpressionVisitor)
    }
}

struct ExpressionVisitor;

impl Visitor<'_> for ExpressionVisitor {
    type Value = Expression;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("an expression: a number or a string such as \"-k*x\"")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Expression, E> {
        Ok(Expression::Number(value))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Expression, E> {
        Ok(Expression::Number(value as f64))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Expression, E> {
        Ok(Expression::Number(value as f64))
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Expression, E> {
        Ok(Expression::Text(text.into()))
    }
}
