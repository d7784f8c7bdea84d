//! Names of numbers in a document: `m`, a parameter; `x.initial`, the initial value of a state; `theta.velocity`, the
//! initial velocity of a coordinate; `R1`, the value of a component; `ball.mass`, a number of a named object.
//!
//! A swept number that is not a parameter becomes one before the document is read ([`lift`]): it is replaced by the
//! name of a new parameter, so that other values can be bound to the compiled problem.

use super::range::Range;
use crate::error::{Errors, SpecificationError};
use crate::json::Json;
use crate::pointer::{Step, pointer};
use crate::vectors::Vectors;
use crate::wording::{abridged, listed};
use expression::nearest;
use serde::Deserialize;
use serde_json::Number;

/// A swept number: its name, and the parameter that stands for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// The name of the swept number, as the user wrote it.
    pub name: String,
    /// The name of the parameter that stands for the swept number.
    pub parameter: String,
}

/// Keys of numbers in named objects of a document, also if the numbers are given as expressions. The value of a
/// component is at the first key of the list that the component has.
const VALUES: [&str; 12] = [
    "ohms",
    "farads",
    "henries",
    "volts",
    "amperes",
    "ratio",
    "breakdown_volts",
    "forward_volts",
    "mass",
    "density",
    "stiffness",
    "restitution",
];

/// Returns the names of the numbers in a document with expanded vectors, each with its path.
pub fn targets(json: &Json) -> Vec<(String, Vec<Step>)> {
    let key = |name: &str| Step::Key(name.to_owned());
    let mut found = Vec::new();
    let Some(Json::Object(types)) = json.child(&key("problem")) else { return found };
    let [(kind, Json::Object(sections))] = types.as_slice() else { return found };
    let path = |steps: &[Step]| [&[key("problem"), key(kind)], steps].concat();
    for (section, value) in sections {
        match value {
            Json::Object(members) if section == "parameters" => {
                found.extend(members.iter().map(|(name, _)| (name.clone(), path(&[key(section), key(name)]))));
            }
            Json::Object(members) if ["states", "coordinates"].contains(&section.as_str()) => {
                for (name, _) in members {
                    let starts: &[&str] = if section == "states" { &["initial"] } else { &["initial", "velocity"] };
                    for start in starts {
                        found.push((format!("{name}.{start}"), path(&[key(section), key(name), key(start)])));
                    }
                }
            }
            // Initial positions and velocities in the `pose` of a robot description.
            Json::Object(members) if kind == "rigid_bodies" && section == "robot" => {
                let Some((_, Json::Object(pose))) = members.iter().find(|(name, _)| name == "pose") else { continue };
                for (name, start) in pose {
                    let of = |last: &[&str]| {
                        let steps = ["robot", "pose", name].into_iter().chain(last.iter().copied()).map(&key);
                        path(&steps.collect::<Vec<_>>())
                    };
                    match start {
                        Json::Number(_) => found.push((format!("{name}.position"), of(&[]))),
                        Json::Object(members) => {
                            let numbers = members.iter().filter(|(_, value)| matches!(value, Json::Number(_)));
                            found.extend(numbers.map(|(last, _)| (format!("{name}.{last}"), of(&[last]))));
                        }
                        _ => {}
                    }
                }
            }
            Json::List(items) if kind == "lcs" && section == "initial" => {
                let names = sections.iter().find(|(name, _)| name == "state_names");
                for i in 0..items.len() {
                    let given = names.and_then(|(_, names)| names.child(&Step::Index(i)));
                    let name = match given {
                        Some(Json::Text(name)) => name.clone(),
                        _ => format!("x{}", i + 1),
                    };
                    found.push((format!("{name}.initial"), path(&[key(section), Step::Index(i)])));
                }
            }
            Json::List(items) => {
                for (i, item) in items.iter().enumerate() {
                    of_named(item, path(&[key(section), Step::Index(i)]), &mut found);
                }
            }
            _ => {}
        }
    }
    found
}

/// Adds the numbers of a list entry with a name, such as a body or a component; the entry may be externally tagged by
/// its kind.
fn of_named(item: &Json, mut path: Vec<Step>, found: &mut Vec<(String, Vec<Step>)>) {
    let Json::Object(mut members) = item.clone() else { return };
    if let [(kind, Json::Object(inner))] = members.as_slice() {
        path.push(Step::Key(kind.clone()));
        members = inner.clone();
    }
    let Some((_, Json::Text(name))) = members.iter().find(|(key, _)| key == "name") else { return };
    let is_component = path.iter().any(|step| *step == Step::Key("components".to_owned()));
    let value = VALUES.iter().find_map(|value| members.iter().map(|(key, _)| key).find(|key| key == value));
    if let Some(key) = value.filter(|_| is_component) {
        found.push((name.clone(), [path.as_slice(), &[Step::Key(key.clone())]].concat()));
    }
    for (key, value) in &members {
        let is_value = match value {
            Json::Number(_) => true,
            Json::Text(_) => VALUES.contains(&key.as_str()),
            _ => false,
        };
        if is_value {
            found.push((format!("{name}.{key}"), [path.as_slice(), &[Step::Key(key.clone())]].concat()));
        }
    }
}

/// Returns the swept names, with their ranges if these are readable: the keys of `sweep.over`, or the columns of
/// `sweep.table`.
fn swept(json: &Json) -> Vec<(String, Vec<Step>, Option<Range>)> {
    let key = |name: &str| Step::Key(name.to_owned());
    let Some(sweep) = json.child(&key("sweep")) else { return Vec::new() };
    if let Some(Json::Object(over)) = sweep.child(&key("over")) {
        let entry = |(name, range): &(String, Json)| {
            (name.clone(), vec![key("sweep"), key("over"), key(name)], Range::deserialize(range).ok())
        };
        return over.iter().map(entry).collect();
    }
    let Some(table) = sweep.child(&key("table")) else { return Vec::new() };
    let Some(Json::List(columns)) = table.child(&key("columns")) else { return Vec::new() };
    let first = table.child(&key("rows")).and_then(|rows| rows.child(&Step::Index(0)));
    let entry = |(i, name): (usize, &Json)| {
        let Json::Text(name) = name else { return None };
        let value = first.and_then(|row| row.child(&Step::Index(i))).and_then(|value| f64::deserialize(value).ok());
        let place = vec![key("sweep"), key("table"), key("columns"), Step::Index(i)];
        Some((name.clone(), place, value.map(|value| Range::List(vec![value]))))
    };
    columns.iter().enumerate().filter_map(entry).collect()
}

/// Replaces every swept number of the document by a new parameter with the numerical value of the number. Unknown
/// names are reported.
pub fn lift(json: &mut Json, vectors: &mut Vectors, errors: &mut Errors) -> Vec<Target> {
    let swept = swept(json);
    if swept.is_empty() {
        return Vec::new();
    }
    let known = targets(json);
    let mut found = Vec::with_capacity(swept.len());
    for (name, place, range) in swept {
        let Some((_, path)) = known.iter().find(|(known, _)| *known == name) else {
            errors.push(unknown(&name, pointer(&place), &known));
            continue;
        };
        let is_parameter = path.iter().any(|step| *step == Step::Key("parameters".to_owned())) && !name.contains('.');
        let given = match json.at_mut(path) {
            Some(Json::Number(number)) => Some(number.clone()),
            _ => None,
        };
        let value = given.or_else(|| number(range.as_ref()?.representative())).unwrap_or_else(|| 1.into());
        let parameter = if is_parameter { name.clone() } else { free_name(json, &name) };
        if !is_parameter {
            put(json, path, Json::Text(parameter.clone()));
        }
        let mut hidden = path[..2].to_vec();
        hidden.extend([Step::Key("parameters".to_owned()), Step::Key(parameter.clone())]);
        if !is_parameter {
            vectors.stands_for(pointer(&hidden), pointer(&place));
        }
        put(json, &hidden, Json::Number(value));
        found.push(Target { name, parameter });
    }
    found
}

/// Sets named numbers of a document, and returns the names that the document does not have.
pub fn set<'a>(json: &mut Json, values: &'a [(String, f64)]) -> Vec<&'a str> {
    let known = targets(json);
    let mut unknown = Vec::new();
    for (name, value) in values {
        match (known.iter().find(|(known, _)| known == name), number(*value)) {
            (Some((_, path)), Some(number)) => put(json, path, Json::Number(number)),
            _ => unknown.push(name.as_str()),
        }
    }
    unknown
}

/// Converts a value to a JSON number; a whole number is written without a decimal point, as the sizes of vectors
/// require.
fn number(value: f64) -> Option<Number> {
    let whole = value as i64;
    // Above 2^53 doubles do not represent every whole number; zero may be negative.
    let is_whole = value.abs() < 9e15 && value == whole as f64 && value.to_bits() != (-0.0_f64).to_bits();
    if is_whole { Some(whole.into()) } else { Number::from_f64(value) }
}

/// Returns the error for an unknown name of a number to sweep or to set.
pub fn unknown(name: &str, pointer: String, known: &[(String, Vec<Step>)]) -> SpecificationError {
    let names = || known.iter().map(|(name, _)| name.as_str());
    let detail = format!(
        "`{}` is neither a parameter nor the initial value of a state nor a number of a named object",
        abridged(name)
    );
    let expected = match known.is_empty() {
        true => "a parameter: put the number under `parameters`, and the name of the parameter in its place".to_owned(),
        false => listed(names()),
    };
    SpecificationError::new(pointer, "unknown_name", detail).expected(expected).did_you_mean(nearest(name, names()))
}

/// Sets the value at a path of a JSON document; missing objects are created.
pub fn put(json: &mut Json, path: &[Step], value: Json) {
    let Some((step, rest)) = path.split_first() else {
        *json = value;
        return;
    };
    match (json, step) {
        (Json::Object(members), Step::Key(key)) => {
            let at = members.iter().position(|(name, _)| name == key).unwrap_or_else(|| {
                members.push((key.clone(), Json::Object(Vec::new())));
                members.len() - 1
            });
            put(&mut members[at].1, rest, value);
        }
        (Json::List(items), Step::Index(index)) => {
            if let Some(item) = items.get_mut(*index) {
                put(item, rest, value);
            }
        }
        _ => {}
    }
}

/// Derives from the name `of` a name that does not occur in the document.
fn free_name(json: &Json, of: &str) -> String {
    let mut name: String = of.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.starts_with(|c: char| c.is_ascii_digit()) {
        name.insert(0, '_');
    }
    let text = json.to_string();
    while text.contains(&name) {
        name.push('_');
    }
    name
}

/// Sets the value at a JSON pointer (RFC 6901) of a document; the last key may be new.
pub fn put_at(json: &mut Json, pointer: &str, value: Json, errors: &mut Errors) {
    let mut at = json;
    let mut keys = pointer.split('/').skip(1).map(|key| key.replace("~1", "/").replace("~0", "~")).peekable();
    while let Some(key) = keys.next() {
        let is_last = keys.peek().is_none();
        let next = match at {
            Json::Object(members) => {
                if is_last && members.iter().all(|(name, _)| *name != key) {
                    members.push((key.clone(), Json::Null));
                }
                members.iter_mut().find(|(name, _)| *name == key).map(|(_, value)| value)
            }
            Json::List(items) => key.parse::<usize>().ok().and_then(|index| items.get_mut(index)),
            _ => None,
        };
        let Some(next) = next else {
            let error = SpecificationError::new(pointer, "unknown_key", format!("there is no `{}`", abridged(&key)));
            errors.push(error.expected("a JSON pointer of the document, such as /method/rtol"));
            return;
        };
        at = next;
    }
    *at = value;
}
