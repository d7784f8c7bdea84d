//! Robot descriptions in the formats [URDF](urdf) and [MJCF](mjcf). A description is replaced by bodies and joints of
//! a scene before the document is read, at the stage at which vectors are expanded. Errors found later in these
//! bodies and joints are reported at the element of the description.

mod inertia;
mod mjcf;
mod motion;
mod pose;
mod scene;
mod urdf;
mod xml;

use super::deserializer::COMMENT;
use super::error::{Errors, SpecificationError};
use super::json::Json;
use super::label::LONGEST as LONGEST_LABEL;
use super::pointer::{Pointer, Step};
use super::rigid_bodies::MOST_BODIES;
use super::wording::{abridged, listed};
use expression::nearest;
use pose::Poses;
use roxmltree::{Document, ParsingOptions};
use scene::{Names, Robot, Start, Written};
use std::collections::{BTreeSet, HashMap, HashSet};
use xml::{At, DescriptionError, Element, Place, Reader};

/// Largest length of a robot description in bytes, and largest number of XML nodes in it.
const LONGEST: usize = 4 << 20;
const MOST_NODES: u32 = 1 << 20;

/// Formats of robot descriptions by key, with the tag of the XML root element.
const FORMATS: [(&str, &str); 2] = [("urdf", "robot"), ("mjcf", "mujoco")];

/// Key of the robot description in a scene.
const ROBOT: &str = "robot";

/// Content of a robot description, with remarks on parts that were left out, and errors.
struct Description {
    robot: Robot,
    names: Names,
    remarks: Vec<String>,
    errors: Vec<DescriptionError>,
}

fn read(format: &str, text: &str, pose: Option<&Json>) -> Description {
    let mut reader = Reader::new(text);
    let poses = Poses::new(pose);
    let mut robot = Robot::default();
    let options = ParsingOptions { nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    if text.len() > LONGEST {
        reader.report(0, "too_long", format!("the description has {} bytes", text.len()), "at most 4 MiB");
    } else {
        match Document::parse_with_options(text, options) {
            Ok(document) => robot = of_document(format, Element::new(document.root_element()), &poses, &mut reader),
            Err(error) => {
                let at = error.pos();
                let place = Place { line: at.row as usize, column: at.col as usize };
                // The XML library appends the position of the error to its message, from which the position is
                // removed.
                let words = error.to_string();
                let detail = words.rsplit_once(" at ").map_or(words.as_str(), |(words, _)| words).to_owned();
                let expected =
                    "XML, without entities of its own; <xacro:..> is expanded by the program xacro".to_owned();
                let error =
                    DescriptionError { at: At::Text(place), code: "syntax", detail, expected, did_you_mean: None };
                reader.errors.push(error);
            }
        }
    }
    if robot.bodies.len() > MOST_BODIES {
        let detail = format!("{} bodies", robot.bodies.len());
        reader.report(0, "too_many_bodies", detail, format!("at most {MOST_BODIES} bodies"));
        robot.bodies.clear();
    }
    let mut errors = std::mem::take(&mut reader.errors);
    let mut joints = HashSet::new();
    for joint in &robot.joints {
        if let Some(name) = joint.name.as_deref().filter(|name| !joints.insert(*name)) {
            let detail = format!("there is a joint `{}` already", abridged(name));
            let (at, expected) = (At::Text(joint.place), "a name of its own".to_owned());
            errors.push(DescriptionError { at, code: "duplicate_name", detail, expected, did_you_mean: None });
        }
    }
    let known: Vec<&str> = robot.poses.iter().map(|(name, _)| name.as_str()).collect();
    let is_whole = errors.is_empty();
    poses.finish(&known, &mut errors);
    // After other errors in the robot description, a name in `pose` may be unknown only because its element could not
    // be read.
    errors.retain(|error| is_whole || !matches!(&error.at, At::Keys(_) if error.code == "unknown_name"));
    let names = Names::of(&robot);
    let renamed = names.changed.iter().map(|(given, name)| format!("`{given}` is called `{name}` here"));
    let remarks = reader.remarks().into_iter().chain(renamed).collect();
    Description { robot, names, remarks, errors }
}

fn of_document(format: &str, root: Element<'_, '_>, poses: &Poses<'_>, reader: &mut Reader) -> Robot {
    let expected = FORMATS.iter().find(|(key, _)| *key == format).map_or("", |(_, tag)| *tag);
    if root.tag() != expected {
        let other = FORMATS.iter().find(|(_, tag)| *tag == root.tag());
        let hint =
            other.map_or_else(|| format!("<{expected}>"), |(key, _)| format!("<{expected}>, or the key `{key}`"));
        reader.report(root.start(), "unknown_choice", format!("the description is a <{}>", abridged(root.tag())), hint);
        return Robot::default();
    }
    match format {
        "urdf" => urdf::read(root, poses, reader),
        _ => mjcf::read(root, poses, reader),
    }
}

/// Maps members of a scene that were generated from a robot description back to their origins in the document.
#[derive(Debug, Default)]
pub(super) struct Origins {
    /// By JSON pointer of a generated or moved member: the pointer of its origin, and the position in the text of the
    /// description, if it is from there.
    places: HashMap<String, (String, Option<String>)>,
    /// Remarks on parts of the robot description that were left out, as sentences.
    pub remarks: Vec<String>,
    /// Whether the robot description has errors, so that the names of its bodies are unknown.
    is_broken: bool,
}

impl Origins {
    /// Moves errors in members generated from a robot description to their origins. Errors that follow from a broken
    /// description are dropped.
    pub fn at_origins(&self, errors: Vec<SpecificationError>) -> Vec<SpecificationError> {
        let is_explained = |error: &SpecificationError| {
            let is_of_robot = error.pointer.starts_with("/problem/rigid_bodies/robot");
            self.is_broken
                && !is_of_robot
                && (error.pointer.starts_with("/problem/rigid_bodies") || error.code == "unknown_name")
        };
        errors.into_iter().filter(|error| !is_explained(error)).map(|error| self.at_origin(error)).collect()
    }

    fn at_origin(&self, error: SpecificationError) -> SpecificationError {
        let mut end = error.pointer.len();
        while !self.places.is_empty() {
            match (self.places.get(&error.pointer[..end]), error.pointer[..end].rfind('/')) {
                (Some((pointer, Some(line))), _) => {
                    let detail = format!("{line}: {}", error.detail);
                    return SpecificationError { pointer: pointer.clone(), detail, ..error };
                }
                (Some((pointer, None)), _) => {
                    let pointer = format!("{pointer}{}", &error.pointer[end..]);
                    return SpecificationError { pointer, ..error };
                }
                (None, Some(slash)) => end = slash,
                (None, None) => break,
            }
        }
        error
    }
}

/// Replaces the robot description of a scene, if there is one, by bodies and joints; if the description has errors,
/// these are reported and its bodies are left out.
pub(super) fn write_out(json: &mut Json, errors: &mut Errors) -> Origins {
    let mut origins = Origins::default();
    let path = [Step::Key("problem".to_owned()), Step::Key("rigid_bodies".to_owned())];
    let Some(Json::Object(members)) = json.at_mut(&path) else { return origins };
    let Some((_, Json::Object(given))) = members.iter().find(|(key, _)| key == ROBOT) else { return origins };
    let given = given.clone();
    let texts: Vec<(&'static str, &str)> = given
        .iter()
        .filter_map(|(key, value)| match value {
            Json::Text(text) => {
                FORMATS.iter().find(|(format, _)| format == key).map(|(format, _)| (*format, text.as_str()))
            }
            _ => None,
        })
        .collect();
    let root = Pointer::Root;
    let problem = root.key("problem");
    let scene = problem.key("rigid_bodies");
    let robot = scene.key(ROBOT);
    let &[(format, text)] = texts.as_slice() else {
        let detail = if texts.is_empty() { "there is no description of a robot" } else { "there are two descriptions" };
        let error = SpecificationError::new(robot.to_string(), "conflict", detail);
        errors.push(error.expected("the text of a description as `urdf` or as `mjcf`"));
        origins.is_broken = true;
        return origins;
    };
    let member = |name: &str| given.iter().find(|(key, _)| key == name).map(|(_, value)| value);
    let description = read(format, text, member("pose"));
    if !description.errors.is_empty() {
        description.errors.iter().for_each(|error| errors.push(at_place(error, &robot, format)));
        origins.is_broken = true;
        return origins;
    }
    origins.remarks.clone_from(&description.remarks);
    let groups: BTreeSet<String> = match members.iter().find(|(key, _)| key == "bodies") {
        Some((_, Json::List(bodies))) => bodies.iter().filter_map(|body| Some(group_of(body)?.to_owned())).collect(),
        _ => BTreeSet::new(),
    };
    let written = description.robot.write(&groups, &description.names);
    let motors = match member("motors") {
        Some(Json::Object(motors)) => motors.as_slice(),
        _ => &[],
    };
    let names = (scene.to_string(), robot.to_string(), format);
    Scene { members, origins: &mut origins, errors, names }.insert(&description, written, motors);
    origins
}

/// Removes the robot description from a document in which it has been replaced by bodies and joints.
pub(super) fn forget(json: &mut Json) {
    let path = [Step::Key("problem".to_owned()), Step::Key("rigid_bodies".to_owned())];
    if let Some(Json::Object(members)) = json.at_mut(&path) {
        members.retain(|(key, _)| key != ROBOT);
    }
}

fn group_of(body: &Json) -> Option<&str> {
    match body.child(&Step::Key("group".to_owned())) {
        Some(Json::Text(group)) => Some(group),
        _ => None,
    }
}

/// Converts an error in a robot description to a specification error, located by line of the text or by JSON key.
fn at_place(error: &DescriptionError, robot: &Pointer<'_>, format: &str) -> SpecificationError {
    let (pointer, detail) = match &error.at {
        At::Text(place) => (robot.key(format).to_string(), format!("{}: {}", shown(*place), error.detail)),
        At::Keys(keys) => {
            let keys = keys.iter().map(|key| format!("/{}", key.replace('~', "~0").replace('/', "~1")));
            (format!("{robot}{}", keys.collect::<String>()), error.detail.clone())
        }
    };
    SpecificationError::new(pointer, error.code, detail)
        .expected(error.expected.clone())
        .did_you_mean(error.did_you_mean.clone())
}

fn shown(place: Place) -> String {
    format!("line {}, column {}", place.line, place.column)
}

/// The JSON members of a scene, to which the bodies and joints of a robot are added.
struct Scene<'a> {
    members: &'a mut Vec<(String, Json)>,
    origins: &'a mut Origins,
    errors: &'a mut Errors,
    /// JSON pointers of the scene and of the robot, and the format of the robot description.
    names: (String, String, &'static str),
}

impl Scene<'_> {
    fn insert(&mut self, description: &Description, written: Written, motors: &[(String, Json)]) {
        if !self.members.iter().any(|(key, _)| key == "gravity") {
            self.members.push(("gravity".to_owned(), scene::vector(&description.robot.gravity)));
        }
        let others = self.members.iter_mut().find(|(key, _)| key == "bodies");
        let has_others = matches!(&others, Some((_, Json::List(all))) if !all.is_empty());
        if let (Some(group), Some((_, Json::List(bodies)))) = (written.group_of_others, others) {
            for body in bodies.iter_mut().filter(|body| group_of(body).is_none()) {
                if let Json::Object(members) = body {
                    members.push(("group".to_owned(), scene::text(group)));
                }
            }
        }
        self.exclude(written.exclude, has_others);
        let mut joints = written.joints;
        for (name, motor) in motors.iter().filter(|(name, _)| name != COMMENT) {
            self.drive(name, motor, description, &mut joints);
        }
        self.put_first("bodies", written.bodies, description.robot.bodies.iter().map(|body| body.place));
        self.put_first("joints", joints, description.robot.joints.iter().map(|joint| joint.place));
        if !written.materials.is_empty() {
            if let Some(all) = self.object("materials") {
                all.extend(written.materials);
            }
            if let Some(contacts) = self.object("contacts").filter(|_| !written.pairs.is_empty()) {
                append_to(contacts, "pairs", written.pairs);
            }
        }
        // Keep only the member `pose` of the robot, since a sweep may vary the numbers in it.
        let is_start = |(key, _): &(String, Json)| key == "pose";
        if let Some((_, Json::Object(given))) = self.members.iter_mut().find(|(key, _)| key == ROBOT) {
            given.retain(is_start);
        }
    }

    /// Sets the motor of the joint `name`, in place of the zero motor that makes its coordinate an output.
    fn drive(&mut self, name: &str, motor: &Json, description: &Description, joints: &mut [Json]) {
        let (scene, robot, _) = &self.names;
        let pointer = format!("{robot}/motors/{}", name.replace('~', "~0").replace('/', "~1"));
        let of_robot = &description.robot.joints;
        let Some(k) = of_robot.iter().position(|joint| joint.name.as_deref() == Some(name) && joint.is_axial()) else {
            let known = || of_robot.iter().filter(|joint| joint.is_axial()).filter_map(|joint| joint.name.as_deref());
            let detail = format!("the description has no hinge or slider `{}`", abridged(name));
            let error = SpecificationError::new(pointer, "unknown_name", detail);
            self.errors.push(error.expected(listed(known())).did_you_mean(nearest(name, known())));
            return;
        };
        let Some(Json::Object(kinds)) = joints.get_mut(k) else { return };
        let Some((kind, Json::Object(members))) = kinds.first_mut() else { return };
        members.retain(|(key, _)| key != "motor");
        members.push(("motor".to_owned(), motor.clone()));
        self.origins.places.insert(format!("{scene}/joints/{k}/{kind}/motor"), (pointer, None));
    }

    /// Inserts items at the beginning of the list `key` of the scene, which is created if missing; a single object
    /// counts as a list of one. Errors in an inserted item are reported at its position in the description, errors in
    /// other items at their original index.
    fn put_first(&mut self, key: &str, items: Vec<Json>, places: impl Iterator<Item = Place>) {
        let (scene, robot, format) = &self.names;
        for (k, place) in places.enumerate() {
            let origin = (format!("{robot}/{format}"), Some(shown(place)));
            self.origins.places.insert(format!("{scene}/{key}/{k}"), origin);
        }
        let count = items.len();
        if !self.members.iter().any(|(known, _)| known == key) {
            // Errors of the list of bodies or joints as a whole, such as a scene in which nothing moves, are reported
            // at the beginning of the description.
            let origin = (format!("{robot}/{format}"), Some(shown(Place { line: 1, column: 1 })));
            self.origins.places.insert(format!("{scene}/{key}"), origin);
        }
        let Some((_, value)) = self.members.iter_mut().find(|(known, _)| known == key) else {
            self.members.push((key.to_owned(), Json::List(items)));
            return;
        };
        if let Json::Object(_) = value {
            *value = Json::List(vec![value.clone()]);
        }
        let Json::List(all) = value else { return };
        for k in 0..all.len() {
            let origin = (format!("{scene}/{key}/{k}"), None);
            self.origins.places.insert(format!("{scene}/{key}/{}", count + k), origin);
        }
        all.splice(0..0, items);
    }

    fn exclude(&mut self, pairs: Vec<Json>, has_others: bool) {
        let is_of_others = |pair: &Json| match pair {
            Json::List(both) => both.iter().any(|group| matches!(group, Json::Text(group) if group == scene::OTHERS)),
            _ => false,
        };
        let pairs: Vec<Json> = pairs.into_iter().filter(|pair| has_others || !is_of_others(pair)).collect();
        if pairs.is_empty() {
            return;
        }
        if let Some(contacts) = self.object("contacts") {
            append_to(contacts, "exclude", pairs);
        }
    }

    /// Returns the members of the object `key` of the scene, which is created if missing; `None` if the value is not
    /// an object.
    fn object(&mut self, key: &str) -> Option<&mut Vec<(String, Json)>> {
        if !self.members.iter().any(|(known, _)| known == key) {
            self.members.push((key.to_owned(), Json::Object(Vec::new())));
        }
        match self.members.iter_mut().find(|(known, _)| known == key) {
            Some((_, Json::Object(members))) => Some(members),
            _ => None,
        }
    }
}

/// Appends items to the list with the key `key` among the members of a JSON object; a missing list is created.
fn append_to(members: &mut Vec<(String, Json)>, key: &str, items: Vec<Json>) {
    match members.iter_mut().find(|(known, _)| known == key) {
        None => members.push((key.to_owned(), Json::List(items))),
        Some((_, Json::List(all))) => all.extend(items),
        // A value that is not a list is reported when the document is read.
        Some(_) => {}
    }
}

/// Returns a document for a robot description alone: the label is the name of the robot, the horizon one second, and
/// `pose` contains the initial position of each joint and each free body.
pub(super) fn document(text: &str) -> Option<Json> {
    let format = format_of(text)?;
    let Description { robot, .. } = read(format, text, None);
    let mut members = Vec::new();
    if let Some(name) = robot.name.filter(|name| !name.is_empty()) {
        members.push(("label", scene::text(&name.chars().take(LONGEST_LABEL).collect::<String>())));
    }
    let pose = robot.poses.into_iter().map(|(name, start)| {
        let start = match start {
            Start::Joint(position) => {
                scene::object([("position", scene::number(position)), ("velocity", scene::number(0.0))])
            }
            Start::Body(frame) => scene::object([
                ("position", scene::vector(&frame.translation.vector)),
                ("orientation", scene::quaternion(&frame.rotation)),
            ]),
        };
        (name, start)
    });
    // Duplicate names of joints or bodies are reported when the robot description is read.
    let mut seen = HashSet::new();
    let mut described = vec![(format, scene::text(text))];
    let pose: Vec<(String, Json)> = pose.filter(|(name, _)| seen.insert(name.clone())).collect();
    if !pose.is_empty() {
        described.push(("pose", Json::Object(pose)));
    }
    let scene = scene::object([(ROBOT, scene::object(described))]);
    members.push(("problem", scene::object([("rigid_bodies", scene)])));
    members.push(("time", scene::object([("end", Json::Number(1.into()))])));
    Some(scene::object(members))
}

/// Returns the format of a robot description, by its XML root element; `None` for any other text.
pub(super) fn format_of(text: &str) -> Option<&'static str> {
    let text = text.trim_start();
    if !text.starts_with('<') {
        return None;
    }
    // XML declarations and comments of any length may precede the root element.
    let first = FORMATS.iter().filter_map(|(format, tag)| Some((text.find(&format!("<{tag}"))?, *format)));
    first.min().map(|(_, format)| format)
}
