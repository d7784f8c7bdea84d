//! The page solves while the user drags a slider, makes links that contain the specification, and marks results of an
//! earlier specification as old.

use crate::driver::{EDITOR, Page};
use serde_json::json;

/// Specification of `x' = -k x`, so that `x(1) = x0 exp(-k)`.
const DECAY: &str = r#"{"label":"Decay","problem":{"dvi":{"parameters":{"k":2},"states":{"x":{"initial":1,"rate":"-k*x"}}}},
"time":{"end":1},"method":{"rtol":1e-9},"output":{"times":{"count":11}}}"#;

/// Moves the slider of the parameter `name` to `value`, as a drag by the user does.
fn drag(page: &Page, name: &str, value: f64) {
    page.value(&format!(
        "(() => {{ const slider = document.querySelector('.knob input[type=range][aria-label={name:?}]');
            slider.value = {value}; slider.dispatchEvent(new Event('input')); }})()"
    ));
}

/// A JavaScript expression that is true if the result on the page belongs to the newest specification in the editor: no
/// result is marked as old or as being computed.
const ANSWERED: &str = "document.getElementById('before').hidden && document.getElementById('result').getAttribute('aria-busy') !== 'true'";

/// A JavaScript expression for the specification text in the editor.
const TEXT: &str = "[...document.getElementById('text').shadowRoot.querySelectorAll('.cm-line')].map((line) => line.textContent).join('\\n')";

/// Returns the final value of the field in the first plot of the page, read with the plot's cursor at its right edge.
fn shown_end(page: &Page) -> f64 {
    page.value("document.getElementById('plots').focus()");
    page.press("0", false);
    let left = "document.querySelector('#plots .u-over').clientWidth";
    page.value(&format!("(() => {{ const over = document.querySelector('#plots .u-over'), box = over.getBoundingClientRect();
        over.dispatchEvent(new MouseEvent('mousemove', {{clientX: box.left + {left} - 1, clientY: box.top + 20, bubbles: true}})); }})()"));
    page.wait("document.querySelector('#plots figcaption .first')?.textContent !== ''");
    page.text("#plots figcaption .first").parse().unwrap()
}

#[test]
fn a_slider_writes_its_number_and_the_answer_follows() {
    let page = Page::open("slider", "/");
    page.replace_text(DECAY);
    page.wait("document.querySelectorAll('.knob').length === 2");
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    for k in [1.0, 0.5, 3.0] {
        drag(&page, "k", k);
        let wanted = format!("{TEXT}.includes('\"k\":{k}')");
        page.wait(&wanted);
        page.wait(ANSWERED);
        let end = shown_end(&page);
        assert!((end - (-k).exp()).abs() < 1e-4, "x(1) = {end} where k is {k}");
    }
    // After a drag of the slider the plot still shows the previous curve, behind the new one, and neither the service
    // nor the browser keeps a job for the values passed during the drag.
    page.wait("fetch('/jobs').then((answer) => answer.json()).then(({jobs}) => jobs.length === 0)");
    assert_eq!(page.value("localStorage.getItem('jobs')"), json!(null));
    page.picture("page_slider");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn older_answers_are_never_shown_after_newer_ones() {
    let page = Page::open("newest", "/");
    page.replace_text(DECAY);
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    for k in 1..40 {
        drag(&page, "k", f64::from(k) / 10.0);
    }
    page.wait(ANSWERED);
    let end = shown_end(&page);
    assert!((end - (-3.9_f64).exp()).abs() < 1e-5, "{end}");
}

#[test]
fn a_link_carries_the_whole_specification_and_opens_with_its_answer() {
    let page = Page::open("link", "/");
    page.solve(DECAY);
    page.value("document.getElementById('share').click()");
    page.wait("location.hash.startsWith('#s=')");
    let link = page.value("location.pathname + location.hash");
    let other = Page::open("link-opened", "/");
    other.call("Page.navigate", json!({"url": "about:blank"}));
    other.go(link.as_str().unwrap());
    other.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    assert_eq!(other.text("#label"), "Decay");
    assert_eq!(other.value(TEXT), json!(DECAY));
    assert_eq!(other.complaints(), Vec::<String>::new());
}

#[test]
fn a_link_that_is_damaged_or_large_runs_nothing_and_says_so() {
    let page = Page::open("bad-link", "/#s=AAAA");
    page.wait("document.getElementById('message').textContent.includes('damaged')");
    let large = DECAY.replace("\"label\":\"Decay\"", &format!("\"label\":\"{}\"", "x".repeat(20_000)));
    let letters = format!("import('/page/share.js').then(({{packed}}) => packed({}))", json!(large));
    let letters = page.value(&letters);
    page.value(&format!("location.hash = '#s=' + {letters}"));
    page.wait("document.getElementById('before').textContent.includes('press Solve')");
    assert_eq!(page.value("document.getElementById('chosen').hidden"), true);
}

#[test]
fn an_answer_of_another_text_is_marked_as_old() {
    let page = Page::open("stale", "/");
    page.solve(DECAY);
    assert_eq!(page.value("document.getElementById('before').hidden"), true);
    page.replace_text(&DECAY.replace("-k*x", "-k*y"));
    page.wait(&format!("{EDITOR}.querySelectorAll('.marked').length > 0"));
    page.wait("document.getElementById('before').textContent.includes('has errors')");
    assert_eq!(page.value("document.getElementById('chosen').classList.contains('stale')"), true);
    page.replace_text(DECAY);
    page.wait("document.getElementById('before').hidden");
    page.picture("page_stale");
}

#[test]
fn what_takes_long_is_not_run_by_itself_for_long() {
    let page = Page::open("slow", "/");
    let endless = r#"{"problem":{"dvi":{"states":{"x":{"initial":0,"rate":"cos(1000*t)"}}}},"time":{"end":1e6},
        "output":{"times":{"count":11}}}"#;
    page.replace_text(endless);
    page.wait("document.getElementById('before').textContent.includes('press Solve')");
    // The service removes an unfinished job as soon as no client waits for it.
    page.wait("fetch('/jobs').then((answer) => answer.json()).then(({jobs}) => jobs.length === 0)");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn every_example_stands_in_the_gallery_with_its_text() {
    let page = Page::open("gallery", "/");
    page.wait("document.querySelectorAll('.card').length > 30");
    let untold = page.value("[...document.querySelectorAll('.card')].filter((card) => !card.querySelector('span')).map((card) => card.dataset.example)");
    assert_eq!(untold, json!([]), "examples without a text in gallery.js");
    let cards = page.value("document.querySelectorAll('.card').length");
    assert_eq!(cards, page.value("document.querySelectorAll('#example option').length - 1"));
    page.value("document.querySelector('.card[data-example=relay]').click()");
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    assert!(page.text("#label").starts_with("Relay"));
}

#[test]
fn jobs_of_this_client_are_listed_and_opened_with_their_specification() {
    let page = Page::open("jobtable", "/");
    page.solve(DECAY);
    page.value("document.getElementById('list').click()");
    page.wait("document.querySelectorAll('#jobtable tbody tr').length === 1");
    let row = page.text("#jobtable tbody tr");
    assert!(row.contains("Decay") && row.contains("successful") && row.contains("trusted"), "{row}");
    page.picture("page_jobs");
    page.go("/");
    page.value("document.getElementById('list').click()");
    page.wait("document.querySelectorAll('#jobtable tbody tr').length === 1");
    page.value("document.querySelector('#jobtable tbody a').click()");
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    assert_eq!(page.value(TEXT).as_str().unwrap().lines().next(), DECAY.lines().next(), "its text is in the editor");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn an_answer_of_an_unknown_kind_is_shown_as_a_table() {
    let page = Page::open("unknown", "/");
    let told = "import('/page/unknown.js').then(({unknownParts}) => unknownParts({version: 1, t: [], sweep: [{k: 1, end: 2}, {k: 2, end: null}],
        fit: {k: 3.5}, odd: [1, [2]], summary: {end: {count: 2, quantiles: {0.5: 0.25}}}}).map((part) => part.textContent))";
    let wanted = json!([
        "sweepkend122–",
        "fitvaluek3.5",
        "odd[\n  1,\n  [\n    2\n  ]\n]",
        "summaryvalueendcount 2, quantiles: 0.5 0.25"
    ]);
    assert_eq!(page.value(told), wanted);
}
