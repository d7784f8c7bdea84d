//! The memory that a solve takes, as far as it is known before it runs: its trajectory at the times asked for, and its
//! matrices; of bodies the contacts at the start. What turns out on the way (the fill of sparse factors, contacts that bodies
//! come to, the steps where no times are asked for) is bounded as it does.

use super::checked::Specification;

impl Specification {
    /// The bytes that a solve is known to take.
    pub fn memory_bytes(&self) -> usize {
        let numbers = self.trajectory_numbers().saturating_add(self.model().numbers(self));
        numbers.saturating_mul(size_of::<f64>()).saturating_add(self.load.bytes())
    }

    fn trajectory_numbers(&self) -> usize {
        let times = self.output_times().map_or(0, <[f64]>::len);
        times.saturating_mul(1 + self.output_fields().len())
    }
}
