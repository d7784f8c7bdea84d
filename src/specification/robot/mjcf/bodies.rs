//! Nested bodies of an MJCF model, and their joints.

use super::geometry::{self, Geometry};
use super::settings::Settings;
use super::{JointsByName, MAKERS, refuse_maker};
use crate::robot::inertia::Inertial;
use crate::robot::motion::{Axis, Motion};
use crate::robot::pose::{JointStart, Poses};
use crate::robot::scene::{BEYOND_LIMITS, Body, Freedom, Joint, Part, Robot, Start};
use crate::robot::xml::{Element, Place, Reader};
use crate::wording::{abridged, listed};
use nalgebra::{Isometry3, Matrix3, Vector3};
use std::collections::HashMap;

/// Mass of the light body inserted between two joints of one MJCF body, relative to the mass of that body.
const LIGHT: f64 = 1e-6;

/// Elements of an MJCF body that describe neither nested bodies nor shapes.
const SAY_NOTHING: [&str; 6] = ["site", "camera", "light", "inertial", "joint", "freejoint"];
const KNOWN: [&str; 6] = ["body", "geom", "joint", "freejoint", "inertial", "frame"];
const KINDS: [&str; 4] = ["hinge", "slide", "ball", "free"];

/// The translation of an MJCF model to a robot, under construction.
pub(super) struct Assembly<'r, 's, 'j> {
    settings: &'s Settings<'s>,
    poses: &'r Poses<'j>,
    pub reader: &'r mut Reader,
    robot: &'r mut Robot,
    /// By the name of an MJCF body: the body of the robot that it moves with; `None` if it is fixed in the world.
    known: HashMap<String, Option<usize>>,
    joints: JointsByName,
}

/// The context of a nested element of an MJCF model: motion, carrying body and default class of its parent.
#[derive(Clone, Copy)]
struct Around<'a> {
    motion: Motion,
    /// Index of the robot's body that carries the nested element; `None` in the world.
    carrier: Option<usize>,
    /// Default class of elements that name no class.
    class: Option<&'a str>,
}

/// An element of a body, the pose of its frame in the frame of the body, and its default class.
type Placed<'a, 'x> = (Element<'a, 'x>, Isometry3<f64>, Option<&'a str>);

/// A nested body element of an MJCF model that has not been translated to a body yet.
struct Made<'a, 'x> {
    around: Around<'a>,
    element: Element<'a, 'x>,
    /// Pose in the parent's frame of the `<frame>` elements between the body and its parent.
    offset: Isometry3<f64>,
}

impl<'r, 's, 'j> Assembly<'r, 's, 'j> {
    pub fn new(settings: &'s Settings<'s>, poses: &'r Poses<'j>, reader: &'r mut Reader, robot: &'r mut Robot) -> Self {
        let known = HashMap::from([("world".to_owned(), None)]);
        Self { settings, poses, reader, robot, known, joints: JointsByName::new() }
    }

    /// Returns the bodies and the joints of the robot, by their names in the MJCF model.
    pub fn finish(self) -> (HashMap<String, Option<usize>>, JointsByName) {
        (self.known, self.joints)
    }

    /// Builds all bodies of the world of the MJCF model.
    pub fn world(&mut self, section: Element<'s, '_>) {
        let around =
            Around { motion: Motion::at_rest(Isometry3::identity()), carrier: None, class: section.get("childclass") };
        let mut waiting = Vec::new();
        self.fill(section, around, Isometry3::identity(), &mut waiting);
        while let Some(Made { around, element, offset }) = waiting.pop() {
            self.body(element, around, offset, &mut waiting);
        }
    }

    /// Queues the bodies nested in a body or the world, and adds the shapes of the world. A queue in place of recursion
    /// keeps deep nesting off the stack.
    fn fill<'x>(
        &mut self,
        element: Element<'s, 'x>,
        around: Around<'s>,
        offset: Isometry3<f64>,
        waiting: &mut Vec<Made<'s, 'x>>,
    ) {
        let mut bodies = Vec::new();
        for (child, at, class) in self.within(element, offset, around.class) {
            match child.tag() {
                "body" => bodies.push(Made { around: Around { class, ..around }, element: child, offset: at }),
                "geom" if around.carrier.is_none() => self.standing(child, around.motion.carrying(&at), class),
                tag if tag == "geom" || SAY_NOTHING.contains(&tag) => {}
                tag if MAKERS.contains(&tag) => refuse_maker(child, self.reader),
                "plugin" => self.reader.refuse(child, "a plugin", "what it does, in the scene"),
                _ => self.reader.unknown(child, &KNOWN),
            }
        }
        waiting.extend(bodies.into_iter().rev());
    }

    /// Returns the elements of a body and of its `<frame>` elements, each with the pose of its frame and its default
    /// class.
    fn within<'x>(
        &mut self,
        element: Element<'s, 'x>,
        offset: Isometry3<f64>,
        class: Option<&'s str>,
    ) -> Vec<Placed<'s, 'x>> {
        let mut found = Vec::new();
        let mut waiting = vec![(element, offset, class)];
        while let Some((element, offset, class)) = waiting.pop() {
            for child in element.children() {
                if child.tag() == "frame" {
                    let at = offset * self.settings.frame(child, self.reader);
                    waiting.push((child, at, child.get("childclass").or(class)));
                } else {
                    found.push((child, offset, class));
                }
            }
        }
        found
    }

    /// Adds a shape of the world of the MJCF model as a fixed body.
    fn standing(&mut self, element: Element<'s, '_>, motion: Motion, class: Option<&str>) {
        let element = self.settings.inheriting(element, class, "geom", self.reader);
        let Some(geometry) = geometry::read(element, self.settings, false, self.reader) else { return };
        if !geometry.touches() {
            return;
        }
        let place = self.reader.place(element.start());
        let name = element.get("name").map_or_else(|| format!("geom{}", self.robot.bodies.len() + 1), str::to_owned);
        let motion = Motion::at_rest(motion.frame * geometry.at);
        let part = Part { shape: geometry.shape, at: Isometry3::identity(), friction: Some(geometry.friction) };
        self.robot.bodies.push(Body { name, place, motion, inertial: None, parts: vec![part], masks: geometry.masks });
    }

    fn body<'x>(
        &mut self,
        element: Element<'s, 'x>,
        around: Around<'s>,
        offset: Isometry3<f64>,
        waiting: &mut Vec<Made<'s, 'x>>,
    ) {
        let class = element.get("childclass").or(around.class);
        let name = element.get("name").map_or_else(|| self.free_name(), str::to_owned);
        let motion = around.motion.carrying(&(offset * self.settings.frame(element, self.reader)));
        if self.reader.number(element, "gravcomp").is_some_and(|part| part != 0.0) {
            self.reader.refuse(element, "a body that gravity does not pull", "`forces` of the scene");
        }
        let within = self.within(element, Isometry3::identity(), class);
        let joints: Vec<_> =
            within.iter().filter(|(child, ..)| ["joint", "freejoint"].contains(&child.tag())).collect();
        let is_mocap = element.get("mocap") == Some("true");
        if is_mocap {
            self.reader.leave_out(element, "bodies that another program moves stand still");
        }
        let stands = joints.is_empty() && around.carrier.is_none();
        let (inertial, shapes) = self.weigh(element, &within, stands);
        let carrier = if joints.is_empty() {
            self.merge(around, motion, inertial, &shapes);
            if self.known.insert(name.clone(), around.carrier).is_some() {
                self.report_double(element, &name);
            }
            let around = Around { motion, carrier: around.carrier, class };
            return self.fill(element, around, Isometry3::identity(), waiting);
        } else {
            let joints: Vec<Placed<'s, 'x>> = joints.into_iter().copied().collect();
            self.moving(element, &name, (around, motion), &joints, (inertial, &shapes))
        };
        if self.known.insert(name.clone(), carrier).is_some() {
            self.report_double(element, &name);
        }
        let Some(carrier) = carrier else { return };
        let around = Around { motion: self.robot.bodies[carrier].motion, carrier: Some(carrier), class };
        self.fill(element, around, Isometry3::identity(), waiting);
    }

    /// Returns an unused name for a body of an MJCF model that has none.
    fn free_name(&self) -> String {
        let mut k = self.known.len();
        while self.known.contains_key(&format!("body{k}")) {
            k += 1;
        }
        format!("body{k}")
    }

    fn report_double(&mut self, element: Element<'_, '_>, name: &str) {
        let detail = format!("there is a body `{}` already", abridged(name));
        self.reader.report(element.start(), "duplicate_name", detail, "a name of its own");
    }

    /// Returns mass and inertia of an MJCF body, and its shapes; nothing for a body that is fixed in the world.
    fn weigh(
        &mut self,
        element: Element<'s, '_>,
        within: &[Placed<'s, '_>],
        stands: bool,
    ) -> (Option<Inertial>, Vec<Geometry>) {
        let given = element.child("inertial").filter(|_| !self.settings.weighs_by_shapes);
        let mut shapes = Vec::new();
        if stands {
            return (None, shapes);
        }
        let mut sum: Option<Inertial> = None;
        for (child, at, class) in within.iter().filter(|(child, ..)| child.tag() == "geom") {
            let child = self.settings.inheriting(*child, *class, "geom", self.reader);
            let Some(geometry) = geometry::read(child, self.settings, given.is_none(), self.reader) else { continue };
            let Some(weight) = geometry.inertial else {
                self.reader.refuse(child, "a plane that moves", "planes in <worldbody>");
                continue;
            };
            if weight.mass > 0.0 {
                let weight = weight.placed(at);
                sum = Some(sum.map_or(weight, |sum| sum.with(weight)));
            }
            shapes.push(Geometry { at: at * geometry.at, ..geometry });
        }
        let found = match given {
            Some(given) => self.inertial(given),
            None => sum,
        };
        let [mass, moment] = self.settings.least;
        let found = found.map(|found| {
            let least = Matrix3::from_diagonal(&found.inertia.diagonal().map(|own| (moment - own).max(0.0)));
            Inertial { mass: found.mass.max(mass), inertia: found.inertia + least, ..found }
        });
        (found, shapes)
    }

    fn inertial(&mut self, element: Element<'_, '_>) -> Option<Inertial> {
        let at = self.settings.frame(element, self.reader);
        let mass = self.reader.required_number(element, "mass")?;
        let mass = self.reader.above_zero(element, "mass", mass)?;
        let inertia = if let Some([xx, yy, zz, xy, xz, yz]) = self.reader.numbers::<6>(element, "fullinertia") {
            Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
        } else if let Some(moments) = self.reader.numbers::<3>(element, "diaginertia") {
            Matrix3::from_diagonal(&Vector3::from(moments))
        } else {
            let detail = "<inertial> has neither `diaginertia` nor `fullinertia`";
            self.reader.report(element.start(), "missing_key", detail, "diaginertia=\"ixx iyy izz\"");
            return None;
        };
        Some(Inertial { mass, centre: Vector3::zeros(), inertia }.placed(&at))
    }

    /// Merges an MJCF body without joints into the body that carries it; in the world, its shapes are bodies of their
    /// own.
    fn merge(&mut self, around: Around<'s>, motion: Motion, inertial: Option<Inertial>, shapes: &[Geometry]) {
        let Some(carrier) = around.carrier else { return };
        let host = &mut self.robot.bodies[carrier];
        let at = host.motion.frame.inverse() * motion.frame;
        if let (Some(of_host), Some(inertial)) = (host.inertial, inertial) {
            host.inertial = Some(of_host.with(inertial.placed(&at)));
        }
        add_shapes(host, &at, shapes);
    }

    /// Adds an MJCF body with joints, and a light body between each two of its joints; returns the index of the body.
    fn moving(
        &mut self,
        element: Element<'s, '_>,
        name: &str,
        (around, motion): (Around<'s>, Motion),
        joints: &[Placed<'s, '_>],
        (inertial, shapes): (Option<Inertial>, &[Geometry]),
    ) -> Option<usize> {
        let place = self.reader.place(element.start());
        let Some(inertial) = inertial else {
            if self.reader.errors.is_empty() {
                let detail = format!("the body `{}` moves and has no mass", abridged(name));
                self.reader.report(element.start(), "mass_or_density", detail, "<inertial>, or a <geom> that weighs");
            }
            return None;
        };
        let light = {
            let moment = LIGHT * inertial.inertia.trace() / 3.0;
            let inertia = Matrix3::from_diagonal_element(moment);
            Inertial { mass: LIGHT * inertial.mass, centre: Vector3::zeros(), inertia }
        };
        let (mut motion, mut carrier) = (motion, around.carrier);
        for (k, (joint, at, class)) in joints.iter().enumerate() {
            let is_last = k + 1 == joints.len();
            let joint = self.settings.inheriting(*joint, *class, "joint", self.reader);
            let kind = if joint.tag() == "freejoint" { "free" } else { joint.get("type").unwrap_or("hinge") };
            let freedom = match kind {
                "hinge" => Some(Freedom::Hinge),
                "slide" => Some(Freedom::Slider),
                "ball" => Some(Freedom::Ball),
                "free" => None,
                other => {
                    let at = joint.attribute("type").map_or(joint.start(), |(_, at)| at);
                    let detail = format!("`{}` is no kind of joint", abridged(other));
                    self.reader.report(at, "unknown_choice", detail, listed(KINDS));
                    return None;
                }
            };
            let Some(freedom) = freedom else {
                if joints.len() > 1 || around.carrier.is_some() {
                    let expected = "one free joint, of a body of the world";
                    self.reader.report(joint.start(), "conflict", "a free joint is no joint beside others", expected);
                    return None;
                }
                let (frame, velocity, angular) = self.poses.of_body(name, motion.frame);
                self.robot.poses.push((name.to_owned(), Start::Body(motion.frame)));
                let motion = Motion::moving(frame, velocity, angular);
                return Some(self.push(name, place, motion, inertial, shapes));
            };
            let own = joint.get("name").map_or_else(|| format!("{name}_{}", k + 1), str::to_owned);
            let given = self.joint((joint, &own), at, freedom, motion);
            motion = given.motion;
            let body = match is_last {
                true => self.push(name, place, motion, inertial, shapes),
                false => self.push(&format!("{name}_before_{}", k + 2), place, motion, light, &[]),
            };
            let (number, place) = (self.robot.joints.len(), self.reader.place(joint.start()));
            self.robot.joints.push(Joint {
                name: Some(own.clone()),
                axis: given.axis,
                limits: given.limits.map(|end| end.map(|end| end - given.start)),
                stiffness: given.stiffness,
                rest: given.rest - given.start,
                damping: given.damping,
                ..Joint::new(freedom, place, (body, carrier), given.at)
            });
            if freedom != Freedom::Ball {
                self.robot.poses.push((own.clone(), Start::Joint(given.start)));
                self.joints.insert(own, (number, given.start));
            }
            carrier = Some(body);
        }
        let body = carrier?;
        if joints.len() > 1 {
            self.reader.leave_out(
                element,
                "several joints of one body act one after the other, by bodies between them with a millionth of its mass",
            );
            // Exclude contact between the body and its parent: because of the light bodies between the joints, no
            // joint connects the two, which would exclude it.
            if let Some(parent) = around.carrier {
                self.robot.apart.insert((parent.min(body), parent.max(body)));
            }
        }
        Some(body)
    }

    fn push(&mut self, name: &str, place: Place, motion: Motion, inertial: Inertial, shapes: &[Geometry]) -> usize {
        let mut body =
            Body { name: name.to_owned(), place, motion, inertial: Some(inertial), parts: Vec::new(), masks: [0, 0] };
        add_shapes(&mut body, &Isometry3::identity(), shapes);
        self.robot.bodies.push(body);
        self.robot.bodies.len() - 1
    }

    /// Reads a hinge, slider or ball joint, and the motion of the body that it moves.
    fn joint(
        &mut self,
        (joint, name): (Element<'_, '_>, &str),
        at: &Isometry3<f64>,
        freedom: Freedom,
        motion: Motion,
    ) -> Given {
        let reader = &mut *self.reader;
        let unit = if freedom == Freedom::Slider { 1.0 } else { self.settings.angle };
        let anchor = reader.numbers::<3>(joint, "pos").unwrap_or_default();
        let axis = reader.numbers::<3>(joint, "axis").unwrap_or([0.0, 0.0, 1.0]);
        let range = reader.numbers::<2>(joint, "range");
        let is_limited = match joint.get("limited") {
            Some("true") => true,
            Some("false") => false,
            _ => self.settings.limits_itself && range.is_some(),
        };
        let mut of = |name: &str| reader.number(joint, name).unwrap_or(0.0);
        let (stiffness, damping) = (of("stiffness"), of("damping"));
        let (reference, rest) = (of("ref") * unit, of("springref") * unit);
        let (armature, friction) = (of("armature"), of("frictionloss"));
        if armature != 0.0 {
            reader.leave_out(joint, "the inertia of rotors (`armature`) is left out");
        }
        if friction != 0.0 {
            reader.leave_out(joint, "friction in joints (`frictionloss`) is left out");
        }
        let local = Axis {
            at: at.transform_point(&anchor.into()).coords,
            along: at.rotation * Vector3::from(axis),
            is_slider: freedom == Freedom::Slider,
        };
        if freedom == Freedom::Ball {
            if is_limited || stiffness != 0.0 || damping != 0.0 {
                reader.leave_out(joint, "limits, springs and dampers of ball joints are left out");
            }
            let at = motion.frame.transform_point(&local.at.into()).coords;
            return Given { motion, at, ..Given::free(motion) };
        }
        let limits = match range.filter(|_| is_limited) {
            Some([lower, upper]) => [Some(lower * unit), Some(upper * unit)],
            None => [None; 2],
        };
        let JointStart { position: start, velocity, is_moved } = self.poses.of_joint(name, reference, limits);
        if is_moved {
            self.reader.leave_out(joint, BEYOND_LIMITS);
        }
        // In the position that the description gives, the coordinate of a joint equals its reference value.
        let (motion, at, along) = motion.behind(&local, (start - reference, velocity));
        Given { motion, at, axis: along, limits, stiffness, rest, damping, start }
    }
}

/// A joint of an MJCF model as it is read, with the motion of the body that it moves.
struct Given {
    motion: Motion,
    at: Vector3<f64>,
    axis: Vector3<f64>,
    limits: [Option<f64>; 2],
    stiffness: f64,
    rest: f64,
    damping: f64,
    /// Coordinate of the joint at the start of the simulation.
    start: f64,
}

impl Given {
    fn free(motion: Motion) -> Self {
        Self {
            motion,
            at: Vector3::zeros(),
            axis: Vector3::z(),
            limits: [None; 2],
            stiffness: 0.0,
            rest: 0.0,
            damping: 0.0,
            start: 0.0,
        }
    }
}

/// Adds to a body those shapes that can touch others; `at` is the pose of the shapes' frame in the frame of the body.
fn add_shapes(body: &mut Body, at: &Isometry3<f64>, shapes: &[Geometry]) {
    for shape in shapes.iter().filter(|shape| shape.touches()) {
        body.parts.push(Part { shape: shape.shape, at: at * shape.at, friction: Some(shape.friction) });
        body.masks[0] |= shape.masks[0];
        body.masks[1] |= shape.masks[1];
    }
}
