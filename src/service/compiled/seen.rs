//! Hashes of recently seen texts of specifications: a text that is posted once, like each one of a parameter sweep, is
//! not worth an entry in the cache of compiled specifications.

use std::hash::{BuildHasher, RandomState};

/// The number of stored hashes; a new hash replaces the one at its index, the hash modulo `PLACES`.
const PLACES: usize = 1 << 10;

/// A table of the hashes of recently seen texts of specifications.
#[derive(Debug)]
pub struct Seen {
    state: RandomState,
    hashes: Box<[u64]>,
}

impl Default for Seen {
    fn default() -> Self {
        Self { state: RandomState::new(), hashes: vec![0; PLACES].into() }
    }
}

impl Seen {
    /// Records the hash of `text`, and returns whether it was in the table already.
    pub fn again(&mut self, text: &[u8]) -> bool {
        let hash = self.state.hash_one(text);
        let place = &mut self.hashes[hash as usize % PLACES];
        std::mem::replace(place, hash) == hash
    }
}
