//! Problems of the collection MCPLIB (Dirkse and Ferris 1995), solved from the starting points from which PATH solves
//! them. Each data file names its source and has the solution to its last digits, which was found independently.

use crate::systems::harness::solve;
use serde_json::Value;

const PROBLEMS: [(&str, &str); 8] = [
    ("hansmcp", include_str!("mcplib/hansmcp.json")),
    ("harkmcp_cspe2", include_str!("mcplib/harkmcp_cspe2.json")),
    ("hydroc06", include_str!("mcplib/hydroc06.json")),
    ("hydroc20", include_str!("mcplib/hydroc20.json")),
    ("methan08", include_str!("mcplib/methan08.json")),
    ("scarfmcp", include_str!("mcplib/scarfmcp.json")),
    ("two3mcp", include_str!("mcplib/two3mcp.json")),
    ("wallmcp", include_str!("mcplib/wallmcp.json")),
];

/// Solves the complementarity problem of a data file, and asserts that the result is the solution in that file.
fn assert_solved(name: &str, specification: &Value, exact: &Value) {
    let mut solution = solve(specification);
    assert!(solution.verdict.trusted, "{name}: {:?}", solution.verdict);
    let found = solution.solution.take().expect("a solution");
    for (variable, exact) in exact.as_object().expect("values by name") {
        let (value, exact) = (found.z[variable], exact.as_f64().expect("a number"));
        assert!((value - exact).abs() <= 1e-11 * exact.abs().max(1.0), "{name}, {variable}: {value} for {exact}");
    }
}

#[test]
fn problems_of_the_collection_are_solved_from_their_starts() {
    for (name, text) in PROBLEMS {
        let problem: Value = serde_json::from_str(text).expect("JSON");
        assert_solved(name, &problem["specification"], &problem["solution"]);
    }
}

/// In the model economy of Scarf and Hansen a household owns one unit of labour, so that the price of labour is its
/// published income.
#[test]
fn the_economy_of_scarf_and_hansen_has_its_published_income() {
    let problem: Value = serde_json::from_str(include_str!("mcplib/hansmcp.json")).expect("JSON");
    let found = solve(&problem["specification"]).solution.expect("a solution");
    assert!((found.z["p_labor"] - 0.587_581_431_692_033_5).abs() < 1e-12, "{:?}", found.z["p_labor"]);
}
