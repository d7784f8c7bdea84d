//! Workers on threads of a test.

use dvi::service::jobs::Solver;
use dvi::service::worker::{Confinement, Launcher, Start, serve};
use std::sync::Arc;
use std::{io, thread};

/// A launcher of workers on threads of this process, with a solver controlled by a test. They talk to the front through
/// pipes, as processes do.
pub fn threads(solver: Solver) -> Launcher {
    Arc::new(move || {
        let ((input, orders), (reports, output)) = (io::pipe()?, io::pipe()?);
        let solver = Arc::clone(&solver);
        thread::spawn(move || serve(input, output, solver, Confinement::default()));
        Ok(Start { orders: orders.into(), reports: reports.into(), process: None })
    })
}
