//! The version of the form in which answers are written.

use serde::de::{Deserialize, Deserializer, Error};
use serde::{Serialize, Serializer};

/// The first one, which may gain members but loses none and changes the meaning of none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Version;

/// Its number.
const NUMBER: u64 = 1;

impl Serialize for Version {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u64(NUMBER)
    }
}

impl<'de> Deserialize<'de> for Version {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match u64::deserialize(deserializer)? {
            NUMBER => Ok(Self),
            other => Err(D::Error::custom(format!(
                "the answer has version {other}, and this program reads version {NUMBER}: use one as recent as what wrote it"
            ))),
        }
    }
}
