//! A JSON document as written: members in order, repeated names included.

use super::pointer::Step;
use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::Number;
use std::collections::HashSet;
use std::fmt;

/// A JSON value of a document as written, with object members in order.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Json {
    Null,
    Bool(bool),
    Number(Number),
    Text(String),
    List(Vec<Json>),
    Object(Vec<(String, Json)>),
}

impl Json {
    /// Returns the member or element of a JSON value at a step of a path.
    pub(super) fn child(&self, step: &Step) -> Option<&Json> {
        match (self, step) {
            (Json::Object(members), Step::Key(key)) => {
                members.iter().find(|(name, _)| name == key).map(|(_, value)| value)
            }
            (Json::List(items), Step::Index(index)) => items.get(*index),
            _ => None,
        }
    }

    /// Returns the part of a JSON value at a path.
    pub(super) fn at_mut(&mut self, path: &[Step]) -> Option<&mut Json> {
        path.iter().try_fold(self, |value, step| match (value, step) {
            (Json::Object(members), Step::Key(key)) => {
                members.iter_mut().find(|(name, _)| name == key).map(|(_, value)| value)
            }
            (Json::List(items), Step::Index(index)) => items.get_mut(*index),
            _ => None,
        })
    }

    /// Removes members of JSON objects that repeat a name of the same object, and calls `found` with the path of each
    /// removed member.
    pub(super) fn remove_duplicates(&mut self, path: &mut Vec<Step>, found: &mut impl FnMut(&[Step])) {
        match self {
            Json::Object(members) => {
                if repeat_a_name(members) {
                    let mut seen = HashSet::new();
                    members.retain(|(name, _)| {
                        let first = seen.insert(name.clone());
                        if !first {
                            path.push(Step::Key(name.clone()));
                            found(path);
                            path.pop();
                        }
                        first
                    });
                }
                for (name, value) in members.iter_mut().filter(|(_, value)| value.is_container()) {
                    path.push(Step::Key(name.clone()));
                    value.remove_duplicates(path, found);
                    path.pop();
                }
            }
            Json::List(items) => {
                for (index, value) in items.iter_mut().enumerate().filter(|(_, value)| value.is_container()) {
                    path.push(Step::Index(index));
                    value.remove_duplicates(path, found);
                    path.pop();
                }
            }
            _ => {}
        }
    }

    fn is_container(&self) -> bool {
        matches!(self, Json::List(_) | Json::Object(_))
    }
}

/// Whether two members of a JSON object have the same name. A few names are compared pairwise, without allocating.
fn repeat_a_name(members: &[(String, Json)]) -> bool {
    if members.len() <= FEW {
        return (1..members.len()).any(|k| members[..k].iter().any(|(name, _)| *name == members[k].0));
    }
    let mut seen = HashSet::with_capacity(members.len());
    !members.iter().all(|(name, _)| seen.insert(name))
}

const FEW: usize = 8;

impl<'de> Deserialize<'de> for Json {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(JsonVisitor)
    }
}

struct JsonVisitor;

impl<'de> Visitor<'de> for JsonVisitor {
    type Value = Json;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> Result<Json, E> {
        Ok(Json::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Json, E> {
        Ok(Json::Bool(value))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Json, E> {
        Ok(Json::Number(value.into()))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Json, E> {
        Ok(Json::Number(value.into()))
    }

    fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<Json, E> {
        Number::from_f64(value).map(Json::Number).ok_or_else(|| E::custom("number out of range"))
    }

    fn visit_str<E>(self, value: &str) -> Result<Json, E> {
        Ok(Json::Text(value.into()))
    }

    fn visit_string<E>(self, value: String) -> Result<Json, E> {
        Ok(Json::Text(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut access: A) -> Result<Json, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = access.next_element()? {
            items.push(item);
        }
        Ok(Json::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Json, A::Error> {
        let mut members = Vec::new();
        while let Some(member) = access.next_entry()? {
            members.push(member);
        }
        Ok(Json::Object(members))
    }
}

impl fmt::Display for Json {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Json::Null => formatter.write_str("null"),
            Json::Bool(value) => write!(formatter, "{value}"),
            Json::Number(number) => write!(formatter, "{number}"),
            Json::Text(text) => write!(formatter, "{}", serde_json::Value::from(text.as_str())),
            Json::List(items) => {
                formatter.write_str("[")?;
                for (index, item) in items.iter().enumerate() {
                    write!(formatter, "{}{item}", if index > 0 { ", " } else { "" })?;
                }
                formatter.write_str("]")
            }
            Json::Object(members) => {
                formatter.write_str("{")?;
                for (index, (name, value)) in members.iter().enumerate() {
                    let separator = if index > 0 { ", " } else { "" };
                    write!(formatter, "{separator}{}: {value}", serde_json::Value::from(name.as_str()))?;
                }
                formatter.write_str("}")
            }
        }
    }
}
