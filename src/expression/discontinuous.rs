//! Discontinuous, mostly periodic functions of time and parameters: steps end where one of their
//! [switches](super::switches) changes sign. Jumps that depend on a state or a variable must be modelled by a convex
//! set.
//!
//! ```text
//! ceil(a) = -floor(-a)                    sawtooth(t, T) = mod(t/T, 1)        triangle(t, T) = 1 - |2 sawtooth(t, T) - 1|
//! pwm(t, T, d) = floor(t/T) - floor(t/T - d)            pulse(t, s, w) = H(t - s) (1 - H(t - s - w))
//! ```

use super::graph::{Graph, Node};
use super::operator::Operator;
use super::parameters::Assumption;

/// A discontinuous function of the expression language, such as `floor`, `mod`, `if` or a pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Discontinuous {
    Floor,
    Ceil,
    Round,
    Modulo,
    /// The choice `if(c, a, b)`, whose first argument is a condition.
    If,
    Pwm,
    Sawtooth,
    Triangle,
    Pulse,
}

/// The admissible range of an argument of a discontinuous function.
#[derive(Clone, Copy, Debug)]
enum Range {
    Positive,
    NotNegative,
    NotZero,
    /// A fraction from 0 to 1, such as a duty cycle.
    Share,
}

/// An argument of a discontinuous function whose value is out of its admissible range.
pub(super) struct OutOfRange {
    pub argument: &'static str,
    pub value: f64,
    pub expected: &'static str,
}

impl Discontinuous {
    /// Returns the number of arguments that a discontinuous function takes, in words and as a number.
    pub(super) fn arity(self) -> (&'static str, usize) {
        match self {
            Self::Floor | Self::Ceil | Self::Round => ("one argument", 1),
            Self::Modulo | Self::Sawtooth | Self::Triangle => ("two arguments", 2),
            Self::If | Self::Pwm | Self::Pulse => ("three arguments", 3),
        }
    }

    /// Returns the source text of a call of the discontinuous function and a description in words, for messages.
    pub(super) fn usage(self) -> &'static str {
        match self {
            Self::Floor => "`floor(a)`, the largest whole number up to a",
            Self::Ceil => "`ceil(a)`, the smallest whole number from a on",
            Self::Round => "`round(a)`, the nearest whole number; to digits: `round(a*100)/100`",
            Self::Modulo => "`mod(a, b)`, the remainder of a divided by b, with the sign of b",
            Self::If => "`if(c, a, b)`, which is a if the condition c is true, and b otherwise",
            Self::Pwm => {
                "`pwm(t, period, duty)`: 1 in the first fraction `duty`, from 0 to 1, of each period, and 0 in the \
                 rest; for levels, a delay and signs write `low + (high - low)*pwm(t - delay, period, duty)`"
            }
            Self::Sawtooth => {
                "`sawtooth(t, period)`, which rises from 0 to 1 in each period; from -1 to 1: `2*sawtooth(t, 2*pi) - 1`"
            }
            Self::Triangle => {
                "`triangle(t, period)`, which rises from 0 to 1 in the first half of each period and falls in the second"
            }
            Self::Pulse => {
                "`pulse(t, start, width)`, which is 1 from `start` on for `width`, else 0; repeated: `pwm(t - start, \
                 period, width/period)`; with slopes: a table"
            }
        }
    }

    /// Returns the remedy for a discontinuous function one of whose arguments depends on a state or a variable, for
    /// messages.
    pub(super) fn as_set(self) -> &'static str {
        match self {
            Self::Floor | Self::Ceil | Self::Round => {
                "a variable in a set for each step: at a = k `floor(a)` rises by z, with z in the box [0, 1] and the \
                 inequality k - a"
            }
            Self::Pwm => {
                "a variable in a set: `pwm(t, T, d)` = z with z in the box [0, 1] and the inequality sawtooth(t, T) - \
                 d; T must not depend on states"
            }
            Self::Modulo | Self::Sawtooth | Self::Triangle => {
                "a periodic function without jumps, such as `sin` or `cos`; or a variable in a set for each jump: at \
                 a = k*b `mod(a, b)` falls by b*z, with z in the box [0, 1] and the inequality k*b - a"
            }
            Self::If | Self::Pulse => super::conditions::AS_SET,
        }
    }

    /// Reports the first argument of a discontinuous function whose known value is out of its admissible range. The
    /// other arguments are assumed to be in range; the assumptions are recorded in `graph`.
    pub(super) fn check(self, graph: &mut Graph, arguments: &[Node]) -> Result<(), OutOfRange> {
        let ranges: &[(usize, &'static str, Range)] = match self {
            Self::Modulo => &[(1, "divisor", Range::NotZero)],
            Self::Sawtooth | Self::Triangle => &[(1, "period", Range::Positive)],
            Self::Pwm => &[(1, "period", Range::Positive), (2, "duty", Range::Share)],
            Self::Pulse => &[(2, "width", Range::NotNegative)],
            _ => &[],
        };
        for &(place, argument, range) in ranges {
            let holds = range.holds(graph, arguments[place]);
            if graph.value(holds) == Some(0.0) {
                let value = graph.value(arguments[place]).unwrap_or(f64::NAN);
                return Err(OutOfRange { argument, value, expected: range.expected() });
            }
            graph.assume(holds, Assumption::Value);
        }
        Ok(())
    }

    /// Builds the term of a discontinuous function from its arguments, whose number must be correct.
    pub(super) fn apply(self, graph: &mut Graph, arguments: &[Node]) -> Node {
        let a = arguments[0];
        match self {
            Self::Floor => graph.unary(Operator::Floor, a),
            Self::Ceil => {
                let minus = graph.negate(a);
                let below = graph.unary(Operator::Floor, minus);
                graph.negate(below)
            }
            Self::Round => graph.unary(Operator::Round, a),
            Self::Modulo => graph.binary(Operator::Modulo, a, arguments[1]),
            Self::If => graph.choice(a, arguments[1], arguments[2]),
            Self::Pwm => graph.pwm(a, arguments[1], arguments[2]),
            Self::Sawtooth => graph.sawtooth(a, arguments[1]),
            Self::Triangle => {
                let (one, two) = (graph.constant(1.0), graph.constant(2.0));
                let rising = graph.sawtooth(a, arguments[1]);
                let double = graph.multiply(two, rising);
                let from_middle = graph.subtract(double, one);
                let distance = graph.unary(Operator::Abs, from_middle);
                graph.subtract(one, distance)
            }
            Self::Pulse => {
                let since_start = graph.subtract(a, arguments[1]);
                let end = graph.add(arguments[1], arguments[2]);
                let since_end = graph.subtract(a, end);
                let (begun, ended) = (graph.heaviside(since_start), graph.heaviside(since_end));
                let goes_on = graph.not(ended);
                graph.multiply(begun, goes_on)
            }
        }
    }
}

impl Range {
    /// Builds the condition that the value of an argument is in this admissible range.
    fn holds(self, graph: &mut Graph, a: Node) -> Node {
        let (zero, one) = (graph.constant(0.0), graph.constant(1.0));
        match self {
            Self::Positive => graph.at_least(zero, a, true),
            Self::NotNegative => graph.at_least(a, zero, false),
            Self::NotZero => {
                let is_zero = graph.equal(a, zero);
                graph.not(is_zero)
            }
            Self::Share => {
                let (above, below) = (graph.at_least(a, zero, false), graph.at_least(one, a, false));
                graph.multiply(above, below)
            }
        }
    }

    fn expected(self) -> &'static str {
        match self {
            Self::Positive => "a number above 0",
            Self::NotNegative => "0 or more",
            Self::NotZero => "a number other than 0",
            Self::Share => "a fraction of the period, from 0 to 1; 50 % is 0.5",
        }
    }
}

impl Graph {
    /// Builds the term of the elapsed fraction of the current period at the time `t`: `mod(t/period, 1)`.
    fn sawtooth(&mut self, t: Node, period: Node) -> Node {
        let (one, periods) = (self.constant(1.0), self.divide(t, period));
        self.binary(Operator::Modulo, periods, one)
    }

    /// Builds the term that is 1 while the elapsed fraction of the period is below `duty`, else 0. A time-dependent
    /// duty cycle is clamped to `[0, 1]`.
    fn pwm(&mut self, t: Node, period: Node, duty: Node) -> Node {
        let duty = if self.value(duty).is_some() {
            duty
        } else {
            let (zero, one) = (self.constant(0.0), self.constant(1.0));
            let below_one = self.binary(Operator::Min, duty, one);
            self.binary(Operator::Max, below_one, zero)
        };
        let periods = self.divide(t, period);
        let late = self.subtract(periods, duty);
        let (begun, ended) = (self.unary(Operator::Floor, periods), self.unary(Operator::Floor, late));
        self.subtract(begun, ended)
    }
}
