//! The verdict on a solution: for people, as a line for each reason and caveat, and for scripts, as an exit code.

use super::{UNFINISHED, UNTRUSTED};
use dvi::solution::{CheckCode, Verdict};
use std::fmt::Write as _;
use std::process::ExitCode;

/// Returns the exit code of a solve; not reaching the end time takes precedence over an untrusted solution. The
/// verdict may be absent, from a service of another version.
pub fn exit_code(reached_end: bool, verdict: Option<&Verdict>) -> ExitCode {
    ExitCode::from(code(reached_end, verdict))
}

/// Returns the exit code of a solve as a number, which unlike `ExitCode` can be compared.
pub fn code(reached_end: bool, verdict: Option<&Verdict>) -> u8 {
    match verdict {
        _ if !reached_end => UNFINISHED,
        Some(verdict) if !verdict.trusted => UNTRUSTED,
        Some(_) | None => 0,
    }
}

/// Formats the reasons against the solution, and its caveats, a line each. The reason for not reaching the end time
/// is reported elsewhere.
pub fn lines(verdict: &Verdict) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    for reason in verdict.because.iter().filter(|reason| reason.code != CheckCode::NotAtEnd) {
        let _ = writeln!(text, "dvi: not trusted: {reason}");
    }
    for caveat in &verdict.caveats {
        let _ = writeln!(text, "dvi: caveat: {}", caveat.message);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use dvi::solution::{Caveat, Reason};

    fn untrusted() -> Verdict {
        let reason = |code, value, message: &str| Reason { code, value, allowed: 1e-3, message: message.to_owned() };
        let because = vec![
            reason(
                CheckCode::JointDrift,
                0.0312,
                "the hinge of `arm` is 3.12 cm apart at t = 0.5; take a smaller step",
            ),
            reason(CheckCode::NotAtEnd, 0.5, "the run ended at t = 0.5"),
        ];
        let message = "a solution, not certified to be the only one".to_owned();
        Verdict { trusted: false, because, caveats: vec![Caveat { code: "not_certified".to_owned(), message }] }
    }

    #[test]
    fn each_reason_and_each_caveat_has_a_line() {
        let told = "\
dvi: not trusted: joint drift 3.12e-2, allowed 1e-3: the hinge of `arm` is 3.12 cm apart at t = 0.5; take a smaller step
dvi: caveat: a solution, not certified to be the only one
";
        assert_eq!(lines(&untrusted()), told);
        assert_eq!(lines(&Verdict { trusted: true, ..Verdict::default() }), "");
    }

    #[test]
    fn the_end_that_was_not_reached_goes_before_the_answer_that_is_not_trusted() {
        let trusted = Verdict { trusted: true, ..Verdict::default() };
        let codes = [
            (exit_code(true, Some(&trusted)), ExitCode::SUCCESS),
            (exit_code(true, Some(&untrusted())), ExitCode::from(7)),
            (exit_code(false, Some(&untrusted())), ExitCode::from(1)),
            (exit_code(true, None), ExitCode::SUCCESS),
        ];
        assert!(codes.iter().all(|(found, right)| found == right), "{codes:?}");
    }
}
