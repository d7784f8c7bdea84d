//! Time per step of an obstacle problem as a function of the number of nodes: `cargo bench --bench obstacle`. A
//! paraboloid moves under a membrane, in one, two and three dimensions; the time per step is the difference between a
//! longer and a shorter run, divided by the difference of their numbers of steps. A slope of one is linear growth.
//! The last column is the longest time from a cancellation, at one of several moments, to the end of a run of the
//! largest size.

use dvi::problem::Control;
use dvi::solution::Status;
use dvi::specification::Specification;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

const STEP: f64 = 0.002;

fn main() {
    let sizes: [&[u64]; 3] = [&[1_000, 10_000, 100_000, 1_000_000], &[31, 99, 315, 999], &[9, 21, 46, 99]];
    let most: f64 = std::env::args().skip(1).find_map(|argument| argument.parse().ok()).unwrap_or(f64::INFINITY);
    println!(
        "{:>10} {:>10} {:>14} {:>8} {:>8} {:>10} {:>10}",
        "dimension", "nodes", "ms a step", "slope", "passes", "residual", "stops in s"
    );
    for (dimension, sizes) in (1..).zip(sizes) {
        let mut before: Option<(f64, f64)> = None;
        for &elements in sizes {
            let nodes = ((elements + 1) as f64).powi(dimension);
            if nodes > most {
                continue;
            }
            let (shorter, longer) = (run(dimension as usize, elements, 2), run(dimension as usize, elements, 8));
            let step = (longer.0 - shorter.0) / 6.0;
            let slope = before.map_or(f64::NAN, |(n, time)| (step / time).ln() / (nodes / n).ln());
            let passes = (longer.1 - shorter.1) / 12.0;
            print!("{dimension:>10} {nodes:>10} {:>14.3} {slope:>8.2} {passes:>8.1} {:>10.1e}", 1e3 * step, longer.2);
            before = Some((nodes, step));
            match sizes.last() {
                Some(last) if *last == elements => println!(" {:>10.2}", latency(dimension as usize, elements)),
                _ => println!(),
            }
        }
    }
}

/// Solves an obstacle problem over `steps` steps; returns the seconds, the number of active sets tried and the
/// largest residual.
fn run(dimension: usize, elements: u64, steps: u32) -> (f64, f64, f64) {
    let solution = dvi::solve(&specification(dimension, elements, steps), &Control::new());
    assert_eq!(solution.status, Status::Completed, "{:?}", solution.error);
    let vi = solution.diagnostics.vi.expect("inequalities");
    (solution.diagnostics.wall_seconds, vi.pivots as f64, vi.largest_residual)
}

/// Returns the longest time in seconds from the cancellation of a run to the end of the run.
fn latency(dimension: usize, elements: u64) -> f64 {
    let specification = specification(dimension, elements, 1000);
    let moments = [0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0];
    moments.iter().fold(0.0, |longest, &moment| {
        let control = Control::new();
        std::thread::scope(|scope| {
            let cancelled = scope.spawn(|| {
                std::thread::sleep(Duration::from_secs_f64(moment));
                control.cancel();
                Instant::now()
            });
            let solution = dvi::solve(&specification, &control);
            assert_eq!(solution.status, Status::Stopped, "{:?}", solution.error);
            let cancelled = cancelled.join().expect("a thread that only waits");
            longest.max(cancelled.elapsed().as_secs_f64())
        })
    })
}

fn specification(dimension: usize, elements: u64, steps: u32) -> Specification {
    let names = &["x", "y", "z"][..dimension];
    let domain: Value = names.iter().map(|name| ((*name).to_owned(), json!([0, 1]))).collect();
    let sides = names.iter().flat_map(|name| [format!("{name}_min"), format!("{name}_max")]);
    let boundary: Value = sides.map(|side| (side, json!({"dirichlet": 0}))).collect();
    let others: String = names[1..].iter().map(|name| format!(" - 16*({name} - 0.4)^2")).collect();
    let obstacle = format!("0.5 - 16*(x - 0.3 - 0.2*t)^2{others}");
    let specification = json!({
        "problem": {"obstacle": {
            "domain": domain, "elements": elements, "diffusion": 1, "boundary": boundary,
            "initial": format!("max({obstacle}, 0)"), "obstacle": obstacle
        }},
        "time": {"end": STEP * f64::from(steps)},
        "method": {"step": STEP},
        "output": {"times": {"count": 2}}
    });
    Specification::from_json(specification.to_string().as_bytes()).expect("a valid specification")
}
