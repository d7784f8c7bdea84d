//! The pace of expressions in input 0 (time), independent of the other inputs: the largest rate of the phase of a sine
//! or of the exponent of an exponential,
//!
//! ```text
//! pace(p) = 0,   pace(sin a) = pace(exp a) = |a'|,   pace(a + b) = max(pace a, pace b),   pace(a b) = pace a + pace b
//! ```
//!
//! for polynomials `p` of low degree in time and `a` of first degree; a product of sines is a sum of sines of sums.

use super::graph::{Graph, Node, Term};
use super::operator::Operator;
use super::tape::Tape;
use rustc_hash::FxHashMap;

/// The degree in time up to which polynomials have pace zero: the stages of a step of any size resolve them.
const SLOW_DEGREE: u32 = 3;

/// The compiled pace of some expressions: the largest rate of the phase of a sine or of the exponent of an
/// exponential.
#[derive(Clone, Debug, Default)]
pub struct Pace {
    /// The program of the pace: `None` if the pace is unknown, without outputs if the pace is zero.
    tape: Option<Tape>,
    value: Vec<f64>,
}

/// The variation of a term with time: the degree of its polynomials, and its pace.
#[derive(Clone, Copy)]
struct Variation {
    /// The degree of the polynomials in time that occur in the term.
    degree: u32,
    /// The pace of the term (the largest rate of the phase of a sine or of the exponent of an exponential in it);
    /// `None` if it is zero.
    pace: Option<Node>,
}

impl Pace {
    /// Compiles the pace of `nodes` in input 0 (time): the largest rate of the phase of a sine or of the exponent of
    /// an exponential.
    pub fn new(graph: &mut Graph, nodes: &[Node]) -> Self {
        let pace = graph.pace(nodes);
        let value = vec![0.0; usize::from(pace.flatten().is_some())];
        Self { tape: pace.map(|pace| Tape::compile(graph, pace.as_slice())), value }
    }

    /// Binds new parameter values to the compiled pace of the expressions.
    pub fn bind(&mut self, parameters: &[f64]) {
        if let Some(tape) = &mut self.tape {
            tape.bind(parameters);
        }
    }

    /// Returns the pace (the largest rate of the phase of a sine or of the exponent of an exponential) in radians per
    /// unit of time: zero without time dependence or for polynomials of low degree, infinite if unknown.
    pub fn fastest(&mut self) -> f64 {
        let Some(tape) = &mut self.tape else { return f64::INFINITY };
        tape.evaluate(0.0, &[], &mut self.value);
        self.value.first().map_or(0.0, |pace| if pace.is_nan() { f64::INFINITY } else { *pace })
    }
}

impl Graph {
    /// Builds the term of the largest pace (rate of the phase of a sine or of the exponent of an exponential) of
    /// `nodes`: `None` if it is unknown, `Some(None)` if it is zero.
    fn pace(&mut self, nodes: &[Node]) -> Option<Option<Node>> {
        let mut terms = self.terms_below(nodes);
        terms.sort_unstable();
        let mut courses: FxHashMap<Node, Variation> = FxHashMap::default();
        // Operands come before the terms that use them.
        for node in terms {
            let course = match (self.terms[node.place()], self.operation(node)) {
                (Term::Input(0), _) => Some(Variation { degree: 1, pace: None }),
                (_, None) => Some(Variation { degree: 0, pace: None }),
                (_, Some(operation)) => self.course(operation, &courses),
            };
            if let Some(course) = course {
                courses.insert(node, course);
            }
        }
        let mut fastest = None;
        for node in nodes {
            let course = courses.get(node).filter(|course| course.degree <= SLOW_DEGREE)?;
            fastest = self.faster(fastest, course.pace);
        }
        Some(fastest)
    }

    fn course(
        &mut self,
        (operator, a, b): (Operator, Node, Node),
        known: &FxHashMap<Node, Variation>,
    ) -> Option<Variation> {
        let of_a = *known.get(&a)?;
        let of_b = if operator.is_unary() { Variation { degree: 0, pace: None } } else { *known.get(&b)? };
        let is_still = |course: Variation| course.degree == 0 && course.pace.is_none();
        match operator {
            Operator::Negate | Operator::Expanded => Some(of_a),
            Operator::Add | Operator::Subtract => {
                let degree = of_a.degree.max(of_b.degree);
                Some(Variation { degree, pace: self.faster(of_a.pace, of_b.pace) })
            }
            Operator::Multiply => {
                let degree = of_a.degree.saturating_add(of_b.degree);
                let pace = match (of_a.pace, of_b.pace) {
                    (Some(a), Some(b)) => Some(self.add(a, b)),
                    (a, b) => a.or(b),
                };
                Some(Variation { degree, pace })
            }
            Operator::Divide if is_still(of_b) => Some(of_a),
            Operator::Sin | Operator::Cos | Operator::Exp if of_a.degree == 1 && of_a.pace.is_none() => {
                let gradient = self.gradient(a).ok()?;
                let (_, slope) = gradient.into_iter().find(|(input, _)| *input == 0)?;
                // The pace is known only if the slope of the argument with respect to time depends on parameters
                // alone.
                let is_fixed = self.inputs(slope).is_empty();
                is_fixed.then(|| Variation { degree: 0, pace: Some(self.unary(Operator::Abs, slope)) })
            }
            // Functions of time alone with breaks at the zero or at the integer values of an argument of first
            // degree: steps end at these breaks.
            Operator::Abs
            | Operator::Sign
            | Operator::Heaviside
            | Operator::Min
            | Operator::Max
            | Operator::Floor
            | Operator::Round
            | Operator::Modulo
                if self.inputs_of(&[a, b]) == [0] && of_a.degree.max(of_b.degree) == 1 =>
            {
                let is_smooth = of_a.pace.or(of_b.pace).is_none();
                is_smooth.then_some(Variation { degree: 1, pace: None })
            }
            Operator::Lookup if self.inputs(a) == [0] && of_a.degree == 1 && of_a.pace.is_none() => {
                Some(Variation { degree: self.table_of(operator, b)?.degree(), pace: None })
            }
            _ => (is_still(of_a) && is_still(of_b)).then_some(Variation { degree: 0, pace: None }),
        }
    }

    fn faster(&mut self, a: Option<Node>, b: Option<Node>) -> Option<Node> {
        match (a, b) {
            (Some(a), Some(b)) if a != b => Some(self.binary(Operator::Max, a, b)),
            (a, b) => a.or(b),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scope;
    use super::*;

    fn fastest(text: &str) -> f64 {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        for (index, name) in ["t", "x"].into_iter().enumerate() {
            scope.bind(name, graph.input(index)).unwrap();
        }
        let node = graph.parse(text, &scope).unwrap();
        Pace::new(&mut graph, &[node]).fastest()
    }

    #[test]
    fn phases_of_sines_and_exponents_set_the_pace() {
        assert_eq!(fastest("x^2*exp(x) + 3"), 0.0);
        assert_eq!(fastest("x*t^2 - t/3"), 0.0);
        assert_eq!(fastest("sin(3*t + x) - 2*cos(50*t - 1)/x"), 50.0);
        assert_eq!(fastest("t*exp(-2*t)*sin(5*t)"), 7.0);
        assert_eq!(fastest("min(t/2, 1)*sin(4*t) + heaviside(t - 3)*x"), 4.0);
        for unknown in ["sin(t^2)", "sin(x*t)", "1/(1 + t)", "exp(-(t - 5)^2)", "sqrt(t)", "abs(sin(t))", "t^7"] {
            assert_eq!(fastest(unknown), f64::INFINITY, "{unknown}");
        }
    }
}
