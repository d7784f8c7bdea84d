//! The evidence of stability in a report: the table of cases, the stability function, contraction, and the energy of
//! contact runs.

use super::{Outcome, cases, run};
use crate::contraction::{Contraction, contractions};
use crate::energies::{Balance, balances};
use crate::linear_stability::{Ray, rays};
use problem::Control;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::time::{Duration, Instant};

/// Time limit of one stability case in a report.
const LONGEST: Duration = Duration::from_secs(20);

/// All measurements of stability in a report.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Stability {
    /// The outcomes of the stability cases in the table.
    pub outcomes: Vec<Outcome>,
    /// The measured stability functions along rays of the left half plane.
    pub rays: Vec<Ray>,
    /// The contraction of pairs of solutions of a dissipative problem.
    pub contractions: Vec<Contraction>,
    /// The energy balances of contact runs.
    pub balances: Vec<Balance>,
}

impl Stability {
    /// Makes all measurements of stability; `progress` is called with the name of each part before it begins.
    pub fn measure(mut progress: impl FnMut(&str)) -> Self {
        let cases = cases();
        let mut outcomes = Vec::with_capacity(cases.len());
        let mut part = "";
        for case in &cases {
            if case.part != part {
                part = case.part;
                progress(part);
            }
            outcomes.push(run(case, &Control::with_deadline(Instant::now() + LONGEST)));
        }
        progress("stability function");
        let rays = rays();
        progress("contraction");
        let contractions = contractions();
        progress("energy of contacts");
        Self { outcomes, rays, contractions, balances: balances() }
    }

    /// Returns the number of trusted answers and the number of all answers, of those stability cases that reached the
    /// end and whose outcomes are as expected (`right`), or are not.
    pub fn trusted(&self, right: bool) -> (usize, usize) {
        let of = self.outcomes.iter().filter(|outcome| outcome.passed() == right).filter_map(|outcome| outcome.trusted);
        of.fold((0, 0), |(trusted, all), one| (trusted + usize::from(one), all + 1))
    }

    /// Returns the table of stability cases as CSV, with a header.
    pub fn csv(&self) -> String {
        let mut text = String::from("part,case,expected,found,passed,trusted,seconds\n");
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        for outcome in &self.outcomes {
            for finding in &outcome.findings {
                let cells = [&outcome.part, &outcome.name, &finding.expected, &finding.found].map(|cell| quoted(cell));
                // Writing to a string cannot fail.
                let trusted = outcome.trusted.map_or_else(String::new, |trusted| trusted.to_string());
                let _ = writeln!(text, "{},{},{trusted},{}", cells.join(","), finding.passed, outcome.seconds);
            }
        }
        text
    }
}
