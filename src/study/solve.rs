//! Solves a specification, including its study or sweep.

use crate::{study, sweep};
use problem::Control;
use solution::Solution;
use specification::Specification;
use std::num::NonZeroUsize;

/// Solves a checked specification. Stops at the next step if `control` asks for it; never panics on a user's input.
pub fn solve(specification: &Specification, control: &Control) -> Solution {
    solve_on(NonZeroUsize::MIN, specification, control)
}

/// Solves a checked specification with several threads for the members of a sweep. The answer does not depend on the
/// number of threads.
pub fn solve_on(threads: NonZeroUsize, specification: &Specification, control: &Control) -> Solution {
    let mut solution = match (specification.sweep(), specification.study()) {
        (Some(plan), _) => sweep(specification, plan.chunk().members, threads, control),
        (None, None) => solve_once(specification, control),
        (None, Some(plan)) => {
            let solution = control.part(0.0..FIRST, || solve_once(specification, control));
            let study = control.part(FIRST..1.0, || study(specification, plan, control));
            Solution { study: Some(study), ..solution }
        }
    };
    // A sweep needs no provenance here: its table has one, which is equal for all parts of the sweep.
    if solution.table.is_none() {
        solution.provenance = Some(specification.provenance());
    }
    solution
}

/// Approximate share of the progress of a work-precision study that its main solve takes.
const FIRST: f64 = 0.1;

/// Solves a specification once, without its work-precision study.
pub(crate) fn solve_once(specification: &Specification, control: &Control) -> Solution {
    let (model, plan) = (specification.model(), specification.plan());
    let mut solution = model.run(specification, &plan, control);
    solution.diagnostics.warnings.extend(specification.warnings().cloned());
    solution.judge(requested_end(specification));
    solution
}

/// Returns the end time that a specification asks for; `None` if it asks for a search.
pub(crate) fn requested_end(specification: &Specification) -> Option<f64> {
    let is_search = specification.search().is_some() || specification.problem() == "vi";
    (!is_search).then_some(specification.time().end)
}
