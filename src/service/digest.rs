//! SHA-256 digests (FIPS 180-4) of stored data, which detect corruption.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use sha2::{Digest as _, Sha256};
use specification::hexadecimal;
use std::fmt;
use std::io;

/// The size of a SHA-256 digest, in bytes.
pub const LENGTH: usize = 32;

/// A SHA-256 digest, stored as text of 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Digest([u8; LENGTH]);

impl Digest {
    /// Returns the SHA-256 digest of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        Self(Sha256::digest(bytes).into())
    }

    /// Returns the SHA-256 digest of the concatenation of `parts`.
    pub fn of_all(parts: &[&[u8]]) -> Self {
        let mut hash = Sha256::new();
        parts.iter().for_each(|part| hash.update(part));
        Self(hash.finalize().into())
    }

    /// The bytes of the SHA-256 digest.
    pub fn bytes(&self) -> &[u8; LENGTH] {
        &self.0
    }

    /// Returns `bytes` if this is their SHA-256 digest.
    ///
    /// # Errors
    /// The digest of `bytes` differs.
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

/// The length and the SHA-256 digest of a byte string.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// The length of the byte string.
    pub bytes: usize,
    /// The SHA-256 digest of the byte string.
    pub digest: Digest,
}

impl Fingerprint {
    /// Returns the length and the SHA-256 digest of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len(), digest: Digest::of(bytes) }
    }
}

/// A writer that computes the length and the digest of the bytes written, and refuses more bytes than a limit.
pub struct Measure {
    limit: usize,
    bytes: usize,
    hash: Sha256,
}

impl Measure {
    /// Returns a writer without input, which accepts at most `limit` bytes.
    pub fn new(limit: usize) -> Self {
        Self { limit, bytes: 0, hash: Sha256::new() }
    }

    /// Returns the length and the digest of the bytes written so far.
    pub fn fingerprint(self) -> Fingerprint {
        Fingerprint { bytes: self.bytes, digest: Digest(self.hash.finalize().into()) }
    }
}

impl io::Write for Measure {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.len() > self.limit - self.bytes {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        self.bytes += bytes.len();
        self.hash.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_is_written_as_its_digits_and_read_back() {
        // The SHA-256 digest of "abc" in FIPS 180-4.
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
