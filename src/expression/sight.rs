//! Screening of a program over a time interval: bounds on the variation of its outputs that samples do not show.
//!
//! A narrow feature of a smooth function arises where an operator is applied to operands that vary by more than its
//! own scale: an exponential over many powers of e, a quotient near a zero of its divisor, a switch, a table over
//! several pieces. Sums and products of sampled terms have no features of their own. Each operation is therefore
//! judged by the ranges of its operands: within its scale it counts as sampled; otherwise its enclosure must not be
//! much wider than the range of its samples, or it counts as hidden, and the bound on the hidden variation is
//! propagated to the outputs.

use super::operator::Operator;
use super::tape::Tape;
use numerics::{Interval, WIDER};

/// Largest ratio of the values of an operand over which samples resolve a function with a singularity at zero, such
/// as a quotient.
const RATIO: f64 = 4.0;
/// Largest variation of the exponent over which samples resolve an exponential.
const POWERS: f64 = 4.0;
/// Largest variation of the argument over which samples resolve a sine or a cosine: about one period.
const PERIOD: f64 = 6.5;
/// Largest variation of the argument over which samples resolve a function with singularities at a distance of about
/// one from the real line, such as `atan`.
const UNIT: f64 = 1.0;
/// Fraction of the sampled range by which values may lie beyond it on either side. Polynomials whose degree is at
/// most two thirds of the number of samples stay within (Ehlich and Zeller 1964).
const BEYOND: f64 = 0.5;
/// Largest ratio of the slope of a function to its mean slope, if its operands vary by no more than its scale (the
/// variation over which samples resolve it).
const STEEPER: f64 = 8.0;

/// The ranges of all registers of a program over samples, and bounds on the variation that the samples do not show.
#[derive(Clone, Debug, Default)]
pub struct Sight {
    sampled: Vec<(f64, f64)>,
    ranges: Vec<Interval>,
    /// For each register, a bound on the variation that samples do not show.
    hidden: Vec<f64>,
    is_needed: bool,
}

impl Sight {
    /// Allocates the ranges and bounds of all registers of the program whose samples are examined.
    pub fn new(tape: &Tape) -> Self {
        let count = tape.registers.len();
        let mut is_needed = false;
        tape.for_each_operation(|operator, _, _| is_needed |= !is_polynomial(operator));
        Self { sampled: vec![NOTHING; count], ranges: vec![Interval::LINE; count], hidden: vec![0.0; count], is_needed }
    }

    /// Whether samples may miss a narrow feature of the program; a polynomial has none.
    pub fn is_needed(&self) -> bool {
        self.is_needed
    }

    /// Discards all samples (evaluations at single times) of the program.
    pub fn begin(&mut self) {
        self.sampled.fill(NOTHING);
    }

    /// Adds the last evaluation of the program as a sample.
    pub fn sample(&mut self, tape: &Tape) {
        for ((lo, hi), &value) in self.sampled.iter_mut().zip(&tape.registers) {
            (*lo, *hi) = (lo.min(value), hi.max(value));
        }
    }

    /// Bounds, for each register, the variation that is not seen in the samples taken while the first input was in
    /// `first`.
    pub fn judge(&mut self, tape: &Tape, first: Interval) {
        let Self { sampled, ranges, hidden, .. } = self;
        let beyond = |(lo, hi): (f64, f64)| {
            let more = BEYOND * (hi - lo);
            if more >= 0.0 { Interval::new(lo - more, hi + more) } else { Interval::LINE }
        };
        let program = &tape.program;
        for place in 0..program.first {
            ranges[place] = if place >= program.inputs {
                Interval::point(tape.registers[place])
            } else if place == 0 {
                first
            } else {
                beyond(sampled[place])
            };
        }
        let mut next = program.first;
        tape.for_each_operation(|operator, a, b| {
            let (of_a, of_b) = (ranges[a], if operator.is_unary() { Interval::point(0.0) } else { ranges[b] });
            let hidden_of = [hidden[a], if operator.is_unary() { 0.0 } else { hidden[b] }];
            let range = program.tables.enclose(operator, of_a, of_b, a == b && !operator.is_unary());
            let (lo, hi) = sampled[next];
            let operation = Operation { operator, a: of_a, b: of_b, same: a == b, range, hidden: hidden_of };
            let pieces = || {
                Some((program.tables.get(of_b.lo)?.piece_at(of_a.lo), program.tables.get(of_b.lo)?.piece_at(of_a.hi)))
            };
            let is_one_piece = operator.takes_table() && pieces().is_some_and(|(first, last)| first == last);
            hidden[next] = operation.hides(hi - lo, is_one_piece);
            // If the samples of a register miss no variation, its range is at most the sampled range with a margin on
            // either side.
            ranges[next] = range;
            if hidden[next] == 0.0 {
                let shown = beyond((lo, hi));
                let (lo, hi) = (range.lo.max(shown.lo), range.hi.min(shown.hi));
                if lo <= hi {
                    ranges[next] = Interval::new(lo, hi);
                }
            }
            next += 1;
        });
    }

    /// Returns a bound on the variation of output `k` of the program that its samples do not show, and the largest
    /// absolute value of the output.
    pub fn hidden(&self, tape: &Tape, k: usize) -> (f64, f64) {
        let place = tape.program.outputs[k] as usize;
        (self.hidden[place], self.ranges[place].magnitudes().1)
    }
}

const NOTHING: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);

fn is_polynomial(operator: Operator) -> bool {
    matches!(operator, Operator::Negate | Operator::Expanded | Operator::Add | Operator::Subtract | Operator::Multiply)
}

/// An operation of the program, with the ranges of its operands and of its result over the samples.
struct Operation {
    operator: Operator,
    a: Interval,
    b: Interval,
    same: bool,
    range: Interval,
    hidden: [f64; 2],
}

impl Operation {
    /// Returns a bound on the variation of the result of the operation over an interval beyond the variation `shown` of
    /// samples within the interval.
    fn hides(&self, shown: f64, is_one_piece: bool) -> f64 {
        let &Self { operator, a, b, range, hidden: [of_a, of_b], .. } = self;
        let width = if range.is_empty() { 0.0 } else { range.width() };
        // A variation smaller than every normal floating-point number does not count as a feature.
        if width < f64::MIN_POSITIVE {
            return 0.0;
        }
        let times = |hidden: f64, size: f64| if hidden == 0.0 { 0.0 } else { hidden * size };
        let carried = match operator {
            Operator::Negate | Operator::Expanded => of_a,
            Operator::Add | Operator::Subtract => of_a + of_b,
            Operator::Multiply => times(of_a, b.magnitudes().1) + times(of_b, a.magnitudes().1),
            Operator::Gate | Operator::Choose if !a.contains(0.0) => of_b,
            Operator::Min | Operator::Max if a.hi <= b.lo => {
                if operator == Operator::Min {
                    of_a
                } else {
                    of_b
                }
            }
            Operator::Min | Operator::Max if b.hi <= a.lo => {
                if operator == Operator::Min {
                    of_b
                } else {
                    of_a
                }
            }
            Operator::Abs if !a.contains(0.0) => of_a,
            _ if of_a + of_b == 0.0 => {
                // If the operands vary by no more than the scale of the function, the enclosure alone shows that
                // there is no feature. Otherwise the samples must account for the width of the enclosure; for a
                // function with jumps they never do, since they do not locate the jumps, and the product of two
                // functions with jumps depends on where these are.
                let is_seen = width <= WIDER * shown && !operator.jumps();
                if is_one_piece || self.is_in_scale() || is_seen { 0.0 } else { width }
            }
            _ if is_one_piece || self.is_in_scale() => {
                let part = |hidden: f64, of: Interval| if hidden == 0.0 { 0.0 } else { hidden / of.width() };
                STEEPER * width * (part(of_a, a) + part(of_b, b))
            }
            _ => width,
        };
        carried.min(width)
    }

    /// Whether the operands vary by no more than the scale of the operator: the variation over which samples resolve
    /// it.
    fn is_in_scale(&self) -> bool {
        let Self { operator, a, b, range, same, .. } = *self;
        let keeps_off = |x: Interval| {
            let (near, far) = x.magnitudes();
            near > 0.0 && far <= RATIO * near
        };
        match operator {
            Operator::Exp | Operator::Sinh | Operator::Cosh => a.width() <= POWERS,
            Operator::Sin | Operator::Cos => a.width() <= PERIOD,
            Operator::Tanh | Operator::Atan => a.width() <= UNIT,
            Operator::Tan => range.width() <= UNIT,
            Operator::Ln | Operator::Log10 | Operator::Sqrt | Operator::Cbrt => keeps_off(a),
            Operator::Asin | Operator::Acos => range.width() <= UNIT && a.magnitudes().1 <= 0.5,
            Operator::Atan2 => keeps_off(a) || keeps_off(b),
            Operator::Divide => same || keeps_off(b),
            // Between two of its jumps, the remainder `a - b floor(a / b)` is linear in `a`.
            Operator::Modulo => {
                let periods = Operator::Divide.enclose(a, b, false);
                keeps_off(b) && Operator::Floor.enclose(periods, periods, true).width() == 0.0
            }
            // A power with a small integer exponent is a polynomial of low degree.
            Operator::Power if b.width() == 0.0 && b.lo.fract() == 0.0 && (0.0..=8.0).contains(&b.lo) => true,
            Operator::Power => a.lo > 0.0 && keeps_off(a) && range.lo > 0.0 && (range.hi / range.lo).ln() <= POWERS,
            _ => false,
        }
    }
}
