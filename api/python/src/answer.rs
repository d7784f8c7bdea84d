//! An answer: its columns in place, its evidence as JSON, and the other forms that the library writes.

use super::columns;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyCapsule};
use solution::Solution;
use solution::columnar::Skeleton;
use solution::encodings::{Csv, read_json, write_json, write_table};
use solution::pictures::write_svg;
use std::io;
use std::sync::Arc;

/// An answer, which never changes: arrays and tables that others hold are views of it.
#[pyclass(frozen, module = "dvi._dvi")]
pub struct Answer {
    solution: Arc<Solution>,
    label: Option<String>,
    /// The answer of a service as it came: its diagnostics are not read.
    came: Option<(Skeleton, Vec<u8>)>,
}

impl Answer {
    pub fn new(solution: Solution, label: Option<&str>) -> Self {
        Self { solution: Arc::new(solution), label: label.map(str::to_owned), came: None }
    }
}

#[pymethods]
impl Answer {
    /// Reads the answer of a service.
    #[staticmethod]
    #[pyo3(signature = (json, label = None))]
    fn from_json(py: Python<'_>, json: &[u8], label: Option<String>) -> PyResult<Self> {
        let read = || {
            let solution = read_json(json)?;
            Ok((solution, Skeleton::read(json)?.0))
        };
        let (solution, skeleton) =
            py.detach(read).map_err(|error: io::Error| PyValueError::new_err(error.to_string()))?;
        Ok(Self { solution: Arc::new(solution), label, came: Some((skeleton, json.to_vec())) })
    }

    /// The names of the columns beside the time, in order.
    #[getter]
    fn names(&self) -> Vec<&str> {
        self.solution.trajectory.fields.iter().map(|field| field.name.as_str()).collect()
    }

    /// The times.
    #[getter]
    fn t<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        columns::view(&slf.get().solution.trajectory.t, slf.clone().into_any())
    }

    /// The column of that name, if there is one.
    fn column<'py>(slf: &Bound<'py, Self>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let column = slf.get().solution.trajectory.field(name);
        column.map(|values| columns::view(values, slf.clone().into_any())).transpose()
    }

    /// All but the columns, as JSON.
    fn evidence(&self, py: Python<'_>) -> PyResult<String> {
        match &self.came {
            Some((skeleton, _)) => Ok(skeleton.text().to_owned()),
            None => Ok(py.detach(|| Skeleton::of(&self.solution))?.text().to_owned()),
        }
    }

    /// The whole answer as JSON, as the program writes it.
    fn json<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        if let Some((_, came)) = &self.came {
            return Ok(PyBytes::new(py, came));
        }
        let mut text = Vec::new();
        py.detach(|| write_json(&self.solution, &mut text))?;
        Ok(PyBytes::new(py, &text))
    }

    /// The trajectory as CSV, as the program writes it.
    fn csv<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let mut text = Vec::new();
        py.detach(|| write_table(&mut Csv, &self.solution.trajectory, &mut text))?;
        Ok(PyBytes::new(py, &text))
    }

    /// The trajectory as a picture, as the program draws it.
    fn svg(&self, py: Python<'_>) -> PyResult<String> {
        let mut text = Vec::new();
        py.detach(|| write_svg(&self.solution, self.label.as_deref(), &mut text))?;
        Ok(String::from_utf8_lossy(&text).into_owned())
    }

    /// The trajectory as an Arrow stream of one batch, its columns in place (the PyCapsule interface of Arrow). A consumer
    /// that would have other types is given doubles: it may cast them.
    #[pyo3(signature = (requested_schema = None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        columns::stream(py, &self.solution)
    }
}
