//! Powers `x^y`. Small integer exponents are expanded into products, by `x^(2k) = (x^k)^2`, and exponents `+-1/2`
//! into square roots: both are an order of magnitude faster than the general power, and integer powers accept any
//! sign of `x`. If the exponent depends on parameters, its value is recorded as an assumption, and the general power
//! is kept beside the product for derivatives with respect to the exponent.

use super::graph::{Graph, Node};
use super::operator::Operator;
use super::parameters::Assumption;

/// The largest integer exponent with which a power is expanded into products. Each squaring doubles the relative error:
/// 16 costs a few units in the last place.
const LARGEST: f64 = 16.0;

impl Graph {
    /// Returns the node of `x^y`.
    pub fn power(&mut self, x: Node, y: Node) -> Node {
        let fixed = self.value(y).filter(|_| !self.is_varied(y));
        let Some(expanded) = fixed.and_then(|exponent| self.expanded(x, exponent)) else {
            return self.binary(Operator::Power, x, y);
        };
        if self.number(y).is_some() {
            return expanded;
        }
        self.assume(y, Assumption::Value);
        let power = self.binary(Operator::Power, x, y);
        let value = self.value(expanded);
        self.applied(Operator::Expanded, expanded, power, value)
    }

    /// Expands `x^exponent` into products and square roots; returns `None` if it is not expanded.
    fn expanded(&mut self, x: Node, exponent: f64) -> Option<Node> {
        if exponent == exponent.trunc() && exponent.abs() <= LARGEST {
            return Some(self.whole_power(x, exponent as i32));
        }
        if exponent.abs() != 0.5 {
            return None;
        }
        let root = self.unary(Operator::Sqrt, x);
        Some(if exponent > 0.0 { root } else { self.reciprocal(root) })
    }

    fn whole_power(&mut self, x: Node, exponent: i32) -> Node {
        let mut product = None;
        let mut square = x;
        let mut rest = exponent.unsigned_abs();
        while rest > 0 {
            if rest % 2 == 1 {
                product = Some(product.map_or(square, |product| self.multiply(product, square)));
            }
            rest /= 2;
            if rest > 0 {
                square = self.multiply(square, square);
            }
        }
        let power = match product {
            None => self.constant(1.0),
            Some(product) if exponent < 0 => self.reciprocal(product),
            Some(product) => product,
        };
        // Record the power only if its base comes before it; signs moved outwards can reverse the order.
        if x < power {
            self.powers.insert(power, (x, exponent));
        }
        power
    }

    fn reciprocal(&mut self, x: Node) -> Node {
        let one = self.constant(1.0);
        self.divide(one, x)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Tape;
    use super::*;

    fn value(exponent: f64, x: f64) -> f64 {
        let mut graph = Graph::new();
        let (input, exponent) = (graph.input(0), graph.constant(exponent));
        let power = graph.power(input, exponent);
        let mut output = [0.0];
        Tape::compile(&graph, &[power]).evaluate(x, &[], &mut output);
        output[0]
    }

    #[test]
    fn written_out_powers_agree_with_the_general_power() {
        for exponent in -20..=20 {
            for x in [-2.5_f64, -1.0, 0.3, 7.0] {
                let expected = x.powf(f64::from(exponent));
                let error = (value(f64::from(exponent), x) - expected).abs();
                assert!(error <= 1e-14 * expected.abs(), "{x}^{exponent}: off by {error}");
            }
        }
        assert_eq!(value(0.5, 2.0), 2f64.sqrt());
        assert_eq!(value(-0.5, 4.0), 0.5);
        assert_eq!(value(2.5, 4.0), 32.0);
        assert_eq!(value(0.0, 0.0), 1.0);
        assert_eq!(value(-1.0, 0.0), f64::INFINITY);
        assert!(value(0.5, -1.0).is_nan());
    }

    #[test]
    fn the_sixteenth_power_takes_four_products() {
        let mut graph = Graph::new();
        let (x, sixteen) = (graph.input(0), graph.constant(16.0));
        let power = graph.power(x, sixteen);
        assert_eq!(Tape::compile(&graph, &[power]).instructions(), 4);
    }
}
