//! Equations given as Rust functions, in place of those of a specification, which names their states and variables.

use super::checked::Specification;
use super::error::{Errors, SpecificationError};
use super::model::{Model, Request};
use super::start;
use models::{Closures, DerivativeFunction, DviModel, Equations, KinkAdvice, RowFunction};
use problem::Workspace;
use std::sync::Arc;

/// Tolerance for rounding in the test whether rates are affine in the variables, relative to the largest rate.
const ROUNDING: f64 = 1e-9;

impl Specification {
    /// Returns this specification of a `dvi` with equations given as functions: its states, initial values,
    /// variables, set, time, method and output stay. The bounds of the set must be constant.
    ///
    /// # Errors
    /// A problem that is not a `dvi`, or whose bounds vary; equations that are not finite at the start, not affine in
    /// the variables, or of an index that the method does not solve.
    pub fn with_equations(
        &self,
        rows: Arc<RowFunction>,
        derivatives: Option<Arc<DerivativeFunction>>,
    ) -> Result<Self, Vec<SpecificationError>> {
        let refused = |code, detail: &str| vec![SpecificationError::new("/problem", code, detail)];
        let Some(named) = self.model().dvi() else {
            return Err(refused("conflict", "functions take the place of the equations of a `dvi` alone"));
        };
        let structure = named.structure().clone();
        if !structure.moving.is_empty() {
            return Err(refused("conflict", "the bounds vary, and those beside functions must be constant"));
        }
        let time = self.time();
        let closures = Closures::new(structure, rows, derivatives, time.end - time.start);
        let (warnings, kinks) = (Vec::new(), KinkAdvice::default());
        let equations = Equations::Closures(Box::new(closures));
        let model = DviModel { equations, warnings, kinks, parameters: None, ..named.clone() };

        let mut errors = Errors::default();
        start::check(&model, time.start, |row| pointer(&model, row), &mut errors);
        if errors.is_empty() {
            check_affine(&model, time.start, &mut errors);
        }
        if errors.is_empty() {
            let analysis = model.analyse(time.start);
            let asked = Request { analysis: &analysis, method: self.method(), time };
            model.check_method(&asked, &mut errors);
            if errors.is_empty() {
                return Ok(self.with_model(Arc::new(model), &[], analysis));
            }
        }
        Err(errors.into_list())
    }
}

/// Returns the JSON pointer at which row `row` of the equations would be written in a specification.
fn pointer(model: &DviModel, row: usize) -> String {
    match row.checked_sub(model.state_names.len()) {
        None => format!("/problem/dvi/states/{}/rate", model.state_names[row]),
        Some(k) => format!("/problem/dvi/variables/{}/inequality", model.variable_names[k]),
    }
}

/// Refuses rates that are not affine in a variable at the start: along a line, the rate at the midpoint must be the
/// mean of the rates at the ends.
fn check_affine(model: &DviModel, t: f64, errors: &mut Errors) {
    let structure = model.structure();
    let (n, m) = (structure.states, structure.variables);
    let mut problem = model.problem();
    let mut y = model.initial.clone();
    y.resize(n + m, 0.0);
    structure.set.project_all(&mut y[n..], &mut Workspace::default());
    let largest = y.iter().fold(0.0_f64, |largest, y| largest.max(y.abs()));
    let by = if largest > 0.0 { largest } else { 1.0 };
    for k in 0..m {
        let rates = [-1.0, 0.0, 1.0].map(|part| {
            let mut y = y.clone();
            y[n + k] += part * by;
            let mut values = vec![0.0; structure.rows()];
            problem.evaluate(t, &y, &mut values);
            values
        });
        let bent = |row: &usize| {
            let [low, middle, high] = [0, 1, 2].map(|at| rates[at][*row]);
            let size = low.abs().max(middle.abs()).max(high.abs());
            size.is_finite() && (low - 2.0 * middle + high).abs() > ROUNDING * size
        };
        if let Some(row) = (0..n).find(bent) {
            let (state, variable) = (&model.state_names[row], &model.variable_names[k]);
            let detail = format!("the rate of `{state}` is not affine in the variable `{variable}`");
            let error = SpecificationError::new(pointer(model, row), "rate_not_affine", detail);
            errors
                .push(error.expected("a rate `f(t,x) + B(t,x) z`; what is nonlinear in `z` stands in the inequality"));
        }
    }
}
