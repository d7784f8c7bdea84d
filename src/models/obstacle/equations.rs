//! What an obstacle problem is made of.

use super::Field;
use crate::finite_elements::{Grid, Quadrature};
use analysis::{Analysis, Uniqueness};
use problem::Warning;

/// What is given on a side.
#[derive(Clone, Debug)]
pub enum Condition {
    /// `u`
    Dirichlet(Field),
    /// `a du/dn`, outwards: what flows in.
    Neumann(Field),
}

impl Condition {
    /// What is given, of whichever kind.
    pub fn field(&self) -> &Field {
        match self {
            Self::Dirichlet(field) | Self::Neumann(field) => field,
        }
    }
}

/// A point at which `u` is told.
#[derive(Clone, Debug)]
pub struct Probe {
    /// Its name.
    pub name: String,
    /// Where it is, within the domain.
    pub at: [f64; 3],
}

/// An obstacle problem on a grid.
#[derive(Clone, Debug)]
pub struct Obstacle {
    /// Interval, rectangle or box in elements.
    pub grid: Grid,
    /// How mass, advection and reaction are integrated: at the nodes (the lumped mass) or exactly (the consistent one).
    pub quadrature: Quadrature,
    /// `a` in each direction, not below zero.
    pub diffusion: Vec<Field>,
    /// `b`, in each direction; empty where there is none.
    pub advection: Vec<Field>,
    /// `c`
    pub reaction: Option<Field>,
    /// `f`
    pub source: Option<Field>,
    /// `phi`
    pub lower: Option<Field>,
    /// `psi`
    pub upper: Option<Field>,
    /// `u` at the start, between the obstacles at every node.
    pub initial: Field,
    /// What is given on each side, by [`Side::place`](crate::finite_elements::Side::place).
    pub conditions: Vec<Condition>,
    /// Where `u` is told.
    pub probes: Vec<Probe>,
    /// What the user should know before it is solved.
    pub warnings: Vec<Warning>,
}

impl Obstacle {
    /// The names of what is told, see [`Contact`](super::Contact) for those after the probes.
    pub fn output_names(&self) -> Vec<String> {
        let probes = self.probes.iter().map(|probe| probe.name.clone());
        let scalars = Self::scalar_names(self.has_obstacle(), self.grid.dimension());
        probes.chain(scalars.iter().map(|&name| name.to_owned())).collect()
    }

    /// The names of what is told of a whole domain of so many directions, with or without obstacles.
    pub fn scalar_names(has_obstacle: bool, dimension: usize) -> &'static [&'static str] {
        const NAMES: [&str; 5] = ["total", "pressure", "contact", "contact_from", "contact_to"];
        match (has_obstacle, dimension) {
            (false, _) => &NAMES[..1],
            (true, 1) => &NAMES,
            (true, _) => &NAMES[..3],
        }
    }

    /// Whether `A` is the same at all times.
    pub fn has_constant_operator(&self) -> bool {
        let mut coefficients = self.diffusion.iter().chain(&self.advection).chain(&self.reaction);
        !coefficients.any(Field::varies_in_time)
    }

    /// Whether there is anything to rest on.
    pub fn has_obstacle(&self) -> bool {
        self.lower.is_some() || self.upper.is_some()
    }

    /// What the theory says of it.
    pub fn analyse(&self) -> Analysis {
        let n = self.grid.nodes();
        let (index, levels, because) = if self.has_obstacle() {
            let because =
                "CB is the inverse of the mass matrix, symmetric and positive definite: index one, one solution";
            (1.0, vec![0, n], because)
        } else {
            (0.0, Vec::new(), "there is no obstacle: an ordinary differential equation in the nodal values")
        };
        Analysis {
            index: Some(index),
            levels,
            uniqueness: Uniqueness::Unique,
            because: because.to_owned(),
            ..Analysis::default()
        }
    }
}
