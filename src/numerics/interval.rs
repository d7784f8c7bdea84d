//! Interval arithmetic with outward rounding (Moore, Kearfott, Cloud 2009, *Introduction to Interval Analysis*): the
//! interval of a result contains the results at all points of the operands, both the exact results and those computed
//! in doubles.
//!
//! Like the decorations of IEEE 1788, each interval records whether its term is defined at every point of the box on
//! which the interval was computed. Overflow does not make a term undefined: the interval becomes unbounded.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// An interval: the numbers from `lo` to `hi`; empty if `lo > hi`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The lower end of the interval, which may be minus infinity.
    pub lo: f64,
    /// The upper end of the interval, which may be infinity.
    pub hi: f64,
    /// Whether the enclosed term has a value at every point of the box on which the interval was computed.
    pub defined: bool,
}

impl Interval {
    /// The whole real line.
    pub const LINE: Self = Self { lo: f64::NEG_INFINITY, hi: f64::INFINITY, defined: true };
    /// The empty interval, which encloses a term that is defined nowhere on the box.
    pub const EMPTY: Self = Self { lo: f64::INFINITY, hi: f64::NEG_INFINITY, defined: false };

    /// Creates the interval of the numbers from `lo` to `hi`.
    pub const fn new(lo: f64, hi: f64) -> Self {
        Self { lo, hi, defined: true }
    }

    /// Creates the interval of a single number; empty for NaN.
    pub const fn point(value: f64) -> Self {
        if value.is_nan() { Self::EMPTY } else { Self::new(value, value) }
    }

    /// Whether the interval is empty.
    pub fn is_empty(self) -> bool {
        self.lo > self.hi
    }

    /// Whether `value` lies in the interval.
    #[inline]
    pub fn contains(self, value: f64) -> bool {
        self.lo <= value && value <= self.hi
    }

    /// Returns the smallest interval that contains both intervals.
    #[must_use]
    pub fn hull(self, other: Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi), defined: self.defined && other.defined }
    }

    /// Returns a copy of the interval whose term counts as defined on the whole box only if `condition` holds in
    /// addition.
    #[must_use]
    pub fn defined_if(self, condition: bool) -> Self {
        Self { defined: self.defined && condition, ..self }
    }

    /// Encloses the squares `x^2` of the numbers in the interval.
    #[must_use]
    #[inline]
    pub fn square(self) -> Self {
        if self.is_empty() {
            return self;
        }
        let (near, far) = self.magnitudes();
        Self { lo: product_down(near, near), hi: product_up(far, far), defined: self.defined }
    }

    /// Encloses the square root of the nonnegative part of the interval.
    #[must_use]
    pub fn sqrt(self) -> Self {
        if self.is_empty() || self.hi < 0.0 {
            return Self::EMPTY;
        }
        let root = |x: f64| if x > 0.0 { x.sqrt() } else { 0.0 };
        let (lo, hi) = (root(self.lo), root(self.hi));
        let defined = self.defined && self.lo >= 0.0;
        Self { lo: if lo > 0.0 { lo.next_down() } else { 0.0 }, hi: if hi > 0.0 { hi.next_up() } else { 0.0 }, defined }
    }

    /// Encloses the absolute values `|x|` of the numbers in the interval.
    #[must_use]
    pub fn abs(self) -> Self {
        if self.is_empty() {
            return self;
        }
        let (lo, hi) = self.magnitudes();
        Self { lo, hi, ..self }
    }

    /// Returns midpoint and radius of a ball that contains the interval; the radius is infinite if an end is infinite
    /// or the interval is empty.
    #[inline]
    pub fn ball(self) -> (f64, f64) {
        if self.lo == self.hi {
            return (self.lo, 0.0);
        }
        let middle = 0.5 * self.lo + 0.5 * self.hi;
        let radius = (self.hi - middle).max(middle - self.lo).next_up();
        if radius >= 0.0 && middle.is_finite() { (middle, radius) } else { (0.0, f64::INFINITY) }
    }

    /// Returns the width `hi - lo` of the interval.
    pub fn width(self) -> f64 {
        self.hi - self.lo
    }

    /// Returns the least and the largest absolute value in the interval.
    pub fn magnitudes(self) -> (f64, f64) {
        let near = if self.contains(0.0) { 0.0 } else { self.lo.abs().min(self.hi.abs()) };
        (near, self.lo.abs().max(self.hi.abs()))
    }

    /// Returns the largest absolute value of the enclosed term; infinite if the term is not defined on the whole box.
    pub fn size(self) -> f64 {
        if self.defined { self.magnitudes().1 } else { f64::INFINITY }
    }

    /// Returns a lower bound of the enclosed term: the lower end of the interval, or minus infinity if the term is
    /// not defined on the whole box.
    pub fn least(self) -> f64 {
        if self.defined { self.lo } else { f64::NEG_INFINITY }
    }
}

/// Returns the interval between two computed ends; the whole line, marked as not defined, if an end is NaN.
#[inline]
pub fn between(lo: f64, hi: f64, defined: bool) -> Interval {
    if lo.is_nan() || hi.is_nan() {
        Interval { defined: false, ..Interval::LINE }
    } else {
        Interval { lo, hi, defined }
    }
}

impl Neg for Interval {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        Self { lo: -self.hi, hi: -self.lo, ..self }
    }
}

impl Add for Interval {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        if self.is_empty() || other.is_empty() {
            return Self::EMPTY;
        }
        let hi = -sum_down(-self.hi, -other.hi);
        between(sum_down(self.lo, other.lo), hi, self.defined && other.defined)
    }
}

impl Sub for Interval {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Interval {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        if self.is_empty() || other.is_empty() {
            return Self::EMPTY;
        }
        let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
        for a in [self.lo, self.hi] {
            for b in [other.lo, other.hi] {
                lo = lo.min(product_down(a, b));
                hi = hi.max(product_up(a, b));
            }
        }
        between(lo, hi, self.defined && other.defined)
    }
}

impl Div for Interval {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        if self.is_empty() || other.is_empty() {
            return Self::EMPTY;
        }
        if other.hi < 0.0 || (other.hi == 0.0 && other.lo < 0.0) {
            return -self / -other;
        }
        let defined = self.defined && other.defined && other.lo > 0.0;
        if other.lo < 0.0 || other.hi == 0.0 {
            return Self { defined, ..Self::LINE };
        }
        // From here on the divisor is nonnegative. Its zero is made a positive zero, so that the quotient becomes
        // unbounded with the right sign.
        let other = Self { lo: other.lo.abs(), ..other };
        let (below, above) =
            (if self.lo >= 0.0 { other.hi } else { other.lo }, if self.hi >= 0.0 { other.lo } else { other.hi });
        let lo = if self.lo == 0.0 { 0.0 } else { (self.lo / below).next_down() };
        let hi = if self.hi == 0.0 { 0.0 } else { (self.hi / above).next_up() };
        between(lo, hi, defined)
    }
}

/// Returns a lower bound of `a + b`; the sum itself if it is exact. The rounding error of a sum is itself a double
/// (Knuth).
fn sum_down(a: f64, b: f64) -> f64 {
    let sum = a + b;
    let part = sum - a;
    let error = (a - (sum - part)) + (b - part);
    if error >= 0.0 { sum } else { sum.next_down() }
}

/// Returns a lower bound of `a b`, with zero times infinity equal to zero: infinite ends do not belong to the
/// interval.
fn product_down(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { (a * b).next_down() }
}

/// Returns an upper bound of `a b`, with zero times infinity equal to zero.
fn product_up(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { (a * b).next_up() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_exact_is_not_widened() {
        let unit = Interval::new(-1.0, 1.0);
        assert_eq!(Interval::point(1.0) - unit, Interval::new(0.0, 2.0));
        assert_eq!(Interval::point(0.0) * Interval::LINE, Interval::point(0.0));
        assert_eq!(unit.square().lo, 0.0);
        let third = Interval::point(1.0) / Interval::point(3.0);
        assert!(third.lo < 1.0 / 3.0 && third.hi > 1.0 / 3.0);
        assert!((third * Interval::point(3.0)).contains(1.0));
    }

    #[test]
    fn a_divisor_that_reaches_zero_is_flagged() {
        let one = Interval::point(1.0);
        let half_line = one / Interval::new(0.0, 2.0);
        assert!(!half_line.defined && half_line.lo > 0.499 && half_line.lo <= 0.5 && half_line.hi == f64::INFINITY);
        let below = one / Interval::new(-2.0, 0.0);
        assert!(!below.defined && below.hi < -0.499 && below.lo == f64::NEG_INFINITY);
        assert_eq!(one / Interval::new(-1.0, 1.0), Interval { defined: false, ..Interval::LINE });
        assert!((one / Interval::new(1e-300, f64::INFINITY)).defined);
    }

    #[test]
    fn nothing_comes_of_nothing() {
        for result in [Interval::EMPTY + Interval::LINE, Interval::LINE * Interval::EMPTY, -Interval::EMPTY] {
            assert!(result.is_empty() && !result.defined);
        }
        assert!(Interval::point(f64::NAN).is_empty());
    }
}
