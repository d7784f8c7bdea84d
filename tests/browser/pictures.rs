//! Animations of the simulated objects on the page: each kind of object is drawn, follows the time cursor, and can be
//! saved as a picture.

use crate::driver::Page;
use serde_json::json;

/// A JavaScript expression for a digest (hash) of the pixels of the animation, by which a test detects a change.
const IMAGE: &str = "(() => {
    const text = document.querySelector('#stage canvas')?.toDataURL() ?? '';
    let digest = 0;
    for (let i = 0; i < text.length; i += 1) digest = (31 * digest + text.charCodeAt(i)) | 0;
    return text === '' ? '' : String(digest);
})()";

/// Moves the time cursor of the animation to a fraction of the horizon, in thousandths.
fn scrub(page: &Page, to: u32) {
    page.value(&format!(
        "(() => {{ const slider = document.querySelector('#clock input'); slider.value = {to}; slider.dispatchEvent(new Event('input')); }})()"
    ));
}

/// Chooses a published example on the page, solves it, and waits for its animation.
fn picture_of(page: &Page, example: &str) {
    page.value("document.getElementById('outcome').textContent = ''");
    page.value(&format!("document.getElementById('example').value = {example:?}"));
    page.value("document.getElementById('example').dispatchEvent(new Event('change'))");
    let solved = "/ in /.test(document.getElementById('outcome').textContent)";
    let asks = "/press Solve/i.test(document.getElementById('before').textContent)";
    page.wait(&format!("{solved} || {asks}"));
    if page.value(asks) == true {
        page.value("document.getElementById('solve').click()");
        page.wait(solved);
    }
    page.wait("document.querySelector('#stage canvas, #stage button') !== null");
    page.value("document.querySelector('#stage button')?.click()");
    page.wait("document.querySelector('#stage canvas') !== null");
}

#[test]
fn every_kind_of_picture_is_drawn_and_moves() {
    let page = Page::open("pictures", "/");
    for example in
        ["bouncing_ball", "diode_bridge_netlist", "oxygen_diffusion", "bar_impact", "switching_circle", "friction_belt"]
    {
        picture_of(&page, example);
        page.wait(&format!("{IMAGE} !== ''"));
        let at_start = page.value(IMAGE);
        scrub(&page, 400);
        assert_ne!(page.value(IMAGE), at_start, "{example} does not move");
        page.picture(&format!("picture_{example}"));
    }
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn bodies_in_space_are_drawn_and_three_is_fetched_only_then() {
    let page = Page::open("scene", "/");
    let fetched = "performance.getEntriesByType('resource').some((entry) => entry.name.endsWith('/three.js'))";
    picture_of(&page, "friction_belt");
    assert_eq!(page.value(fetched), false);
    let light =
        page.value("performance.getEntriesByType('resource').filter(({name}) => name.includes('/page/')).reduce((sum, entry) => sum + entry.transferSize, 0)");
    assert!(light.as_f64().unwrap() < 250e3, "{light} bytes without a scene");
    picture_of(&page, "rolling_ball");
    page.wait(fetched);
    page.picture("picture_rolling_ball");
    let heavy = "performance.getEntriesByType('resource').filter(({name}) => name.includes('/page/')).reduce((sum, entry) => sum + entry.transferSize, 0)";
    let heavy = page.value(heavy);
    assert!(heavy.as_f64().unwrap() < 450e3, "{heavy} bytes with a scene");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn a_film_plays_pauses_and_steps_to_events() {
    let page = Page::open("film", "/");
    picture_of(&page, "bouncing_ball");
    page.tab_to("#clock button");
    page.press("Enter", false);
    page.wait("Number(document.querySelector('#clock input').value) > 5");
    page.press("Enter", false);
    let paused = page.value("document.querySelector('#clock button').textContent");
    assert_eq!(paused, "Play");
    scrub(&page, 0);
    page.value("document.querySelectorAll('#clock button')[1].click()");
    // The time cursor shows the first impact of a ball dropped from 1 m, at sqrt(2 / 9.81).
    assert_eq!(page.text("#clock .time"), "t = 0.4515");
}

#[test]
fn cards_of_the_gallery_have_pictures_that_leave_nothing_behind() {
    let page = Page::open("cards", "/");
    page.wait("document.querySelector('.card[data-example=bouncing_ball] canvas:not([hidden])') !== null");
    let drawn = "[...document.querySelector('.card[data-example=bouncing_ball] canvas').getContext('2d')
        .getImageData(0, 0, 270, 140).data].some((byte) => byte > 0)";
    assert_eq!(page.value(drawn), true);
    page.picture("page_cards");
    page.wait("fetch('/jobs').then((answer) => answer.json()).then(({jobs}) => jobs.length === 0)");
    let fetched = "performance.getEntriesByType('resource').some((entry) => entry.name.endsWith('/three.js'))";
    assert_eq!(page.value(fetched), false);
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn an_answer_is_saved_as_a_picture_and_as_a_file_that_needs_no_network() {
    let page = Page::open("files", "/");
    picture_of(&page, "friction_belt");
    // Replaces the browser's saving of files by a script that collects what the page would save.
    page.value(
        "window.files = []; HTMLAnchorElement.prototype.click = () => {};
        URL.createObjectURL = (blob) => { window.files.push(blob); return 'about:blank'; }; 0",
    );
    page.value("document.getElementById('still').click()");
    page.wait("window.files.length === 1");
    assert_eq!(page.value("window.files[0].type"), json!("image/png"));
    page.value("document.getElementById('html').click()");
    page.wait("window.files.length === 2");
    let told = "window.files[1].text().then((text) => {
        // The page allows no styles but its own, here neither.
        const read = new DOMParser().parseFromString(text.replace(/<style>[^]*?<\\/style>/, ''), 'text/html');
        return [read.querySelector('h1').textContent, read.querySelectorAll('svg').length, read.querySelectorAll('#claims li').length > 2,
            JSON.parse(read.querySelector('pre').textContent).time.end, text.split('data:image/webp').length - 1,
            [...read.querySelectorAll('[src], [href]')].length];
    })";
    let wanted = json!(["Mass on a spring and a moving belt: slip, stick, slip", 1, true, 20, 80, 0]);
    assert_eq!(page.value(told), wanted);
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn figures_have_names_units_and_a_legend() {
    let page = Page::open("figures", "/");
    let told = "Promise.all([import('/page/figure.js'), import('/page/fields.js')]).then(([{panelsFigure, textOf}, {panels}]) => {
        const specification = {problem: {circuit: {}}};
        const fields = ['v(a)', 'v(b)', 'i(L1)'];
        const t = [0, 1, 2];
        const shown = panels(fields, specification, () => 1).map((group) => ({...group, log: false, events: [{t: 1}],
            series: group.fields.map((name) => ({name, t, values: [1, 2, 3]}))}));
        const text = textOf(panelsFigure(shown, {title: 'A <b>', specification}));
        const read = new DOMParser().parseFromString(text, 'image/svg+xml');
        return [shown.map(({fields}) => fields), [...read.querySelectorAll('text')].map((one) => one.textContent).filter((one) => /[a-z]/i.test(one)),
            read.querySelectorAll('parsererror').length];
    })";
    let wanted =
        json!([[["v(a)", "v(b)"], ["i(L1)"]], ["A <b>", "voltage in V", "v(b)", "v(a)", "t in s", "i(L1) in A"], 0]);
    assert_eq!(page.value(told), wanted);
}
