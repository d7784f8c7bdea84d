//! A document that has been parsed but not yet checked. A few words may declare a grid of a million nodes, so a service
//! estimates how long the check will take before it begins.

use super::checked::Specification;
use super::document::Document;
use super::error::SpecificationError;
use super::json::Json;
use super::output::MOST_TIMES;
use super::reading::{Reading, read, read_tree};
use super::times::Times;
use problem::Control;
use std::time::Duration;

/// A specification whose structure is known and whose meaning has not been checked.
#[derive(Debug)]
pub struct Draft(Reading);

/// Length in bytes assumed for a document that is already parsed; it bounds the work of repairs, of which such a
/// document needs few or none.
const OF_TREE: usize = 1 << 20;

/// Measured time to generate one output time of a trajectory, in nanoseconds.
const A_TIME: usize = 5;

impl Draft {
    /// Reads a JSON document.
    ///
    /// # Errors
    /// Every error in the structure of the document, at least one, if the document cannot be repaired well enough to
    /// be checked.
    pub fn read(text: &[u8]) -> Result<Self, Vec<SpecificationError>> {
        read(text).map(Self)
    }

    /// Reads the tree of a document, in which the numbers named in `values` (parameters, initial values and other
    /// numbers that a sweep may vary) get new values.
    pub(super) fn of_tree(tree: Json, values: &[(String, f64)]) -> Result<Self, Vec<SpecificationError>> {
        read_tree(tree, values, OF_TREE).map(Self)
    }

    /// Estimates the time to check the document, beyond what the length of the text accounts for.
    pub fn check_time(&self) -> Duration {
        let document = &self.0.document;
        let of_problem = document.problem.written().time_to_check();
        let nanoseconds = of_problem.saturating_add(declared_times(document).saturating_mul(A_TIME));
        Duration::from_nanos(nanoseconds as u64)
    }

    /// Checks the meaning of the document. If `control` asks to stop, the document is refused, right or wrong.
    ///
    /// # Errors
    /// Every error, at least one.
    pub fn check(self, control: &Control) -> Result<Specification, Vec<SpecificationError>> {
        self.check_within(usize::MAX, control)
    }

    /// Checks the meaning of the document, for a solve that may take `most` bytes of memory, as far as the check
    /// estimates memory. Items that the estimate counts one by one, such as pairs of bodies, are counted until the
    /// estimate is far beyond `most`; the estimate is a lower bound then.
    ///
    /// # Errors
    /// Every error, at least one.
    pub fn check_within(self, most: usize, control: &Control) -> Result<Specification, Vec<SpecificationError>> {
        let Reading { document, repairs, mut errors, vectors, prepared, digest } = self.0;
        match Specification::check(document, (&repairs, &vectors, &prepared), most, control, &mut errors) {
            Some(specification) if errors.is_empty() => Ok(specification.with_digest(digest)),
            _ => Err(vectors.at_origins(errors.into_list())),
        }
    }
}

/// Number of output times that a rule such as `count` or `every` generates; 0 if there are too many, since those are
/// refused.
fn declared_times(document: &Document) -> usize {
    let times = match &document.output.times {
        Times::Steps | Times::List(_) => 0.0,
        Times::Count(count) => *count as f64,
        // Without a time horizon, as for a periodic orbit, the number of times is unknown and counted as 0.
        Times::Every(dt) => document.time.map_or(0.0, |time| (time.end - time.start) / dt),
    };
    if times <= MOST_TIMES as f64 { times.max(0.0) as usize } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_time(document: &str, at_least: Duration, at_most: Duration) {
        let time = Draft::read(document.as_bytes()).unwrap().check_time();
        assert!((at_least..=at_most).contains(&time), "{time:?} for {document}");
    }

    #[test]
    fn a_few_words_may_declare_much() {
        let (moment, second) = (Duration::from_millis(1), Duration::from_secs(1));
        let obstacle = |elements: &str| {
            format!(
                r#"{{"problem": {{"obstacle": {{"domain": {{"x": [0, 1], "y": [0, 1], "z": [0, 1]}}, "elements": {elements},
                    "diffusion": 1, "initial": 0}}}}, "time": {{"end": 1}}}}"#
            )
        };
        assert_time(&obstacle("5"), Duration::ZERO, moment);
        assert_time(&obstacle("100"), second, Duration::MAX);
        assert_time(&obstacle("18446744073709551615"), second, Duration::MAX);
        assert_time(&obstacle(r#"{"x": 18446744073709551615, "y": 2, "z": 2}"#), second, Duration::MAX);
        let decay = |times: &str| {
            format!(
                r#"{{"problem": {{"dvi": {{"states": {{"x": {{"initial": 1, "rate": "-x"}}}}}}}}, "time": {{"end": 1}},
                    "output": {{"times": {times}}}}}"#
            )
        };
        assert_time(&decay(r#"{"count": 1001}"#), Duration::ZERO, moment);
        assert_time(&decay(r#"{"count": 2000000}"#), moment, second);
        assert_time(&decay(r#"{"every": 1e-6}"#), moment, second);
        assert_time(&decay(r#"{"every": -1}"#), Duration::ZERO, moment);
        // Too many output times are refused immediately, so they take no time to check.
        assert_time(&decay(r#"{"count": 18446744073709551615}"#), Duration::ZERO, moment);
    }

    #[test]
    fn a_check_that_is_stopped_refuses_what_is_correct() {
        let text = br#"{"problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}, "time": {"end": 1}}"#;
        let check = |control: &Control| Draft::read(text).unwrap().check(control);
        let control = Control::new();
        assert!(check(&control).is_ok());
        control.cancel();
        assert_eq!(check(&control).unwrap_err()[0].code, "interrupted");
    }
}
