//! Lists of numbers of equal length, one list per row: the trajectories of members of a sweep at the same times. A
//! missing number, such as one after the time at which a run failed, is NaN in memory and null in every written form.

/// A column of lists of numbers of equal length in the table of a sweep.
#[derive(Clone, Debug, Default)]
pub struct Lists {
    length: usize,
    rows: usize,
    values: Vec<f64>,
}

impl PartialEq for Lists {
    fn eq(&self, other: &Self) -> bool {
        let same = |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
        self.rows == other.rows && self.length == other.length && self.values.iter().zip(&other.values).all(same)
    }
}

impl Lists {
    /// Creates a column without rows, for lists of the given length.
    pub fn new(length: usize) -> Self {
        Self { length, ..Self::default() }
    }

    /// Returns the length of each list of the column.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Returns the number of rows of the column of lists.
    pub fn len(&self) -> usize {
        self.rows
    }

    /// Whether the column of lists has no rows.
    pub fn is_empty(&self) -> bool {
        self.rows == 0
    }

    /// Returns the list of numbers in a row of the column.
    pub fn get(&self, row: usize) -> Option<&[f64]> {
        if row >= self.rows {
            return None;
        }
        self.values.get(row * self.length..(row + 1) * self.length)
    }

    /// Returns the numbers of the list in a row of the column, `None` for missing ones; returns `None` if all are
    /// missing.
    pub fn numbers(&self, row: usize) -> Option<impl Iterator<Item = Option<f64>>> {
        let list = self.get(row).filter(|list| list.iter().any(|value| value.is_finite()))?;
        Some(list.iter().map(|value| Some(*value).filter(|value| value.is_finite())))
    }

    /// Appends a list to the column: missing numbers are added if it is too short, and excess numbers are dropped.
    pub fn push(&mut self, list: &[f64]) {
        let given = list.iter().copied().chain(std::iter::repeat(f64::NAN));
        self.values.extend(given.take(self.length));
        self.rows += 1;
    }

    /// Sets the length of the lists of the column to that of `other`, if there are no rows yet.
    pub fn take_length(&mut self, other: &Self) {
        if self.rows == 0 {
            self.length = other.length;
        }
    }

    /// Reserves space for additional rows of the column of lists.
    pub fn reserve(&mut self, rows: usize) {
        self.values.reserve_exact(rows.saturating_mul(self.length));
    }

    /// Returns the numbers in all rows of the column, one list after the other.
    pub fn values(&self) -> &[f64] {
        &self.values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_have_one_length_and_what_is_missing_is_none() {
        let mut lists = Lists::new(2);
        [&[1.0, 2.0][..], &[3.0], &[], &[4.0, 5.0, 6.0]].iter().for_each(|list| lists.push(list));
        let numbers = |row: usize| lists.numbers(row).map(|list| list.collect::<Vec<_>>());
        assert_eq!((lists.len(), numbers(0)), (4, Some(vec![Some(1.0), Some(2.0)])));
        assert_eq!((numbers(1), numbers(2)), (Some(vec![Some(3.0), None]), None));
        assert_eq!((lists.get(3), lists.get(4)), (Some(&[4.0, 5.0][..]), None));
    }
}
