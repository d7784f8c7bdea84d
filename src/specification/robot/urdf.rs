//! URDF, the Unified Robot Description Format of ROS (<http://wiki.ros.org/urdf/XML>): links, which joints connect to
//! a tree.
//!
//! A root link without mass is fixed in the world; a root link with mass is free. Links on fixed joints become parts
//! of the links that carry them. Links of one robot do not touch each other, as in most simulators by default.

use super::inertia::Inertial;
use super::motion::{Axis, Motion};
use super::pose::{JointStart, Poses};
use super::scene::{BEYOND_LIMITS, Body, Freedom, Joint, Part, Robot, Shape, Start};
use super::xml::{Element, Reader};
use crate::wording::{abridged, listed};
use expression::nearest;
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use std::collections::HashMap;

/// Default acceleration of gravity along the z axis of a URDF robot, in metres per second squared.
const GRAVITY: f64 = -9.81;
/// Radius of the ball that gives a point mass its inertia, relative to the distance of the mass from the origin of its
/// link.
const POINT: f64 = 1e-3;

const OF_ROBOT: [&str; 2] = ["link", "joint"];
const OF_LINK: [&str; 3] = ["inertial", "visual", "collision"];
const OF_JOINT: [&str; 6] = ["origin", "parent", "child", "axis", "limit", "dynamics"];
/// URDF elements that do not affect the motion of bodies.
const SAY_NOTHING: [&str; 6] = ["material", "gazebo", "transmission", "calibration", "safety_controller", "visual"];
const SHAPES: [&str; 4] = ["box", "sphere", "cylinder", "capsule"];
const KINDS: [&str; 5] = ["revolute", "continuous", "prismatic", "fixed", "floating"];

struct Link<'a, 'x> {
    element: Element<'a, 'x>,
    name: &'a str,
    inertial: Option<Inertial>,
    parts: Vec<Part>,
    /// Index of the joint that carries the link; `None` for a root link.
    on: Option<usize>,
    carries: Vec<usize>,
}

struct Connection<'a, 'x> {
    element: Element<'a, 'x>,
    name: &'a str,
    kind: &'a str,
    child: usize,
    origin: Isometry3<f64>,
    axis: Vector3<f64>,
    limits: [Option<f64>; 2],
    damping: f64,
}

/// Index of the body that carries a link of a URDF robot; `None` for the world.
type Carrier = Option<usize>;

/// Reads a robot from the root element of a URDF description.
pub(super) fn read(root: Element<'_, '_>, poses: &Poses<'_>, reader: &mut Reader) -> Robot {
    let mut links: Vec<Link<'_, '_>> = Vec::new();
    let mut places: HashMap<&str, usize> = HashMap::new();
    for element in root.children() {
        match element.tag() {
            "link" => {
                let Some(name) = reader.name(element) else { continue };
                if places.insert(name, links.len()).is_some() {
                    let detail = format!("there is a link `{}` already", abridged(name));
                    reader.report(element.start(), "duplicate_name", detail, "a name of its own");
                }
                links.push(link(element, name, reader));
            }
            "joint" => {}
            tag if SAY_NOTHING.contains(&tag) => {}
            _ => reader.unknown(element, &OF_ROBOT),
        }
    }
    let mut joints: Vec<Connection<'_, '_>> = Vec::new();
    for element in root.children().filter(|element| element.tag() == "joint") {
        let Some((parent, joint)) = connection(element, &places, reader) else { continue };
        if let Some(other) = links[joint.child].on {
            let names = [abridged(links[joint.child].name), abridged(joints[other].name)];
            let detail = format!("the link `{}` is on the joint `{}` already", names[0], names[1]);
            reader.report(
                element.start(),
                "conflict",
                detail,
                "each link on one joint: loops are closed by `joints` of the scene",
            );
            continue;
        }
        links[joint.child].on = Some(joints.len());
        links[parent].carries.push(joints.len());
        joints.push(joint);
    }
    let mut robot = Robot {
        name: root.get("name").map(str::to_owned),
        is_apart: true,
        gravity: Vector3::new(0.0, 0.0, GRAVITY),
        ..Robot::default()
    };
    if links.is_empty() {
        reader.report(
            root.start(),
            "empty",
            "the robot has no links",
            "<link name=\"..\"> with <inertial> and <collision>",
        );
    }
    let mut assembly = Assembly { links: &links, joints: &joints, poses, reader, robot: &mut robot };
    let mut is_reached = vec![false; links.len()];
    for root in (0..links.len()).filter(|k| links[*k].on.is_none()) {
        assembly.assemble(root, &mut is_reached);
    }
    if let Some(lost) = is_reached.iter().position(|reached| !reached) {
        let detail = format!("the joints go round in a circle by the link `{}`", abridged(links[lost].name));
        reader.report(
            links[lost].element.start(),
            "conflict",
            detail,
            "a tree of links: loops are closed by `joints` of the scene",
        );
    }
    robot
}

fn link<'a, 'x>(element: Element<'a, 'x>, name: &'a str, reader: &mut Reader) -> Link<'a, 'x> {
    let mut link = Link { element, name, inertial: None, parts: Vec::new(), on: None, carries: Vec::new() };
    for child in element.children() {
        match child.tag() {
            "inertial" => link.inertial = inertial(child, reader).or(link.inertial),
            "collision" => link.parts.extend(collision(child, reader)),
            tag if SAY_NOTHING.contains(&tag) => {}
            _ => reader.unknown(child, &OF_LINK),
        }
    }
    link
}

fn inertial(element: Element<'_, '_>, reader: &mut Reader) -> Option<Inertial> {
    let at = origin(element, reader);
    let Some(of_mass) = element.child("mass") else {
        reader.report(element.start(), "missing_key", "<inertial> has no <mass>", "<mass value=\"..\"/>");
        return None;
    };
    let mass = reader.required_number(of_mass, "value")?;
    if mass == 0.0 {
        return None;
    }
    let mass = reader.above_zero(of_mass, "value", mass)?;
    let Some(moments) = element.child("inertia") else {
        reader.report(
            element.start(),
            "missing_key",
            "<inertial> has no <inertia>",
            "<inertia ixx=\"..\" iyy=\"..\" izz=\"..\"/>",
        );
        return None;
    };
    let [xx, yy, zz] = ["ixx", "iyy", "izz"].map(|name| reader.required_number(moments, name));
    let [xy, xz, yz] = ["ixy", "ixz", "iyz"].map(|name| reader.number(moments, name).unwrap_or(0.0));
    let (xx, yy, zz) = (xx?, yy?, zz?);
    let mut inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    if inertia == Matrix3::zeros() {
        let radius = POINT * at.translation.vector.norm();
        inertia = Matrix3::identity() * (0.4 * mass * radius * radius);
        if radius > 0.0 {
            reader.leave_out(
                element,
                "a mass without inertia is that of a ball with a thousandth of its distance for its radius",
            );
        } else {
            reader.report(
                moments.start(),
                "out_of_range",
                "all moments of inertia are 0",
                "moments of inertia above 0",
            );
            return None;
        }
    }
    Some(Inertial { mass, centre: Vector3::zeros(), inertia }.placed(&at))
}

/// Reads the pose of one frame in another: a translation, and rotations about the fixed axes x, y and z.
fn origin(element: Element<'_, '_>, reader: &mut Reader) -> Isometry3<f64> {
    let Some(origin) = element.child("origin") else { return Isometry3::identity() };
    let shift = reader.numbers::<3>(origin, "xyz").unwrap_or_default();
    let [roll, pitch, yaw] = reader.numbers::<3>(origin, "rpy").unwrap_or_default();
    Isometry3::from_parts(Vector3::from(shift).into(), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn collision(element: Element<'_, '_>, reader: &mut Reader) -> Option<Part> {
    let at = origin(element, reader);
    let Some(geometry) = element.child("geometry") else {
        reader.report(element.start(), "missing_key", "<collision> has no <geometry>", "<geometry> with a shape in it");
        return None;
    };
    let Some(given) = geometry.children().next() else {
        reader.report(geometry.start(), "empty", "<geometry> has no shape", format!("<{}>", SHAPES.join(">, <")));
        return None;
    };
    let shape = match given.tag() {
        "sphere" => Shape::Sphere { radius: reader.length(given, "radius")? },
        "box" => {
            reader.required(given, "size")?;
            let size = reader.numbers::<3>(given, "size")?;
            let least = size.iter().copied().fold(f64::INFINITY, f64::min);
            reader.above_zero(given, "size", least)?;
            Shape::Box { size: size.into() }
        }
        kind @ ("cylinder" | "capsule") => {
            let (radius, length) = (reader.length(given, "radius"), reader.length(given, "length"));
            let (radius, length) = (radius?, length?);
            if kind == "cylinder" { Shape::Cylinder { radius, length } } else { Shape::Capsule { radius, length } }
        }
        "mesh" => {
            let file = abridged(given.get("filename").unwrap_or("")).to_string();
            let detail =
                format!("the shape of this collision is in another file, `{file}`, and no part of the specification");
            reader.refuse(
                given,
                detail,
                format!("one of <{}>, or the shape as a body beside `robot`", SHAPES.join(">, <")),
            );
            return None;
        }
        _ => {
            reader.unknown(given, &SHAPES);
            return None;
        }
    };
    Some(Part { shape, at, friction: None })
}

fn connection<'a, 'x>(
    element: Element<'a, 'x>,
    links: &HashMap<&'a str, usize>,
    reader: &mut Reader,
) -> Option<(usize, Connection<'a, 'x>)> {
    let (name, kind) = (reader.name(element), reader.required(element, "type"));
    let mut of = |tag: &str| {
        let Some(child) = element.child(tag) else {
            reader.report(
                element.start(),
                "missing_key",
                format!("<joint> has no <{tag}>"),
                format!("<{tag} link=\"..\"/>"),
            );
            return None;
        };
        let link = reader.required(child, "link")?;
        let found = links.get(link).copied();
        if found.is_none() {
            let at = child.attribute("link").map_or(child.start(), |(_, at)| at);
            let detail = format!("`{}` is no link", abridged(link));
            let mut known: Vec<&str> = links.keys().copied().collect();
            known.sort_unstable();
            reader.report(at, "unknown_name", detail, listed(known.iter().copied()));
            if let Some(error) = reader.errors.last_mut() {
                error.did_you_mean = nearest(link, known.iter().copied()).map(str::to_owned);
            }
        }
        found
    };
    let (parent, child) = (of("parent"), of("child"));
    for other in element.children() {
        match other.tag() {
            "mimic" => reader.refuse(other, "a joint that follows another", "two joints, or a motor of `robot.motors`"),
            tag if OF_JOINT.contains(&tag) || SAY_NOTHING.contains(&tag) => {}
            _ => reader.unknown(other, &OF_JOINT),
        }
    }
    let origin = origin(element, reader);
    let axis = element.child("axis").and_then(|axis| reader.numbers::<3>(axis, "xyz")).unwrap_or([1.0, 0.0, 0.0]);
    let dynamics = element.child("dynamics");
    let damping = dynamics.and_then(|dynamics| reader.number(dynamics, "damping")).unwrap_or(0.0);
    if dynamics.is_some_and(|dynamics| reader.number(dynamics, "friction").is_some_and(|friction| friction != 0.0)) {
        reader.leave_out(element, "friction in joints is left out");
    }
    let (name, kind) = (name?, kind?);
    let ends =
        element.child("limit").map(|limit| ["lower", "upper"].map(|end| reader.number(limit, end).unwrap_or(0.0)));
    let limits = match (kind, ends) {
        ("revolute" | "prismatic", Some([lower, upper])) => [Some(lower), Some(upper)],
        ("revolute" | "prismatic", None) => {
            let detail = format!("a {kind} joint has no <limit>");
            reader.report(
                element.start(),
                "missing_key",
                detail,
                "<limit lower=\"..\" upper=\"..\"/>, or the type `continuous`",
            );
            [None; 2]
        }
        _ => [None; 2],
    };
    if !KINDS.contains(&kind) {
        let at = element.attribute("type").map_or(element.start(), |(_, at)| at);
        let detail = format!("joints of the type `{}` are not known here", abridged(kind));
        reader.report(at, "unsupported_element", detail, listed(KINDS));
        return None;
    }
    let joint = Connection { element, name, kind, child: child?, origin, axis: axis.into(), limits, damping };
    Some((parent?, joint))
}

struct Assembly<'r, 'l, 'a, 'x, 'j> {
    links: &'l [Link<'a, 'x>],
    joints: &'l [Connection<'a, 'x>],
    poses: &'r Poses<'j>,
    reader: &'r mut Reader,
    robot: &'r mut Robot,
}

impl Assembly<'_, '_, '_, '_, '_> {
    /// Builds a root link of a URDF robot and all links that it carries.
    fn assemble(&mut self, root: usize, is_reached: &mut [bool]) {
        let link = &self.links[root];
        let (frame, velocity, angular) = self.poses.of_body(link.name, Isometry3::identity());
        self.robot.poses.push((link.name.to_owned(), Start::Body(Isometry3::identity())));
        let (motion, carrier) = match link.inertial {
            None => {
                let motion = Motion::at_rest(frame);
                (motion, self.standing(root, motion))
            }
            Some(_) => {
                let motion = Motion::moving(frame, velocity, angular);
                (motion, Some(self.body(root, motion, link.inertial)))
            }
        };
        let mut waiting = vec![(root, motion, carrier, link.inertial.is_some())];
        while let Some((at, motion, carrier, moves)) = waiting.pop() {
            is_reached[at] = true;
            for &joint in self.links[at].carries.iter().rev() {
                let child = self.joints[joint].child;
                let (motion, carrier, moves) = self.carry(joint, motion, (carrier, moves));
                waiting.push((child, motion, carrier, moves));
            }
        }
    }

    /// Adds a body for a link of a URDF robot; returns the index of the body.
    fn body(&mut self, link: usize, motion: Motion, inertial: Option<Inertial>) -> usize {
        let Link { element, name, parts, .. } = &self.links[link];
        let place = self.reader.place(element.start());
        let (name, parts) = ((*name).to_owned(), parts.clone());
        self.robot.bodies.push(Body { name, place, motion, inertial, parts, masks: [1, 1] });
        self.robot.bodies.len() - 1
    }

    /// Adds a fixed body for a link of a URDF robot that does not move, if the link has a shape.
    fn standing(&mut self, link: usize, motion: Motion) -> Carrier {
        let has_shape = !self.links[link].parts.is_empty();
        has_shape.then(|| self.body(link, Motion::at_rest(motion.frame), None))
    }

    /// Builds the link that a joint carries; returns the motion of the link, the body that it is a part of, and
    /// whether it moves.
    fn carry(&mut self, joint: usize, motion: Motion, (carrier, moves): (Carrier, bool)) -> (Motion, Carrier, bool) {
        let Connection { element, name, kind, child, origin, axis, limits, damping } = &self.joints[joint];
        let place = self.reader.place(element.start());
        let at = motion.carrying(origin);
        let is_locked = matches!(limits, [Some(lower), Some(upper)] if lower == upper);
        if is_locked && *kind != "fixed" {
            self.reader.leave_out(*element, "joints whose limits are the same are fixed");
        }
        let link = &self.links[*child];
        if *kind == "fixed" || is_locked {
            let at = match (is_locked, limits[0]) {
                (true, Some(q)) => self.step(at, axis, *kind == "prismatic", (q, 0.0)).0,
                _ => at,
            };
            return (at, self.merge(*child, at, carrier, moves), moves);
        }
        let Some(inertial) = link.inertial else {
            let detail = format!("the link `{}` moves and has no mass", abridged(link.name));
            self.reader.report(
                link.element.start(),
                "mass_or_density",
                detail,
                "<inertial> with <mass> and <inertia>, or a fixed joint",
            );
            return (at, carrier, moves);
        };
        if *kind == "floating" {
            let (frame, velocity, angular) = self.poses.of_body(link.name, at.frame);
            self.robot.poses.push((link.name.to_owned(), Start::Body(at.frame)));
            let motion = Motion::moving(frame, velocity, angular);
            return (motion, Some(self.body(*child, motion, Some(inertial))), true);
        }
        let JointStart { position, velocity, is_moved } = self.poses.of_joint(name, 0.0, *limits);
        if is_moved {
            self.reader.leave_out(*element, BEYOND_LIMITS);
        }
        self.robot.poses.push(((*name).to_owned(), Start::Joint(position)));
        let is_slider = *kind == "prismatic";
        let (motion, point, along) = self.step(at, axis, is_slider, (position, velocity));
        let body = self.body(*child, motion, Some(inertial));
        let freedom = if is_slider { Freedom::Slider } else { Freedom::Hinge };
        self.robot.joints.push(Joint {
            name: Some((*name).to_owned()),
            axis: along,
            limits: limits.map(|end| end.map(|end| end - position)),
            damping: *damping,
            ..Joint::new(freedom, place, (body, carrier), point)
        });
        (motion, Some(body), true)
    }

    fn step(
        &self,
        at: Motion,
        axis: &Vector3<f64>,
        is_slider: bool,
        start: (f64, f64),
    ) -> (Motion, Vector3<f64>, Vector3<f64>) {
        at.behind(&Axis { at: Vector3::zeros(), along: *axis, is_slider }, start)
    }

    /// Merges a link of a URDF robot into the moving body that carries it; a link that does not move becomes a fixed
    /// body.
    fn merge(&mut self, link: usize, motion: Motion, carrier: Carrier, moves: bool) -> Carrier {
        let Some(body) = carrier.filter(|_| moves) else { return self.standing(link, motion).or(carrier) };
        let Link { inertial, parts, .. } = &self.links[link];
        let host = &mut self.robot.bodies[body];
        let at = host.motion.frame.inverse() * motion.frame;
        host.parts.extend(parts.iter().map(|part| Part { at: at * part.at, ..*part }));
        if let (Some(of_host), Some(inertial)) = (host.inertial, inertial) {
            host.inertial = Some(of_host.with(inertial.placed(&at)));
        }
        carrier
    }
}
