//! Comparison of run times: for each system the fastest run that is accurate enough, of this program and of other
//! programs; and how often verdicts are right.

use super::chapters::rung;
use super::{escaped, number, table};
use crate::report::{Chapter, Errors, Ladder, Run, WRONG, chosen, first_order};

/// Target errors of the states, at the end and over time, for which run times are compared.
const TARGETS: [f64; 2] = [1e-3, 1e-6];

/// Returns the table of the shortest run times for the target errors, for all systems.
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
        "implicit Euler or Moreau",
        "fastest other program",
        "10⁻⁶: chosen",
        "implicit Euler or Moreau",
        "fastest other program",
    ];
    "<h2>Run time for an error</h2><p>The shortest run time in seconds of the runs whose errors of states, at the end and over time, \
     are at most so large and whose answers are trusted (other programs give no verdict); a dash where none is.</p>"
        .to_owned()
        + &table(&head, rows)
}

/// Returns the shortest run time of the runs with an error of at most `target` and no verdict against them, with the
/// method if `named`.
fn fastest<'a>(ladders: impl IntoIterator<Item = &'a Ladder>, target: f64, named: bool) -> String {
    let good = |run: &&Run| {
        run.trusted != Some(false) && run.errors.as_ref().and_then(Errors::of_states).is_some_and(|e| e <= target)
    };
    let all = ladders.into_iter().flat_map(|ladder| {
        ladder.runs.iter().filter(good).map(|run| (run.seconds, ladder.method.as_str())).collect::<Vec<_>>()
    });
    match all.min_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((seconds, method)) if named => number(&format!("{seconds:.1e} ({})", escaped(method))),
        Some((seconds, _)) => number(&format!("{seconds:.1e}")),
        None => number("–"),
    }
}

/// Error of the states up to which an answer counts as right, whatever accuracy was asked for.
const RIGHT: f64 = 1e-3;

/// Returns a table of how many answers the verdicts trust, by the error of the answer, with the list of trusted runs
/// whose answers are wrong.
pub fn verdicts<'a>(chapters: impl Iterator<Item = &'a Chapter>) -> String {
    let (mut counts, mut silent) = ([[0_usize; 2]; 3], Vec::new());
    for chapter in chapters {
        for (ladder, run) in chapter.ladders.iter().flat_map(|ladder| ladder.runs.iter().map(move |run| (ladder, run)))
        {
            let (Some(trusted), Some(error)) = (run.trusted, run.errors.as_ref().and_then(Errors::of_states)) else {
                continue;
            };
            let row = if error > WRONG { 2 } else { usize::from(error > RIGHT) };
            counts[row][usize::from(!trusted)] += 1;
            if row == 2 && trusted {
                silent.push(format!(
                    "{} ({}, {}: {error:.1e})",
                    escaped(&chapter.name),
                    escaped(&ladder.method),
                    rung(run)
                ));
            }
        }
    }
    let names = ["at most 10⁻³", "between", "more than 10⁻²"];
    let rows = names
        .iter()
        .zip(counts)
        .map(|(name, [trusted, not])| [(*name).to_owned(), number(&trusted.to_string()), number(&not.to_string())]);
    let silent = match silent.as_slice() {
        [] => "No answer with a larger error is trusted.".to_owned(),
        silent => format!("Trusted, with errors above 10⁻²: {}.", silent.join("; ")),
    };
    "<h2>Verdicts against errors</h2><p>All runs that reached the end, by the larger of the errors of states at the end and over time. \
     Fixed steps have no tolerance: their answers are trusted up to an estimated error of 10⁻³.</p>"
        .to_owned()
        + &table(&["error of states", "trusted", "not trusted"], rows)
        + &format!("<p>{silent}</p>")
}
