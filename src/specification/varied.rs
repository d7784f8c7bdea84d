//! Parameters that an analysis varies: those of derivatives, of a fit and of a continuation.

use super::error::{Errors, SpecificationError};
use super::fit::FitRequest;
use super::model::Model;
use super::pointer::Pointer;
use super::search;
use super::sensitivities::SensitivitiesRequest;
use super::wording::abridged;
use models::Unbindable;

/// Relative change of a parameter in the test whether the parameter decides the structure of a problem.
const SHIFT: f64 = 1e-6;

/// Returns the names of parameters and initial values that sensitivities, a fit or a continuation vary.
pub(super) fn varied(
    sensitivities: Option<&SensitivitiesRequest>,
    fit: Option<&FitRequest>,
    search: &search::Request<'_>,
) -> Vec<String> {
    let differentiated = sensitivities.into_iter().flat_map(|asked| &asked.to).map(String::as_str);
    let fitted = fit.into_iter().flat_map(|asked| asked.parameters.names());
    let continued = search.branch().map(|asked| asked.parameter.as_str());
    differentiated.chain(fitted).chain(continued).map(str::to_owned).collect()
}

/// Refuses a parameter, by its index, if it decides the structure of the equations near its value, such as a
/// coefficient of friction at zero: equations of a fixed structure do not show the effect of changing such a
/// parameter.
pub(super) fn check_structure(model: &dyn Model, at: usize, place: &Pointer<'_>, errors: &mut Errors) {
    let Some(parameters) = model.parameters() else { return };
    let (name, values) = (&parameters.names()[at], parameters.values());
    let size = if values[at] == 0.0 { 1.0 } else { values[at].abs() };
    for shift in [SHIFT * size, -SHIFT * size] {
        let mut values = values.to_vec();
        values[at] += shift;
        let Err(error @ Unbindable::Structure { .. }) = model.with_parameters(&values) else { continue };
        let detail = format!("`{}` decides the structure that equations are built for: {error}", abridged(name));
        let error = SpecificationError::new(place.to_string(), "conflict", detail);
        let expected = match parameters.values()[at] == 0.0 {
            true => "another value than 0 in the problem, or another parameter",
            false => "a parameter whose values do not change which terms the equations have",
        };
        errors.push(error.expected(expected));
        return;
    }
}
