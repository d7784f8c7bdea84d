//! MJCF, the format of MuJoCo (Todorov, Erez and Tassa 2012, *MuJoCo: a physics engine for model-based control*;
//! <https://mujoco.readthedocs.io/en/stable/XMLreference.html>): nested bodies, their joints, and shapes with masses.
//!
//! Contacts of a scene are rigid, with Coulomb's law; those of MuJoCo are soft. Several joints of one body act one
//! after the other: between the joints, bodies with a millionth of its mass are inserted.

mod bodies;
mod geometry;
mod settings;

use super::inertia::Inertial;
use super::pose::Poses;
use super::scene::{Freedom, Joint, Robot};
use super::xml::{Element, Reader};
use crate::wording::{abridged, listed};
use bodies::Assembly;
use expression::nearest;
use nalgebra::Isometry3;
use settings::Settings;
use std::collections::HashMap;

/// Sections of an MJCF model that do not describe bodies, joints or contacts.
const SAY_NOTHING: [&str; 9] =
    ["size", "visual", "statistic", "asset", "sensor", "custom", "keyframe", "compiler", "option"];
const SECTIONS: [&str; 8] = ["compiler", "option", "default", "worldbody", "contact", "equality", "tendon", "actuator"];
/// Elements of an MJCF model that include other files, or that generate bodies by rules.
const MAKERS: [&str; 7] = ["include", "composite", "flexcomp", "replicate", "attach", "deformable", "extension"];

/// Reads a robot from the root element of an MJCF model.
pub(super) fn read(root: Element<'_, '_>, poses: &Poses<'_>, reader: &mut Reader) -> Robot {
    let settings = Settings::read(root, reader);
    let mut robot = Robot { name: root.get("model").map(str::to_owned), gravity: settings.gravity, ..Robot::default() };
    let mut assembly = Assembly::new(&settings, poses, reader, &mut robot);
    for section in root.children() {
        match section.tag() {
            "worldbody" => assembly.world(section),
            tag if MAKERS.contains(&tag) => refuse_maker(section, assembly.reader),
            tag if SAY_NOTHING.contains(&tag) || SECTIONS.contains(&tag) => {}
            _ => assembly.reader.unknown(section, &SECTIONS),
        }
    }
    let (known, joints) = assembly.finish();
    for section in root.children() {
        match section.tag() {
            "contact" => contacts(section, &known, reader, &mut robot),
            "equality" => equalities(section, &settings, &known, reader, &mut robot),
            "tendon" => tendons(section, reader),
            "actuator" => actuators(section, &settings, &joints, reader, &mut robot),
            "keyframe" => reader.leave_out(section, "keyframes are left out: give the start as `robot.pose`"),
            _ => {}
        }
    }
    if let Some(total) = settings.total_mass {
        let now: f64 = robot.bodies.iter().filter_map(|body| Some(body.inertial?.mass)).sum();
        for inertial in robot.bodies.iter_mut().filter_map(|body| body.inertial.as_mut()) {
            *inertial = Inertial::scaled(*inertial, total / now);
        }
    }
    if robot.bodies.is_empty() && reader.errors.is_empty() {
        reader.report(root.start(), "empty", "the model has no bodies", "<worldbody> with a <body> in it");
    }
    robot
}

fn refuse_maker(element: Element<'_, '_>, reader: &mut Reader) {
    let detail = format!("<{}> takes from another file, or makes bodies by a rule", abridged(element.tag()));
    reader.refuse(element, detail, "the bodies written out: MuJoCo saves a model as one file with mj_saveLastXML");
}

/// Returns the index of the body that an attribute of an MJCF element names (`None` for the world), or nothing if the
/// name is unknown, which is reported.
fn body_of(
    element: Element<'_, '_>,
    attribute: &str,
    known: &HashMap<String, Option<usize>>,
    reader: &mut Reader,
) -> Option<Option<usize>> {
    let name = reader.required(element, attribute)?;
    let found = known.get(name).copied();
    if found.is_none() {
        let detail = format!("`{}` is no body", abridged(name));
        let mut names: Vec<&str> = known.keys().map(String::as_str).collect();
        names.sort_unstable();
        let at = element.attribute(attribute).map_or(element.start(), |(_, at)| at);
        reader.report(at, "unknown_name", detail, listed(names.iter().copied()));
        if let Some(error) = reader.errors.last_mut() {
            error.did_you_mean = nearest(name, names.iter().copied()).map(str::to_owned);
        }
    }
    found
}

fn contacts(section: Element<'_, '_>, known: &HashMap<String, Option<usize>>, reader: &mut Reader, robot: &mut Robot) {
    for element in section.children() {
        match element.tag() {
            "exclude" => {
                let bodies = ["body1", "body2"].map(|name| body_of(element, name, known, reader));
                if let [Some(Some(a)), Some(Some(b))] = bodies
                    && a != b
                {
                    robot.apart.insert((a.min(b), a.max(b)));
                }
            }
            "pair" => reader.refuse(
                element,
                "a pair of shapes with a contact of its own",
                "`contype` and `conaffinity` of both shapes",
            ),
            _ => reader.unknown(element, &["exclude", "pair"]),
        }
    }
}

fn equalities(
    section: Element<'_, '_>,
    settings: &Settings<'_>,
    known: &HashMap<String, Option<usize>>,
    reader: &mut Reader,
    robot: &mut Robot,
) {
    for plain in section.children() {
        let element = settings.inheriting(plain, None, "equality", reader);
        if element.get("active") == Some("false") {
            continue;
        }
        let freedom = match element.tag() {
            "connect" => Freedom::Ball,
            "weld" => Freedom::Nothing,
            tag => {
                let detail = format!("an equality of the kind <{}>", abridged(tag));
                reader.refuse(element, detail, "<connect> or <weld> of two bodies");
                continue;
            }
        };
        if element.get("site1").is_some() || element.get("relpose").is_some() {
            reader.refuse(element, "an equality by sites, or with a pose of its own", "`body1`, `body2` and `anchor`");
            continue;
        }
        let first = body_of(element, "body1", known, reader);
        let second = if element.get("body2").is_some() { body_of(element, "body2", known, reader) } else { Some(None) };
        let anchor = reader.numbers::<3>(element, "anchor").unwrap_or_default();
        let (Some(first), Some(second)) = (first, second) else { continue };
        let frame = first.map_or(Isometry3::identity(), |body| robot.bodies[body].motion.frame);
        let at = frame.transform_point(&anchor.into()).coords;
        let pair = match (first, second) {
            (Some(a), other) if Some(a) != other => (a, other),
            (None, Some(b)) => (b, None),
            _ => {
                reader.report(
                    element.start(),
                    "nothing_to_join",
                    "both bodies move as one",
                    "two bodies that move apart",
                );
                continue;
            }
        };
        let place = reader.place(element.start());
        let name = element.get("name").map(str::to_owned);
        robot.joints.push(Joint { name, ..Joint::new(freedom, place, pair, at) });
    }
}

fn tendons(section: Element<'_, '_>, reader: &mut Reader) {
    for element in section.children() {
        let pulls = ["stiffness", "damping", "range", "frictionloss"].iter().any(|name| element.get(name).is_some());
        if pulls {
            reader.refuse(element, "a tendon that pulls", "`springs` of the scene between two points");
        } else {
            reader.leave_out(element, "tendons are left out");
        }
    }
}

/// By the name of an MJCF joint: its index in the robot, and its coordinate at the start.
type JointsByName = HashMap<String, (usize, f64)>;

/// Adds the effect of MJCF actuators whose controls are zero: a motor does nothing, a position servo is a spring, and a
/// velocity servo is a damper.
fn actuators(
    section: Element<'_, '_>,
    settings: &Settings<'_>,
    joints: &JointsByName,
    reader: &mut Reader,
    robot: &mut Robot,
) {
    for plain in section.children() {
        let element = settings.inheriting(plain, None, plain.tag(), reader);
        let Some((name, at)) = element.attribute("joint") else {
            reader.leave_out(element, "actuators of anything but joints are left out");
            continue;
        };
        let Some(&(joint, start)) = joints.get(name) else {
            let detail = format!("`{}` is no joint", abridged(name));
            let mut names: Vec<&str> = joints.keys().map(String::as_str).collect();
            names.sort_unstable();
            reader.report(at, "unknown_name", detail, listed(names.iter().copied()));
            continue;
        };
        let gear = reader.list(element, "gear").and_then(|gear| gear.first().copied()).unwrap_or(1.0);
        let of = |name: &str, default: f64, reader: &mut Reader| reader.number(element, name).unwrap_or(default);
        match element.tag() {
            "motor" => {
                reader.leave_out(element, "motors have no control and do nothing: drive joints by `robot.motors`")
            }
            "position" => {
                let (stiffness, damping) = (of("kp", 1.0, reader), of("kv", 0.0, reader));
                robot.joints[joint].add_spring(stiffness * gear * gear, -start, damping * gear * gear);
                reader.leave_out(element, "servos have no control and pull towards 0: drive joints by `robot.motors`");
            }
            "velocity" => {
                let damping = of("kv", 1.0, reader);
                robot.joints[joint].add_spring(0.0, 0.0, damping * gear * gear);
                reader.leave_out(
                    element,
                    "servos of velocity have no control and slow down: drive joints by `robot.motors`",
                );
            }
            tag => {
                let what = format!("actuators of the kind <{}> are left out", abridged(tag));
                reader.leave_out(element, what);
            }
        }
    }
}
