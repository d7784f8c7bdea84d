//! Lists of known failures that may only shrink: an unlisted failure fails the test, and so does an entry that does
//! not fail, so that a repaired case stays repaired.

use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Known failures: the name of each case, and how it fails, as a keyword.
pub type Known<'a> = &'a [(&'a str, &'a str)];

/// A test case that has failed.
#[derive(Clone, Debug)]
pub struct Failure {
    /// The name of the case, as in a list of known failures.
    pub name: String,
    /// How the test case fails, as a keyword.
    pub how: &'static str,
    /// The measured values that show the failure, as text.
    pub detail: String,
}

/// Compares the failures with the known ones; `list` names the list and its source file.
///
/// # Panics
/// If a failure is not listed or fails in another way than listed, or if an entry does not fail.
pub fn assert_known(list: &str, known: Known, failures: &[Failure]) {
    let listed: BTreeMap<&str, &str> = known.iter().copied().collect();
    assert_eq!(listed.len(), known.len(), "{list} names something twice");
    let mut faults = String::new();
    for Failure { name, how, detail } in failures {
        let fault = match listed.get(name.as_str()) {
            Some(word) if word == how => continue,
            Some(word) => format!("is listed as `{word}` and is `{how}`: {detail}"),
            None => format!("is `{how}`: {detail}"),
        };
        writeln!(faults, "  {name} {fault}").expect("text has room");
    }
    for (name, _) in known.iter().filter(|(name, _)| failures.iter().all(|failure| failure.name != *name)) {
        writeln!(faults, "  {name} fails no longer: strike it from the list").expect("text has room");
    }
    assert!(faults.is_empty(), "{list} is not what was found:\n{faults}");
}

#[test]
fn a_list_holds_what_fails_and_nothing_else() {
    let failure = |how| Failure { name: "a".to_owned(), how, detail: String::new() };
    let holds = |known: Known, failures: &[Failure]| {
        std::panic::catch_unwind(|| assert_known("a list", known, failures)).is_ok()
    };
    assert!(holds(&[], &[]) && holds(&[("a", "wrong")], &[failure("wrong")]));
    assert!(!holds(&[], &[failure("wrong")]), "a failure that is not listed");
    assert!(!holds(&[("a", "failed")], &[failure("wrong")]), "a failure of another kind");
    assert!(!holds(&[("a", "wrong")], &[]), "an entry that does not fail");
}
