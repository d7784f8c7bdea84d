//! The help of the specification editor on the page: errors marked in place with a suggested fix, and completion and
//! explanations from the JSON Schema.

use crate::driver::{EDITOR, Page};
use serde_json::json;

const BROKEN: &str = r#"{"problem":{"dvi":{"states":{"x":{"inital":1,"rate":"-x"}}}},"time":{"end":1}}"#;

#[test]
fn a_fix_writes_the_name_that_was_meant() {
    let page = Page::open("fix", "/");
    page.replace_text(BROKEN);
    page.wait("document.querySelector('.fix') !== null");
    assert_eq!(page.text(".fix"), "Write initial");
    page.tab_to(".fix");
    page.press("Enter", false);
    page.wait("document.getElementById('check').innerText.startsWith('Correct')");
    let text = page.value(&format!("{EDITOR}.querySelector('.cm-content').textContent"));
    assert_eq!(text, json!(BROKEN.replace("inital", "initial")));
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn keys_are_completed_from_the_schema() {
    let page = Page::open("complete", "/");
    // The page fetches the JSON Schema of specifications when the editor first gets the focus.
    let fetched = "performance.getEntriesByType('resource').some((entry) => entry.name.endsWith('/schema') && entry.responseEnd > 0)";
    assert_eq!(page.value(fetched), false);
    page.tab_to("#text");
    page.wait(fetched);
    page.paste("{\"problem\": {}, \"me\"}");
    for _ in 0..2 {
        page.press("ArrowLeft", false);
    }
    page.press(" ", true);
    page.wait(&format!("{EDITOR}.querySelector('.cm-tooltip-autocomplete') !== null"));
    page.wait(&format!("{EDITOR}.querySelector('.cm-tooltip-autocomplete').textContent.includes('method')"));
    page.picture("page_completion");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn the_schema_is_followed_by_keys_indices_and_alternatives() {
    let page = Page::open("language", "/");
    let told = "Promise.all([import('/page/language.js'), fetch('/schema').then((answer) => answer.json())]).then(([{keysAt, valuesAt, meaningOf}, schema]) => {
        const value = {problem: {circuit: {components: [{diode: {name: 'D1'}}]}}, method: {switches: 'locate'}};
        return [
            keysAt(schema, [], value).some(({key, required}) => key === 'problem' && required),
            keysAt(schema, ['problem'], {problem: {}}).map(({key}) => key).includes('elastic'),
            keysAt(schema, ['problem', 'circuit', 'components', 0, 'diode'], value).map(({key}) => key).sort(),
            valuesAt(schema, ['method', 'switches'], value).map(({word}) => word),
            meaningOf(schema, ['problem', 'circuit', 'components', 0, 'diode', 'forward_volts'], value).includes('conducting diode'),
        ];
    })";
    let wanted = json!([true, true, ["comment", "forward_volts", "name", "nodes"], ["locate", "step_over"], true]);
    assert_eq!(page.value(told), wanted);
}

#[test]
fn expressions_are_read_as_the_service_reads_them() {
    let page = Page::open("expressions", "/");
    let told = "import('/page/expressions.js').then(({value, parameterValues}) => [value('-2^2'), value('2^3^2'), value('2^-1'),
        value('if(t > 1 and t < 3, 4, 5)', {t: 2}), value('pwm(2.2, 1, 0.3) + sawtooth(2.5, 1)'), value('v(out) + i( L1 )', {'v(out)': 1, 'i(L1)': 2}),
        value('x[2] + ball.vx', {'x[2]': 1, 'ball.vx': 2}), value('mod(-1, 3)'), parameterValues({a: 'b/2', b: 3, c: 'nothing'}), String(value('2 +'))])";
    assert_eq!(page.value(told), json!([-4, 512, 0.5, 4, 1.5, 3, 3, 2, {"a": 1.5, "b": 3}, "NaN"]));
}
