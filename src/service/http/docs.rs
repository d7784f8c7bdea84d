//! The `OpenAPI` description as an HTML page: operations by tag, each with its parameters and responses, then the
//! schemas.

use crate::guide::escaped;
use serde_json::{Map, Value};
use std::fmt::Write as _;

/// Renders an `OpenAPI` description as the body of an HTML page.
pub fn body(description: &Value) -> String {
    let text = |pointer: &str| escaped(description.pointer(pointer).and_then(Value::as_str).unwrap_or_default());
    let (title, version) = (text("/info/title"), text("/info/version"));
    let mut html = format!(
        "<h1>Interface over HTTP <small>{title} {version}</small></h1>\n<p>{} As a description for programs: \
         <a href=\"/openapi.json\">OpenAPI</a>.</p>\n",
        text("/info/description")
    );
    for tag in list(description.get("tags")) {
        let name = tag["name"].as_str().unwrap_or_default();
        // Writing HTML to a string cannot fail.
        let _ = write!(html, "<h2>{}</h2>\n<p>{}</p>\n", escaped(name), told(tag, "description"));
        for (path, item) in members(description.get("paths")) {
            for (method, operation) in members(Some(item)) {
                if list(operation.get("tags")).iter().any(|tag| tag == name) {
                    html.push_str(&operation_of(path, method, operation));
                }
            }
        }
    }
    html.push_str("<h2>Schemas</h2>\n");
    for (name, schema) in members(description.pointer("/components/schemas")) {
        let name = escaped(name);
        let _ = writeln!(
            html,
            "<details id=\"{name}\"><summary><code>{name}</code> {}</summary>\n<pre tabindex=\"0\">{}</pre></details>",
            told(schema, "description"),
            escaped(&format!("{schema:#}"))
        );
    }
    html
}

fn operation_of(path: &str, method: &str, operation: &Value) -> String {
    let mut html = format!(
        "<section>\n<h3><b>{}</b> <code>{}</code></h3>\n<p>{} {}</p>\n<dl>\n",
        method.to_uppercase(),
        escaped(path),
        told(operation, "summary"),
        told(operation, "description")
    );
    for parameter in list(operation.get("parameters")) {
        let _ = writeln!(
            html,
            "<dt><code>{}</code> <small>{}</small></dt><dd>{}</dd>",
            told(parameter, "name"),
            told(parameter, "in"),
            told(parameter, "description")
        );
    }
    for (media_type, content) in members(operation.pointer("/requestBody/content")) {
        let _ = writeln!(html, "<dt>body</dt><dd>{}</dd>", content_of(media_type, content));
    }
    for (status, response) in members(operation.get("responses")) {
        let contents: Vec<String> =
            members(response.get("content")).map(|(media_type, content)| content_of(media_type, content)).collect();
        let _ = writeln!(
            html,
            "<dt>{}</dt><dd>{} {}</dd>",
            escaped(status),
            told(response, "description"),
            contents.join(", ")
        );
        for (name, header) in members(response.get("headers")) {
            let _ = writeln!(html, "<dd>with <code>{}</code>: {}</dd>", escaped(name), told(header, "description"));
        }
    }
    html.push_str("</dl>\n</section>\n");
    html
}

/// Returns a media type as HTML, with a link to its schema, if the schema has a name.
fn content_of(media_type: &str, content: &Value) -> String {
    let reference = content.pointer("/schema/$ref").and_then(Value::as_str).unwrap_or_default();
    let link = match reference.rsplit('/').next().map(escaped) {
        Some(name) if !name.is_empty() => format!(": <a href=\"#{name}\">{name}</a>"),
        _ => String::new(),
    };
    format!("<code>{}</code>{link}", escaped(media_type))
}

fn told(value: &Value, member: &str) -> String {
    escaped(value.get(member).and_then(Value::as_str).unwrap_or_default())
}

fn list(value: Option<&Value>) -> &[Value] {
    value.and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn members(value: Option<&Value>) -> impl Iterator<Item = (&String, &Value)> {
    value.and_then(Value::as_object).into_iter().flat_map(Map::iter)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_description_becomes_text_and_not_markup() {
        let page = body(&json!({
            "info": {"title": "<script>", "version": "1"},
            "tags": [{"name": "a&b"}],
            "paths": {"/x": {"get": {"tags": ["a&b"], "summary": "\"s\"", "responses": {
                "200": {"description": "<b>", "headers": {"x-h": {"description": "<i>"}}}
            }}}},
        }));
        assert!(page.contains("&lt;script&gt;") && !page.contains("<script"), "{page}");
        assert!(page.contains("<b>GET</b> <code>/x</code>") && page.contains("&quot;s&quot;"), "{page}");
        assert!(page.contains("<dt>200</dt><dd>&lt;b&gt;"), "{page}");
        assert!(page.contains("<dd>with <code>x-h</code>: &lt;i&gt;</dd>"), "{page}");
    }
}
