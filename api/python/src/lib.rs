//! The module `dvi._dvi`: the front door of the library for Python. Whatever it does, the library does; what is written here
//! hands texts in and columns out, releases Python's lock meanwhile, and hears Ctrl-C. The package around it is in `python/dvi`.

mod answer;
mod columns;
mod interruptible;
mod specification;

use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// The solver in this process.
#[pymodule]
mod _dvi {
    #[pymodule_export]
    use super::answer::Answer;
    #[pymodule_export]
    use super::catalogue;
    #[pymodule_export]
    use super::document_of;
    #[pymodule_export]
    use super::examples;
    #[pymodule_export]
    use super::schema;
    #[pymodule_export]
    use super::specification::{Malformed, Specification};
    #[pymodule_export]
    #[allow(non_upper_case_globals, reason = "the name that Python's modules have it by")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}

/// The JSON Schema of specifications, as text.
#[pyfunction]
fn schema() -> PyResult<String> {
    text(&::specification::json_schema())
}

/// What there is to choose from, with its conditions, as JSON.
#[pyfunction]
fn catalogue() -> PyResult<String> {
    text(&::specification::catalogue())
}

/// The examples, each its name and its text.
#[pyfunction]
fn examples() -> Vec<(&'static str, &'static str)> {
    ::specification::EXAMPLES.iter().map(|example| (example.name, example.text)).collect()
}

/// The document that a text is: a deck of SPICE becomes a specification, all else stays as it is.
#[pyfunction]
fn document_of<'py>(py: Python<'py>, text: &[u8]) -> Bound<'py, PyBytes> {
    PyBytes::new(py, &::specification::document_of(text))
}

/// The JSON of a value.
fn text(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| pyo3::exceptions::PyRuntimeError::new_err(error.to_string()))
}
