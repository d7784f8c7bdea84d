//! Runs work on a thread of its own without Python's lock; the calling thread checks for signals while it waits, so
//! that Ctrl-C interrupts the work.

use problem::Control;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::{Condvar, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// Time between two checks for a signal: a tenth of the delay that a person perceives as immediate.
const GLANCE: Duration = Duration::from_millis(10);

/// Stack size that the deepest expression permitted in a specification needs; the workers of the service have the
/// same.
const STACK_BYTES: usize = 8 << 20;

/// The outcome of interrupted work: the exception, and what the work had computed.
pub struct Interrupted<T> {
    /// The Python exception: `KeyboardInterrupt`, or an exception of the progress function.
    pub error: PyErr,
    /// The value that the work returned after it was cancelled.
    pub so_far: Option<T>,
}

/// Runs `work`, which must stop soon after `control` is cancelled; a signal that Python raises as an exception
/// cancels `control`. Calls `progress` with the completed fraction and the number of steps.
pub fn run<T: Send>(
    py: Python<'_>,
    control: &Control,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce() -> T + Send,
) -> Result<T, Interrupted<T>> {
    let ended = Ended::default();
    thread::scope(|scope| {
        let working = || {
            // The mark is dropped when the work returns or panics; dropping it signals the end of the work.
            let _mark = Mark(&ended);
            work()
        };
        let thread = thread::Builder::new().name("dvi-solver".to_owned()).stack_size(STACK_BYTES);
        let thread = match thread.spawn_scoped(scope, working) {
            Ok(thread) => thread,
            Err(error) => return Err(Interrupted { error: error.into(), so_far: None }),
        };
        let mut raised = None;
        while !py.detach(|| ended.wait()) {
            if raised.is_none() {
                raised = look(py, control, progress).err();
                if raised.is_some() {
                    control.cancel();
                }
            }
        }
        let done = py.detach(|| thread.join());
        match (done, raised) {
            (Ok(done), None) => Ok(done),
            (Ok(done), Some(error)) => Err(Interrupted { error, so_far: Some(done) }),
            (Err(_), _) => {
                let error = PyRuntimeError::new_err("the solver met a defect of its own; standard error has its words");
                Err(Interrupted { error, so_far: None })
            }
        }
    })
}

/// Lets Python handle pending signals, and reports the progress of the work to the progress function.
fn look(py: Python<'_>, control: &Control, progress: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    py.check_signals()?;
    if let Some(progress) = progress {
        progress.call1((control.fraction(), control.steps()))?;
    }
    Ok(())
}

/// A flag that is set when the work has ended; a thread can wait for it.
#[derive(Default)]
struct Ended {
    is: Mutex<bool>,
    changed: Condvar,
}

impl Ended {
    /// Waits briefly for the end of the work; returns whether the work has ended.
    fn wait(&self) -> bool {
        let is = self.is.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.changed.wait_timeout_while(is, GLANCE, |is| !*is);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// A guard that signals the end of the work when it is dropped.
struct Mark<'a>(&'a Ended);

impl Drop for Mark<'_> {
    fn drop(&mut self) {
        *self.0.is.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.changed.notify_all();
    }
}
