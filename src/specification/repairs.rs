//! Repairs one structural error at a time: an unknown key is removed or its spelling corrected, a value of the wrong
//! type is replaced by a valid one, a missing value is inserted.

use super::error::{Errors, SpecificationError};
use super::foreign;
use super::json::Json;
use super::mismatch::Mismatch;
use super::pointer::{Step, pointer};
use super::shapes;
use super::wording::{abridged, listed};
use expression::nearest;

/// A place in the document whose content has been replaced to continue the check after an error.
#[derive(Debug)]
struct Repair {
    path: Vec<Step>,
    pointer: String,
    /// Number of replacement values tried at the place; the last one is in the document.
    tried: usize,
    /// Whether the replacement value is zero or null, so that the repair changes one value, and no list or object.
    plain: bool,
}

/// The places of a document whose content has been replaced after structural errors.
#[derive(Debug, Default)]
pub(super) struct Repairs(Vec<Repair>);

impl Repairs {
    /// Whether an error at the JSON pointer `pointer` may be the consequence of a repair.
    pub(super) fn explain(&self, pointer: &str) -> bool {
        self.0.iter().any(|repair| within(pointer, &repair.pointer) || within(&repair.pointer, pointer))
    }

    /// Whether anything at or below the JSON pointer `pointer` has been repaired.
    pub(super) fn touch(&self, pointer: &str) -> bool {
        self.0.iter().any(|repair| within(&repair.pointer, pointer))
    }

    /// Whether a repair at or below the JSON pointer `pointer` changed more than one value.
    pub(super) fn reshape(&self, pointer: &str) -> bool {
        self.0.iter().any(|repair| !repair.plain && within(&repair.pointer, pointer))
    }

    /// Reports a structural error (`mismatch`) of the document at `path` and repairs it. Returns false if no
    /// replacement fits.
    pub(super) fn mend(&mut self, json: &mut Json, path: Vec<Step>, mismatch: Mismatch, errors: &mut Errors) -> bool {
        match mismatch {
            Mismatch::UnknownKey { key, valid } => self.unknown_key(json, path, &key, valid, errors),
            Mismatch::MissingKey { key } => self.missing_key(json, path, key, errors),
            Mismatch::UnknownVariant { name, valid } => self.unknown_variant(json, path, &name, valid, errors),
            Mismatch::NotAVariant { found, valid } => {
                let expected = format!("an object with exactly one key or a string: {}", listed(valid.iter().copied()));
                let write = json.at_mut(&path).and_then(|found| shapes::choice(found, valid));
                self.wrong_type(json, path, &found, (expected, write), &choice(valid), errors)
            }
            Mismatch::WrongType { found, expected } if expected == "newtype variant" => {
                let write = json.at_mut(&path).map(|name| shapes::alone(name));
                let (found, expected) =
                    (found.replace("unit variant", "only its name"), "an object with it as the only key");
                self.wrong_type(json, path, &found, (expected.to_owned(), write), &stand_ins(), errors)
            }
            Mismatch::WrongType { found, expected } => {
                let write = json.at_mut(&path).and_then(|found| shapes::instead(&path, found, &expected));
                self.wrong_type(json, path, &found, (expected, write), &stand_ins(), errors)
            }
            Mismatch::Other(detail) => {
                errors.push(SpecificationError::new(pointer(&path), "invalid_value", detail));
                false
            }
        }
    }

    fn unknown_key(
        &mut self,
        json: &mut Json,
        mut path: Vec<Step>,
        key: &str,
        valid: &'static [&'static str],
        errors: &mut Errors,
    ) -> bool {
        if path.last() == Some(&Step::Key(key.into())) {
            path.pop();
        }
        let Some(Json::Object(members)) = json.at_mut(&path) else { return false };
        let suggestion = foreign::synonym(key, valid).or_else(|| nearest(key, valid.iter().copied()));
        let free = suggestion.filter(|name| members.iter().all(|(other, _)| other != name));
        let Some(position) = members.iter().position(|(name, _)| name == key) else { return false };
        let place = [path.as_slice(), &[Step::Key(key.into())]].concat();
        if !self.covers(&place) {
            let elsewhere = suggestion.map_or_else(|| foreign::place_of(key), |_| None);
            let remark = elsewhere.map(|(place, name)| format!("; `{name}` belongs in {place}")).unwrap_or_default();
            let detail = format!("`{}` is not a key here{remark}", abridged(key));
            errors.push(
                SpecificationError::new(pointer(&place), "unknown_key", detail)
                    .expected(listed(valid.iter().copied()))
                    .did_you_mean(suggestion),
            );
        }
        match free {
            // Continue with the corrected spelling of the key: its contents are the user's, and so are errors in them.
            Some(name) => members[position].0 = name.into(),
            None => {
                members.remove(position);
            }
        }
        true
    }

    fn missing_key(&mut self, json: &mut Json, mut path: Vec<Step>, key: &'static str, errors: &mut Errors) -> bool {
        if !self.covers(&path) {
            let detail = format!("`{key}` is missing");
            errors.push(SpecificationError::new(pointer(&path), "missing_key", detail).expected(format!("`{key}`")));
        }
        let Some(Json::Object(members)) = json.at_mut(&path) else { return false };
        members.push((key.into(), Json::Null));
        path.push(Step::Key(key.into()));
        self.record(path, true);
        true
    }

    fn unknown_variant(
        &mut self,
        json: &mut Json,
        mut path: Vec<Step>,
        name: &str,
        valid: &'static [&'static str],
        errors: &mut Errors,
    ) -> bool {
        if path.last() == Some(&Step::Key(name.into())) && json.at_mut(&path[..path.len() - 1]).is_some_and(is_tagged) {
            path.pop();
        }
        let suggestion = foreign::synonym(name, valid).or_else(|| nearest(name, valid.iter().copied()));
        let Some(value) = json.at_mut(&path) else { return false };
        let mut place = path.clone();
        if matches!(value, Json::Object(_)) {
            place.push(Step::Key(name.into()));
        }
        if !self.covers(&path) {
            let detail = format!("`{}` is not a choice here", abridged(name));
            let names = listed(valid.iter().copied());
            let is_type = valid.contains(&"dvi") && foreign::is_of_a_type(name);
            let expected =
                if is_type { format!("the type around it: {{\"dvi\": {{\"{name}\": ...}}}}; {names}") } else { names };
            errors.push(
                SpecificationError::new(pointer(&place), "unknown_choice", detail)
                    .expected(expected)
                    .did_you_mean(suggestion),
            );
        }
        match (value, suggestion, valid.first()) {
            (Json::Object(members), Some(name), _) if members.len() == 1 => members[0].0 = name.into(),
            (Json::Text(text), Some(name), _) => *text = name.into(),
            (value, _, Some(&name)) => {
                *value = match value {
                    Json::Object(_) => Json::Object(vec![(name.into(), Json::Null)]),
                    _ => Json::Text(name.into()),
                };
                self.record(path, false);
            }
            (_, _, None) => return false,
        }
        true
    }

    fn wrong_type(
        &mut self,
        json: &mut Json,
        path: Vec<Step>,
        found: &str,
        (expected, write): (String, Option<String>),
        stand_ins: &[Json],
        errors: &mut Errors,
    ) -> bool {
        let is_list = expected.contains("list");
        if !self.covers(&path) {
            let detail = format!("found {found}, expected {expected}");
            errors.push(
                SpecificationError::new(pointer(&path), "wrong_type", detail).expected(write.unwrap_or(expected)),
            );
        }
        let Some(value) = json.at_mut(&path) else { return false };
        let repair = self.record(path, true);
        // Do not replace a list by a number or a text, which would count as a list of one element: later checks would
        // report its length, which is not that of the user's list.
        let stand_ins: Vec<&Json> = match is_list {
            true => stand_ins.iter().filter(|stand_in| !matches!(stand_in, Json::Number(_) | Json::Text(_))).collect(),
            false => stand_ins.iter().collect(),
        };
        let Some(&stand_in) = stand_ins.get(repair.tried) else { return false };
        repair.tried += 1;
        repair.plain = matches!(stand_in, Json::Null | Json::Number(_));
        *value = stand_in.clone();
        true
    }

    /// Whether `path` lies within a part of the document that a repair has replaced.
    fn covers(&self, path: &[Step]) -> bool {
        self.0.iter().any(|repair| path.starts_with(&repair.path))
    }

    fn record(&mut self, path: Vec<Step>, plain: bool) -> &mut Repair {
        let position = self.0.iter().position(|repair| repair.path == path).unwrap_or_else(|| {
            self.0.push(Repair { pointer: pointer(&path), path, tried: 0, plain });
            self.0.len() - 1
        });
        &mut self.0[position]
    }
}

/// Whether the JSON pointer `pointer` equals `ancestor` or lies below it.
fn within(pointer: &str, ancestor: &str) -> bool {
    pointer.strip_prefix(ancestor).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

fn is_tagged(json: &mut Json) -> bool {
    matches!(json, Json::Object(_))
}

/// Returns replacement values for a faulty value, one of each type that a document may require, simplest first.
fn stand_ins() -> Vec<Json> {
    let zero = || Json::Number(0.into());
    vec![
        Json::Null,
        zero(),
        Json::Text(String::new()),
        Json::List(Vec::new()),
        Json::Object(Vec::new()),
        Json::List(vec![zero(), zero()]),
        Json::List(vec![zero(), zero(), zero()]),
    ]
}

/// Returns a replacement for a faulty choice among the keywords `valid`. With null as its contents it also fits a plain
/// keyword.
fn choice(valid: &[&str]) -> Vec<Json> {
    valid.first().map(|name| Json::Object(vec![((*name).into(), Json::Null)])).into_iter().collect()
}
