//! Intermediate form of a robot description: bodies, joints, and pairs of bodies without contact. It is translated
//! into members of a rigid-body scene.

use super::inertia::Inertial;
use super::motion::Motion;
use super::xml::Place;
use crate::json::Json;
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use serde_json::Number;
use std::collections::{BTreeMap, BTreeSet, HashSet};

/// The shape of a body of a robot, or of a part of it, along the axes of its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    Sphere {
        radius: f64,
    },
    Ellipsoid {
        radii: Vector3<f64>,
    },
    /// A box; `size` holds the lengths of its edges.
    Box {
        size: Vector3<f64>,
    },
    /// A capsule; `length` is the length of the cylinder between the half balls.
    Capsule {
        radius: f64,
        length: f64,
    },
    Cylinder {
        radius: f64,
        length: f64,
    },
    /// The half-space below the plane normal to the third axis.
    HalfSpace,
}

/// A collision shape of a body of a robot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    pub shape: Shape,
    /// Pose of the shape in the frame of the body.
    pub at: Isometry3<f64>,
    /// Coefficient of friction of the shape, if the description gives one.
    pub friction: Option<f64>,
}

/// A body of a robot description.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub name: String,
    pub place: Place,
    pub motion: Motion,
    /// Mass and inertia of the body; `None` for a fixed body.
    pub inertial: Option<Inertial>,
    pub parts: Vec<Part>,
    /// Collision masks of the body: two bodies can touch if the first mask of one shares a bit with the second mask of
    /// the other.
    pub masks: [u32; 2],
}

/// Kind of a joint, by the relative motion that it leaves free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Freedom {
    Hinge,
    Slider,
    Ball,
    Nothing,
}

/// A joint between a body of a robot and another body, or the world.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    /// Name of the joint in the description.
    pub name: Option<String>,
    pub place: Place,
    pub freedom: Freedom,
    pub body: usize,
    pub other: Option<usize>,
    /// A point on the joint and the direction of its axis, both in world coordinates at the start.
    pub at: Vector3<f64>,
    pub axis: Vector3<f64>,
    /// Lower and upper limit of the joint coordinate, which is zero in the initial position.
    pub limits: [Option<f64>; 2],
    pub stiffness: f64,
    /// Joint coordinate at which the spring of the joint exerts no force.
    pub rest: f64,
    pub damping: f64,
}

impl Joint {
    /// Creates a joint without limits, spring or damper.
    pub fn new(freedom: Freedom, place: Place, bodies: (usize, Option<usize>), at: Vector3<f64>) -> Self {
        Self {
            name: None,
            place,
            freedom,
            body: bodies.0,
            other: bodies.1,
            at,
            axis: Vector3::z(),
            limits: [None; 2],
            stiffness: 0.0,
            rest: 0.0,
            damping: 0.0,
        }
    }

    /// Whether the joint has a scalar coordinate, as hinges and sliders have.
    pub fn is_axial(&self) -> bool {
        matches!(self.freedom, Freedom::Hinge | Freedom::Slider)
    }

    /// Adds a spring and a damper along the joint coordinate, merged with those that the joint already has.
    pub fn add_spring(&mut self, stiffness: f64, rest: f64, damping: f64) {
        let both = self.stiffness + stiffness;
        if both > 0.0 {
            self.rest = (self.stiffness * self.rest + stiffness * rest) / both;
        }
        (self.stiffness, self.damping) = (both, self.damping + damping);
    }
}

/// Content of a robot description: a robot, or any other mechanism.
#[derive(Debug, Default)]
pub(super) struct Robot {
    pub name: Option<String>,
    pub bodies: Vec<Body>,
    pub joints: Vec<Joint>,
    /// Pairs of bodies without contact with each other, the smaller index first.
    pub apart: BTreeSet<(usize, usize)>,
    /// Whether no two bodies of the robot description have contact with each other.
    pub is_apart: bool,
    pub gravity: Vector3<f64>,
    /// Initial joint coordinates and initial poses of free bodies, by the names in the description, for use unless
    /// the user gives others.
    pub poses: Vec<(String, Start)>,
}

/// Initial position of a joint or a free body of a robot.
#[derive(Clone, Copy, Debug)]
pub(super) enum Start {
    /// Initial coordinate of a joint.
    Joint(f64),
    /// Initial pose of a free body, in the world.
    Body(Isometry3<f64>),
}

/// Remark on joints whose limits exclude the coordinate 0, so that they start at the middle of their limits.
pub(super) const BEYOND_LIMITS: &str =
    "joints whose limits do not hold 0 begin in their middle: give the start as `robot.pose`";

/// Names of contact groups: bodies that touch nothing, bodies of a robot that do not touch each other, and bodies of
/// the scene outside the robot.
const NOTHING: &str = "touches_nothing";
const ROBOT: &str = "robot";
pub(super) const OTHERS: &str = "others";

/// Radius of a body without a shape, relative to the largest distance from its centre of mass to a joint.
const SMALL: f64 = 1e-2;

pub(super) fn number(value: f64) -> Json {
    Number::from_f64(value).map_or(Json::Null, Json::Number)
}

pub(super) fn text(value: &str) -> Json {
    Json::Text(value.to_owned())
}

pub(super) fn vector(value: &Vector3<f64>) -> Json {
    Json::List(value.iter().copied().map(number).collect())
}

pub(super) fn quaternion(value: &UnitQuaternion<f64>) -> Json {
    Json::List([value.w, value.i, value.j, value.k].map(number).into())
}

pub(super) fn object(members: impl IntoIterator<Item = (&'static str, Json)>) -> Json {
    Json::Object(members.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
}

fn matrix(value: &Matrix3<f64>) -> Json {
    // The upper triangle is written twice, so that the matrix is exactly symmetric.
    let entry = |i: usize, j: usize| number(value[(i.min(j), i.max(j))]);
    Json::List((0..3).map(|i| Json::List((0..3).map(|j| entry(i, j)).collect())).collect())
}

impl Shape {
    fn json(&self) -> Json {
        let round = |radius: f64, length: f64| object([("radius", number(radius)), ("length", number(length))]);
        match self {
            Self::Sphere { radius } => object([("sphere", object([("radius", number(*radius))]))]),
            Self::Box { size } => object([("box", object([("size", vector(size))]))]),
            Self::Capsule { radius, length } => object([("capsule", round(*radius, *length))]),
            Self::Cylinder { radius, length } => object([("cylinder", round(*radius, *length))]),
            // A ball can replace an ellipsoid, which touches nothing: ellipsoids that could touch other shapes have
            // been refused.
            Self::Ellipsoid { radii } => object([("sphere", object([("radius", number(radii.max()))]))]),
            Self::HalfSpace => object([("half_space", object([("normal", vector(&Vector3::z()))]))]),
        }
    }
}

/// The JSON members of a scene that a robot is translated into, in the order of the bodies and joints of the robot.
#[derive(Debug, Default)]
pub(super) struct Written {
    pub bodies: Vec<Json>,
    pub joints: Vec<Json>,
    pub materials: Vec<(String, Json)>,
    pub pairs: Vec<Json>,
    pub exclude: Vec<Json>,
    /// Group for those bodies of the scene outside the robot that have no group.
    pub group_of_others: Option<&'static str>,
}

impl Robot {
    /// Translates the robot into members of a scene whose other bodies have the contact groups `groups_of_others`;
    /// `names` are the names of the robot's bodies and joints in the scene.
    pub fn write(&self, groups_of_others: &BTreeSet<String>, names: &Names) -> Written {
        let mut written = Written::default();
        let frictions = self.frictions();
        for (k, friction) in frictions.iter().enumerate() {
            written.materials.push((material(k), object([("friction", number(*friction))])));
            for (j, other) in frictions.iter().enumerate().take(k) {
                let both = Json::List(vec![text(&material(j)), text(&material(k))]);
                written.pairs.push(object([("materials", both), ("friction", number(friction.max(*other)))]));
            }
        }
        let groups = self.groups(groups_of_others, &mut written);
        for (k, body) in self.bodies.iter().enumerate() {
            let friction = body.friction().and_then(|friction| frictions.iter().position(|known| *known == friction));
            written.bodies.push(self.body(k, &names.bodies[k], groups.get(k), friction.map(material)));
        }
        for (joint, name) in self.joints.iter().zip(&names.joints) {
            written.joints.push(joint.json(name.as_deref(), &names.bodies));
        }
        written
    }

    fn frictions(&self) -> Vec<f64> {
        let mut all: Vec<f64> = self.bodies.iter().filter_map(Body::friction).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    }

    /// Returns the contact group of each body of the robot, or nothing if no groups are needed, and adds the pairs of
    /// groups without contact to `written`.
    fn groups(&self, of_others: &BTreeSet<String>, written: &mut Written) -> Vec<String> {
        let touches = |body: &Body| !body.parts.is_empty();
        let masks: HashSet<[u32; 2]> = self.bodies.iter().filter(|body| touches(body)).map(|body| body.masks).collect();
        let is_plain = self.bodies.iter().all(touches) && masks.len() <= 1 && masks.iter().all(|mask| meet(mask, mask));
        if is_plain && !self.is_apart && self.apart.is_empty() {
            return Vec::new();
        }
        let alone: HashSet<usize> = self.apart.iter().flat_map(|(a, b)| [*a, *b]).collect();
        let group = |(k, body): (usize, &Body)| match () {
            () if !touches(body) => NOTHING.to_owned(),
            () if self.is_apart => ROBOT.to_owned(),
            () if alone.contains(&k) => format!("{ROBOT}.{k}"),
            () => format!("{ROBOT}.{}.{}", body.masks[0], body.masks[1]),
        };
        let groups: Vec<String> = self.bodies.iter().enumerate().map(group).collect();
        // One body represents each contact group: all bodies of a group have the same contacts.
        let mut first: BTreeMap<&str, usize> = BTreeMap::new();
        for (k, group) in groups.iter().enumerate() {
            first.entry(group).or_insert(k);
        }
        let mut exclude = |a: &str, b: &str| written.exclude.push(Json::List(vec![text(a), text(b)]));
        for (a, &i) in &first {
            for (b, &j) in first.range(*a..) {
                let (one, other) = (&self.bodies[i], &self.bodies[j]);
                let is_pair = self.apart.contains(&(i.min(j), i.max(j)));
                let is_apart = self.is_apart || is_pair || !meet(&one.masks, &other.masks);
                if is_apart || !touches(one) || !touches(other) {
                    exclude(a, b);
                }
            }
        }
        if first.contains_key(NOTHING) {
            written.group_of_others = Some(OTHERS);
            exclude(NOTHING, OTHERS);
            of_others.iter().for_each(|group| exclude(NOTHING, group));
        }
        groups
    }

    fn body(&self, k: usize, name: &str, group: Option<&String>, material: Option<String>) -> Json {
        let body = &self.bodies[k];
        let mut members = vec![("name", text(name)), ("shape", self.shape(k))];
        match &body.inertial {
            None => members.push(("fixed", Json::Bool(true))),
            Some(inertial) => members.extend([
                ("mass", number(inertial.mass)),
                ("centre_of_mass", vector(&inertial.centre)),
                ("inertia", matrix(&inertial.inertia)),
            ]),
        }
        members.push(("position", vector(&body.motion.frame.translation.vector)));
        members.push(("orientation", quaternion(&body.motion.frame.rotation)));
        let (velocity, angular) = (body.motion.velocity(), body.motion.angular);
        if body.inertial.is_some() && (velocity != Vector3::zeros() || angular != Vector3::zeros()) {
            members.extend([("velocity", vector(&velocity)), ("angular_velocity", vector(&angular))]);
        }
        members.extend(material.map(|material| ("material", text(&material))));
        members.extend(group.map(|group| ("group", text(group))));
        object(members)
    }

    fn shape(&self, k: usize) -> Json {
        let body = &self.bodies[k];
        match body.parts.as_slice() {
            [] => Shape::Sphere { radius: self.radius(k) }.json(),
            [part] if part.at == Isometry3::identity() => part.shape.json(),
            parts => {
                let part = |part: &Part| {
                    let (position, orientation) = (vector(&part.at.translation.vector), quaternion(&part.at.rotation));
                    object([("shape", part.shape.json()), ("position", position), ("orientation", orientation)])
                };
                object([("compound", Json::List(parts.iter().map(part).collect()))])
            }
        }
    }

    /// Returns the radius of the ball that stands for a body without a shape, which touches nothing.
    fn radius(&self, k: usize) -> f64 {
        let body = &self.bodies[k];
        let centre = body.inertial.map_or_else(Vector3::zeros, |inertial| inertial.centre);
        let centre = body.motion.frame.transform_point(&centre.into()).coords;
        let of_joints = self.joints.iter().filter(|joint| joint.body == k || joint.other == Some(k));
        let farthest = of_joints.map(|joint| (joint.at - centre).norm()).fold(0.0, f64::max);
        if farthest > 0.0 { SMALL * farthest } else { SMALL }
    }
}

/// Whether bodies with the collision masks `a` and `b` can touch.
fn meet(a: &[u32; 2], b: &[u32; 2]) -> bool {
    a[0] & b[1] != 0 || b[0] & a[1] != 0
}

fn material(k: usize) -> String {
    format!("friction_{}", k + 1)
}

impl Body {
    /// Returns the largest coefficient of friction of the collision shapes of the body.
    fn friction(&self) -> Option<f64> {
        self.parts.iter().filter_map(|part| part.friction).reduce(f64::max)
    }
}

impl Joint {
    fn json(&self, name: Option<&str>, bodies: &[String]) -> Json {
        let of = [Some(self.body), self.other].into_iter().flatten();
        let mut members = vec![("bodies", Json::List(of.map(|body| text(&bodies[body])).collect()))];
        members.extend(name.map(|name| ("name", text(name))));
        if self.freedom != Freedom::Nothing {
            members.push(("at", vector(&self.at)));
        }
        if self.is_axial() {
            members.push(("axis", vector(&self.axis)));
            self.drive(name.is_some(), &mut members);
        }
        let kind = match self.freedom {
            Freedom::Hinge => "hinge",
            Freedom::Slider => "slider",
            Freedom::Ball => "ball",
            Freedom::Nothing => "fixed",
        };
        object([(kind, object(members))])
    }

    /// Adds the limits and the spring of the joint to `members`; a named joint with neither gets a motor of zero
    /// effort, so that its coordinate is an output.
    fn drive(&self, is_named: bool, members: &mut Vec<(&'static str, Json)>) {
        let [lower, upper] = self.limits;
        let ends: Vec<(&'static str, Json)> = [("lower", lower), ("upper", upper)]
            .into_iter()
            .filter_map(|(key, end)| Some((key, number(end?))))
            .collect();
        let is_sprung = self.stiffness > 0.0 || self.damping > 0.0;
        if is_named && ends.is_empty() && !is_sprung {
            members.push(("motor", object([("effort", number(0.0))])));
        }
        if !ends.is_empty() {
            members.push(("limits", object(ends)));
        }
        if is_sprung {
            let mut spring = vec![("damping", number(self.damping))];
            if self.stiffness > 0.0 {
                spring.extend([("stiffness", number(self.stiffness)), ("rest", number(self.rest))]);
            }
            members.push(("spring", object(spring)));
        }
    }
}

/// Unique names of the bodies and joints of a robot in a scene, which can be used in expressions.
#[derive(Debug, Default)]
pub(super) struct Names {
    pub bodies: Vec<String>,
    pub joints: Vec<Option<String>>,
    /// Names that had to be changed: the name in the description, then the name in the scene.
    pub changed: Vec<(String, String)>,
}

impl Names {
    /// Assigns unique names to the bodies and joints of a robot.
    pub fn of(robot: &Robot) -> Self {
        let mut taken = HashSet::new();
        let mut names = Self::default();
        for body in &robot.bodies {
            let name = free(&body.name, "", &mut taken);
            names.note(&body.name, &name);
            names.bodies.push(name);
        }
        for joint in &robot.joints {
            let name = joint.name.as_ref().map(|given| {
                let name = free(given, "_joint", &mut taken);
                names.note(given, &name);
                name
            });
            names.joints.push(name);
        }
        names
    }

    fn note(&mut self, given: &str, name: &str) {
        if given != name {
            self.changed.push((given.to_owned(), name.to_owned()));
        }
    }
}

/// Returns an unused name of letters, digits and `_` derived from `given`: with `suffix` if the name is taken, and with
/// a number if that is taken too.
fn free(given: &str, suffix: &str, taken: &mut HashSet<String>) -> String {
    let mut name: String = given.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.is_empty() || name.starts_with(|c: char| c.is_ascii_digit()) {
        name.insert(0, '_');
    }
    if name == "t" {
        // The name `t` is that of the time.
        name.push('_');
    }
    if taken.contains(&name) {
        name.push_str(suffix);
    }
    let (base, mut k) = (name.clone(), 2);
    while !taken.insert(name.clone()) {
        name = format!("{base}_{k}");
        k += 1;
    }
    name
}
