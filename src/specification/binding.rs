//! Other values for the parameters of a problem that is lowered: nothing is read, differentiated or compiled again.

use super::checked::Specification;
use super::error::{Errors, SpecificationError};
use super::model::Request;
use super::pointer::Pointer;
use super::wording::{abridged, listed};
use expression::nearest;
use models::Unbindable;

impl Specification {
    /// The same problem with other values of some parameters, by their names. Parameters that are expressions in others
    /// follow them.
    ///
    /// # Errors
    /// Names that are no parameters with values of their own, values that are none or that the problem does not have at its
    /// start, and those that would change the structure (`structure_changes`), for which it is to be read anew.
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
                    let detail = format!("`{}` is no parameter with a value of its own", abridged(name));
                    let names = || parameters.names().iter().map(String::as_str);
                    let error = SpecificationError::new(place.key(name).to_string(), "unknown_name", detail);
                    errors.push(error.expected(listed(names())).did_you_mean(nearest(name, names())));
                }
            }
        }
        if !errors.is_empty() {
            return Err(errors.into_list());
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
