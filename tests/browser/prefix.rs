//! The page under a path prefix, as behind a proxy: each address that it requests or links to lies below the prefix.

use crate::driver::Page;
use crate::server::Server;

const EXAMPLE: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples/bouncing_ball.json"));

/// A JavaScript expression for the requested addresses, and the link targets within the service, that do not lie
/// below the path prefix. Citations may link to other sites.
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
    // The address that the page shows after the solve leads another browser to the same result.
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
