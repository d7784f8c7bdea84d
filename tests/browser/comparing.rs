//! Comparison of the results of two jobs on the web page of the service.

use crate::driver::Page;
use serde_json::json;

fn decay(rate: u32, count: u32) -> String {
    format!(
        r#"{{"label":"Rate {rate}","problem":{{"dvi":{{"states":{{"x":{{"initial":1,"rate":"-{rate}*x"}}}}}}}},
        "time":{{"end":1}},"method":{{"rtol":1e-9}},"output":{{"times":{{"count":{count}}}}}}}"#
    )
}

#[test]
fn two_jobs_are_drawn_together_with_their_difference() {
    let page = Page::open("comparing", "/");
    page.solve(&decay(2, 1001));
    page.solve(&decay(1, 1001));
    page.tab_to("#other");
    page.press("ArrowDown", false);
    page.wait("document.querySelectorAll('#plots .difference').length === 1");
    // The difference of the two solutions, exp(-t) - exp(-2 t), has its maximum 1/4 at t = ln 2.
    assert_eq!(page.text("#plots .difference"), "largest difference 0.25");
    assert_eq!(page.value("document.querySelector('#evidence tr').children.length"), 3, "a column of evidence a job");
    page.picture("page_compared");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn what_is_at_other_times_is_compared_over_the_times_of_both() {
    let page = Page::open("differences", "/");
    let differences = "import('/page/comparison.js').then(({largestDifference: d}) => [
        d([0, 1, 2], [0, 1, 2], [0, 2], [0, 2]),
        d([0, 1, 2], [0, 5, 2], [0, 2], [0, 2]),
        d([0, 1, 2], [9, 1, 9], [0.5, 1.5], [0, 1]),
        d([0, 1], [0, 0], [2, 3], [0, 0]),
        d([0, 1], [1, 1], [1], [4]),
    ])";
    // Third case of two polygons that are compared: at t = 1, the line through (0, 0) and (2, 2) has the value 1, and
    // the line through (0.5, 0) and (1.5, 1) has the value 0.5.
    assert_eq!(page.value(differences), json!([0, 4, 0.5, null, 3]));
}
