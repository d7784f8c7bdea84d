//! The page shows the verdict (whether the result is to be trusted) first, readable in the light and dark colour
//! schemes, and never shows that of another run.

use crate::driver::Page;
use serde_json::{Value, json};

const DECAY: &str =
    r#"{"label":"Decay","problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-x"}}}},"time":{"end":1}}"#;
const ENDLESS: &str = r#"{"label":"Endless","problem":{"dvi":{"states":{"x":{"initial":0,"rate":"cos(1000*t)"}}}},
    "time":{"end":1e6},"output":{"times":{"count":11}}}"#;

/// Replaces the verdict and the numerical checks in each result that the page receives from the service.
fn answer_with(page: &Page, verdict: &Value, checks: &Value) {
    page.value(&format!(
        "(() => {{
            const {{fetch}} = window;
            window.fetch = async (address, options) => {{
                const response = await fetch(address, options);
                if (!String(address).endsWith('/results')) return response;
                const result = await response.json();
                result.verdict = {verdict};
                result.diagnostics.checks = {checks};
                return Response.json(result);
            }};
        }})()"
    ));
}

fn doubt() -> (Value, Value) {
    let reason = |code: &str, value: f64, allowed: f64, message: &str| json!({"code": code, "value": value, "allowed": allowed, "message": message});
    let because = [
        reason(
            "joint_drift",
            0.0312,
            1e-3,
            "the hinge of <b>arm</b> is 3.12 cm apart at t = 0.5; take a smaller `step`",
        ),
        reason("energy_balance", f64::MAX, 1e-3, "the balance of energy is not finite from t = 0.7 on"),
    ];
    let caveat =
        json!({"code": "not_certified", "message": "this is a solution; it is not certified to be the only one"});
    let verdict = json!({"trusted": false, "because": because, "caveats": [caveat]});
    let checks = json!({
        "law_residual": {"value": 3e-10, "allowed": 1e-8},
        "joint_drift": {"value": 0.0312, "allowed": 1e-3},
        "energy_balance": {"value": f64::MAX, "allowed": 1e-3}
    });
    (verdict, checks)
}

/// A JavaScript expression for the smallest contrast between the text of the verdict (whether the result is to be
/// trusted) and its background (WCAG 2.2).
const CONTRAST: &str = "(() => {
    const luminance = (colour) => {
        const [r, g, b] = colour.match(/[0-9.]+/g).map(Number).map((c) => c / 255)
            .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const ground = (element) => {
        const {backgroundColor} = getComputedStyle(element);
        return /, 0\\)$/.test(backgroundColor) ? ground(element.parentElement) : luminance(backgroundColor);
    };
    const ratio = (element) => {
        const [ink, paper] = [luminance(getComputedStyle(element).color), ground(element)];
        return (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
    };
    return Math.min(...[...document.querySelectorAll('#verdict *')].map(ratio));
})()";

fn is_readable(page: &Page, name: &str) {
    for scheme in ["light", "dark"] {
        let features = json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]});
        page.call("Emulation.setEmulatedMedia", features);
        page.picture(&format!("verdict_{name}_{scheme}"));
        // WCAG level AA requires a contrast of 4.5 for text of normal size, here that of the verdict.
        let contrast = page.value(CONTRAST).as_f64().unwrap();
        assert!(contrast >= 4.5, "{name}, {scheme}: {contrast}");
    }
}

#[test]
fn an_answer_that_is_trusted_says_so_first() {
    let page = Page::open("trusted", "/");
    page.solve(DECAY);
    assert_eq!(page.text("#verdict .badge").replace('\n', ""), "✓Trusted");
    assert_eq!(page.value("document.querySelectorAll('#verdict li').length"), 0);
    let first = "document.getElementById('label').nextElementSibling === document.getElementById('verdict')";
    assert_eq!(page.value(first), true, "nothing stands between the name of a run and its verdict");
    is_readable(&page, "trusted");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn an_answer_that_is_not_trusted_says_why_each_value_beside_what_is_allowed() {
    let page = Page::open("untrusted", "/");
    let (verdict, checks) = doubt();
    answer_with(&page, &verdict, &checks);
    page.solve(DECAY);
    assert_eq!(page.text("#verdict .badge").replace('\n', ""), "✗Not trusted");
    let reasons = page.text("#verdict .reasons");
    for told in [
        "joint drift: 0.0312, allowed 0.001",
        "the hinge of <b>arm</b> is 3.12 cm apart at t = 0.5; take a smaller `step`",
        "energy balance: not finite, allowed 0.001",
    ] {
        assert!(reasons.split_whitespace().collect::<Vec<_>>().join(" ").contains(told), "{told} in {reasons}");
    }
    assert_eq!(page.text("#verdict .caveats"), "this is a solution; it is not certified to be the only one");
    assert_eq!(page.value("document.getElementById('verdict').getAttribute('role')"), "status");
    page.value("document.getElementById('raw').open = true");
    let evidence = page.text("#evidence");
    assert!(evidence.contains("law residual") && evidence.contains("3e-10, allowed 1e-8"), "{evidence}");
    let beyond = page.value("[...document.querySelectorAll('#evidence td.bad')].map((cell) => cell.textContent)");
    assert_eq!(beyond, json!(["not finite, allowed 0.001", "0.0312, allowed 0.001"]));
    is_readable(&page, "untrusted");
    page.call(
        "Emulation.setDeviceMetricsOverride",
        json!({"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": true}),
    );
    page.wait("document.documentElement.scrollWidth <= 390");
    page.picture("verdict_untrusted_narrow");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn the_verdict_of_the_run_before_is_out_of_sight_while_the_next_runs() {
    let page = Page::open("verdict-before", "/");
    page.solve(DECAY);
    assert_eq!(page.value("document.getElementById('verdict').checkVisibility()"), true);
    page.replace_text(ENDLESS);
    page.press("Enter", true);
    page.wait("/^running, t = .* steps$/.test(document.getElementById('state').innerText)");
    for hidden in ["verdict", "outcome"] {
        assert_eq!(page.value(&format!("document.getElementById('{hidden}').checkVisibility()")), false, "{hidden}");
    }
    assert_eq!(page.text("#label"), "Decay");
    assert!(page.text("#before").contains("of the run before"));
    page.picture("verdict_before");
    page.tab_to("#cancel");
    page.press("Enter", false);
    page.wait("document.getElementById('label').innerText === 'Endless'");
    assert_eq!(page.text("#verdict .badge").replace('\n', ""), "✗Not trusted");
    assert!(page.text("#verdict .reasons").contains("not at end"), "{}", page.text("#verdict .reasons"));
    assert_eq!(page.value("document.getElementById('before').checkVisibility()"), false);
    let marked = "document.querySelector('#jobs li .bad')?.textContent";
    assert_eq!(page.value(marked), "not trusted", "the list of jobs tells it too");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn two_runs_that_are_compared_have_a_verdict_each() {
    let page = Page::open("verdicts", "/");
    page.solve(&DECAY.replace("Decay", "First"));
    let (verdict, checks) = doubt();
    answer_with(&page, &verdict, &checks);
    page.solve(DECAY);
    page.value("(() => { const other = document.getElementById('other'); other.selectedIndex = 1; other.dispatchEvent(new Event('change')); })()");
    page.wait("document.querySelectorAll('#verdict .badge').length === 2");
    let second = page.text("#verdict p:nth-of-type(2) .badge").replace('\n', "");
    assert_eq!(second, "✗Not trusted (second)");
}
