//! The specification language: one JSON object, checked as a whole.
//!
//! A document is read ([`Specification::from_json`]; [`Draft`] for callers that need an estimate of the time first) in
//! three steps, and the errors of all three are reported together: JSON to a tree that keeps the order of members; the
//! tree to the types of this module, which are also the source of the JSON Schema ([`json_schema`]); the types to a
//! [`Model`], where names, shapes, domains and the affine form of the rates are checked. Choices are externally tagged,
//! `{"box": {..}}`, so that every value has an exact JSON pointer.

mod as_set;
mod binding;
mod catalogue;
mod checked;
mod choices;
mod circuit;
mod closures;
mod continuation;
mod convolution;
mod deserializer;
mod digest;
mod directions;
mod document;
mod draft;
mod dvi;
mod elastic;
mod elements;
mod error;
mod examples;
mod expression;
mod filippov;
mod fit;
mod foreign;
mod formats;
mod json;
mod kinks;
mod label;
mod lcs;
mod lowering;
mod mass;
mod matrix;
mod mechanical;
mod memory;
mod method;
mod mismatch;
mod model;
mod observables;
mod obstacle;
mod ordered;
mod output;
mod parameters;
mod plan;
mod pointer;
mod range;
mod reading;
mod repairs;
mod rigid_bodies;
mod robot;
mod schema;
mod search;
mod sensitivities;
mod set;
mod shapes;
mod spice;
mod stages;
mod start;
mod static_vi;
mod study;
mod summary;
mod sweep;
mod syntax;
mod tables;
mod times;
mod tolerance;
mod units;
mod varied;
mod vectors;
mod view;
mod wording;
mod written;

pub use crate::expression::Expression;
pub use catalogue::{Catalogue, Choice, Coefficients, Limit, catalogue};
pub use checked::Specification;
pub use circuit::{
    Capacitor, CircuitProblem, Comparator, Component, CurrentSource, Diode, Inductor, OpAmp, Resistor, Switch,
    Transformer, VoltageSource, Zener,
};
pub use continuation::{NotContinuable, continued};
pub use convolution::{ConvolutionProblem, ConvolutionVariable, FractionalKernel, KernelOfTime};
pub use digest::hexadecimal;
pub use document::{Document, Limits, Problem, Time};
pub use draft::Draft;
pub use dvi::{DviProblem, State, Variable};
pub use elastic::{
    BarBody, BoxBody, ElasticBody, ElasticContact, ElasticProblem, ElasticStart, PlaneLaw, RectangleBody, StringBody,
};
pub use elements::{Elements, ElementsOf};
pub use error::SpecificationError;
pub use examples::{EXAMPLES, Example};
pub use filippov::{FilippovProblem, FilippovRegion, FilippovState};
pub use fit::{FitData, FitParameter, FitRequest, LossName, Spread, SpreadOfState};
pub use formats::document_of;
pub use lcs::LcsProblem;
pub use matrix::{Matrix, SparseMatrix};
pub use mechanical::{ConeName, Contact, Coordinate, Friction, Interpenetration, Joint, MechanicalProblem};
pub use method::{ImpactLawName, Impacts, Method, MethodName, Switches, ViSolverName};
pub use model::{By, Ladder, Model, Sizes, Varied, WithStages};
pub use obstacle::{Boundary, BoundaryCondition, Directions, Domain, MassName, ObstacleProblem, PerDirection};
pub use ordered::Ordered;
pub use output::Output;
pub use rigid_bodies::{
    AxesOfForce, AxialJoint, BodyContacts, BodyForce, BodyJoint, BodyMotion, BodySpring, BoxShape, Bushing,
    CapsuleShape, CompoundPart, CylinderShape, FixedJoint, HalfSpaceShape, HullShape, Inertia, JointLimits,
    JointSpring, Material, MaterialPair, MeshShape, Motor, NumberOrVector, PointJoint, PoseOfRobot, RigidBodiesProblem,
    RigidBody, RigidShape, RobotDescription, ServoMotor, SphereShape, StartOfRobot,
};
pub use schema::json_schema;
pub use search::{FreePeriod, Period, PeriodicRequest, Search, SteadyStateRequest};
pub use set::{BallBlock, Block, BoxBlock, PolyhedronBlock};
pub use stages::Stages;
pub use static_vi::{StaticVariable, ViProblem};
pub use study::{Exact, Rung, StudyPlan, StudyRequest};
pub use summary::Summary;
pub use sweep::{
    AtTime, Design, DesignName, KeepName, Kept, Range, Reducer, Rule, Selector, SweepChunk, SweepPlan, SweepRequest,
    TableOfMembers, Target, edited,
};
pub use tables::{InterpolationName, TableOfPoints};
pub use times::Times;
pub use tolerance::AbsoluteTolerance;
