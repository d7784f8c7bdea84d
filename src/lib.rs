//! Differential variational inequalities, solved with evidence:
//!
//! ```text
//! x' = f(t,x) + B(t,x) z,    z in K,    <G(t,x,z), z~ - z> >= 0  for all z~ in K
//! ```
//!
//! A [`Problem`] is given as JSON text, in the notation of all interfaces, or as Rust functions; [`Settings`] have
//! defaults; the [`Solution`] holds the trajectory, by columns, and the evidence that it is right.
//!
//! ```
//! use dvi::{Problem, Set, Settings};
//!
//! // A mass on a spring, on a belt that moves at 0.5: dry friction of at most 1.
//! let belt = Problem::new()
//!     .state("x", 4.0)
//!     .state("v", 0.0)
//!     .variables(&["F"], Set::Box { lower: -1.0, upper: 1.0 })
//!     .equations(|_t, x, z, rates, inequality| {
//!         rates[0] = x[1];
//!         rates[1] = -x[0] - z[0];
//!         inequality[0] = 0.5 - x[1];
//!     });
//! let solution = belt.solve(20.0, &Settings { rtol: 1e-8, ..Settings::default() })?;
//! assert!(solution.verdict.trusted);
//! # Ok::<(), dvi::Refused>(())
//! ```
//!
//! A whole [`Specification`], with definitions, sweeps, periodic orbits, fits and sensitivities, is read from JSON
//! and checked as a whole; [`solve`] returns its solution:
//!
//! ```
//! use dvi::{Control, Specification};
//!
//! let text = br#"{"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}, "time": {"end": 1}}"#;
//! let specification = Specification::from_json(text).expect("a valid specification");
//! let solution = dvi::solve(&specification, &Control::new());
//! let x = solution.trajectory.field("x").expect("a state named x");
//! assert!((x.last().expect("a value at the end") - (-1.0_f64).exp()).abs() < 1e-6);
//! ```
//!
//! # The numerics, from the ground up
//!
//! The program is built in layers, listed from the lowest to the highest. Each layer is a crate that depends only on
//! layers listed before it, and is a module of this crate.
//!
//! | layer | contents |
//! |---|---|
//! | [`numerics`] | intervals, norms, roots of polynomials: arithmetic that all other layers share |
//! | [`expression`] | expressions as a graph: programs for values, exact derivatives, enclosures, kinks |
//! | [`factorisation`] | dense and sparse linear systems, with reuse of the symbolic analysis |
//! | [`problem`] | the trait of a differential variational inequality, convex sets and their faces |
//! | [`vi`] | solvers of one variational inequality, each with a certificate: Lemke, semismooth Newton, active sets, cones, Coulomb friction |
//! | [`analysis`] | index, existence, uniqueness |
//! | [`hybrid`] | the step loop: propose a step, solve in the mode, locate events, accept with the mode transition |
//! | [`radau`] | Radau IIA with a variational inequality at every stage, adaptive in step and order |
//! | [`contact`] | mechanical systems with impacts and friction: event-driven, or by time stepping |
//! | [`convolution`] | problems with memory (Volterra), by convolution quadrature |
//! | [`models`] | circuits, Filippov systems, obstacles, elastic and rigid bodies as equations |
//! | [`solution`] | runs and their evidence, sensitivities, periodic orbits, fits, solution branches, encodings |
//! | [`specification`] | the specification language, its checks and its errors |
//! | [`study`] | work-precision studies, sweeps, the report |
//! | [`service`] | the HTTP service |
//!
//! # Features of the build
//!
//! `otlp` (off by default): exports trace spans of requests and jobs to an OpenTelemetry collector.

mod library;

pub use ::problem::Control;
pub use ::solution::Solution;
pub use ::specification::Specification;
pub use library::{AbsoluteTolerance, Problem, Refused, Set, Settings};
pub use study::{solve, solve_on};
pub use {
    analysis, contact, convolution, explanation, expression, factorisation, hybrid, models, numerics, problem, radau,
    service, solution, specification, study, vi,
};

/// Runs the programs of the guide `api/guide/recipes.md` as documentation tests.
#[cfg(doctest)]
#[doc = include_str!("../api/guide/recipes.md")]
pub struct Recipes;
