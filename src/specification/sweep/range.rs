//! The values of a swept number: points, or a distribution.
//!
//! Every range has a quantile function `[0, 1) -> R`, from which random and low-discrepancy designs draw; the
//! quantile function of a normal distribution is `mean + sd Phi^-1(u)`.

use crate::error::{Errors, SpecificationError};
use crate::pointer::Pointer;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use statrs::distribution::{ContinuousCDF, Normal};
use std::fmt;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, ArrayBuilder, ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// The values of one swept number.
#[derive(Clone, Debug, PartialEq)]
pub enum Range {
    /// A list of values of the swept number.
    List(Vec<f64>),
    /// Points of the swept number by a rule, or a distribution to draw its values from.
    Rule(Rule),
}

/// Values of a swept number: points by a rule, or a distribution.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// Equally spaced points: first point, last point and number of points.
    Linspace((f64, f64, u64)),
    /// Points equally spaced in the logarithm: first point, last point and number of points.
    Logspace((f64, f64, u64)),
    /// Normal distribution of the swept number: mean and standard deviation.
    Normal((f64, f64)),
    /// Uniform distribution: lower and upper end of the interval.
    Uniform((f64, f64)),
    /// Lognormal distribution of the swept number: mean and standard deviation of the logarithm.
    Lognormal((f64, f64)),
}

impl Range {
    /// The number of points of the range; `None` for a distribution.
    pub fn points(&self) -> Option<usize> {
        match self {
            Self::List(values) => Some(values.len()),
            Self::Rule(Rule::Linspace((_, _, count)) | Rule::Logspace((_, _, count))) => usize::try_from(*count).ok(),
            Self::Rule(Rule::Normal(_) | Rule::Uniform(_) | Rule::Lognormal(_)) => None,
        }
    }

    /// Returns point number `k` of the range, counted from zero.
    pub fn point(&self, k: usize) -> f64 {
        match self {
            Self::List(values) => values.get(k).copied().unwrap_or(f64::NAN),
            Self::Rule(Rule::Linspace((from, to, count))) => between(*from, *to, k, *count),
            Self::Rule(Rule::Logspace((from, to, count))) => match k as u64 {
                0 => *from,
                k if k + 1 == *count => *to,
                _ => from.signum() * between(from.abs().ln(), to.abs().ln(), k, *count).exp(),
            },
            Self::Rule(rule) => rule.quantile(0.5),
        }
    }

    /// Returns the quantile of the range at the probability `u` in `(0, 1)`.
    pub fn quantile(&self, u: f64) -> f64 {
        match (self, self.points()) {
            (Self::Rule(rule), None) => rule.quantile(u),
            (_, points) => {
                let count = points.unwrap_or(1);
                self.point(((u * count as f64) as usize).min(count.saturating_sub(1)))
            }
        }
    }

    /// Returns a typical value of the swept number, the median of its range.
    pub fn representative(&self) -> f64 {
        self.quantile(0.5)
    }

    /// Reports errors in the range of a swept number.
    pub fn check(&self, place: &Pointer<'_>, errors: &mut Errors) {
        let mut refuse = |detail: String, expected: &str| {
            errors.push(SpecificationError::new(place.to_string(), "out_of_range", detail).expected(expected));
        };
        match *self {
            Self::List(ref values) => {
                if values.is_empty() {
                    refuse("no values".to_owned(), "at least one value");
                }
            }
            Self::Rule(Rule::Linspace((.., 0))) => refuse("no values".to_owned(), "at least one value"),
            Self::Rule(Rule::Logspace((from, to, count))) => {
                if count == 0 {
                    refuse("no values".to_owned(), "at least one value");
                }
                if !(from * to > 0.0 || (from.signum() == to.signum() && from != 0.0 && to != 0.0)) {
                    let detail = format!("logarithmic spacing from {from} to {to} is not possible");
                    refuse(detail, "two nonzero numbers of the same sign");
                }
            }
            Self::Rule(Rule::Normal((_, sd)) | Rule::Lognormal((_, sd))) if sd < 0.0 => {
                refuse(format!("the standard deviation is {sd}"), "a standard deviation of at least 0");
            }
            Self::Rule(Rule::Uniform((a, b))) if a > b => {
                refuse(format!("the lower end {a} is above the upper end {b}"), "the lower end first");
            }
            Self::Rule(_) => {}
        }
    }
}

impl Rule {
    fn quantile(&self, u: f64) -> f64 {
        match *self {
            Self::Uniform((a, b)) => a + u * (b - a),
            Self::Normal((mean, sd)) => mean + sd * standard_normal(u),
            Self::Lognormal((mean, sd)) => (mean + sd * standard_normal(u)).exp(),
            Self::Linspace(_) | Self::Logspace(_) => f64::NAN,
        }
    }
}

/// The quantile function of the standard normal distribution.
fn standard_normal(u: f64) -> f64 {
    Normal::standard().inverse_cdf(u)
}

/// Returns number `k` of `count` equally spaced numbers from `from` to the other end.
fn between(from: f64, to: f64, k: usize, count: u64) -> f64 {
    match count {
        0 | 1 => from,
        _ if k as u64 + 1 == count => to,
        _ => from + (to - from) * (k as f64 / (count - 1) as f64),
    }
}

impl<'de> Deserialize<'de> for Range {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(RangeVisitor)
    }
}

struct RangeVisitor;

impl<'de> Visitor<'de> for RangeVisitor {
    type Value = Range;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a list of numbers, or a rule such as {\"linspace\": [0, 1, 11]}")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Range, E> {
        Ok(Range::List(vec![value]))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Range, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Range, E> {
        self.visit_f64(value as f64)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut access: A) -> Result<Range, A::Error> {
        let mut values = Vec::with_capacity(access.size_hint().unwrap_or(0).min(4096));
        while let Some(value) = access.next_element()? {
            values.push(value);
        }
        Ok(Range::List(values))
    }

    fn visit_map<A: MapAccess<'de>>(self, access: A) -> Result<Range, A::Error> {
        Rule::deserialize(MapAccessDeserializer::new(access)).map(Range::Rule)
    }
}

impl PartialSchema for Range {
    fn schema() -> RefOr<Schema> {
        let numbers = |count: usize| {
            let item = ObjectBuilder::new().schema_type(Type::Number);
            ArrayBuilder::new().items(item).min_items(Some(count)).max_items(Some(count))
        };
        let rule = |name: &str, count: usize, about: &str| {
            ObjectBuilder::new()
                .schema_type(Type::Object)
                .property(name, numbers(count).description(Some(about)))
                .required(name)
                .additional_properties(Some(AdditionalProperties::FreeForm(false)))
        };
        let number = ObjectBuilder::new().schema_type(Type::Number);
        OneOfBuilder::new()
            .item(ArrayBuilder::new().items(number).min_items(Some(1)))
            .item(rule("linspace", 3, "From, to, and how many: equal distances, both ends included."))
            .item(rule("logspace", 3, "From, to, and how many: equal ratios, both ends included."))
            .item(rule("normal", 2, "Mean and standard deviation."))
            .item(rule("uniform", 2, "The lesser and the greater end."))
            .item(rule("lognormal", 2, "Mean and standard deviation of the logarithm."))
            .description(Some("The values of a name: a list, points by a rule, or a distribution to draw from."))
            .into()
    }
}

impl ToSchema for Range {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_met_to_the_bit() {
        let (linear, logarithmic) = (Rule::Linspace((0.1, 0.5, 41)), Rule::Logspace((0.01, 1.0, 20)));
        for (rule, ends, count) in [(linear, (0.1, 0.5), 41), (logarithmic, (0.01, 1.0), 20)] {
            let range = Range::Rule(rule);
            assert_eq!((range.points(), range.point(0), range.point(count - 1)), (Some(count), ends.0, ends.1));
        }
        let range = Range::Rule(logarithmic);
        let ratios: Vec<f64> = (0..19).map(|k| range.point(k + 1) / range.point(k)).collect();
        assert!(ratios.iter().all(|ratio| (ratio - 100.0_f64.powf(1.0 / 19.0)).abs() < 1e-13));
    }

    #[test]
    fn quantiles_are_those_of_tables() {
        // Quantiles of the normal distribution from Abramowitz and Stegun (1964), table 26.5.
        let normal = Range::Rule(Rule::Normal((10.0, 2.0)));
        for (p, x) in [(0.975, 1.959_963_984_540_054), (0.5, 0.0), (0.001, -3.090_232_306_167_814)] {
            assert!((normal.quantile(p) - (10.0 + 2.0 * x)).abs() < 1e-13, "{p}: {}", normal.quantile(p));
        }
        let median = Range::Rule(Rule::Lognormal((1.0, 0.3))).quantile(0.5);
        assert!((median - 1.0_f64.exp()).abs() < 1e-14);
        assert_eq!(Range::Rule(Rule::Uniform((2.0, 4.0))).quantile(0.25), 2.5);
        assert_eq!(Range::List(vec![1.0, 2.0, 4.0]).quantile(0.99), 4.0);
    }
}
