//! Contact laws between bodies: friction and restitution, by pairs of materials.

use super::{Expression, Ordered};
use crate::error::SpecificationError;
use crate::lowering::Lowering;
use crate::mechanical::ConeName;
use crate::pointer::Pointer;
use crate::range::in_range;
use crate::wording::{abridged, listed};
use contact::law::Cone;
use expression::nearest;
use models::rigid_bodies::{Law, Laws};
use serde::Deserialize;
use std::collections::{HashMap, HashSet};
use utoipa::ToSchema;

/// The contact laws between bodies.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyContacts {
    /// The default coefficient of friction, for bodies without a material or whose material has none. Default 0.
    pub friction: Option<Expression>,
    /// The default coefficient of restitution, from 0 to 1, for bodies without a material or whose material has none.
    /// Default 0.
    pub restitution: Option<Expression>,
    /// The set of friction forces. Default `quadratic`.
    #[serde(default)]
    pub cone: ConeName,
    /// Number of corners of a polyhedral cone, from 4 to 64, the first along the x axis projected onto the contact
    /// plane. Default 8.
    #[schema(minimum = 4, maximum = 64)]
    pub facets: Option<u64>,
    /// Pairs of materials with coefficients of their own. For other pairs, the friction is the geometric mean of the
    /// two, and the restitution the smaller one.
    #[serde(default)]
    pub pairs: Vec<MaterialPair>,
    /// Pairs of groups, possibly equal, whose bodies have no contact with each other. Default: none.
    #[serde(default)]
    pub exclude: Vec<[String; 2]>,
}

/// A material.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// The coefficient of friction, not negative. Default: that of `contacts`.
    pub friction: Option<Expression>,
    /// The coefficient of restitution, from 0 to 1. Default: that of `contacts`.
    pub restitution: Option<Expression>,
}

/// Coefficients of a pair of materials, possibly equal.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialPair {
    /// The names of the two materials.
    pub materials: [String; 2],
    /// The coefficient of friction, not negative.
    pub friction: Option<Expression>,
    /// The coefficient of restitution, from 0 to 1.
    pub restitution: Option<Expression>,
}

impl BodyContacts {
    /// Reads the set of friction forces.
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

/// The indices of the groups by name, and the pairs of groups without contact.
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

/// Default number of corners of a polyhedral cone.
const FACETS: u64 = 8;

fn coefficients(
    friction: Option<&Expression>,
    restitution: Option<&Expression>,
    default: Law,
    place: &Pointer<'_>,
    lowering: &mut Lowering,
) -> Law {
    let mut read = |value: Option<&Expression>, what: &str, range: (fn(f64) -> bool, &str), default: f64| {
        value.and_then(|value| in_range(value, what, range, &place.key(what), lowering)).unwrap_or(default)
    };
    let friction = read(friction, "friction", (|mu| mu >= 0.0, "not below 0"), default.friction);
    let restitution =
        read(restitution, "restitution", (|e| (0.0..=1.0).contains(&e), "from 0 to 1"), default.restitution);
    Law { friction, restitution }
}

/// The contact law of every pair of materials; the last material is that of bodies without one.
pub(super) fn lower(
    contacts: &BodyContacts,
    materials: &Ordered<Material>,
    problem: &Pointer<'_>,
    lowering: &mut Lowering,
) -> Laws {
    let place = problem.key("contacts");
    let given = (contacts.friction.as_ref(), contacts.restitution.as_ref());
    let default = coefficients(given.0, given.1, Law::default(), &place, lowering);
    let place_of_materials = problem.key("materials");
    let mut single: Vec<Law> = materials
        .iter()
        .map(|(name, material)| {
            let given = (material.friction.as_ref(), material.restitution.as_ref());
            coefficients(given.0, given.1, default, &place_of_materials.key(name), lowering)
        })
        .collect();
    single.push(default);
    let mut laws = Laws::of_materials(&single);
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
                lowering.errors.push(error.expected(listed(materials.names())).did_you_mean(nearest));
            }
            found
        };
        let (Some(a), Some(b)) = (find(0), find(1)) else { continue };
        let given = (pair.friction.as_ref(), pair.restitution.as_ref());
        laws.set(a, b, coefficients(given.0, given.1, laws.of(a, b), &place, lowering));
    }
    laws
}
