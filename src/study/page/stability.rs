//! The stability chapter of a report: the table of cases with verdicts, the stability function in pictures,
//! contraction, energy.

use super::{escaped, number, table};
use crate::contraction::Contraction;
use crate::energies::Balance;
use crate::linear_stability::Ray;
use crate::stability::{Outcome, Stability, parts};
use solution::Status;
use solution::pictures::{Curve, double_logarithmic};

/// Smallest modulus of the stability function that is drawn: smaller values are rounding.
const LEAST: f64 = 1e-17;

/// Returns the stability chapter of the report as HTML.
pub fn html(limits: &Stability) -> String {
    let Stability { outcomes, rays, contractions, balances } = limits;
    let mut page = include_str!("stability.html").to_owned();
    let passed = outcomes.iter().filter(|outcome| outcome.passed()).count();
    page += &format!("<p><strong>{passed} of {}</strong> cases pass.</p>", outcomes.len());
    page += &verdicts(limits);
    let failed: Vec<&Outcome> = outcomes.iter().filter(|outcome| !outcome.passed()).collect();
    if !failed.is_empty() {
        page += "<h2>Failures</h2>";
        page += &rows(&failed);
    }
    for part in parts() {
        let of_part: Vec<&Outcome> = outcomes.iter().filter(|outcome| outcome.part == part).collect();
        let passed = of_part.iter().filter(|outcome| outcome.passed()).count();
        let name = part.replace('_', " ");
        page +=
            &format!("<details><summary>{name}: {passed} of {}</summary>{}</details>", of_part.len(), rows(&of_part));
    }
    page + &linear(rays) + &nonlinear(contractions) + &energy(balances)
}

/// Describes how many of the right and of the wrong answers to the stability cases the verdicts trust.
fn verdicts(limits: &Stability) -> String {
    let [right, wrong] = [true, false].map(|passed| limits.trusted(passed));
    format!(
        "<p>The verdict on the answers that reached the end: of the right ones <strong>{} of {}</strong> are trusted, of the \
         wrong ones {} of {}.</p>",
        right.0, right.1, wrong.0, wrong.1
    )
}

fn rows(outcomes: &[&Outcome]) -> String {
    let rows = outcomes.iter().flat_map(|outcome| {
        outcome.findings.iter().enumerate().map(|(k, finding)| {
            let once = |text: &str| if k == 0 { escaped(text) } else { String::new() };
            let class = if finding.passed { "passed" } else { "failed" };
            let verdict = format!("<span class=\"{class}\">{class}</span>");
            let trusted = if k == 0 { super::trusted(outcome.trusted) } else { String::new() };
            let [name, title] = [once(&outcome.name), once(&outcome.title)];
            [name, title, escaped(&finding.expected), escaped(&finding.found), verdict, trusted]
        })
    });
    table(&["case", "", "what must come of it", "what came", "", "trusted"], rows)
}

fn linear(rays: &[Ray]) -> String {
    let mut page = "<h2>The stability function, measured from the stepper</h2>\
        <p>One step of length one of <i>x′ = λx</i>; the methods are A-stable where no value lies above one, and L-stable where it \
        falls to zero. The last column is the distance from the stability function of the coefficients.</p>"
        .to_owned();
    for (degrees, name) in
        [(90, "along the imaginary axis"), (135, "along the diagonal"), (180, "along the negative real axis")]
    {
        let of_angle = rays.iter().filter(|ray| ray.degrees == degrees);
        let curves: Vec<Curve> = of_angle
            .map(|ray| Curve {
                name: format!("{} stage{}", ray.stages, if ray.stages == 1 { "" } else { "s" }),
                points: ray.points.iter().map(|&(z, r)| (z, r.max(LEAST))).collect(),
                ..Curve::default()
            })
            .collect();
        page += &double_logarithmic(&curves, &format!("|R(z)| {name}"), "|R(z)|", "|z|");
    }
    let rows = rays.iter().map(|ray| {
        let far = ray.points.last().map_or(f64::NAN, |point| point.1);
        [
            number(&ray.stages.to_string()),
            number(&format!("{}°", ray.degrees)),
            number(&format!("{:.6}", ray.largest)),
            number(&format!("{far:.1e}")),
            number(&format!("{:.1e}", ray.difference)),
        ]
    });
    let head = ["stages", "angle of z", "largest |R|", "|R| at |z| = 10⁸", "off the coefficients by"];
    page + "<details><summary>Numbers</summary>" + &table(&head, rows) + "</details>"
}

fn nonlinear(contractions: &[Contraction]) -> String {
    let rows = contractions.iter().map(|found| {
        let (stages, step) = (found.stages.to_string(), format!("{:e}", found.step));
        [stages, step, format!("{:.1e}", found.growth), found.failures.to_string()].map(|cell| number(&cell))
    });
    "<h2>Nonlinear contraction</h2><p>Pairs of solutions of a monotone system with cubic damping, a rotation and dry friction: the exact \
     flow brings no two of them further apart, and neither may a step.</p>"
        .to_owned()
        + &table(&["stages", "step", "most growth of a distance", "pairs with an unsolved stage"], rows)
}

fn energy(balances: &[Balance]) -> String {
    let rows = balances.iter().map(|balance| {
        let defect = match balance.status {
            Status::Completed => format!("{:.1e}", balance.defect),
            Status::Stopped => "stopped".to_owned(),
            Status::Failed => "failed".to_owned(),
        };
        let gain = format!("{:.1e}", balance.gain_in_impacts);
        [escaped(&balance.name), escaped(&balance.how), number(&defect), number(&gain)]
    });
    "<h2>Energy of contact runs</h2><p>The balance of energy, work, friction, viscosity and impacts: the most that it is off by, as a part of the \
     energy, and the most that a step gained through impacts.</p>"
        .to_owned()
        + &table(&["system", "at", "largest defect", "largest gain in impacts"], rows)
}
