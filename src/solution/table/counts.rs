//! Columns of counts in few bytes, so that a million rows fit into memory. An arithmetic sequence with step 0 or 1,
//! such as the numbers of successive members or a constant count, takes no memory per row; other columns take one,
//! two or four bytes per row, depending on the largest count.

/// The value that stands for a missing count.
pub const MISSING: u32 = u32::MAX;

/// A column of counts, one per row; [`u32::MAX`] if missing.
#[derive(Clone, Debug)]
pub struct Counts {
    kept: Kept,
    /// Number of rows of the column for which space is reserved.
    room: usize,
}

#[derive(Clone, Debug)]
enum Kept {
    /// The counts of a column that form an arithmetic sequence `first`, `first + step`, and so on, one per row.
    Run {
        first: u32,
        step: u32,
        len: usize,
    },
    Bytes(Vec<u8>),
    Shorts(Vec<u16>),
    Words(Vec<u32>),
}

impl Default for Counts {
    fn default() -> Self {
        Self { kept: Kept::Run { first: 0, step: 0, len: 0 }, room: 0 }
    }
}

impl FromIterator<u32> for Counts {
    fn from_iter<I: IntoIterator<Item = u32>>(values: I) -> Self {
        let mut counts = Self::default();
        values.into_iter().for_each(|value| counts.push(value));
        counts
    }
}

impl PartialEq for Counts {
    fn eq(&self, other: &Self) -> bool {
        self.len() == other.len() && self.iter().eq(other.iter())
    }
}

impl Counts {
    /// Returns the number of rows of the column.
    pub fn len(&self) -> usize {
        match &self.kept {
            Kept::Run { len, .. } => *len,
            Kept::Bytes(values) => values.len(),
            Kept::Shorts(values) => values.len(),
            Kept::Words(values) => values.len(),
        }
    }

    /// Whether the column has no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the count in a row of the column; `None` after the last row.
    pub fn get(&self, row: usize) -> Option<u32> {
        match &self.kept {
            Kept::Run { first, step, len } => (row < *len).then(|| first + step * row as u32),
            Kept::Bytes(values) => {
                values.get(row).map(|value| if *value == u8::MAX { MISSING } else { (*value).into() })
            }
            Kept::Shorts(values) => {
                values.get(row).map(|value| if *value == u16::MAX { MISSING } else { (*value).into() })
            }
            Kept::Words(values) => values.get(row).copied(),
        }
    }

    /// Returns the counts in all rows of the column in order.
    pub fn iter(&self) -> impl Iterator<Item = u32> {
        (0..self.len()).filter_map(|row| self.get(row))
    }

    /// Reserves space for additional rows of the column.
    pub fn reserve(&mut self, rows: usize) {
        self.room = self.len() + rows;
        match &mut self.kept {
            Kept::Run { .. } => {}
            Kept::Bytes(values) => values.reserve_exact(rows),
            Kept::Shorts(values) => values.reserve_exact(rows),
            Kept::Words(values) => values.reserve_exact(rows),
        }
    }

    /// Appends a count to the column.
    pub fn push(&mut self, value: u32) {
        if let Kept::Run { first, step, len } = &mut self.kept {
            match *len {
                0 => (*first, *step) = (value, 0),
                1 if value.checked_sub(*first).is_some_and(|step| step <= 1) => *step = value - *first,
                // The value that stands for a missing count does not occur in a sequence with step 1.
                _ if first.checked_add(step.saturating_mul(*len as u32)) == Some(value)
                    && (*step == 0 || value < MISSING) => {}
                _ => return self.widen(value),
            }
            *len += 1;
            return;
        }
        let fits = match &mut self.kept {
            Kept::Run { .. } => false,
            Kept::Bytes(values) => byte(value).map(|value| values.push(value)).is_some(),
            Kept::Shorts(values) => short(value).map(|value| values.push(value)).is_some(),
            Kept::Words(values) => {
                values.push(value);
                true
            }
        };
        if !fits {
            self.widen(value);
        }
    }

    /// Appends a count to the column that does not fit into the current representation, by a change to a wider one.
    fn widen(&mut self, value: u32) {
        let room = self.room.max(self.len() + 1);
        let is_of = |fits: &dyn Fn(u32) -> bool| self.iter().chain([value]).all(fits);
        let all = self.iter().chain([value]);
        self.kept = if is_of(&|value| byte(value).is_some()) {
            let mut values = Vec::with_capacity(room);
            values.extend(all.filter_map(byte));
            Kept::Bytes(values)
        } else if is_of(&|value| short(value).is_some()) {
            let mut values = Vec::with_capacity(room);
            values.extend(all.filter_map(short));
            Kept::Shorts(values)
        } else {
            let mut values = Vec::with_capacity(room);
            values.extend(all);
            Kept::Words(values)
        };
    }
}

/// Returns a count as one byte, if it fits into one.
fn byte(value: u32) -> Option<u8> {
    if value == MISSING { Some(u8::MAX) } else { u8::try_from(value).ok().filter(|value| *value < u8::MAX) }
}

/// Returns a count as two bytes, if it fits into two.
fn short(value: u32) -> Option<u16> {
    if value == MISSING { Some(u16::MAX) } else { u16::try_from(value).ok().filter(|value| *value < u16::MAX) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_those_that_were_added() {
        let m = MISSING;
        for values in [
            vec![],
            vec![7],
            vec![m],
            (5..3000).collect::<Vec<u32>>(),
            vec![3; 100],
            vec![m; 50],
            vec![3, 3, 4],
            vec![3, 4, 4],
            vec![4, 3],
            vec![0, m, 254, 255, 256],
            vec![1, m - 1, m],
            vec![m - 2, m - 1, m],
            vec![m - 1, m],
            vec![m, 0],
            vec![65_534, 65_535, m, 65_536, 0],
            (0..70_000).map(|k| k % 300).collect(),
        ] {
            let mut counts = Counts::default();
            counts.reserve(values.len());
            for (row, value) in values.iter().enumerate() {
                counts.push(*value);
                assert_eq!((counts.get(row), counts.get(row + 1), counts.len()), (Some(*value), None, row + 1));
            }
            assert!(counts.iter().eq(values.iter().copied()), "{values:?}");
            assert_eq!(counts, values.iter().copied().collect());
        }
    }

    #[test]
    fn they_take_as_few_bytes_as_they_need() {
        let of = |values: &mut dyn Iterator<Item = u32>| values.collect::<Counts>().kept;
        assert!(matches!(of(&mut (0..1_000_000)), Kept::Run { .. }));
        assert!(matches!(of(&mut [9; 100].into_iter()), Kept::Run { .. }));
        assert!(matches!(of(&mut [1, 9, MISSING].into_iter()), Kept::Bytes(_)));
        assert!(matches!(of(&mut [1, 9, 400].into_iter()), Kept::Shorts(_)));
        assert!(matches!(of(&mut [1, 9, 400_000].into_iter()), Kept::Words(_)));
    }
}
