//! The data of an obstacle problem: coefficients, source, obstacles, initial and boundary values.

use super::Field;
use crate::finite_elements::{Grid, Quadrature};
use analysis::{Analysis, Uniqueness};
use expression::Breaks;
use hybrid::Breaking;
use numerics::Interval;
use problem::Warning;

/// The boundary condition on a side of the domain.
#[derive(Clone, Debug)]
pub enum Condition {
    /// A Dirichlet condition: the value of `u`.
    Dirichlet(Field),
    /// A Neumann condition: the inflow `a du/dn`, with the outward normal `n`.
    Neumann(Field),
}

impl Condition {
    /// Returns the field of a Dirichlet or Neumann condition.
    pub fn field(&self) -> &Field {
        match self {
            Self::Dirichlet(field) | Self::Neumann(field) => field,
        }
    }
}

/// A point of the domain at which `u` is an output.
#[derive(Clone, Debug)]
pub struct Probe {
    /// The name of the output with the value of `u` at the point.
    pub name: String,
    /// The coordinates of the output point, within the domain.
    pub at: [f64; 3],
}

/// A parabolic obstacle problem on a grid.
#[derive(Clone, Debug)]
pub struct Obstacle {
    /// The finite element grid on an interval, a rectangle or a box.
    pub grid: Grid,
    /// The quadrature of mass, advection and reaction: nodal (lumped mass) or exact (consistent mass).
    pub quadrature: Quadrature,
    /// The diffusion coefficient `a` in each direction, nonnegative.
    pub diffusion: Vec<Field>,
    /// The advection velocity `b` in each direction; empty without advection.
    pub advection: Vec<Field>,
    /// The reaction coefficient `c`, if there is a reaction term.
    pub reaction: Option<Field>,
    /// The source `f`, if there is one.
    pub source: Option<Field>,
    /// The lower obstacle `phi`, if there is one.
    pub lower: Option<Field>,
    /// The upper obstacle `psi`, if there is one.
    pub upper: Option<Field>,
    /// The initial value of `u`, between the obstacles at every node.
    pub initial: Field,
    /// The boundary condition of each side, by [`Side::place`](crate::finite_elements::Side::place).
    pub conditions: Vec<Condition>,
    /// The breakpoints in time of all data except the initial values.
    pub breaks: Breaks,
    /// The points at which `u` is an output.
    pub probes: Vec<Probe>,
    /// Warnings for the user, known before the problem is solved.
    pub warnings: Vec<Warning>,
}

impl Breaking for Obstacle {
    fn breaks(&mut self, t: f64) -> &[f64] {
        self.breaks.at(t)
    }

    fn enclose_breaks(&mut self, t: Interval) -> &[Interval] {
        self.breaks.over(t)
    }
}

impl Obstacle {
    /// Returns the names of the outputs: probes, then scalars of the whole domain (see [`Contact`](super::Contact)).
    pub fn output_names(&self) -> Vec<String> {
        let probes = self.probes.iter().map(|probe| probe.name.clone());
        let scalars = Self::scalar_names(self.has_obstacle(), self.grid.dimension());
        probes.chain(scalars.iter().map(|&name| name.to_owned())).collect()
    }

    /// Returns the names of the scalar outputs of a domain of the given dimension, with or without obstacles.
    pub fn scalar_names(has_obstacle: bool, dimension: usize) -> &'static [&'static str] {
        const NAMES: [&str; 5] = ["total", "pressure", "contact", "contact_from", "contact_to"];
        match (has_obstacle, dimension) {
            (false, _) => &NAMES[..1],
            (true, 1) => &NAMES,
            (true, _) => &NAMES[..3],
        }
    }

    /// Returns whether the operator `A` (diffusion, advection and reaction) does not depend on time.
    pub fn has_constant_operator(&self) -> bool {
        let mut coefficients = self.diffusion.iter().chain(&self.advection).chain(&self.reaction);
        !coefficients.any(Field::varies_in_time)
    }

    /// Returns whether the problem has a lower or an upper obstacle.
    pub fn has_obstacle(&self) -> bool {
        self.lower.is_some() || self.upper.is_some()
    }

    /// Analyses index, existence and uniqueness according to the theory of parabolic variational inequalities.
    pub fn analyse(&self) -> Analysis {
        let n = self.grid.nodes();
        let (index, levels, because) = if self.has_obstacle() {
            let because = "CB is the inverse of the mass matrix, symmetric and positive definite: index one, and the \
                           solution is unique";
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
