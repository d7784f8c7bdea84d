use super::super::write_whole;
use super::*;
use crate::columnar::PART;
use crate::encodings::{self, Csv};
use crate::{Column, Incomplete, TableProvenance, Values, Words};
use crate::{Diagnostics, Event, EventKind, Excerpt, Field, Solution, Status};
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

fn solution(rows: usize) -> Solution {
    let t: Vec<f64> = (0..rows).map(|k| k as f64 / 8.0).collect();
    let field =
        |name: &str, scale: f64| Field { name: name.to_owned(), values: t.iter().map(|t| scale / (1.0 + t)).collect() };
    let fields = vec![field("x", 1.0), field("a \"trajectory\":{\"t\":[],\"fields\":{},", -3.0)];
    let events =
        vec![Event { t: 0.5, kind: EventKind::Slip, of: "\"trajectory\":{\"t\":[],\"fields\":{},".to_owned() }];
    Solution {
        status: Status::Completed,
        trajectory: Trajectory { t, fields, events },
        diagnostics: Diagnostics { switches: 7, ..Diagnostics::default() },
        ..Solution::default()
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

/// Writes a solution in the earlier stored form, with chunks instead of blocks.
fn in_chunks(solution: &Solution) -> (Vec<u8>, Vec<u8>) {
    let Trajectory { t, fields, .. } = &solution.trajectory;
    let (mut bytes, mut checksums) = (Vec::new(), Vec::new());
    for column in std::iter::once(t).chain(fields.iter().map(|field| &field.values)) {
        for chunk in column.chunks(1024) {
            let written: Vec<u8> = chunk.iter().flat_map(|value| value.to_le_bytes()).collect();
            checksums.push(checksum(&written));
            bytes.extend(written);
        }
    }
    let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
    let skeleton = Skeleton::of(solution).unwrap();
    let index = serde_json::json!({
        "columns": 1, "rows": t.len(), "names": names, "checksums": checksums, "skeleton": skeleton.text(),
    });
    let index = serde_json::to_vec(&index).unwrap();
    bytes.extend(&index);
    (bytes, index)
}

#[test]
fn columns_of_the_form_in_chunks_are_read_and_verified() {
    for rows in [0, 1, CHUNK, 2 * CHUNK + 5] {
        let solution = solution(rows);
        let mut told = Vec::new();
        encodings::write_json(&solution, &mut told).unwrap();
        let (bytes, index) = in_chunks(&solution);
        let columns = Stored::open(bytes.clone(), &index).unwrap();
        let mut json = Vec::new();
        write_whole(&columns, columns.skeleton(), &mut json).unwrap();
        assert!(json == told, "{rows} rows");
        assert_eq!(columns.bytes() as usize, bytes.len() - index.len());
        for place in (0..bytes.len() - index.len()).step_by(1999) {
            let mut flipped = bytes.clone();
            flipped[place] ^= 1;
            let read = Stored::open(flipped, &index).unwrap();
            assert!(crate::Selection::whole(&read).verify(&read).is_err(), "{place}");
        }
    }
}

#[test]
fn a_block_of_another_place_or_of_other_results_does_not_pass() {
    let [one, other] = [solution(10 * BLOCK), {
        let mut other = solution(10 * BLOCK);
        other.diagnostics.switches += 1;
        other
    }];
    let ((bytes, index), (others, _)) = (stored(&one), stored(&other));
    let block = 8 * (BLOCK + 1);
    for (from, to, source) in [(0, 1, &bytes), (3, 13, &bytes), (2, 2, &others)] {
        let mut replaced = bytes.clone();
        replaced[to * block..][..block].copy_from_slice(&source[from * block..][..block]);
        let read = Stored::open(replaced, &index).unwrap();
        assert!(crate::Selection::whole(&read).verify(&read).is_err(), "{from} in the place of {to}");
    }
    let mut empty = bytes.clone();
    empty[block..2 * block].fill(0);
    let read = Stored::open(empty, &index).unwrap();
    assert!(crate::Selection::whole(&read).verify(&read).is_err());
}

/// A source of bytes that counts the bytes read from it.
struct Counted(Vec<u8>, Arc<AtomicUsize>);

impl Source for Counted {
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
        self.1.fetch_add(bytes.len(), Relaxed);
        self.0.read_at(offset, bytes)
    }
}

#[test]
fn an_excerpt_reads_little_more_than_it_shows() {
    let solution = solution(200_000);
    let (bytes, index) = stored(&solution);
    let read = Arc::new(AtomicUsize::new(0));
    let columns = Stored::open(Counted(bytes, Arc::clone(&read)), &index).unwrap();
    for (every, from, to, blocks) in [(1000, 0.0, f64::INFINITY, 600), (1, 800.0, 1600.0, 3 * 150), (1, 9.0, 9.0, 3)] {
        let every = NonZeroUsize::new(every).unwrap();
        read.store(0, Relaxed);
        let selection = Excerpt { fields: None, from, to, every }.of(&columns).unwrap();
        selection.block(&columns, selection.rows).unwrap();
        // The rows are found by two bisections of the times, each of which reads a number of blocks that is the
        // base-two logarithm of the number of all blocks of the times.
        let (found, searches) = (read.load(Relaxed) / 512, 2 * 13);
        assert!(found <= blocks + searches, "{found} blocks for {} rows", selection.rows.len());
    }
}

#[test]
fn the_json_of_stored_columns_is_that_of_the_solution() {
    for rows in [0, 1, 3, BLOCK - 1, BLOCK, CHUNK, 2 * CHUNK + 5] {
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
    for (bytes, index) in [stored(&solution), in_chunks(&solution)] {
        excerpts_are_those_of_the_trajectory(&solution, &Stored::open(bytes, &index).unwrap());
    }
}

fn excerpts_are_those_of_the_trajectory(solution: &Solution, columns: &Stored) {
    let names = [None, Some(vec!["x".to_owned()])];
    let distances = [1, 7, BLOCK - 1, BLOCK, 10 * BLOCK, CHUNK - 1, CHUNK, 2 * CHUNK + 1, usize::MAX];
    for (every, fields) in distances.iter().zip(names.iter().cycle()) {
        for (from, to) in [(f64::NEG_INFINITY, f64::INFINITY), (1000.0, 2500.3), (1024.0, 1024.0), (9.0, 2.0)] {
            let every = NonZeroUsize::new(*every).unwrap();
            let excerpt = Excerpt { fields: fields.clone(), from, to, every };
            let selection = excerpt.of(columns).unwrap();
            assert_eq!(selection, excerpt.of(&solution.trajectory).unwrap());
            selection.verify(columns).unwrap();
            let part = |columns: &dyn Columns| selection.block(columns, selection.rows).unwrap();
            assert_eq!(part(columns), part(&solution.trajectory));
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
        (0..rows)
            .for_each(|row| words.push((row % 3 > 0).then_some(["", "a>\"b", "\"table\":{\"columns\":{}"][row % 3])));
        let table = Table {
            columns: vec![
                column("member", Values::Counts((0..rows as u32).collect())),
                column(
                    "x",
                    Values::Numbers((0..rows).map(|k| if k % 7 == 0 { f64::NAN } else { -0.1 * k as f64 }).collect()),
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
    for place in [0, 8 * BLOCK, 8 * CHUNK, columns - 9, columns - 1] {
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
