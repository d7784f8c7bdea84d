//! The differential variational inequality of an elastic body that is discretised in space.

use super::friction::{self, Frictional};
use super::{ContactNode, Continuum, DisplacementIndex, EnergyForm, Unknowns};
use crate::LinearRows;
use expression::{Graph, Node};
use factorisation::SparseMatrix;
use problem::{Control, ConvexSet, Interrupted, Mass, MovingBound, Side};

/// An elastic body as a linear complementarity system, with the meaning of the system's unknowns.
#[derive(Clone, Debug)]
pub struct Semidiscrete {
    /// The equations of motion of the body as a linear complementarity system.
    pub rows: LinearRows,
    /// The initial values of the system's states.
    pub initial: Vec<f64>,
    /// The positions of the displacement components in the vector of unknowns `(x, z)`.
    pub unknowns: Unknowns,
    /// The kinetic and the potential energy of the body.
    pub energy: EnergyForm,
    /// The force of each contact on the body, as a function of `t`, of the states `x` and of the variables `z`.
    pub reactions: Vec<Node>,
    /// The frictional contacts of the body, with the positions of their unknowns.
    pub rough: Vec<Frictional>,
}

/// Derives the equations of an elastic body with the given initial displacements and velocities.
///
/// # Errors
/// If `control` asks to stop.
pub fn semidiscretise(
    graph: &mut Graph,
    continuum: &Continuum,
    displacement: &[f64],
    velocity: &[f64],
    control: &Control,
) -> Result<Semidiscrete, Interrupted> {
    let (stiffness, masses) = (continuum.stiffness(control)?, continuum.masses());
    let unknowns = Unknowns::new(continuum, displacement);
    let mut initial = vec![0.0; unknowns.states()];
    for (d, place) in unknowns.places.iter().enumerate() {
        match *place {
            DisplacementIndex::Inner(u, v) => (initial[u], initial[v]) = (displacement[d], velocity[d]),
            DisplacementIndex::Contact(u, _) if unknowns.has_forces => initial[u] = displacement[d],
            DisplacementIndex::Contact(..) | DisplacementIndex::Clamped(_) => {}
        }
    }
    control.go_on()?;
    let forces = forces(graph, continuum, &unknowns, &stiffness);
    let body = Body { continuum, unknowns: &unknowns, stiffness: &stiffness, masses: &masses, forces };
    let mut rows = if unknowns.has_forces { body.with_forces(graph) } else { body.with_bounds(graph) };
    control.go_on()?;
    let reactions = body.reactions(graph, &rows);
    let rough = friction::add(graph, &mut rows, continuum, &unknowns);
    let energy = EnergyForm::new(graph, continuum, &unknowns, (&masses, stiffness), (&reactions, &rough));
    Ok(Semidiscrete { rows, initial, unknowns, energy, reactions, rough })
}

/// Returns the load on each displacement component, plus the elastic forces that clamped displacements exert on it.
fn forces(graph: &mut Graph, continuum: &Continuum, unknowns: &Unknowns, stiffness: &SparseMatrix) -> Vec<Node> {
    let mut held = vec![0.0; continuum.loads.len()];
    for entry in stiffness.triplet_iter() {
        if let DisplacementIndex::Clamped(value) = unknowns.places[entry.col] {
            held[entry.row] -= entry.val * value;
        }
    }
    let both = continuum.loads.iter().zip(held);
    both.map(|(&load, held)| {
        let held = graph.constant(held);
        graph.add(load, held)
    })
    .collect()
}

/// The data from which the equations of an elastic body are derived.
struct Body<'a> {
    continuum: &'a Continuum,
    unknowns: &'a Unknowns,
    stiffness: &'a SparseMatrix,
    masses: &'a [f64],
    forces: Vec<Node>,
}

impl Body<'_> {
    /// Returns the equations of motion in the form with bounded displacements: `u_I' = v,  v' = m^-1 (f - K u)_I;  u_N
    /// in K(t),  G = (K u - f)_N`
    fn with_bounds(&self, graph: &mut Graph) -> LinearRows {
        let &Unknowns { inner, contact, .. } = self.unknowns;
        let zero = graph.constant(0.0);
        let mut state_forcing = vec![zero; self.unknowns.states()];
        let mut inequality_forcing = vec![zero; contact];
        let mut matrix: Vec<(usize, usize, f64)> = (0..inner).map(|i| (i, inner + i, 1.0)).collect();
        for (d, &place) in self.unknowns.places.iter().enumerate() {
            match place {
                DisplacementIndex::Inner(_, v) => {
                    state_forcing[v] = scaled(graph, self.forces[d], 1.0 / self.masses[d])
                }
                DisplacementIndex::Contact(_, c) => inequality_forcing[c] = graph.negate(self.forces[d]),
                DisplacementIndex::Clamped(_) => {}
            }
        }
        for (row, column, value) in self.couplings() {
            match self.unknowns.places[row] {
                DisplacementIndex::Inner(_, v) => matrix.push((v, column, -value / self.masses[row])),
                DisplacementIndex::Contact(place, _) => matrix.push((place, column, value)),
                DisplacementIndex::Clamped(_) => {}
            }
        }
        let mut set = ConvexSet::free(contact);
        let mut moving = Vec::new();
        for node in &self.continuum.contacts {
            let DisplacementIndex::Contact(_, variable) = self.unknowns.places[node.displacement] else { continue };
            let (side, end) = match node.towards > 0.0 {
                true => (Side::Upper, node.gap),
                false => (Side::Lower, graph.negate(node.gap)),
            };
            let bound = MovingBound { variable, side };
            match graph.value(end) {
                Some(value) => bound.place(value, &mut set),
                None => moving.push((bound, end)),
            }
        }
        LinearRows {
            mass: Mass::Identity,
            matrix,
            parametric: Vec::new(),
            state_forcing,
            inequality_forcing,
            set,
            moving,
        }
    }

    /// Returns the equations of motion in the form with contact forces `r` as variables: `u_I' = v,  m v' + C_IN u_N' =
    /// (f - K u)_I - C_II v, C_NN u_N' = (f - K u)_N - C_NI v - n r;  G = gap - n u_N`
    fn with_forces(&self, graph: &mut Graph) -> LinearRows {
        let (inner, nodes) = (self.unknowns.inner, self.continuum.contacts.len());
        let states = self.unknowns.states();
        let zero = graph.constant(0.0);
        let mut state_forcing = vec![zero; states];
        let mut mass: Vec<(usize, usize, f64)> = (0..inner).map(|i| (i, i, 1.0)).collect();
        let mut matrix: Vec<(usize, usize, f64)> = (0..inner).map(|i| (i, inner + i, 1.0)).collect();
        for (d, &place) in self.unknowns.places.iter().enumerate() {
            if let Some(row) = equation(place) {
                state_forcing[row] = self.forces[d];
            }
            if let DisplacementIndex::Inner(_, v) = place {
                mass.push((v, v, self.masses[d]));
            }
        }
        let relaxation = self.continuum.relaxation;
        for (d, column, value) in self.couplings() {
            let Some(row) = equation(self.unknowns.places[d]) else { continue };
            matrix.push((row, column, -value));
            if relaxation == 0.0 {
                continue;
            }
            match column.checked_sub(inner) {
                // With viscosity, forces depend on displacement rates: the rate of an inner displacement is a state,
                // and that of a contact displacement is not, so that its term belongs to the mass matrix.
                None => matrix.push((row, column + inner, -relaxation * value)),
                Some(_) => mass.push((row, column, relaxation * value)),
            }
        }
        let mut inequality_forcing = Vec::with_capacity(nodes);
        for (k, node) in self.continuum.contacts.iter().enumerate() {
            let DisplacementIndex::Contact(u, _) = self.unknowns.places[node.displacement] else { continue };
            matrix.push((u, states + k, -node.towards));
            matrix.push((states + k, u, -node.towards));
            inequality_forcing.push(node.gap);
        }
        LinearRows {
            mass: Mass::Constant(mass),
            matrix,
            parametric: Vec::new(),
            state_forcing,
            inequality_forcing,
            set: ConvexSet::nonnegative(nodes),
            moving: Vec::new(),
        }
    }

    /// Returns the force of every contact on the body: the variable `r`, or `-n G` in the form with bounded
    /// displacements.
    fn reactions(&self, graph: &mut Graph, rows: &LinearRows) -> Vec<Node> {
        let states = self.unknowns.states();
        let contacts = &self.continuum.contacts;
        if self.unknowns.has_forces {
            return (0..contacts.len()).map(|k| graph.input(1 + states + k)).collect();
        }
        let mut residuals = rows.inequality_forcing.clone();
        for &(row, column, value) in rows.matrix.iter().filter(|(row, ..)| *row >= states) {
            let unknown = graph.input(1 + column);
            let term = scaled(graph, unknown, value);
            residuals[row - states] = graph.add(residuals[row - states], term);
        }
        let of = |contact: &ContactNode| match self.unknowns.places[contact.displacement] {
            DisplacementIndex::Contact(_, c) => Some(scaled(graph, residuals[c], -contact.towards)),
            DisplacementIndex::Clamped(_) | DisplacementIndex::Inner(..) => None,
        };
        contacts.iter().filter_map(of).collect()
    }

    /// Returns the nonzeros of the stiffness matrix `K` in all rows and in the columns of unclamped displacements, as
    /// `(displacement, unknown, value)`.
    fn couplings(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let nonzeros = self.stiffness.triplet_iter().filter(|entry| *entry.val != 0.0);
        nonzeros.filter_map(|entry| Some((entry.row, self.unknowns.places[entry.col].unknown()?, *entry.val)))
    }
}

/// Returns the equation row of the momentum balance of a displacement component; `None` if the displacement is clamped.
fn equation(place: DisplacementIndex) -> Option<usize> {
    match place {
        DisplacementIndex::Inner(_, v) => Some(v),
        DisplacementIndex::Contact(u, _) => Some(u),
        DisplacementIndex::Clamped(_) => None,
    }
}

fn scaled(graph: &mut Graph, node: Node, factor: f64) -> Node {
    let factor = graph.constant(factor);
    graph.multiply(factor, node)
}
