//! The stored form of columns: written sequentially, read at any position, with every block verified against its
//! checksum.

use super::checksum::{checksum, checksum_from};
use super::members::{Members, PartsIndex, StoredMembers, write_parts};
use super::{Columns, Rows, Skeleton};
use crate::{Table, Trajectory};
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

/// Rows per block of a stored column. A block takes 512 bytes with its checksum, the least amount that is read for a
/// number. A block never crosses a page of memory, and at most 504 bytes beside the requested number are verified.
const BLOCK: usize = 63;

/// Rows per chunk of a column in the earlier stored forms, which have chunks of 8 KiB instead of blocks.
const CHUNK: usize = 1024;

/// Bytes per number of a column, and per checksum of a block.
const WIDTH: usize = size_of::<f64>();

/// Bytes of a stored column that are read at once if the requested blocks are close to one another.
const RUN: usize = 64 << 10;

/// Distance in bytes between two requested blocks up to which the bytes between them are read as well: the size of a
/// page of memory, whose copy takes about as long as a further system call.
const CLOSE: usize = 4 << 10;

/// Distance in bytes between two requested blocks up to which all bytes between them are prefetched from the disk: a
/// disk transfers them faster than it answers another request.
const FETCHED: usize = 128 << 10;

/// The index of a stored solution, which describes the bytes before the index.
#[derive(Serialize, Deserialize)]
struct Index {
    /// Version number of the stored form of the solution.
    columns: u32,
    rows: usize,
    names: Vec<String>,
    /// Checksums of the chunks of the times, then of the chunks of each field, in the stored forms without blocks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    checksums: Vec<u64>,
    /// The index of the parts of the table of a sweep, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    members: Option<PartsIndex>,
    skeleton: String,
}

/// The version number of the stored form of solutions with blocks, and those of the forms in chunks, which can still be
/// read: without and with the table of a sweep.
const FORM: u32 = 3;
const IN_CHUNKS: [u32; 2] = [1, 2];

/// The layout of the numbers of a stored column in the file.
enum Layout {
    /// Chunks of [`CHUNK`] rows, with their checksums in the index.
    Chunks(Vec<u64>),
    /// Blocks of [`BLOCK`] rows, each followed by its checksum. The seed of the checksum is the sum of the given
    /// number and of the index of the block in the file, so that a block from another position or from another
    /// solution is detected.
    Blocks(u64),
}

impl Layout {
    /// Returns the layout of columns in blocks, with the checksum of this skeleton as the seed of the blocks'
    /// checksums.
    fn of(skeleton: &Skeleton) -> Self {
        Self::Blocks(checksum(skeleton.text().as_bytes()))
    }

    /// Returns the number of rows of a full block (or chunk) of a column.
    fn rows(&self) -> usize {
        match self {
            Self::Chunks(_) => CHUNK,
            Self::Blocks(_) => BLOCK,
        }
    }

    /// Returns the number of bytes of the checksum after a block.
    fn tail(&self) -> usize {
        match self {
            Self::Chunks(_) => 0,
            Self::Blocks(_) => WIDTH,
        }
    }

    /// Returns the length in bytes of a full block (or chunk) of a column, with its checksum.
    fn length(&self) -> usize {
        self.rows() * WIDTH + self.tail()
    }

    /// Returns the numbers in the bytes of the block with index `number` in the file; `None` if the bytes do not match
    /// the checksum of the block.
    fn numbers<'b>(&self, number: usize, block: &'b [u8]) -> Option<&'b [[u8; WIDTH]]> {
        let (bytes, is_intact) = match self {
            Self::Chunks(checksums) => (block, checksums.get(number) == Some(&checksum(block))),
            Self::Blocks(seed) => {
                let (bytes, sum) = block.split_last_chunk::<WIDTH>()?;
                (bytes, u64::from_le_bytes(*sum) == checksum_from(seed.wrapping_add(number as u64), bytes))
            }
        };
        is_intact.then_some(bytes.as_chunks().0)
    }
}

/// Writes `trajectory`, the `table` of a sweep if there is one, and the rest of the solution; returns the bytes of
/// the index, which it has written last.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_columns(
    trajectory: &Trajectory,
    table: Option<&Table>,
    skeleton: &Skeleton,
    out: &mut impl Write,
) -> io::Result<Vec<u8>> {
    let rows = trajectory.t.len();
    let seed = checksum(skeleton.text().as_bytes());
    let mut blocks = io::BufWriter::with_capacity(RUN, &mut *out);
    let (mut number, mut bytes) = (seed, Vec::with_capacity(BLOCK * WIDTH));
    for column in std::iter::once(&trajectory.t).chain(trajectory.fields.iter().map(|field| &field.values)) {
        if column.len() != rows {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "columns must have the same length"));
        }
        for block in column.chunks(BLOCK) {
            bytes.clear();
            block.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            blocks.write_all(&bytes)?;
            blocks.write_all(&checksum_from(number, &bytes).to_le_bytes())?;
            number = number.wrapping_add(1);
        }
    }
    blocks.flush()?;
    drop(blocks);
    let names = trajectory.fields.iter().map(|field| field.name.clone()).collect();
    let members = table.map_or(Ok(None), |table| write_parts(table, out))?;
    let skeleton = skeleton.text().to_owned();
    let index = serde_json::to_vec(&Index { columns: FORM, rows, names, checksums: Vec::new(), members, skeleton })?;
    out.write_all(&index)?;
    Ok(index)
}

/// A source of bytes with random access.
pub trait Source: Send + Sync {
    /// Fills `bytes` with the bytes from `offset` on.
    ///
    /// # Errors
    /// Errors of the disk, or too few bytes.
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<()>;

    /// Announces that several parts of `_length` bytes from `_offset` on will be read soon, each by a separate request.
    fn fetch(&self, _offset: u64, _length: u64) {}
}

impl Source for Vec<u8> {
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
        let start = usize::try_from(offset).map_err(io::Error::other)?;
        let found = self.get(start..start.saturating_add(bytes.len())).ok_or(io::ErrorKind::UnexpectedEof)?;
        bytes.copy_from_slice(found);
        Ok(())
    }
}

/// Reads from a shared source of bytes.
impl<S: Source + ?Sized> Source for Arc<S> {
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
        (**self).read_at(offset, bytes)
    }

    fn fetch(&self, offset: u64, length: u64) {
        (**self).fetch(offset, length);
    }
}

/// Columns of a solution in the stored form.
pub struct Stored {
    source: Arc<dyn Source>,
    rows: usize,
    names: Vec<String>,
    layout: Layout,
    members: Option<StoredMembers>,
    skeleton: Skeleton,
}

impl Stored {
    /// Opens the columns in `source` with an index whose digest the caller has verified.
    ///
    /// # Errors
    /// The bytes are not a valid index.
    pub fn open(source: impl Source + 'static, index: &[u8]) -> io::Result<Self> {
        let Index { columns, rows, names, checksums, members, skeleton } = serde_json::from_slice(index)?;
        let skeleton = Skeleton::of_text(skeleton)?;
        let layout = match columns {
            FORM => Layout::of(&skeleton),
            form if IN_CHUNKS.contains(&form) && checksums.len() == (1 + names.len()) * rows.div_ceil(CHUNK) => {
                Layout::Chunks(checksums)
            }
            form => {
                return Err(io::Error::new(
                    io::ErrorKind::InvalidData,
                    format!("columns of form {form} are not known"),
                ));
            }
        };
        let source: Arc<dyn Source> = Arc::new(source);
        let mut stored = Self { source, rows, names, layout, members: None, skeleton };
        let start = stored.start_of(1 + stored.names.len());
        stored.members = members.map(|members| StoredMembers::new(Arc::clone(&stored.source), members, start));
        Ok(stored)
    }

    /// Returns the table of a sweep stored in `source`, and the rest of its solution, which has no trajectory.
    pub fn of_members(source: Arc<dyn Source>, index: PartsIndex, skeleton: Skeleton) -> Self {
        let members = Some(StoredMembers::new(Arc::clone(&source), index, 0));
        Self { source, rows: 0, names: Vec::new(), layout: Layout::of(&skeleton), members, skeleton }
    }

    /// Returns the bytes of the index, as they are stored after the columns.
    ///
    /// # Errors
    /// None occur: the index can always be serialised as JSON.
    pub fn index(&self) -> io::Result<Vec<u8>> {
        let members = self.members.as_ref().map(|members| members.index().clone());
        let (columns, checksums) = match &self.layout {
            Layout::Chunks(checksums) => (IN_CHUNKS[usize::from(members.is_some())], checksums.clone()),
            Layout::Blocks(_) => (FORM, Vec::new()),
        };
        let (names, skeleton) = (self.names.clone(), self.skeleton.text().to_owned());
        Ok(serde_json::to_vec(&Index { columns, rows: self.rows, names, checksums, members, skeleton })?)
    }

    /// Returns the solution without its columns.
    pub fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    /// Returns the number of bytes of the stored solution before its index.
    pub fn bytes(&self) -> u64 {
        let columns = self.start_of(1 + self.names.len());
        self.members.as_ref().map_or(columns, StoredMembers::end)
    }

    /// Returns the offset in bytes of the column with the index `column`; if this is the number of columns, the
    /// offset of their end.
    fn start_of(&self, column: usize) -> u64 {
        let length = self.rows * WIDTH + self.blocks() * self.layout.tail();
        (column * length) as u64
    }

    /// Returns the number of blocks of a column.
    fn blocks(&self) -> usize {
        self.rows.div_ceil(self.layout.rows())
    }

    /// Returns the range of rows whose numbers are in a block of a column.
    fn rows_of(&self, block: usize) -> Range<usize> {
        let start = block * self.layout.rows();
        start..(start + self.layout.rows()).min(self.rows)
    }

    /// Reads successive blocks of a column into `bytes`, without verifying their checksums.
    fn read(&self, column: usize, blocks: Range<usize>, bytes: &mut Vec<u8>) -> io::Result<()> {
        let rows = self.rows_of(blocks.end.saturating_sub(1)).end - self.rows_of(blocks.start).start;
        bytes.resize(rows * WIDTH + blocks.len() * self.layout.tail(), 0);
        self.source
            .read_at(self.start_of(column) + (blocks.start * self.layout.length()) as u64, bytes)
            .map_err(cut_off)
    }

    /// Returns the numbers of a block of a column, verified by its checksum, from the `bytes` of successive blocks
    /// beginning with block `first`.
    fn numbers<'b>(&self, column: usize, block: usize, bytes: &'b [u8], first: usize) -> io::Result<&'b [[u8; WIDTH]]> {
        let start = (block - first) * self.layout.length();
        let length = self.rows_of(block).len() * WIDTH + self.layout.tail();
        let bytes = bytes.get(start..start + length);
        bytes.and_then(|bytes| self.layout.numbers(column * self.blocks() + block, bytes)).ok_or_else(changed)
    }

    /// Calls `visit` for every block of a column that contains some of `rows`, with the numbers of the block and the
    /// range of those rows, counted from the beginning of the block.
    fn visit(&self, column: usize, rows: Rows, mut visit: impl FnMut(&[[u8; WIDTH]], Rows)) -> io::Result<()> {
        let (mut bytes, mut next, end) = (Vec::new(), rows.first, rows.end.min(self.rows));
        let distance = rows.every.saturating_mul(WIDTH);
        let run = if distance <= CLOSE { (RUN / self.layout.length()).max(1) } else { 1 };
        if (CLOSE..=FETCHED).contains(&distance) && next < end {
            let [first, last] = [next, end].map(|row| (row / self.layout.rows() * self.layout.length()) as u64);
            self.source.fetch(self.start_of(column) + first, last - first);
        }
        while next < end {
            let first = next / self.layout.rows();
            let blocks = first..(first + run).min(end.div_ceil(self.layout.rows()));
            self.read(column, blocks.clone(), &mut bytes)?;
            while next < end && next / self.layout.rows() < blocks.end {
                let block = next / self.layout.rows();
                let of_block = self.rows_of(block);
                let within = Rows { first: next - of_block.start, end: end.min(of_block.end) - of_block.start, ..rows };
                visit(self.numbers(column, block, &bytes, first)?, within);
                next = next.saturating_add(within.len().saturating_mul(rows.every));
            }
        }
        Ok(())
    }
}

impl Columns for Stored {
    fn rows(&self) -> usize {
        self.rows
    }

    fn names(&self) -> Vec<&str> {
        self.names.iter().map(String::as_str).collect()
    }

    fn values(&self, column: usize, rows: Rows) -> io::Result<Vec<f64>> {
        let mut values = Vec::with_capacity(rows.len());
        self.visit(column, rows, |numbers, within| {
            let numbers = numbers.get(within.first..within.end).unwrap_or_default();
            values.extend(numbers.iter().step_by(within.every).map(|number| f64::from_le_bytes(*number)));
        })?;
        Ok(values)
    }

    fn verify(&self, columns: &[usize], rows: Rows) -> io::Result<()> {
        columns.iter().try_for_each(|&column| self.visit(column, rows, |_, _| ()))
    }

    fn partition_point(&self, is_before: &dyn Fn(f64) -> bool) -> io::Result<usize> {
        let mut bytes = Vec::new();
        let mut times = |block: usize| -> io::Result<Vec<f64>> {
            self.read(0, block..block + 1, &mut bytes)?;
            Ok(self.numbers(0, block, &bytes, block)?.iter().map(|time| f64::from_le_bytes(*time)).collect())
        };
        // Bisection for the first block of the times whose last time does not satisfy `is_before`.
        let (mut found, mut end) = (0, self.blocks());
        while found < end {
            let middle = found.midpoint(end);
            if times(middle)?.last().is_some_and(|time| is_before(*time)) {
                found = middle + 1;
            } else {
                end = middle;
            }
        }
        if found == self.blocks() {
            return Ok(self.rows);
        }
        Ok(self.rows_of(found).start + times(found)?.partition_point(|time| is_before(*time)))
    }

    fn members(&self) -> Option<&dyn Members> {
        self.members.as_ref().map(|members| members as &dyn Members)
    }
}

fn changed() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "a column has changed since it was written")
}

/// Converts the error of a file that is too short to one of invalid data.
fn cut_off(error: io::Error) -> io::Error {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => io::Error::new(io::ErrorKind::InvalidData, "the end of the columns is missing"),
        _ => error,
    }
}

#[cfg(test)]
mod tests;
