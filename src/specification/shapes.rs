//! Suggestions for values of the wrong shape: the user's value rewritten, or an example of a valid one.

use super::json::Json;
use super::pointer::Step;
use super::wording::{abridged, quoted};

/// Examples of valid values for messages, by the key of the value.
const EXAMPLES: [(&str, &str); 40] = [
    ("problem", r#"{"dvi": {"states": {"x": {"initial": 1, "rate": "-x"}}}}"#),
    ("time", r#"{"end": 10}"#),
    ("method", r#"{"rtol": 1e-6}"#),
    ("output", r#"{"fields": ["x"], "times": {"count": 101}}"#),
    ("limits", r#"{"wall_seconds": 60}"#),
    ("stop", r#"[{"when": "x - 1"}]"#),
    ("sensitivities", r#"{"to": ["k"], "of": ["x"]}"#),
    ("study", r#"{"rtol": [1e-3, 1e-6]}"#),
    ("times", r#"{"count": 101}"#),
    ("fields", r#"["x"]"#),
    ("set", r#"[{"nonnegative": ["z"]}]"#),
    ("box", r#"{"of": ["F"], "lower": -1, "upper": 1}"#),
    ("ball", r#"{"of": ["Fx", "Fy"], "radius": 1}"#),
    ("polyhedron", r#"{"of": ["z"], "A": [[1]], "b": [1]}"#),
    ("states", r#"{"x": {"initial": 1, "rate": "-x"}}"#),
    ("variables", r#"{"F": {"inequality": "-v"}}"#),
    ("parameters", r#"{"k": 1}"#),
    ("definitions", r#"{"slip": "v - v_belt"}"#),
    ("integrals", r#"{"work": "F*v"}"#),
    ("tables", r#"{"load": {"x": [0, 1], "y": [0, 2]}}"#),
    ("coordinates", r#"{"x": {"initial": 0, "velocity": 1}}"#),
    ("mass", r#"[["m", 0], [0, "m"]]"#),
    ("A", "[[0, 1], [-1, 0]]"),
    ("B", "[[0], [1]]"),
    ("C", "[[0, 1]]"),
    ("D", "[[0]]"),
    ("a", r#"[0, "sin(t)"]"#),
    ("g", "[0]"),
    ("initial", "[1, 0]"),
    ("forces", r#"{"x": "-k*x"}"#),
    ("friction", r#"{"coefficient": 0.5, "slip": ["x_dot"]}"#),
    ("contacts", r#"[{"name": "floor", "gap": "y"}]"#),
    ("components", r#"[{"resistor": {"name": "R1", "nodes": ["a", "0"], "ohms": 10}}]"#),
    ("nodes", r#"["a", "0"]"#),
    ("shape", r#"{"sphere": {"radius": 0.1}}"#),
    ("gravity", "[0, 0, -9.81]"),
    ("orientation", "[1, 0, 0, 0]"),
    ("position", "[0, 0, 1]"),
    ("axis", "[1, 0, 0]"),
    ("regions", r#"[{"indicator": "x", "rates": {"x": "-1"}}]"#),
];

/// The kinds of components of a circuit.
const KINDS_OF_COMPONENTS: [&str; 11] = [
    "resistor",
    "capacitor",
    "inductor",
    "diode",
    "zener",
    "switch",
    "voltage_source",
    "current_source",
    "transformer",
    "op_amp",
    "comparator",
];

/// Suggests what to write in place of the value `found` at the end of a path in the document, where `expected` is
/// required.
pub(super) fn instead(path: &[Step], found: &Json, expected: &str) -> Option<String> {
    let key = path.iter().rev().find_map(|step| if let Step::Key(key) = step { Some(key.as_str()) } else { None });
    let parent =
        path.len().checked_sub(2).and_then(|at| if let Step::Key(key) = &path[at] { Some(key.as_str()) } else { None });
    let is_member = matches!(path.last(), Some(Step::Key(_)));
    let shown = abridged(&found.to_string());
    match (found, key) {
        (Json::Text(text), _) if expected == "a boolean" => {
            return Some(match text.trim().to_lowercase().as_str() {
                "true" | "1" | "yes" | "on" | "high" => "`true` without quotes".to_owned(),
                "false" | "0" | "no" | "off" | "low" => "`false` without quotes".to_owned(),
                _ => "`true` or `false`, without quotes".to_owned(),
            });
        }
        (Json::Number(number), _) if expected == "a boolean" => {
            return Some(format!("`{}`", number.as_f64() != Some(0.0)));
        }
        (Json::Text(text), _) if expected.contains("number") && !expected.contains("expression") => {
            return Some(match text.trim().parse::<f64>() {
                Ok(value) if value.is_finite() => format!("`{}` without quotes", text.trim()),
                _ => "a number; expressions are not allowed here".to_owned(),
            });
        }
        (Json::Number(_) | Json::Bool(_), _) if expected == "a string" => return Some(format!("`{}`", quoted(&shown))),
        (Json::Text(text), _) if text.trim_start().starts_with(['[', '{']) => {
            return Some(format!("`{}` without quotes", abridged(text.trim())));
        }
        (Json::Text(text), Some("nodes")) if text.split_whitespace().count() == 2 => {
            let [a, b] = [0, 1].map(|place| quoted(text.split_whitespace().nth(place).unwrap_or_default()));
            return Some(format!("`[{a}, {b}]`"));
        }
        // Some sets, such as `nonnegative`, are a list of names; other sets have their names under `of`.
        (Json::Object(members), Some(_))
            if is_member && (expected == "a string" || expected.contains("list")) && names_in(members).is_some() =>
        {
            return names_in(members).map(|names| format!("the names alone: `{}`", abridged(&names.to_string())));
        }
        (Json::Number(_), Some("time")) => return Some(format!("`{{\"end\": {shown}}}`")),
        (Json::List(items), Some("time")) if items.len() == 2 => {
            return Some(format!("`{{\"start\": {}, \"end\": {}}}`", items[0], items[1]));
        }
        (Json::Number(number), Some("times")) => {
            let key = if number.as_u64().is_some() { "count" } else { "every" };
            return Some(format!("`{{\"{key}\": {shown}}}`"));
        }
        (Json::Text(_), Some("method")) if is_member => return Some(format!("`{{\"name\": {shown}}}`")),
        (Json::Text(_), Some("problem")) if is_member => return Some("`{\"dvi\": {...}}`".to_owned()),
        (Json::Text(_), None) if path.len() == 1 => return Some(format!("`{{\"when\": {shown}}}`")),
        (Json::Number(_) | Json::Text(_), Some("friction")) if is_member && expected == "an object" => {
            return Some(format!("`{{\"coefficient\": {shown}, \"slip\": [\"x_dot\"]}}`"));
        }
        (Json::Text(_), Some("stop")) if !is_member => return Some(format!("`{{\"when\": {shown}}}`")),
        (Json::Text(_) | Json::List(_) | Json::Number(_), Some(_)) if parent == Some("states") && is_member => {
            let rate = if let Json::Text(_) = found { shown } else { "\"-x\"".to_owned() };
            return Some(format!("`{{\"initial\": 0, \"rate\": {rate}}}`"));
        }
        (Json::Text(_), Some(_)) if parent == Some("variables") && is_member => {
            return Some(format!("`{{\"inequality\": {shown}}}`"));
        }
        (Json::List(items), Some(name)) if is_member && matches!(parent, Some("parameters" | "definitions")) => {
            return ranges(items)
                .map(|ranges| format!("a range with the name: `{}: {shown}`", quoted(&format!("{name}[{ranges}]"))));
        }
        (Json::List(items), Some("sensitivities")) if !items.is_empty() => {
            return Some(format!("`{{\"to\": {shown}}}`"));
        }
        (Json::List(items), Some("output")) if !items.is_empty() => return Some(format!("`{{\"fields\": {shown}}}`")),
        (Json::Object(members), Some(key)) if expected == "a list" && is_member && is_of_objects(members) => {
            return Some(format!("`{}`", abridged(&listed_objects(key, members))));
        }
        (Json::Object(members), _) if expected == "a list" && is_member && !members.is_empty() => {
            let values = members.iter().map(|(_, value)| value);
            let of_numbers = members.iter().all(|(_, value)| matches!(value, Json::Number(_)));
            if of_numbers {
                let values: Vec<String> = values.map(Json::to_string).collect();
                return Some(format!("`[{}]`", abridged(&values.join(", "))));
            }
            return Some(format!("`[{shown}]`"));
        }
        _ => {}
    }
    if let (Some(key @ ("A" | "B" | "C" | "D" | "mass")), false, true) = (key, is_member, expected == "a list") {
        let example = EXAMPLES.iter().find(|(name, _)| *name == key).map(|(_, example)| *example);
        return example.map(|example| format!("a list of rows: `{example}`"));
    }
    if path.is_empty() {
        return Some("`{\"problem\": {...}, \"time\": {\"end\": 1}}`".to_owned());
    }
    let example = EXAMPLES.iter().find(|(name, _)| is_member && Some(*name) == key).map(|(_, example)| *example);
    match (example, found) {
        (_, Json::Text(_))
            if expected == "a list"
                && !matches!(key, Some("set" | "stop" | "mass" | "axis" | "contacts" | "components")) =>
        {
            Some(format!("`[{shown}]`"))
        }
        (Some(example), _) => Some(format!("`{example}`")),
        _ if expected == "a list" => Some(format!("`[{shown}]`")),
        _ if expected.starts_with("3 entries") || expected.contains("length 3") => Some("`[0, 0, 1]`".to_owned()),
        _ => None,
    }
}

/// Returns as text the ranges of the indices of a list of values, or of a list of rows of equal length.
fn ranges(items: &[Json]) -> Option<String> {
    let lengths = items.iter().map(|item| if let Json::List(row) = item { Some(row.len()) } else { None });
    let lengths: Vec<Option<usize>> = lengths.collect();
    let first = *lengths.first()?;
    let range = match first {
        Some(columns) => format!("1..{},1..{columns}", items.len()),
        None => format!("1..{}", items.len()),
    };
    lengths.iter().all(|length| *length == first).then_some(range)
}

/// Whether a JSON object has members, and all of them are objects.
fn is_of_objects(members: &[(String, Json)]) -> bool {
    !members.is_empty() && members.iter().all(|(_, value)| matches!(value, Json::Object(_)))
}

/// Rewrites a JSON object of objects as a list: each key becomes the name of its entry, or its kind.
fn listed_objects(key: &str, members: &[(String, Json)]) -> String {
    let is_kind = |name: &str| match key {
        "components" => KINDS_OF_COMPONENTS.contains(&name),
        "set" => true,
        _ => false,
    };
    let named = |name: &str, value: &Json| {
        let Json::Object(own) = value else { return value.to_string() };
        let has_name = own.iter().any(|(key, _)| key == "name");
        let own: Vec<String> = own.iter().map(|(key, value)| format!("{}: {value}", quoted(key))).collect();
        let name = if has_name { Vec::new() } else { vec![format!("\"name\": {}", quoted(name))] };
        format!("{{{}}}", [name, own].concat().join(", "))
    };
    let entry = |(name, value): &(String, Json)| match (key, value) {
        _ if is_kind(name) => format!("{{{}: {value}}}", quoted(name)),
        // Expect an object such as `{"resistor": {..}}` under the name of a component; for any other value, show the
        // form of a resistor as an example.
        ("components", Json::Object(own)) => match own.as_slice() {
            [(kind, inner @ Json::Object(_))] => format!("{{{}: {}}}", quoted(kind), named(name, inner)),
            _ => format!("{{\"resistor\": {}}}", named(name, value)),
        },
        _ => named(name, value),
    };
    let entries: Vec<String> = members.iter().map(entry).collect();
    format!("[{}]", entries.join(", "))
}

/// Returns the first list of names in a JSON object.
fn names_in(members: &[(String, Json)]) -> Option<&Json> {
    members.iter().map(|(_, value)| value).find(|value| match value {
        Json::List(items) => !items.is_empty() && items.iter().all(|item| matches!(item, Json::Text(_))),
        _ => false,
    })
}

/// Suggests how to write a choice that needs contents, such as a set or a component, if only its name is given.
pub(super) fn alone(name: &Json) -> String {
    let of_names = ["free", "nonnegative", "nonpositive", "second_order_cone", "simplex"];
    match name {
        Json::Text(text) if of_names.contains(&text.as_str()) => format!("`{{{name}: [\"z\"]}}`"),
        _ => format!("`{{{name}: {{...}}}}`"),
    }
}

/// Suggests how to write a choice with contents, if the value `found` is not an object with one key.
pub(super) fn choice(found: &Json, valid: &[&'static str]) -> Option<String> {
    let is_valid = |name: &&&'static str, text: &str| **name == text;
    let named = match found {
        Json::Text(text) => valid.iter().find(|name| is_valid(name, text)),
        Json::Object(members) => members.iter().find_map(|(key, value)| match value {
            Json::Text(text) if matches!(key.as_str(), "type" | "kind" | "class" | "shape") => {
                valid.iter().find(|name| is_valid(name, text))
            }
            _ => None,
        }),
        _ => None,
    };
    let name = named.or(valid.first())?;
    Some(format!("`{{\"{name}\": {{...}}}}`"))
}
