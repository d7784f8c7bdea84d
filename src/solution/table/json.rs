//! Columns of a table as JSON: an object of lists by name, with null for missing values.

use super::{Column, Counts, Lists, MISSING, Values, Words};
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::io::{self, Write};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, ArrayBuilder, ObjectBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

pub(super) fn schema_of_columns() -> Schema {
    let list =
        ArrayBuilder::new().items(ObjectBuilder::new().schema_type(utoipa::openapi::schema::SchemaType::AnyValue));
    let columns = ObjectBuilder::new().schema_type(Type::Object);
    columns
        .additional_properties(Some(AdditionalProperties::RefOr(RefOr::T(Schema::Array(list.build())))))
        .description(Some(
            "The columns by name: `member`, from zero; the swept names; the collected values; `status`, `trusted`, \
             `error`, `steps`, `switches`, `residual`, `warnings`. A missing value is null.",
        ))
        .into()
}

pub(super) mod by_name {
    use super::*;

    pub fn serialize<S: Serializer>(columns: &[Column], serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(columns.len()))?;
        for column in columns {
            map.serialize_entry(&column.name, &column.values)?;
        }
        map.end()
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Column>, D::Error> {
        deserializer.deserialize_map(ColumnsVisitor)
    }
}

struct ColumnsVisitor;

impl<'de> Visitor<'de> for ColumnsVisitor {
    type Value = Vec<Column>;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("columns by name")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Self::Value, A::Error> {
        let mut columns: Vec<Column> = Vec::new();
        while let Some((name, values)) = access.next_entry::<String, Values>()? {
            columns.push(Column { name, values });
        }
        let rows = columns.first().map_or(0, |column| column.values.len());
        if columns.iter().any(|column| column.values.len() != rows) {
            return Err(A::Error::custom("the columns must have the same length"));
        }
        Ok(columns)
    }
}

impl Values {
    /// Writes the value in a row, or null if it is missing.
    ///
    /// # Errors
    /// Errors of writing to `out`.
    pub fn write_json(&self, row: usize, out: &mut dyn Write) -> io::Result<()> {
        match self {
            Self::Flags(values) => serde_json::to_writer(out, &values.get(row))?,
            Self::Words(words) => serde_json::to_writer(out, &words.get(row))?,
            Self::Counts(values) => serde_json::to_writer(out, &values.get(row).filter(|value| *value != MISSING))?,
            Self::Numbers(_) => serde_json::to_writer(out, &self.number(row))?,
            Self::Lists(lists) => serde_json::to_writer(out, &lists.numbers(row).map(List::of))?,
        }
        Ok(())
    }
}

impl Serialize for Values {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut list = serializer.serialize_seq(Some(self.len()))?;
        match self {
            Self::Numbers(values) => {
                for value in values {
                    list.serialize_element(&Some(*value).filter(|value| value.is_finite()))?;
                }
            }
            Self::Counts(values) => {
                for value in values.iter() {
                    list.serialize_element(&Some(value).filter(|value| *value != MISSING))?;
                }
            }
            Self::Flags(values) => {
                for value in values {
                    list.serialize_element(value)?;
                }
            }
            Self::Words(words) => {
                for row in 0..words.places.len() {
                    list.serialize_element(&words.get(row))?;
                }
            }
            Self::Lists(lists) => {
                for row in 0..lists.len() {
                    list.serialize_element(&lists.numbers(row).map(List::of))?;
                }
            }
        }
        list.end()
    }
}

impl<'de> Deserialize<'de> for Values {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(ValuesVisitor)
    }
}

/// The numbers of a list in a table, with null for missing ones.
#[derive(Serialize)]
#[serde(transparent)]
struct List(Vec<Option<f64>>);

impl List {
    fn of(numbers: impl Iterator<Item = Option<f64>>) -> Self {
        Self(numbers.collect())
    }
}

struct ValuesVisitor;

/// One value of a column in JSON: an integer without a decimal point is read as a count.
#[derive(Deserialize)]
#[serde(untagged)]
enum Value {
    Flag(bool),
    Count(u32),
    Number(f64),
    Word(String),
    List(Vec<Option<f64>>),
}

impl<'de> Visitor<'de> for ValuesVisitor {
    type Value = Values;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("numbers, texts, booleans or null")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut access: A) -> Result<Values, A::Error> {
        let mut found: Option<Values> = None;
        let mut missing = 0;
        while let Some(value) = access.next_element::<Option<Value>>()? {
            let Some(value) = value else {
                match &mut found {
                    Some(values) => values.push_number(None),
                    None => missing += 1,
                }
                continue;
            };
            let values = found.get_or_insert_with(|| {
                let mut values = match &value {
                    Value::Flag(_) => Values::Flags(Vec::new()),
                    Value::Count(_) => Values::Counts(Counts::default()),
                    Value::Number(_) => Values::Numbers(Vec::new()),
                    Value::Word(_) => Values::Words(Words::default()),
                    Value::List(list) => Values::Lists(Lists::new(list.len())),
                };
                (0..missing).for_each(|_| values.push_number(None));
                values
            });
            match (values, value) {
                (Values::Flags(values), Value::Flag(value)) => values.push(value),
                (Values::Counts(values), Value::Count(value)) => values.push(value),
                (Values::Numbers(values), Value::Number(value)) => values.push(value),
                (Values::Numbers(values), Value::Count(value)) => values.push(f64::from(value)),
                (Values::Words(words), Value::Word(word)) => words.push(Some(&word)),
                (Values::Lists(lists), Value::List(list)) if list.len() == lists.length() => {
                    let list: Vec<f64> = list.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect();
                    lists.push(&list);
                }
                _ => return Err(A::Error::custom("a column has values of one kind")),
            }
        }
        Ok(found.unwrap_or_else(|| Values::Numbers(vec![f64::NAN; missing])))
    }
}

impl PartialSchema for Values {
    fn schema() -> RefOr<Schema> {
        ArrayBuilder::new().into()
    }
}

impl ToSchema for Values {}
