//! JSON lines (`application/x-ndjson`): one object `{"t":...,"name":...}` per time, each on its own line.

use super::Table;
use crate::Trajectory;
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::io::{self, Write};
use std::ops::Range;

/// Writes a trajectory as JSON lines.
#[derive(Clone, Copy, Debug)]
pub struct Lines;

impl Table for Lines {
    fn begin(&mut self, _: &Trajectory, _: &mut dyn Write) -> io::Result<()> {
        Ok(())
    }

    fn rows(&mut self, trajectory: &Trajectory, times: Range<usize>, out: &mut dyn Write) -> io::Result<()> {
        for row in times {
            serde_json::to_writer(&mut *out, &Line { trajectory, row })?;
            out.write_all(b"\n")?;
        }
        Ok(())
    }

    fn end(&mut self, _: &mut dyn Write) -> io::Result<()> {
        Ok(())
    }
}

struct Line<'a> {
    trajectory: &'a Trajectory,
    row: usize,
}

impl Serialize for Line<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut line = serializer.serialize_map(Some(self.trajectory.fields.len() + 1))?;
        line.serialize_entry("t", &self.trajectory.t[self.row])?;
        for field in &self.trajectory.fields {
            line.serialize_entry(&field.name, &field.values.get(self.row))?;
        }
        line.end()
    }
}
