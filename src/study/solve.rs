//! A specification solved, with its study where it asks for one.

use crate::{study, sweep};
use problem::Control;
use solution::Solution;
use specification::Specification;
use std::num::NonZeroUsize;

/// Solves a checked specification. Stops at the next step when `control` says so; never panics on a user's input.
pub fn solve(specification: &Specification, control: &Control) -> Solution {
    solve_on(NonZeroUsize::MIN, specification, control)
}

/// The same, with so many threads for the members of a sweep. The answer does not depend on their number.
pub fn solve_on(threads: NonZeroUsize, specification: &Specification, control: &Control) -> Solution {
    let mut solution = match (specification.sweep(), specification.study()) {
        (Some(plan), _) => sweep(specification, 0..plan.members(), threads, control),
        (None, None) => solve_once(specification, control),
        (None, Some(plan)) => {
            let solution = control.part(0.0..FIRST, || solve_once(specification, control));
            let study = control.part(FIRST..1.0, || study(specification, plan, control));
            Solution { study: Some(study), ..solution }
        }
    };
    // The table of a sweep has its own, which its parts share.
    if solution.table.is_none() {
        solution.provenance = Some(specification.provenance());
    }
    solution
}

/// The part of the work of a study that the solve as it is asked for makes up, about.
const FIRST: f64 = 0.1;

/// One solve, without a study.
pub(crate) fn solve_once(specification: &Specification, control: &Control) -> Solution {
    let (model, plan) = (specification.model(), specification.plan());
    let mut solution = model.run(specification, &plan, control);
    solution.diagnostics.warnings.extend(specification.warnings().cloned());
    let end = solution.orbit.as_ref().map_or(plan.end, |orbit| plan.start + orbit.period);
    solution.judge(end);
    solution
}
