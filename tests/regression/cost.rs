//! The cost of every example and of every reference problem, compared with a committed table: a run that does more or
//! less work fails until the table is written anew.
//!
//! Runs are deterministic: neither the build profile, nor the given memory, nor tests that run at the same time
//! change a count. But linear algebra and the C library choose their kernels by the instructions of the processor,
//! which round differently, and this occasionally decides whether a step is accepted. Therefore the table names the
//! processor on which it was written; on another processor, counts may differ by a small fraction.

use crate::reference::{example, read, smooth, switching};
use dvi::problem::Control;
use dvi::solution::Solution;
use dvi::specification::{EXAMPLES, Specification};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::{env, fs};

const TABLE: &str = "tests/regression/cost.txt";

const ACCEPT: &str = "if that is meant, write the table anew and commit it with the change that explains it:\n    \
                      UPDATE=1 cargo test --test regression cost";

/// The names of the columns of the cost table, which lists the work of the solver for each problem.
const COLUMNS: [&str; 9] =
    ["accepted", "rejected", "newton", "rates", "jacobians", "factorisations", "vi_solves", "vi_pivots", "switches"];

/// Widths in characters: of the cost table's column of problem names, and the smallest one of its other columns; a
/// column with a longer heading is as wide as its heading.
const NAME: usize = 37;
const CELL: usize = 8;

/// Permitted relative difference of a count of work on a processor with other instructions than the one of the table.
/// Measured with a C library without fused multiplication: 5 % of the rejected steps of the ring modulator, and less
/// than 3 % of all other counts.
const OTHER_PROCESSOR: f64 = 0.1;

/// The counts of work of a solve, in the order of [`COLUMNS`].
type Counts = [u64; COLUMNS.len()];

fn counts(solution: &Solution) -> Counts {
    let diagnostics = &solution.diagnostics;
    let (steps, evaluations) = (&diagnostics.steps, diagnostics.evaluations);
    let (solves, pivots) = diagnostics.vi.as_ref().map_or((0, 0), |vi| (vi.solves, vi.pivots));
    [
        steps.accepted,
        steps.rejected,
        diagnostics.newton_iterations,
        evaluations.rates,
        evaluations.jacobians,
        evaluations.factorisations,
        solves,
        pivots,
        diagnostics.switches,
    ]
}

/// Returns all problems of the cost table: their names, which tell their sources, and their specifications as text,
/// since the order of JSON members is part of a problem.
fn problems() -> Vec<(String, String)> {
    let examples = EXAMPLES.iter().map(|given| (format!("example {}", given.name), given.text.to_owned()));
    let stiff = read("tests/reference/smooth.json")["problems"].take();
    let stiff = stiff.as_array().expect("problems").iter().map(|problem| {
        let mut specification = smooth(problem);
        let factor = problem["atol_factor"].as_f64().expect("a factor");
        specification["method"] = json!({"rtol": 1e-6, "atol": 1e-6 * factor});
        (format!("smooth {}", problem["name"].as_str().expect("a name")), specification.to_string())
    });
    // The published examples of the systems in this list have output times within steps, and tolerances of their own;
    // for the cost table they are solved with a single output at the end and default tolerances.
    let switched = [
        ("diode_bridge", "diode_bridge"),
        ("diode_bridge_filter", "diode_bridge_filter"),
        ("friction_oscillator_belt", "friction_belt"),
        ("sliding_mode", "sliding_mode"),
        ("switching_circle", "switching_circle"),
    ];
    let switched = switched.into_iter().map(|(name, file)| {
        let mut specification = example(file);
        specification["time"]["end"] = switching(name)["T"].clone();
        specification["method"] = json!({});
        specification["output"] = json!({"times": [switching(name)["T"]]});
        (format!("switching {name}"), specification.to_string())
    });
    examples.chain(stiff).chain(switched).collect()
}

fn measure(specification: &str) -> Counts {
    let specification = Specification::from_json(specification.as_bytes()).expect("a specification");
    counts(&dvi::solve(&specification, &Control::new()))
}

/// Returns the processor's architecture and those of its instructions that determine the choice of linear algebra
/// kernels.
fn processor() -> String {
    #[cfg(target_arch = "x86_64")]
    let found = [
        ("fma", is_x86_feature_detected!("fma")),
        ("avx2", is_x86_feature_detected!("avx2")),
        ("avx512f", is_x86_feature_detected!("avx512f")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let found: [(&str, bool); 0] = [];
    let mut name = env::consts::ARCH.to_owned();
    for (instructions, _) in found.into_iter().filter(|(_, has)| *has) {
        name += &format!(" {instructions}");
    }
    name
}

fn row(name: &str, cells: impl Iterator<Item = String>) -> String {
    let mut line = format!("{name:NAME$}");
    for (cell, column) in cells.zip(COLUMNS) {
        write!(line, "  {cell:>0$}", column.len().max(CELL)).expect("text has room");
    }
    line + "\n"
}

fn table(found: &BTreeMap<String, Counts>) -> String {
    let mut text = format!("processor: {}\n\n", processor());
    text += &row("", COLUMNS.into_iter().map(str::to_owned));
    for (name, counts) in found {
        text += &row(name, counts.iter().map(u64::to_string));
    }
    text
}

/// Returns the processor on which a cost table was written, and the rows of the table by the names of problems.
fn parse(text: &str) -> (String, BTreeMap<String, Counts>) {
    let processor = text.lines().next().and_then(|line| line.strip_prefix("processor: ")).expect("the processor");
    let rows = text.lines().skip(3).map(|line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let (name, cells) = words.split_at(words.len() - COLUMNS.len());
        let cells: Vec<u64> = cells.iter().map(|cell| cell.parse().expect("a count")).collect();
        (name.join(" "), cells.try_into().expect("a count in each column"))
    });
    (processor.to_owned(), rows.collect())
}

/// Returns, as text, the counts of a run that differ from the expected ones by more than the relative difference
/// `allowed`, if any.
fn differences(expected: &Counts, found: &Counts, allowed: f64) -> Option<String> {
    let cells = expected.iter().zip(found).zip(COLUMNS);
    let changed =
        cells.filter(|((expected, found), _)| expected.abs_diff(**found) as f64 > (allowed * **expected as f64).ceil());
    let texts: Vec<String> =
        changed.map(|((expected, found), column)| format!("{column} {expected} -> {found}")).collect();
    (!texts.is_empty()).then(|| texts.join(", "))
}

#[test]
fn every_solve_costs_what_the_table_says() {
    let found: BTreeMap<String, Counts> =
        problems().into_iter().map(|(name, specification)| (name, measure(&specification))).collect();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(TABLE);
    if env::var_os("UPDATE").is_some() {
        fs::write(file, table(&found)).expect("a file that can be written");
        return;
    }
    let (written_on, expected) = parse(&fs::read_to_string(file).expect("the table"));
    let allowed = if written_on == processor() { 0.0 } else { OTHER_PROCESSOR };
    let mut changes = String::new();
    for (name, counts) in &found {
        let change = match expected.get(name) {
            Some(row) => differences(row, counts, allowed),
            None => Some("is not in the table".to_owned()),
        };
        if let Some(change) = change {
            writeln!(changes, "  {name}: {change}").expect("text has room");
        }
    }
    for name in expected.keys().filter(|name| !found.contains_key(*name)) {
        writeln!(changes, "  {name}: is in the table alone").expect("text has room");
    }
    assert!(changes.is_empty(), "the cost differs from {TABLE}:\n{changes}{ACCEPT}");
}
