//! Summary statistics of the numbers in the table of a sweep: count, mean, standard deviation, extremes and
//! quantiles.

use crate::columnar::Members;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io;
use utoipa::ToSchema;

/// The probabilities of the quantiles in a summary, with their names.
const QUANTILES: [(&str, f64); 5] = [("0.05", 0.05), ("0.25", 0.25), ("0.5", 0.5), ("0.75", 0.75), ("0.95", 0.95)];

/// The distribution over the members of a sweep of each number that the sweep collects, by name.
pub type Summary = BTreeMap<String, OfNumber>;

/// The distribution of a collected number over the members of a sweep that have a value.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct OfNumber {
    /// Number of members of the sweep that have a value.
    pub count: u64,
    /// The mean of the values.
    pub mean: f64,
    /// The standard deviation of the values, with divisor `count - 1`; zero for a single member.
    pub sd: f64,
    /// The minimum of the values.
    pub min: f64,
    /// The maximum of the values.
    pub max: f64,
    /// Quantiles by their probability, such as `0.5`, with linear interpolation of the sorted values (Hyndman and Fan
    /// 1996, type 7).
    pub quantiles: BTreeMap<String, f64>,
}

/// Returns the distribution of each number that the sweep has collected.
///
/// # Errors
/// Errors of reading the table.
pub fn summary(members: &dyn Members) -> io::Result<Summary> {
    let mut summary = Summary::new();
    for name in &members.head().collected {
        // Columns are read one at a time, and space is reserved exactly, since there may be millions of members.
        let (mut count, mut numbers) = (0, Vec::new());
        members.visit(name, |values| count += (0..values.len()).filter(|row| values.number(*row).is_some()).count())?;
        numbers.reserve_exact(count);
        members.visit(name, |values| numbers.extend((0..values.len()).filter_map(|row| values.number(row))))?;
        if let Some(of) = OfNumber::of(numbers) {
            summary.insert(name.clone(), of);
        }
    }
    Ok(summary)
}

impl OfNumber {
    fn of(mut numbers: Vec<f64>) -> Option<Self> {
        if numbers.is_empty() {
            return None;
        }
        let count = numbers.len() as f64;
        let size = numbers.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
        // Values of the collected number are divided by the largest one, so that neither their sum nor a square
        // overflows.
        let unit = if size > 0.0 { size } else { 1.0 };
        let mean = numbers.iter().map(|x| x / unit).sum::<f64>() / count;
        let squares = numbers.iter().map(|x| (x / unit - mean).powi(2)).sum::<f64>();
        let sd = if numbers.len() > 1 { (squares / (count - 1.0)).sqrt() * unit } else { 0.0 };
        numbers.sort_unstable_by(f64::total_cmp);
        let quantile = |part: f64| {
            let place = part * (count - 1.0);
            let below = place as usize;
            let (low, high) = (numbers[below], numbers[(below + 1).min(numbers.len() - 1)]);
            let part = place - below as f64;
            (1.0 - part) * low + part * high
        };
        let quantiles = QUANTILES.map(|(name, part)| (name.to_owned(), quantile(part)));
        let (min, max) = (numbers[0], numbers[numbers.len() - 1]);
        let finite = |x: f64| if x.is_finite() { x } else { f64::MAX };
        Some(Self {
            count: numbers.len() as u64,
            mean: mean * unit,
            sd: finite(sd),
            min,
            max,
            quantiles: quantiles.into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_r_and_numpy() {
        let of = OfNumber::of(vec![4.0, 1.0, 3.0, 2.0]).unwrap();
        assert_eq!((of.count, of.mean, of.min, of.max), (4, 2.5, 1.0, 4.0));
        assert!((of.sd - (5.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        let told = [("0.05", 1.15), ("0.25", 1.75), ("0.5", 2.5), ("0.75", 3.25), ("0.95", 3.85)];
        assert!(told.iter().all(|(name, value)| (of.quantiles[*name] - value).abs() < 1e-14), "{of:?}");
    }

    #[test]
    fn nothing_overflows() {
        let of = OfNumber::of(vec![f64::MAX, -f64::MAX]).unwrap();
        assert!(of.mean == 0.0 && of.sd.is_finite() && of.quantiles.values().all(|value| value.is_finite()), "{of:?}");
        assert!(OfNumber::of(vec![]).is_none());
    }
}
