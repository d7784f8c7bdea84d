//! Work-precision studies (error against run time) as the page shows them, and as SVG pictures of their own.

use crate::driver::Page;
use dvi::solution::pictures::work_precision;
use dvi::solution::{Series, Status, StudyRun};
use serde_json::json;
use std::path::PathBuf;

/// Specification of a work-precision study of `x' = -x` with two tolerances and two numbers of stages.
const STUDY: &str = r#"{"label":"Decay","problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-x"}}}},"time":{"end":1},
"study":{"rtol":[1e-3,1e-6],"stages":[3,"auto"],"exact":{"x":"exp(-t)"}}}"#;

const PLAIN: &str = r#"{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-x"}}}},"time":{"end":1}}"#;

#[test]
fn a_study_is_shown_as_a_picture_and_in_numbers() {
    let page = Page::open("studies", "/");
    page.solve(STUDY);
    page.wait("document.querySelector('#study img')?.complete");
    let image = "document.querySelector('#study img').naturalWidth";
    assert!(page.value(image).as_f64().unwrap() >= 700.0, "the picture is read as one");
    page.tab_to("#study summary");
    page.press("Enter", false);
    for scheme in ["light", "dark"] {
        let features = json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]});
        page.call("Emulation.setEmulatedMedia", features);
        page.picture(&format!("study_{scheme}"));
    }
    let numbers = page.text("#study table");
    assert!(numbers.contains("rrors against the exact values"), "{numbers}");
    let rows: Vec<&str> = numbers.lines().filter(|line| line.contains("stages")).collect();
    assert_eq!(rows.len(), 4, "{numbers}");
    assert!(rows.iter().all(|row| row.contains(" ms") || row.contains(" µs")), "{numbers}");
    page.solve(PLAIN);
    page.wait("document.getElementById('study').children.length === 0");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

/// A JavaScript expression for the texts of an SVG picture that extend beyond its left or right edge.
const OUTSIDE: &str = "(() => {
    const {width} = document.documentElement.viewBox.baseVal;
    return [...document.querySelectorAll('text')]
        .filter((text) => { const box = text.getBBox(); return box.x < 0 || box.x + box.width > width; })
        .map((text) => text.textContent);
})()";

#[test]
fn no_name_of_many_methods_runs_out_of_the_picture() {
    let run = |wall_seconds, error| StudyRun {
        rtol: None,
        step: Some(error),
        status: Status::Completed,
        trusted: Some(error < 1e-4),
        steps: 1,
        wall_seconds,
        error_at_end: Some(error),
        largest_error: None,
        order: None,
    };
    let methods =
        ["3 stages", "stages chosen", "WWWWWWWWW by WWWWWWWWWW", "2 stages at fixed steps", "SciPy BDF with events"];
    let series: Vec<Series> = (0..14)
        .map(|k| {
            let runs = vec![run(1e-4, 1e-2 / f64::from(k + 1)), run(1e-3, 1e-6 / f64::from(k + 1))];
            Series { method: methods[k as usize % methods.len()].to_owned(), runs }
        })
        .collect();
    let picture = work_precision(&series, Some("Fourteen methods"), "a run with the relative tolerance 1e-11");
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("methods.svg");
    std::fs::write(&file, picture).unwrap();
    let page = Page::open("methods", "/");
    page.call("Page.navigate", json!({"url": format!("file://{}", file.display())}));
    page.wait("document.documentElement.localName === 'svg' && document.querySelectorAll('text').length > 5");
    page.picture("methods");
    assert_eq!(page.value(OUTSIDE), json!([]));
}
