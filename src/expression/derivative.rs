//! Reverse-mode differentiation by one sweep over the graph (Griewank and Walther 2008, section 3.2). Given the adjoint
//! `w = d root / d y` of a term `y = phi(a, b)`,
//!
//! ```text
//! d root / d a  +=  w d phi / d a,    d root / d b  +=  w d phi / d b
//! ```
//!
//! Adjoints are terms of the graph that contains the expression, a small number for each term of the expression.

use super::error::ExpressionError;
use super::graph::{Graph, Node, Term};
use super::operator::Operator;
use rustc_hash::FxHashSet;
use std::collections::BTreeMap;
use std::f64::consts::LN_10;

/// The largest number of terms in a graph of expressions, including the terms of their derivatives.
pub(super) const MAXIMUM_TERMS: usize = 2_000_000;

/// The variables of differentiation: inputs or parameters.
#[derive(Debug)]
enum By {
    /// Derivatives with respect to inputs. Terms in parameters alone are constant; derivatives that vanish at the
    /// given parameter values are dropped.
    Inputs,
    /// Derivatives with respect to parameters, with the set of all terms that depend on a parameter.
    Parameters(FxHashSet<Node>),
}

impl Graph {
    /// Returns the derivatives of `root` with respect to its inputs, as `(input, derivative)` sorted by input.
    /// Derivatives that vanish identically or at the given parameter values are dropped; the latter is recorded as an
    /// assumption.
    ///
    /// # Errors
    /// `too_many_nodes` if the graph exceeds two million terms.
    pub fn gradient(&mut self, root: Node) -> Result<Vec<(usize, Node)>, ExpressionError> {
        self.sweep(root, &By::Inputs)
    }

    /// Returns the derivatives of `root` with respect to its parameters, as `(parameter, derivative)` sorted by
    /// parameter. Derivatives that vanish identically are dropped.
    ///
    /// # Errors
    /// `too_many_nodes` if the graph exceeds two million terms.
    pub fn gradient_by_parameters(&mut self, root: Node) -> Result<Vec<(usize, Node)>, ExpressionError> {
        let mut terms = self.all_below(&[root]);
        // Sort by position: operands come before the terms that use them.
        terms.sort_unstable();
        let mut depending = FxHashSet::default();
        for y in terms {
            let depends = match self.terms[y.place()] {
                Term::Parameter(_) => true,
                Term::Apply(_, a, b) => depending.contains(&a) || depending.contains(&b),
                Term::Constant(_) | Term::Input(_) => false,
            };
            if depends {
                depending.insert(y);
            }
        }
        self.sweep(root, &By::Parameters(depending))
    }

    fn sweep(&mut self, root: Node, by: &By) -> Result<Vec<(usize, Node)>, ExpressionError> {
        let mut gradient = Vec::new();
        // Process the adjoints in descending order of their terms, so that the adjoint of the last term is complete.
        let mut adjoints = BTreeMap::from([(root, self.constant(1.0))]);
        while let Some((y, w)) = adjoints.pop_last() {
            if self.len() > MAXIMUM_TERMS {
                return Err(ExpressionError::too_many_nodes(0));
            }
            let chosen = match self.terms[y.place()] {
                Term::Apply(Operator::Choose, condition, a) => self.by_chosen(condition, a, w, by)?,
                _ => Vec::new(),
            };
            for (operand, contribution) in self.contributions(y, w, by).into_iter().flatten().chain(chosen) {
                if !self.is_nothing(contribution, by) {
                    let sum = match adjoints.get(&operand) {
                        Some(&adjoint) => self.add(adjoint, contribution),
                        None => contribution,
                    };
                    adjoints.insert(operand, sum);
                }
            }
            match (self.terms[y.place()], by) {
                (Term::Input(index), By::Inputs) | (Term::Parameter(index), By::Parameters(_))
                    if !self.is_nothing(w, by) =>
                {
                    gradient.push((index, w));
                }
                _ => {}
            }
        }
        gradient.sort_unstable_by_key(|&(index, _)| index);
        Ok(gradient)
    }

    /// Whether a derivative of an expression is zero, so that it is left out of the gradient.
    fn is_nothing(&mut self, derivative: Node, by: &By) -> bool {
        match by {
            By::Inputs => self.is_absent(derivative),
            By::Parameters(_) => self.number(derivative) == Some(0.0),
        }
    }

    /// Whether an operand depends on the inputs or parameters with respect to which derivatives are built.
    fn varies(&self, operand: Node, by: &By) -> bool {
        match by {
            By::Inputs => self.value(operand).is_none(),
            By::Parameters(depending) => depending.contains(&operand),
        }
    }

    /// Returns the contributions of the term `y` with adjoint `w` to the adjoints of its nonconstant operands.
    fn contributions(&mut self, y: Node, w: Node, by: &By) -> [Option<(Node, Node)>; 2] {
        let Term::Apply(operator, a, b) = self.terms[y.place()] else {
            return [None, None];
        };
        if let Some(&(base, exponent)) = self.powers.get(&y) {
            if !self.varies(base, by) {
                return [None, None];
            }
            let (k, less) = (self.constant(f64::from(exponent)), self.constant(f64::from(exponent - 1)));
            let slope = self.power(base, less);
            let slope = self.multiply(k, slope);
            return [Some((base, self.multiply(w, slope))), None];
        }
        let first = self.varies(a, by).then(|| (a, self.by_first(operator, a, b, y, w)));
        let second = match operator {
            Operator::Expanded => self.by_exponent(b, w, by),
            _ if operator.is_unary() || !self.varies(b, by) => None,
            _ => Some((b, self.by_second(operator, a, b, y, w))),
        };
        [first, second]
    }

    /// Returns the contributions of a `Choose` term (`a` if a condition holds, else 0) with adjoint `w`: the
    /// derivatives of `a` if chosen. These are taken directly with respect to the variables of differentiation,
    /// because derivatives of `a` may be undefined where it is not chosen, and zero adjoints would not suppress them.
    fn by_chosen(&mut self, condition: Node, a: Node, w: Node, by: &By) -> Result<Vec<(Node, Node)>, ExpressionError> {
        let mut contributions = Vec::new();
        if self.varies(a, by) {
            for (index, derivative) in self.sweep(a, by)? {
                let operand = self.intern(match by {
                    By::Inputs => Term::Input(index),
                    By::Parameters(_) => Term::Parameter(index),
                });
                let chosen = self.binary(Operator::Choose, condition, derivative);
                contributions.push((operand, self.multiply(w, chosen)));
            }
        }
        Ok(contributions)
    }

    /// Returns the contribution of an expanded power with adjoint `w` to its exponent; the contribution to its base
    /// is that of the expanded product.
    fn by_exponent(&mut self, power: Node, w: Node, by: &By) -> Option<(Node, Node)> {
        let Term::Apply(operator, base, exponent) = self.terms[power.place()] else { return None };
        self.varies(exponent, by).then(|| (exponent, self.by_second(operator, base, exponent, power, w)))
    }

    /// Builds the term `w d phi(a, b) / d a`, with `y = phi(a, b)`.
    fn by_first(&mut self, operator: Operator, a: Node, b: Node, y: Node, w: Node) -> Node {
        let one = self.constant(1.0);
        match operator {
            Operator::Negate => self.negate(w),
            Operator::Expanded => w,
            Operator::Sin => self.scaled(w, Operator::Cos, a),
            Operator::Cos => {
                let slope = self.scaled(w, Operator::Sin, a);
                self.negate(slope)
            }
            Operator::Tan => {
                let square = self.multiply(y, y);
                let slope = self.add(one, square);
                self.multiply(w, slope)
            }
            Operator::Asin => self.by_arc(w, a),
            Operator::Acos => {
                let slope = self.by_arc(w, a);
                self.negate(slope)
            }
            Operator::Atan => {
                let square = self.multiply(a, a);
                let denominator = self.add(one, square);
                self.divide(w, denominator)
            }
            Operator::Sinh => self.scaled(w, Operator::Cosh, a),
            Operator::Cosh => self.scaled(w, Operator::Sinh, a),
            Operator::Tanh => {
                let square = self.multiply(y, y);
                let slope = self.subtract(one, square);
                self.multiply(w, slope)
            }
            Operator::Exp => self.multiply(w, y),
            Operator::Ln => self.divide(w, a),
            Operator::Log10 => {
                let ln_10 = self.constant(LN_10);
                let denominator = self.multiply(ln_10, a);
                self.divide(w, denominator)
            }
            Operator::Sqrt => {
                let half = self.constant(0.5);
                let numerator = self.multiply(half, w);
                self.divide(numerator, y)
            }
            Operator::Cbrt => {
                let (three, square) = (self.constant(3.0), self.multiply(y, y));
                let denominator = self.multiply(three, square);
                self.divide(w, denominator)
            }
            // Use 2 H - 1 instead of the sign, whose value 0 at 0 is not a limit of derivatives.
            Operator::Abs => {
                let (two, step) = (self.constant(2.0), self.unary(Operator::Heaviside, a));
                let double = self.multiply(two, step);
                let slope = self.subtract(double, one);
                self.multiply(w, slope)
            }
            Operator::Sign | Operator::Heaviside | Operator::Greater | Operator::Gate | Operator::Choose => {
                self.constant(0.0)
            }
            Operator::Floor | Operator::Round | Operator::Parity | Operator::Piece => self.constant(0.0),
            Operator::Lookup => match self.table_of(operator, b).map(|table| table.derivative().clone()) {
                Some(table) => {
                    let slope = self.of_table(Operator::Lookup, &table, a);
                    self.multiply(w, slope)
                }
                None => self.constant(0.0),
            },
            Operator::Add | Operator::Subtract | Operator::Modulo => w,
            Operator::Multiply => self.multiply(w, b),
            Operator::Divide => self.divide(w, b),
            Operator::Power => {
                let less = self.subtract(b, one);
                let power = self.power(a, less);
                let slope = self.multiply(b, power);
                self.multiply(w, slope)
            }
            Operator::Atan2 => self.by_angle(w, b, a, b),
            Operator::Max => self.gate(a, b, w),
            Operator::Min => self.gate(b, a, w),
        }
    }

    /// Builds the term `w d phi(a, b) / d b`, with `y = phi(a, b)`, for a binary operator.
    fn by_second(&mut self, operator: Operator, a: Node, b: Node, y: Node, w: Node) -> Node {
        match operator {
            Operator::Add => w,
            Operator::Subtract => self.negate(w),
            Operator::Multiply => self.multiply(w, a),
            Operator::Divide => {
                let quotient = self.divide(w, b);
                let slope = self.multiply(quotient, y);
                self.negate(slope)
            }
            Operator::Power => {
                let logarithm = self.guarded_logarithm(a, self.is_varied(b));
                let slope = self.multiply(y, logarithm);
                self.multiply(w, slope)
            }
            Operator::Atan2 => {
                let slope = self.by_angle(w, a, a, b);
                self.negate(slope)
            }
            Operator::Max => self.gate_not(a, b, w),
            Operator::Min => self.gate_not(b, a, w),
            Operator::Gate => self.binary(Operator::Gate, a, w),
            Operator::Modulo => {
                let quotient = self.divide(a, b);
                let slope = self.scaled(w, Operator::Floor, quotient);
                self.negate(slope)
            }
            _ => self.constant(0.0),
        }
    }

    /// Builds the term `w phi(a)` for the function `phi` of an operator.
    fn scaled(&mut self, w: Node, operator: Operator, a: Node) -> Node {
        let slope = self.unary(operator, a);
        self.multiply(w, slope)
    }

    /// Builds the term `w / sqrt((1 - a)(1 + a))`, without cancellation near 1.
    fn by_arc(&mut self, w: Node, a: Node) -> Node {
        let one = self.constant(1.0);
        let (below, above) = (self.subtract(one, a), self.add(one, a));
        let product = self.multiply(below, above);
        let root = self.unary(Operator::Sqrt, product);
        self.divide(w, root)
    }

    /// Builds the term `w p / (a^2 + b^2)`, which occurs in the derivatives of `atan2`.
    fn by_angle(&mut self, w: Node, p: Node, a: Node, b: Node) -> Node {
        let (a, b) = (self.multiply(a, a), self.multiply(b, b));
        let square = self.add(a, b);
        let slope = self.divide(p, square);
        self.multiply(w, slope)
    }

    /// Builds the term that is `w` if `a > b`, else 0.
    fn gate(&mut self, a: Node, b: Node, w: Node) -> Node {
        let greater = self.binary(Operator::Greater, a, b);
        self.binary(Operator::Gate, greater, w)
    }

    /// Builds the term that is `w` unless `a > b`, else 0.
    fn gate_not(&mut self, a: Node, b: Node, w: Node) -> Node {
        let (one, greater) = (self.constant(1.0), self.binary(Operator::Greater, a, b));
        let not_greater = self.subtract(one, greater);
        self.binary(Operator::Gate, not_greater, w)
    }

    /// Builds `ln a` for the derivative of `a^y` with respect to `y`; it is 0 for `a = 0`, since `0^y` does not
    /// depend on `y > 0`. For `a < 0` the derivative does not exist: the term is 0 if `y` keeps its value, and NaN if
    /// `y` varies.
    fn guarded_logarithm(&mut self, a: Node, varies: bool) -> Node {
        let (zero, one) = (self.constant(0.0), self.constant(1.0));
        if varies {
            let is_zero = self.equal(a, zero);
            let argument = self.add(a, is_zero);
            return self.unary(Operator::Ln, argument);
        }
        let positive_part = self.gate(a, zero, a);
        let one_elsewhere = self.gate_not(a, zero, one);
        let argument = self.add(positive_part, one_elsewhere);
        self.unary(Operator::Ln, argument)
    }
}
