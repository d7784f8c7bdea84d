//! Generated chapters of the guide: the keys of a specification from its JSON Schema, the fields of a response from
//! the `OpenAPI` description, and the error codes from their explanations.

use super::{Chapter, Section, escaped, id_of, with_code};
use serde_json::{Map, Value};
use std::collections::{BTreeSet, VecDeque};
use std::fmt::Write as _;

/// Returns the chapter that lists every key of a specification.
pub fn keys(schema: &Value) -> Chapter {
    let introduction = "Every key, by object. Expressions are explained in <a href=\"/docs/expressions\">their own \
                        chapter</a>; the JSON Schema is at <a href=\"/schema\">/schema</a>.";
    let mut chapter = Chapter::begin("keys", "Every key of a specification", introduction);
    chapter.object("Specification", schema);
    for (name, inner) in members(schema.get("$defs")) {
        chapter.object(name, inner);
    }
    chapter
}

/// Returns the chapter that lists every field of a response.
pub fn answer(description: &Value) -> Chapter {
    let introduction = "The JSON result of <code>POST /solve</code> (<code>Solution</code>), and the status of jobs \
                        (<code>StatusInfo</code>). Their assessment is explained in <a href=\"/docs/evidence\">How to \
                        read the evidence</a>.";
    let mut chapter = Chapter::begin("answer", "Every field of an answer", introduction);
    let schemas = description.pointer("/components/schemas");
    let mut waiting = VecDeque::from(["Solution", "StatusInfo", "ProblemDetails"].map(str::to_owned));
    let mut seen = BTreeSet::new();
    while let Some(name) = waiting.pop_front() {
        let Some(schema) = schemas.and_then(|schemas| schemas.get(&name)) else { continue };
        if !seen.insert(name.clone()) {
            continue;
        }
        chapter.object(&name, schema);
        let mut named = Vec::new();
        references(schema, &mut named);
        waiting.extend(named);
    }
    chapter
}

/// Returns the chapter that lists every error code, with the texts that `GET /problems` returns.
pub fn codes() -> Chapter {
    let introduction = "Every word that programs read: errors of a specification, warnings and verdicts, failures of a solve, refusals of the \
                        service. <code>dvi explain CODE</code> says the same on the command line, <code>GET /problems/CODE</code> over HTTP.";
    let mut chapter = Chapter::begin("codes", "Every code", introduction);
    for page in explanation::pages() {
        let text = [page.meaning, page.why, page.remedy, page.example].join(" ");
        let _ = write!(
            chapter.html,
            "<section>\n<h2 id=\"{0}\"><code>{0}</code></h2>\n<p>{1}</p>\n<dl>\n<dt>Why</dt><dd>{2}</dd>\n<dt>What to do</dt><dd>{3}</dd>\n\
             <dt>Example</dt><dd>{4}</dd>\n</dl>\n</section>\n",
            escaped(page.code),
            with_code(page.meaning),
            with_code(page.why),
            with_code(page.remedy),
            with_code(page.example)
        );
        chapter.sections.push(Section { id: page.code.to_owned(), heading: page.code.to_owned(), text });
    }
    chapter
}

impl Chapter {
    fn begin(name: &str, title: &str, introduction: &str) -> Self {
        let id = id_of(title);
        let html = format!("<h1 id=\"{id}\">{title}</h1>\n<p>{introduction}</p>\n");
        let first = Section { id, heading: title.to_owned(), text: String::new() };
        Self { name: name.to_owned(), title: title.to_owned(), html, sections: vec![first] }
    }

    /// Adds a section on the schema `name` to the chapter: its description, its keys in a table, its alternatives in a
    /// list.
    fn object(&mut self, name: &str, schema: &Value) {
        let id = name.to_lowercase();
        let said = text(schema, "description");
        // Writing HTML to a string cannot fail.
        let _ = write!(self.html, "<section>\n<h2 id=\"{id}\">{}</h2>\n<p>{}</p>\n", escaped(name), with_code(said));
        let mut words = vec![said.to_owned()];
        let parts: Vec<&Value> = std::iter::once(schema).chain(list(schema.get("allOf"))).collect();
        let rows: Vec<(&Value, &String, &Value)> = parts
            .iter()
            .flat_map(|part| members(part.get("properties")).map(move |(key, inner)| (*part, key, inner)))
            .collect();
        if !rows.is_empty() {
            self.html.push_str(
                "<div class=\"wide\" tabindex=\"0\"><table>\n<thead><tr><th scope=\"col\">Key</th>\
                 <th scope=\"col\">Value</th><th scope=\"col\">Meaning</th></tr></thead>\n<tbody>\n",
            );
            for (part, key, inner) in rows {
                let required = list(part.get("required")).any(|one| one == key);
                let mark = if required { " <small>required</small>" } else { "" };
                let meaning = description(inner);
                let _ = writeln!(
                    self.html,
                    "<tr><th scope=\"row\"><code>{}</code>{mark}</th><td>{}</td><td>{}{}</td></tr>",
                    escaped(key),
                    kind(inner),
                    with_code(meaning),
                    bounds(inner)
                );
                words.push(format!("{key} {meaning}"));
            }
            self.html.push_str("</tbody>\n</table></div>\n");
        }
        let alternatives: Vec<&Value> = list(schema.get("oneOf")).collect();
        if !alternatives.is_empty() {
            self.html.push_str("<p>One of:</p>\n<ul>\n");
            for one in alternatives {
                let _ = writeln!(self.html, "<li>{} {}</li>", kind(one), with_code(text(one, "description")));
                words.push(text(one, "description").to_owned());
            }
            self.html.push_str("</ul>\n");
        }
        let choices: Vec<String> =
            list(schema.get("enum")).map(|one| format!("<code>{}</code>", escaped(&one.to_string()))).collect();
        if !choices.is_empty() {
            let _ = writeln!(self.html, "<p>One of {}.</p>", choices.join(", "));
        }
        self.html.push_str("</section>\n");
        self.sections.push(Section { id, heading: name.to_owned(), text: words.join(" ") });
    }
}

/// Returns the description of a schema; if it has none, the first one among its alternatives.
fn description(schema: &Value) -> &str {
    let own = text(schema, "description");
    let inner = || list(schema.get("oneOf")).map(|one| text(one, "description")).find(|text| !text.is_empty());
    if own.is_empty() { inner().unwrap_or_default() } else { own }
}

/// Returns the type of a schema's values as HTML; a type that has a name is a link to its section.
fn kind(schema: &Value) -> String {
    if let Some(reference) = schema.get("$ref").and_then(Value::as_str) {
        let name = reference.rsplit('/').next().unwrap_or_default();
        return format!("<a href=\"#{}\">{}</a>", escaped(&name.to_lowercase()), escaped(name));
    }
    if let Some(words) = schema.get("enum") {
        let words: Vec<String> =
            list(Some(words)).map(|word| format!("<code>{}</code>", escaped(&word.to_string()))).collect();
        return words.join(" or ");
    }
    let inner: Vec<String> = list(schema.get("oneOf"))
        .chain(list(schema.get("anyOf")))
        .filter(|one| one["type"] != "null")
        .map(kind)
        .collect();
    if !inner.is_empty() {
        return inner.join(" or ");
    }
    let types: Vec<&str> = match schema.get("type") {
        Some(Value::String(one)) => vec![one],
        Some(Value::Array(several)) => several.iter().filter_map(Value::as_str).filter(|&one| one != "null").collect(),
        _ => vec![],
    };
    let keys: Vec<&String> = members(schema.get("properties")).map(|(key, _)| key).collect();
    match (types.first().copied(), keys.as_slice()) {
        (Some("object"), [key]) => {
            let value = schema.pointer(&format!("/properties/{key}")).map(kind).unwrap_or_default();
            format!("<code>{{\"{}\": ..}}</code> {value}", escaped(key))
        }
        (Some("object"), [_, ..]) => {
            let keys: Vec<String> = keys.iter().map(|key| format!("\"{}\": ..", escaped(key))).collect();
            format!("<code>{{{}}}</code>", keys.join(", "))
        }
        (Some("object"), []) => match schema.get("additionalProperties").filter(|one| one.is_object()) {
            Some(each) => format!("names, each with {}", kind(each)),
            None => "object".to_owned(),
        },
        (Some("array"), _) => match schema.get("items").filter(|one| one.is_object()) {
            Some(each) => format!("list of {}", kind(each)),
            None => "list".to_owned(),
        },
        (Some(one), _) => one.to_owned(),
        (None, _) => "value".to_owned(),
    }
}

/// Returns the bounds and the default of a number in a schema as sentences, without those that the description of the
/// number already states.
fn bounds(schema: &Value) -> String {
    let bound = |key: &str, words: &str| schema.get(key).map(|value| format!(" {words} {value}."));
    let all = [
        bound("minimum", "At least"),
        bound("exclusiveMinimum", "Above"),
        bound("maximum", "At most"),
        bound("default", "Default"),
    ];
    let said = description(schema);
    all.into_iter()
        .flatten()
        .filter(|one| !said.contains(one.trim().trim_end_matches('.')))
        .map(|one| escaped(&one))
        .collect()
}

/// Collects the names of the schemas that `schema` refers to.
fn references(schema: &Value, into: &mut Vec<String>) {
    match schema {
        Value::Object(inner) => {
            if let Some(name) =
                inner.get("$ref").and_then(Value::as_str).and_then(|reference| reference.rsplit('/').next())
            {
                into.push(name.to_owned());
            }
            inner.values().for_each(|one| references(one, into));
        }
        Value::Array(items) => items.iter().for_each(|one| references(one, into)),
        _ => {}
    }
}

fn text<'a>(value: &'a Value, member: &str) -> &'a str {
    value.get(member).and_then(Value::as_str).unwrap_or_default()
}

fn list(value: Option<&Value>) -> impl Iterator<Item = &Value> {
    value.and_then(Value::as_array).into_iter().flatten()
}

fn members(value: Option<&Value>) -> impl Iterator<Item = (&String, &Value)> {
    value.and_then(Value::as_object).into_iter().flat_map(Map::iter)
}
