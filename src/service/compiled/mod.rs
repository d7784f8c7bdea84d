//! A cache of compiled specifications: a text that is posted again word for word is not parsed again, and a text that
//! differs only in the numbers of its `parameters` reuses the compiled programs with other inputs. In both cases, the
//! results are those of a fresh compilation.

mod generations;
mod known;
mod seen;
mod structure;

pub use generations::Generations;
pub use known::{Known, Repeated, SMALL};

use crate::worker::Limits;
use problem::Control;
use seen::Seen;
use specification::{Draft, Specification, SpecificationError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use structure::Structure;

/// The largest number of specifications that are cached by text, and of those cached by structure (the text without the
/// values of parameters): enough for a page of examples, or for some concurrent parameter sweeps.
const KEPT: usize = 256;

/// The size in bytes up to which a specification is parsed on the thread that serves its connection or has taken its
/// job, which takes less time than to send it to a worker process. The specification is also checked on that thread
/// if the estimated time of the check is at most `SOON`.
const SHORT: usize = 4 << 10;
const SOON: Duration = Duration::from_millis(2);

/// The largest estimated memory of a problem whose compiled form is cached, in bytes. A larger problem takes longer
/// to solve than to compile.
const LARGEST: usize = 256 << 10;

/// Cached small specifications, found by their text or by their structure (the text without the values of parameters).
#[derive(Debug)]
pub struct Compiled {
    texts: Mutex<Generations<Arc<Known>>>,
    structures: Mutex<Generations<Arc<Known>>>,
    /// Hashes of the texts for which the cached programs of a specification of equal structure were recently used,
    /// with other values of its parameters.
    bound: Mutex<Seen>,
}

impl Default for Compiled {
    fn default() -> Self {
        Self {
            texts: Mutex::new(Generations::new(KEPT)),
            structures: Mutex::new(Generations::new(KEPT)),
            bound: Mutex::default(),
        }
    }
}

impl Compiled {
    /// Returns the compiled specification of a short text that takes little time to compile, to be solved within
    /// `limits`; `None` if the text is longer, or its check may take longer.
    ///
    /// # Errors
    /// All errors of the specification.
    pub fn read(&self, text: &[u8], limits: &Limits) -> Result<Option<Arc<Known>>, Vec<SpecificationError>> {
        if text.len() > SHORT {
            return Ok(None);
        }
        if let Some(known) = self.find(text) {
            return Ok(Some(known));
        }
        let draft = Draft::read(text)?;
        if draft.check_time() > SOON {
            return Ok(None);
        }
        let known = Arc::new(Known::of(limits.check(draft, &Control::new())?));
        self.keep(text, &known);
        Ok(Some(known))
    }

    /// Returns the compiled specification of `text`, if a text that differs at most in the values of parameters was
    /// compiled before.
    fn find(&self, text: &[u8]) -> Option<Arc<Known>> {
        if let Some(known) = lock(&self.texts).find(text) {
            return Some(known);
        }
        let structure = Structure::of(text)?;
        let like = lock(&self.structures).find(&structure.text)?;
        let given: Vec<(&str, f64)> = structure.parameters().collect();
        // A text with invalid values of its parameters is compiled afresh, which reports the error.
        let bound = Arc::new(Known::of(like.specification.with_parameters(&given).ok()?.of_text(text)));
        if lock(&self.bound).again(text) {
            lock(&self.texts).insert(text.into(), Arc::clone(&bound));
        }
        Some(bound)
    }

    /// Caches the compiled specification of `text`, unless the problem is large.
    fn keep(&self, text: &[u8], known: &Arc<Known>) {
        if known.facts.memory > LARGEST {
            return;
        }
        lock(&self.texts).insert(text.into(), Arc::clone(known));
        if let Some(structure) = Structure::of(text).filter(|structure| is_of(structure, &known.specification)) {
            lock(&self.structures).insert(structure.text.into(), Arc::clone(known));
        }
    }
}

/// Whether the numbers found in the text are all the parameters of the specification, with their values, and nothing
/// but the compiled problem depends on them.
fn is_of(structure: &Structure<'_>, specification: &Specification) -> bool {
    let Some(parameters) = specification.model().parameters() else { return false };
    // A specification with advice to formulate its problem differently is excluded, since the advice quotes values of
    // the parameters.
    let advised = specification.model().dvi().is_some_and(|model| model.kinks.as_set.is_some());
    let known = || parameters.names().iter().map(String::as_str).zip(parameters.values().iter().copied());
    let same = structure.parameters().count() == known().count()
        && structure.parameters().all(|given| known().any(|known| known == given));
    same && !advised && specification.study().is_none() && specification.sweep().is_none()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Arc<Known> {
        let read = Specification::from_json(text.as_bytes()).unwrap_or_else(|errors| panic!("{errors:#?}"));
        Arc::new(Known::of(read))
    }

    /// A friction problem with parameters in rates, bounds and initial values.
    fn belt(m: &str, f: &str) -> String {
        format!(
            r#"{{"problem": {{"dvi": {{"parameters": {{"m": {m}, "f": {f}, "k": "2*m"}},
                "states": {{"x": {{"initial": "m", "rate": "v"}}, "v": {{"initial": 0, "rate": "(-k*x - F)/m"}}}},
                "variables": {{"F": {{"inequality": "-(v - 0.5)"}}}},
                "set": [{{"box": {{"of": ["F"], "lower": "-f", "upper": "f"}}}}]}}}}, "time": {{"end": 3}}}}"#
        )
    }

    #[test]
    fn what_is_found_is_what_reading_gives() {
        let compiled = Compiled::default();
        let first = belt("1", "1");
        assert!(compiled.find(first.as_bytes()).is_none());
        let specification = read(&first);
        compiled.keep(first.as_bytes(), &specification);
        assert!(Arc::ptr_eq(&compiled.find(first.as_bytes()).unwrap(), &specification));
        for (m, f) in [("1.5", "1"), ("1", "0.25"), ("2e0", "3"), ("0.1", "0.1"), ("12345678901234567890123", "0.5")] {
            let other = belt(m, f);
            let (found, anew) = (compiled.find(other.as_bytes()).unwrap(), read(&other));
            let (found, anew) = (&found.specification, &anew.specification);
            assert_eq!(serde_json::to_value(found.summary()).unwrap(), serde_json::to_value(anew.summary()).unwrap());
            assert_eq!(found.model().initial(), anew.model().initial(), "{m} {f}");
            // The third search for a text finds it by its whole text, with the value that the second search has
            // stored.
            let again = [0, 1].map(|_| compiled.find(other.as_bytes()).unwrap());
            assert!(Arc::ptr_eq(&again[0], &again[1]), "{m} {f}");
        }
        // A specification with an error is never found in the cache of compiled specifications.
        for (m, f) in [("0", "1"), ("1", "-1"), ("1e999", "1"), ("01", "1"), ("1.", "1"), ("\"1\"", "1")] {
            assert!(compiled.find(belt(m, f).as_bytes()).is_none(), "{m} {f}");
        }
    }

    #[test]
    fn what_only_looks_like_parameters_is_no_structure() {
        let compiled = Compiled::default();
        let texts = [
            r#"{"label": "\"parameters\": {\"a\": 1}", "problem": {"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}, "time": {"end": 1}}"#,
            r#"{"problem": {"dvi": {"states": {"parameters": {"initial": 1, "rate": "-parameters"}}}}, "time": {"end": 1}}"#,
        ];
        for text in texts {
            compiled.keep(text.as_bytes(), &read(text));
            assert!(compiled.find(text.replace('1', "2").as_bytes()).is_none(), "{text}");
        }
    }

    #[test]
    fn no_more_is_kept_than_there_is_room_for() {
        let compiled = Compiled::default();
        let specification = read(&belt("1", "1"));
        for k in 0..10 * KEPT {
            compiled.keep(format!("{k}").as_bytes(), &specification);
        }
        assert!(Arc::strong_count(&specification) <= KEPT + 1);
        assert!(compiled.find(format!("{}", 10 * KEPT - 1).as_bytes()).is_some());
    }
}
