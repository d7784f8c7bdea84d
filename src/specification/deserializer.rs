//! Deserialises serde types from a [`Json`]. Stricter than deserialising from text: an object must not be written as a
//! list, and a choice is a string or an object with exactly one key. More lenient in two respects:
//!
//! - A value in the place of a list stands for a list of one element, as MATLAB, Octave and R write it.
//! - A member `comment` of an object with fixed keys is ignored, unless it is one of the keys.

use super::json::Json;
use super::mismatch::Mismatch;
use serde::de::value::{MapAccessDeserializer, MapDeserializer, SeqDeserializer};
use serde::de::{Deserializer, Error, IntoDeserializer, Unexpected, Visitor};
use serde::forward_to_deserialize_any;
use std::iter::once;

/// The key of the user's comments in a document, which is ignored.
pub(super) const COMMENT: &str = "comment";

impl Json {
    fn unexpected(&self) -> Unexpected<'_> {
        match self {
            Json::Null => Unexpected::Unit,
            Json::Bool(value) => Unexpected::Bool(*value),
            Json::Number(number) => match (number.as_u64(), number.as_i64()) {
                (Some(value), _) => Unexpected::Unsigned(value),
                (None, Some(value)) => Unexpected::Signed(value),
                (None, None) => Unexpected::Float(number.as_f64().unwrap_or(f64::NAN)),
            },
            Json::Text(text) => Unexpected::Str(text),
            Json::List(_) => Unexpected::Seq,
            Json::Object(_) => Unexpected::Map,
        }
    }
}

/// Returns the members of a JSON object; if the keys of the object are fixed, all members but the user's comments.
fn members<'a>(
    members: &'a [(String, Json)],
    fixed: Option<&'static [&'static str]>,
) -> impl Iterator<Item = (&'a str, &'a Json)> {
    let passes_over = fixed.is_some_and(|fixed| !fixed.contains(&COMMENT));
    let members = members.iter().map(|(name, value)| (name.as_str(), value));
    members.filter(move |(name, _)| !(passes_over && *name == COMMENT))
}

impl<'de> Deserializer<'de> for &'de Json {
    type Error = Mismatch;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mismatch> {
        match self {
            Json::Null => visitor.visit_unit(),
            Json::Bool(value) => visitor.visit_bool(*value),
            Json::Number(number) => match (number.as_u64(), number.as_i64()) {
                (Some(value), _) => visitor.visit_u64(value),
                (None, Some(value)) => visitor.visit_i64(value),
                (None, None) => visitor.visit_f64(number.as_f64().unwrap_or(f64::NAN)),
            },
            Json::Text(text) => visitor.visit_borrowed_str(text),
            Json::List(items) => {
                let mut access = SeqDeserializer::new(items.iter());
                let value = visitor.visit_seq(&mut access)?;
                access.end()?;
                Ok(value)
            }
            Json::Object(entries) => {
                let mut access = MapDeserializer::new(members(entries, None));
                let value = visitor.visit_map(&mut access)?;
                access.end()?;
                Ok(value)
            }
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mismatch> {
        match self {
            Json::Null => visitor.visit_none(),
            _ => visitor.visit_some(self),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Mismatch> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mismatch> {
        match self {
            Json::List(_) => Err(Mismatch::invalid_type(Unexpected::Seq, &visitor)),
            Json::Object(entries) => {
                let mut access = MapDeserializer::new(members(entries, Some(fields)));
                let value = visitor.visit_map(&mut access)?;
                access.end()?;
                Ok(value)
            }
            _ => self.deserialize_any(visitor),
        }
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mismatch> {
        match self {
            // A list that the user has put in quotes is a mistake, and not a list of one element.
            Json::Text(text) if text.trim_start().starts_with('[') => self.deserialize_any(visitor),
            Json::Number(_) | Json::Text(_) | Json::Object(_) => visitor.visit_seq(SeqDeserializer::new(once(self))),
            _ => self.deserialize_any(visitor),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        valid: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mismatch> {
        match self {
            Json::Text(name) => visitor.visit_enum(name.as_str().into_deserializer()),
            Json::Object(entries) => match members(entries, Some(valid)).count() {
                1 => {
                    visitor.visit_enum(MapAccessDeserializer::new(MapDeserializer::new(members(entries, Some(valid)))))
                }
                count => Err(Mismatch::NotAVariant { found: format!("an object with {count} keys"), valid }),
            },
            _ => match Mismatch::invalid_type(self.unexpected(), &visitor) {
                Mismatch::WrongType { found, .. } => Err(Mismatch::NotAVariant { found, valid }),
                other => Err(other),
            },
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf
        unit unit_struct tuple tuple_struct map identifier ignored_any
    }
}

impl<'de> IntoDeserializer<'de, Mismatch> for &'de Json {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}
