//! The Python module `dvi._dvi`, a thin layer over the library: it converts specifications and results, releases
//! Python's lock during a solve, and handles Ctrl-C. The Python package around it is in `python/dvi`.

mod answer;
mod columns;
mod interruptible;
mod specification;

use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// The solver, running in the process of Python.
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

/// The available methods and options with their conditions, as JSON.
#[pyfunction]
fn catalogue() -> PyResult<String> {
    text(&::specification::catalogue())
}

/// The name and the JSON text of each example specification.
#[pyfunction]
fn examples() -> Vec<(&'static str, &'static str)> {
    ::specification::EXAMPLES.iter().map(|example| (example.name, example.text)).collect()
}

/// Converts a SPICE netlist to a specification; any other text is returned unchanged.
#[pyfunction]
fn document_of<'py>(py: Python<'py>, text: &[u8]) -> Bound<'py, PyBytes> {
    PyBytes::new(py, &::specification::document_of(text))
}

/// Serializes a value as JSON.
fn text(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| pyo3::exceptions::PyRuntimeError::new_err(error.to_string()))
}
