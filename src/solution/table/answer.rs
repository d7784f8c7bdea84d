//! The answer that a table of members is: its totals, its verdict and its summary.

use super::Table;
use crate::{CheckCode, Failure, Solution, Status};

/// Why a table has fewer rows than members were asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Incomplete<'a> {
    /// A word for programs.
    pub code: &'static str,
    /// The same for people.
    pub why: &'a str,
}

impl Incomplete<'static> {
    /// The wall time ended.
    pub const WALL_TIME: Self = Self { code: "wall_time", why: "the wall time allowed ended" };
    /// The sweep was cancelled.
    pub const CANCELLED: Self = Self { code: "cancelled", why: "the sweep was cancelled" };
    /// Too many members took their workers down.
    pub const MEMBERS_LOST: Self = Self { code: "members_lost", why: "too many members took their workers down" };
    /// Parts of the sweep are missing.
    pub const MEMBERS_MISSING: Self = Self { code: "members_missing", why: "parts are missing" };
}

impl Table {
    /// The answer to a sweep of which `asked` members were asked for; `incomplete` says why there are fewer rows, where
    /// there are.
    pub fn into_answer(self, asked: usize, incomplete: Incomplete<'_>) -> Solution {
        let mut solution = Solution::default();
        let rows = self.rows();
        if rows < asked {
            let Incomplete { code, why } = incomplete;
            let message = format!("{why}: {rows} of {asked} members were done; the table has their rows");
            solution.error = Some(Failure { code: code.into(), message, time: 0.0, state: Vec::new() });
            solution.status = Status::Stopped;
        }
        let total = |name: &str| {
            let values = self.column(name);
            values.map_or(0, |values| {
                (0..values.len()).filter_map(|row| values.number(row)).map(|count| count as u64).sum()
            })
        };
        let diagnostics = &mut solution.diagnostics;
        diagnostics.method = "sweep";
        (diagnostics.steps.accepted, diagnostics.switches) = (total("steps"), total("switches"));
        self.judge(&mut solution);
        solution.summary = Some(self.summary());
        solution.table = Some(self);
        solution.judge(0.0);
        for reason in solution.verdict.because.iter_mut().filter(|reason| reason.code == CheckCode::NotAtEnd) {
            reason.value = asked.saturating_sub(rows) as f64;
            reason.message = format!("{rows} of {asked} members were done");
        }
        solution
    }

    /// Records how many members are not to be relied upon.
    fn judge(&self, solution: &mut Solution) {
        let checks = &mut solution.diagnostics.checks;
        let untrusted = self.untrusted();
        checks.record(CheckCode::UntrustedMembers, untrusted as f64, 0.0, || {
            format!(
                "{untrusted} of {} members are not trusted: see `trusted` and `warnings` in their rows",
                self.rows()
            )
        });
        if self.failed > 0 {
            let message =
                format!("{} of {} members failed: see `status` and `error` in their rows", self.failed, self.rows());
            checks.caveat("failed_members", message);
        }
    }
}
