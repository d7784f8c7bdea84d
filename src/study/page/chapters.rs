//! The chapters of a report: the statement of each example system, as a paper would give it, then the measurements.

use super::{escaped, number, table, trusted};
use crate::report::{
    Chapter, Errors, FINER_STEPS, LONG, LONGEST, Ladder, Outcome, REPEATS, Run, WRONG, chapter_picture,
};
use serde_json::Value;
use std::fmt::Write as _;

/// Returns a table with a row for each example system: its reference, the least errors of its runs, and how many runs
/// have an answer and are trusted.
pub fn summary<'a>(chapters: impl Iterator<Item = &'a Chapter>) -> String {
    let rows = chapters.map(|chapter| {
        let least = |error: fn(&Errors) -> Option<f64>| {
            let runs = chapter.ladders.iter().flat_map(|ladder| &ladder.runs).filter_map(|run| run.errors.as_ref());
            number(
                &runs.filter_map(error).reduce(f64::min).map_or_else(|| "–".to_owned(), |least| format!("{least:.0e}")),
            )
        };
        let name = escaped(&chapter.name);
        let (lost, runs) = Chapter::lost(&chapter.ladders);
        let (right, ended) = chapter.trusted();
        [
            format!("<a href=\"#{name}\">{name}</a>"),
            against(chapter),
            least(|errors| errors.end),
            least(|errors| errors.states),
            least(|errors| errors.switches),
            number(&format!("{lost} of {runs}")),
            number(&format!("{right} of {ended}")),
        ]
    });
    let head = ["system", "reference", "end", "over time", "switches", "runs without an answer", "trusted"];
    table(&head, rows)
}

/// Returns what the errors of a system are measured against, in words.
fn against(chapter: &Chapter) -> String {
    chapter.source.as_ref().map_or_else(
        || "<em>a run of this program</em>".to_owned(),
        |source| escaped(&source.what) + if chapter.semidiscrete { " (for the mesh)" } else { "" },
    )
}

/// Returns a table of the systems on which, by a public thread, another program gives a wrong answer or none. A row
/// has the thread, the failure reported there, the least error of this program's trusted runs, and the source of the
/// reference values.
pub fn reported(chapters: &[Chapter]) -> String {
    let rows = chapters.iter().filter_map(|chapter| {
        let reported = chapter.reported.as_ref()?;
        let (title, address) = (escaped(&reported.title), escaped(&reported.address));
        let errors = chapter.ladders.iter().flat_map(|ladder| &ladder.runs).filter(|run| run.trusted == Some(true));
        let least = errors.filter_map(|run| run.errors.as_ref()?.of_states()).reduce(f64::min);
        let name = escaped(&chapter.name);
        Some([
            format!("<a href=\"#{name}\">{name}</a>"),
            format!("<a href=\"{address}\">{title}</a>"),
            escaped(&reported.what),
            number(&least.map_or_else(|| "–".to_owned(), |least| format!("{least:.0e}"))),
            against(chapter),
        ])
    });
    let rows: Vec<[String; 5]> = rows.collect();
    if rows.is_empty() {
        return String::new();
    }
    let head = ["system", "reported in", "what happens there", "error of states here, trusted", "against"];
    include_str!("reported.html").to_owned() + &table(&head, rows.into_iter())
}

/// Appends the section of an example system: statement, solution, reference, errors.
pub fn section(page: &mut String, chapter: &Chapter, fixed: bool) {
    // Writing to a string cannot fail.
    let _ = write!(page, "<section id=\"{}\"><h2>{}</h2>", escaped(&chapter.name), escaped(&chapter.title));
    *page += &statement(chapter);
    if !chapter.solution.is_empty() {
        let _ = write!(page, "<figure>{}<figcaption>The solution.</figcaption></figure>", chapter.solution);
    }
    if let Some(reported) = &chapter.reported {
        let (what, title, address) = (escaped(&reported.what), escaped(&reported.title), escaped(&reported.address));
        let _ = write!(page, "<p><strong>Reported elsewhere.</strong> <a href=\"{address}\">{title}</a>: {what}.</p>");
    }
    let _ = write!(page, "<p>{}</p>", reference(chapter));
    let _ = write!(
        page,
        "<figure>{}<figcaption>{}</figcaption></figure>",
        chapter_picture(chapter, fixed),
        caption(chapter)
    );
    if !chapter.meshes.is_empty() {
        *page += &meshes(chapter);
    }
    let rows = chapter.all().flat_map(|ladder| ladder.runs.iter().map(|run| row(ladder, run, fixed)));
    let head = [
        "method",
        "at",
        "steps",
        "time / s (spread)",
        "end",
        "states",
        "variables",
        "switch times",
        "switches",
        "power",
        "trusted",
    ];
    let _ = write!(page, "<details><summary>Numbers</summary>{}</details></section>", table(&head, rows));
}

/// The largest number of initial values that are listed beside the equations of a system.
const MOST_STATES: usize = 12;

/// Returns the equations, parameters and horizon of a system, and the specification with which its runs can be
/// repeated.
fn statement(chapter: &Chapter) -> String {
    let mut text = format!("<pre class=\"equations\">{}</pre>", escaped(&chapter.equations.join("\n")));
    let value = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let parameters = chapter.parameters().into_iter().flatten();
    let mut told: Vec<String> = parameters.map(|(name, number)| format!("{name} = {}", value(number))).collect();
    let time = &chapter.specification["time"];
    let start = time.get("start").map_or_else(|| "0".to_owned(), value);
    told.push(format!("t from {start} to {}", time.get("end").map_or_else(String::new, value)));
    let _ = write!(text, "<p>{}.</p>", escaped(&told.join(", ")));
    if chapter.start.len() <= MOST_STATES {
        let values: Vec<String> = chapter.start.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let _ = write!(text, "<p>At the start: {}.</p>", escaped(&values.join(", ")));
    } else {
        let _ = write!(text, "<p>{} states; their initial values are in the specification.</p>", chapter.start.len());
    }
    let (least, most) = chapter.atol;
    let parts = if least == most { format!("{least:.0e}") } else { format!("{least:.0e} to {most:.0e}") };
    if most > 0.0 {
        let _ = write!(text, "<p>Absolute tolerances: {parts} times the relative tolerance.</p>");
    }
    let whole = serde_json::to_string_pretty(&chapter.specification).unwrap_or_default();
    text + "<details><summary>Specification</summary><pre>" + &escaped(&whole) + "</pre></details>"
}

/// Describes the reference that errors are measured against, and how the reference was computed.
fn reference(chapter: &Chapter) -> String {
    let reference = &chapter.reference;
    let mut text = "<strong>Reference.</strong> ".to_owned();
    if let Some(source) = &chapter.source {
        let file = source.file.as_ref().map_or_else(String::new, |file| format!(" (<code>{}</code>)", escaped(file)));
        let _ = write!(text, "{}; {}{file}. ", capital(&escaped(&source.what)), escaped(&source.digits));
    }
    match (&reference.run, chapter.outside(), chapter.semidiscrete) {
        (Some(run), _, true) => {
            let _ = write!(
                text,
                "That is the answer in the continuum, and the mesh is measured against it. Errors in time are those \
                against the exact solution of the equations on this mesh: a run of this program with {run}. "
            );
        }
        (Some(run), true, false) => {
            let _ = write!(
                text,
                "Where that says nothing (between, and of other outputs) the reference is a run of this program with {run}"
            );
            if let Some(agreement) = reference.agreement {
                let _ = write!(text, ", which differs from it by {agreement:.1e} at the end");
            }
            text += ". ";
        }
        (Some(run), false, false) => {
            let _ = write!(
                text,
                "Nothing is known from outside: a run of this program with {run}. The figures show that the \
                methods agree, not that they are right. "
            );
        }
        (None, ..) => match reference.agreement {
            Some(distance) => {
                let _ = write!(
                    text,
                    "The best run of this program differs from it by {distance:.1e} at the end and is no reference, so that errors \
                     over time are left out. "
                );
            }
            None => text += "No run of reference reached the end, so that errors over time are left out. ",
        },
    }
    if let Some(coarser) = reference.coarser {
        let _ = write!(
            text,
            "A run with steps twice as long differs from it by {coarser:.1e} over time: smaller errors here mean \
             nothing{}. ",
            if coarser > WRONG { ", and time stepping does not converge to one solution" } else { "" }
        );
    }
    let switches = match (reference.switches.len(), reference.switches_outside) {
        (0, _) => "There are no switches.".to_owned(),
        (count, true) => format!("{count} switch{} known from outside.", if count == 1 { "" } else { "es" }),
        (count, false) => format!("{count} switch{} from that run.", if count == 1 { "" } else { "es" }),
    };
    let times = format!(" Runs are compared at {} times.", reference.compared);
    text + &switches + &times
}

fn caption(chapter: &Chapter) -> String {
    let mut text = "Relative errors".to_owned();
    let (lost, runs) = Chapter::lost(&chapter.ladders);
    if lost > 0 {
        let reasons: Vec<String> = chapter
            .ladders
            .iter()
            .flat_map(|ladder| {
                let lost = ladder.runs.iter().filter(|run| matches!(run.outcome, Outcome::Failed | Outcome::Stopped));
                lost.map(|run| format!("{} at {}: {}", escaped(&ladder.method), rung(run), why(run)))
            })
            .collect();
        let _ = write!(text, ". {lost} of {runs} runs have no answer ({})", reasons.join("; "));
    }
    if chapter.peers.is_empty() && chapter.is_exact_for_all() {
        text += ". Other programs were not asked: implicit Euler is exact here";
    } else if chapter.is_exact_between_switches() {
        text += ". The loosest tolerance is exact to rounding: switches are located, and nothing is shown of the order";
    }
    text + "."
}

fn why(run: &Run) -> String {
    match (&run.message, run.outcome) {
        (Some(message), _) => escaped(message),
        (None, Outcome::Stopped) => format!("stopped after {} s", LONGEST.as_secs()),
        (None, _) => "failed".to_owned(),
    }
}

fn meshes(chapter: &Chapter) -> String {
    let shown = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1e}"));
    let rows = chapter.meshes.iter().map(|mesh| {
        let order = mesh.order.map_or_else(|| "–".to_owned(), |order| format!("{order:.2}"));
        [number(&escaped(&mesh.elements)), number(&shown(mesh.error)), number(&order)]
    });
    "<p>The error of the mesh, at a tolerance in time far below it:</p>".to_owned()
        + &table(&["elements", "error against the continuum", "order in the size of an element"], rows)
}

/// Returns the tolerance or the step size of a run, as text.
pub fn rung(run: &Run) -> String {
    match (run.rtol, run.step) {
        (Some(rtol), _) => format!("tolerance {rtol:.0e}"),
        (None, Some(step)) => format!("step {step:.2e}"),
        (None, None) => String::new(),
    }
}

fn row(ladder: &Ladder, run: &Run, fixed: bool) -> [String; 11] {
    let errors = run.errors.clone().unwrap_or_default();
    let shown = |value: Option<f64>| number(&value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1e}")));
    let end = match run.outcome {
        Outcome::Completed => shown(errors.end),
        Outcome::Stopped => number("stopped"),
        Outcome::Failed => number("failed"),
        Outcome::NotTried => number("not tried"),
    };
    let power = |power: f64| {
        let base = if run.rtol.is_some() { "tol" } else { "h" };
        format!("{base}<sup>{power:.2}</sup>")
    };
    let time = match (fixed, run.outcome) {
        (true, _) | (_, Outcome::NotTried) => "–".to_owned(),
        _ if run.spread.0 == run.spread.1 => format!("{:.1e}", run.seconds),
        _ => format!("{:.1e} ({:.1e} to {:.1e})", run.seconds, run.spread.0, run.spread.1),
    };
    [
        escaped(&ladder.method),
        number(&rung(run)),
        number(&run.steps.to_string()),
        number(&time),
        end,
        shown(errors.states),
        shown(errors.variables),
        shown(errors.switches),
        number(&errors.switches_found.map_or_else(|| "–".to_owned(), |count| count.to_string())),
        number(&run.change.map_or_else(|| "–".to_owned(), power)),
        trusted(run.trusted),
    ]
}

/// Describes how run times were measured, and on which machine. For a `fixed` report, which must not depend on the
/// machine, it only says that run times are left out.
pub fn conditions(chapters: &[Chapter], fixed: bool) -> String {
    if fixed {
        return "<p>Made without times, machine and date: the abscissa of the figures is the number of accepted steps.</p>".to_owned();
    }
    let mut all: Vec<_> = chapters.iter().map(|chapter| &chapter.conditions).collect();
    all.dedup();
    let rows = all.iter().map(|one| {
        let program = format!("{}, {}", one.program, one.build);
        let processor = format!("{}, {} available, one used", one.processor, one.cores);
        [escaped(&one.date), escaped(&program), escaped(&processor), escaped(&one.system)]
    });
    let table = table(&["date", "program", "processor", "system"], rows);
    format!(
        "{table}<p>A run time is the median of {REPEATS} solves after one that is not counted, on one thread, without reading the \
         specification; thin lines in the figures reach from the least to the largest. Runs of more than {LONG} s are not repeated. \
         A run is stopped after {} s, and finer ones of its ladder are not tried then. Fixed steps whose answers are wrong at all of \
         four sizes go on to a {}th and a {}th of the horizon.</p>",
        LONGEST.as_secs(),
        FINER_STEPS[0],
        FINER_STEPS[1]
    )
}

fn capital(text: &str) -> String {
    let mut rest = text.chars();
    rest.next().map_or_else(String::new, |first| first.to_uppercase().collect::<String>() + rest.as_str())
}
