//! The message of a job in the NATS queue. The message of a job that has just been admitted contains the job's entry
//! and its revision, so that a worker reads nothing before it claims the job. An entry that has changed meanwhile has
//! another revision, so that the claim fails, and the worker reads the current entry.

use super::entry::{Entry, FORMAT, Versioned as _};

/// The content of the message of a job in the NATS queue.
#[derive(Debug)]
pub struct Errand {
    /// The entry of the job when the message was written.
    pub entry: Entry,
    /// The revision of the job's entry when the message was written.
    pub revision: u64,
}

impl Errand {
    /// Encodes the message of a job whose entry has just been written.
    pub fn text(entry: &Entry, revision: u64) -> Vec<u8> {
        [revision.to_string().as_bytes(), b"\n", &entry.text()].concat()
    }

    /// Parses the message of a job; `None` if it contains no entry, or one that another version wrote.
    pub fn read(text: &[u8]) -> Option<Self> {
        let end = text.iter().position(|byte| *byte == b'\n')?;
        let revision = str::from_utf8(&text[..end]).ok()?.parse().ok()?;
        Some(Self { entry: Entry::read(&text[end + 1..])?, revision })
    }
}

/// Returns the message of a job without its entry, which is then to be read from the bucket of states.
pub fn bare() -> Vec<u8> {
    FORMAT.to_string().into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digest::Fingerprint;
    use crate::jobs::nats::entry::SHORT;
    use crate::jobs::{Held, Record};

    #[test]
    fn the_message_of_a_short_job_says_all_that_a_worker_needs() {
        let record =
            Record { label: Some("two\nlines".to_owned()), ..Record::example(Held::Table(Fingerprint::of(b""))) };
        let document = "{\n \"label\": \"\u{e4}\"}\n";
        let entry = Entry::waiting(record).with_document(document.as_bytes());
        let read = Errand::read(&Errand::text(&entry, 17)).unwrap();
        assert_eq!((read.revision, read.entry.document.as_deref()), (17, Some(document)));
        assert_eq!(read.entry.text(), entry.text());
        let later = Entry { format: FORMAT + 1, ..entry.clone() };
        for text in [bare(), Errand::text(&later, 17)] {
            assert!(Errand::read(&text).is_none());
        }
        for long in [&[b' '; SHORT + 1][..], b"\xff"] {
            assert!(entry.clone().with_document(long).document.is_none());
        }
    }
}
