//! The appearance of the web page in the light and dark colour schemes and in wide and narrow windows.

use crate::driver::Page;
use serde_json::json;

const EXAMPLE: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples/bouncing_ball.json"));

/// A JavaScript expression for the contrast of the page's text with its background (WCAG 2.2, "contrast ratio"), and
/// for the luminance of the background.
const CONTRAST: &str = "(() => {
    const luminance = (colour) => {
        const [r, g, b] = colour.match(/[0-9.]+/g).map(Number).map((c) => c / 255)
            .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const ground = luminance(getComputedStyle(document.getElementById('result')).backgroundColor);
    const ratio = (element) => {
        const ink = luminance(getComputedStyle(element).color);
        return (Math.max(ink, ground) + 0.05) / (Math.min(ink, ground) + 0.05);
    };
    const told = ['#label', '#outcome', '#hover', '#evidence th', '#evidence td', '#warnings'];
    return {ground, least: Math.min(...told.map((selector) => ratio(document.querySelector(selector))))};
})()";

#[test]
fn it_is_light_or_dark_as_the_reader_wishes_and_readable_in_both() {
    let page = Page::open("looks", "/");
    page.solve(EXAMPLE);
    for scheme in ["light", "dark"] {
        let features = json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]});
        page.call("Emulation.setEmulatedMedia", features);
        page.picture(&format!("page_{scheme}"));
        let seen = page.value(CONTRAST);
        let ground = seen["ground"].as_f64().unwrap();
        assert_eq!(ground > 0.5, scheme == "light", "{scheme}: {seen}");
        // WCAG level AA requires a contrast of 4.5 for text of normal size.
        assert!(seen["least"].as_f64().unwrap() >= 4.5, "{scheme}: {seen}");
    }
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn nothing_is_wider_than_a_narrow_screen() {
    let page = Page::open("narrow", "/");
    page.call(
        "Emulation.setDeviceMetricsOverride",
        json!({"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": true}),
    );
    page.solve(EXAMPLE);
    page.wait("document.documentElement.scrollWidth <= 390");
    page.picture("page_narrow");
}

#[test]
fn on_a_narrow_screen_a_choice_leads_to_its_result() {
    let page = Page::open("choice", "/");
    page.call(
        "Emulation.setDeviceMetricsOverride",
        json!({"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": true}),
    );
    page.value("document.querySelector('.card[data-example=relay]').click()");
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    page.wait("Math.abs(document.getElementById('result').getBoundingClientRect().top) < 100");
    page.picture("page_choice");
}

#[test]
fn a_slow_network_and_a_lost_one_are_told() {
    let page = Page::open("network", "/");
    page.call("Network.enable", json!({}));
    let network = |offline: bool, latency: u32, bytes: i32| {
        let conditions =
            json!({"offline": offline, "latency": latency, "downloadThroughput": bytes, "uploadThroughput": bytes});
        page.call("Network.emulateNetworkConditions", conditions);
    };
    network(false, 400, 50_000);
    page.value("document.getElementById('example').value = 'relay'");
    page.value("document.getElementById('example').dispatchEvent(new Event('change'))");
    assert_eq!(page.text("#before"), "Loading the example ...");
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    network(true, 0, -1);
    page.value("document.getElementById('solve').click()");
    page.wait("document.getElementById('check').textContent.includes('The service does not answer.')");
}
