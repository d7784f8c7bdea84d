//! Shapes of MJCF, with their masses and inertias.

use super::settings::{Settings, along};
use crate::robot::inertia::Inertial;
use crate::robot::scene::Shape;
use crate::robot::xml::{Element, Reader};
use crate::wording::{abridged, listed};
use nalgebra::{Isometry3, Matrix3, Vector3};

/// Default density of an MJCF shape, in kilograms per cubic metre.
const DENSITY: f64 = 1000.0;
/// Default coefficient of friction of an MJCF shape.
const FRICTION: f64 = 1.0;
/// Kinds of MJCF shapes that are described by lengths alone.
const KINDS: [&str; 6] = ["sphere", "capsule", "cylinder", "box", "ellipsoid", "plane"];

/// A shape of an MJCF body.
pub(super) struct Geometry {
    pub shape: Shape,
    /// Pose of the shape in the frame of its body.
    pub at: Isometry3<f64>,
    pub friction: f64,
    pub masks: [u32; 2],
    /// Mass and inertia of the shape; `None` for a plane, which has no volume.
    pub inertial: Option<Inertial>,
}

impl Geometry {
    /// Whether the collision masks let the shape touch other shapes.
    pub fn touches(&self) -> bool {
        self.masks != [0, 0]
    }
}

/// Reads an MJCF shape; `weighs` is whether the mass of its body follows from the shapes of the body.
pub(super) fn read(
    element: Element<'_, '_>,
    settings: &Settings<'_>,
    weighs: bool,
    reader: &mut Reader,
) -> Option<Geometry> {
    let masks = ["contype", "conaffinity"].map(|name| mask(element, name, reader));
    let masks = if settings.has_contacts { masks } else { [0, 0] };
    let friction = reader.list(element, "friction").and_then(|friction| friction.first().copied()).unwrap_or(FRICTION);
    let mass = reader.number(element, "mass");
    let density = reader.number(element, "density").unwrap_or(DENSITY);
    let kind = element.get("type").unwrap_or(if element.get("mesh").is_some() { "mesh" } else { "sphere" });
    if !KINDS.contains(&kind) {
        let is_seen_alone = masks == [0, 0] && (!weighs || mass == Some(0.0) || (mass.is_none() && density == 0.0));
        if is_seen_alone {
            return None;
        }
        let detail = match kind {
            "mesh" => {
                let name = abridged(element.get("mesh").unwrap_or("")).to_string();
                format!("the shape `{name}` is a mesh in another file, and no part of the specification")
            }
            "hfield" | "sdf" => format!("a shape of the kind `{kind}`"),
            _ => format!("`{}` is no kind of shape", abridged(kind)),
        };
        let expected = listed(KINDS);
        reader.refuse(
            element,
            detail,
            format!("{expected}; or contype=\"0\" conaffinity=\"0\" and <inertial> of its body"),
        );
        return None;
    }
    let (shape, at) = shape(element, kind, settings, reader)?;
    if let (Shape::Ellipsoid { .. }, true) = (shape, masks != [0, 0]) {
        reader.refuse(
            element,
            "an ellipsoid that touches others",
            "a capsule or a sphere, or contype=\"0\" conaffinity=\"0\"",
        );
        return None;
    }
    if friction < 0.0 {
        reader.report(element.start(), "out_of_range", format!("the friction is {friction}"), "not below 0");
        return None;
    }
    let inertial = shape.solid().map(|(volume, moments)| {
        let mass = mass.unwrap_or(density * volume);
        Inertial { mass, centre: Vector3::zeros(), inertia: Matrix3::from_diagonal(&(moments * mass)) }.placed(&at)
    });
    if inertial.is_some_and(|inertial| inertial.mass < 0.0) {
        reader.report(element.start(), "out_of_range", "the shape weighs less than nothing", "a mass not below 0");
        return None;
    }
    Some(Geometry { shape, at, friction, masks, inertial })
}

fn mask(element: Element<'_, '_>, name: &str, reader: &mut Reader) -> u32 {
    let Some(value) = reader.number(element, name) else { return 1 };
    let is_whole = value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value);
    if !is_whole {
        let at = element.attribute(name).map_or(element.start(), |(_, at)| at);
        reader.report(at, "out_of_range", format!("`{name}` is {value}"), "a whole number of 32 bits");
    }
    value as u32
}

/// Reads an MJCF shape with its pose: from the attribute `size`, and for long shapes from `fromto`.
fn shape(
    element: Element<'_, '_>,
    kind: &str,
    settings: &Settings<'_>,
    reader: &mut Reader,
) -> Option<(Shape, Isometry3<f64>)> {
    let mut at = settings.frame(element, reader);
    if kind == "plane" {
        return Some((Shape::HalfSpace, at));
    }
    let size = reader.list(element, "size").unwrap_or_default();
    let mut half = None;
    if let Some([a, b, c, d, e, f]) = reader.numbers::<6>(element, "fromto") {
        let (from, to) = (Vector3::new(a, b, c), Vector3::new(d, e, f));
        // The third axis points from the end to the beginning of `fromto`, as in MuJoCo.
        let Some(turn) = along(&(from - to)) else {
            reader.report(element.start(), "zero_direction", "both ends of `fromto` are the same", "two points");
            return None;
        };
        if kind == "sphere" {
            reader.report(element.start(), "conflict", "a sphere has no `fromto`", "`pos`, or a capsule");
            return None;
        }
        at = Isometry3::from_parts((0.5 * (from + to)).into(), turn);
        half = Some(0.5 * (to - from).norm());
    }
    let needed = match (kind, half) {
        ("sphere", _) | ("capsule" | "cylinder", Some(_)) => 1,
        ("capsule" | "cylinder", None) => 2,
        // A box or an ellipsoid with `fromto`: `size` is the half width, `fromto` gives the length.
        (_, Some(_)) => 1,
        (_, None) => 3,
    };
    if size.len() < needed {
        let detail = format!("a {kind} has {} sizes", size.len());
        reader.report(element.start(), "wrong_count", detail, format!("`size` with {needed} numbers"));
        return None;
    }
    if let Some(wrong) = size.iter().take(needed).find(|size| **size <= 0.0) {
        reader.report(element.start(), "out_of_range", format!("a size is {wrong}"), "sizes above 0");
        return None;
    }
    let shape = match (kind, half) {
        ("sphere", _) => Shape::Sphere { radius: size[0] },
        ("capsule", _) => Shape::Capsule { radius: size[0], length: 2.0 * half.unwrap_or_else(|| size[1]) },
        ("cylinder", _) => Shape::Cylinder { radius: size[0], length: 2.0 * half.unwrap_or_else(|| size[1]) },
        (_, half) => {
            let halves = match half {
                Some(half) => Vector3::new(size[0], size.get(1).copied().unwrap_or(size[0]), half),
                None => Vector3::new(size[0], size[1], size[2]),
            };
            if kind == "box" { Shape::Box { size: 2.0 * halves } } else { Shape::Ellipsoid { radii: halves } }
        }
    };
    Some((shape, at))
}
