//! Semidiscretisation of an obstacle problem in space: the mass matrix `M`, the operator `A(t)`, the load `f(t)`, and
//! the bounds of `K(t)` at the nodes of the grid.

use super::load::load_at;
use super::operator::{check_coefficients, stiffness};
use super::{Condition, Field, Obstacle, ObstacleDataError, ObstacleError};
use crate::finite_elements::{Assembly, Element, Neighbours, Quadrature, Side};
use factorisation::SparseMatrix;
use problem::{Control, ConvexSet, Interrupted};

/// The equations of the nodal values `u` of an obstacle problem, with matrices and vectors at the time of their last
/// evaluation.
pub struct Semidiscrete {
    /// The obstacle problem before discretisation.
    pub problem: Obstacle,
    /// The mass matrix `M` of the finite element grid.
    pub mass: SparseMatrix,
    /// The matrix of the operator `A` (diffusion, advection and reaction), with the sparsity pattern of `M`.
    pub stiffness: SparseMatrix,
    /// The load vector `f`, including the inflow through the sides of the domain.
    pub load: Vec<f64>,
    /// The set `K` of nodal values between the obstacles; both bounds of a node with a Dirichlet condition are equal to
    /// the prescribed value.
    pub set: ConvexSet,
    /// The integral of each shape function over the domain.
    pub weights: Vec<f64>,
    /// For each node, whether its value `u` is prescribed by a Dirichlet condition.
    pub is_given: Vec<bool>,
    /// A zero matrix with the sparsity pattern of `A`, from which the assembly of `A` starts.
    blank: Assembly,
    has_operator: bool,
    has_vectors: bool,
    varying: Varying,
}

/// Which parts of the semidiscrete equations depend on time.
struct Varying {
    operator: bool,
    load: bool,
    set: bool,
}

/// Number of elements assembled between two polls of [`Control`] for interruption: about a millisecond's work.
const AT_ONCE: usize = 1 << 13;

/// Relative tolerance for violations of an obstacle: nodal values beyond it by less are treated as values on the
/// obstacle.
const ROUNDING: f64 = 1e-10;

impl Semidiscrete {
    /// Assembles the mass matrix. [`Self::operator_at`] and [`Self::vectors_at`] evaluate `A`, `f` and `K`.
    ///
    /// # Errors
    /// If `control` asks to stop.
    pub fn new(problem: Obstacle, control: &Control) -> Result<Self, Interrupted> {
        let grid = &problem.grid;
        let n = grid.nodes();
        let neighbours = match problem.quadrature {
            Quadrature::Exact => Neighbours::OfElements,
            Quadrature::Nodal => Neighbours::AlongAxes,
        };
        let blank = Assembly::new(grid, 1, neighbours);
        let mut mass = blank.clone();
        let local = Element::of(grid, problem.quadrature).mass();
        for element in 0..grid.elements() {
            if element % AT_ONCE == 0 {
                control.go_on()?;
            }
            mass.add(element, 1.0, &local);
        }
        let mass = mass.finish();
        let mut weights = vec![0.0; n];
        for entry in mass.triplet_iter() {
            weights[entry.row] += entry.val;
        }
        let is_given = problem.is_given();
        let varying = Varying {
            operator: !problem.has_constant_operator(),
            load: problem.source.iter().any(varies)
                || problem.conditions.iter().any(|condition| varies(condition.field())),
            set: problem.lower.iter().chain(&problem.upper).any(varies)
                || problem.conditions.iter().any(|condition| varies(condition.field())),
        };
        Ok(Self {
            stiffness: mass.clone(),
            mass,
            load: vec![0.0; n],
            set: ConvexSet::free(n),
            weights,
            is_given,
            blank,
            has_operator: false,
            has_vectors: false,
            varying,
            problem,
        })
    }

    /// Returns whether the load vector `f` depends on time.
    pub(super) fn load_varies(&self) -> bool {
        self.varying.load
    }

    /// Returns whether the set `K` between the obstacles depends on time.
    pub(super) fn set_varies(&self) -> bool {
        self.varying.set
    }

    /// Evaluates the operator matrix `A` at time `t`; returns whether it was assembled anew.
    ///
    /// # Errors
    /// If a coefficient is not finite, if diffusion is negative, or if `control` asks to stop.
    pub fn operator_at(&mut self, t: f64, control: &Control) -> Result<bool, ObstacleError> {
        if self.has_operator && !self.varying.operator {
            return Ok(false);
        }
        self.stiffness = stiffness(&mut self.problem, self.blank.clone(), t, control)?;
        self.has_operator = true;
        Ok(true)
    }

    /// Evaluates the load `f` and the set `K` at time `t`.
    ///
    /// # Errors
    /// If a value is not finite, if obstacles cross, if a Dirichlet value is beyond an obstacle, or if
    /// `control` asks to stop.
    pub fn vectors_at(&mut self, t: f64, control: &Control) -> Result<(), ObstacleError> {
        if self.varying.load || !self.has_vectors {
            load_at(&mut self.problem, &mut self.load, t, control)?;
        }
        if self.varying.set || !self.has_vectors {
            set_at(&mut self.problem, &mut self.set, &self.is_given, t, control)?;
        }
        self.has_vectors = true;
        Ok(())
    }

    /// Evaluates the set `K` alone at time `t`.
    ///
    /// # Errors
    /// See [`Self::vectors_at`].
    pub(super) fn bounds_at(&mut self, t: f64, control: &Control) -> Result<(), ObstacleError> {
        set_at(&mut self.problem, &mut self.set, &self.is_given, t, control)
    }

    /// Returns the initial nodal values, with Dirichlet values on the sides. The load `f` and the set `K` must have
    /// been evaluated at the initial time.
    ///
    /// # Errors
    /// If a value is not finite, if a value is beyond an obstacle (the worst is reported), or if `control`
    /// asks to stop.
    pub fn initial(&mut self, t: f64, control: &Control) -> Result<Vec<f64>, ObstacleError> {
        initial(&mut self.problem, &self.set, &self.is_given, t, control)
    }
}

impl Obstacle {
    /// Checks all data of the problem at the initial time `t`, initial values included, without assembling matrices.
    ///
    /// # Errors
    /// The first invalid value, or an interruption if `control` asks to stop.
    pub fn check(&mut self, t: f64, control: &Control) -> Result<(), ObstacleError> {
        let n = self.grid.nodes();
        check_coefficients(self, t, control)?;
        load_at(self, &mut vec![0.0; n], t, control)?;
        let (mut set, is_given) = (ConvexSet::free(n), self.is_given());
        set_at(self, &mut set, &is_given, t, control)?;
        initial(self, &set, &is_given, t, control)?;
        Ok(())
    }

    /// Returns for each node whether its value `u` is prescribed by a Dirichlet condition.
    fn is_given(&self) -> Vec<bool> {
        let mut is_given = vec![false; self.grid.nodes()];
        for (side, condition) in Side::all(self.grid.dimension()).zip(&self.conditions) {
            if matches!(condition, Condition::Dirichlet(_)) {
                self.grid.nodes_on(side).for_each(|node| is_given[node] = true);
            }
        }
        is_given
    }
}

/// Returns the initial nodal values, with Dirichlet values at the nodes on the sides of the domain.
fn initial(
    problem: &mut Obstacle,
    set: &ConvexSet,
    is_given: &[bool],
    t: f64,
    control: &Control,
) -> Result<Vec<f64>, ObstacleError> {
    let mut u = Vec::with_capacity(is_given.len());
    let mut worst = (0.0, None);
    for (node, &is_given) in is_given.iter().enumerate() {
        go_on(node, t, control)?;
        let at = problem.grid.coordinates(node);
        let value = finite("initial", &mut problem.initial, t, at)?;
        let bound = set.project(node, value);
        let beyond = (bound - value).abs();
        if !is_given && beyond > slack(bound).max(worst.0) {
            worst = (beyond, Some(ObstacleDataError::InitialBeyond { value, bound, at }));
        }
        u.push(bound);
    }
    worst.1.map_or(Ok(u), |error| Err(error.into()))
}

/// Evaluates the bounds of the set `K` between the obstacles at time `t`.
fn set_at(
    problem: &mut Obstacle,
    set: &mut ConvexSet,
    is_given: &[bool],
    t: f64,
    control: &Control,
) -> Result<(), ObstacleError> {
    let Obstacle { grid, lower, upper, conditions, .. } = problem;
    for (node, &is_given) in is_given.iter().enumerate() {
        go_on(node, t, control)?;
        let at = grid.coordinates(node);
        if let Some(lower) = lower {
            set.lower[node] = finite("obstacle", lower, t, at)?;
        }
        if let Some(upper) = upper {
            set.upper[node] = finite("upper_obstacle", upper, t, at)?;
        }
        if set.lower[node] > set.upper[node] && !is_given {
            return Err(ObstacleDataError::Crossing { lower: set.lower[node], upper: set.upper[node], at, t }.into());
        }
    }
    for (side, condition) in Side::all(grid.dimension()).zip(conditions) {
        let Condition::Dirichlet(given) = condition else { continue };
        for node in grid.nodes_on(side) {
            let at = grid.coordinates(node);
            let value = finite(&side_key(side, "dirichlet"), given, t, at)?;
            let bounds = [
                lower.as_mut().map(|lower| lower.at(t, at)).filter(|lower| value < lower - slack(*lower)),
                upper.as_mut().map(|upper| upper.at(t, at)).filter(|upper| value > upper + slack(*upper)),
            ];
            if let [Some(bound), _] | [_, Some(bound)] = bounds {
                return Err(ObstacleDataError::GivenBeyond { side, value, bound, at, t }.into());
            }
            (set.lower[node], set.upper[node]) = (value, value);
        }
    }
    Ok(())
}

/// Polls `control` before every `AT_ONCE`-th node or element.
///
/// # Errors
/// If `control` asks to stop.
pub(super) fn go_on(item: usize, t: f64, control: &Control) -> Result<(), ObstacleError> {
    if item.is_multiple_of(AT_ONCE) { control.go_on().map_err(|_| ObstacleError::Interrupted { t }) } else { Ok(()) }
}

fn slack(bound: f64) -> f64 {
    ROUNDING * (1.0 + bound.abs())
}

fn varies(field: &Field) -> bool {
    field.varies_in_time()
}

/// Returns the key of a boundary condition in a specification.
pub(super) fn side_key(side: Side, kind: &str) -> String {
    format!("boundary/{}/{kind}", side.name())
}

/// Returns the value of a field at a time and a position.
///
/// # Errors
/// If the value is not finite.
pub(super) fn finite(key: &str, field: &mut Field, t: f64, at: [f64; 3]) -> Result<f64, ObstacleDataError> {
    let value = field.at(t, at);
    if value.is_finite() { Ok(value) } else { Err(ObstacleDataError::NotFinite { key: key.to_owned(), value, at, t }) }
}
