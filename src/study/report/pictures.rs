//! Pictures of the report: for one system the errors at the end and over time, for all systems the errors at the end.

use super::{Chapter, Errors, Ladder, Outcome, Run};
use solution::pictures::{Arrangement, Curve, LARGE, SMALL, Words, overview};

/// Smallest error that is shown: smaller errors are rounding, and are drawn at this value.
const LEAST_ERROR: f64 = 1e-17;
/// Shortest run time that the pictures show, in seconds.
const LEAST_TIME: f64 = 1e-9;

/// Names of the methods in the picture of all systems: the first one that a system has been run with is shown.
const CHOSEN: [&str; 5] = ["stages chosen", "contact, located", "tr_bdf2", "3 stages", "3 stages at fixed steps"];
const FIRST_ORDER: [&str; 2] = [super::IMPLICIT_EULER, "contact at fixed steps"];

/// Returns the runs of the method that the program chooses by default; `None` for a system that is only solved with
/// fixed steps of first order.
pub fn chosen(chapter: &Chapter) -> Option<&Ladder> {
    first_of(chapter, &CHOSEN)
}

/// Returns the runs of first-order time stepping (implicit Euler or Moreau) of a system, from coarse to fine.
pub fn first_order(chapter: &Chapter) -> Option<&Ladder> {
    first_of(chapter, &FIRST_ORDER)
}

fn first_of<'a>(chapter: &'a Chapter, methods: &[&str]) -> Option<&'a Ladder> {
    methods.iter().find_map(|method| chapter.ladders.iter().find(|ladder| ladder.method == *method))
}

/// A kind of error of a run: its name, and the function that selects it.
type Kind = (&'static str, fn(&Errors) -> Option<f64>);

const KINDS: [Kind; 4] = [
    ("at the end", |errors| errors.end),
    ("states, largest over time", |errors| errors.states),
    ("variables and other outputs, largest over time", |errors| errors.variables),
    ("times of switches", |errors| errors.switches),
];

/// Returns the label of the abscissa of the pictures: run time, or the number of steps in a report that must not depend
/// on the machine.
fn abscissa(fixed: bool) -> &'static str {
    if fixed { "steps" } else { "run time in s" }
}

fn cost(run: &Run, fixed: bool) -> f64 {
    if fixed { (run.steps as f64).max(1.0) } else { run.seconds.max(LEAST_TIME) }
}

fn curve(ladder: &Ladder, error: fn(&Errors) -> Option<f64>, fixed: bool) -> Curve {
    let point = |run: &Run| Some((cost(run, fixed), error(run.errors.as_ref()?)?.max(LEAST_ERROR)));
    // Runs of programs that do not count their steps are not shown if the abscissa is the number of steps.
    let shown = |run: &&Run| run.outcome != Outcome::NotTried && !(fixed && run.steps == 0);
    let runs = || ladder.runs.iter().filter(shown);
    let wide = |run: &Run| (run.spread.0.max(LEAST_TIME), run.spread.1.max(LEAST_TIME));
    let spread = runs().filter_map(|run| point(run).map(|point| (wide(run).0, wide(run).1, point.1)));
    Curve {
        name: ladder.method.clone(),
        points: runs().filter_map(point).collect(),
        untrusted: runs().filter(|run| run.trusted == Some(false)).filter_map(point).collect(),
        lost: runs().filter(|run| run.outcome != Outcome::Completed).map(|run| cost(run, fixed)).collect(),
        spread: if fixed { Vec::new() } else { spread.collect() },
    }
}

/// Returns the picture of one system: a panel for each kind of error that its runs have.
pub fn chapter_picture(chapter: &Chapter, fixed: bool) -> String {
    let panels: Vec<(&str, Vec<Curve>)> = KINDS
        .into_iter()
        .map(|(name, error)| (name, chapter.all().map(|ladder| curve(ladder, error, fixed)).collect::<Vec<_>>()))
        .filter(|(_, curves)| curves.iter().any(|curve| !curve.points.is_empty()))
        .collect();
    let title = format!("{}: error against {}", chapter.title, abscissa(fixed));
    let words = Words { title: &title, titled: false, ordinate: "relative error", abscissa: abscissa(fixed) };
    let arrangement = if panels.len() == 1 { Arrangement { columns: 1, height: 300.0, ..LARGE } } else { LARGE };
    overview(&panels, words, arrangement)
}

/// Returns the picture of all systems that have values from outside this program and distinguish methods: the
/// first-order time stepping of other programs beside the method that this program chooses by default.
pub fn picture(chapters: &[Chapter], fixed: bool) -> String {
    let at_end = |ladder: Option<&Ladder>, name: &str| {
        let found = ladder.map_or_else(Curve::default, |ladder| curve(ladder, |errors| errors.end, fixed));
        Curve { name: name.to_owned(), ..found }
    };
    let panels: Vec<(&str, Vec<Curve>)> = chapters
        .iter()
        .filter(|chapter| chapter.outside() && !chapter.is_exact_for_all())
        .map(|chapter| {
            let curves = [
                at_end(chosen(chapter), "tolerances from 1e-3 to 1e-9"),
                at_end(first_order(chapter), "implicit Euler or Moreau at fixed steps"),
            ];
            (chapter.name.as_str(), curves.into())
        })
        .collect();
    let title = if fixed { "Error against number of steps" } else { "Error against run time" };
    let words = Words { title, titled: true, ordinate: "relative error at the end", abscissa: abscissa(fixed) };
    overview(&panels, words, SMALL)
}
