//! Expansion of vectors before a document is read. A member `"x[1..n]"` becomes one member per element, in which the
//! index `i` is replaced by its value; a name with a range in a list of names becomes the names of all elements; a list
//! entry whose `name`, `label` or (for a box) `of` has a range becomes one entry per element. A list in the place of a
//! number or an expression gives one value for each element; for a name with two ranges it may be a list of rows.
//!
//! Later stages see only the expanded document; their errors are mapped back to the place of the range.

mod range;

use super::deserializer::COMMENT;
use super::error::{Errors, SpecificationError};
use super::json::Json;
use super::pointer::{Step, pointer};
use super::robot;
use super::wording::abridged;
use range::{MOST_ELEMENTS, Range, Values, replaced};
use std::collections::{HashMap, HashSet};

/// The record of an expansion of vectors, which maps errors back to the user's document.
#[derive(Debug, Default)]
pub(super) struct Vectors {
    /// Names of parameters that determine the numbers of elements of vectors.
    pub sizes: Vec<String>,
    /// Pointers in the user's document, by pointers in the document with expanded vectors.
    origins: HashMap<String, String>,
    /// JSON pointers of names with a faulty index range, which are not expanded.
    wrong: HashSet<String>,
    /// The origins of bodies and joints that have replaced the description of a robot.
    pub robot: robot::Origins,
}

impl Vectors {
    /// Maps the pointers of errors back to the user's document, and removes repetitions.
    pub fn at_origins(&self, errors: Vec<SpecificationError>) -> Vec<SpecificationError> {
        self.robot.at_origins(self.before_vectors(errors))
    }

    /// Maps the pointers of errors back to the document as it was before the expansion of vectors, and removes
    /// repetitions.
    fn before_vectors(&self, errors: Vec<SpecificationError>) -> Vec<SpecificationError> {
        if self.origins.is_empty() && self.wrong.is_empty() {
            return errors;
        }
        let mut seen = HashSet::new();
        let is_told =
            |error: &SpecificationError| error.code == "malformed_name" && self.wrong.contains(&error.pointer);
        let errors = errors.into_iter().filter(|error| !is_told(error));
        let moved = errors.map(|error| SpecificationError { pointer: self.origin(error.pointer), ..error });
        moved.filter(|error| seen.insert((error.pointer.clone(), error.code))).collect()
    }

    /// Redirects errors at the JSON pointer `new`, in the expanded document, to the pointer `old` in the user's
    /// document.
    pub fn stands_for(&mut self, new: String, old: String) {
        self.origins.insert(new, old);
    }

    fn origin(&self, pointer: String) -> String {
        let mut end = pointer.len();
        loop {
            if let Some(origin) = self.origins.get(&pointer[..end]) {
                return format!("{origin}{}", &pointer[end..]);
            }
            match pointer[..end].rfind('/') {
                Some(slash) => end = slash,
                None => return pointer,
            }
        }
    }
}

/// Expands the vectors of a document; faulty vectors are reported and left as they are.
pub(super) fn write_out(json: &mut Json, errors: &mut Errors) -> Vectors {
    let mut expansion = Expansion {
        vectors: Vectors::default(),
        parameters: HashMap::new(),
        taken: HashSet::from(["t".to_owned()]),
        elements: 0,
        errors,
    };
    let Json::Object(members) = json else { return expansion.vectors };
    let problem = members.iter().find(|(key, _)| key == "problem").and_then(|(_, problem)| problem.only());
    if let Some(Json::Object(parameters)) =
        problem.and_then(|problem| problem.child(&Step::Key("parameters".to_owned())))
    {
        let whole = parameters.iter().filter_map(|(name, value)| match value {
            Json::Number(number) => Some((name.clone(), number.as_i64()?)),
            _ => None,
        });
        expansion.parameters = whole.collect();
    }
    if let Some(Json::Object(sections)) = problem {
        let named = ["parameters", "definitions", "integrals", "tables", "states", "variables", "coordinates"];
        for (_, section) in sections.iter().filter(|(key, _)| named.contains(&key.as_str())) {
            if let Json::Object(entries) = section {
                expansion.taken.extend(entries.iter().map(|(name, _)| name.clone()));
            }
        }
    }
    for key in ["problem", "stop", "output", "sensitivities"] {
        let mut place = ExpandedPath { new: vec![Step::Key(key.to_owned())], old: vec![Step::Key(key.to_owned())] };
        if let Some((_, value)) = members.iter_mut().find(|(name, _)| name == key) {
            expansion.value(value, &mut place);
        }
    }
    expansion.vectors.sizes.sort_unstable();
    expansion.vectors.sizes.dedup();
    expansion.vectors
}

/// Returns the values of a list of rows of equal length as one list, row by row; `None` for any other value.
fn of_rows(value: &Json) -> Option<Json> {
    let Json::List(rows) = value else { return None };
    let values = |row: &Json| match row {
        Json::List(values) if values.iter().all(|value| matches!(value, Json::Number(_) | Json::Text(_))) => {
            Some(values.clone())
        }
        _ => None,
    };
    let rows = rows.iter().map(values).collect::<Option<Vec<_>>>()?;
    let is_even = rows.windows(2).all(|two| two[0].len() == two[1].len());
    (is_even && !rows.is_empty()).then(|| Json::List(rows.concat()))
}

/// A path in the document with expanded vectors, and the corresponding path in the user's document.
struct ExpandedPath {
    new: Vec<Step>,
    old: Vec<Step>,
}

struct Expansion<'e> {
    vectors: Vectors,
    parameters: HashMap<String, i64>,
    /// Names that the indices of vectors must not have, since they are in use.
    taken: HashSet<String>,
    elements: usize,
    errors: &'e mut Errors,
}

impl Expansion<'_> {
    fn value(&mut self, value: &mut Json, place: &mut ExpandedPath) {
        match value {
            Json::Object(members) => self.members(members, place),
            Json::List(items) => self.items(items, place),
            _ => {}
        }
    }

    fn members(&mut self, members: &mut Vec<(String, Json)>, place: &mut ExpandedPath) {
        let written = std::mem::take(members);
        for (key, mut value) in written {
            let step = Step::Key(key.clone());
            let Some(range) = self.range(&key, place, &step) else {
                place.new.push(step.clone());
                place.old.push(step);
                // The columns of a table are not vectors of the problem.
                if key != "tables" {
                    self.value(&mut value, place);
                }
                place.new.pop();
                place.old.pop();
                members.push((key, value));
                continue;
            };
            place.old.push(step);
            if let Some(values) = of_rows(&value) {
                value = values;
            }
            for (position, (name, values)) in range.elements().enumerate() {
                place.new.push(Step::Key(name.clone()));
                let element = self.element(&value, &values, (position, range.len()), place);
                self.remember(place);
                place.new.pop();
                members.push((name, element));
            }
            place.old.pop();
        }
    }

    fn items(&mut self, items: &mut Vec<Json>, place: &mut ExpandedPath) {
        let written = std::mem::take(items);
        for (index, mut item) in written.into_iter().enumerate() {
            let step = Step::Index(index);
            let name = named(&item).map(str::to_owned);
            let range = name.as_ref().and_then(|name| self.range(name, place, &step));
            place.old.push(step);
            match range {
                Some(range) => {
                    for (position, (name, values)) in range.elements().enumerate() {
                        place.new.push(Step::Index(items.len()));
                        let element = match &item {
                            Json::Text(_) => Json::Text(name),
                            item => {
                                let mut element = self.element(item, &values, (position, range.len()), place);
                                rename(&mut element, &name);
                                element
                            }
                        };
                        self.remember(place);
                        place.new.pop();
                        items.push(element);
                    }
                }
                None => {
                    place.new.push(Step::Index(items.len()));
                    if items.len() != index {
                        self.remember(place);
                    }
                    self.value(&mut item, place);
                    place.new.pop();
                    items.push(item);
                }
            }
            place.old.pop();
        }
    }

    /// Returns one element of a vector: indices in texts are replaced by their values, and lists by the element's own
    /// value.
    fn element(
        &mut self,
        value: &Json,
        values: &Values<'_>,
        (position, count): (usize, Option<usize>),
        place: &ExpandedPath,
    ) -> Json {
        match value {
            Json::Text(text) => Json::Text(replaced(text, values)),
            Json::Object(members) => {
                let element = |(key, value): &(String, Json)| {
                    (key.clone(), self.element(value, values, (position, count), place))
                };
                Json::Object(members.iter().map(element).collect())
            }
            Json::List(items)
                if items.iter().all(|item| matches!(item, Json::Number(_) | Json::Text(_))) && !is_of_names(items) =>
            {
                match items.get(position) {
                    Some(item) if count == Some(items.len()) => self.element(item, values, (position, count), place),
                    _ => {
                        let detail = format!("{} values for {} elements", items.len(), count.unwrap_or(0));
                        let error = SpecificationError::new(pointer(&place.old), "wrong_count", detail);
                        self.errors.push(error.expected("one value for all elements, or a list with one for each"));
                        Json::Number(0.into())
                    }
                }
            }
            Json::List(items) => {
                Json::List(items.iter().map(|item| self.element(item, values, (position, count), place)).collect())
            }
            other => other.clone(),
        }
    }

    /// Reads the index range of a name such as `x[1..n]`, if it has a valid one.
    fn range<'t>(&mut self, name: &'t str, place: &ExpandedPath, step: &Step) -> Option<Range<'t>> {
        let at = || pointer(&[place.old.as_slice(), std::slice::from_ref(step)].concat());
        let sizes = std::cell::RefCell::new(Vec::new());
        let size = |name: &str| {
            let value = self.parameters.get(name).copied()?;
            sizes.borrow_mut().push(name.to_owned());
            Some(value)
        };
        let read = Range::read(name, at, size);
        self.vectors.sizes.append(&mut sizes.into_inner());
        let range = match read {
            Ok(range) => range?,
            Err(error) => {
                self.vectors.wrong.insert(at());
                self.errors.push(error);
                return None;
            }
        };
        if let Some(index) = range.indices().find(|index| self.taken.contains(*index)) {
            let detail = format!("the index `{index}` of `{}` has a name that is in use already", abridged(name));
            let error = SpecificationError::new(at(), "duplicate_name", detail);
            self.errors.push(error.expected(format!("another name for it, as in `{}[k in 1..n]`", range.name)));
            self.vectors.wrong.insert(at());
            return None;
        }
        self.elements += range.len().unwrap_or(0);
        if self.elements > MOST_ELEMENTS {
            let error =
                SpecificationError::new(at(), "too_many_unknowns", "all vectors together have too many elements");
            self.errors.push(error.expected(format!("at most {MOST_ELEMENTS} elements")));
            return None;
        }
        Some(range)
    }

    fn remember(&mut self, place: &ExpandedPath) {
        self.vectors.origins.insert(pointer(&place.new), pointer(&place.old));
    }
}

/// Whether a list consists of indexed names, so that it does not give one value per element.
fn is_of_names(items: &[Json]) -> bool {
    let is_name = |text: &str| {
        let parts = text.strip_suffix(']').and_then(|text| text.split_once('['));
        parts.is_some_and(|(name, inside)| !name.contains([' ', '*', '+']) && !inside.contains(['[', '*', '+']))
    };
    items.iter().all(|item| matches!(item, Json::Text(text) if is_name(text)))
}

/// Returns the name of a list entry that may have a range: of a text the text itself, of a box its only variable.
fn named(item: &Json) -> Option<&str> {
    match item {
        Json::Text(text) => Some(text),
        Json::Object(members) => members.iter().find_map(|(key, value)| match (key.as_str(), value) {
            ("name" | "label", Json::Text(text)) => Some(text.as_str()),
            ("box", Json::Object(_)) => match value.child(&Step::Key("of".to_owned())) {
                Some(Json::List(of)) if of.len() == 1 => named(&of[0]),
                _ => None,
            },
            _ => None,
        }),
        _ => None,
    }
}

/// Replaces the name with an index range in an element of a vector by the name of the element.
fn rename(element: &mut Json, name: &str) {
    let Json::Object(members) = element else { return };
    for (key, value) in members {
        match (key.as_str(), value) {
            ("name" | "label", Json::Text(text)) => *text = name.to_owned(),
            ("box", value) => {
                if let Some(Json::List(of)) = value.at_mut(&[Step::Key("of".to_owned())]) {
                    *of = vec![Json::Text(name.to_owned())];
                }
            }
            _ => {}
        }
    }
}

impl Json {
    /// Returns the value of a JSON object with one member, apart from comments.
    fn only(&self) -> Option<&Json> {
        let Json::Object(members) = self else { return None };
        let mut members = members.iter().filter(|(name, _)| name != COMMENT);
        members.next().filter(|_| members.next().is_none()).map(|(_, value)| value)
    }
}
