//! A page for every code: errors in a specification, warnings and verdicts, failures, and refusals of a service.
//!
//! The texts are in `pages`, one readable file per kind: a heading with the code, its meaning, the cause, the remedy,
//! an example.

use std::sync::LazyLock;

/// The kind of message that a code belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A code of an error in a specification.
    Specification,
    /// A code of a warning, of a caveat, or of a reason of a verdict.
    Answer,
    /// A code of a failure or a stop of a solve.
    Failure,
    /// A code of a refused request of a service, or of a job without a result.
    Service,
}

/// The explanation of one code of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Page {
    /// The code of the message, as programs read it.
    pub code: &'static str,
    /// The kind of message that the code belongs to: an error, a warning, a failure or a refused request.
    pub kind: Kind,
    /// The meaning of the message, in one sentence.
    pub meaning: &'static str,
    /// The cause of the message.
    pub why: &'static str,
    /// What the user can do about the cause of the message.
    pub remedy: &'static str,
    /// An example that produces the message.
    pub example: &'static str,
}

const TEXTS: [(Kind, &str); 4] = [
    (Kind::Specification, include_str!("pages/specification.md")),
    (Kind::Answer, include_str!("pages/answer.md")),
    (Kind::Failure, include_str!("pages/failure.md")),
    (Kind::Service, include_str!("pages/service.md")),
];

impl Kind {
    /// All kinds of messages, in the order in which explanations are listed.
    pub const ALL: [Self; 4] = [Self::Specification, Self::Answer, Self::Failure, Self::Service];

    /// Returns the title of the kind of message, for a heading.
    pub fn title(self) -> &'static str {
        let text = TEXTS.iter().find(|(kind, _)| *kind == self).map_or("", |(_, text)| text);
        text.strip_prefix("# ").and_then(|text| text.lines().next()).unwrap_or_default()
    }
}

/// Returns the explanations of all codes, grouped by kind of message.
pub fn pages() -> &'static [Page] {
    static PAGES: LazyLock<Vec<Page>> = LazyLock::new(|| {
        let sections =
            TEXTS.iter().flat_map(|(kind, text)| text.split("\n## ").skip(1).map(|section| (*kind, section)));
        sections.map(|(kind, section)| page(kind, section)).collect()
    });
    &PAGES
}

/// Returns the explanation of a code; `-` is accepted in place of `_`, as in the addresses of web pages.
pub fn find(code: &str) -> Option<&'static Page> {
    let code = code.replace('-', "_");
    pages().iter().find(|page| page.code == code)
}

fn page(kind: Kind, section: &'static str) -> Page {
    let (code, rest) = section.split_once('\n').unwrap_or((section, ""));
    let item = |name: &str| rest.split("\n- ").find_map(|item| item.strip_prefix(name)).unwrap_or_default().trim();
    let meaning = rest.split("\n- ").next().unwrap_or_default().trim();
    Page { code, kind, meaning, why: item("why:"), remedy: item("do:"), example: item("example:") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_page_is_complete_and_there_is_one_for_a_code() {
        for page in pages() {
            let Page { code, meaning, why, remedy, example, .. } = page;
            assert!(code.bytes().all(|c| c.is_ascii_lowercase() || c == b'_'), "{code}");
            for text in [meaning, why, remedy, example] {
                assert!(text.len() > 4 && !text.contains("\n\n"), "{code}: {text:?}");
                assert!(text.ends_with(['.', '`']), "{code}: {text:?}");
            }
            assert_eq!(pages().iter().filter(|other| other.code == *code).count(), 1, "{code}");
        }
        assert!(Kind::ALL.iter().all(|kind| !kind.title().is_empty()));
    }

    #[test]
    fn a_page_is_found_by_its_code_and_by_its_address() {
        assert_eq!(find("unknown_key"), find("unknown-key"));
        assert_eq!(find("unknown_key").map(|page| page.kind), Some(Kind::Specification));
        assert_eq!(find("unknown"), None);
    }
}
