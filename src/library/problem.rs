//! Builder of a problem, given as JSON text or as Rust functions.

use super::{Refused, Settings};
use ::models::{DerivativeFunction, RowFunction};
use ::problem::Control;
use ::solution::Solution;
use ::specification::{Specification, SpecificationError};
use serde_json::value::RawValue;
use serde_json::{Value, json};
use std::fmt;
use std::sync::Arc;

/// A factor of the convex set `K`, for some of the variables of the variational inequality.
#[derive(Clone, Debug, PartialEq)]
pub enum Set {
    /// The whole space: the inequality of the variables becomes the equation `G = 0`.
    Free,
    /// Complementarity: variables `z >= 0`, with `G >= 0` and `z G = 0`.
    Nonnegative,
    /// Complementarity with reversed signs: variables `z <= 0`, with `G <= 0` and `z G = 0`.
    Nonpositive,
    /// A box: every variable lies between the same two bounds, each of which may be infinite.
    Box {
        /// Lower bound of every variable in the box.
        lower: f64,
        /// Upper bound of every variable in the box.
        upper: f64,
    },
    /// A Euclidean ball about the origin, for the vector of the variables.
    Ball {
        /// Radius of the ball about the origin.
        radius: f64,
    },
    /// The second-order cone: the first variable is at least the Euclidean norm of the others.
    SecondOrderCone,
    /// The unit simplex: all variables in the set are nonnegative, with sum one.
    Simplex,
}

impl Set {
    /// Returns the set, for the variables named in `of`, in the JSON notation of a specification.
    fn written(&self, of: &[String]) -> Value {
        // An infinite bound on its own side is written as null; a bound that is NaN, or infinite on the other side, is refused.
        let bound = |end: f64, none: f64| match end {
            end if end == none => Value::Null,
            end if end.is_finite() => json!(end),
            _ => json!({}),
        };
        match self {
            Self::Free => json!({"free": of}),
            Self::Nonnegative => json!({"nonnegative": of}),
            Self::Nonpositive => json!({"nonpositive": of}),
            Self::Box { lower, upper } => {
                json!({"box": {"of": of, "lower": bound(*lower, f64::NEG_INFINITY), "upper": bound(*upper, f64::INFINITY)}})
            }
            Self::Ball { radius } => json!({"ball": {"of": of, "radius": radius}}),
            Self::SecondOrderCone => json!({"second_order_cone": of}),
            Self::Simplex => json!({"simplex": of}),
        }
    }
}

/// A differential variational inequality, to be solved any number of times.
///
/// ```text
/// M x' = F(t,x,z) = f(t,x) + B(t,x) z,    z in K,    <G(t,x,z), z~ - z> >= 0  for all z~ in K
/// ```
///
/// A problem in text is the value of `"problem"` in a specification, of any problem type:
///
/// ```
/// let decay = dvi::Problem::text(r#"{"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}"#);
/// let solution = decay.solve(1.0, &dvi::Settings::default())?;
/// assert!((solution.trajectory.field("x").unwrap().last().unwrap() - (-1.0_f64).exp()).abs() < 1e-6);
/// # Ok::<(), dvi::Refused>(())
/// ```
///
/// A problem given as functions has states, variables in sets, and equations. The equations write `F` (one value per
/// state) and `G` (one value per variable), in the order in which states and variables were added. `F` must be affine
/// in `z`. A mass of 1 on a spring and a belt, with dry friction:
///
/// ```
/// use dvi::{Problem, Set, Settings};
///
/// let belt = Problem::new()
///     .state("x", 4.0)
///     .state("v", 0.0)
///     .variables(&["F"], Set::Box { lower: -1.0, upper: 1.0 })
///     .equations(|_t, x, z, rates, inequality| {
///         rates[0] = x[1];
///         rates[1] = -x[0] - z[0];
///         inequality[0] = 0.5 - x[1];
///     });
/// let solution = belt.solve(20.0, &Settings { rtol: 1e-8, ..Settings::default() })?;
/// assert!(solution.trajectory.events.iter().any(|event| event.t > 0.0));
/// # Ok::<(), dvi::Refused>(())
/// ```
///
/// Functions are known by their values only. The verdict therefore says what it cannot prove: uniqueness of the
/// solution, and the absence of events between the points examined. Derivatives are central differences, accurate to
/// ten digits, unless [`Problem::derivatives`] supplies them; the Jacobian is dense. Problems in text have none of
/// these limits.
#[derive(Clone, Debug, Default)]
pub struct Problem {
    /// Value of `"problem"` in a specification, as JSON text; `None` for a problem given as functions.
    text: Option<String>,
    functions: Functions,
}

/// Names, initial values, sets, mass matrix and functions of a problem given as functions.
#[derive(Clone, Default)]
struct Functions {
    states: Vec<(String, f64)>,
    variables: Vec<(Vec<String>, Set)>,
    mass: Option<Vec<Vec<f64>>>,
    equations: Option<Arc<RowFunction>>,
    derivatives: Option<Arc<DerivativeFunction>>,
}

impl fmt::Debug for Functions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { states, variables, mass, .. } = self;
        let mut shown = f.debug_struct("Functions");
        shown.field("states", states).field("variables", variables).field("mass", mass).finish_non_exhaustive()
    }
}

impl Problem {
    /// Creates a problem of any type from the value of `"problem"` in a specification. Errors in the text are
    /// reported by [`Problem::solve`].
    pub fn text(problem: &str) -> Self {
        Self { text: Some(problem.to_owned()), ..Self::default() }
    }

    /// Creates a problem to be given as functions, without states and variables.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a state to the problem, with its initial value.
    #[must_use]
    pub fn state(mut self, name: &str, initial: f64) -> Self {
        self.functions.states.push((name.to_owned(), initial));
        self
    }

    /// Adds variables of the variational inequality, constrained to a set.
    #[must_use]
    pub fn variables(mut self, names: &[&str], set: Set) -> Self {
        self.functions.variables.push((names.iter().copied().map(str::to_owned).collect(), set));
        self
    }

    /// Sets the constant mass matrix `M` of `M x' = F`, by rows; it may be singular. Default: the identity.
    #[must_use]
    pub fn mass(mut self, rows: &[&[f64]]) -> Self {
        self.functions.mass = Some(rows.iter().map(|row| row.to_vec()).collect());
        self
    }

    /// Sets the equations: a function of `(t, x, z)` that writes the rates `F` and the inequality `G`.
    #[must_use]
    pub fn equations(
        mut self,
        equations: impl Fn(f64, &[f64], &[f64], &mut [f64], &mut [f64]) + Send + Sync + 'static,
    ) -> Self {
        self.functions.equations = Some(Arc::new(equations));
        self
    }

    /// Sets the derivatives: a function of `(t, x, z)` that writes the Jacobian of `(F, G)` with respect to `(x, z)`,
    /// row by row.
    #[must_use]
    pub fn derivatives(
        mut self,
        derivatives: impl Fn(f64, &[f64], &[f64], &mut [f64]) + Send + Sync + 'static,
    ) -> Self {
        self.functions.derivatives = Some(Arc::new(derivatives));
        self
    }

    /// Solves up to the time `end`. A solve that fails before `end` returns a [`Solution`] with the trajectory so
    /// far, whose status reports the failure.
    ///
    /// # Errors
    /// Every error in the problem and its settings.
    pub fn solve(&self, end: f64, settings: &Settings) -> Result<Solution, Refused> {
        let specification = self.specification(end, settings)?;
        let control = specification.control();
        Ok(::study::solve(&specification, &control))
    }

    /// Solves up to the time `end`, and stops at the next step if `control` asks for it.
    ///
    /// # Errors
    /// Every error in the problem and its settings.
    pub fn solve_with(&self, end: f64, settings: &Settings, control: &Control) -> Result<Solution, Refused> {
        Ok(::study::solve(&self.specification(end, settings)?, control))
    }

    /// Returns the checked specification, for uses that [`Settings`] do not cover.
    ///
    /// # Errors
    /// Every error in the problem and its settings.
    pub fn specification(&self, end: f64, settings: &Settings) -> Result<Specification, Refused> {
        let read = |problem: &str| {
            let rest = Value::Object(settings.written(end)).to_string();
            let text = format!(r#"{{"problem": {problem}, {}"#, &rest[1..]);
            Specification::from_json(text.as_bytes()).map_err(Refused)
        };
        let refused = |error: SpecificationError| Refused(vec![error]);
        let Functions { states, variables, mass, equations, derivatives } = &self.functions;
        let Some(text) = &self.text else {
            let Some(equations) = equations else {
                let error = SpecificationError::new("/problem", "missing_key", "there are no equations");
                return Err(refused(error.expected("a function that writes them, in `equations`")));
            };
            let read = read(&self.functions.written())?;
            return read.with_equations(Arc::clone(equations), derivatives.clone()).map_err(Refused);
        };
        let is_text_alone = states.is_empty() && variables.is_empty() && mass.is_none();
        if !is_text_alone || equations.is_some() || derivatives.is_some() {
            let error = SpecificationError::new("/problem", "conflict", "a problem in text has no functions beside it");
            return Err(refused(error.expected("`Problem::new()`, or all of it in text")));
        }
        // JSON text of a problem with missing or surplus brackets could absorb the keys of the specification that are
        // written after it, so it is parsed alone first.
        serde_json::from_str::<&RawValue>(text)
            .map_err(|error| refused(SpecificationError::new("/problem", "syntax", error.to_string())))?;
        read(text)
    }
}

impl Functions {
    /// Returns the problem in the JSON notation of a specification, in the order of definition, with placeholders for
    /// its equations, which are Rust functions.
    fn written(&self) -> String {
        // Placeholders for the equations: a constant state, and a variable of index 1.
        let states = self
            .states
            .iter()
            .map(|(name, initial)| format!(r#"{}: {{"initial": {}, "rate": 0}}"#, json!(name), json!(initial)));
        let names = self.variables.iter().flat_map(|(names, _)| names);
        let variables = names.map(|name| format!(r#"{}: {{"inequality": {}}}"#, json!(name), json!(name)));
        let list = |items: Vec<String>| items.join(", ");
        let (states, variables) = (list(states.collect()), list(variables.collect()));
        let set: Vec<Value> = self.variables.iter().map(|(names, set)| set.written(names)).collect();
        let set = if set.is_empty() { String::new() } else { format!(r#", "set": {}"#, json!(set)) };
        let mass = self.mass.as_ref().map_or_else(String::new, |mass| format!(r#", "mass": {}"#, json!(mass)));
        format!(r#"{{"dvi": {{"states": {{{states}}}, "variables": {{{variables}}}{set}{mass}}}}}"#)
    }
}
