//! The trajectory of a run: output times, values of the outputs in columns, and events.

use problem::Event;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::ser::{SerializeMap, SerializeStruct, Serializer};
use serde::{Deserialize, Serialize};
use std::fmt;
use utoipa::ToSchema;

/// The values of one output over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// The name of the state, variable or other output.
    pub name: String,
    /// The values of the output, one per output time.
    pub values: Vec<f64>,
}

/// Values of outputs over time, in columns of equal length, and events.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, ToSchema)]
pub struct Trajectory {
    /// The output times, increasing.
    pub t: Vec<f64>,
    /// The requested outputs, by name.
    #[serde(deserialize_with = "columns")]
    #[schema(value_type = BTreeMap<String, Vec<f64>>)]
    pub fields: Vec<Field>,
    /// The events of the run, in order of time.
    pub events: Vec<Event>,
}

impl Trajectory {
    /// Returns the values of the output with the given name.
    pub fn field(&self, name: &str) -> Option<&[f64]> {
        self.fields.iter().find(|field| field.name == name).map(|field| field.values.as_slice())
    }
}

impl Serialize for Trajectory {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut object = serializer.serialize_struct("Trajectory", 3)?;
        object.serialize_field("t", &self.t)?;
        object.serialize_field("fields", &Columns(&self.fields))?;
        object.serialize_field("events", &self.events)?;
        object.end()
    }
}

/// The fields of a trajectory, serialised as a JSON object from names to values, in order.
struct Columns<'a>(&'a [Field]);

impl Serialize for Columns<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for field in self.0 {
            map.serialize_entry(&field.name, &field.values)?;
        }
        map.end()
    }
}

/// Reads the fields of a trajectory from a JSON object, keeping their order.
fn columns<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Field>, D::Error> {
    struct Visit;

    impl<'de> Visitor<'de> for Visit {
        type Value = Vec<Field>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("an object of columns")
        }

        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
            let mut fields = Vec::new();
            while let Some((name, values)) = map.next_entry()? {
                fields.push(Field { name, values });
            }
            Ok(fields)
        }
    }

    deserializer.deserialize_map(Visit)
}
