//! The operations of a term, on one pair of numbers. Constant folding and the tape both call [`Operator::apply`], so
//! that folding never changes a value.

/// What a term does with its operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Operator {
    Negate,
    /// The first operand, which is the second with an exponent that parameters give written out as products.
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
    // Binary from here on.
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Atan2,
    Min,
    Max,
    /// 1 where `a > b`, else 0.
    Greater,
    /// `b` where `a` is not 0, else 0 whatever `b` is: the branch not taken may be infinite.
    Gate,
}

impl Operator {
    /// Whether the second operand is ignored.
    pub(super) fn is_unary(self) -> bool {
        self < Self::Add
    }

    /// Whether the operands may be exchanged.
    pub(super) fn commutes(self) -> bool {
        matches!(self, Self::Add | Self::Multiply)
    }

    /// The name of a function that has a kink or a jump.
    pub(super) fn kink(self) -> Option<&'static str> {
        match self {
            Self::Abs => Some("abs"),
            Self::Sign => Some("sign"),
            Self::Heaviside => Some("heaviside"),
            Self::Min => Some("min"),
            Self::Max => Some("max"),
            _ => None,
        }
    }

    /// The value at `(a, b)`. NaN passes through; `f64::min` and `f64::max` would drop it.
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
            Self::Cbrt => a.cbrt(),
            Self::Abs => a.abs(),
            Self::Sign if a > 0.0 => 1.0,
            Self::Sign if a < 0.0 => -1.0,
            Self::Sign => a,
            Self::Heaviside if a >= 0.0 => 1.0,
            Self::Heaviside if a < 0.0 => 0.0,
            Self::Heaviside => a,
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
        }
    }
}
