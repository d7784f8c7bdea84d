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
    /// A Dirichlet condition: the prescribed value of the solution `u`.
    Dirichlet(Field),
    /// A Neumann condition: the prescribed inflow `a du/dn`, with the diffusion coefficient `a` and the outward normal
    /// `n`.
    Neumann(Field),
}

impl Condition {
    /// Returns the prescribed function of a Dirichlet or Neumann condition.
    pub fn field(&self) -> &Field {
        match self {
            Self::Dirichlet(field) | Self::Neumann(field) => field,
        }
    }
}

/// A point of the domain at which the solution `u` is an output.
#[derive(Clone, Debug)]
pub struct Probe {
    /// The name of the output with the value of the solution `u` at the point.
    pub name: String,
    /// The coordinates of the point, within the domain.
    pub at: [f64; 3],
}

/// A parabolic obstacle problem on a grid.
#[derive(Clone, Debug)]
pub struct Obstacle {
    /// The finite element grid on an interval, a rectangle or a box.
    pub grid: Grid,
    /// The quadrature of the mass, advection and reaction matrices: nodal (lumped mass) or exact (consistent mass).
    pub quadrature: Quadrature,
    /// The diffusion coefficient `a` of the equation in each direction, nonnegative.
    pub diffusion: Vec<Field>,
    /// The advection velocity `b` of the equation in each direction; empty without advection.
    pub advection: Vec<Field>,
    /// The reaction coefficient `c` of the equation; `None` without a reaction term.
    pub reaction: Option<Field>,
    /// The source `f` of the equation; `None` without a source.
    pub source: Option<Field>,
    /// The lower obstacle `phi`; `None` without a lower obstacle.
    pub lower: Option<Field>,
    /// The upper obstacle `psi`; `None` without an upper obstacle.
    pub upper: Option<Field>,
    /// The initial value of the solution `u`, between the obstacles at every node.
    pub initial: Field,
    /// The boundary condition on each side of the domain, in the order of
    /// [`Side::place`](crate::finite_elements::Side::place).
    pub conditions: Vec<Condition>,
    /// The breakpoints in time of coefficients, source, obstacles and boundary values.
    pub breaks: Breaks,
    /// The points of the domain at which the solution `u` is an output.
    pub probes: Vec<Probe>,
    /// Warnings to the user about the obstacle problem, known before the problem is solved.
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
    /// Returns the names of the outputs: values at points, then scalars of the whole domain (see
    /// [`Contact`](super::Contact)).
    pub fn output_names(&self) -> Vec<String> {
        let probes = self.probes.iter().map(|probe| probe.name.clone());
        let scalars = Self::scalar_names(self.has_obstacle(), self.grid.dimension());
        probes.chain(scalars.iter().map(|&name| name.to_owned())).collect()
    }

    /// Returns the names of the scalar outputs of an obstacle problem on a domain of the given dimension, with or
    /// without obstacles.
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
