//! Idempotent requests: a client that does not know whether its job was admitted posts it again under the same
//! `Idempotency-Key` and gets the first job. A key belongs to one client and lives as long as its job.

use crate::digest::Digest;
use serde::{Deserialize, Serialize};

/// An idempotency key with the digest of the specification first posted under it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Key {
    /// The text of the idempotency key, chosen by the client.
    pub name: String,
    digest: String,
}

impl Key {
    /// Creates the idempotency key `name` for the specification `document`.
    pub fn new(name: impl Into<String>, document: &[u8]) -> Self {
        Self { name: name.into(), digest: Digest::of(document).to_string() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_knows_its_document() {
        let key = Key::new("k", b"abc");
        assert_eq!(key, Key::new("k", b"abc"));
        assert_ne!(key, Key::new("k", b"abd"));
        // The SHA-256 digest of "abc" in FIPS 180-4.
        assert_eq!(key.digest, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
