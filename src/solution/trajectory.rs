//! The trajectory in columns.

use serde::de::{Deserializer, MapAccess, Visitor};
use serde::ser::{SerializeMap, SerializeStruct, Serializer};
use serde::{Deserialize, Serialize};
use std::fmt;

/// One output over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// The name of the state or variable.
    pub name: String,
    /// Its values, as many as there are times.
    pub values: Vec<f64>,
}

/// What happened to a variable at a switch of the active face of `K`, or to a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// It left its bound: the inequality became an equation.
    Activated,
    /// It came to rest on a bound.
    Deactivated,
    /// A contact closed.
    Impact,
    /// A contact opened that had been closed for a while.
    LiftOff,
    /// A contact ceased to slip.
    Stick,
    /// A contact began to slip.
    Slip,
}

/// A switch of the active face.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// When.
    pub t: f64,
    /// What.
    pub kind: EventKind,
    /// The variable or the contact.
    pub of: String,
}

/// Values over time, in columns of equal length.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Trajectory {
    /// The times, increasing.
    pub t: Vec<f64>,
    /// The outputs that were asked for.
    #[serde(deserialize_with = "columns")]
    pub fields: Vec<Field>,
    /// The switches.
    pub events: Vec<Event>,
}

impl Trajectory {
    /// The column of that name.
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

/// Fields as one object, name to values, in order.
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

/// The fields of one object, in its order.
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
