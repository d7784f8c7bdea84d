//! Pictures of what is simulated: each kind is drawn, moves with the time cursor, and can be put on paper.

use crate::driver::Page;
use serde_json::json;

/// A digest of what the picture shows.
const IMAGE: &str =
    "(() => { const canvas = document.querySelector('#stage canvas'); return canvas ? canvas.toDataURL().length + ':' +
    canvas.toDataURL().slice(-200) : ''; })()";

/// Chooses an example and waits for its picture.
fn picture_of(page: &Page, example: &str) {
    page.value(&format!("document.getElementById('example').value = {example:?}"));
    page.value("document.getElementById('example').dispatchEvent(new Event('change'))");
    page.wait("/ in /.test(document.getElementById('outcome').textContent) || !document.getElementById('before').hidden && /press Solve/i.test(document.getElementById('before').textContent)");
    if page.value("document.getElementById('chosen').hidden") == true {
        page.value("document.getElementById('solve').click()");
        page.wait(
            "!document.getElementById('chosen').hidden && / in /.test(document.getElementById('outcome').textContent)",
        );
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
        page.value("(() => { const slider = document.querySelector('#clock input'); slider.value = 400; slider.dispatchEvent(new Event('input')); })()");
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
    page.value("(() => { const slider = document.querySelector('#clock input'); slider.value = 0; slider.dispatchEvent(new Event('input')); })()");
    page.value("document.querySelectorAll('#clock button')[1].click()");
    // The first impact of a ball let go at 1 m is at sqrt(2 / 9.81).
    assert_eq!(page.text("#clock .time"), "t = 0.4515");
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
