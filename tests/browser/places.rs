//! Errors of a specification are marked at their lines in the editor.

use crate::driver::{EDITOR, Page};
use serde_json::json;

const BROKEN: &str = r#"{
  "problem": {"dvi": {
    "states": {
      "x": {"initial": 1, "rate": "-x"},
      "y": {"inital": 1, "rate": "-x"}
    },
    "variables": ["z"],
    "set": [{"nonnegative": ["w"]}]
  }},
  "time": {"end": 1}
}"#;

#[test]
fn every_wrong_line_is_marked_and_can_be_gone_to() {
    let page = Page::open("marks", "/");
    page.replace_text(BROKEN);
    page.wait(&format!("{EDITOR}.querySelectorAll('.marked').length > 0"));
    let marked = page.marked();
    assert!(marked.as_array().unwrap().contains(&json!("5")), "{marked}");
    assert!(!marked.as_array().unwrap().contains(&json!("4")), "{marked}");
    assert!(page.text("#check").contains("did you mean initial?"));
    page.picture("page_broken");

    page.tab_to(".place");
    page.press("Enter", false);
    let line =
        format!("[...{EDITOR}.querySelectorAll('.cm-line')].findIndex((line) => line.matches('.cm-activeLine')) + 1");
    let named = page.text(".place");
    assert_eq!(format!("line {}", page.value(&line)), named);

    let repaired =
        BROKEN.replace("inital", "initial").replace("[\"z\"]", "{}").replace("[{\"nonnegative\": [\"w\"]}]", "[]");
    page.replace_text(&repaired);
    page.wait("document.getElementById('check').innerText.startsWith('Correct')");
    assert_eq!(page.marked(), json!([]));
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn a_text_that_is_no_json_is_marked_where_it_breaks() {
    let page = Page::open("syntax", "/");
    page.replace_text("{\n  \"problem\": {},\n  \"time\": {\"end\": 1,,}\n}");
    page.wait(&format!("{EDITOR}.querySelectorAll('.cm-lineNumbers .marked').length === 1"));
    assert_eq!(page.marked(), json!(["3"]));
}

#[test]
fn a_pointer_leads_to_the_line_of_its_key_or_element() {
    let page = Page::open("pointers", "/");
    let text = "{\n  \"a\": [\n    {\"x/y\": 1},\n    2\n  ],\n  \"b\": {\"~\": {\n    \"c\": \"q\\\"}\",\n    \"d\"";
    // JSON Pointers (RFC 6901), in which ~0 stands for ~, and ~1 for /. A pointer to a missing member leads to the
    // line of the object around it; the text after a syntax error is ignored.
    let pointers = ["", "/a", "/a/0/x~1y", "/a/1", "/b/~0/c", "/b/~0/d", "/b/~0/missing", "/missing"];
    let expression =
        format!("import('/page/places.js').then(({{linesOf}}) => linesOf({}, {}))", json!(text), json!(pointers));
    assert_eq!(page.value(&expression), json!([0, 1, 2, 3, 6, 7, 5, 0]));
}

#[test]
fn depth_and_length_cost_no_more_than_their_size() {
    let page = Page::open("depth", "/");
    let deep = "import('/page/places.js').then(({linesOf}) => linesOf('['.repeat(200000) + '\\n1', ['/0/0'])[0])";
    assert_eq!(page.value(deep), 0);
}
