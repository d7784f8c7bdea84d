//! The expected outcome of a stability case: an answer to a number of digits, a bound, no growth of energy, events at
//! their times, a warning, or a refusal with its code.

use super::Case;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use solution::{EventKind, Solution, Status};
use specification::{Specification, SpecificationError};

/// An expected property of the solution of a stability case.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Expectation {
    /// Known values of outputs, to a number of digits.
    Answer(ExpectedValues),
    /// Outputs that are expected to stay bounded at all times.
    Bounded {
        /// The names of the outputs that stay bounded.
        of: Vec<String>,
        /// The bound on the absolute value of the outputs.
        by: f64,
    },
    /// Largest growth of the total energy, relative to the largest kinetic or potential energy.
    Energy(f64),
    /// The number and the times of switches and impacts.
    Event(Events),
    /// Largest admissible number of accepted steps.
    Steps(u64),
    /// Code of a warning that the solution is expected to carry.
    Warning(String),
    /// Code and time of an expected failure of a run, or refusal of a specification.
    Refusal(ExpectedError),
}

/// Known values of outputs, which an answer must match to a number of digits.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectedValues {
    /// Expressions in `t` and the parameters of the problem, by the name of the output.
    pub of: Map<String, Value>,
    /// Smallest admissible number of correct digits: `-log10` of the largest error, relative to the largest value.
    pub digits: f64,
    /// Whether to compare outputs at all output times or at the last one only.
    #[serde(default)]
    pub at: At,
}

/// The times at which outputs are compared with their known values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum At {
    /// Outputs are compared at all output times.
    #[default]
    Outputs,
    /// Outputs are compared at the last output time.
    End,
}

/// Expected events of a run; simultaneous events count once.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Events {
    /// Kind of the expected events; `None` for all kinds.
    pub kind: Option<EventKind>,
    /// Expected number of events.
    pub count: Option<usize>,
    /// Expected time of the first event.
    pub first: Option<f64>,
    /// Expected time of the last event.
    pub last: Option<f64>,
    /// Admissible deviation of the event times from the expected times.
    #[serde(default)]
    pub within: f64,
}

/// An expected failure of a run, or refusal of a specification.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectedError {
    /// The code of the failure of the run or of the error in the specification.
    pub code: String,
    /// The time at which the run is expected to fail.
    pub time: Option<f64>,
    /// Admissible deviation of the time at which the run fails.
    #[serde(default)]
    pub within: f64,
}

/// An expectation of a stability case with the actual outcome.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Finding {
    /// The expectation, as text.
    pub expected: String,
    /// The actual outcome, as text.
    pub found: String,
    /// Whether the outcome meets the expectation.
    pub passed: bool,
}

/// Number of correct digits assigned to an error of zero.
const ALL_DIGITS: f64 = 17.0;

impl Expectation {
    /// Compares the expectation with the outcome of a stability case.
    pub fn judge(&self, case: &Case, solution: &Result<Solution, Vec<SpecificationError>>) -> Finding {
        let expected = self.words();
        let judged = match (self, solution) {
            (Self::Refusal(refusal), _) => refusal.judge(solution),
            (_, Err(errors)) => Err(format!("refused: {}", codes(errors))),
            (_, Ok(solution)) if solution.status != Status::Completed => Err(ended(solution)),
            (Self::Answer(answer), Ok(solution)) => answer.judge(case, solution),
            (Self::Bounded { of, by }, Ok(solution)) => bounded(of, *by, solution),
            (Self::Energy(most), Ok(solution)) => energy(*most, solution),
            (Self::Event(events), Ok(solution)) => events.judge(solution),
            (Self::Steps(most), Ok(solution)) => {
                let steps = solution.diagnostics.steps.accepted;
                verdict(steps <= *most, format!("{steps} steps"))
            }
            (Self::Warning(code), Ok(solution)) => {
                let warnings = solution.diagnostics.warnings.iter().map(|warning| warning.code);
                let caveats = solution.verdict.caveats.iter().map(|caveat| caveat.code.as_str());
                let codes: Vec<&str> = warnings.chain(caveats).collect();
                verdict(codes.contains(&code.as_str()), format!("warnings: {}", listed(&codes)))
            }
        };
        let passed = judged.is_ok();
        let (Ok(found) | Err(found)) = judged;
        Finding { expected, found, passed }
    }

    fn words(&self) -> String {
        match self {
            Self::Answer(ExpectedValues { of, digits, at }) => {
                let names: Vec<&str> = of.keys().map(String::as_str).collect();
                let at = if *at == At::End { " at the end" } else { "" };
                format!("{} to {digits} digits{at}", names.join(", "))
            }
            Self::Bounded { of, by } => format!("{} at most {by:e}", of.join(", ")),
            Self::Energy(most) => format!("energy grows by {most:e} at most"),
            Self::Event(Events { kind, count, first, last, within }) => {
                let mut words = vec![if *kind == Some(EventKind::Impact) { "impacts" } else { "events" }.to_owned()];
                words.extend(count.map(|count| format!("{count} in all")));
                words.extend(first.map(|t| format!("the first at {t}")));
                words.extend(last.map(|t| format!("the last at {t}")));
                words.extend((*within > 0.0).then(|| format!("within {within:e}")));
                words.join(", ")
            }
            Self::Steps(most) => format!("at most {most} steps"),
            Self::Warning(code) => format!("the warning {code}"),
            Self::Refusal(ExpectedError { code, time, .. }) => {
                time.map_or_else(|| format!("refused: {code}"), |t| format!("refused: {code} at {t}"))
            }
        }
    }
}

impl ExpectedValues {
    fn judge(&self, case: &Case, solution: &Solution) -> Result<String, String> {
        let exact = self.exact(case, &solution.trajectory.t)?;
        let mut largest = 0.0_f64;
        for (name, exact) in self.of.keys().zip(exact) {
            let values = solution.trajectory.field(name).ok_or_else(|| format!("no output `{name}`"))?;
            let size = exact.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
            let size = if size > 0.0 { size } else { 1.0 };
            let skipped = if self.at == At::End { exact.len().saturating_sub(1) } else { 0 };
            for (value, exact) in values.iter().zip(exact).skip(skipped) {
                let error = ((value - exact) / size).abs();
                largest = if error > largest || error.is_nan() { error } else { largest };
            }
        }
        let digits = if largest == 0.0 { ALL_DIGITS } else { -largest.log10() };
        verdict(digits >= self.digits, format!("{digits:.1} digits"))
    }

    /// Evaluates the known values at the output times; the expressions are compiled like those of a study of the
    /// problem.
    fn exact(&self, case: &Case, times: &[f64]) -> Result<Vec<Vec<f64>>, String> {
        let mut document = case.specification.clone();
        let start = document["time"]["start"].as_f64().unwrap_or(0.0);
        let horizon = document["time"]["end"].as_f64().unwrap_or(0.0) - start;
        document["study"] = json!({"step": [horizon], "exact": self.of});
        let specification =
            Specification::from_json(document.to_string().as_bytes()).map_err(|errors| codes(&errors))?;
        let exact = specification.study().and_then(|study| study.exact.as_ref()).ok_or("no study")?;
        let (mut tape, mut row) = (exact.values.clone(), vec![0.0; exact.fields.len()]);
        let names = specification.model().output_names();
        let mut columns = vec![Vec::with_capacity(times.len()); self.of.len()];
        for &t in times {
            tape.evaluate(t, &[], &mut row);
            for (column, name) in columns.iter_mut().zip(self.of.keys()) {
                let place = exact.fields.iter().position(|&field| names[field] == *name).ok_or("no such output")?;
                column.push(row[place]);
            }
        }
        Ok(columns)
    }
}

impl Events {
    fn judge(&self, solution: &Solution) -> Result<String, String> {
        let events = solution.trajectory.events.iter();
        let mut times: Vec<f64> =
            events.filter(|event| self.kind.is_none_or(|kind| event.kind == kind)).map(|event| event.t).collect();
        times.dedup();
        let near = |found: Option<&f64>, expected: Option<f64>| {
            expected.is_none_or(|expected| found.is_some_and(|found| (found - expected).abs() <= self.within))
        };
        let passed = self.count.is_none_or(|count| times.len() == count)
            && near(times.first(), self.first)
            && near(times.last(), self.last);
        let ends = match times[..] {
            [] => String::new(),
            [only] => format!(", at {only}"),
            [first, .., last] => format!(", from {first} to {last}"),
        };
        verdict(passed, format!("{}{ends}", times.len()))
    }
}

impl ExpectedError {
    fn judge(&self, solution: &Result<Solution, Vec<SpecificationError>>) -> Result<String, String> {
        match solution {
            Err(errors) => verdict(errors.iter().any(|error| error.code == self.code), codes(errors)),
            Ok(solution) => {
                let failure = solution.error.as_ref().ok_or("completed")?;
                let in_time = self.time.is_none_or(|time| (failure.time - time).abs() <= self.within);
                verdict(failure.code == self.code && in_time, ended(solution))
            }
        }
    }
}

fn bounded(names: &[String], by: f64, solution: &Solution) -> Result<String, String> {
    let mut largest = 0.0_f64;
    for name in names {
        let values = solution.trajectory.field(name).ok_or_else(|| format!("no output `{name}`"))?;
        largest = values.iter().fold(largest, |largest, x| largest.max(x.abs()));
    }
    verdict(largest <= by, format!("{largest:.2e} at most"))
}

fn energy(most: f64, solution: &Solution) -> Result<String, String> {
    let field = |name: &str| solution.trajectory.field(name).ok_or_else(|| format!("no output `{name}`"));
    let (kinetic, potential) = (field("kinetic_energy")?, field("potential_energy")?);
    let (mut least, mut growth, mut size) = (f64::INFINITY, 0.0_f64, f64::MIN_POSITIVE);
    for (kinetic, potential) in kinetic.iter().zip(potential) {
        least = least.min(kinetic + potential);
        growth = growth.max(kinetic + potential - least);
        size = size.max(kinetic.abs()).max(potential.abs());
    }
    let share = growth / size;
    verdict(share <= most, format!("grows by {share:.1e}"))
}

fn verdict(passed: bool, found: String) -> Result<String, String> {
    if passed { Ok(found) } else { Err(found) }
}

fn ended(solution: &Solution) -> String {
    let failure = solution.error.as_ref();
    failure.map_or_else(|| "no reason".to_owned(), |failure| format!("{} at {}", failure.code, failure.time))
}

fn codes(errors: &[SpecificationError]) -> String {
    let codes: Vec<&str> = errors.iter().map(|error| error.code).collect();
    listed(&codes)
}

fn listed(codes: &[&str]) -> String {
    if codes.is_empty() { "none".to_owned() } else { codes.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::super::run;
    use super::*;
    use problem::Control;

    /// Whether the solution `x = max(2 - t, 0)` of a test problem meets an expectation.
    fn passes(expectation: &str) -> bool {
        let specification = json!({
            "problem": {"dvi": {"states": {"x": {"initial": 2, "rate": "-1 + z"}},
                "variables": {"z": {"inequality": "x"}}, "set": [{"nonnegative": ["z"]}]}},
            "time": {"end": 3}});
        let expect = vec![serde_json::from_str(expectation).expect("an expectation")];
        let (name, title) = ("test".to_owned(), String::new());
        run(&Case { part: "test", name, title, specification, expect }, &Control::new()).passed()
    }

    #[test]
    fn an_expectation_holds_or_does_not() {
        for (right, wrong) in [
            (
                r#"{"answer": {"of": {"x": "max(2 - t, 0)"}, "digits": 12}}"#,
                r#"{"answer": {"of": {"x": "2 - t"}, "digits": 1}}"#,
            ),
            (
                r#"{"answer": {"of": {"z": 1}, "digits": 12, "at": "end"}}"#,
                r#"{"answer": {"of": {"z": 1}, "digits": 12}}"#,
            ),
            (r#"{"bounded": {"of": ["x"], "by": 2}}"#, r#"{"bounded": {"of": ["x"], "by": 1.9}}"#),
            (r#"{"event": {"count": 1, "first": 2, "within": 1e-12}}"#, r#"{"event": {"last": 2.1, "within": 0.01}}"#),
            (r#"{"steps": 100}"#, r#"{"steps": 0}"#),
            (r#"{"event": {"kind": "impact", "count": 0}}"#, r#"{"warning": "jump"}"#),
        ] {
            assert!(passes(right), "{right}");
            assert!(!passes(wrong), "{wrong}");
        }
        for wrong in
            [r#"{"refusal": {"code": "no_solution"}}"#, r#"{"energy": 1}"#, r#"{"bounded": {"of": ["y"], "by": 9}}"#]
        {
            assert!(!passes(wrong), "{wrong}");
        }
    }
}
