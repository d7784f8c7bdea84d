//! Specifications that were compiled before: what comes again word for word is not read again, and what differs from it in
//! numbers of `parameters` alone has them bound, since they are inputs of its programs. Both give what reading anew would.

mod generations;
mod known;
mod seen;
mod structure;

pub use known::{Known, Repeated};

use generations::Generations;
use seen::Seen;
use specification::Specification;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use structure::Structure;

/// Specifications that are kept, of texts and of structures each: those of a page of examples, or of some sweeps at once.
const KEPT: usize = 256;

/// The bytes of a problem that is kept, by its estimate. A larger one takes longer to solve than to compile.
const LARGEST: usize = 256 << 10;

/// Small specifications, by their texts and by their structures.
#[derive(Debug)]
pub struct Compiled {
    texts: Mutex<Generations<Arc<Known>>>,
    structures: Mutex<Generations<Arc<Known>>>,
    /// Texts that were bound.
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
    /// What reading `text` would give, if it or its structure was read before.
    pub fn find(&self, text: &[u8]) -> Option<Arc<Known>> {
        if let Some(known) = lock(&self.texts).find(text) {
            return Some(known);
        }
        let structure = Structure::of(text)?;
        let like = lock(&self.structures).find(&structure.text)?;
        let given: Vec<(&str, f64)> = structure.parameters().collect();
        // What cannot be bound is read, which says why.
        let bound = Arc::new(Known::of(like.specification.with_parameters(&given).ok()?.of_text(text)));
        if lock(&self.bound).again(text) {
            lock(&self.texts).insert(text.into(), Arc::clone(&bound));
        }
        Some(bound)
    }

    /// Keeps what reading `text` has given.
    pub fn keep(&self, text: &[u8], known: &Arc<Known>) {
        if known.facts.memory > LARGEST {
            return;
        }
        lock(&self.texts).insert(text.into(), Arc::clone(known));
        if let Some(structure) = Structure::of(text).filter(|structure| is_of(structure, &known.specification)) {
            lock(&self.structures).insert(structure.text.into(), Arc::clone(known));
        }
    }
}

/// Whether all parameters of a specification with values of their own are those numbers, and nothing but the problem depends on
/// them.
fn is_of(structure: &Structure<'_>, specification: &Specification) -> bool {
    let Some(parameters) = specification.model().parameters() else { return false };
    // Advice on how to write the problem otherwise has its numbers in it.
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

    /// A problem whose law has parameters in rates, bounds and at the start.
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
            // What comes more than once is bound no more.
            let again = [0, 1].map(|_| compiled.find(other.as_bytes()).unwrap());
            assert!(Arc::ptr_eq(&again[0], &again[1]), "{m} {f}");
        }
        // Where reading finds an error, so does who reads it.
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
