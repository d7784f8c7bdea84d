//! Recently seen texts, as hashes: a text that comes once, like each of a parameter sweep, is not worth a place in the
//! cache.

use std::hash::{BuildHasher, RandomState};

/// The number of hashes; a new hash replaces the one with the same lowest bits.
const PLACES: usize = 1 << 10;

/// A table of hashes.
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
    /// Records `text`, and returns whether it was seen recently.
    pub fn again(&mut self, text: &[u8]) -> bool {
        let hash = self.state.hash_one(text);
        let place = &mut self.hashes[hash as usize % PLACES];
        std::mem::replace(place, hash) == hash
    }
}
