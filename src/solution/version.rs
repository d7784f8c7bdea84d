//! The version number of the format of answers, as a type that serialises as this number.

use serde::de::{Deserialize, Deserializer, Error};
use serde::{Serialize, Serializer};

/// Version 1 of the answer format, to which members may be added, but none removed or changed in meaning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Version;

/// The version number of the format of answers.
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
                "the answer has version {other}, and this program reads version {NUMBER}: use a version at least as \
                 recent as the one that wrote it"
            ))),
        }
    }
}
