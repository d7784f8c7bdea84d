//! The page draws a map of a final quantity over two parameters of a problem, and saves a film of an animation.

use crate::driver::Page;
use serde_json::json;

/// Specification with `x(1) = a exp(-k)`, from which the exact value in each cell of the map over `a` and `k` is known.
const DECAY: &str = r#"{"problem":{"dvi":{"parameters":{"a":1,"k":2},"states":{"x":{"initial":"a","rate":"-k*x"}}}},"time":{"end":1},"method":{"rtol":1e-8}}"#;

#[test]
fn a_cell_of_a_map_is_the_run_that_it_opens() {
    let page = Page::open("map", "/");
    page.solve(DECAY);
    page.value("document.getElementById('mapbox').open = true");
    page.wait("document.querySelectorAll('#map select')[0]?.options.length >= 2");
    page.value("document.querySelector('#map button').click()");
    page.wait("document.querySelectorAll('#map rect[data-cell]').length === 225");
    page.value("document.querySelector('.heatmap').focus()");
    page.picture("map");
    // Moves the focus of the map to the cell with the largest a and the second smallest k.
    for _ in 0..14 {
        page.press("ArrowRight", false);
    }
    page.press("ArrowUp", false);
    let told = page.text("#map [role=status]");
    assert!(told.starts_with("a = 2, k = 0.2857"), "{told}");
    let value: f64 = told.rsplit(' ').next().unwrap().parse().unwrap();
    assert!((value - 2.0 * f64::exp(-0.28571)).abs() < 1e-4, "{told}");
    page.press("Enter", false);
    page.wait("document.querySelector('#knobs output')?.textContent === '2'");
    let written = page.value("document.getElementById('text').shadowRoot.querySelector('.cm-content').textContent");
    assert!(written.as_str().unwrap().contains("0.28571"), "{written}");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
#[ignore = "recording ends the browser on some machines without a video encoder, and every test beside it"]
fn a_picture_is_saved_as_a_film() {
    let page = Page::open("film", "/#example=friction_belt");
    page.wait("document.querySelector('#stage canvas') !== null");
    // Replaces the browser's saving of files by a script that collects what the page would save. The film takes as long
    // to record as to play, two seconds at the highest speed.
    page.value(
        "window.films = []; HTMLAnchorElement.prototype.click = () => {};
        URL.createObjectURL = (blob) => { window.films.push(blob); return 'about:blank'; }",
    );
    page.value("(() => { const speed = document.querySelector('#clock select'); speed.value = '4'; speed.dispatchEvent(new Event('change')); })()");
    page.value("document.getElementById('webm').click()");
    page.wait("window.films.length > 0");
    let kind = page.value("window.films[0].type");
    assert_eq!(kind, json!("video/webm"));
    let size = page.value("window.films[0].size").as_f64().unwrap();
    assert!(size > 5e3, "a film of {size} bytes");
    // A WebM film begins with the signature of its container format EBML.
    page.value("window.films[0].slice(0, 4).arrayBuffer().then((bytes) => (window.head = [...new Uint8Array(bytes)]))");
    page.wait("window.head !== undefined");
    assert_eq!(page.value("window.head"), json!([0x1a, 0x45, 0xdf, 0xa3]));
    assert_eq!(page.complaints(), Vec::<String>::new());
}
