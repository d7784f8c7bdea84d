//! Derivatives, by one sweep in reverse over the graph (Griewank and Walther 2008, section 3.2): with the adjoint
//! `w = d root / d y` of a term `y = phi(a, b)` known,
//!
//! ```text
//! d root / d a  +=  w d phi / d a,    d root / d b  +=  w d phi / d b
//! ```
//!
//! The adjoints are terms of the same graph, at most a few for each term of the expression.

use super::error::ExpressionError;
use super::graph::{Graph, Node, Term};
use super::operator::Operator;
use rustc_hash::FxHashSet;
use std::collections::BTreeMap;
use std::f64::consts::LN_10;

/// The largest number of terms in a graph, derivatives included.
pub(super) const MAXIMUM_TERMS: usize = 2_000_000;

/// What is differentiated by.
#[derive(Debug)]
enum By {
    /// The inputs; what parameters alone decide is constant, and what vanishes at the values given is left out.
    Inputs,
    /// The parameters, by way of these terms: those that depend on one.
    Parameters(FxHashSet<Node>),
}

impl Graph {
    /// The inputs that `root` has a derivative by, and the derivatives, sorted by input; those that vanish
    /// identically are left out, and those that vanish with the parameters given, which is assumed from then on.
    ///
    /// # Errors
    /// `too_many_nodes` when the graph has grown past two million terms.
    pub fn gradient(&mut self, root: Node) -> Result<Vec<(usize, Node)>, ExpressionError> {
        self.sweep(root, &By::Inputs)
    }

    /// The parameters that `root` has a derivative by, and the derivatives, sorted by parameter; those that vanish
    /// whatever the parameters are left out.
    ///
    /// # Errors
    /// `too_many_nodes` when the graph has grown past two million terms.
    pub fn gradient_by_parameters(&mut self, root: Node) -> Result<Vec<(usize, Node)>, ExpressionError> {
        let mut terms = self.all_below(&[root]);
        // Operands stand before the terms that use them.
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
        // Sorted by place, so that the last one has all that its users contribute.
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

    /// Whether a derivative is left out.
    fn is_nothing(&mut self, derivative: Node, by: &By) -> bool {
        match by {
            By::Inputs => self.vanishes(derivative),
            By::Parameters(_) => self.number(derivative) == Some(0.0),
        }
    }

    /// Whether an operand has a derivative.
    fn varies(&self, operand: Node, by: &By) -> bool {
        match by {
            By::Inputs => self.value(operand).is_none(),
            By::Parameters(depending) => depending.contains(&operand),
        }
    }

    /// What `y` with adjoint `w` gives to the adjoints of its operands. Constants need none.
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

    /// What `a` where a condition holds, with adjoint `w`, gives to what is differentiated by: the derivatives of `a` as they
    /// are chosen. Where it is not they may not exist, and an adjoint of 0 would not hide that.
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

    /// What a power that is written out, with adjoint `w`, gives to its exponent; its base has its share by the product.
    fn by_exponent(&mut self, power: Node, w: Node, by: &By) -> Option<(Node, Node)> {
        let Term::Apply(operator, base, exponent) = self.terms[power.place()] else { return None };
        self.varies(exponent, by).then(|| (exponent, self.by_second(operator, base, exponent, power, w)))
    }

    /// `w d phi(a, b) / d a`, with `y = phi(a, b)`.
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
            // 2 H - 1 rather than the sign, which is 0 at 0 and no limit of derivatives there.
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

    /// `w d phi(a, b) / d b`, with `y = phi(a, b)`, of a binary operator.
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
                let logarithm = self.guarded_logarithm(a);
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

    /// `w phi(a)`
    fn scaled(&mut self, w: Node, operator: Operator, a: Node) -> Node {
        let slope = self.unary(operator, a);
        self.multiply(w, slope)
    }

    /// `w / sqrt((1 - a)(1 + a))`, which loses no digits near 1.
    fn by_arc(&mut self, w: Node, a: Node) -> Node {
        let one = self.constant(1.0);
        let (below, above) = (self.subtract(one, a), self.add(one, a));
        let product = self.multiply(below, above);
        let root = self.unary(Operator::Sqrt, product);
        self.divide(w, root)
    }

    /// `w p / (a^2 + b^2)`
    fn by_angle(&mut self, w: Node, p: Node, a: Node, b: Node) -> Node {
        let (a, b) = (self.multiply(a, a), self.multiply(b, b));
        let square = self.add(a, b);
        let slope = self.divide(p, square);
        self.multiply(w, slope)
    }

    /// `w` where `a > b`, else 0.
    fn gate(&mut self, a: Node, b: Node, w: Node) -> Node {
        let greater = self.binary(Operator::Greater, a, b);
        self.binary(Operator::Gate, greater, w)
    }

    /// `w` where not `a > b`, else 0.
    fn gate_not(&mut self, a: Node, b: Node, w: Node) -> Node {
        let (one, greater) = (self.constant(1.0), self.binary(Operator::Greater, a, b));
        let not_greater = self.subtract(one, greater);
        self.binary(Operator::Gate, not_greater, w)
    }

    /// `ln a` where `a > 0`, else 0: `0^y` does not depend on `y > 0`, and below 0 there is no derivative by `y`.
    fn guarded_logarithm(&mut self, a: Node) -> Node {
        let (zero, one) = (self.constant(0.0), self.constant(1.0));
        let positive_part = self.gate(a, zero, a);
        let one_elsewhere = self.gate_not(a, zero, one);
        let argument = self.add(positive_part, one_elsewhere);
        self.unary(Operator::Ln, argument)
    }
}
