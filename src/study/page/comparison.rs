//! The time for an error: of each system the fastest run that is at least so accurate, here and of other programs.

use super::{escaped, number, table};
use crate::report::{Chapter, Ladder, chosen, first_order};

/// The errors at the end that are asked for.
const TARGETS: [f64; 2] = [1e-3, 1e-6];

/// The table of the systems whose errors tell methods apart.
pub fn html<'a>(chapters: impl Iterator<Item = &'a Chapter>) -> String {
    let rows = chapters.map(|chapter| {
        let name = escaped(&chapter.name);
        let peers: Vec<&Ladder> = chapter.peers.iter().collect();
        let cells = TARGETS.map(|target| {
            [
                fastest(chosen(chapter), target, false),
                fastest(first_order(chapter), target, false),
                fastest(peers.iter().copied(), target, true),
            ]
        });
        let [[a, b, c], [d, e, f]] = cells;
        [format!("<a href=\"#{name}\">{name}</a>"), a, b, c, d, e, f]
    });
    let head = [
        "system",
        "10⁻³: chosen",
        "first order",
        "fastest other program",
        "10⁻⁶: chosen",
        "first order",
        "fastest other program",
    ];
    "<h2>Run time for an error at the end</h2><p>The shortest run time in seconds of the runs that are at least so accurate; a \
     dash where none is.</p>"
        .to_owned()
        + &table(&head, rows)
}

/// The shortest time of the runs with an error below a target, with the method where it is asked for.
fn fastest<'a>(ladders: impl IntoIterator<Item = &'a Ladder>, target: f64, named: bool) -> String {
    let good =
        |run: &&crate::report::Run| run.errors.as_ref().and_then(|errors| errors.end).is_some_and(|e| e <= target);
    let all = ladders.into_iter().flat_map(|ladder| {
        ladder.runs.iter().filter(good).map(|run| (run.seconds, ladder.method.as_str())).collect::<Vec<_>>()
    });
    match all.min_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((seconds, method)) if named => number(&format!("{seconds:.1e} ({})", escaped(method))),
        Some((seconds, _)) => number(&format!("{seconds:.1e}")),
        None => number("–"),
    }
}
