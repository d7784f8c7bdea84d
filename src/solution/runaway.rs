//! States that diverge: at the end of a run they change by their own size in less time than the accuracy of the time,
//! as near a pole of the solution, which may lie before the end.
//!
//! With an error of time of `rtol` times the length `T` of the run, a state that never exceeded `X` is off by
//!
//! ```text
//! |x'| rtol T = kappa rtol X,    kappa = |x'| T/X
//! ```
//!
//! so that no digit is known where `kappa rtol` is near one. A long oscillation also has a large `kappa`, but takes
//! as many steps.

use super::{CheckCode, Checks, Plan};
use hybrid::OneStep;
use radau::Radau;

/// Relative error of a state at which no digit of it is known.
const NO_DIGIT: f64 = 0.1;

/// Largest angle, in radians, of an oscillation per step: a state that changes faster than this angle times the
/// number of steps does not oscillate.
const TURN: f64 = 10.0;

/// Records the check of the state that changes fastest, relative to its size, at the end of a run with `accepted`
/// steps.
pub(super) fn check(radau: &Radau<'_>, plan: &Plan, (rtol, atol): (f64, &[f64]), accepted: u64, checks: &mut Checks) {
    let (t, length) = (radau.t(), radau.t() - plan.start);
    // A state below its absolute tolerance counts as zero.
    let sizes = radau.largest().iter().zip(atol).map(|(largest, atol)| largest.max(atol / rtol));
    let kappas = radau.slopes_at(t).into_iter().zip(sizes).map(|(rate, size)| rate.abs() * length / size);
    let worst = kappas.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((state, kappa)) = worst else { return };
    let allowed = (NO_DIGIT / rtol).max(TURN * accepted as f64);
    if kappa <= allowed {
        return;
    }
    checks.record(CheckCode::GlobalError, kappa, allowed, || {
        let name = plan.names.get(state).map_or("a state", String::as_str);
        format!(
            "`{name}` changes by its own size within {:.1e} of the end, {:.0e} of the run: hardly a digit of its value there is known, as near a \
             pole, which may lie before the end; end the run earlier",
            length / kappa,
            kappa.recip()
        )
    });
}
