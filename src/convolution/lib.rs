//! Problems with memory: variational inequalities that contain a convolution,
//!
//! ```text
//! z in K,    <(m * z)(t) + q(t), z~ - z> >= 0  for all z~ in K,    (m * z)(t) = int_0^t m(t - s) z(s) ds
//! ```
//!
//! discretised on the stages of Radau IIA with a step `h`: `w_n = q(t_n + c h) + sum_{k <= n} W_{n-k} Z_k`, with the
//! values `Z_n` of `z` at the stages. The weights are those of convolution quadrature if the kernel is a power
//! ([`quadrature`]), and of product integration if it is an expression ([`product_integration`]); contributions of the
//! past are summed by blocks ([`history`]); each step is one variational inequality ([`stepper`]).
//!
//! If no step size is given and all variables are in intervals, switches are located, and the segments between them
//! have elements of any length ([`segments`]).

mod forcing;
pub mod gauss_jacobi;
pub mod history;
pub mod kernel;
pub mod product_integration;
pub mod quadrature;
pub mod segments;
pub mod stepper;
pub mod weights;

pub use kernel::{Function, Kernel, Term};
pub use segments::{Activity, SegmentSettings, Segments, Switch};
pub use stepper::{Convolution, Settings, StepError};
