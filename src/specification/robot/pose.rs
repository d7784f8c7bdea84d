//! The initial state of the joints and the free bodies of a robot description, by their names and in numbers, which are
//! read before the document.

use super::xml::{At, DescriptionError};
use crate::json::Json;
use crate::wording::{abridged, listed};
use expression::nearest;
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use std::cell::RefCell;
use std::collections::HashSet;

/// The initial states that the user gives in `pose` of a robot, with the names used and the errors found so far.
pub(super) struct Poses<'j> {
    given: &'j [(String, Json)],
    used: RefCell<HashSet<&'j str>>,
    errors: RefCell<Vec<DescriptionError>>,
}

/// Initial position and velocity of a joint of a robot.
#[derive(Clone, Copy, Debug)]
pub(super) struct JointStart {
    pub position: f64,
    pub velocity: f64,
    /// Whether the joint starts at another position than that of the description, because the latter lies beyond the
    /// limits of the joint.
    pub is_moved: bool,
}

const OF_JOINT: [&str; 2] = ["position", "velocity"];
const OF_BODY: [&str; 4] = ["position", "orientation", "velocity", "angular_velocity"];

impl<'j> Poses<'j> {
    /// Reads the member `pose` of a robot; a value that is not an object is refused where the document is read.
    pub fn new(pose: Option<&'j Json>) -> Self {
        let given = match pose {
            Some(Json::Object(members)) => members.as_slice(),
            _ => &[],
        };
        Self { given, used: RefCell::default(), errors: RefCell::default() }
    }

    fn find(&self, name: &str) -> Option<&'j Json> {
        let (name, value) = self.given.iter().find(|(known, _)| known == name)?;
        self.used.borrow_mut().insert(name);
        Some(value)
    }

    fn report(&self, keys: &[&str], code: &'static str, detail: String, expected: &str) {
        let keys = std::iter::once("pose").chain(keys.iter().copied()).map(str::to_owned).collect();
        let error =
            DescriptionError { at: At::Keys(keys), code, detail, expected: expected.into(), did_you_mean: None };
        self.errors.borrow_mut().push(error);
    }

    /// Returns the initial state of a joint with the given limits: that of the user, else the position `reference` of
    /// the description, or the middle of the limits if `reference` is beyond them.
    pub fn of_joint(&self, name: &str, reference: f64, limits: [Option<f64>; 2]) -> JointStart {
        let [lower, upper] = [limits[0].unwrap_or(f64::NEG_INFINITY), limits[1].unwrap_or(f64::INFINITY)];
        let is_within = |position: f64| lower <= position && position <= upper;
        let is_moved = !is_within(reference) && lower.is_finite() && upper.is_finite();
        let own =
            JointStart { position: if is_moved { 0.5 * (lower + upper) } else { reference }, velocity: 0.0, is_moved };
        let Some(value) = self.find(name) else { return own };
        self.check_keys(name, value, &OF_JOINT);
        let of = |key: &str| member(value, key).and_then(|value| self.number(value, &[name, key]));
        let (position, velocity) = match value {
            Json::Number(_) => (self.number(value, &[name]), None),
            _ => (of("position"), of("velocity")),
        };
        if let Some(beyond) = position.filter(|position| !is_within(*position)) {
            let detail = format!("the joint begins at {beyond}, beyond its limits");
            self.report(&[name], "out_of_range", detail, &format!("a position from {lower} to {upper}"));
            return own;
        }
        let is_moved = own.is_moved && position.is_none();
        JointStart { position: position.unwrap_or(own.position), velocity: velocity.unwrap_or(0.0), is_moved }
    }

    /// Returns the pose, the velocity of the origin and the angular velocity of a free body as `pose` gives them; by
    /// default the body is at rest at `frame`.
    pub fn of_body(&self, name: &str, frame: Isometry3<f64>) -> (Isometry3<f64>, Vector3<f64>, Vector3<f64>) {
        let Some(value) = self.find(name) else { return (frame, Vector3::zeros(), Vector3::zeros()) };
        self.check_keys(name, value, &OF_BODY);
        let vector =
            |key: &str| member(value, key).and_then(|value| self.numbers::<3>(value, &[name, key])).map(Vector3::from);
        let position = vector("position").unwrap_or(frame.translation.vector);
        let turn = member(value, "orientation").and_then(|value| self.numbers::<4>(value, &[name, "orientation"]));
        let turn = turn.map(|[w, x, y, z]| UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.0));
        if turn == Some(None) {
            let detail = "this quaternion has no direction".to_owned();
            self.report(&[name, "orientation"], "zero_quaternion", detail, "a unit quaternion [w, x, y, z]");
        }
        let turn = turn.flatten().unwrap_or(frame.rotation);
        let rates = ["velocity", "angular_velocity"].map(|key| vector(key).unwrap_or_default());
        (Isometry3::from_parts(position.into(), turn), rates[0], rates[1])
    }

    /// Reports the errors found, once all joints and free bodies have been looked up: a name in `pose` that is not
    /// used is unknown.
    pub fn finish(self, known: &[&str], errors: &mut Vec<DescriptionError>) {
        let used = self.used.borrow();
        let unknown = self.given.iter().map(|(name, _)| name.as_str()).filter(|name| !used.contains(name));
        for name in unknown.collect::<Vec<_>>() {
            let detail = format!("the description has no joint or free body `{}`", abridged(name));
            self.report(&[name], "unknown_name", detail, &listed(known.iter().copied()));
            if let Some(error) = self.errors.borrow_mut().last_mut() {
                error.did_you_mean = nearest(name, known.iter().copied()).map(str::to_owned);
            }
        }
        drop(used);
        errors.extend(self.errors.into_inner());
    }

    fn check_keys(&self, name: &str, value: &Json, keys: &[&str]) {
        let Json::Object(members) = value else { return };
        for (key, _) in members.iter().filter(|(key, _)| !keys.contains(&key.as_str()) && key != "comment") {
            let detail = format!("`{}` is not a key of this start", abridged(key));
            self.report(&[name, key], "unknown_key", detail, &listed(keys.iter().copied()));
        }
    }

    fn number(&self, value: &Json, keys: &[&str]) -> Option<f64> {
        let number = finite(value);
        if number.is_none() {
            let detail = "the start of a description is a number".to_owned();
            self.report(keys, "constant", detail, "a number: radians, metres, or a second of them");
        }
        number
    }

    fn numbers<const N: usize>(&self, value: &Json, keys: &[&str]) -> Option<[f64; N]> {
        let found: Option<Vec<f64>> = match value {
            Json::List(items) => items.iter().map(finite).collect(),
            _ => None,
        };
        let array = found.and_then(|found| <[f64; N]>::try_from(found).ok());
        if array.is_none() {
            self.report(keys, "wrong_shape", format!("this is no list of {N} numbers"), &format!("{N} numbers"));
        }
        array
    }
}

fn member<'j>(value: &'j Json, key: &str) -> Option<&'j Json> {
    match value {
        Json::Object(members) => members.iter().find(|(name, _)| name == key).map(|(_, value)| value),
        _ => None,
    }
}

fn finite(value: &Json) -> Option<f64> {
    match value {
        Json::Number(number) => number.as_f64().filter(|number| number.is_finite()),
        _ => None,
    }
}
