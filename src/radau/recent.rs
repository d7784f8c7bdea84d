//! The rows of the problem at the points evaluated last. The search for events returns to the ends of steps, to their
//! stages and to its own points, which are not evaluated again.

/// Number of stored points: enough for one search for events, and for the stages of a step twice over. Twice as many
/// would save one more evaluation in a hundred.
const MOST: usize = 16;

/// Points `(t, y)` with the rows of the problem at them; the oldest point is overwritten first.
#[derive(Debug)]
pub(super) struct Recent {
    /// Hash of each point, from the sum of its bits: different points seldom share a hash.
    keys: [u32; MOST],
    /// Time of each stored point; NaN where no point is stored yet.
    times: [f64; MOST],
    y: Vec<f64>,
    values: Vec<f64>,
    next: usize,
}

impl Recent {
    /// Allocates the store for points with `unknowns` unknowns and `rows` rows.
    pub(super) fn new(unknowns: usize, rows: usize) -> Self {
        let (y, values) = (vec![0.0; MOST * unknowns], vec![0.0; MOST * rows]);
        Self { keys: [0; MOST], times: [f64::NAN; MOST], y, values, next: 0 }
    }

    /// Returns the rows at the point `(t, y)`, if they are stored; `rows` is the number of rows.
    pub(super) fn find(&self, t: f64, y: &[f64], rows: usize) -> Option<&[f64]> {
        let key = key(t, y);
        // Compare the hashes of all stored points, without an exit at the first match, so that the loop is
        // vectorised.
        if !self.keys.iter().fold(false, |found, other| found | (*other == key)) {
            return None;
        }
        let is_same = |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits();
        let is_there = |&at: &usize| {
            self.keys[at] == key && self.times[at] == t && self.y[y.len() * at..].iter().zip(y).all(is_same)
        };
        let at = (0..MOST).find(is_there)?;
        Some(&self.values[rows * at..][..rows])
    }

    /// Stores the rows `values` of the problem at the point `(t, y)`, in place of the oldest point.
    pub(super) fn keep(&mut self, t: f64, y: &[f64], values: &[f64]) {
        let at = self.next;
        (self.keys[at], self.times[at]) = (key(t, y), t);
        self.y[y.len() * at..][..y.len()].copy_from_slice(y);
        self.values[values.len() * at..][..values.len()].copy_from_slice(values);
        self.next = (at + 1) % MOST;
    }
}

fn key(t: f64, y: &[f64]) -> u32 {
    let sum = y.iter().fold(t.to_bits(), |sum, y| sum.wrapping_add(y.to_bits()));
    (sum ^ (sum >> 32)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_found_by_all_of_its_bits_until_others_took_its_room() {
        let mut recent = Recent::new(2, 1);
        assert!(recent.find(0.0, &[0.0, 0.0], 1).is_none());
        recent.keep(1.0, &[0.0, 2.0], &[3.0]);
        recent.keep(1.0, &[0.0, 5.0], &[4.0]);
        assert_eq!(recent.find(1.0, &[0.0, 2.0], 1), Some([3.0].as_slice()));
        assert_eq!(recent.find(1.0, &[0.0, 5.0], 1), Some([4.0].as_slice()));
        assert!(recent.find(1.0, &[-0.0, 2.0], 1).is_none() && recent.find(2.0, &[0.0, 2.0], 1).is_none());
        for k in 2..=MOST {
            assert!(recent.find(1.0, &[0.0, 2.0], 1).is_some());
            recent.keep(k as f64, &[0.0, 2.0], &[0.0]);
        }
        assert!(recent.find(1.0, &[0.0, 2.0], 1).is_none() && recent.find(1.0, &[0.0, 5.0], 1).is_some());
    }
}
