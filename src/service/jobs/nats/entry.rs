//! The entry of a job in the bucket of states: a JSON object, changed by compare-and-set alone.

use crate::jobs::{Client, Record, Results};
use jiff::Timestamp;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::fmt::Write as _;
use std::net::IpAddr;

/// The version of entries and of what they refer to. Who does not know it leaves the job to others.
pub const FORMAT: u32 = 3;

/// The largest size of a specification and of results that stand in the entry of their job, in bytes of JSON.
pub const SHORT: usize = 16 << 10;

/// The entry of a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Entry {
    /// [`FORMAT`].
    pub format: u32,
    /// The row of the job. A job that has neither ended nor a claim waits.
    pub record: Record,
    /// The worker that has the job.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub claim: Option<Claim>,
    /// The job is a sweep of which there are chunks.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub divided: bool,
    /// The specification, if it is short.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub document: Option<String>,
    /// The results of a job that has ended, if they are short.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub results: Option<Box<RawValue>>,
}

/// The claim of a worker to a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Claim {
    /// The name of the worker.
    pub worker: String,
    /// When it took the job.
    pub started: Timestamp,
    /// Whether the job runs alone on it, as one does that has lost a worker before: the loss of this one is then evidence
    /// against the job.
    pub alone: bool,
}

/// Results as they stand in an entry, with every byte as it is; `None` if they are longer than that.
pub fn short(results: &Results) -> Option<Box<RawValue>> {
    let json = results.text().filter(|json| json.len() <= SHORT)?;
    let short = RawValue::from_string(String::from_utf8(json.to_vec()).ok()?).ok()?;
    // White space around it would not be read again.
    (short.get().trim().len() == json.len()).then_some(short)
}

/// Only the version.
#[derive(Deserialize)]
struct Version {
    format: u32,
}

/// What has a `format` in the bucket of states, and is changed by compare-and-set.
pub trait Versioned: Serialize + DeserializeOwned {
    /// Reads it; `None` if another version wrote it.
    fn read(text: &[u8]) -> Option<Self> {
        let Version { format } = serde_json::from_slice(text).ok()?;
        if format == FORMAT { serde_json::from_slice(text).ok() } else { None }
    }

    /// The same as JSON.
    fn text(&self) -> Vec<u8> {
        // Strings and finite numbers can always be encoded.
        serde_json::to_vec(self).unwrap_or_default()
    }
}

impl Versioned for Entry {}

impl Entry {
    /// The entry of a waiting job.
    pub fn waiting(record: Record) -> Self {
        Self { format: FORMAT, record, claim: None, divided: false, document: None, results: None }
    }

    /// The entry with the specification, if that is short.
    pub fn with_document(self, document: &[u8]) -> Self {
        let short = str::from_utf8(document).ok().filter(|document| document.len() <= SHORT);
        Self { document: short.map(str::to_owned), ..self }
    }
}

impl Client {
    /// The client as one token of a subject.
    pub(super) fn token(self) -> String {
        let (kind, bytes) = match self {
            Self::Token(number) => ('t', number.to_be_bytes().to_vec()),
            Self::Address(IpAddr::V4(address)) => ('a', address.octets().to_vec()),
            Self::Address(IpAddr::V6(address)) => ('a', address.octets().to_vec()),
        };
        bytes.into_iter().fold(kind.to_string(), |mut text, byte| {
            // Writing to a string cannot fail.
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
