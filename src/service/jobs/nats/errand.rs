//! The message of a job. That of a short job has all that a worker needs to begin, so that it reads nothing before it claims
//! the job: the entry, its revision and the specification. An entry that has changed since has another revision, so that the
//! claim fails, and the worker reads what there is.

use super::entry::{Entry, FORMAT, Versioned as _};
use std::io::Write as _;

/// The longest specification that stands in a message, in bytes.
const LONGEST: usize = 64 << 10;

/// What the message of a short job says.
#[derive(Debug)]
pub struct Errand {
    /// The entry of the job when the message was written.
    pub entry: Entry,
    /// Its revision.
    pub revision: u64,
    /// The specification.
    pub document: Vec<u8>,
}

impl Errand {
    /// The message of a job whose entry has just been written.
    pub fn text(entry: &Entry, revision: u64, document: &[u8]) -> Vec<u8> {
        if document.len() > LONGEST {
            return bare();
        }
        let mut text = Vec::new();
        // Writing to memory cannot fail. There is no line break in an entry.
        let _ = writeln!(text, "{revision}");
        text.extend_from_slice(&entry.text());
        text.push(b'\n');
        text.extend_from_slice(document);
        text
    }

    /// Reads a message; `None` if it says nothing, or nothing that this version knows.
    pub fn read(text: &[u8]) -> Option<Self> {
        let mut parts = text.splitn(3, |byte| *byte == b'\n');
        let (revision, entry, document) = (parts.next()?, parts.next()?, parts.next()?);
        let revision = str::from_utf8(revision).ok()?.parse().ok()?;
        Some(Self { entry: Entry::read(entry)?, revision, document: document.to_owned() })
    }
}

/// The message of what is to be read.
pub fn bare() -> Vec<u8> {
    FORMAT.to_string().into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digest::Fingerprint;
    use crate::jobs::{Held, Record};

    #[test]
    fn the_message_of_a_short_job_says_all_that_a_worker_needs() {
        let record =
            Record { label: Some("two\nlines".to_owned()), ..Record::example(Held::Table(Fingerprint::of(b""))) };
        let entry = Entry::waiting(record);
        let read = Errand::read(&Errand::text(&entry, 17, b"{\n}\n")).unwrap();
        assert_eq!((read.revision, &*read.document), (17, &b"{\n}\n"[..]));
        assert_eq!(read.entry.text(), entry.text());
        let later = Entry { format: FORMAT + 1, ..entry.clone() };
        for text in [bare(), Errand::text(&later, 17, b"{}"), Errand::text(&entry, 17, &[b' '; LONGEST + 1])] {
            assert!(Errand::read(&text).is_none());
        }
    }
}
