//! Radau IIA with a variational inequality at every stage.
//!
//! ```text
//! M v_i = M x_n + h sum_j a_ij F(t_j, v_j, z_j),    z_i in K,    <G(t_i, v_i, z_i), z~ - z_i> >= 0,    x_{n+1} = v_s
//! ```
//!
//! With `m = 0` this is the stiff ODE solver of Hairer and Wanner (Solving Ordinary Differential Equations II, 1996,
//! sections IV.8 and VII), with `K = R^m` their solver of differential-algebraic equations; a set with bounds adds
//! the active face of `K` and its switches, and nothing else.

mod blocks;
mod breakpoints;
mod chattering;
mod clock;
mod conditions;
mod consistent_variables;
mod constraint_defect;
mod constraints;
mod coupled;
mod crossings;
mod defect;
mod dense_output;
mod error_control;
mod face;
mod factors;
mod footprint;
mod free_variables;
mod knots;
mod law;
mod layout;
mod location;
mod newton_control;
mod orders;
mod points;
mod progress;
mod ranges;
mod recent;
mod recurrence;
mod regular_face;
mod screening;
mod settings;
mod stage_vi;
mod stages;
mod start;
mod stepper;
mod switches;
mod system;
mod tableau;
mod tangents;
mod uncertainties;
mod unseen;
mod work;

pub use conditions::{AlgebraicStability, Conditions, Order, PositiveDiagonal, Vanishing};
pub use dense_output::GivenStep;
pub use face::{ActiveFace, Activity};
pub use footprint::{MOST_BYTES, run_numbers};
pub use law::Excess;
pub use screening::{ALLOWED, Screened};
pub use settings::{RejectionCause, Settings, StageChoice, StepError, Switches};
pub use start::Jump;
pub use stepper::{Counts, End, LastStep, Radau, Saved, Variables};
pub use switches::Switch;
pub use tableau::{MOST_STAGES, Tableau};
pub use tangents::{
    Adjoint, AdjointWork, DirectionSize, Directions, IntegralWeights, NoDerivative, RowsBy, Shifted, StoredStep,
    SweepError, Swept, Tangents,
};
pub use work::{Rates, Work};
