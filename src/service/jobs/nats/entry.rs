//! The entry of a job in the NATS bucket of states: a JSON object, changed only by compare-and-set.

use crate::jobs::{Client, Record, Results};
use jiff::Timestamp;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::fmt::Write as _;
use std::net::IpAddr;

/// The version of entries and of the data that they refer to. A worker of another version leaves the job to others.
pub const FORMAT: u32 = 3;

/// The largest size of a specification and of results that are stored in the entry of their job, in bytes of JSON.
pub const SHORT: usize = 16 << 10;

/// The entry of a job in the NATS bucket of states.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Entry {
    /// The format version of the entry, [`FORMAT`].
    pub format: u32,
    /// The record of the job. A job that has neither an end nor a claim is waiting.
    pub record: Record,
    /// The claim of the worker that is solving the job.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub claim: Option<Claim>,
    /// Whether the job is a sweep that is divided into chunks with entries of their own.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub divided: bool,
    /// The posted specification of the job, if it is short.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub document: Option<String>,
    /// The results of a job that has ended, if they are short.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub results: Option<Box<RawValue>>,
}

/// The claim of a worker to a job or chunk.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Claim {
    /// The name of the worker that has claimed the job or chunk.
    pub worker: String,
    /// The time at which the worker claimed the job or chunk.
    pub started: Timestamp,
    /// Whether the job runs alone on the worker, as a job does that has lost a worker: the loss of this worker is
    /// then evidence against the job.
    pub alone: bool,
}

/// Returns the results of a job in the form in which its entry contains them, byte for byte; `None` if they are longer
/// than [`SHORT`].
pub fn short(results: &Results) -> Option<Box<RawValue>> {
    let json = results.text().filter(|json| json.len() <= SHORT)?;
    let short = RawValue::from_string(String::from_utf8(json.to_vec()).ok()?).ok()?;
    // Results with white space around the JSON are not stored in the entry, since the white space would be lost when
    // the entry is parsed.
    (short.get().trim().len() == json.len()).then_some(short)
}

/// The version of an entry in the NATS bucket of states, which is read before the rest of the entry.
#[derive(Deserialize)]
struct Version {
    format: u32,
}

/// An object with a `format` in the bucket of states, changed only by compare-and-set.
pub trait Versioned: Serialize + DeserializeOwned {
    /// Parses an object of the bucket of states; `None` if another version of the program wrote the object.
    fn read(text: &[u8]) -> Option<Self> {
        let Version { format } = serde_json::from_slice(text).ok()?;
        if format == FORMAT { serde_json::from_slice(text).ok() } else { None }
    }

    /// Encodes an object as JSON, to be stored in the bucket of states.
    fn text(&self) -> Vec<u8> {
        // The object consists of strings and finite numbers, so that encoding cannot fail.
        serde_json::to_vec(self).unwrap_or_default()
    }
}

impl Versioned for Entry {}

impl Entry {
    /// Creates the entry of a waiting job for the NATS bucket of states.
    pub fn waiting(record: Record) -> Self {
        Self { format: FORMAT, record, claim: None, divided: false, document: None, results: None }
    }

    /// Adds the posted specification to the entry of its job, if the specification is short.
    pub fn with_document(self, document: &[u8]) -> Self {
        let short = str::from_utf8(document).ok().filter(|document| document.len() <= SHORT);
        Self { document: short.map(str::to_owned), ..self }
    }
}

impl Client {
    /// Returns the client as one token of a NATS subject.
    pub(super) fn token(self) -> String {
        let (kind, bytes) = match self {
            Self::Token(number) => ('t', number.to_be_bytes().to_vec()),
            Self::Address(IpAddr::V4(address)) => ('a', address.octets().to_vec()),
            Self::Address(IpAddr::V6(address)) => ('a', address.octets().to_vec()),
        };
        bytes.into_iter().fold(kind.to_string(), |mut text, byte| {
            // Writing digits to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
            text
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digest::Fingerprint;
    use crate::jobs::Held;

    #[test]
    fn an_entry_of_another_version_is_not_read() {
        let entry = Entry::waiting(Record::example(Held::Table(Fingerprint::of(b"{}"))));
        assert!(Entry::read(&entry.text()).is_some());
        let later = Entry { format: FORMAT + 1, ..entry };
        assert!(Entry::read(&later.text()).is_none());
        assert!(Entry::read(b"{}").is_none());
    }

    #[test]
    fn clients_are_single_tokens_of_subjects_and_distinct() {
        let at = |text: &str| Client::at(text.parse().unwrap()).token();
        assert_eq!(at("10.0.0.1"), "a0a000001");
        let all = [at("10.0.0.1"), at("::1"), at("10.0.0.2"), Client::Token(0x0a00_0001).token()];
        for (k, one) in all.iter().enumerate() {
            assert!(one.chars().all(|c| c.is_ascii_alphanumeric()) && !all[..k].contains(one), "{one}");
        }
    }
}
