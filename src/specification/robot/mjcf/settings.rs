//! Settings of a whole MJCF model: units, gravity, and the attributes that elements inherit by classes.

use crate::robot::xml::{Defaults, Element, Reader};
use crate::wording::{abridged, listed};
use expression::nearest;
use nalgebra::{Isometry3, Quaternion, Rotation3, Unit, UnitQuaternion, Vector3};
use std::collections::HashMap;

/// Name of the default class of MJCF elements that name no class.
const MAIN: &str = "main";

/// Settings of an MJCF model.
pub(super) struct Settings<'a> {
    /// Radians per unit of angle in the MJCF model.
    pub angle: f64,
    /// Axes of the model's Euler angles, in order; axes in small letters rotate with the body.
    sequence: [char; 3],
    /// Whether the mass of a body always follows from its shapes, and not only where no `<inertial>` gives it.
    pub weighs_by_shapes: bool,
    /// Whether MJCF joints with a range are limited by default.
    pub limits_itself: bool,
    /// Total mass of all bodies of the MJCF model, if the model gives it.
    pub total_mass: Option<f64>,
    /// Smallest mass and smallest moment of inertia of a body of the MJCF model.
    pub least: [f64; 2],
    pub gravity: Vector3<f64>,
    pub has_contacts: bool,
    /// Default attributes of MJCF elements, by class and kind of element.
    classes: HashMap<&'a str, HashMap<&'a str, Defaults<'a>>>,
}

impl<'a> Settings<'a> {
    /// Reads the settings from all sections of an MJCF model.
    pub fn read(root: Element<'a, '_>, reader: &mut Reader) -> Self {
        let mut settings = Self {
            angle: 1_f64.to_radians(),
            sequence: ['x', 'y', 'z'],
            weighs_by_shapes: false,
            limits_itself: true,
            total_mass: None,
            least: [0.0; 2],
            gravity: Vector3::new(0.0, 0.0, -9.81),
            has_contacts: true,
            classes: HashMap::from([(MAIN, HashMap::new())]),
        };
        for section in root.children() {
            match section.tag() {
                "compiler" => settings.compile(section, reader),
                "option" => settings.choose(section, reader),
                "default" => settings.inherit(section, MAIN, reader),
                _ => {}
            }
        }
        settings
    }

    fn compile(&mut self, element: Element<'a, '_>, reader: &mut Reader) {
        match element.get("angle") {
            Some("radian") => self.angle = 1.0,
            Some("degree") => self.angle = 1_f64.to_radians(),
            Some(other) => choice(element, "angle", other, &["degree", "radian"], reader),
            None => {}
        }
        if let Some((text, at)) = element.attribute("eulerseq") {
            let letters: Vec<char> = text.chars().collect();
            match <[char; 3]>::try_from(letters) {
                Ok(sequence) if sequence.iter().all(|axis| "xyzXYZ".contains(*axis)) => self.sequence = sequence,
                _ => reader.report(
                    at,
                    "unknown_choice",
                    format!("`{}` are no axes", abridged(text)),
                    "three of x, y, z, X, Y, Z",
                ),
            }
        }
        self.weighs_by_shapes = match element.get("inertiafromgeom") {
            Some("true") => true,
            Some("false" | "auto") | None => false,
            Some(other) => {
                choice(element, "inertiafromgeom", other, &["true", "false", "auto"], reader);
                false
            }
        };
        if element.get("autolimits") == Some("false") {
            self.limits_itself = false;
        }
        if element.get("coordinate") == Some("global") {
            reader.refuse(element, "coordinates in the world, which MuJoCo reads no more", "`coordinate=\"local\"`");
        }
        self.total_mass = reader.number(element, "settotalmass").filter(|mass| *mass > 0.0).or(self.total_mass);
        for (k, name) in ["boundmass", "boundinertia"].into_iter().enumerate() {
            self.least[k] = reader.number(element, name).unwrap_or(self.least[k]);
        }
        if element.get("balanceinertia") == Some("true") {
            reader.leave_out(element, "`balanceinertia` is left out: what no body can have is refused");
        }
    }

    fn choose(&mut self, element: Element<'a, '_>, reader: &mut Reader) {
        if let Some(gravity) = reader.numbers::<3>(element, "gravity") {
            self.gravity = gravity.into();
        }
        for name in ["density", "viscosity"] {
            if reader.number(element, name).is_some_and(|value| value != 0.0) {
                reader.refuse(element, "forces of a fluid", format!("no `{name}`, and `forces` of the scene"));
            }
        }
        if let Some(flag) = element.child("flag") {
            if flag.get("gravity") == Some("disable") {
                self.gravity = Vector3::zeros();
            }
            self.has_contacts &= flag.get("contact") != Some("disable");
        }
    }

    /// Reads a class of default attributes and the classes nested in it; each class begins with the defaults of the
    /// enclosing class.
    fn inherit(&mut self, element: Element<'a, '_>, around: &'a str, reader: &mut Reader) {
        let mut waiting = vec![(element, around)];
        while let Some((element, around)) = waiting.pop() {
            let name = element.get("class").unwrap_or(around);
            let mut class = self.classes.get(name).or_else(|| self.classes.get(around)).cloned().unwrap_or_default();
            for child in element.children().filter(|child| child.tag() != "default") {
                let of_kind = class.entry(child.tag()).or_default();
                for attribute in child.node.attributes() {
                    of_kind.insert(attribute.name(), (attribute.value(), attribute.range_value().start));
                }
            }
            self.classes.insert(name, class);
            for child in element.children().filter(|child| child.tag() == "default") {
                if child.get("class").is_none() {
                    reader.report(
                        child.start(),
                        "missing_key",
                        "<default> within another has no `class`",
                        "class=\"..\"",
                    );
                }
                waiting.push((child, name));
            }
        }
    }

    /// Returns an element with the attributes that it inherits from its class, or else from the class `around` of the
    /// enclosing bodies.
    pub fn inheriting<'s, 'x>(
        &'s self,
        element: Element<'s, 'x>,
        around: Option<&str>,
        kind: &str,
        reader: &mut Reader,
    ) -> Element<'s, 'x> {
        let own = element.node.attribute("class");
        let name = own.or(around).unwrap_or(MAIN);
        let Some(class) = self.classes.get(name) else {
            let mut known: Vec<&str> = self.classes.keys().copied().collect();
            known.sort_unstable();
            let detail = format!("`{}` is no class", abridged(name));
            reader.report(element.start(), "unknown_name", detail, listed(known.iter().copied()));
            if let Some(error) = reader.errors.last_mut() {
                error.did_you_mean = nearest(name, known.iter().copied()).map(str::to_owned);
            }
            return element;
        };
        Element::inheriting(element.node, class.get(kind))
    }

    /// Returns the pose of an MJCF element in the frame of its parent.
    pub fn frame(&self, element: Element<'_, '_>, reader: &mut Reader) -> Isometry3<f64> {
        let at = reader.numbers::<3>(element, "pos").unwrap_or_default();
        Isometry3::from_parts(Vector3::from(at).into(), self.orientation(element, reader))
    }

    /// Returns the orientation of an element, given in any notation of MJCF.
    pub fn orientation(&self, element: Element<'_, '_>, reader: &mut Reader) -> UnitQuaternion<f64> {
        let none = UnitQuaternion::identity();
        let found = if let Some([w, x, y, z]) = reader.numbers::<4>(element, "quat") {
            UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.0)
        } else if let Some([x, y, z, angle]) = reader.numbers::<4>(element, "axisangle") {
            let axis = Unit::try_new(Vector3::new(x, y, z), 0.0);
            axis.map(|axis| UnitQuaternion::from_axis_angle(&axis, angle * self.angle))
        } else if let Some(angles) = reader.numbers::<3>(element, "euler") {
            Some(self.of_angles(angles))
        } else if let Some([a, b, c, d, e, f]) = reader.numbers::<6>(element, "xyaxes") {
            let x = Vector3::new(a, b, c).try_normalize(0.0);
            let y = x.and_then(|x| {
                let y = Vector3::new(d, e, f);
                (y - x * x.dot(&y)).try_normalize(0.0)
            });
            x.zip(y).map(|(x, y)| {
                let basis = Rotation3::from_basis_unchecked(&[x, y, x.cross(&y)]);
                UnitQuaternion::from_rotation_matrix(&basis)
            })
        } else if let Some(z) = reader.numbers::<3>(element, "zaxis") {
            along(&Vector3::from(z))
        } else {
            return none;
        };
        if found.is_none() {
            reader.report(
                element.start(),
                "zero_direction",
                "this orientation has no direction",
                "vectors other than zero",
            );
        }
        found.unwrap_or(none)
    }

    fn of_angles(&self, angles: [f64; 3]) -> UnitQuaternion<f64> {
        let mut turn = UnitQuaternion::identity();
        for (axis, angle) in self.sequence.iter().zip(angles) {
            let unit = match axis.to_ascii_lowercase() {
                'x' => Vector3::x_axis(),
                'y' => Vector3::y_axis(),
                _ => Vector3::z_axis(),
            };
            let next = UnitQuaternion::from_axis_angle(&unit, angle * self.angle);
            turn = if axis.is_ascii_lowercase() { turn * next } else { next * turn };
        }
        turn
    }
}

/// Returns the shortest rotation that takes the third axis to a given direction.
pub(super) fn along(direction: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let unit = direction.try_normalize(0.0)?;
    // For a direction opposite to the third axis, any half turn about a perpendicular axis will do.
    let across = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    Some(UnitQuaternion::rotation_between(&Vector3::z(), &unit).unwrap_or(across))
}

fn choice(element: Element<'_, '_>, name: &str, found: &str, known: &[&str], reader: &mut Reader) {
    let at = element.attribute(name).map_or(element.start(), |(_, at)| at);
    let detail = format!("`{}` is no choice of `{name}`", abridged(found));
    reader.report(at, "unknown_choice", detail, listed(known.iter().copied()));
}
