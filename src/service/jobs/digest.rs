//! Digests of what is stored (SHA-256, FIPS 180-4): bytes that a disk has changed are told from those that were written.
//!
//! The row of a job carries a digest over its own bytes and its name, so that no row passes for another's; in it are those of
//! its specification and of its results.

use super::JobId;
use super::idempotency::hexadecimal;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use sha2::{Digest as _, Sha256};
use std::fmt;
use std::io;

/// The bytes of a digest.
const LENGTH: usize = 32;

/// What bytes are known by.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Digest([u8; LENGTH]);

impl Digest {
    /// That of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        Self(Sha256::digest(bytes).into())
    }

    /// Gives `bytes` if they are those that it was made of.
    ///
    /// # Errors
    /// They are others.
    pub fn vouch<T: AsRef<[u8]>>(self, bytes: T) -> io::Result<T> {
        if Self::of(bytes.as_ref()) == self {
            Ok(bytes)
        } else {
            Err(io::Error::new(io::ErrorKind::InvalidData, "the bytes are not those that were written"))
        }
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&hexadecimal(&self.0))
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let byte = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok();
        let bytes: Option<Vec<u8>> = text.as_bytes().chunks(2).map(byte).collect();
        let digest = bytes.and_then(|bytes| bytes.try_into().ok());
        digest.map(Self).ok_or_else(|| serde::de::Error::custom("not a digest of 64 hexadecimal digits"))
    }
}

/// The bytes of a row of `id` as they are stored: their digest, and then they themselves.
pub fn seal(id: JobId, row: &[u8]) -> Vec<u8> {
    let mut sealed = Vec::with_capacity(LENGTH + row.len());
    sealed.extend_from_slice(&digest_of_row(id, row));
    sealed.extend_from_slice(row);
    sealed
}

/// The bytes of a row of `id`; nothing if they, the digest or the name are not what was written.
pub fn unseal(id: JobId, sealed: &[u8]) -> Option<&[u8]> {
    let (digest, row) = sealed.split_first_chunk::<LENGTH>()?;
    (*digest == digest_of_row(id, row)).then_some(row)
}

fn digest_of_row(id: JobId, row: &[u8]) -> [u8; LENGTH] {
    Sha256::new().chain_update(id.number().to_be_bytes()).chain_update(row).finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flipped_bit_and_a_row_of_another_are_told() {
        let id = JobId::of_number(7);
        let sealed = seal(id, b"a row");
        assert_eq!(unseal(id, &sealed), Some(&b"a row"[..]));
        assert_eq!(unseal(JobId::of_number(8), &sealed), None);
        for bit in 0..8 * sealed.len() {
            let mut flipped = sealed.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(unseal(id, &flipped), None, "bit {bit}");
        }
        assert_eq!(unseal(id, b"short"), None);
    }

    #[test]
    fn a_digest_is_written_as_its_digits_and_read_back() {
        // FIPS 180-4, the digest of "abc".
        let text = "\"ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad\"";
        let digest = Digest::of(b"abc");
        assert_eq!(serde_json::to_string(&digest).unwrap(), text);
        assert_eq!(serde_json::from_str::<Digest>(text).unwrap(), digest);
        for bad in ["\"\"", "\"ba78\"", "\"zz\"", &text.replace("ba7", "ba7é"), &text.replace("ad\"", "ad00\"")] {
            assert!(serde_json::from_str::<Digest>(bad).is_err(), "{bad}");
        }
        assert!(digest.vouch(b"abc").is_ok() && digest.vouch(b"abd").is_err());
    }
}
