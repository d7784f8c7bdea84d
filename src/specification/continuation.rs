//! Continuation of a run: the specification with the final states of the run as initial values and its end time as
//! start.
//!
//! The states determine the further motion, and with it active sets, contact modes and regions, which are found anew at
//! the start. They do not determine problems with memory, or fields whose start is given as an expression in space.

use super::deserializer::COMMENT;
use super::error::Errors;
use super::json::Json;
use super::robot;
use super::vectors;
use models::velocity_name;
use serde::{Serialize, Serializer};
use serde_json::Number;
use std::fmt;

/// Reason why a run cannot be continued beyond its end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NotContinuable {
    /// The specification of the run cannot be parsed.
    Unreadable,
    /// The states of the problem do not determine its further motion, or a specification has no way to give all of them
    /// as initial values.
    Problem(&'static str),
    /// The trajectory of the run has no column of the given name.
    Column(String),
}

impl fmt::Display for NotContinuable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable => f.write_str("its specification cannot be read"),
            Self::Problem(why) => f.write_str(why),
            Self::Column(name) => {
                write!(f, "its results leave out `{name}`: name it in `output.fields`, or name no fields")
            }
        }
    }
}

/// Keys of requests for which the states at the end of the run do not suffice to continue it, each with the reason.
const NO_END: [(&str, &str); 5] = [
    ("sweep", "a sweep has many runs, each with its own end"),
    ("fit", "a fit is of all its data at once: solve on with its estimates as parameters"),
    ("periodic", "a periodic orbit is closed, and ends where it began: solve on from its start without `periodic`"),
    ("steady_state", "a steady state has no time to go on in"),
    (
        "sensitivities",
        "its derivatives are with respect to its own start, and the states at its end do not determine how they go on: \
         solve from the start with a later `time.end`",
    ),
];

/// Returns the specification that continues a run of `document` from `start` to `end`; `last` maps a column of the
/// trajectory to its final value, which is the value at the new start.
///
/// # Errors
/// The reason why the run cannot be continued.
pub fn continued(
    document: &[u8],
    start: f64,
    end: f64,
    last: impl Fn(&str) -> Option<f64>,
) -> Result<Vec<u8>, NotContinuable> {
    let mut json: Json = serde_json::from_slice(document).map_err(|_| NotContinuable::Unreadable)?;
    for (key, why) in NO_END {
        if json.member(key).is_some() {
            return Err(NotContinuable::Problem(why));
        }
    }
    robot::write_out(&mut json, &mut Errors::default());
    robot::forget(&mut json);
    vectors::write_out(&mut json, &mut Errors::default());
    let last = |name: &str| last(name).and_then(number).ok_or_else(|| NotContinuable::Column(name.to_owned()));
    let (name, problem) = json.member("problem").and_then(Json::only_member).ok_or(NotContinuable::Unreadable)?;
    problem.write_lists(match name {
        "lcs" => &["initial", "state_names"],
        "rigid_bodies" => &["bodies", "joints", "springs"],
        "circuit" => &["components"],
        _ => &[],
    });
    match name {
        "dvi" | "filippov" => {
            for (state, value) in problem.members("states") {
                value.set("initial", last(state)?);
            }
        }
        "lcs" => of_matrices(problem, last)?,
        "mechanical" => {
            for (coordinate, value) in problem.members("coordinates") {
                value.set("initial", last(coordinate)?);
                value.set("velocity", last(&velocity_name(coordinate))?);
            }
            // At the end of a run, a gap or joint may be violated by as much as the tolerance; resolve the violation
            // at the new start instead of refusing it.
            problem.set("interpenetration", Json::Text("resolve".to_owned()));
        }
        "rigid_bodies" => of_bodies(problem, last)?,
        "circuit" => of_circuit(problem, last)?,
        "vi" => return Err(NotContinuable::Problem("a static problem has no time to go on in")),
        "convolution" => return Err(NotContinuable::Problem("a problem with memory depends on its whole past")),
        _ => return Err(NotContinuable::Problem("its start is an expression in space, which values at nodes are not")),
    }
    let (Some(from), Some(to)) = (number(start), number(end)) else { return Err(NotContinuable::Unreadable) };
    json.set("time", Json::Object(vec![("start".to_owned(), from), ("end".to_owned(), to)]));
    json.remove("study");
    if let Some(output) = json.member("output") {
        output.keep_times_within(start, end);
    }
    serde_json::to_vec(&json).map_err(|_| NotContinuable::Unreadable)
}

fn of_matrices(problem: &mut Json, last: impl Fn(&str) -> Result<Json, NotContinuable>) -> Result<(), NotContinuable> {
    let names = match problem.member("state_names") {
        Some(Json::List(names)) => names.iter().map(|name| name.text().to_owned()).collect(),
        _ => Vec::new(),
    };
    if let Some(Json::List(values)) = problem.member("initial") {
        for (i, value) in values.iter_mut().enumerate() {
            *value = last(&names.get(i).cloned().unwrap_or_else(|| format!("x{}", i + 1)))?;
        }
    }
    Ok(())
}

fn of_bodies(problem: &mut Json, last: impl Fn(&str) -> Result<Json, NotContinuable>) -> Result<(), NotContinuable> {
    const VECTORS: [(&str, &[&str]); 4] = [
        ("position", &["x", "y", "z"]),
        ("orientation", &["qw", "qx", "qy", "qz"]),
        ("velocity", &["vx", "vy", "vz"]),
        ("angular_velocity", &["wx", "wy", "wz"]),
    ];
    if is_placed_at_its_start(problem) {
        let why = "joints between bodies, springs, motors and motions are placed where its bodies are at the start";
        return Err(NotContinuable::Problem(why));
    }
    if let Some(Json::List(bodies)) = problem.member("bodies") {
        for body in bodies.iter_mut() {
            if matches!(body.member("fixed"), Some(Json::Bool(true))) {
                continue;
            }
            let name = body.member("name").map_or("", |name| name.text()).to_owned();
            for (key, columns) in VECTORS {
                let values: Result<Vec<Json>, _> = columns.iter().map(|c| last(&format!("{name}.{c}"))).collect();
                body.set(key, Json::List(values?));
            }
        }
    }
    problem.set("interpenetration", Json::Text("resolve".to_owned()));
    Ok(())
}

/// Whether a joint, spring or motion of a rigid-body problem depends on the initial configuration of the bodies, and
/// not only on points and axes given in the world.
fn is_placed_at_its_start(problem: &mut Json) -> bool {
    let has_springs = matches!(problem.member("springs"), Some(Json::List(springs)) if !springs.is_empty());
    let mut moves_by_itself = false;
    if let Some(Json::List(bodies)) = problem.member("bodies") {
        moves_by_itself = bodies.iter_mut().any(|body| body.member("motion").is_some());
    }
    let mut is_relative = false;
    if let Some(Json::List(joints)) = problem.member("joints") {
        is_relative = joints.iter_mut().filter_map(Json::only_member).any(|(_, joint)| {
            let two = matches!(joint.member("bodies"), Some(Json::List(bodies)) if bodies.len() > 1);
            two || ["motor", "spring", "limits"].iter().any(|key| joint.member(key).is_some())
        });
    }
    has_springs || moves_by_itself || is_relative
}

fn of_circuit(problem: &mut Json, last: impl Fn(&str) -> Result<Json, NotContinuable>) -> Result<(), NotContinuable> {
    let Some(Json::List(components)) = problem.member("components") else {
        return Err(NotContinuable::Problem("its circuit is a netlist: write it as `components` to continue it"));
    };
    for component in components.iter_mut() {
        let Some((kind, values)) = component.only_member() else { continue };
        let name = values.member("name").map_or("", |name| name.text()).to_owned();
        let last = |quantity: &str| last(&format!("{quantity}({name})"));
        match kind {
            "capacitor" => values.set("volts", last("v")?),
            "inductor" => values.set("amperes", last("i")?),
            // The state of a switch with hysteresis is part of the initial state.
            "switch" if values.member("hysteresis").is_some() => {
                let closed = last("closed")?.value().is_some_and(|closed| closed > 0.5);
                values.set("initially", Json::Bool(closed));
            }
            "comparator" if values.member("hysteresis").is_some() => {
                let mut limit =
                    |key: &str, otherwise: f64| values.member(key).map_or(Some(otherwise), |limit| limit.value());
                let (Some(low), Some(high), Some(volts)) = (limit("low", 0.0), limit("high", 1.0), last("v")?.value())
                else {
                    return Err(NotContinuable::Problem(
                        "`low` and `high` of a comparator are expressions: write them as numbers to continue it",
                    ));
                };
                values.set("initially", Json::Bool(volts > 0.5 * (low + high)));
            }
            _ => {}
        }
    }
    Ok(())
}

fn number(value: f64) -> Option<Json> {
    Number::from_f64(value).map(Json::Number)
}

impl Json {
    fn value(&self) -> Option<f64> {
        match self {
            Json::Number(number) => number.as_f64(),
            _ => None,
        }
    }

    fn member(&mut self, key: &str) -> Option<&mut Self> {
        let Self::Object(members) = self else { return None };
        members.iter_mut().find(|(name, _)| name == key).map(|(_, value)| value)
    }

    fn only_member(&mut self) -> Option<(&str, &mut Self)> {
        let Self::Object(members) = self else { return None };
        let member = members.iter_mut().find(|(name, _)| name != COMMENT);
        member.map(|(name, value)| (name.as_str(), value))
    }

    /// Wraps the values of the members `keys` of a JSON object in lists of one element, where the user has written a
    /// single value.
    fn write_lists(&mut self, keys: &[&str]) {
        let Self::Object(members) = self else { return };
        for (_, value) in members.iter_mut().filter(|(name, _)| keys.contains(&name.as_str())) {
            if !matches!(value, Self::List(_) | Self::Null) {
                *value = Self::List(vec![std::mem::replace(value, Self::Null)]);
            }
        }
    }

    fn members(&mut self, key: &str) -> impl Iterator<Item = (&str, &mut Self)> {
        let members = match self.member(key) {
            Some(Self::Object(members)) => members.as_mut_slice(),
            _ => &mut [],
        };
        members.iter_mut().map(|(name, value)| (name.as_str(), value))
    }

    fn set(&mut self, key: &str, value: Self) {
        if let Some(known) = self.member(key) {
            *known = value;
        } else if let Self::Object(members) = self {
            members.push((key.to_owned(), value));
        }
    }

    fn remove(&mut self, key: &str) {
        if let Self::Object(members) = self {
            members.retain(|(name, _)| name != key);
        }
    }

    fn text(&self) -> &str {
        if let Self::Text(text) = self { text } else { "" }
    }

    /// Keeps those of the listed output times that lie within the new horizon; if none remains, output is at the steps.
    fn keep_times_within(&mut self, start: f64, end: f64) {
        let Some(Self::List(times)) = self.member("times") else { return };
        times.retain(|time| {
            matches!(time, Self::Number(time) if time.as_f64().is_some_and(|time| (start..=end).contains(&time)))
        });
        if times.is_empty() {
            self.remove("times");
        }
    }
}

impl Serialize for Json {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Null => serializer.serialize_unit(),
            Self::Bool(value) => serializer.serialize_bool(*value),
            Self::Number(number) => number.serialize(serializer),
            Self::Text(text) => serializer.serialize_str(text),
            Self::List(items) => serializer.collect_seq(items),
            Self::Object(members) => serializer.collect_map(members.iter().map(|(name, value)| (name, value))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_go_on_in_their_order_and_what_is_past_is_left_out() {
        let document = r#"{"study":{},"problem":{"dvi":{"parameters":{"b":1,"a":"b"},"states":{"y":{"initial":"a","rate":"1"},
            "x":{"initial":0,"rate":"y"}}}},"time":{"end":1},"output":{"times":[0,0.5,1,1.5],"fields":["x","y"]}}"#;
        let last =
            |name: &str| [("x", 0.25), ("y", 0.1 + 0.2)].iter().find(|(known, _)| *known == name).map(|(_, x)| *x);
        let text = continued(document.as_bytes(), 1.0, 2.0, last).unwrap();
        let expected = r#"{"problem":{"dvi":{"parameters":{"b":1,"a":"b"},"states":{"y":{"initial":0.30000000000000004,"rate":"1"},"x":{"initial":0.25,"rate":"y"}}}},"time":{"start":1.0,"end":2.0},"output":{"times":[1,1.5],"fields":["x","y"]}}"#;
        assert_eq!(String::from_utf8(text).unwrap(), expected);
        let missing = continued(document.as_bytes(), 1.0, 2.0, |name| (name == "y").then_some(0.0));
        assert_eq!(missing, Err(NotContinuable::Column("x".to_owned())));
    }
    #[test]
    fn one_value_in_the_place_of_a_list_goes_on_too() {
        let last = |name: &str| (name == "x1" || name == "a").then_some(0.5);
        for (names, initial) in [("", "1"), (r#""state_names":"a","#, "1"), ("", "[1]")] {
            let document = format!(
                r#"{{"problem":{{"comment":"why","lcs":{{{names}"initial":{initial},"A":-1}}}},"time":{{"until":1}}}}"#
            );
            let text = String::from_utf8(continued(document.as_bytes(), 1.0, 2.0, last).unwrap()).unwrap();
            assert!(
                text.contains(r#""initial":[0.5]"#) && text.contains(r#""time":{"start":1.0,"end":2.0}"#),
                "{text}"
            );
        }
        let body = r#"{"problem":{"rigid_bodies":{"bodies":{"name":"ball"}}},"time":{"end":1}}"#;
        let text = String::from_utf8(continued(body.as_bytes(), 1.0, 2.0, |_| Some(0.25)).unwrap()).unwrap();
        assert!(text.contains(r#""position":[0.25,0.25,0.25]"#), "{text}");
    }
}
