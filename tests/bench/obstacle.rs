//! How the time of a step of an obstacle problem grows with the number of nodes: `cargo bench --bench obstacle`. A paraboloid
//! moves under a membrane, in one, two and three dimensions; the time of a step is the difference between a longer run
//! and a shorter one. A slope of one is linear growth.

use dvi::problem::Control;
use dvi::solution::Status;
use dvi::specification::Specification;
use serde_json::{Value, json};

const STEP: f64 = 0.002;

fn main() {
    let sizes: [&[u64]; 3] = [&[1_000, 10_000, 100_000, 1_000_000], &[31, 99, 315, 999], &[9, 21, 46, 99]];
    let most: f64 = std::env::args().skip(1).find_map(|argument| argument.parse().ok()).unwrap_or(f64::INFINITY);
    println!(
        "{:>10} {:>10} {:>14} {:>8} {:>8} {:>10}",
        "dimension", "nodes", "ms a step", "slope", "passes", "residual"
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
            println!("{dimension:>10} {nodes:>10} {:>14.3} {slope:>8.2} {passes:>8.1} {:>10.1e}", 1e3 * step, longer.2);
            before = Some((nodes, step));
        }
    }
}

/// Seconds, active sets tried and the residual of a run of so many steps.
fn run(dimension: usize, elements: u64, steps: u32) -> (f64, f64, f64) {
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
    let specification = Specification::from_json(specification.to_string().as_bytes()).expect("a valid specification");
    let solution = dvi::solve(&specification, &Control::new());
    assert_eq!(solution.status, Status::Completed, "{:?}", solution.error);
    let vi = solution.diagnostics.vi.expect("inequalities");
    (solution.diagnostics.wall_seconds, vi.pivots as f64, vi.largest_residual)
}
