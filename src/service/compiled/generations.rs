//! A bounded map that drops entries not used recently, in two generations: when the younger generation is full, it
//! replaces the older one (an approximation of LRU; cf. the clock algorithm of Corbato 1968, "A paging experiment
//! with the Multics system").

use std::collections::HashMap;
use std::mem;

/// A cache that maps byte strings, such as the texts of specifications, to values, with a bounded number of entries.
#[derive(Debug)]
pub struct Generations<T> {
    young: HashMap<Box<[u8]>, T>,
    old: HashMap<Box<[u8]>, T>,
    /// The largest number of values in each of the two generations of the cache.
    most: usize,
}

impl<T: Clone> Generations<T> {
    /// Creates a cache that keeps about `kept` values in its two generations together, and at least two.
    pub fn new(kept: usize) -> Self {
        Self { young: HashMap::new(), old: HashMap::new(), most: (kept / 2).max(1) }
    }

    /// Returns the cached value of `text`, and moves its entry to the younger generation of the cache.
    pub fn find(&mut self, text: &[u8]) -> Option<T> {
        if let Some(value) = self.young.get(text) {
            return Some(value.clone());
        }
        let (text, value) = self.old.remove_entry(text)?;
        self.insert(text, value.clone());
        Some(value)
    }

    /// Adds the entry of `text` to the younger generation of the cache; if it is full, it becomes the older generation.
    pub fn insert(&mut self, text: Box<[u8]>, value: T) {
        if self.young.len() >= self.most {
            self.old = mem::take(&mut self.young);
        }
        self.young.insert(text, value);
    }
}
