//! Rigid bodies in space: shapes, masses, initial state, contact laws, joints.
//!
//! ```text
//! M (v+ - v) = h f + J^T r,    u = J v,    r_k in the friction cone of contact k, by Coulomb's law;    q+ = q (+) h v+
//! ```
//!
//! The velocities are `v` before and `v+` after a step of size `h`; `M` is the mass matrix, `J` the Jacobian of the
//! contacts, `f` are forces, `r` contact impulses, `u` contact velocities and `q` positions. Joints are bilateral
//! constraints: `c(q) = 0` and `G v = 0`, with the Jacobian `G` of `c`, at the end of every step.

mod bodies;
mod bushings;
mod contacts;
mod forces;
mod inertia;
mod joints;
mod motors;
mod overlaps;
mod robot;
mod shapes;
mod springs;
mod vectors;

pub use bodies::{BodyMotion, RigidBody};
pub use bushings::Bushing;
pub use contacts::{BodyContacts, Material, MaterialPair};
pub use forces::{AxesOfForce, BodyForce};
pub use inertia::Inertia;
pub use joints::{AxialJoint, BodyJoint, FixedJoint, PointJoint};
pub use motors::{JointLimits, JointSpring, Motor, ServoMotor};
pub use robot::{NumberOrVector, PoseOfRobot, RobotDescription, StartOfRobot};
pub use shapes::{
    BoxShape, CapsuleShape, CompoundPart, CylinderShape, HalfSpaceShape, HullShape, MeshShape, RigidShape, SphereShape,
};
pub use springs::BodySpring;

use super::error::SpecificationError;
use super::expression::Expression;
use super::lowering::{Lowering, Named, Start};
use super::mechanical::Interpenetration;
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::tables::TableOfPoints;
use super::written::{Lowered, Written};
use models::rigid_bodies::{MultibodySystem, OF_BODY};
use motors::Functions;
use serde::Deserialize;
use std::collections::HashMap;
use std::sync::Arc;
use utoipa::ToSchema;
use vectors::Vector;

/// Largest number of rigid bodies of one problem.
pub(super) const MOST_BODIES: usize = 100_000;

/// Rigid bodies with contact, friction, impacts and joints. SI units; the z axis of a shape is its axis of symmetry.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RigidBodiesProblem {
    /// Constants by name; each may be an expression in the others, without circular references.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub parameters: Ordered<Expression>,
    /// Tables by name: functions of one argument, called as `load(t)`.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, TableOfPoints>)]
    pub tables: Ordered<TableOfPoints>,
    /// Expressions by name, in states, variables, parameters, `t` and each other, without circular references. Each can be
    /// reported as a column, and used by its name in other expressions.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub definitions: Ordered<Expression>,
    /// Integrals over time of expressions by name, from zero at the start: further columns.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub integrals: Ordered<Expression>,
    /// Gravitational acceleration in metres per second squared. Default `[0, 0, 0]`.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub gravity: Option<Vector>,
    /// Materials by name.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Material>)]
    pub materials: Ordered<Material>,
    /// A robot described in URDF or MJCF, whose bodies and joints come before those of `bodies` and `joints`.
    pub robot: Option<Box<RobotDescription>>,
    /// The bodies, at least one of them moving; at most 100,000.
    #[serde(default)]
    pub bodies: Vec<RigidBody>,
    /// Contact laws between bodies.
    #[serde(default)]
    pub contacts: BodyContacts,
    /// Joints between bodies, or to the world.
    #[serde(default)]
    pub joints: Vec<BodyJoint>,
    /// Springs and dampers between points of bodies.
    #[serde(default)]
    pub springs: Vec<BodySpring>,
    /// Soft mounts between bodies: springs and dampers along and about three axes.
    #[serde(default)]
    pub bushings: Vec<Bushing>,
    /// Forces and torques on bodies.
    #[serde(default)]
    pub forces: Vec<BodyForce>,
    /// What to do if bodies overlap at the start, or their velocities violate a joint. Default `refuse`.
    #[serde(default)]
    pub interpenetration: Interpenetration,
}

/// Measured time to check a pair of rigid bodies of a specification, in nanoseconds.
const A_PAIR_OF_BODIES: usize = 5_000;

impl Written for RigidBodiesProblem {
    fn key(&self) -> &'static str {
        "rigid_bodies"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, integrals, .. } = self;
        Named { parameters, tables, definitions, integrals }
    }

    fn unknowns(&self) -> usize {
        self.bodies.len()
    }

    fn time_to_check(&self) -> usize {
        let bodies = self.bodies.len();
        bodies.saturating_mul(bodies).saturating_mul(A_PAIR_OF_BODIES)
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::new(start, self.named(), place);
        let has_motions = self.bodies.iter().any(|body| body.motion.is_some());
        if !self.forces.is_empty() || has_motions || self.joints.iter().any(BodyJoint::has_motor) {
            let outputs = forces::names(&self.bodies);
            lowering.bind_outputs(&outputs.iter().map(String::as_str).collect::<Vec<_>>());
        }
        lowering.use_definitions(&self.definitions);
        let place_of_bodies = place.key("bodies");
        if self.bodies.len() > MOST_BODIES {
            let detail = format!("{} bodies", self.bodies.len());
            let error = SpecificationError::new(place_of_bodies.to_string(), "too_many_bodies", detail);
            lowering.errors.push(error.expected(format!("at most {MOST_BODIES} bodies")));
            return (lowering, None);
        }
        let gravity = self.gravity.as_ref().map(|g| vectors::lower(g, &place.key("gravity"), &mut lowering));
        let inputs = 1 + OF_BODY.len() * self.bodies.len();
        let laws = contacts::lower(&self.contacts, &self.materials, inputs, place, &mut lowering);
        let cone = self.contacts.cone(&place.key("contacts"), &mut lowering);
        let mut warnings = Vec::new();
        let mut names = HashMap::with_capacity(self.bodies.len());
        let mut bodies = Vec::with_capacity(self.bodies.len());
        for (k, body) in self.bodies.iter().enumerate() {
            let place = place_of_bodies.index(k);
            let name = body.name(k);
            lowering.keep_name(&name, &place.key("name"));
            names.insert(name.clone(), k);
            bodies.push(body.lower(name, &self.materials, &place, &mut warnings, &mut lowering));
        }
        if !self.bodies.iter().any(RigidBody::is_free) {
            let detail = "no body moves";
            let error = SpecificationError::new(place_of_bodies.to_string(), "nothing_moves", detail);
            lowering.errors.push(error.expected("at least one body that is not `\"fixed\": true` and has no `motion`"));
        }
        let Some(bodies) = bodies.into_iter().collect::<Option<Vec<_>>>().filter(|_| lowering.errors.is_empty()) else {
            return (lowering, None);
        };
        let mut functions = Functions::default();
        let known = self.bodies.iter().filter_map(|body| body.group.as_deref()).collect();
        let (groups, apart) = contacts::groups(&self.contacts, &known, place, &mut lowering);
        let mut bodies = bodies;
        for (k, (body, given)) in bodies.iter_mut().zip(&self.bodies).enumerate() {
            let place = place_of_bodies.index(k);
            let motion = given.motion.as_ref();
            if let Some(motion) = motion {
                motion.lower(given, body, &place, &mut functions, &mut lowering);
            }
            body.group = given.group.as_deref().and_then(|group| groups.get(group).copied());
        }
        let mut joints =
            joints::lower(&self.joints, &bodies, &names, &place.key("joints"), &mut functions, &mut lowering);
        joints.extend(springs::lower(&self.springs, &bodies, &names, &place.key("springs"), &mut lowering));
        joints.extend(bushings::lower(&self.bushings, &bodies, &names, &place.key("bushings"), &mut lowering));
        let actions = forces::lower(&self.forces, &bodies, &names, &place.key("forces"), &mut lowering);
        let signals = functions.signals(&mut lowering);
        let resolve = self.interpenetration == Interpenetration::Resolve;
        let scene = MultibodySystem {
            gravity: gravity.unwrap_or_default(),
            bodies,
            laws,
            cone,
            apart,
            joints,
            actions,
            signals,
            resolve,
            warnings,
        };
        if !resolve && lowering.errors.is_empty() {
            overlaps::refuse(&scene, &place_of_bodies, lowering.control, &mut lowering.errors);
            let t = lowering.start;
            joints::refuse_torn(&self.joints, &scene, t, &place.key("joints"), &mut lowering.errors);
        }
        (lowering, Some(Arc::new(scene)))
    }
}
