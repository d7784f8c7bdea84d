//! Evaluation of the equations of a problem at the start time, which reveals initial values outside their domain.

use super::error::{Errors, SpecificationError};
use super::wording::abridged;
use models::DviModel;
use problem::{Side, Workspace};

/// Reports rates and bounds that are not finite at `t` and the initial values, and contradictory bounds. `pointer`
/// returns where a row of the problem is written. The variables are not known yet and set to the point of `K` nearest
/// to zero; inequalities that depend on them are not checked.
pub(super) fn check(model: &DviModel, t: f64, pointer: impl Fn(usize) -> String, errors: &mut Errors) {
    let mut problem = model.problem();
    let (n, m) = (model.structure().states, model.structure().variables);
    let mut y = model.initial.clone();
    y.resize(n + m, 0.0);
    let mut values = vec![0.0; model.structure().rows()];
    problem.evaluate(t, &y, &mut values);

    let mut set = model.structure().set.clone();
    for (k, bound) in model.structure().moving.iter().enumerate() {
        let row = n + m + k;
        if !values[row].is_finite() {
            errors.push(outside_domain(model, t, row, "this bound", values[row], &pointer));
            continue;
        }
        bound.place(values[row], &mut set);
        if bound.side == Side::Radius && values[row] < 0.0 {
            let detail = format!("at the start this radius is {}", values[row]);
            errors.push(SpecificationError::new(pointer(row), "negative_radius", detail));
            bound.place(0.0, &mut set);
        }
        let (lower, upper) = (set.lower[bound.variable], set.upper[bound.variable]);
        if lower > upper {
            let name = abridged(&model.variable_names[bound.variable]);
            let detail = format!("at the start the lower bound of `{name}` is {lower}, above its upper bound {upper}");
            errors.push(SpecificationError::new(pointer(row), "empty_interval", detail));
        }
    }
    if m > 0 {
        set.project_all(&mut y[n..], &mut Workspace::default());
        problem.evaluate(t, &y, &mut values);
    }
    let mut judged = vec![true; n + m];
    for &(row, _) in model.structure().pattern.iter().filter(|&&(row, column)| row < n + m && column >= n) {
        judged[row] = row < n;
    }
    for row in (0..n + m).filter(|&row| judged[row] && !values[row].is_finite()) {
        let what = match row.checked_sub(n) {
            None => format!("the rate of `{}`", abridged(&model.state_names[row])),
            Some(i) => format!("the inequality of `{}`", abridged(&model.variable_names[i])),
        };
        errors.push(outside_domain(model, t, row, &what, values[row], &pointer));
    }
}

fn outside_domain(
    model: &DviModel,
    t: f64,
    row: usize,
    what: &str,
    value: f64,
    pointer: &impl Fn(usize) -> String,
) -> SpecificationError {
    const SHOWN: usize = 6;
    let at: String = model
        .structure()
        .pattern
        .iter()
        .filter(|&&(r, column)| r == row && column < model.initial.len())
        .take(SHOWN)
        .map(|&(_, column)| format!(", {} = {}", abridged(&model.state_names[column]), model.initial[column]))
        .collect();
    let detail = format!("initial value outside its domain: {what} is {value} at t = {t}{at}");
    SpecificationError::new(pointer(row), "outside_domain", detail).expected("a finite value at the start")
}
