//! One operator applied to many pairs of registers, with contiguous results. Dispatch is done once and operands are
//! staged contiguously, so that the compiler vectorises the arithmetic; results are bitwise equal to those of
//! [`Operator::apply`].

use super::operator::Operator;

/// The number of lanes (pairs of registers to which one operator is applied) whose operands are copied to contiguous
/// memory together: small enough for the stack, large enough to amortise the dispatch.
const CHUNK: usize = 64;

/// The registers of one operand in all lanes (pairs of registers to which one operator is applied).
#[derive(Clone, Debug)]
enum Operands {
    /// One register, which is the operand in all lanes.
    Same(usize),
    /// Consecutive registers, one per lane, of which the first is given.
    Run(usize),
    /// Arbitrary registers, one per lane.
    Each(Vec<u32>),
}

/// One operator applied to many pairs of registers.
#[derive(Clone, Debug)]
pub(super) struct Lanes {
    operator: Operator,
    length: usize,
    a: Operands,
    b: Operands,
}

impl Lanes {
    /// Prepares an operator for the pairs of registers `(a[i], b[i])`; there must be at least one pair.
    pub(super) fn new(operator: Operator, a: Vec<u32>, b: Vec<u32>) -> Self {
        Self { operator, length: a.len(), a: Operands::new(a), b: Operands::new(b) }
    }

    /// Returns the number of lanes (pairs of registers), each of which has one result.
    pub(super) fn len(&self) -> usize {
        self.length
    }

    /// Visits the lanes (pairs of registers) in order, each with the registers of its two operands.
    pub(super) fn for_each_operation(&self, visit: &mut impl FnMut(Operator, usize, usize)) {
        for lane in 0..self.length {
            visit(self.operator, self.a.register(lane), self.b.register(lane));
        }
    }

    /// Writes the results of the operator for all lanes (pairs of registers).
    pub(super) fn evaluate(&self, registers: &[f64], results: &mut [f64]) {
        let (mut a, mut b) = ([0.0; CHUNK], [0.0; CHUNK]);
        for (chunk, results) in results.chunks_mut(CHUNK).enumerate() {
            let (start, length) = (chunk * CHUNK, results.len());
            let a = self.a.stage(registers, start, &mut a[..length]);
            let b = if self.operator.is_unary() { a } else { self.b.stage(registers, start, &mut b[..length]) };
            self.operator.apply_all(a, b, results);
        }
    }

    /// Writes the results of all lanes (pairs of registers) at the first `count` of `L` evaluation points; results at
    /// the other points are arbitrary.
    pub(super) fn evaluate_points<const L: usize>(
        &self,
        registers: &[[f64; L]],
        results: &mut [[f64; L]],
        count: usize,
    ) {
        for (lane, results) in results.iter_mut().enumerate() {
            let (a, b) = (&registers[self.a.register(lane)], &registers[self.b.register(lane)]);
            self.operator.apply_lanes(a, b, results, count);
        }
    }
}

impl Operands {
    fn new(registers: Vec<u32>) -> Self {
        let first = registers[0] as usize;
        if registers.iter().all(|&register| register as usize == first) {
            Self::Same(first)
        } else if registers.iter().enumerate().all(|(lane, &register)| register as usize == first + lane) {
            Self::Run(first)
        } else {
            Self::Each(registers)
        }
    }

    /// Returns the register of the operand of one lane (pair of registers).
    fn register(&self, lane: usize) -> usize {
        match self {
            Self::Same(register) => *register,
            Self::Run(first) => first + lane,
            Self::Each(places) => places[lane] as usize,
        }
    }

    /// Returns the first or second operands of the lanes (pairs of registers) from `start` on, copied to `room`
    /// unless they are contiguous already.
    #[inline(always)]
    fn stage<'r>(&self, registers: &'r [f64], start: usize, room: &'r mut [f64]) -> &'r [f64] {
        match self {
            Self::Same(register) => {
                room.fill(registers[*register]);
                room
            }
            Self::Run(first) => &registers[first + start..][..room.len()],
            Self::Each(places) => {
                for (value, &place) in room.iter_mut().zip(&places[start..]) {
                    *value = registers[place as usize];
                }
                room
            }
        }
    }
}

impl Operator {
    /// Computes `results[i] = apply(a[i], b[i])` for all lanes `i` (pairs of registers).
    fn apply_all(self, a: &[f64], b: &[f64], results: &mut [f64]) {
        if !self.apply_arithmetic(a, b, results) {
            // Select the operator anew for each pair of operands: the functions that remain take much longer than
            // this selection.
            each(a, b, results, |a, b| self.apply(a, b));
        }
    }

    /// Computes `results[i] = apply(a[i], b[i])` for the first `count` lanes `i` (pairs of registers); the other
    /// results are arbitrary.
    #[inline(always)]
    pub(super) fn apply_lanes<const L: usize>(self, a: &[f64; L], b: &[f64; L], results: &mut [f64; L], count: usize) {
        if !self.apply_arithmetic(a, b, results) {
            each(&a[..count], &b[..count], &mut results[..count], |a, b| self.apply(a, b));
        }
    }

    /// Computes `results[i] = apply(a[i], b[i])` for operators that are as cheap as their dispatch; returns false for
    /// others. The operator is constant inside each loop, so that the loop is vectorised.
    #[inline(always)]
    fn apply_arithmetic(self, a: &[f64], b: &[f64], results: &mut [f64]) -> bool {
        match self {
            Self::Negate => each(a, b, results, |a, b| Self::Negate.apply(a, b)),
            Self::Sqrt => each(a, b, results, |a, b| Self::Sqrt.apply(a, b)),
            Self::Abs => each(a, b, results, |a, b| Self::Abs.apply(a, b)),
            Self::Add => each(a, b, results, |a, b| Self::Add.apply(a, b)),
            Self::Subtract => each(a, b, results, |a, b| Self::Subtract.apply(a, b)),
            Self::Multiply => each(a, b, results, |a, b| Self::Multiply.apply(a, b)),
            Self::Divide => each(a, b, results, |a, b| Self::Divide.apply(a, b)),
            Self::Min => each(a, b, results, |a, b| Self::Min.apply(a, b)),
            Self::Max => each(a, b, results, |a, b| Self::Max.apply(a, b)),
            Self::Greater => each(a, b, results, |a, b| Self::Greater.apply(a, b)),
            Self::Gate => each(a, b, results, |a, b| Self::Gate.apply(a, b)),
            _ => return false,
        }
        true
    }
}

#[inline(always)]
fn each(a: &[f64], b: &[f64], results: &mut [f64], apply: impl Fn(f64, f64) -> f64) {
    for ((result, &a), &b) in results.iter_mut().zip(a).zip(b) {
        *result = apply(a, b);
    }
}
