//! The derivatives of a run with respect to its parameters and initial values.
//!
//! Within a step, they are the derivatives of the stages on their face, with the exact Jacobian of each stage,
//!
//! ```text
//! M dX_i = M dx_n + h sum_j a_ij (F_x dX_j + F_z dZ_j + F_p),    G_x dX_i + G_z dZ_i + G_p = 0 or dZ_i = dl,    dx_{n+1} = dX_s
//! ```
//!
//! so that they have the order of the states. Where the face changes, or the rows have a breakpoint, at a time `tau` at
//! which a monitor `phi` vanishes, the states are continuous, but their rates need not be:
//!
//! ```text
//! dtau = -(phi_x dx + phi_z dz + phi_p) / phi',    dx+ = dx- + (x'- - x'+) dtau
//! ```
//!
//! (Rozenvasser 1967; Hiskens and Pai 2000, *Trajectory sensitivity analysis of hybrid systems*), with `dz` and `phi'`
//! on the face before. No derivative exists, and none is reported, if `phi'` vanishes, if several monitors vanish at
//! one time, or if a switch was not located.

mod adjoint;
mod independent;
mod monitors;
mod stages;
mod steps;

pub use adjoint::{Adjoint, IntegralWeights, StoredStep, SweepError, Swept, Work as AdjointWork};
pub use steps::DirectionSize;

use super::dense_output::Step;
use super::face::Activity;
use super::settings::StepError;
use super::stepper::Radau;
use super::tableau::Tableau;
use hybrid::{NoSlope, OneStep};
use independent::Jump;
use nalgebra::{DMatrix, Dyn, LU};
use problem::{Dvi, Mass, MovingBound};

/// A jump of the rates at a switch below this fraction of their terms counts as zero: variables and times of switches
/// are only as accurate as the tolerances.
const CONTINUOUS: f64 = 1e-9;

/// Maximum number of attempts at a step whose derivatives are not accurate enough, each at most half as long as the
/// one before it.
const MOST_ATTEMPTS: usize = 40;

/// The directions of differentiation (parameters and initial values), one per column.
pub struct Directions {
    /// The derivatives of the states at the start of the run along the directions, one direction per column.
    pub initial: DMatrix<f64>,
    /// Writes the derivatives of the rows `F`, `G` and the moving bounds at `(t, y)` with respect to the directions.
    pub rows: RowsBy,
    /// The nonzero derivatives of the mass matrix, as `((row, column), direction, value)`.
    pub mass: Vec<((usize, usize), usize, f64)>,
    /// The nonzero derivatives of constant bounds, as `(bound, direction, value)`.
    pub bounds: Vec<(MovingBound, usize, f64)>,
    /// The problem shifted forwards and backwards along each direction; `None` if its equations do not depend on the
    /// direction.
    pub shifted: Vec<Option<Shifted>>,
}

/// Writes the derivatives of the rows of a problem at `(t, y)` with respect to each direction.
pub type RowsBy = Box<dyn FnMut(f64, &[f64], &mut DMatrix<f64>) + Send>;

/// A problem with one parameter shifted above and below its value.
pub struct Shifted {
    /// Size of the shift of the parameter, in its unit.
    pub by: f64,
    /// The problems with the parameter above and below its value.
    pub problems: [Box<dyn Dvi>; 2],
}

/// Reason why a run has no derivative along the directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoDerivative {
    /// The mass matrix is singular: some states have no mass.
    #[error("the mass matrix is singular: the rates of some states are not determined")]
    SingularMass,
    /// The states jump, since they violate constraints at the start or at a breakpoint.
    #[error("the states jump, because they violate the constraints")]
    Jump,
    /// A switch (change of the active face of `K`) was stepped over rather than located.
    #[error("a switch could not be located, and was stepped over")]
    Unlocated,
    /// A block of variables moves from one face of its set to another.
    #[error(
        "variables come to the boundary of a ball, a cone, a simplex or a polyhedron, or leave it, and rates jump: of that switch \
         derivatives are not available"
    )]
    Block,
    /// Several monitors (event functions) vanish at one time, with different derivatives of that time.
    #[error("several switches coincide, and their order depends on the direction")]
    Several,
    /// A monitor (event function) touches zero without a change of sign.
    #[error(
        "a switching surface is touched and not crossed (grazing), so that the time of the switch has no derivative"
    )]
    Grazing,
    /// The equations for the derivatives of a step, or those of the variables, are singular.
    #[error("the equations for the derivatives are singular")]
    Singular,
}

impl From<NoSlope> for NoDerivative {
    fn from(cause: NoSlope) -> Self {
        match cause {
            NoSlope::Grazing => Self::Grazing,
            NoSlope::Several => Self::Several,
        }
    }
}

/// The derivatives of the states along a run with respect to the directions.
pub struct Tangents {
    problem: Box<dyn Dvi>,
    directions: Directions,
    mass: DMatrix<f64>,
    inverse_mass: LU<f64, Dyn, Dyn>,
    /// Derivatives of the states at the time reached, one direction per column.
    now: DMatrix<f64>,
    /// The largest absolute value of the derivative of each state so far.
    largest: DMatrix<f64>,
    /// Derivatives of the states at the beginning of the last step, and at its stages.
    before: DMatrix<f64>,
    stages: Vec<DMatrix<f64>>,
    /// Slopes (time derivatives) of the derivatives of the states: the correction at the beginning of the last step,
    /// times the step size, and the slope at its end.
    slopes: [Option<DMatrix<f64>>; 2],
    /// Whether the directions are a basis of the states and parameters, some of which lead off the constraints of a
    /// face: along such directions the monitors of one switch need not agree.
    is_basis: bool,
    /// Magnitudes of the terms of the derivatives of the states in the last step, if they are measured.
    terms: Option<Terms>,
    /// Number of central differences, one for each direction, at breakpoints of time and of hidden constraints.
    differences: u64,
    /// The error of the derivatives of the states in the last step, relative to the tolerance, if it was estimated.
    error: Option<f64>,
}

/// The absolute values of the terms that add up to the derivatives of the states in a step and at the switch at its end: a
/// scale for the rounding of derivatives that cancel.
struct Terms {
    /// Absolute values of the inverse of the mass matrix.
    inverse_mass: DMatrix<f64>,
    /// The absolute values of the terms, one direction per column.
    now: DMatrix<f64>,
}

impl Tangents {
    /// Creates the derivatives at the start of a run of a problem.
    ///
    /// # Errors
    /// If the mass matrix is singular.
    pub fn new(problem: Box<dyn Dvi>, directions: Directions) -> Result<Self, NoDerivative> {
        let structure = problem.structure();
        let n = structure.states;
        let mut mass = DMatrix::identity(n, n);
        if let Mass::Constant(entries) = &structure.mass {
            mass.fill(0.0);
            entries.iter().for_each(|&(i, j, value)| mass[(i, j)] += value);
        }
        let inverse_mass = mass.clone().lu();
        if !inverse_mass.is_invertible() {
            return Err(NoDerivative::SingularMass);
        }
        let now = directions.initial.clone();
        Ok(Self {
            problem,
            largest: now.abs(),
            before: now.clone(),
            stages: Vec::new(),
            slopes: [None, None],
            is_basis: false,
            terms: None,
            differences: 0,
            error: None,
            now,
            directions,
            mass,
            inverse_mass,
        })
    }

    /// Measures the magnitudes of the terms that add up to the derivatives as well.
    ///
    /// # Errors
    /// If the mass matrix is singular.
    pub fn with_terms(mut self) -> Result<Self, NoDerivative> {
        let inverse_mass = self.inverse_mass.try_inverse().ok_or(NoDerivative::SingularMass)?.abs();
        self.terms = Some(Terms { inverse_mass, now: self.now.abs() });
        Ok(self)
    }

    /// Returns a copy of the data at the time reached on which the derivatives in later steps depend.
    fn point(&self) -> Point {
        Point { now: self.now.clone(), largest: self.largest.clone(), slope: self.slopes[1].clone() }
    }

    /// Restores saved data on which the derivatives in later steps depend.
    fn restore(&mut self, Point { now, largest, slope }: &Point) {
        self.now.copy_from(now);
        self.largest.copy_from(largest);
        self.slopes = [None, slope.clone()];
    }

    /// Makes a step of a run in which the error of the derivatives, too, is within the tolerance, unless the step
    /// size is fixed.
    ///
    /// # Errors
    /// If no step is made; the inner result tells why there is no derivative from the end of the step on.
    pub fn advance(&mut self, radau: &mut Radau<'_>) -> Result<Result<(), NoDerivative>, StepError> {
        let (mark, begin) = (radau.mark(), self.point());
        for attempt in 0.. {
            radau.step()?;
            let followed = self.follow(radau);
            match self.shorter(radau).filter(|_| followed.is_ok() && attempt < MOST_ATTEMPTS) {
                Some(h) => {
                    radau.retry_from(&mark, h);
                    self.restore(&begin);
                }
                None => return Ok(followed),
            }
        }
        Ok(Ok(()))
    }

    /// Updates the derivatives of the states over the last accepted step of a run.
    fn follow(&mut self, radau: &mut Radau<'_>) -> Result<(), NoDerivative> {
        self.error = None;
        if !radau.last.is_smooth {
            return Err(NoDerivative::Unlocated);
        }
        self.before.copy_from(&self.now);
        let tableau = radau.orders.last().tableau;
        self.solve_stages(&radau.last, tableau)?;
        self.find_slopes(&radau.last, tableau);
        if let Some(last) = self.stages.last() {
            self.now.copy_from(last);
        }
        self.remember_largest();
        self.limit_step(radau);
        if radau.jumped().is_some() {
            return Err(NoDerivative::Jump);
        }
        if radau.continues || radau.is_done() {
            return Ok(());
        }
        self.slopes[1] = None;
        self.pass_switch(radau)?;
        self.remember_largest();
        self.limit_first_step(radau);
        Ok(())
    }

    /// Writes the derivatives of a state at a time within the last step of the run, one per direction.
    pub fn write(&self, radau: &Radau<'_>, t: f64, state: usize, out: &mut [f64]) {
        let Step { t: begin, h, .. } = radau.last;
        let is_known = t < radau.t() && !self.stages.is_empty();
        if !is_known {
            out.iter_mut().zip(self.now.row(state).iter()).for_each(|(out, value)| *out = *value);
            return;
        }
        let tableau: &Tableau = radau.orders.last().tableau;
        let mut weights = vec![0.0; tableau.stages()];
        let theta = (t - begin) / h;
        tableau.increments_at(theta, &mut weights);
        for (direction, out) in out.iter_mut().enumerate() {
            let first = self.before[(state, direction)];
            let stages = weights.iter().zip(&self.stages);
            *out = first + stages.map(|(weight, stage)| weight * (stage[(state, direction)] - first)).sum::<f64>();
            if let Some(lacking) = &self.slopes[0] {
                *out += tableau.bubble_at(theta) * lacking[(state, direction)];
            }
        }
    }

    /// Sets the slope that the polynomial through the derivatives at the stages of a step lacks at the beginning,
    /// times the step size, and the slope at the end. The slope at the beginning is that of the rates if there are no
    /// variables, and otherwise that at the end of the step before.
    fn find_slopes(&mut self, step: &Step, tableau: &Tableau) {
        let combine = |weight: &dyn Fn(usize) -> f64, stages: &[DMatrix<f64>], first: &DMatrix<f64>| {
            let mut sum = DMatrix::zeros(first.nrows(), first.ncols());
            stages.iter().enumerate().for_each(|(j, stage)| sum += (stage - first) * weight(j));
            sum
        };
        let begin = match self.mass.nrows() == step.y.len() {
            true => {
                let before = self.before.clone();
                self.slopes_at(step.t, &step.y, &before)
            }
            false => self.slopes[1].take(),
        };
        let begin = begin.map(|slope| slope * step.h);
        let (at_begin, at_end) = (tableau.begin_weights(), tableau.end_weights(step.h));
        let lacking = begin.map(|begin| begin - combine(&|j| at_begin[j], &self.stages, &self.before));
        self.slopes = [lacking, Some(combine(&|j| at_end[j], &self.stages, &self.before))];
    }

    /// Returns the slopes (time derivatives) of the derivatives `states` of the states at `(t, y)`, if there are no
    /// variables.
    fn slopes_at(&mut self, t: f64, y: &[f64], states: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let (rows, (rates, _)) = (self.rows_at(t, y), self.rates(t, y));
        let mut right = rows.by_y * states + rows.by_directions;
        for &((row, column), direction, value) in &self.directions.mass {
            right[(row, direction)] -= value * rates[column];
        }
        self.inverse_mass.solve(&right)
    }

    fn count(&self) -> usize {
        self.now.ncols()
    }

    /// Continues the derivatives of the states across a switch or breakpoint at the end of a step.
    fn pass_switch(&mut self, radau: &mut Radau<'_>) -> Result<(), NoDerivative> {
        for Saltation { jump, times } in self.saltations(radau)? {
            for (direction, time) in times.iter().enumerate() {
                for (i, jump) in jump.iter().enumerate() {
                    let now = &mut self.now[(i, direction)];
                    if let Some(Terms { now: terms, .. }) = &mut self.terms {
                        let terms = &mut terms[(i, direction)];
                        *terms = terms.max(now.abs() + (jump * time).abs());
                    }
                    *now += jump * time;
                }
            }
        }
        Ok(())
    }

    /// Returns the changes of the derivatives at a switch or breakpoint at the end of a step: one change for each
    /// independent switch; none if the rates do not jump.
    fn saltations(&mut self, radau: &mut Radau<'_>) -> Result<Vec<Saltation>, NoDerivative> {
        let (before, after) = (radau.before_switch(), radau.y().to_vec());
        let ends = [radau.last.t + radau.last.h, radau.t()];
        let [(left, terms), (right, _)] = [self.rates(ends[0], &before), self.rates(ends[1], &after)];
        let jump: Vec<f64> = left.iter().zip(&right).map(|(left, right)| left - right).collect();
        let none = |i: usize| CONTINUOUS * terms[i].max(left[i].abs()).max(right[i].abs());
        let none: Vec<f64> = (0..jump.len()).map(none).collect();
        if jump.iter().zip(&none).all(|(jump, none)| jump.abs() <= *none) {
            return Ok(Vec::new());
        }
        self.switches(radau, ends, Jump { ends: [&before, &after], by: &jump, none: &none })
    }

    /// Returns the rates `M^-1 F` at the point `(t, y)`, and the largest term of each row.
    fn rates(&mut self, t: f64, y: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let n = self.mass.nrows();
        let mut values = vec![0.0; self.problem.structure().rows()];
        self.problem.evaluate(t, y, &mut values);
        let mut rates = DMatrix::from_column_slice(n, 1, &values[..n]);
        self.inverse_mass.solve_mut(&mut rates);
        let structure = self.problem.structure();
        let pattern = structure.pattern.clone();
        let mut derivatives = vec![0.0; pattern.len()];
        self.problem.jacobian(t, y, &mut derivatives);
        let mut terms = vec![0.0; n];
        for (&(row, column), value) in pattern.iter().zip(&derivatives).filter(|((row, _), _)| *row < n) {
            terms[row] = f64::max(terms[row], (value * y[column]).abs());
        }
        let scale = terms.iter().fold(0.0_f64, |most, term| most.max(*term));
        if self.problem.structure().mass != Mass::Identity {
            terms.fill(scale);
        }
        (rates.as_slice().to_vec(), terms)
    }
}

/// The derivatives at a saved point of a run, to which the computation of derivatives can return.
struct Point {
    now: DMatrix<f64>,
    largest: DMatrix<f64>,
    /// The slope (time derivative) of the derivatives at the end of the last step.
    slope: Option<DMatrix<f64>>,
}

/// The change `(x'- - x'+) dtau` of the derivatives at a jump of the rates whose time `tau` depends on the
/// directions.
struct Saltation {
    /// The jump `x'- - x'+` of the rates of the states.
    jump: Vec<f64>,
    /// The derivatives of the time of the jump, one per direction.
    times: Vec<f64>,
}

/// Returns the variables whose activity differs between two faces.
fn changed(from: &[Activity], to: &[Activity]) -> Vec<usize> {
    (0..from.len()).filter(|&k| from[k] != to[k]).collect()
}
