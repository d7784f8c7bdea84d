//! Tables: functions given by points, with piecewise polynomial interpolation. Before the first point and after the
//! last, the value is constant.
//!
//! `pchip` is the piecewise cubic with the slopes of Fritsch and Carlson (1980, *Monotone piecewise cubic
//! interpolation*), in the form of Fritsch and Butland (1984): it is monotone wherever the points are.

use super::operator::Operator;
use numerics::Interval;
use std::sync::{Arc, OnceLock};

/// The interpolation between the points of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// Piecewise linear.
    Linear,
    /// Piecewise cubic, continuously differentiable and without overshoots.
    Pchip,
    /// Piecewise constant: the value of the previous point.
    Previous,
}

/// A function given by points. Copies share the points.
#[derive(Clone, Debug)]
pub struct Table(pub(super) Arc<Pieces>);

/// The reason why points do not define a table.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TableError {
    /// The table has different numbers of arguments and of values.
    #[error("a table has {x} values `x` and {y} values `y`")]
    Lengths {
        /// The number of arguments `x` of the points.
        x: usize,
        /// The number of values `y` of the points.
        y: usize,
    },
    /// The table has fewer than two points.
    #[error("a table has {0} points")]
    TooFew(usize),
    /// The argument of a point of the table is not above that of the previous point.
    #[error("`x` number {0}, counted from 0, is not above the one before")]
    Unsorted(usize),
    /// An argument, a value or a polynomial coefficient of the table is not finite.
    #[error("point number {0}, counted from 0, is not finite or too far from the next")]
    NotFinite(usize),
}

/// A piecewise polynomial.
#[derive(Debug)]
pub(super) struct Pieces {
    /// The knots of the piecewise polynomial, at which one piece ends and the next begins.
    knots: Arc<[f64]>,
    /// The coefficients of each piece in powers of the distance from the knot before it (from the first knot for the
    /// first).
    coefficients: Vec<[f64; 4]>,
    /// The ranges of all pieces as a segment tree: entry `k` is the hull of entries `2 k` and `2 k + 1`.
    ranges: Vec<Interval>,
    /// The switches of the table: the knots at which its polynomial differs from piece to piece.
    switches: Arc<[f64]>,
    interpolation: Interpolation,
    derivative: OnceLock<Arc<Pieces>>,
    zigzag: OnceLock<Arc<Pieces>>,
}

impl Table {
    /// Builds the table through the points `(x, y)`.
    ///
    /// # Errors
    /// Fails if there are fewer than two points, a number is not finite, or the points are not sorted by `x`.
    pub fn new(x: &[f64], y: &[f64], interpolation: Interpolation) -> Result<Self, TableError> {
        if x.len() != y.len() {
            return Err(TableError::Lengths { x: x.len(), y: y.len() });
        }
        if x.len() < 2 {
            return Err(TableError::TooFew(x.len()));
        }
        if let Some(k) = (0..x.len()).find(|&k| !(x[k].is_finite() && y[k].is_finite())) {
            return Err(TableError::NotFinite(k));
        }
        if let Some(k) = (1..x.len()).find(|&k| x[k] <= x[k - 1]) {
            return Err(TableError::Unsorted(k));
        }
        let inner = match interpolation {
            Interpolation::Previous => y[..y.len() - 1].iter().map(|&y| [y, 0.0, 0.0, 0.0]).collect(),
            Interpolation::Linear => lines(x, y),
            Interpolation::Pchip => cubics(x, y),
        };
        if let Some(k) = inner.iter().position(|piece: &[f64; 4]| !piece.iter().all(|c| c.is_finite())) {
            return Err(TableError::NotFinite(k));
        }
        let still = |y: f64| [y, 0.0, 0.0, 0.0];
        let mut coefficients = vec![still(y[0])];
        coefficients.extend(inner);
        coefficients.push(still(y[y.len() - 1]));
        // Compare continuous pieces by their slopes and higher coefficients, constant pieces by their values.
        let telling = usize::from(interpolation != Interpolation::Previous);
        let changes = |k: &usize| coefficients[*k][telling..] != coefficients[k + 1][telling..];
        let switches = (0..x.len()).filter(changes).map(|k| x[k]).collect();
        Ok(Self(Arc::new(Pieces::new(x.into(), coefficients, switches, interpolation))))
    }

    /// Whether the table jumps.
    pub fn jumps(&self) -> bool {
        self.0.interpolation == Interpolation::Previous && !self.0.switches.is_empty()
    }
}

/// Computes the coefficients of linear interpolation.
fn lines(x: &[f64], y: &[f64]) -> Vec<[f64; 4]> {
    (1..x.len()).map(|k| [y[k - 1], (y[k] - y[k - 1]) / (x[k] - x[k - 1]), 0.0, 0.0]).collect()
}

fn cubics(x: &[f64], y: &[f64]) -> Vec<[f64; 4]> {
    let width: Vec<f64> = (1..x.len()).map(|k| x[k] - x[k - 1]).collect();
    let chord: Vec<f64> = (1..x.len()).map(|k| (y[k] - y[k - 1]) / width[k - 1]).collect();
    let last = chord.len() - 1;
    if last == 0 {
        return lines(x, y);
    }
    let mut slope = vec![0.0; x.len()];
    for k in 1..=last {
        if chord[k - 1] * chord[k] > 0.0 {
            let (before, after) = (2.0 * width[k] + width[k - 1], width[k] + 2.0 * width[k - 1]);
            slope[k] = (before + after) / (before / chord[k - 1] + after / chord[k]);
        }
    }
    slope[0] = slope_at_end([width[0], width[1]], [chord[0], chord[1]]);
    slope[last + 1] = slope_at_end([width[last], width[last - 1]], [chord[last], chord[last - 1]]);
    let piece = |k: usize| {
        let quadratic = (3.0 * chord[k] - 2.0 * slope[k] - slope[k + 1]) / width[k];
        let cubic = (slope[k] - 2.0 * chord[k] + slope[k + 1]) / (width[k] * width[k]);
        [y[k], slope[k], quadratic, cubic]
    };
    (0..=last).map(piece).collect()
}

/// Returns the slope at an end of the table: that of the parabola through three points, limited to avoid overshoots.
fn slope_at_end(width: [f64; 2], chord: [f64; 2]) -> f64 {
    let slope = ((2.0 * width[0] + width[1]) * chord[0] - width[0] * chord[1]) / (width[0] + width[1]);
    if slope * chord[0] <= 0.0 {
        0.0
    } else if chord[0] * chord[1] <= 0.0 && slope.abs() > 3.0 * chord[0].abs() {
        3.0 * chord[0]
    } else {
        slope
    }
}

impl Pieces {
    fn new(knots: Arc<[f64]>, coefficients: Vec<[f64; 4]>, switches: Arc<[f64]>, interpolation: Interpolation) -> Self {
        let count = coefficients.len();
        let (derivative, zigzag) = (OnceLock::new(), OnceLock::new());
        let mut pieces = Self { knots, coefficients, ranges: Vec::new(), switches, interpolation, derivative, zigzag };
        let mut ranges = vec![Interval::EMPTY; 2 * count];
        for k in 0..count {
            ranges[count + k] = pieces.range_of(k, f64::NEG_INFINITY, f64::INFINITY);
        }
        for k in (1..count).rev() {
            ranges[k] = ranges[2 * k].hull(ranges[2 * k + 1]);
        }
        pieces.ranges = ranges;
        pieces
    }

    /// Whether the first derivative of the table jumps between two pieces.
    pub(super) fn has_kinks(&self) -> bool {
        self.interpolation == Interpolation::Linear && !self.switches.is_empty()
    }

    /// Returns the name of the nonsmooth function for messages, if the table is not smooth.
    pub(super) fn kink(&self) -> Option<&'static str> {
        match self.interpolation {
            _ if self.switches.is_empty() => None,
            Interpolation::Previous => Some("previous"),
            Interpolation::Linear => Some("table"),
            Interpolation::Pchip => None,
        }
    }

    /// Returns the largest degree of the polynomial pieces of the table.
    pub(super) fn degree(&self) -> u32 {
        let of_piece = |piece: &[f64; 4]| piece.iter().rposition(|c| *c != 0.0).unwrap_or(0);
        self.coefficients.iter().map(of_piece).max().map_or(0, |degree| degree as u32)
    }

    /// Returns the derivative of the table, piece by piece.
    pub(super) fn derivative(&self) -> &Arc<Self> {
        self.derivative.get_or_init(|| {
            let differentiated = self.coefficients.iter().map(|&[_, b, c, d]| [b, 2.0 * c, 3.0 * d, 0.0]).collect();
            Arc::new(Self::new(self.knots.clone(), differentiated, self.switches.clone(), self.interpolation))
        })
    }

    /// Returns a piecewise linear function with the slopes 1 and -1 that is zero exactly at the switches of the table
    /// (the knots at which its polynomial changes).
    pub(super) fn zigzag(&self) -> &Arc<Self> {
        self.zigzag.get_or_init(|| {
            let zeros = &self.switches;
            let middles = zeros.windows(2).map(|pair| 0.5 * pair[0] + 0.5 * pair[1]);
            let knots: Arc<[f64]> = if zeros.len() > 1 { middles.collect() } else { zeros.clone() };
            let piece = |k: usize| {
                let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
                let zero = zeros[k.min(zeros.len() - 1)];
                let origin = knots[k.max(1) - 1];
                [sign * (origin - zero), sign, 0.0, 0.0]
            };
            let count = zeros.len().max(2);
            let coefficients =
                if zeros.len() > 1 { (0..count).map(piece).collect() } else { vec![[0.0, 1.0, 0.0, 0.0]; 2] };
            Arc::new(Self::new(knots.clone(), coefficients, knots, Interpolation::Linear))
        })
    }

    pub(super) fn piece_at(&self, a: f64) -> usize {
        self.knots.partition_point(|knot| *knot <= a)
    }

    fn origin(&self, piece: usize) -> f64 {
        self.knots[piece.max(1) - 1]
    }

    fn at(&self, a: f64) -> f64 {
        if a.is_nan() {
            return a;
        }
        let piece = self.piece_at(a);
        let coefficients = &self.coefficients[piece];
        if coefficients[1..] == [0.0; 3] { coefficients[0] } else { horner(coefficients, a - self.origin(piece)) }
    }

    /// Returns the number of switches of the table (knots at which its polynomial changes) that are at most `a`.
    fn count_at(&self, a: f64) -> f64 {
        if a.is_nan() { a } else { self.switches.partition_point(|switch| *switch <= a) as f64 }
    }

    /// Returns the range of a polynomial piece of the table for arguments in `[lo, hi]`.
    fn range_of(&self, piece: usize, lo: f64, hi: f64) -> Interval {
        let coefficients @ [a, b, c, d] = self.coefficients[piece];
        if [b, c, d] == [0.0; 3] {
            return Interval::point(a);
        }
        let origin = self.origin(piece);
        let from = if piece == 0 { lo } else { lo.max(origin) } - origin;
        let to = self.knots.get(piece).map_or(hi, |&end| hi.min(end)) - origin;
        if c == 0.0 && d == 0.0 && !(from.is_finite() && to.is_finite()) {
            return Interval::new(f64::NEG_INFINITY, f64::INFINITY);
        }
        let mut range = [from, to].map(|s| horner(&coefficients, s));
        range.sort_unstable_by(f64::total_cmp);
        // Extrema at the zeros of b + 2 c s + 3 d s^2.
        let root = (c * c - 3.0 * b * d).max(0.0).sqrt();
        let sum = -(c + root.copysign(c));
        for s in [sum / (3.0 * d), b / sum] {
            if s > from && s < to {
                let value = horner(&coefficients, s);
                range = [range[0].min(value), range[1].max(value)];
            }
        }
        let reach = from.abs().max(to.abs());
        let magnitude = horner(&coefficients.map(f64::abs), reach);
        let rounding = 8.0 * f64::EPSILON * magnitude + f64::MIN_POSITIVE;
        Interval::new(range[0] - rounding, range[1] + rounding)
    }

    fn enclose(&self, a: Interval) -> Interval {
        let (first, last) = (self.piece_at(a.lo), self.piece_at(a.hi));
        let mut range = self.range_of(first, a.lo, a.hi);
        if last > first {
            range = range.hull(self.range_of(last, a.lo, a.hi));
            // Add the ranges of the pieces between the first and the last one, from the segment tree.
            let count = self.coefficients.len();
            let (mut from, mut to) = (count + first + 1, count + last);
            while from < to {
                if from % 2 == 1 {
                    range = range.hull(self.ranges[from]);
                    from += 1;
                }
                if to % 2 == 1 {
                    to -= 1;
                    range = range.hull(self.ranges[to]);
                }
                (from, to) = (from / 2, to / 2);
            }
        }
        range.defined_if(a.defined)
    }
}

fn horner(&[a, b, c, d]: &[f64; 4], s: f64) -> f64 {
    a + s * (b + s * (c + s * d))
}

/// The tables of a graph or of a program, by index. Copies share the tables.
#[derive(Clone, Debug, Default)]
pub(super) struct Tables(Vec<Arc<Pieces>>);

impl Tables {
    /// Returns the index of a table, which is added if it is new.
    pub(super) fn place(&mut self, table: &Arc<Pieces>) -> usize {
        self.0.iter().position(|known| Arc::ptr_eq(known, table)).unwrap_or_else(|| {
            self.0.push(table.clone());
            self.0.len() - 1
        })
    }

    /// Returns the table with the index `place`, which is a constant of a graph or of a program.
    pub(super) fn get(&self, place: f64) -> Option<&Arc<Pieces>> {
        self.0.get(place as usize)
    }

    /// Returns the value of an operator at `(a, b)`, including table operators.
    pub(super) fn apply(&self, operator: Operator, a: f64, b: f64) -> f64 {
        match (operator, self.get(b)) {
            (Operator::Lookup, Some(table)) => table.at(a),
            (Operator::Piece, Some(table)) => table.count_at(a),
            _ => operator.apply(a, b),
        }
    }

    /// Encloses the values of an operator at `(a, b)`, including table operators.
    pub(super) fn enclose(&self, operator: Operator, a: Interval, b: Interval, same: bool) -> Interval {
        match operator {
            Operator::Lookup | Operator::Piece if a.is_empty() => Interval::EMPTY,
            Operator::Lookup => self.get(b.lo).map_or(Interval::LINE, |table| table.enclose(a)),
            Operator::Piece => self.get(b.lo).map_or(Interval::LINE, |table| Interval {
                lo: table.count_at(a.lo),
                hi: table.count_at(a.hi),
                ..a
            }),
            _ => operator.enclose(a, b, same),
        }
    }
}
