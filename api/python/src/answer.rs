//! The result of a solve: its columns without a copy, its other members as JSON, and the file formats that the
//! library writes.

use super::columns;
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyCapsule};
use solution::columnar::Skeleton;
use solution::encodings::{Form, read_json};
use solution::{Solution, Table};
use std::io;
use std::sync::Arc;

/// The result of a solve. It never changes, since arrays and tables of Python are views of its memory.
#[pyclass(frozen, module = "dvi._dvi")]
pub struct Answer {
    solution: Arc<Solution>,
    label: Option<String>,
    /// For a result that was received from a service, its JSON bytes, and its parsed members except for the columns of
    /// the trajectory; the diagnostics of the result are kept as they came.
    came: Option<(Skeleton, Vec<u8>)>,
}

impl Answer {
    pub fn new(solution: Solution, label: Option<&str>) -> Self {
        Self { solution: Arc::new(solution), label: label.map(str::to_owned), came: None }
    }
}

#[pymethods]
impl Answer {
    /// Reads a result that a service has sent as JSON.
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

    /// The kind of the result: a `run`, `sweep`, `fit`, `orbit`, `steady_state` or `sensitivities`.
    #[getter]
    fn kind(&self) -> &'static str {
        match &*self.solution {
            Solution { table: Some(_), .. } => "sweep",
            Solution { fit: Some(_), .. } => "fit",
            Solution { orbit: Some(_), .. } => "orbit",
            Solution { steady_state: Some(_), .. } => "steady_state",
            Solution { sensitivities: Some(_), .. } => "sensitivities",
            _ => "run",
        }
    }

    /// The names of the columns of the trajectory without the time, or of the table of a sweep, in their order.
    #[getter]
    fn names(&self) -> Vec<&str> {
        match &self.solution.table {
            Some(table) => table.columns.iter().map(|column| column.name.as_str()).collect(),
            None => self.solution.trajectory.fields.iter().map(|field| field.name.as_str()).collect(),
        }
    }

    /// The times of the trajectory.
    #[getter]
    fn t<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        columns::view(&slf.get().solution.trajectory.t, slf.clone().into_any())
    }

    /// The column with this name of the trajectory or of the sweep's table, or None.
    fn column<'py>(slf: &Bound<'py, Self>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let (solution, owner) = (&slf.get().solution, slf.clone().into_any());
        match &solution.table {
            Some(table) => table.column(name).map(|values| columns::view_of_table(values, owner)).transpose(),
            None => solution.trajectory.field(name).map(|values| columns::view(values, owner)).transpose(),
        }
    }

    /// The largest difference between the interpolants of the fields in time and the values of the run, relative to the
    /// largest values of the fields; None if the solve has not kept interpolants.
    #[getter]
    fn deviation(&self) -> Option<f64> {
        self.solution.dense.as_ref().map(|dense| dense.deviation)
    }

    /// The fields at the given times by interpolation, one array per field in the order of `names`; None if the solve
    /// has not kept interpolants, or if a time lies outside the run.
    fn at<'py>(&self, py: Python<'py>, times: Vec<f64>) -> Option<Vec<Bound<'py, PyArray1<f64>>>> {
        let dense = self.solution.dense.as_ref()?;
        let evaluate = || {
            let mut columns = vec![Vec::with_capacity(times.len()); dense.fields()];
            let mut row = vec![0.0; dense.fields()];
            for t in &times {
                if !dense.at(*t, &mut row) {
                    return None;
                }
                columns.iter_mut().zip(&row).for_each(|(column, value)| column.push(*value));
            }
            Some(columns)
        };
        let columns = py.detach(evaluate)?;
        Some(columns.into_iter().map(|column| PyArray1::from_vec(py, column)).collect())
    }

    /// All members of the result except the columns, as JSON.
    fn evidence(&self, py: Python<'_>) -> PyResult<String> {
        match &self.came {
            Some((skeleton, _)) => Ok(skeleton.text().to_owned()),
            None => Ok(py.detach(|| Skeleton::of(&without_rows(&self.solution)))?.text().to_owned()),
        }
    }

    /// The whole result in the file format with this extension, identical to the bytes that the program writes.
    fn written<'py>(&self, py: Python<'py>, extension: &str) -> PyResult<Bound<'py, PyBytes>> {
        let form = Form::of_extension(extension).ok_or_else(|| {
            let known = ".json, .csv, .ndjson, .arrow and .svg";
            PyValueError::new_err(format!("no form of an answer is known by .{extension}: there are {known}"))
        })?;
        if let (Form::Json, Some((_, came))) = (form, &self.came) {
            return Ok(PyBytes::new(py, came));
        }
        let mut text = Vec::new();
        py.detach(|| form.write(&self.solution, self.label.as_deref(), &mut text))?;
        Ok(PyBytes::new(py, &text))
    }

    /// The trajectory, or the table of a sweep, as an Arrow stream of one batch that refers to the columns without a
    /// copy (the PyCapsule interface of Arrow). A consumer that requests other types gets the existing ones, which it
    /// may cast.
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

/// Returns a copy of the result of a sweep without the rows of its table, so that they are not written as text only
/// to be discarded; any other result is returned unchanged.
fn without_rows(solution: &Arc<Solution>) -> Arc<Solution> {
    let Some(table) = &solution.table else { return Arc::clone(solution) };
    Arc::new(Solution {
        version: solution.version,
        status: solution.status,
        verdict: solution.verdict.clone(),
        provenance: solution.provenance.clone(),
        error: solution.error.clone(),
        diagnostics: solution.diagnostics.clone(),
        table: Some(Table { failed: table.failed, ..table.emptied() }),
        summary: solution.summary.clone(),
        ..Solution::default()
    })
}
