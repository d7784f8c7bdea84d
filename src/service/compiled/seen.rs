//! Which texts came lately, by their hashes: one that comes once, as each of a sweep does, is not worth the room, nor the memory
//! that goes cold for it.

use std::hash::{BuildHasher, RandomState};

/// As many hashes as are remembered; one takes the place of another with the same lowest bits.
const PLACES: usize = 1 << 10;

/// The hashes.
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
    /// Whether `text` came before, as far as that is remembered.
    pub fn again(&mut self, text: &[u8]) -> bool {
        let hash = self.state.hash_one(text);
        let place = &mut self.hashes[hash as usize % PLACES];
        std::mem::replace(place, hash) == hash
    }
}
