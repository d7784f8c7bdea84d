//! Binding of new parameter values to a compiled problem, without reading, differentiating or compiling anything
//! again.

use super::checked::Specification;
use super::error::{Errors, SpecificationError};
use super::model::Request;
use super::pointer::Pointer;
use super::wording::{abridged, listed};
use expression::nearest;
use models::Unbindable;

impl Specification {
    /// Returns this specification with new values for some parameters, given by name. Parameters defined as expressions
    /// in others are recomputed.
    ///
    /// # Errors
    /// Unknown parameter names; values that are not finite or that the problem does not admit at its start; and values
    /// that would change the structure of the equations (`structure_changes`), for which the specification has to be
    /// read anew.
    pub fn with_parameters(&self, given: &[(&str, f64)]) -> Result<Self, Vec<SpecificationError>> {
        let (root, time, mut errors) = (Pointer::Root, self.time(), Errors::default());
        let (problem, key) = (root.key("problem"), self.problem());
        let problem = problem.key(key);
        let place = problem.key("parameters");
        let Some(parameters) = self.model().parameters() else {
            return Err(vec![SpecificationError::new(place.to_string(), "folded", Unbindable::Folded.to_string())]);
        };
        let mut values = parameters.values().to_vec();
        for &(name, value) in given {
            match parameters.names().iter().position(|known| known == name) {
                Some(k) => values[k] = value,
                None => {
                    let detail = format!("`{}` is not a parameter with a value of its own", abridged(name));
                    let names = || parameters.names().iter().map(String::as_str);
                    let error = SpecificationError::new(place.key(name).to_string(), "unknown_name", detail);
                    errors.push(error.expected(listed(names())).did_you_mean(nearest(name, names())));
                }
            }
        }
        if !errors.is_empty() {
            return Err(errors.into_list());
        }
        if self.search().is_some_and(|search| search.changes_period(&values)) {
            let detail = "these values change the period, which is the horizon";
            return Err(vec![SpecificationError::new(place.to_string(), "structure_changes", detail)]);
        }
        let model = self.model().with_parameters(&values).map_err(|error| {
            let code = match error {
                Unbindable::Structure { .. } => "structure_changes",
                Unbindable::NotFinite { .. } => "not_finite",
                Unbindable::OutOfRange { .. } => "out_of_range",
                Unbindable::EmptySet { .. } => "empty_set",
                Unbindable::Folded | Unbindable::Count { .. } => "folded",
            };
            vec![SpecificationError::new(place.to_string(), code, error.to_string())]
        })?;
        model.check_start(time.start, &problem, &mut errors);
        let analysis = model.analyse(time.start);
        model.check_method(&Request { analysis: &analysis, method: self.method(), time }, &mut errors);
        match errors.is_empty() {
            true => Ok(self.with_model(model, &values, analysis)),
            false => Err(errors.into_list()),
        }
    }
}
