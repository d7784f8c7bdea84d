//! Operators of terms. Constant folding and program evaluation both call [`Operator::apply`], so that folding never
//! changes a value.

use super::cube_root::cube_root;

/// The operator of a term.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Operator {
    Negate,
    /// A power whose exponent depends on parameters, expanded into products: the first operand is the product, which
    /// gives the value, the second the general power.
    Expanded,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Ln,
    Log10,
    Sqrt,
    Cbrt,
    Abs,
    Sign,
    Heaviside,
    /// The largest integer not above the operand.
    Floor,
    /// The nearest integer, ties away from zero.
    Round,
    /// The parity: 1 for even integers, -1 for odd integers.
    Parity,
    // The operators with two operands follow.
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Atan2,
    Min,
    Max,
    /// The comparison that is 1 if `a > b`, else 0.
    Greater,
    /// The gate: `b` if `a` is not 0, else 0 for any `b`, as the branch that is not taken may be infinite.
    Gate,
    /// The choice: `b` if the condition `a` holds, else 0.
    Choose,
    /// The remainder `a - b floor(a / b)`, which has the sign of `b`.
    Modulo,
    // The table operators, whose second operand is the index of the table.
    /// The value of a table at the first operand.
    Lookup,
    /// The number of knots up to the argument at which the polynomial of a table changes.
    Piece,
}

impl Operator {
    /// Whether the operator has one operand; the second operand of its node is then ignored.
    pub(super) fn is_unary(self) -> bool {
        self < Self::Add
    }

    /// Whether the operator needs a table, and is applied by [`Tables`](super::table::Tables).
    pub(super) fn takes_table(self) -> bool {
        self >= Self::Lookup
    }

    /// Whether the two operands of the operator may be exchanged.
    pub(super) fn commutes(self) -> bool {
        matches!(self, Self::Add | Self::Multiply)
    }

    /// Whether the operator jumps (and does not only have a kink) where its switch, an event function, changes sign.
    pub(super) fn jumps(self) -> bool {
        matches!(self, Self::Sign | Self::Heaviside) || self.has_steps()
    }

    /// Whether the operator jumps at integer values of its operand (or quotient of operands).
    pub(super) fn has_steps(self) -> bool {
        matches!(self, Self::Floor | Self::Round | Self::Parity | Self::Modulo)
    }

    /// Returns the name of the function in the language, if it has a kink or a jump.
    pub(super) fn kink(self) -> Option<&'static str> {
        match self {
            Self::Abs => Some("abs"),
            Self::Sign => Some("sign"),
            Self::Heaviside => Some("heaviside"),
            Self::Min => Some("min"),
            Self::Max => Some("max"),
            Self::Floor => Some("floor"),
            Self::Round => Some("round"),
            Self::Modulo => Some("mod"),
            _ => None,
        }
    }

    /// Returns the value of the operator at `(a, b)`. NaN propagates, unlike in `f64::min` and `f64::max`.
    #[inline(always)]
    pub(super) fn apply(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Negate => -a,
            Self::Expanded => a,
            Self::Sin => a.sin(),
            Self::Cos => a.cos(),
            Self::Tan => a.tan(),
            Self::Asin => a.asin(),
            Self::Acos => a.acos(),
            Self::Atan => a.atan(),
            Self::Sinh => a.sinh(),
            Self::Cosh => a.cosh(),
            Self::Tanh => a.tanh(),
            Self::Exp => a.exp(),
            Self::Ln => a.ln(),
            Self::Log10 => a.log10(),
            Self::Sqrt => a.sqrt(),
            Self::Cbrt => cube_root(a),
            Self::Abs => a.abs(),
            Self::Sign if a > 0.0 => 1.0,
            Self::Sign if a < 0.0 => -1.0,
            Self::Sign => a,
            Self::Heaviside if a >= 0.0 => 1.0,
            Self::Heaviside if a < 0.0 => 0.0,
            Self::Heaviside => a,
            Self::Floor => a.floor(),
            Self::Round => a.round(),
            Self::Parity if 2.0 * (0.5 * a).floor() == a => 1.0,
            Self::Parity if a.is_nan() => a,
            Self::Parity => -1.0,
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Power => a.powf(b),
            Self::Atan2 => a.atan2(b),
            Self::Min if a < b || a.is_nan() => a,
            Self::Max if a > b || a.is_nan() => a,
            Self::Min | Self::Max => b,
            Self::Greater if a > b => 1.0,
            Self::Greater => 0.0,
            Self::Gate if a != 0.0 => b,
            Self::Gate => 0.0,
            Self::Choose if a == 0.0 || a.is_nan() => a,
            Self::Choose => b,
            Self::Modulo => a - b * (a / b).floor(),
            // Tables are looked up by `Tables::apply`.
            Self::Lookup | Self::Piece => f64::NAN,
        }
    }
}
