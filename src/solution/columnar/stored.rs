//! The stored form: written sequentially, read at any place, with every chunk verified against its checksum.

use super::checksum::checksum;
use super::members::{Members, PartsIndex, StoredMembers, write_parts};
use super::{Columns, Rows, Skeleton};
use crate::{Table, Trajectory};
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

/// Rows per chunk, 8 KiB: the amount read for a single number.
const CHUNK: usize = 1024;

/// Bytes per number.
const WIDTH: usize = size_of::<f64>();

/// The index, which describes the bytes before it.
#[derive(Serialize, Deserialize)]
struct Index {
    /// Version number of the stored form.
    columns: u32,
    rows: usize,
    names: Vec<String>,
    /// Checksums of the chunks of the times, then of those of each field.
    checksums: Vec<u64>,
    /// The table of a sweep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    members: Option<PartsIndex>,
    skeleton: String,
}

/// The number of the form, and that of the form without the table of a sweep.
const FORM: u32 = 2;
const WITHOUT_MEMBERS: u32 = 1;

/// Writes `trajectory`, the `table` if it is that of a sweep, and the rest of the solution; gives the bytes of the index,
/// which are the last that it wrote.
///
/// # Errors
/// Those of `out`.
pub fn write_columns(
    trajectory: &Trajectory,
    table: Option<&Table>,
    skeleton: &Skeleton,
    out: &mut impl Write,
) -> io::Result<Vec<u8>> {
    let rows = trajectory.t.len();
    let (mut checksums, mut bytes) = (Vec::new(), Vec::with_capacity(CHUNK * WIDTH));
    for column in std::iter::once(&trajectory.t).chain(trajectory.fields.iter().map(|field| &field.values)) {
        if column.len() != rows {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "columns must have the same length"));
        }
        for chunk in column.chunks(CHUNK) {
            bytes.clear();
            chunk.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            checksums.push(checksum(&bytes));
            out.write_all(&bytes)?;
        }
    }
    let names = trajectory.fields.iter().map(|field| field.name.clone()).collect();
    let members = table.map_or(Ok(None), |table| write_parts(table, out))?;
    let columns = if members.is_some() { FORM } else { WITHOUT_MEMBERS };
    let index = Index { columns, rows, names, checksums, members, skeleton: skeleton.text().to_owned() };
    let index = serde_json::to_vec(&index)?;
    out.write_all(&index)?;
    Ok(index)
}

/// Bytes with random access.
pub trait Source: Send + Sync {
    /// Reads bytes from `offset` on.
    ///
    /// # Errors
    /// Errors of the disk, or too few bytes.
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<()>;
}

impl Source for Vec<u8> {
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
        let start = usize::try_from(offset).map_err(io::Error::other)?;
        let found = self.get(start..start.saturating_add(bytes.len())).ok_or(io::ErrorKind::UnexpectedEof)?;
        bytes.copy_from_slice(found);
        Ok(())
    }
}

/// Shared bytes.
impl<S: Source + ?Sized> Source for Arc<S> {
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
        (**self).read_at(offset, bytes)
    }
}

/// Columns in the stored form.
pub struct Stored {
    source: Arc<dyn Source>,
    rows: usize,
    names: Vec<String>,
    checksums: Vec<u64>,
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
        let is_known = [FORM, WITHOUT_MEMBERS].contains(&columns);
        if !is_known || checksums.len() != (1 + names.len()) * rows.div_ceil(CHUNK) {
            return Err(io::Error::new(io::ErrorKind::InvalidData, format!("columns of form {columns} are not known")));
        }
        let source: Arc<dyn Source> = Arc::new(source);
        let start = ((1 + names.len()) * rows * WIDTH) as u64;
        let members = members.map(|members| StoredMembers::new(Arc::clone(&source), members, start));
        Ok(Self { source, rows, names, checksums, members, skeleton: Skeleton::of_text(skeleton)? })
    }

    /// The table of a sweep in `source`, and the rest of its solution, which has no trajectory.
    pub fn of_members(source: Arc<dyn Source>, index: PartsIndex, skeleton: Skeleton) -> Self {
        let members = Some(StoredMembers::new(Arc::clone(&source), index, 0));
        Self { source, rows: 0, names: Vec::new(), checksums: Vec::new(), members, skeleton }
    }

    /// The bytes of the index, as they stand behind the columns.
    ///
    /// # Errors
    /// There are none: the index has a JSON form.
    pub fn index(&self) -> io::Result<Vec<u8>> {
        let members = self.members.as_ref().map(|members| members.index().clone());
        let columns = if members.is_some() { FORM } else { WITHOUT_MEMBERS };
        let (names, checksums) = (self.names.clone(), self.checksums.clone());
        let skeleton = self.skeleton.text().to_owned();
        Ok(serde_json::to_vec(&Index { columns, rows: self.rows, names, checksums, members, skeleton })?)
    }

    /// The solution without its columns.
    pub fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    /// Number of bytes before the index.
    pub fn bytes(&self) -> u64 {
        let columns = ((1 + self.names.len()) * self.rows * WIDTH) as u64;
        self.members.as_ref().map_or(columns, StoredMembers::end)
    }

    /// The rows of a chunk.
    fn chunk(&self, chunk: usize) -> Range<usize> {
        let start = chunk * CHUNK;
        start..(start + CHUNK).min(self.rows)
    }

    /// Reads a chunk of a column into `bytes`.
    fn read(&self, column: usize, chunk: usize, bytes: &mut Vec<u8>) -> io::Result<()> {
        let rows = self.chunk(chunk);
        let written = self.checksums.get(column * self.rows.div_ceil(CHUNK) + chunk);
        bytes.resize(rows.len() * WIDTH, 0);
        self.source.read_at(((column * self.rows + rows.start) * WIDTH) as u64, bytes).map_err(cut_off)?;
        if written == Some(&checksum(bytes)) {
            Ok(())
        } else {
            Err(io::Error::new(io::ErrorKind::InvalidData, "a column has changed since it was written"))
        }
    }

    /// Calls `visit` for every chunk of a column that contains some of `rows`, with its bytes and these rows relative
    /// to the chunk.
    fn visit(&self, column: usize, rows: Rows, mut visit: impl FnMut(&[u8], Rows)) -> io::Result<()> {
        let (mut bytes, mut next, end) = (Vec::new(), rows.first, rows.end.min(self.rows));
        while next < end {
            let chunk = self.chunk(next / CHUNK);
            self.read(column, next / CHUNK, &mut bytes)?;
            let within = Rows { first: next - chunk.start, end: end.min(chunk.end) - chunk.start, every: rows.every };
            visit(&bytes, within);
            next = next.saturating_add(within.len().saturating_mul(rows.every));
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
        self.visit(column, rows, |bytes, within| {
            let numbers = &bytes.as_chunks::<WIDTH>().0[within.first..within.end];
            values.extend(numbers.iter().step_by(within.every).map(|number| f64::from_le_bytes(*number)));
        })?;
        Ok(values)
    }

    fn verify(&self, columns: &[usize], rows: Rows) -> io::Result<()> {
        columns.iter().try_for_each(|&column| self.visit(column, rows, |_, _| ()))
    }

    fn partition_point(&self, is_before: &dyn Fn(f64) -> bool) -> io::Result<usize> {
        let chunks: Vec<usize> = (0..self.rows.div_ceil(CHUNK)).collect();
        let (mut bytes, mut broken) = (Vec::new(), Ok(()));
        // The first chunk whose last time does not satisfy `is_before`.
        let found = chunks.partition_point(|&chunk| match self.read(0, chunk, &mut bytes) {
            Ok(()) => bytes.as_chunks::<WIDTH>().0.last().is_some_and(|time| is_before(f64::from_le_bytes(*time))),
            Err(error) => {
                broken = Err(error);
                false
            }
        });
        broken?;
        if found == chunks.len() {
            return Ok(self.rows);
        }
        self.read(0, found, &mut bytes)?;
        let times = bytes.as_chunks::<WIDTH>().0;
        Ok(self.chunk(found).start + times.partition_point(|time| is_before(f64::from_le_bytes(*time))))
    }

    fn members(&self) -> Option<&dyn Members> {
        self.members.as_ref().map(|members| members as &dyn Members)
    }
}

/// Reports a file that is too short as invalid data.
fn cut_off(error: io::Error) -> io::Error {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => io::Error::new(io::ErrorKind::InvalidData, "the end of the columns is missing"),
        _ => error,
    }
}

#[cfg(test)]
mod tests {
    use super::super::write_whole;
    use super::*;
    use crate::columnar::PART;
    use crate::encodings::{self, Csv};
    use crate::{Column, Incomplete, TableProvenance, Values, Words};
    use crate::{Diagnostics, Event, EventKind, Excerpt, Field, Solution, Status, Verdict, Version};
    use std::num::NonZeroUsize;

    fn solution(rows: usize) -> Solution {
        let t: Vec<f64> = (0..rows).map(|k| k as f64 / 8.0).collect();
        let field = |name: &str, scale: f64| Field {
            name: name.to_owned(),
            values: t.iter().map(|t| scale / (1.0 + t)).collect(),
        };
        let fields = vec![field("x", 1.0), field("a \"trajectory\":{\"t\":[],\"fields\":{},", -3.0)];
        let events =
            vec![Event { t: 0.5, kind: EventKind::Slip, of: "\"trajectory\":{\"t\":[],\"fields\":{},".to_owned() }];
        Solution {
            version: Version,
            status: Status::Completed,
            verdict: Verdict::default(),
            error: None,
            ended_by: None,
            sensitivities: None,
            event_slopes: Vec::new(),
            trajectory: Trajectory { t, fields, events },
            diagnostics: Diagnostics { switches: 7, ..Diagnostics::default() },
            orbit: None,
            provenance: None,
            steady_state: None,
            branch: None,
            table: None,
            summary: None,
            fit: None,
            solution: None,
            study: None,
            collected: Vec::new(),
            dense: None,
        }
    }

    fn stored(solution: &Solution) -> (Vec<u8>, Vec<u8>) {
        let mut bytes = Vec::new();
        let index =
            write_columns(&solution.trajectory, solution.table.as_ref(), &Skeleton::of(solution).unwrap(), &mut bytes)
                .unwrap();
        assert!(bytes.ends_with(&index));
        (bytes, index)
    }

    #[test]
    fn the_json_of_stored_columns_is_that_of_the_solution() {
        for rows in [0, 1, 3, CHUNK - 1, CHUNK, 2 * CHUNK + 5] {
            let solution = solution(rows);
            let mut told = Vec::new();
            encodings::write_json(&solution, &mut told).unwrap();
            let (bytes, index) = stored(&solution);
            let columns = Stored::open(bytes, &index).unwrap();
            let mut json = Vec::new();
            write_whole(&columns, columns.skeleton(), &mut json).unwrap();
            assert!(json == told, "{rows} rows");
            let (skeleton, trajectory) = Skeleton::read(&told).unwrap();
            assert_eq!((&skeleton, trajectory), (columns.skeleton(), solution.trajectory));
        }
    }

    #[test]
    fn excerpts_of_stored_columns_are_those_of_the_trajectory() {
        let solution = solution(3 * CHUNK + 100);
        let (bytes, index) = stored(&solution);
        let columns = Stored::open(bytes, &index).unwrap();
        let names = [None, Some(vec!["x".to_owned()])];
        for (every, fields) in [1, 7, CHUNK - 1, CHUNK, 2 * CHUNK + 1, usize::MAX].iter().zip(names.iter().cycle()) {
            for (from, to) in [(f64::NEG_INFINITY, f64::INFINITY), (1000.0, 2500.3), (1024.0, 1024.0), (9.0, 2.0)] {
                let every = NonZeroUsize::new(*every).unwrap();
                let excerpt = Excerpt { fields: fields.clone(), from, to, every };
                let selection = excerpt.of(&columns).unwrap();
                assert_eq!(selection, excerpt.of(&solution.trajectory).unwrap());
                selection.verify(&columns).unwrap();
                let part = |columns: &dyn Columns| selection.block(columns, selection.rows).unwrap();
                assert_eq!(part(&columns), part(&solution.trajectory));
            }
        }
    }

    #[test]
    fn a_table_in_pieces_is_the_whole_table() {
        let solution = solution(2 * CHUNK);
        let (bytes, index) = stored(&solution);
        let columns = Stored::open(bytes, &index).unwrap();
        let (mut whole, mut pieces) = (Vec::new(), Vec::new());
        encodings::write_table(&mut Csv, &solution.trajectory, &mut whole).unwrap();
        let mut table = super::super::TablePieces::new(crate::Selection::whole(&columns), Box::new(Csv));
        while table.write(&columns, &mut pieces).unwrap() {}
        assert!(whole == pieces);
    }

    #[test]
    fn the_json_of_a_stored_table_is_that_of_the_solution() {
        for rows in [0, 1, PART, 2 * PART + 5] {
            let column = |name: &str, values: Values| Column { name: name.to_owned(), values };
            let mut words = Words::default();
            (0..rows).for_each(|row| {
                words.push((row % 3 > 0).then_some(["", "a>\"b", "\"table\":{\"columns\":{}"][row % 3]))
            });
            let table = Table {
                columns: vec![
                    column("member", Values::Counts((0..rows as u32).collect())),
                    column(
                        "x",
                        Values::Numbers(
                            (0..rows).map(|k| if k % 7 == 0 { f64::NAN } else { -0.1 * k as f64 }).collect(),
                        ),
                    ),
                    column("\"table\":{\"columns\":{}", Values::Numbers(vec![f64::NAN; rows])),
                    column("error", Values::Words(words)),
                    column("trusted", Values::Flags((0..rows).map(|k| k % 2 == 0).collect())),
                ],
                members: 3 * PART as u64,
                failed: 0,
                swept: Vec::new(),
                collected: vec!["x".to_owned()],
                times: Vec::new(),
                provenance: TableProvenance::default(),
            };
            let solution = table.into_answer(3 * PART, Incomplete::CANCELLED);
            let mut told = Vec::new();
            encodings::write_json(&solution, &mut told).unwrap();
            let (bytes, index) = stored(&solution);
            let columns = Stored::open(bytes.clone(), &index).unwrap();
            assert_eq!(columns.bytes() as usize, bytes.len() - index.len());
            let mut json = Vec::new();
            write_whole(&columns, columns.skeleton(), &mut json).unwrap();
            assert!(json == told, "{rows} rows: {}", String::from_utf8_lossy(&json[..json.len().min(2000)]));
            let members = columns.members().unwrap();
            assert_eq!(Some(members.whole().unwrap()), solution.table);
            members.verify().unwrap();
            for place in (0..bytes.len() - index.len()).step_by(997) {
                let mut flipped = bytes.clone();
                flipped[place] ^= 1;
                let read = Stored::open(flipped, &index).unwrap();
                assert_eq!(read.members().unwrap().verify().unwrap_err().kind(), io::ErrorKind::InvalidData, "{place}");
            }
        }
    }

    #[test]
    fn a_flipped_bit_and_a_lost_end_are_told() {
        let (bytes, index) = stored(&solution(CHUNK + 10));
        let columns = bytes.len() - index.len();
        for place in [0, 8 * CHUNK, columns - 1] {
            let mut flipped = bytes.clone();
            flipped[place] ^= 1;
            let read = Stored::open(flipped, &index).unwrap();
            let error = crate::Selection::whole(&read).verify(&read).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::InvalidData, "{place}");
        }
        let read = Stored::open(bytes[..columns - 8].to_vec(), &index).unwrap();
        assert_eq!(crate::Selection::whole(&read).verify(&read).unwrap_err().kind(), io::ErrorKind::InvalidData);
        assert!(Stored::open(bytes, b"{}").is_err());
    }
}
