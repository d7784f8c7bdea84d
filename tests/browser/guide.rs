//! Links from the web page of the service to its guide and back.

use crate::driver::Page;
use serde_json::json;

#[test]
fn an_example_of_the_guide_opens_on_the_page_with_its_answer() {
    let page = Page::open("guide-open", "/");
    let link = page.value(
        "fetch('/docs').then((answer) => answer.text()).then((text) => new DOMParser().parseFromString(text, 'text/html').querySelector('.open a').getAttribute('href'))",
    );
    page.call("Page.navigate", json!({"url": "about:blank"}));
    page.go(link.as_str().unwrap());
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    assert_eq!(page.text("#label"), "A mass, a spring and a belt");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn every_light_leads_to_its_explanation() {
    let page = Page::open("guide-lights", "/");
    page.solve(include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples/bouncing_ball.json")));
    let lost = "(async () => {
        const lost = [];
        for (const link of document.querySelectorAll('#claims a')) {
            const text = await (await fetch(link.href)).text();
            if (new DOMParser().parseFromString(text, 'text/html').getElementById(link.hash.slice(1)) === null) lost.push(link.hash);
        }
        return [document.querySelectorAll('#claims a').length > 4, lost];
    })()";
    assert_eq!(page.value(lost), json!([true, []]));
}
