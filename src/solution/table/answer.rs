//! The answer of a sweep from its table: totals, verdict and summary.

use super::{Table, Values};
use crate::columnar::Members;
use crate::summary::summary;
use crate::{CheckCode, Failure, Solution, Status};
use std::io;

/// The reason why the table of a sweep has fewer rows than members were requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Incomplete<'a> {
    /// A code of the reason why rows are missing, for programs.
    pub code: &'static str,
    /// The reason why rows are missing, in words.
    pub why: &'a str,
}

impl Incomplete<'static> {
    /// The sweep reached its wall-clock limit.
    pub const WALL_TIME: Self = Self { code: "wall_time", why: "the wall time allowed ended" };
    /// The user cancelled the sweep.
    pub const CANCELLED: Self = Self { code: "cancelled", why: "the sweep was cancelled" };
    /// Too many members made their worker processes crash.
    pub const MEMBERS_LOST: Self = Self { code: "members_lost", why: "too many members took their workers down" };
    /// Parts of the sweep are missing.
    pub const MEMBERS_MISSING: Self = Self { code: "members_missing", why: "parts are missing" };
}

impl Table {
    /// Returns the answer to a sweep of which `asked` members were requested; `incomplete` is the reason if there are
    /// fewer rows.
    pub fn into_answer(self, asked: usize, incomplete: Incomplete<'_>) -> Solution {
        // Reading a table in memory cannot fail.
        let answer = answer(&self, asked, incomplete).unwrap_or_default();
        Solution { table: Some(self), ..answer }
    }
}

/// Returns the answer that belongs to a table, in memory or on disk; the `table` of the answer has no rows.
///
/// # Errors
/// Errors of reading the table.
pub fn answer(members: &dyn Members, asked: usize, incomplete: Incomplete<'_>) -> io::Result<Solution> {
    let (mut solution, mut rows) = (Solution::default(), 0);
    members.visit("member", |values| rows += values.len())?;
    if rows < asked {
        let Incomplete { code, why } = incomplete;
        let message = format!("{why}: {rows} of {asked} members were done; the table has their rows");
        solution.error = Some(Failure { code: code.into(), message, time: 0.0, state: Vec::new() });
        solution.status = Status::Stopped;
    }
    let total = |name: &str| -> io::Result<u64> {
        let mut total = 0;
        members.visit(name, |values| {
            total += (0..values.len()).filter_map(|row| values.number(row)).map(|count| count as u64).sum::<u64>();
        })?;
        Ok(total)
    };
    let diagnostics = &mut solution.diagnostics;
    diagnostics.method = "sweep";
    (diagnostics.steps.accepted, diagnostics.switches) = (total("steps")?, total("switches")?);
    judge(members, rows, &mut solution)?;
    solution.summary = Some(summary(members)?);
    solution.table = Some(members.head().head());
    solution.judge(Some(0.0));
    for reason in solution.verdict.because.iter_mut().filter(|reason| reason.code == CheckCode::NotAtEnd) {
        reason.value = asked.saturating_sub(rows) as f64;
        reason.message = format!("{rows} of {asked} members were done");
    }
    Ok(solution)
}

/// Records the numbers of members of the sweep that are not trusted, and that failed, in the answer.
fn judge(members: &dyn Members, rows: usize, solution: &mut Solution) -> io::Result<()> {
    let checks = &mut solution.diagnostics.checks;
    let untrusted = untrusted(members)?;
    checks.record(CheckCode::UntrustedMembers, untrusted as f64, 0.0, || {
        format!("{untrusted} of {rows} members are not trusted: see `trusted` and `warnings` in their rows")
    });
    let failed = members.head().failed;
    if failed > 0 {
        let message = format!("{failed} of {rows} members failed: see `status` and `error` in their rows");
        checks.caveat("failed_members", message);
    }
    Ok(())
}

/// Returns the number of members of the sweep that reached their end and are not trusted.
fn untrusted(members: &dyn Members) -> io::Result<u64> {
    let place = |name: &str| members.head().columns.iter().position(|column| column.name == name);
    let (Some(trusted), Some(status)) = (place("trusted"), place("status")) else { return Ok(0) };
    let mut untrusted = 0;
    for part in 0..members.parts() {
        let (trusted, status) = (members.values(part, trusted)?, members.values(part, status)?);
        let Values::Flags(trusted) = trusted else { continue };
        let is_untrusted = |row: &usize| !trusted[*row] && status.word(*row) == Some("completed");
        untrusted += (0..trusted.len()).filter(is_untrusted).count() as u64;
    }
    Ok(untrusted)
}
