//! Work on a thread of its own, so that Python's lock is free and Ctrl-C is heard: the thread that asked looks for signals
//! while it waits.

use problem::Control;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::{Condvar, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// Time between two looks for a signal: a tenth of what a person takes for at once.
const GLANCE: Duration = Duration::from_millis(10);

/// Room for the deepest expression that a specification may hold, as in the workers of the service.
const STACK_BYTES: usize = 8 << 20;

/// Work that was interrupted, as far as it came.
pub struct Interrupted<T> {
    /// What Python raises: `KeyboardInterrupt`, or what a report of progress raised.
    pub error: PyErr,
    /// What the work gave when it was stopped.
    pub so_far: Option<T>,
}

/// Runs `work`, which stops soon after `control` is cancelled. A signal of Python cancels it. `progress` is called with the
/// fraction done and the steps.
pub fn run<T: Send>(
    py: Python<'_>,
    control: &Control,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce() -> T + Send,
) -> Result<T, Interrupted<T>> {
    let ended = Ended::default();
    thread::scope(|scope| {
        let working = || {
            // Ended also where the work panics.
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

/// Lets Python handle its signals, and reports how far the work is.
fn look(py: Python<'_>, control: &Control, progress: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    py.check_signals()?;
    if let Some(progress) = progress {
        progress.call1((control.fraction(), control.steps()))?;
    }
    Ok(())
}

/// Whether the work has ended, to be waited for.
#[derive(Default)]
struct Ended {
    is: Mutex<bool>,
    changed: Condvar,
}

impl Ended {
    /// Waits for the end for a moment; whether it came.
    fn wait(&self) -> bool {
        let is = self.is.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.changed.wait_timeout_while(is, GLANCE, |is| !*is);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// Marks the end when it is dropped.
struct Mark<'a>(&'a Ended);

impl Drop for Mark<'_> {
    fn drop(&mut self) {
        *self.0.is.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.changed.notify_all();
    }
}
