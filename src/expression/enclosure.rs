//! Interval arithmetic for the functions of the language, and for programs: [`Tape::enclose`] encloses the outputs of
//! a program over a box of inputs.
//!
//! Monotone functions are evaluated at the ends of an interval; for sine, cosine and tangent, extrema and poles
//! inside the interval are checked too. Library functions have errors of a few units in the last place: their values
//! are widened by [`SLACK`].

use super::cube_root::cube_root;
use super::graph::is_power_of_two;
use super::operator::Operator;
use super::tape::Tape;
use numerics::{Interval, between};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Bound on the relative error of library functions; the largest error of the functions in use is 4 units in the last
/// place.
const SLACK: f64 = 8.0 * f64::EPSILON;

/// Interval registers of one compiled expression program, so that [`Tape::enclose`] does not allocate.
#[derive(Clone, Debug, Default)]
pub struct IntervalWorkspace {
    registers: Vec<Interval>,
}

impl IntervalWorkspace {
    /// Allocates the interval registers of an expression program and sets its constants.
    pub fn new(tape: &Tape) -> Self {
        Self { registers: tape.registers.iter().map(|&value| Interval::point(value)).collect() }
    }

    /// Updates the constants in the interval registers after new parameter values were bound to the program.
    pub fn bind(&mut self, tape: &Tape) {
        let constants = tape.program.inputs..tape.program.first;
        for (range, &value) in self.registers[constants.clone()].iter_mut().zip(&tape.registers[constants]) {
            *range = Interval::point(value);
        }
    }
}

impl Tape {
    /// Encloses the outputs of the program over the first input (usually time) in `first` and the other inputs in
    /// `rest`, which must extend to the largest index that occurs. The workspace must belong to this program.
    pub fn enclose(
        &self,
        first: Interval,
        rest: &[Interval],
        workspace: &mut IntervalWorkspace,
        outputs: &mut [Interval],
    ) {
        self.enclose_sides((first, rest), workspace, outputs, |_, _, _, range| range);
    }

    /// Encloses the outputs, as [`enclose`](Self::enclose) does, over a box that contains the inputs of the last
    /// [`evaluate`](Self::evaluate). Where an argument is so close to a jump that its interval reaches both sides of
    /// it, only the side on which the last evaluation was is enclosed.
    pub fn enclose_as_evaluated(
        &self,
        first: Interval,
        rest: &[Interval],
        workspace: &mut IntervalWorkspace,
        outputs: &mut [Interval],
    ) {
        self.enclose_sides((first, rest), workspace, outputs, |operator, operands, [a, b], range| {
            let [of_a, of_b, value] = operands.map(|register| self.registers[register]);
            operator.side_of(range, ([a, b], [of_a, of_b]), value)
        });
    }

    /// Encloses the outputs of the program. The function `side` may narrow the range of an operation, given its
    /// operator, the registers of both operands and of the result, the ranges of the operands, and the range of the
    /// operation.
    fn enclose_sides(
        &self,
        (first, rest): (Interval, &[Interval]),
        workspace: &mut IntervalWorkspace,
        outputs: &mut [Interval],
        side: impl Fn(Operator, [usize; 3], [Interval; 2], Interval) -> Interval,
    ) {
        debug_assert_eq!(outputs.len(), self.program.outputs.len(), "as many outputs as were compiled");
        debug_assert_eq!(workspace.registers.len(), self.registers.len(), "a workspace of this program");
        let registers = workspace.registers.as_mut_slice();
        if let Some((input, inputs)) = registers[..self.program.inputs].split_first_mut() {
            *input = first;
            inputs.copy_from_slice(&rest[..inputs.len()]);
        }
        let mut next = self.program.first;
        self.for_each_operation(|operator, a, b| {
            let operands = [registers[a], registers[b]];
            let range = self.program.tables.enclose(operator, operands[0], operands[1], a == b);
            registers[next] = side(operator, [a, b, next], operands, range);
            next += 1;
        });
        for (output, &register) in outputs.iter_mut().zip(&self.program.outputs) {
            *output = registers[register as usize];
        }
    }
}

impl Operator {
    /// If the range of an operation contains a jump, returns its range on one side of the jump: the side of the last
    /// evaluation, in which the operation had the value `value` for the values `operands`.
    fn side_of(self, range: Interval, (ranges, operands): ([Interval; 2], [f64; 2]), value: f64) -> Interval {
        let is_open = range.lo < range.hi && range.contains(value);
        match self {
            Self::Sign | Self::Heaviside | Self::Floor | Self::Round | Self::Parity | Self::Greater if is_open => {
                Interval::point(value).defined_if(range.defined)
            }
            Self::Modulo if is_open => {
                let whole = Interval::point((operands[0] / operands[1]).floor());
                (ranges[0] - product(ranges[1], whole)).defined_if(range.defined)
            }
            _ => range,
        }
    }

    /// Encloses the values of the operator at `(a, b)`; `same` states that both operands are one term and thus have
    /// equal values.
    pub(super) fn enclose(self, a: Interval, b: Interval, same: bool) -> Interval {
        // A gate or choice whose condition is 0 has the value 0 even if its other operand is undefined; comparisons
        // and some powers of NaN have a value too.
        if !matches!(self, Self::Gate | Self::Choose | Self::Greater | Self::Power) && (a.is_empty() || b.is_empty()) {
            return Interval::EMPTY;
        }
        let defined = a.defined && b.defined;
        match self {
            Self::Negate => -a,
            Self::Expanded => a,
            Self::Sin => wave(a, FRAC_PI_2, f64::sin),
            Self::Cos => wave(a, 0.0, f64::cos),
            Self::Tan if reaches(a, FRAC_PI_2, PI) => Interval { defined: false, ..Interval::LINE },
            Self::Tan => increasing(a, f64::tan),
            Self::Asin => within(a, -1.0, 1.0, |a| increasing(a, f64::asin)),
            Self::Acos => within(a, -1.0, 1.0, |a| between(below(a.hi.acos()).max(0.0), above(a.lo.acos()), a.defined)),
            Self::Atan => increasing(a, f64::atan),
            Self::Sinh => increasing(a, f64::sinh),
            Self::Cosh => {
                let (near, far) = a.magnitudes();
                increasing(Interval { lo: near, hi: far, ..a }, f64::cosh)
            }
            Self::Tanh => clamped(increasing(a, f64::tanh), -1.0, 1.0),
            Self::Exp => clamped(increasing(a, f64::exp), 0.0, f64::INFINITY),
            Self::Ln => within(a, 0.0, f64::INFINITY, |b| increasing(b, f64::ln).defined_if(a.lo > 0.0)),
            Self::Log10 => within(a, 0.0, f64::INFINITY, |b| increasing(b, f64::log10).defined_if(a.lo > 0.0)),
            Self::Sqrt => within(a, 0.0, f64::INFINITY, |a| clamped(increasing(a, f64::sqrt), 0.0, f64::INFINITY)),
            Self::Cbrt => increasing(a, cube_root),
            Self::Abs => a.abs(),
            Self::Sign | Self::Heaviside | Self::Floor | Self::Round => {
                between(self.apply(a.lo, a.lo), self.apply(a.hi, a.hi), defined)
            }
            Self::Parity if a.lo == a.hi => Interval::point(self.apply(a.lo, a.lo)).defined_if(defined),
            Self::Parity => Interval::new(-1.0, 1.0).defined_if(defined),
            Self::Modulo => modulo(a, b),
            Self::Lookup | Self::Piece => Interval { defined: false, ..Interval::LINE },
            Self::Add => a + b,
            Self::Subtract if same => Interval::point(0.0).defined_if(defined),
            Self::Subtract => a - b,
            Self::Multiply if same => a.square(),
            Self::Multiply => product(a, b),
            Self::Divide if same => Interval::point(1.0).defined_if(defined && !a.contains(0.0)),
            // Exact quotients are not widened, so that `floor` and other functions with jumps at integers have a
            // single value at an exact integer.
            Self::Divide if is_exact_quotient(a, b) => Interval::point(a.lo / b.lo).defined_if(defined),
            // Enclose as a product, since a quotient by a constant power of two is compiled as a product.
            Self::Divide if b.lo == b.hi && is_power_of_two(b.lo) => {
                let reciprocal = 1.0 / b.lo;
                product(a, Interval { lo: reciprocal, hi: reciprocal, ..b })
            }
            Self::Divide => a / b,
            Self::Power => power(a, b),
            Self::Atan2 => angle(a, b),
            Self::Min => between(a.lo.min(b.lo), a.hi.min(b.hi), defined),
            Self::Max => between(a.lo.max(b.lo), a.hi.max(b.hi), defined),
            Self::Greater if defined && a.lo > b.hi => Interval::point(1.0),
            Self::Greater if same || a.hi <= b.lo => Interval::point(0.0).defined_if(defined),
            Self::Greater => Interval::new(0.0, 1.0).defined_if(defined),
            Self::Gate | Self::Choose => gate(a, b),
        }
    }
}

/// Whether both operands are points with an exact quotient.
fn is_exact_quotient(a: Interval, b: Interval) -> bool {
    a.lo == a.hi && b.lo == b.hi && (a.lo / b.lo).mul_add(b.lo, -a.lo) == 0.0
}

/// Encloses the product `a b`; exact if one factor is the point 1, as a parameter may be, or if both are points with an
/// exact product.
fn product(a: Interval, b: Interval) -> Interval {
    let is_one = |x: Interval| x.lo == 1.0 && x.hi == 1.0;
    let value = a.lo * b.lo;
    if a.lo == a.hi
        && b.lo == b.hi
        && a.lo.mul_add(b.lo, -value) == 0.0
        && (value == 0.0) == (a.lo == 0.0 || b.lo == 0.0)
    {
        return Interval::point(value).defined_if(a.defined && b.defined);
    }
    match (is_one(a), is_one(b)) {
        (_, true) => a.defined_if(b.defined),
        (true, _) => b.defined_if(a.defined),
        _ => a * b,
    }
}

/// Encloses the remainder `a - b floor(a / b)`: between 0 and `b`, up to rounding if the quotient is nearly an integer.
fn modulo(a: Interval, b: Interval) -> Interval {
    let quotient = Operator::Divide.enclose(a, b, false);
    let whole = Operator::Floor.enclose(quotient, quotient, true);
    if whole.lo == whole.hi {
        return a - product(b, whole);
    }
    // The quotient `a / b` and its product with `b` have a rounding error of one unit in the last place each.
    let rounding = 4.0 * f64::EPSILON * a.magnitudes().1;
    between(b.lo.min(0.0) - rounding, b.hi.max(0.0) + rounding, whole.defined)
}

/// Encloses the gate operator: `b` if `a` is not 0, else 0.
fn gate(a: Interval, b: Interval) -> Interval {
    if a.is_empty() {
        Interval::EMPTY
    } else if a.lo == 0.0 && a.hi == 0.0 {
        Interval::point(0.0).defined_if(a.defined)
    } else if a.contains(0.0) {
        b.hull(Interval::point(0.0)).defined_if(a.defined)
    } else {
        b.defined_if(a.defined)
    }
}

/// Returns a lower bound of the exact value, given the result of a library function.
fn below(value: f64) -> f64 {
    if value.is_finite() { value - (SLACK * value.abs() + f64::MIN_POSITIVE) } else { value.next_down() }
}

/// Returns an upper bound of the exact value, given the result of a library function.
fn above(value: f64) -> f64 {
    -below(-value)
}

/// Encloses an increasing function; every increasing library function in use is exact at zero.
fn increasing(a: Interval, function: impl Fn(f64) -> f64) -> Interval {
    let lo = if a.lo == 0.0 { function(0.0) } else { below(function(a.lo)) };
    let hi = if a.hi == 0.0 { function(0.0) } else { above(function(a.hi)) };
    between(lo, hi, a.defined)
}

/// Encloses a function on the part of `a` in its domain `least..=most`.
fn within(a: Interval, least: f64, most: f64, function: impl Fn(Interval) -> Interval) -> Interval {
    let inside = Interval { lo: a.lo.max(least), hi: a.hi.min(most), ..a };
    if inside.is_empty() { Interval::EMPTY } else { function(inside).defined_if(least <= a.lo && a.hi <= most) }
}

/// Clamps the enclosure of a function to `least..=most`, the range of its values.
fn clamped(a: Interval, least: f64, most: f64) -> Interval {
    Interval { lo: a.lo.clamp(least, most), hi: a.hi.clamp(least, most), ..a }
}

/// Encloses the sine or the cosine over `a`; `crest` is the position of a maximum.
fn wave(a: Interval, crest: f64, function: impl Fn(f64) -> f64) -> Interval {
    let (at_lo, at_hi) = (function(a.lo), function(a.hi));
    let hi = if reaches(a, crest, TAU) { 1.0 } else { above(at_lo.max(at_hi)) };
    let lo = if reaches(a, crest - PI, TAU) { -1.0 } else { below(at_lo.min(at_hi)) };
    clamped(between(lo, hi, a.defined), -1.0, 1.0)
}

/// Whether the point `first + k period` may lie in `a` for an integer `k`; true for large arguments, where rounding
/// exceeds a period.
fn reaches(a: Interval, first: f64, period: f64) -> bool {
    if !(a.lo.is_finite() && a.hi.is_finite()) || a.width() >= period {
        return true;
    }
    let (from, to) = ((a.lo - first) / period, (a.hi - first) / period);
    let rounding = SLACK * (1.0 + from.abs().max(to.abs()));
    (from - rounding).ceil() <= to + rounding
}

/// Encloses `a^b` according to IEEE 754: NaN to the power of 0 is 1, and 1 to the power of NaN is 1.
fn power(a: Interval, b: Interval) -> Interval {
    let one = (!a.defined && b.contains(0.0)) || (!b.defined && a.contains(1.0));
    let known = if a.is_empty() || b.is_empty() { Interval::EMPTY } else { real_power(a, b) };
    if one { known.hull(Interval::point(1.0)).defined_if(false) } else { known }
}

/// Encloses `a^b`: for a positive base as `exp(b ln a)`, whose extrema are at the corners; for a negative base with
/// constant integer exponents only.
fn real_power(a: Interval, b: Interval) -> Interval {
    let defined = a.defined && b.defined;
    let fixed = (b.lo == b.hi).then_some(b.lo);
    if let Some(exponent) = fixed.filter(|exponent| *exponent == exponent.trunc()) {
        return whole_power(a, exponent).defined_if(defined);
    }
    if a.lo < 0.0 && fixed.is_none() {
        return Interval { defined: false, ..Interval::LINE };
    }
    let grows = b.lo > 0.0;
    within(a, 0.0, f64::INFINITY, |a| {
        // Take the absolute value, since powers of a negative zero could have the wrong sign.
        let least = a.lo.abs();
        let values = [least.powf(b.lo), least.powf(b.hi), a.hi.powf(b.lo), a.hi.powf(b.hi)];
        clamped(corners(values, defined && (a.lo > 0.0 || grows)), 0.0, f64::INFINITY)
    })
}

/// Encloses `a^k` for an integer `k`.
fn whole_power(a: Interval, k: f64) -> Interval {
    if k < 0.0 {
        return Interval::point(1.0) / whole_power(a, -k);
    }
    if (0.5 * k).fract() == 0.0 {
        let (near, far) = a.magnitudes();
        between(below(near.powf(k)).max(0.0), above(far.powf(k)), a.defined)
    } else {
        between(below(a.lo.powf(k)), above(a.hi.powf(k)), a.defined)
    }
}

/// Encloses the angle `atan2(y, x)`. It jumps where `y` changes sign and `x` is negative; on a box without this line,
/// its extrema are at the corners.
fn angle(y: Interval, x: Interval) -> Interval {
    let defined = y.defined && x.defined;
    if x.lo > 0.0 || y.lo > 0.0 || y.hi < 0.0 {
        return corners([y.lo.atan2(x.lo), y.lo.atan2(x.hi), y.hi.atan2(x.lo), y.hi.atan2(x.hi)], defined);
    }
    // Enclose the full circle even if `x >= 0`: the angle of (0, -0) is pi.
    between(-above(PI), above(PI), defined)
}

/// Returns the hull of the values at the corners of a box, widened by the error of library functions.
fn corners(values: [f64; 4], defined: bool) -> Interval {
    let (lo, hi) =
        values.into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), value| (lo.min(value), hi.max(value)));
    between(below(lo), above(hi), defined)
}
