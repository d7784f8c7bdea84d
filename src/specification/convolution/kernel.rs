//! The kernel of a problem with memory. Product integration treats entries `t^(a-1) g` with `a <= 1` and `g(0)`
//! nonzero, of index `a`. An entry of higher index, for which product integration would be unstable, is written as
//! the integral of its derivative,
//!
//! ```text
//! t^(a-1) g = int_0^t s^(a-2) [(a - 1) g + s g'] ds
//! ```

use super::{FractionalKernel, KernelOfTime};
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::matrix::Matrix;
use crate::pointer::Pointer;
use convolution::{Function, Kernel, Term};
use expression::{ExpressionError, Node, Tape};
use nalgebra::DMatrix;
use rustc_hash::FxHashMap;

/// Highest admissible index of a convolution kernel: above it, solutions need not exist.
const HIGHEST_INDEX: f64 = 2.0;

/// A convolution kernel, its index, and its leading coefficient matrix at `t = 0`.
pub type Lowered = (Kernel, f64, DMatrix<f64>);

impl KernelOfTime {
    /// Builds the convolution kernel, of `m` rows and columns, from its description; reports errors and then returns
    /// `None`.
    pub(super) fn lower(&self, m: usize, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Lowered> {
        match (&self.fractional, &self.entries) {
            (Some(fractional), None) => {
                if self.exponent.is_some() {
                    let detail = "the exponent of a power is in `fractional`; this exponent belongs to `entries`";
                    lowering.errors.report(&place.key("exponent"), "conflict", detail);
                }
                fractional.lower(m, &place.key("fractional"), lowering)
            }
            (None, Some(entries)) => of_entries(entries, self.exponent.as_ref(), m, place, lowering),
            _ => {
                let detail = "a kernel is either a power of time and a matrix, `fractional`, or a matrix of expressions in `t`, \
                              `entries`";
                let error = SpecificationError::new(place.to_string(), "fractional_or_entries", detail);
                lowering.errors.push(error.expected("one of `fractional`, `entries`"));
                None
            }
        }
    }
}

impl FractionalKernel {
    fn lower(&self, m: usize, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<Lowered> {
        let exponent = exponent(&self.exponent, &place.key("exponent"), lowering);
        let matrix = match &self.matrix {
            Some(matrix) => matrix.entries((m, m), &place.key("matrix"), lowering),
            None => (0..m).map(|i| (i, i, 1.0)).collect(),
        };
        let exponent = exponent.filter(|_| lowering.errors.is_empty())?;
        let mut at_zero = DMatrix::zeros(m, m);
        for &(i, j, value) in &matrix {
            at_zero[(i, j)] = value;
        }
        let kernel = Kernel { terms: vec![Term { function: Function::power(exponent), matrix }] };
        Some((kernel, exponent, at_zero))
    }
}

/// Reads the exponent of a convolution kernel, a constant above 0 and at most `HIGHEST_INDEX`.
fn exponent(exponent: &Expression, place: &Pointer<'_>, lowering: &mut Lowering) -> Option<f64> {
    let value = lowering.constant(exponent, place)?;
    if value > HIGHEST_INDEX {
        lowering.errors.push(too_high(place, value));
        return None;
    }
    if value <= 0.0 {
        let error = SpecificationError::new(place.to_string(), "out_of_range", format!("{value} is out of range"));
        lowering.errors.push(error.expected("above 0, at most 2: only then the kernel is integrable"));
        return None;
    }
    Some(value)
}

fn too_high(place: &Pointer<'_>, index: f64) -> SpecificationError {
    let detail = format!(
        "the index is {index}: above 2 the inequality has solutions for special data only, and limits of approximate \
         solutions need not be solutions"
    );
    SpecificationError::new(place.to_string(), "index_too_high", detail).expected("an exponent above 0, at most 2")
}

fn of_entries(
    entries: &Matrix,
    given: Option<&Expression>,
    m: usize,
    place: &Pointer<'_>,
    lowering: &mut Lowering,
) -> Option<Lowered> {
    let exponent = match given {
        Some(given) => exponent(given, &place.key("exponent"), lowering),
        None => Some(1.0),
    };
    let place = place.key("entries");
    let nodes = entries.nodes((m, m), &place, lowering);
    let exponent = exponent.filter(|_| lowering.errors.is_empty())?;
    let mut known: FxHashMap<Node, usize> = FxHashMap::default();
    let (mut terms, mut leading): (Vec<Term>, Vec<f64>) = (Vec::new(), Vec::new());
    for (entry, &node) in nodes.iter().enumerate() {
        if lowering.graph.value(node) == Some(0.0) {
            continue;
        }
        let term = match known.get(&node) {
            Some(&term) => term,
            None => {
                let (function, at_zero) = match function(node, exponent, lowering) {
                    Ok(found) => found,
                    Err(mut error) => {
                        error.detail = format!("entry ({}, {}) of the kernel: {}", entry / m, entry % m, error.detail);
                        lowering.errors.push(SpecificationError { pointer: place.to_string(), ..error });
                        return None;
                    }
                };
                terms.push(Term { function, matrix: Vec::new() });
                leading.push(at_zero);
                known.insert(node, terms.len() - 1);
                terms.len() - 1
            }
        };
        terms[term].matrix.push((entry / m, entry % m, 1.0));
    }
    let led = || terms.iter().zip(&leading).filter(|(_, at_zero)| **at_zero != 0.0);
    let index = led().map(|(term, _)| term.function.index()).fold(f64::INFINITY, f64::min);
    if index > HIGHEST_INDEX {
        lowering.errors.push(vanishing(&place, exponent));
        return None;
    }
    let mut matrix = DMatrix::zeros(m, m);
    for (term, at_zero) in led().filter(|(term, _)| term.function.index() == index) {
        term.matrix.iter().for_each(|&(i, j, _)| matrix[(i, j)] = *at_zero);
    }
    Some((Kernel { terms }, index, matrix))
}

/// Returns the error for a kernel whose entries vanish at `t = 0` together with their derivatives.
fn vanishing(place: &Pointer<'_>, exponent: f64) -> SpecificationError {
    if exponent < 1.0 {
        let detail = format!("all entries are zero at t = 0: the index is above the exponent {exponent}");
        return SpecificationError::new(place.to_string(), "conflict", detail)
            .expected("entries divided by t, and an exponent higher by 1");
    }
    too_high(place, if exponent > 1.0 { exponent + 1.0 } else { 3.0 })
}

/// Returns the kernel entry `t^(a-1) g` as a function, differentiated once if its index is above one (the solver
/// integrates it back), and the value at `t = 0` of the remaining factor.
fn function(node: Node, exponent: f64, lowering: &mut Lowering) -> Result<(Function, f64), SpecificationError> {
    let (mut g, mut a, mut integrations) = (node, exponent, 0);
    loop {
        let factor = Tape::compile(&lowering.graph, &[g]);
        let mut at_zero = [0.0];
        factor.clone().evaluate(0.0, &[], &mut at_zero);
        let [at_zero] = at_zero;
        if !at_zero.is_finite() {
            let detail = format!("it is, or its derivative is, {at_zero} at t = 0");
            return Err(SpecificationError::new(String::new(), "outside_domain", detail)
                .expected("an entry that is smooth from zero on; `exponent`: a puts a power t^(a-1) in front of all"));
        }
        if a < 1.0 || integrations == 1 || (a == 1.0 && at_zero != 0.0) {
            let slope = slope(g, lowering).map_err(underivable)?;
            let slope = Some(Tape::compile(&lowering.graph, &[slope]));
            return Ok((Function { exponent: a, factor: Some(factor), slope, integrations }, at_zero));
        }
        g = derivative(g, a, lowering).map_err(underivable)?;
        a = if a > 1.0 { a - 1.0 } else { a };
        integrations += 1;
    }
}

fn underivable(error: ExpressionError) -> SpecificationError {
    SpecificationError::new(String::new(), error.code, error.message)
}

/// Returns the derivative `g'` of the factor `g` of a kernel entry with respect to `t`.
fn slope(node: Node, lowering: &mut Lowering) -> Result<Node, ExpressionError> {
    let graph = &mut lowering.graph;
    let slope = graph.gradient(node)?.into_iter().find(|&(input, _)| input == 0).map(|(_, slope)| slope);
    Ok(slope.unwrap_or_else(|| graph.constant(0.0)))
}

/// Returns the factor that remains of the derivative of the kernel entry `t^(a-1) g`: `(a - 1) g + t g'` for `a > 1`,
/// and `g'` for `a = 1`.
fn derivative(node: Node, a: f64, lowering: &mut Lowering) -> Result<Node, ExpressionError> {
    let slope = slope(node, lowering)?;
    if a == 1.0 {
        return Ok(slope);
    }
    let graph = &mut lowering.graph;
    let (t, factor) = (graph.input(0), graph.constant(a - 1.0));
    let (scaled, moved) = (graph.multiply(factor, node), graph.multiply(t, slope));
    Ok(graph.add(scaled, moved))
}
