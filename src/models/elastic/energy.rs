//! The energies of an elastic body, `T = sum m v^2 / 2` and `V = u^T K u / 2 - f^T u` with the constant loads `f`,
//! and their balance:
//!
//! ```text
//! d/dt (T + V) = f(t)^T u' - sum n r u_N' - u'^T C u' - q^T v
//! ```
//!
//! The right-hand side is the power of time-dependent loads `f(t)` and of contact forces `r` on moving obstacles,
//! less the viscous and frictional dissipation.

use super::{Continuum, DisplacementIndex, Frictional, Slip, Unknowns};
use expression::{Graph, Node, Tape};
use factorisation::SparseMatrix;
use std::sync::Arc;

/// Energies and powers of an elastic body as functions of time, of `(x, z)`, and of the rates of the displacements in
/// contact.
#[derive(Clone, Debug)]
pub struct EnergyForm {
    places: Arc<[DisplacementIndex]>,
    /// The lumped mass of each displacement component of the body.
    masses: Arc<[f64]>,
    stiffness: Arc<SparseMatrix>,
    relaxation: f64,
    /// The constant load on each displacement component of the body.
    loads: Arc<[f64]>,
    /// The indices of the displacement components with time-dependent loads or moving obstacles.
    driven: Vec<usize>,
    /// The forces on the `driven` displacement components, as compiled expressions.
    forces: Tape,
    slips: Arc<[Slip]>,
}

/// The powers in the energy balance of an elastic body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Power {
    /// The power that time-dependent loads and moving obstacles supply to the body.
    pub supplied: f64,
    /// The power dissipated by viscosity of the body.
    pub viscous: f64,
    /// The power dissipated by friction at the contacts of the body.
    pub frictional: f64,
}

impl EnergyForm {
    /// Compiles the energies of an elastic body; `reactions` are its contact forces as functions of `t`, of the states
    /// `x` and of the variables `z`.
    pub fn new(
        graph: &mut Graph,
        continuum: &Continuum,
        unknowns: &Unknowns,
        (masses, stiffness): (&[f64], SparseMatrix),
        (reactions, rough): (&[Node], &[Frictional]),
    ) -> Self {
        let mut driven = Vec::new();
        let mut forces = Vec::new();
        for (d, &load) in continuum.loads.iter().enumerate().filter(|(d, _)| unknowns.places[*d].unknown().is_some()) {
            if graph.value(load).is_none() {
                driven.push(d);
                forces.push(load);
            }
        }
        for (node, &reaction) in continuum.contacts.iter().zip(reactions) {
            if graph.value(node.gap).is_none() {
                driven.push(node.displacement);
                forces.push(if node.towards > 0.0 { graph.negate(reaction) } else { reaction });
            }
        }
        Self {
            places: unknowns.places.as_slice().into(),
            masses: masses.into(),
            stiffness: Arc::new(stiffness),
            relaxation: continuum.relaxation,
            loads: continuum.loads.iter().map(|&load| graph.value(load).unwrap_or(0.0)).collect(),
            driven,
            forces: Tape::compile(graph, &forces),
            slips: rough.iter().flat_map(|rough| rough.slips.iter().copied()).collect(),
        }
    }

    /// Returns the kinetic and the potential energy of the elastic body at `y = (x, z)`.
    pub fn at(&self, y: &[f64]) -> (f64, f64) {
        let kinetic = self.places.iter().zip(self.masses.iter()).map(|(place, mass)| match *place {
            DisplacementIndex::Inner(_, v) => 0.5 * mass * y[v] * y[v],
            DisplacementIndex::Clamped(_) | DisplacementIndex::Contact(..) => 0.0,
        });
        let displacement = |d: usize| self.places[d].value(y);
        let work: f64 = self.loads.iter().enumerate().map(|(d, load)| load * displacement(d)).sum();
        (kinetic.sum(), 0.5 * self.quadratic(displacement) - work)
    }

    /// Returns whether the total energy of the elastic body is conserved: no viscosity, no friction, no time-dependent
    /// loads and no moving obstacles.
    pub fn is_closed(&self) -> bool {
        self.relaxation == 0.0 && self.driven.is_empty() && self.slips.is_empty()
    }

    /// Returns the powers in the energy balance of the elastic body at `t` and `y = (x, z)`, where `rates` is `y'`.
    pub fn power(&mut self, t: f64, y: &[f64], rates: &[f64]) -> Power {
        let mut forces = vec![0.0; self.driven.len()];
        self.forces.evaluate(t, y, &mut forces);
        let velocity = |d: usize| match self.places[d] {
            DisplacementIndex::Clamped(_) => 0.0,
            DisplacementIndex::Inner(_, v) => y[v],
            DisplacementIndex::Contact(u, _) => rates[u],
        };
        let supplied = self.driven.iter().zip(&forces).map(|(&d, force)| force * velocity(d)).sum();
        let frictional = self.slips.iter().map(|slip| y[slip.force] * y[slip.velocity]).sum();
        let viscous = if self.relaxation > 0.0 { self.relaxation * self.quadratic(velocity) } else { 0.0 };
        Power { supplied, viscous, frictional }
    }

    /// Returns the quadratic form `w^T K w` of the stiffness matrix `K`, twice the elastic energy of the displacements
    /// `w`.
    fn quadratic(&self, w: impl Fn(usize) -> f64) -> f64 {
        let columns = 0..self.places.len();
        columns
            .map(|d| {
                let column = self.stiffness.row_idx_of_col(d).zip(self.stiffness.val_of_col(d));
                w(d) * column.map(|(row, value)| value * w(row)).sum::<f64>()
            })
            .sum()
    }
}
