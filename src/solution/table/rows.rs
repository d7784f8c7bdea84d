//! The rows of a table as bytes, for a worker to send and a store to keep:
//!
//! ```text
//! head       the bytes of the head (4), the head as JSON: a table without rows
//! rows       how many (4)
//! columns    of each its kind (1), and its values, little-endian:
//!            numbers 8 bytes, NaN where there is none; counts 4 bytes, the largest where there is none; truths 1 byte;
//!            words: how many (4), each with its bytes (4) before it, then the place of each row in that list (4);
//!            lists: their length (4), then their numbers
//! ```
//!
//! Unlike in JSON, a column whose values are all missing keeps its type.

use super::{Lists, MISSING, Table, Values, Words};
use std::io;

/// The codes of the types of columns in the byte format of a table.
const NUMBERS: u8 = 0;
const COUNTS: u8 = 1;
const FLAGS: u8 = 2;
const WORDS: u8 = 3;
const LISTS: u8 = 4;

impl Table {
    /// Returns the table as bytes.
    ///
    /// # Errors
    /// The table has more rows, or longer texts, than four bytes can count.
    pub fn to_bytes(&self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        put_text(&serde_json::to_vec(&self.head())?, &mut bytes)?;
        put(self.rows(), &mut bytes)?;
        self.columns.iter().try_for_each(|column| column.values.put(&mut bytes))?;
        Ok(bytes)
    }

    /// Reads a table that [`Table::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`] if the bytes do not represent a table.
    pub fn of_bytes(bytes: &[u8]) -> io::Result<Self> {
        let mut rest = Rest(bytes);
        let length = rest.count()?;
        let mut table: Self = serde_json::from_slice(rest.take(length)?)?;
        let rows = rest.count()?;
        for column in &mut table.columns {
            column.values = rest.values(rows)?;
        }
        if rest.0.is_empty() { Ok(table) } else { Err(cut_off()) }
    }

    /// Returns the table without rows, but with the number of failed members.
    pub fn head(&self) -> Self {
        Self { failed: self.failed, ..self.emptied() }
    }
}

impl Values {
    /// Appends the values as bytes, preceded by the code of their type.
    ///
    /// # Errors
    /// There are more texts, or longer ones, than four bytes can count.
    pub fn put(&self, bytes: &mut Vec<u8>) -> io::Result<()> {
        match self {
            Self::Numbers(values) => {
                bytes.push(NUMBERS);
                values.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            }
            Self::Counts(values) => {
                bytes.push(COUNTS);
                values.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            }
            Self::Flags(values) => {
                bytes.push(FLAGS);
                bytes.extend(values.iter().map(|value| u8::from(*value)));
            }
            Self::Words(words) => {
                bytes.push(WORDS);
                put(words.words.len(), bytes)?;
                words.words.iter().try_for_each(|word| put_text(word.as_bytes(), bytes))?;
                words.places.iter().for_each(|place| bytes.extend_from_slice(&place.to_le_bytes()));
            }
            Self::Lists(lists) => {
                bytes.push(LISTS);
                put(lists.length(), bytes)?;
                lists.values().iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            }
        }
        Ok(())
    }

    /// Reads the values of `rows` rows that [`Values::put`] wrote.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`] if the bytes do not represent a column of `rows` rows.
    pub fn of_bytes(bytes: &[u8], rows: usize) -> io::Result<Self> {
        let mut rest = Rest(bytes);
        let values = rest.values(rows)?;
        if rest.0.is_empty() { Ok(values) } else { Err(cut_off()) }
    }
}

fn put(count: usize, bytes: &mut Vec<u8>) -> io::Result<()> {
    let count = u32::try_from(count).map_err(|_| io::ErrorKind::FileTooLarge)?;
    bytes.extend_from_slice(&count.to_le_bytes());
    Ok(())
}

fn put_text(text: &[u8], bytes: &mut Vec<u8>) -> io::Result<()> {
    put(text.len(), bytes)?;
    bytes.extend_from_slice(text);
    Ok(())
}

fn cut_off() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "these are no rows of a table")
}

/// The bytes of a stored table that have not been read yet.
struct Rest<'b>(&'b [u8]);

impl<'b> Rest<'b> {
    fn take(&mut self, count: usize) -> io::Result<&'b [u8]> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or_else(cut_off)?;
        self.0 = rest;
        Ok(taken)
    }

    /// Reads `count` numbers of `N` bytes each.
    fn numbers<const N: usize>(&mut self, count: usize) -> io::Result<&'b [[u8; N]]> {
        Ok(self.take(count.checked_mul(N).ok_or_else(cut_off)?)?.as_chunks().0)
    }

    fn count(&mut self) -> io::Result<usize> {
        self.numbers(1)?.first().map(|bytes| u32::from_le_bytes(*bytes) as usize).ok_or_else(cut_off)
    }

    fn values(&mut self, rows: usize) -> io::Result<Values> {
        let [kind] = self.numbers::<1>(1)?[..] else { return Err(cut_off()) };
        Ok(match kind {
            [NUMBERS] => Values::Numbers(self.numbers(rows)?.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect()),
            [COUNTS] => Values::Counts(self.numbers(rows)?.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect()),
            [FLAGS] => Values::Flags(self.take(rows)?.iter().map(|byte| *byte != 0).collect()),
            [WORDS] => Values::Words(self.words(rows)?),
            [LISTS] => {
                let length = self.count()?;
                let mut lists = Lists::new(length);
                // Empty lists take no bytes, so that their number of rows is limited separately.
                let count = if length == 0 { rows.min(self.0.len()) } else { rows };
                let numbers = self.numbers(count.checked_mul(length).ok_or_else(cut_off)?)?;
                let numbers: Vec<f64> = numbers.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
                numbers.chunks_exact(length.max(1)).for_each(|list| lists.push(list));
                if lists.len() != rows {
                    return Err(cut_off());
                }
                Values::Lists(lists)
            }
            _ => return Err(cut_off()),
        })
    }

    fn words(&mut self, rows: usize) -> io::Result<Words> {
        let count = self.count()?;
        // Each text of a column takes at least four bytes, which limits the number of texts.
        let mut known = Vec::with_capacity(count.min(self.0.len() / 4));
        for _ in 0..count {
            let length = self.count()?;
            known.push(str::from_utf8(self.take(length)?).map_err(|_| cut_off())?);
        }
        let mut words = Words::default();
        for place in self.numbers(rows)? {
            let place = u32::from_le_bytes(*place);
            let word = match place {
                MISSING => None,
                place => Some(*known.get(place as usize).ok_or_else(cut_off)?),
            };
            words.push(word);
        }
        Ok(words)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Column, TableProvenance};
    use super::*;

    fn table() -> Table {
        let column = |name: &str, values: Values| Column { name: name.to_owned(), values };
        let mut words = Words::default();
        [Some("stick>slip"), None, Some("\"é\n"), Some("stick>slip")].iter().for_each(|word| words.push(*word));
        let mut lists = Lists::new(2);
        [&[1.0, -0.0][..], &[f64::MIN], &[], &[2.0, 3.0]].iter().for_each(|list| lists.push(list));
        Table {
            columns: vec![
                column("member", Values::Counts([5, 6, 7, 8].into_iter().collect())),
                column("x", Values::Numbers(vec![-0.0, f64::NAN, 5e-324, f64::MAX])),
                column("n", Values::Counts([MISSING; 4].into_iter().collect())),
                column("trusted", Values::Flags(vec![true, false, true, true])),
                column("word", Values::Words(words)),
                column("trajectory.x", Values::Lists(lists)),
            ],
            members: 1_000_000,
            failed: 1,
            swept: vec!["x".to_owned()],
            collected: vec!["n".to_owned(), "word".to_owned()],
            times: vec![0.0, 0.5],
            provenance: TableProvenance { digest: "abc".to_owned(), ..TableProvenance::default() },
        }
    }

    #[test]
    fn rows_read_back_with_their_kinds_and_to_the_same_bits() {
        let table = table();
        let read = Table::of_bytes(&table.to_bytes().unwrap()).unwrap();
        assert_eq!(read, table);
        assert!(matches!(read.columns[2].values, Values::Counts(_)));
        assert_eq!(read.to_bytes().unwrap(), table.to_bytes().unwrap());
        assert_eq!(Table::of_bytes(&table.emptied().to_bytes().unwrap()).unwrap().rows(), 0);
    }

    #[test]
    fn other_bytes_are_refused() {
        let bytes = table().to_bytes().unwrap();
        for length in 0..bytes.len() {
            assert!(Table::of_bytes(&bytes[..length]).is_err(), "{length}");
        }
        assert!(Table::of_bytes(&[&bytes[..], &[0]].concat()).is_err());
        // Any single byte is changed: the table that is read has columns of equal length, or is rejected.
        for place in 0..bytes.len() {
            let mut other = bytes.clone();
            other[place] ^= 0x55;
            if let Ok(read) = Table::of_bytes(&other) {
                assert!(read.columns.iter().all(|column| column.values.len() == read.rows()), "{place}");
            }
        }
    }
}
