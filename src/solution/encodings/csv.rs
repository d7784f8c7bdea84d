//! CSV (RFC 4180, with lines ended by a line feed): the header `t,name,...`, then one row per time.

use super::Table;
use crate::Trajectory;
use std::io::{self, Write};
use std::ops::Range;

/// Writes a trajectory as CSV.
#[derive(Clone, Copy, Debug)]
pub struct Csv;

impl Table for Csv {
    fn begin(&mut self, trajectory: &Trajectory, out: &mut dyn Write) -> io::Result<()> {
        out.write_all(b"t")?;
        for field in &trajectory.fields {
            out.write_all(b",")?;
            write_text(&field.name, out)?;
        }
        out.write_all(b"\n")
    }

    fn rows(&mut self, trajectory: &Trajectory, times: Range<usize>, out: &mut dyn Write) -> io::Result<()> {
        for (row, t) in trajectory.t.iter().enumerate().take(times.end).skip(times.start) {
            serde_json::to_writer(&mut *out, t)?;
            for field in &trajectory.fields {
                out.write_all(b",")?;
                if let Some(value) = field.values.get(row) {
                    serde_json::to_writer(&mut *out, value)?;
                }
            }
            out.write_all(b"\n")?;
        }
        Ok(())
    }

    fn end(&mut self, _: &mut dyn Write) -> io::Result<()> {
        Ok(())
    }
}

/// Writes a text field, quoted where RFC 4180, section 2, requires it.
pub(super) fn write_text(text: &str, out: &mut (impl Write + ?Sized)) -> io::Result<()> {
    if text.contains(['"', ',', '\n', '\r']) {
        write!(out, "\"{}\"", text.replace('"', "\"\""))
    } else {
        out.write_all(text.as_bytes())
    }
}
