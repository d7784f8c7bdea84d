//! Invalid data of an obstacle problem: values that are not finite or out of range.

use crate::finite_elements::Side;
use std::fmt;

/// An invalid value of the data of an obstacle problem, with its position and time.
#[derive(Clone, Debug, PartialEq)]
pub enum ObstacleDataError {
    /// An expression of the obstacle problem has no finite value.
    NotFinite {
        /// The key, in a specification, of the expression without a finite value.
        key: String,
        /// The value of the expression, NaN or infinite.
        value: f64,
        /// The position at which the expression has no finite value.
        at: [f64; 3],
        /// The time at which the expression has no finite value.
        t: f64,
    },
    /// The diffusion coefficient is negative, so that the equation would be ill-posed.
    NegativeDiffusion {
        /// The value of the diffusion coefficient, which is negative.
        value: f64,
        /// The position at which the diffusion coefficient is negative.
        at: [f64; 3],
        /// The time at which the diffusion coefficient is negative.
        t: f64,
    },
    /// The lower obstacle is above the upper obstacle.
    Crossing {
        /// The value of the lower obstacle where the obstacles cross.
        lower: f64,
        /// The value of the upper obstacle where the obstacles cross.
        upper: f64,
        /// The position at which the obstacles cross.
        at: [f64; 3],
        /// The time at which the obstacles cross.
        t: f64,
    },
    /// A Dirichlet value on a side of the domain is beyond an obstacle.
    GivenBeyond {
        /// The side of the domain with the Dirichlet condition.
        side: Side,
        /// The value of the solution `u` that the Dirichlet condition prescribes.
        value: f64,
        /// The value of the obstacle beyond which the Dirichlet value lies.
        bound: f64,
        /// The position at which the Dirichlet value is beyond the obstacle.
        at: [f64; 3],
        /// The time at which the Dirichlet value is beyond the obstacle.
        t: f64,
    },
    /// The initial value of the solution `u` is beyond an obstacle.
    InitialBeyond {
        /// The initial value of the solution `u` where it is beyond the obstacle.
        value: f64,
        /// The value of the obstacle beyond which the initial value lies.
        bound: f64,
        /// The position at which the initial value is beyond the obstacle.
        at: [f64; 3],
    },
}

impl ObstacleDataError {
    /// Returns the key, in a specification, of the expression with the invalid value.
    pub fn key(&self) -> String {
        match self {
            Self::NotFinite { key, .. } => key.clone(),
            Self::NegativeDiffusion { .. } => "diffusion".to_owned(),
            Self::Crossing { .. } => "obstacle".to_owned(),
            Self::GivenBeyond { side, .. } => format!("boundary/{}/dirichlet", side.name()),
            Self::InitialBeyond { .. } => "initial".to_owned(),
        }
    }

    /// Returns a machine-readable code of the error, which does not change between versions.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NotFinite { .. } => "not_finite",
            Self::NegativeDiffusion { .. } => "out_of_range",
            Self::Crossing { .. } => "empty_set",
            Self::GivenBeyond { .. } | Self::InitialBeyond { .. } => "beyond_obstacle",
        }
    }

    /// Returns a description of the valid values of the expression, for error messages.
    pub fn expected(&self) -> &'static str {
        match self {
            Self::NotFinite { .. } => "a finite value in the whole domain",
            Self::NegativeDiffusion { .. } => "a diffusion that is nonnegative everywhere",
            Self::Crossing { .. } => "a lower obstacle that is nowhere above the upper one",
            Self::GivenBeyond { .. } => "a value between the obstacles",
            Self::InitialBeyond { .. } => "a value between the obstacles, such as its `max` with the lower one",
        }
    }
}

impl fmt::Display for ObstacleDataError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite { key, value, at: [x, y, z], t } => write!(
                formatter,
                "`{key}` is {value} at ({x}, {y}, {z}) and t = {t:?}: a division by zero, a function outside its domain, or \
                 a number too large"
            ),
            Self::NegativeDiffusion { value, at: [x, y, z], t } => {
                write!(formatter, "the diffusion is {value} at ({x}, {y}, {z}) and t = {t:?}")
            }
            Self::Crossing { lower, upper, at: [x, y, z], t } => write!(
                formatter,
                "the lower obstacle {lower} is above the upper one {upper} at ({x}, {y}, {z}) and t = {t:?}"
            ),
            Self::GivenBeyond { side, value, bound, at: [x, y, z], t } => write!(
                formatter,
                "the value {value} given on `{}` is beyond the obstacle {bound} at ({x}, {y}, {z}) and t = {t:?}",
                side.name()
            ),
            Self::InitialBeyond { value, bound, at: [x, y, z] } => write!(
                formatter,
                "the initial value {value} is beyond the obstacle {bound} at ({x}, {y}, {z}), by {:e}",
                (value - bound).abs()
            ),
        }
    }
}
