//! The discretisation error in space apart from that in time: one problem on ever finer meshes, at a tolerance that
//! leaves the error in time far below, against the solution of the continuous problem.

use super::known::Known;
use super::measure::LONGEST;
use crate::solve::solve_once;
use problem::Control;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use solution::Status;
use specification::Specification;
use std::time::Instant;

/// Numbers of elements of the meshes, relative to the number in the example specification.
const FACTORS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
/// Relative tolerance of the time integration, so that the error in time is far below that in space.
const RTOL: f64 = 1e-7;

/// The result of a run on one mesh.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Mesh {
    /// Numbers of elements along the sides of the mesh, as text.
    pub elements: String,
    /// Largest relative error of the values at the end; `None` if the run did not reach the end.
    pub error: Option<f64>,
    /// Observed order: exponent of the element size with which the error changed from the previous mesh.
    pub order: Option<f64>,
    /// Run time on the mesh in seconds.
    pub seconds: f64,
}

/// Runs a problem whose continuous solution is known on all meshes, and returns its error on each.
pub fn meshes(document: &Value, known: &Known) -> Vec<Mesh> {
    let mut found: Vec<Mesh> = Vec::new();
    for factor in FACTORS {
        let Some((document, elements)) = scaled(document, factor) else { continue };
        let Some((error, seconds)) = run(document, known) else { continue };
        let order =
            found.last().and_then(|coarser| Some((coarser.error? / error?).log2())).filter(|order| order.is_finite());
        found.push(Mesh { elements, error, order, seconds });
    }
    found
}

/// Returns the problem with its numbers of elements scaled by a factor, and these numbers in words.
fn scaled(document: &Value, factor: f64) -> Option<(Value, String)> {
    let mut document = document.clone();
    let problem = document.get_mut("problem")?.as_object_mut()?.values_mut().next()?;
    let elements = problem.get_mut("elements")?;
    let times = |count: &Value| Some(json!((count.as_f64()? * factor).round().max(1.0) as u64));
    let words = match elements {
        Value::Object(sides) => {
            for count in sides.values_mut() {
                *count = times(count)?;
            }
            sides.values().map(Value::to_string).collect::<Vec<_>>().join(" × ")
        }
        count => {
            *count = times(count)?;
            count.to_string()
        }
    };
    Some((document, words))
}

fn run(mut document: Value, known: &Known) -> Option<(Option<f64>, f64)> {
    document["study"] = json!({"rtol": [RTOL], "exact": known.exact});
    let specification = Specification::from_json(document.to_string().as_bytes()).ok()?;
    let plan = specification.study()?;
    let exact = plan.exact.as_ref()?;
    let end = specification.time().end;
    let mut values = vec![0.0; exact.fields.len()];
    exact.values.clone().evaluate(end, &[], &mut values);
    let variant = specification.variant(
        plan.rungs.first().copied()?,
        specification.method().stages,
        vec![end],
        exact.fields.clone(),
    );
    let solution = solve_once(&variant, &Control::with_deadline(Instant::now() + LONGEST));
    let seconds = solution.diagnostics.wall_seconds;
    if solution.status != Status::Completed {
        return Some((None, seconds));
    }
    let ends = solution.trajectory.fields.iter().map(|field| field.values.last().copied().unwrap_or(f64::NAN));
    let parts = ends.zip(&values).map(|(x, exact)| (x - exact).abs() / if *exact == 0.0 { 1.0 } else { exact.abs() });
    Some((parts.reduce(f64::max).filter(|error| error.is_finite()), seconds))
}
