//! A specification that has been read and checked: it can be described, and solved any number of times.

use super::answer::Answer;
use super::interruptible::{self, Interrupted};
use super::text;
use problem::Control;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use specification::SpecificationError;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::thread;

create_exception!(
    _dvi,
    Malformed,
    PyValueError,
    "A specification with errors; its one argument is their list, as JSON."
);

/// A specification that has passed every check.
#[pyclass(frozen, module = "dvi._dvi")]
pub struct Specification(Arc<specification::Specification>);

#[pymethods]
impl Specification {
    /// Reads and checks a JSON document; raises `Malformed` with all faults of the document.
    #[new]
    fn new(py: Python<'_>, document: &[u8]) -> PyResult<Self> {
        let control = Control::new();
        let read = || specification::Specification::from_json_with(document, &control);
        let read = interruptible::run(py, &control, None, read).map_err(|interrupted| interrupted.error)?;
        read.map(|specification| Self(Arc::new(specification))).map_err(|errors| malformed(&errors))
    }

    /// The label that the user has given to the specification.
    #[getter]
    fn label(&self) -> Option<&str> {
        self.0.label()
    }

    /// A summary of the problem without a solve, as JSON: its sizes, statements of the theory about it, and the method,
    /// the memory and the parts of the solver that a solve would use.
    fn summary(&self, py: Python<'_>) -> PyResult<String> {
        text(&py.detach(|| self.0.summary()))
    }

    /// Solves the problem, with output at `times`, if given, in place of the output times of the specification. A
    /// sweep runs on `threads` threads, by default one per core. With `dense`, the result also keeps its fields as
    /// functions of time, where the problem permits it. After Ctrl-C, the attribute `answer` of the exception holds
    /// the result so far.
    #[pyo3(signature = (progress = None, times = None, threads = None, dense = false))]
    fn solve(
        &self,
        py: Python<'_>,
        progress: Option<&Bound<'_, PyAny>>,
        times: Option<Vec<f64>>,
        threads: Option<NonZeroUsize>,
        dense: bool,
    ) -> PyResult<Answer> {
        let threads = threads.unwrap_or_else(|| thread::available_parallelism().unwrap_or(NonZeroUsize::MIN));
        let specification = match times {
            None => Arc::clone(&self.0),
            Some(times) => Arc::new(self.0.reporting_at(times).map_err(|errors| malformed(&errors))?),
        };
        let specification = if dense { Arc::new(specification.keeping_interpolants()) } else { specification };
        let control = specification.control();
        let solved = interruptible::run(py, &control, progress, || study::solve_on(threads, &specification, &control));
        let label = specification.label();
        solved.map(|solution| Answer::new(solution, label)).map_err(|Interrupted { error, so_far }| {
            if let Some(solution) = so_far
                && let Ok(answer) = Py::new(py, Answer::new(solution, label))
            {
                // An exception type that does not accept attributes is raised without the result.
                let _ = error.value(py).setattr("answer", answer);
            }
            error
        })
    }
}

fn malformed(errors: &[SpecificationError]) -> PyErr {
    match text(&errors) {
        Ok(errors) => Malformed::new_err(errors),
        Err(error) => error,
    }
}
