//! An elastic body on its finite element grid: material, nodal masses, loads, clamped displacements and possible
//! contacts.
//!
//! Displacement components are numbered `node * components + component`.

use super::Lame;
use crate::finite_elements::{Assembly, Element, Grid, Neighbours, Quadrature};
use expression::Node;
use factorisation::SparseMatrix;
use problem::{Control, Interrupted};

/// An elastic or viscoelastic body, discretised in space by finite elements.
#[derive(Clone, Debug)]
pub struct Continuum {
    /// The finite element grid of the body.
    pub grid: Grid,
    /// The number of displacement components per node: the dimension of the grid, one for a string.
    pub components: usize,
    /// The mass density of the body, per volume; for strings and bars (whose cross-section is one) per length.
    pub density: f64,
    /// The Lame parameters of Hooke's law for the body.
    pub lame: Lame,
    /// The relaxation time of a viscoelastic body: the viscous stress is the relaxation time times the elastic stress
    /// of the displacement rates; zero for an elastic body.
    pub relaxation: f64,
    /// The load on each displacement component, a function of `t` alone.
    pub loads: Vec<Node>,
    /// For each displacement component, whether it is clamped: stays at its initial value.
    pub clamped: Vec<bool>,
    /// The possible contacts of the body, at most one on either side of a displacement component; clamped components
    /// have none.
    pub contacts: Vec<ContactNode>,
}

/// A displacement component of a node that is bounded by an obstacle.
#[derive(Clone, Debug)]
pub struct ContactNode {
    /// The index of the displacement component that the obstacle bounds.
    pub displacement: usize,
    /// The direction of the bound: 1 if the obstacle bounds the displacement above, -1 if below.
    pub towards: f64,
    /// The bound of the obstacle on `towards` times the displacement, a function of `t` alone.
    pub gap: Node,
    /// The displacements of adjacent nodes that carry the mass of the bounded displacement, in equal parts; they are
    /// neither clamped nor in contact.
    pub carriers: Vec<usize>,
    /// Coulomb's coefficient of friction between body and obstacle; zero for a frictionless contact.
    pub friction: f64,
    /// The tangential displacement components of the contact node that have a mass and are not clamped: at most two.
    pub tangential: Vec<usize>,
    /// The index of the grid side on which the contact node lies.
    pub side: usize,
}

/// Number of elements assembled between two polls of [`Control`] for interruption: a few milliseconds' work in three
/// dimensions.
const BETWEEN_POLLS: usize = 256;

impl Continuum {
    /// Assembles the stiffness matrix `K` of all displacements, including clamped ones.
    ///
    /// # Errors
    /// If `control` asks to stop.
    pub fn stiffness(&self, control: &Control) -> Result<SparseMatrix, Interrupted> {
        let local = self.lame.stiffness(&Element::of(&self.grid, Quadrature::Exact), self.components);
        let mut assembly = Assembly::new(&self.grid, self.components, Neighbours::OfElements);
        for element in 0..self.grid.elements() {
            if element % BETWEEN_POLLS == 0 {
                control.go_on()?;
            }
            assembly.add(element, 1.0, &local);
        }
        Ok(assembly.finish())
    }

    /// Returns the lumped mass of each displacement component; zero for components with a possible contact.
    pub fn masses(&self) -> Vec<f64> {
        let share = self.density * self.volume_share();
        let mut masses = vec![0.0; self.grid.nodes() * self.components];
        for element in 0..self.grid.elements() {
            for node in self.grid.corners(element) {
                masses[node * self.components..(node + 1) * self.components].iter_mut().for_each(|m| *m += share);
            }
        }
        for contact in &self.contacts {
            let mass = std::mem::take(&mut masses[contact.displacement]);
            contact.carriers.iter().for_each(|&carrier| masses[carrier] += mass / contact.carriers.len() as f64);
        }
        masses
    }

    /// Returns the share of a finite element's volume that belongs to one of its corners.
    fn volume_share(&self) -> f64 {
        let element = Element::of(&self.grid, Quadrature::Nodal);
        element.volume() / (1_u32 << self.grid.dimension()) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finite_elements::Axis;
    use expression::Graph;

    #[test]
    fn the_mass_of_contact_nodes_goes_inwards_and_none_is_lost() {
        let mut graph = Graph::new();
        let zero = graph.constant(0.0);
        let axis = |upper, elements| Axis { lower: 0.0, upper, elements };
        let grid = Grid::new(vec![axis(3.0, 3), axis(2.0, 2)]);
        let contact = |node: usize| ContactNode {
            displacement: 2 * node + 1,
            towards: -1.0,
            gap: zero,
            carriers: vec![2 * (node + 4) + 1],
            friction: 0.0,
            tangential: Vec::new(),
            side: 0,
        };
        let continuum = Continuum {
            components: 2,
            density: 5.0,
            lame: Lame::solid(1.0, 0.3),
            relaxation: 0.0,
            loads: vec![zero; 24],
            clamped: vec![false; 24],
            contacts: (0..4).map(contact).collect(),
            grid,
        };
        let masses = continuum.masses();
        for component in 0..2 {
            let total: f64 = masses.iter().skip(component).step_by(2).sum();
            assert!((total - 30.0).abs() < 1e-12, "{component}: {total}");
        }
        // The corner node of the grid has the mass of a quarter element in the tangential direction, and no mass in the
        // normal direction, in which it may be in contact.
        assert_eq!((masses[0], masses[1]), (1.25, 0.0));
        assert_eq!((masses[8], masses[9]), (2.5, 3.75));
    }
}
