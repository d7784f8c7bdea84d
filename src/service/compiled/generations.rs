//! A bounded map that forgets entries not used lately, in two generations: the older one is dropped when the younger
//! one is full (the clock of two hands with one bit; Corbato 1968, "A paging experiment with the Multics system").

use std::collections::HashMap;
use std::mem;

/// Values by text.
#[derive(Debug)]
pub struct Generations<T> {
    young: HashMap<Box<[u8]>, T>,
    old: HashMap<Box<[u8]>, T>,
    /// The largest number of values in one generation.
    most: usize,
}

impl<T: Clone> Generations<T> {
    /// Room for `kept` values, and for two at least.
    pub fn new(kept: usize) -> Self {
        Self { young: HashMap::new(), old: HashMap::new(), most: (kept / 2).max(1) }
    }

    /// The value of `text`, which moves to the younger generation.
    pub fn find(&mut self, text: &[u8]) -> Option<T> {
        if let Some(value) = self.young.get(text) {
            return Some(value.clone());
        }
        let (text, value) = self.old.remove_entry(text)?;
        self.insert(text, value.clone());
        Some(value)
    }

    /// Adds the value of `text`.
    pub fn insert(&mut self, text: Box<[u8]>, value: T) {
        if self.young.len() >= self.most {
            self.old = mem::take(&mut self.young);
        }
        self.young.insert(text, value);
    }
}
