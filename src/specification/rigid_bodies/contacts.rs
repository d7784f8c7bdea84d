//! Contact laws between bodies: friction and restitution, by pairs of materials.

use super::forces::AxesOfForce;
use super::vectors::{self, Vector};
use super::{Expression, Ordered};
use crate::error::SpecificationError;
use crate::lowering::Lowering;
use crate::mechanical::ConeName;
use crate::pointer::Pointer;
use crate::range::in_range;
use crate::wording::{abridged, listed};
use contact::law::Cone;
use expression::{Node, Tape, nearest};
use models::rigid_bodies::{AxesOfGrain, Coefficient, Grain, Law, Laws, OF_BODY, Patch};
use nalgebra::Vector3;
use serde::Deserialize;
use std::collections::{HashMap, HashSet};
use utoipa::ToSchema;

/// The contact laws between bodies.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyContacts {
    /// The default coefficient of friction, not negative, for bodies without a material or whose material has none. It may
    /// vary: an expression in `t`, the place of the contact `contact_x`, `contact_y`, `contact_z` in world coordinates, in
    /// metres, and `slip_speed`, the speed of the slip, as in `0.2 + 0.1*exp(-slip_speed/0.05)`. Default 0.
    pub friction: Option<Expression>,
    /// The coefficient of friction for motion across the direction `along`, divided by `friction`, which then is the
    /// coefficient for motion along it; the set of friction forces is an ellipse. Positive; for all pairs of
    /// materials without a ratio of their own. Default 1, a disk.
    pub ratio: Option<Expression>,
    /// The direction of motion to which `friction` applies if there is a `ratio`, projected onto the contact plane.
    /// Default `[1, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub along: Option<Vector>,
    /// The axes in which `along` is given: those of the world, or of the body in contact that comes first in the
    /// scene. Default `world`.
    pub axes: Option<AxesOfForce>,
    /// The radius in metres of the patch on which bodies touch at a point: a disc with uniform pressure, on which
    /// sliding and drilling about the normal share friction (Contensou's law). For all pairs of materials without a
    /// patch of their own. Default 0, a point that resists no drilling.
    pub patch: Option<Expression>,
    /// The coefficient of rolling friction in metres: the largest torque against rolling, divided by the normal
    /// force. For all pairs of materials without such a coefficient of their own. Default 0.
    pub rolling: Option<Expression>,
    /// The default coefficient of restitution, from 0 to 1, for bodies without a material or whose material has none.
    /// Default 0.
    pub restitution: Option<Expression>,
    /// The shape of the set of friction forces, a disk or a polygon. Default `quadratic`.
    #[serde(default)]
    pub cone: ConeName,
    /// Number of corners of a polyhedral cone, from 4 to 64, the first along the x axis projected onto the contact
    /// plane. Default 8.
    #[schema(minimum = 4, maximum = 64)]
    pub facets: Option<u64>,
    /// Pairs of materials with coefficients of their own. For other pairs, the coefficient of friction is the
    /// geometric mean of those of the two materials, and the coefficient of restitution is the smaller one.
    #[serde(default)]
    pub pairs: Vec<MaterialPair>,
    /// Pairs of groups, possibly equal, whose bodies have no contact with each other. Default: none.
    #[serde(default)]
    pub exclude: Vec<[String; 2]>,
}

/// Coefficients of friction and restitution of a material.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// The coefficient of friction of the material, not negative; it may vary as `friction` of `contacts` does, which
    /// is the default.
    pub friction: Option<Expression>,
    /// The coefficient of restitution of the material, from 0 to 1. Default: `restitution` of `contacts`.
    pub restitution: Option<Expression>,
}

/// Coefficients of a pair of materials, possibly equal.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialPair {
    /// The names of the two materials.
    pub materials: [String; 2],
    /// The coefficient of friction of the pair, not negative; it may vary as `friction` of `contacts` does.
    pub friction: Option<Expression>,
    /// The coefficient of restitution of the pair, from 0 to 1.
    pub restitution: Option<Expression>,
    /// The coefficient of friction for motion across the direction `along`, divided by `friction`, which then is the
    /// coefficient for motion along it. Positive. Default: the `ratio` of `contacts`.
    pub ratio: Option<Expression>,
    /// The direction of motion to which `friction` applies if there is a `ratio`, projected onto the contact plane.
    /// Default `[1, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub along: Option<Vector>,
    /// The axes in which `along` is given: those of the world, or of the body with the first of the two materials.
    /// Default `world`.
    pub axes: Option<AxesOfForce>,
    /// The radius of the contact patch in metres, as `patch` of `contacts`, which is the default.
    pub patch: Option<Expression>,
    /// The coefficient of rolling friction of the pair in metres. Default: `rolling` of `contacts`.
    pub rolling: Option<Expression>,
}

impl BodyContacts {
    /// Returns the set of friction forces of a contact, a quadratic or a polyhedral cone; reports a wrong number of
    /// corners.
    pub(super) fn cone(&self, place: &Pointer<'_>, lowering: &mut Lowering) -> Cone {
        let facets = self.facets.unwrap_or(FACETS);
        if self.facets.is_some() && (self.cone == ConeName::Quadratic || !(4..=64).contains(&facets)) {
            let detail = format!("{facets} corners for a {:?} cone", self.cone).to_lowercase();
            let error = SpecificationError::new(place.key("facets").to_string(), "out_of_range", detail);
            lowering.errors.push(error.expected("4 to 64 corners, for a polyhedral cone"));
        }
        match self.cone {
            ConeName::Quadratic => Cone::Quadratic,
            ConeName::Polyhedral => Cone::Polyhedral(facets as usize),
        }
    }
}

/// Returns the indices of the contact groups of bodies by name, and the pairs of groups without contact.
pub(super) fn groups<'a>(
    contacts: &'a BodyContacts,
    known: &HashSet<&str>,
    problem: &Pointer<'_>,
    lowering: &mut Lowering,
) -> (HashMap<&'a str, u32>, HashSet<(u32, u32)>) {
    let place = problem.key("contacts");
    let place = place.key("exclude");
    let (mut groups, mut apart) = (HashMap::new(), HashSet::new());
    for (k, pair) in contacts.exclude.iter().enumerate() {
        let mut of = [0; 2];
        for (i, name) in pair.iter().enumerate() {
            let next = groups.len() as u32;
            of[i] = *groups.entry(name.as_str()).or_insert(next);
            if !known.contains(name.as_str()) {
                let detail = format!("no body is of the group `{}`", abridged(name));
                let error = SpecificationError::new(place.index(k).index(i).to_string(), "unknown_name", detail);
                let mut all: Vec<&str> = known.iter().copied().collect();
                all.sort_unstable();
                let nearest = nearest(name, all.iter().copied());
                lowering.errors.push(error.expected(listed(all.iter().copied())).did_you_mean(nearest));
            }
        }
        apart.insert((of[0].min(of[1]), of[0].max(of[1])));
    }
    (groups, apart)
}

/// Default number of corners of a polyhedral friction cone.
const FACETS: u64 = 8;

/// Coefficient of friction between two materials: a number, or the geometric mean of two varying expressions, which
/// may be equal.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Friction {
    Constant(f64),
    Varying(Node, Node),
}

/// Friction, restitution and contact patch of a material, or of a pair of materials.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Coefficients {
    friction: Friction,
    restitution: f64,
    patch: Patch,
}

/// Names of the inputs that a coefficient of friction may depend on, after the time `t`.
const NAMES: [&str; 4] = ["contact_x", "contact_y", "contact_z", "slip_speed"];

/// Quantities that a coefficient of friction may depend on, for error messages.
const DEPENDS: &str = "an expression in `t`, `contact_x`, `contact_y`, `contact_z`, `slip_speed` and parameters";

/// Reads the coefficients of contact laws of materials, and combines those of two materials.
struct Reading<'l, 'c> {
    lowering: &'l mut Lowering<'c>,
    /// Index in the expression graph of the first input of [`NAMES`].
    first: usize,
    coefficients: Vec<Coefficient>,
    known: HashMap<(Node, Node), u32>,
    grains: Vec<Grain>,
    patches: Vec<Patch>,
}

impl Reading<'_, '_> {
    fn friction(&mut self, value: &Expression, place: &Pointer<'_>) -> Option<Friction> {
        let range: (fn(f64) -> bool, &str) = (|mu| mu >= 0.0, "not below 0");
        if let Expression::Text(_) = value {
            let names: Vec<(&str, Node)> =
                NAMES.iter().enumerate().map(|(i, name)| (*name, self.lowering.graph.input(self.first + i))).collect();
            let node = self.lowering.node_with(&names, value, place)?;
            let inputs = self.lowering.graph.inputs(node);
            if let Some(&input) = inputs.iter().find(|&&input| input > 0 && input < self.first) {
                let state = OF_BODY[(input - 1) % OF_BODY.len()];
                let detail = format!("a coefficient of friction that depends on the `{state}` of a body");
                let error = SpecificationError::new(place.to_string(), "depends_on_body", detail);
                self.lowering.errors.push(error.expected(DEPENDS));
                return None;
            }
            if !inputs.is_empty() {
                return Some(Friction::Varying(node, node));
            }
        }
        in_range(value, "friction", range, place, self.lowering).map(Friction::Constant)
    }

    fn coefficients(
        &mut self,
        friction: Option<&Expression>,
        restitution: Option<&Expression>,
        default: Coefficients,
        place: &Pointer<'_>,
    ) -> Coefficients {
        let range: (fn(f64) -> bool, &str) = (|e| (0.0..=1.0).contains(&e), "from 0 to 1");
        let friction = friction.and_then(|value| self.friction(value, &place.key("friction")));
        let restitution = restitution
            .and_then(|value| in_range(value, "restitution", range, &place.key("restitution"), self.lowering));
        Coefficients {
            friction: friction.unwrap_or(default.friction),
            restitution: restitution.unwrap_or(default.restitution),
            patch: default.patch,
        }
    }

    /// Returns the contact patch with the given radius and coefficient of rolling friction, each taken from `default`
    /// if missing.
    fn patch(&mut self, given: [Option<&Expression>; 2], default: Patch, cone: ConeName, place: &Pointer<'_>) -> Patch {
        let mut read = |value: Option<&Expression>, key: &str, default: f64| {
            let Some(value) = value else { return default };
            let range: (fn(f64) -> bool, &str) = (|length| length >= 0.0, "not below 0, in metres");
            let value = in_range(value, key, range, &place.key(key), self.lowering).unwrap_or(0.0);
            if value > 0.0 && cone == ConeName::Polyhedral {
                let detail = format!("a `{key}` beside a polyhedral cone");
                let error = SpecificationError::new(place.key(key).to_string(), "conflict", detail);
                self.lowering.errors.push(error.expected(format!("`\"cone\": \"quadratic\"`, or no `{key}`")));
            }
            value
        };
        Patch { radius: read(given[0], "patch", default.radius), rolling: read(given[1], "rolling", default.rolling) }
    }

    /// Returns the coefficient of friction between two materials, the geometric mean of their coefficients.
    fn mean(&mut self, a: Friction, b: Friction) -> Friction {
        let mut node = |mu| self.lowering.graph.constant(mu);
        match (a, b) {
            _ if a == b => a,
            (Friction::Constant(a), Friction::Constant(b)) => Friction::Constant((a * b).sqrt()),
            (Friction::Constant(0.0), _) | (_, Friction::Constant(0.0)) => Friction::Constant(0.0),
            (Friction::Constant(mu), Friction::Varying(of, _)) | (Friction::Varying(of, _), Friction::Constant(mu)) => {
                Friction::Varying(of, node(mu))
            }
            (Friction::Varying(a, _), Friction::Varying(b, _)) => Friction::Varying(a, b),
        }
    }

    fn law(&mut self, Coefficients { friction, restitution, patch }: Coefficients, grain: Option<u32>) -> Law {
        let place = (patch != Patch::default()).then(|| {
            let known = self.patches.iter().position(|known| *known == patch);
            known.unwrap_or_else(|| {
                self.patches.push(patch);
                self.patches.len() - 1
            }) as u32
        });
        let law = Law { restitution, grain, patch: place, ..Law::default() };
        match friction {
            Friction::Constant(friction) => Law { friction, ..law },
            Friction::Varying(a, b) => Law { varying: Some(self.coefficient(a, b)), ..law },
        }
    }

    /// Returns the index of a varying coefficient of friction, the geometric mean of `a` and `b`, or `a` if both are
    /// equal. Each pair of expressions is compiled once.
    fn coefficient(&mut self, a: Node, b: Node) -> u32 {
        if let Some(&known) = self.known.get(&(a, b)) {
            return known;
        }
        let first = self.first;
        let local = |input: usize| if input == 0 { 0 } else { 1 + input - first };
        let nodes = if a == b { vec![a] } else { vec![a, b] };
        let (graph, nodes) = self.lowering.graph.below_with(&nodes, local);
        let index = self.coefficients.len() as u32;
        self.coefficients.push(Coefficient { program: Tape::compile(&graph, &nodes), is_mean: a != b });
        self.known.insert((a, b), index);
        index
    }

    /// Returns the index of the directions of anisotropic friction; `None` without a ratio. `first` are the axes that
    /// the choice `body` stands for.
    fn grain(
        &mut self,
        given: &Directions<'_>,
        first: AxesOfGrain,
        cone: ConeName,
        place: &Pointer<'_>,
    ) -> Option<u32> {
        let Some(ratio) = given.ratio else {
            for (key, is_given) in [("along", given.along.is_some()), ("axes", given.axes.is_some())] {
                if is_given {
                    let detail = format!("`{key}` without a `ratio`: friction is the same in all directions");
                    let error = SpecificationError::new(place.key(key).to_string(), "conflict", detail);
                    self.lowering.errors.push(error.expected("a `ratio` beside it, or to be left out"));
                }
            }
            return None;
        };
        if cone == ConeName::Polyhedral {
            let detail = "a ratio beside a polyhedral cone";
            let error = SpecificationError::new(place.key("ratio").to_string(), "conflict", detail);
            self.lowering.errors.push(error.expected("`\"cone\": \"quadratic\"`, or no `ratio`"));
        }
        let range: (fn(f64) -> bool, &str) = (|ratio| ratio > 0.0, "above 0");
        let ratio = in_range(ratio, "ratio", range, &place.key("ratio"), self.lowering)?;
        let along = given
            .along
            .map_or_else(Vector3::x_axis, |along| vectors::direction(along, &place.key("along"), self.lowering));
        let axes = if given.axes == Some(AxesOfForce::Body) { first } else { AxesOfGrain::World };
        self.grains.push(Grain { along: along.into_inner(), axes, ratio });
        Some(self.grains.len() as u32 - 1)
    }

    /// Reports anisotropic friction on a patch with a radius as an error at `key`: the friction law of such a patch
    /// is isotropic.
    fn refuse_grain_on(&mut self, patch: Patch, grain: Option<u32>, key: &str, place: &Pointer<'_>) {
        let directed = grain.is_some_and(|grain| self.grains[grain as usize].ratio != 1.0);
        if patch.radius > 0.0 && directed {
            let detail = "a `ratio` of friction on a patch";
            let error = SpecificationError::new(place.key(key).to_string(), "conflict", detail);
            self.lowering.errors.push(error.expected("a `ratio`, or a `patch` with a radius above 0"));
        }
    }
}

/// Ratio, direction and axes of anisotropic friction, as the user gives them.
struct Directions<'a> {
    ratio: Option<&'a Expression>,
    along: Option<&'a Vector>,
    axes: Option<AxesOfForce>,
}

/// Returns the contact law of every pair of materials; the last material is that of bodies without one. The graph
/// inputs on which a coefficient of friction may depend, besides `t`, have the indices from `inputs` on.
pub(super) fn lower(
    contacts: &BodyContacts,
    materials: &Ordered<Material>,
    inputs: usize,
    problem: &Pointer<'_>,
    lowering: &mut Lowering<'_>,
) -> Laws {
    let place = problem.key("contacts");
    let mut reading = Reading {
        lowering,
        first: inputs,
        coefficients: Vec::new(),
        known: HashMap::new(),
        grains: Vec::new(),
        patches: Vec::new(),
    };
    let given = (contacts.friction.as_ref(), contacts.restitution.as_ref());
    let none = Coefficients { friction: Friction::Constant(0.0), restitution: 0.0, patch: Patch::default() };
    let mut default = reading.coefficients(given.0, given.1, none, &place);
    let directions = Directions { ratio: contacts.ratio.as_ref(), along: contacts.along.as_ref(), axes: contacts.axes };
    let grain = reading.grain(&directions, AxesOfGrain::First, contacts.cone, &place);
    let lengths = [contacts.patch.as_ref(), contacts.rolling.as_ref()];
    default.patch = reading.patch(lengths, Patch::default(), contacts.cone, &place);
    reading.refuse_grain_on(default.patch, grain, "patch", &place);
    let place_of_materials = problem.key("materials");
    let mut single: Vec<Coefficients> = materials
        .iter()
        .map(|(name, material)| {
            let given = (material.friction.as_ref(), material.restitution.as_ref());
            reading.coefficients(given.0, given.1, default, &place_of_materials.key(name))
        })
        .collect();
    single.push(default);
    let n = single.len();
    // Friction is the geometric mean, so that contacts with a frictionless material are frictionless; restitution is
    // the smaller coefficient, because the softer material deforms.
    let mut of_pairs = Vec::with_capacity(n * n);
    for a in &single {
        for b in &single {
            let friction = reading.mean(a.friction, b.friction);
            of_pairs.push((Coefficients { friction, restitution: a.restitution.min(b.restitution), ..default }, grain));
        }
    }
    for (k, pair) in contacts.pairs.iter().enumerate() {
        let place = place.key("pairs");
        let place = place.index(k);
        let mut find = |i: usize| {
            let name = &pair.materials[i];
            let found = materials.names().position(|known| known == name);
            if found.is_none() {
                let detail = format!("`{}` is not a material", abridged(name));
                let error =
                    SpecificationError::new(place.key("materials").index(i).to_string(), "unknown_name", detail);
                let nearest = nearest(name, materials.names());
                let expected = listed(materials.names());
                reading.lowering.errors.push(error.expected(expected).did_you_mean(nearest));
            }
            found
        };
        let (Some(a), Some(b)) = (find(0), find(1)) else { continue };
        let given = (pair.friction.as_ref(), pair.restitution.as_ref());
        let mut coefficients = reading.coefficients(given.0, given.1, of_pairs[a * n + b].0, &place);
        let lengths = [pair.patch.as_ref(), pair.rolling.as_ref()];
        coefficients.patch = reading.patch(lengths, coefficients.patch, contacts.cone, &place);
        let directions = Directions { ratio: pair.ratio.as_ref(), along: pair.along.as_ref(), axes: pair.axes };
        let own = reading.grain(&directions, AxesOfGrain::Material(a), contacts.cone, &place);
        let law = (coefficients, own.or(of_pairs[a * n + b].1));
        // A patch and directions that a pair inherits from `contacts` have been checked with `contacts`.
        if pair.patch.is_some() || own.is_some() {
            let key = if pair.patch.is_some() { "patch" } else { "ratio" };
            reading.refuse_grain_on(coefficients.patch, law.1, key, &place);
        }
        (of_pairs[a * n + b], of_pairs[b * n + a]) = (law, law);
    }
    let laws = of_pairs.into_iter().map(|(coefficients, grain)| reading.law(coefficients, grain)).collect();
    let Reading { coefficients, grains, patches, .. } = reading;
    let mut laws = Laws::new(n, laws);
    (laws.coefficients, laws.grains, laws.patches) = (coefficients, grains, patches);
    laws
}
