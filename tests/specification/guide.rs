//! The specifications in the guide: each one is solved, and the verdict trusts its result.

use dvi::problem::Control;
use dvi::solution::Status;
use dvi::specification::Specification;
use std::fs;

#[test]
fn every_specification_of_the_guide_runs_and_is_trusted() {
    let mut count = 0;
    for entry in fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/api/guide")).unwrap() {
        let path = entry.unwrap().path();
        let text = fs::read_to_string(&path).unwrap();
        for block in text.split("```json\n").skip(1).filter_map(|rest| rest.split("\n```").next()) {
            let specification = Specification::from_json(block.as_bytes())
                .unwrap_or_else(|errors| panic!("{path:?}: {block}\n{errors:#?}"));
            let solution = dvi::solve(&specification, &Control::new());
            assert_eq!(solution.status, Status::Completed, "{path:?}: {block}\n{:?}", solution.error);
            assert!(solution.verdict.trusted, "{path:?}: {block}\n{:?}", solution.verdict);
            count += 1;
        }
    }
    assert!(count >= 20, "{count}");
}
