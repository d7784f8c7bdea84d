//! Workers as threads of the test process.

use dvi::service::jobs::Solver;
use dvi::service::worker::{Confinement, Launcher, Start, serve};
use std::sync::Arc;
use std::{io, thread};

/// Returns a launcher of workers on threads of this process, with a solver that the test controls. They talk to the
/// front of the service through pipes, as worker processes do.
pub fn threads(solver: Solver) -> Launcher {
    Arc::new(move || {
        let ((input, orders), (reports, output)) = (io::pipe()?, io::pipe()?);
        let solver = Arc::clone(&solver);
        thread::spawn(move || serve(input, output, solver, Confinement::default()));
        Ok(Start { orders: orders.into(), reports: reports.into(), process: None })
    })
}
