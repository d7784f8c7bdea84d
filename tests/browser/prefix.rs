//! Under a path, as behind a proxy that shows the service there: nothing that the page asks for or leads to stands outside.

use crate::driver::Page;
use crate::server::Server;

const EXAMPLE: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples/bouncing_ball.json"));

/// What the page has asked for, and where its links within the service lead, other than below the path of its address.
/// Citations lead to other sites, as they should.
const OUTSIDE: &str = "(() => {
    const below = new URL('/lab/dvi/', location.href).href;
    const asked = performance.getEntriesByType('resource').map((entry) => entry.name);
    const led = [...document.querySelectorAll('a[href]')].map((link) => link.href)
        .filter((address) => new URL(address).origin === location.origin);
    return [...asked, ...led].filter((address) => !address.startsWith(below) && !address.startsWith('blob:'));
})()";

#[test]
fn a_page_under_a_path_stays_below_it() {
    let server = Server::start_with(&["--listen", "127.0.0.1:0", "--ephemeral", "--path-prefix", "/lab/dvi"]);
    let page = Page::of(server, "prefix", "/lab/dvi/");
    page.solve(EXAMPLE);
    assert_eq!(page.value(OUTSIDE), serde_json::json!([]));
    // The address that the page has now leads a colleague to the same result.
    let place = page.value("location.pathname + location.search + location.hash");
    let place = place.as_str().unwrap();
    assert!(place.starts_with("/lab/dvi/"), "{place}");
    page.go(place);
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    page.wait("document.querySelector('#plots canvas') !== null");
    assert_eq!(page.value(OUTSIDE), serde_json::json!([]));
    page.value("document.querySelector('a[href$=\"/docs\"]').click()");
    page.wait("location.pathname === '/lab/dvi/docs' && document.readyState === 'complete'");
    assert!(page.value("document.styleSheets[0].cssRules.length").as_u64() > Some(0));
    assert_eq!(page.value(OUTSIDE), serde_json::json!([]));
    assert_eq!(page.complaints(), Vec::<String>::new());
}
