//! A scalar problem with memory with an increasing number of steps N: `O(N log^2 N)` time and `O(N)` memory. `cargo
//! bench --bench memory`.
//!
//! The force oscillates, so that the variable leaves and reaches its bounds throughout the run. The table has the
//! total time, the time per step, which grows like `log^2 N`, and the peak memory of the process.

use dvi::problem::Control;
use dvi::solution::Status;
use dvi::specification::Specification;
use serde_json::json;
use std::fs;
use std::time::Instant;

fn main() {
    println!("{:>10} {:>10} {:>12} {:>12}", "steps", "seconds", "us a step", "MiB at most");
    for steps in [1_000, 10_000, 100_000, 1_000_000] {
        let document = json!({
            "problem": {"convolution": {
                "variables": {"u": {"q": "0.3 - sin(t)"}},
                "kernel": {"fractional": {"exponent": 0.5}},
                "set": [{"nonnegative": ["u"]}]
            }},
            "time": {"end": 100}, "method": {"step": 100.0 / f64::from(steps)}, "output": {"times": {"count": 101}}
        });
        let specification = Specification::from_json(document.to_string().as_bytes()).expect("a specification");
        let began = Instant::now();
        let solution = dvi::solve(&specification, &Control::new());
        let seconds = began.elapsed().as_secs_f64();
        assert_eq!(solution.status, Status::Completed, "{:?}", solution.error);
        let memory = memory().map_or_else(|| "?".to_owned(), |kib| format!("{:.0}", kib / 1024.0));
        println!("{steps:>10} {seconds:>10.3} {:>12.3} {memory:>12}", 1e6 * seconds / f64::from(steps));
    }
}

/// Returns the peak memory of the process so far in KiB, if the system reports it.
fn memory() -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.split_whitespace().next()?.parse().ok()
}
