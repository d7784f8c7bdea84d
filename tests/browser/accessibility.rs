//! The accessibility checker axe-core finds no fault on the web page of the service and in its guide, in the light and
//! dark colour schemes and in wide and narrow windows.

use crate::driver::Page;
use serde_json::{Value, json};

const AXE: &str = include_str!("vendor/axe.min.js");
const EXAMPLE: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples/bouncing_ball.json"));

/// Returns the accessibility rules of axe-core that the page violates, each with the violating elements.
fn broken(page: &Page) -> Value {
    // The content security policy of the page blocks foreign scripts, but the debugger may run them.
    page.value(&format!("window.axe ? null : (() => {{ {AXE}; }})()"));
    page.value(
        "axe.run(document, {resultTypes: ['violations']}).then(({violations}) => violations.map(({id, nodes}) => [id, nodes.map(({html}) => html.slice(0, 160))]))",
    )
}

fn looks(page: &Page, dark: bool, narrow: bool) {
    let scheme = if dark { "dark" } else { "light" };
    page.call("Emulation.setEmulatedMedia", json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]}));
    let (width, height) = if narrow { (390, 844) } else { (1400, 900) };
    let size = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": narrow});
    page.call("Emulation.setDeviceMetricsOverride", size);
}

#[test]
fn nothing_is_wrong_with_the_page() {
    let page = Page::open("axe", "/");
    for (dark, narrow) in [(false, false), (true, false), (true, true)] {
        looks(&page, dark, narrow);
        assert_eq!(broken(&page), json!([]), "the gallery, dark: {dark}, narrow: {narrow}");
        page.picture(&format!("axe_gallery_{dark}_{narrow}"));
    }
    page.solve(EXAMPLE);
    page.value("document.querySelectorAll('details').forEach((one) => { one.open = true; })");
    page.value("document.getElementById('list').click()");
    page.wait("document.querySelectorAll('#jobtable tbody tr').length > 0");
    for (dark, narrow) in [(false, false), (true, false), (false, true), (true, true)] {
        looks(&page, dark, narrow);
        assert_eq!(broken(&page), json!([]), "a result, dark: {dark}, narrow: {narrow}");
        page.wait("document.documentElement.scrollWidth <= innerWidth");
        page.picture(&format!("axe_result_{dark}_{narrow}"));
    }
    page.replace_text("{\"problem\": {\"dvi\": {\"state\": {}}}}");
    page.wait("document.querySelector('.errors') !== null");
    assert_eq!(broken(&page), json!([]), "errors");
}

#[test]
fn nothing_is_wrong_with_the_guide() {
    let page = Page::open("axe-guide", "/");
    for (chapter, narrow) in
        [("", false), ("/keys", false), ("/evidence", true), ("/interface", false), ("/search?q=energy", true)]
    {
        let address = page.value(&format!("location.origin + '/docs{chapter}'"));
        page.call("Page.navigate", json!({"url": address}));
        page.wait("document.readyState === 'complete' && document.querySelector('main') !== null");
        for dark in [false, true] {
            looks(&page, dark, narrow);
            assert_eq!(broken(&page), json!([]), "{chapter}, dark: {dark}");
            page.wait("document.documentElement.scrollWidth <= innerWidth");
        }
        page.picture(&format!("guide{}", chapter.replace(['/', '?', '='], "_")));
    }
}
