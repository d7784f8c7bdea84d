//! A problem with the active face of `K` held fixed: the differential-algebraic system
//!
//! ```text
//! diag(M, 0) y' = Phi(t, y),    Phi = (F, G_i or l_i - z_i or u_i - z_i),    y = (x, z)
//! ```
//!
//! and the counters of what was evaluated.

use super::face::Place;
use super::layout::Layout;
use super::settings::StepError;
use crate::problem::{ConvexSet, Dvi, Mass, Side, Workspace};
use std::sync::Arc;

/// What was evaluated, and how often.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Evaluations of `F` and `G`.
    pub rates: u64,
    /// Evaluations of their derivatives.
    pub jacobians: u64,
    /// Factorisations, a real and a complex one counted as one each.
    pub factorisations: u64,
    /// Newton iterations on the stages.
    pub newton: u64,
    /// How fast its increments shrank.
    pub contraction: Rates,
}

/// The rates of convergence of Newton's method, where it took more than one iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    count: u64,
    sum: f64,
    largest: f64,
}

impl Rates {
    /// Takes a rate into account: the factor from one increment to the next.
    pub fn observe(&mut self, rate: f64) {
        self.count += 1;
        self.sum += rate;
        self.largest = self.largest.max(rate);
    }

    /// The mean and the largest; none where no rate was seen.
    pub fn summary(&self) -> Option<(f64, f64)> {
        (self.count > 0).then(|| (self.sum / self.count as f64, self.largest))
    }
}

/// A problem on a face, with room for one evaluation and one Jacobian.
pub struct System<'p> {
    problem: &'p mut dyn Dvi,
    /// `n`
    pub states: usize,
    /// `n + m`
    pub unknowns: usize,
    /// `M` as `(row, column, value)`; none where it is the identity.
    pub mass: Option<Vec<(usize, usize, f64)>>,
    /// The diagonal of `M`.
    pub mass_diagonal: Vec<f64>,
    /// Where the matrices of the stage equations stand in memory.
    pub layout: Arc<Layout>,
    /// `K`, its moving bounds as of the last evaluation.
    pub set: ConvexSet,
    workspace: Workspace,
    /// Variables with a bound; the others are algebraic states.
    pub bounded: Vec<usize>,
    /// The active face, a place a variable.
    pub face: Vec<Place>,
    /// Rows `F`, `G`, moving bounds as of the last evaluation.
    pub values: Vec<f64>,
    /// Where each row of the Jacobian starts among its nonzeros.
    row_starts: Vec<usize>,
    /// Nonzeros of the Jacobian as of the last evaluation.
    pub derivatives: Vec<f64>,
    /// Counters.
    pub work: Work,
}

impl<'p> System<'p> {
    /// Wraps a problem; every bounded variable starts on a bound.
    ///
    /// # Errors
    /// If its matrices would not fit into memory.
    pub fn new(problem: &'p mut dyn Dvi) -> Result<Self, StepError> {
        let structure = problem.structure();
        let (n, unknowns) = (structure.states, structure.unknowns());
        let mut mass_diagonal = vec![0.0; n];
        let mass = match &structure.mass {
            Mass::Identity => None,
            Mass::Constant(entries) => Some(entries.clone()),
        };
        match &mass {
            None => mass_diagonal.fill(1.0),
            Some(entries) => {
                for &(i, _, value) in entries.iter().filter(|(i, j, _)| i == j) {
                    mass_diagonal[i] += value;
                }
            }
        }
        let mut set = structure.set.clone();
        for moving in &structure.moving {
            // A finite stand-in until the first evaluation: the end exists.
            moving.place(0.0, &mut set);
        }
        let bounded: Vec<usize> = (0..structure.variables).filter(|&k| !set.is_free(k)).collect();
        let face = (0..structure.variables)
            .map(|k| match (set.lower[k].is_finite(), set.upper[k].is_finite()) {
                _ if set.block_of(k).is_some() => Place::Boundary,
                (true, _) => Place::Lower,
                (false, true) => Place::Upper,
                (false, false) => Place::Inside,
            })
            .collect();
        let (rows, nonzeros) = (structure.rows(), structure.pattern.len());
        let row_starts = (0..=rows).map(|row| structure.pattern.partition_point(|&(i, _)| i < row)).collect();
        let layout = Arc::new(Layout::new(structure, &bounded)?);
        Ok(Self {
            problem,
            states: n,
            unknowns,
            mass,
            mass_diagonal,
            layout,
            set,
            workspace: Workspace::default(),
            bounded,
            face,
            values: vec![0.0; rows],
            row_starts,
            derivatives: vec![0.0; nonzeros],
            work: Work::default(),
        })
    }

    /// The problem itself.
    pub fn problem(&mut self) -> &mut dyn Dvi {
        self.problem
    }

    /// Whether one Jacobian serves for all `(t, y)`.
    pub fn constant_jacobian(&self) -> bool {
        self.problem.structure().constant_jacobian
    }

    /// Evaluates `F`, `G` and the bounds at `(t, y)`; false if a number is not finite.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> bool {
        self.work.rates += 1;
        self.problem.evaluate(t, y, &mut self.values);
        for (p, moving) in self.problem.structure().moving.iter().enumerate() {
            moving.place(self.values[self.unknowns + p], &mut self.set);
        }
        self.values.iter().all(|value| value.is_finite())
    }

    /// Evaluates `Phi` at `(t, y)` on the present face into `phi`; false if a number is not finite.
    pub fn phi(&mut self, t: f64, y: &[f64], phi: &mut [f64]) -> bool {
        let finite = self.evaluate(t, y);
        phi.copy_from_slice(&self.values[..self.unknowns]);
        for &k in &self.bounded {
            match self.face[k] {
                Place::Lower => phi[self.states + k] = self.set.lower[k] - y[self.states + k],
                Place::Upper => phi[self.states + k] = self.set.upper[k] - y[self.states + k],
                Place::Inside => {}
                Place::Held | Place::Boundary | Place::Vertex => phi[self.states + k] = 0.0,
            }
        }
        finite
    }

    /// Puts the variables of `y = (x, z)` into `K` as of the last evaluation.
    pub fn project(&mut self, y: &mut [f64]) {
        self.set.project_all(&mut y[self.states..], &mut self.workspace);
    }

    /// Evaluates the derivatives at `(t, y)`; false if a number is not finite.
    pub fn differentiate(&mut self, t: f64, y: &[f64]) -> bool {
        if self.constant_jacobian() && self.work.jacobians > 0 {
            return true;
        }
        self.work.jacobians += 1;
        self.problem.jacobian(t, y, &mut self.derivatives);
        self.derivatives.iter().all(|value| value.is_finite())
    }

    /// The partial derivatives of `G` by `t` at `(t, y)`, into `values` (m).
    pub fn time_derivative(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.problem.time_derivative(t, y, values);
    }

    /// The nonzeros of the Jacobian as of the last differentiation, as `(row, column, value)`.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.problem.structure().pattern.iter().zip(&self.derivatives).map(|(&(i, j), &value)| (i, j, value))
    }

    /// `out += factor diag(M, 0) y`
    pub fn add_mass(&self, factor: f64, y: &[f64], out: &mut [f64]) {
        let n = self.states;
        match &self.mass {
            None => {
                for (out, y) in out[..n].iter_mut().zip(y) {
                    *out += factor * y;
                }
            }
            Some(entries) => {
                for &(i, j, value) in entries {
                    out[i] += factor * value * y[j];
                }
            }
        }
    }

    /// `sum_j |dG_k/dy_j| size_j`: how large the terms of `G_k` are, in which its rounding errors are measured.
    pub fn terms(&self, k: usize, size: impl Fn(usize) -> f64) -> f64 {
        self.terms_of_row(self.states + k, size)
    }

    /// The same of the moving bounds of variable `k`.
    pub fn terms_of_bounds(&self, k: usize, size: impl Fn(usize) -> f64) -> f64 {
        let bounds = self.problem.structure().moving.iter().enumerate().filter(|(_, moving)| moving.variable == k);
        bounds.map(|(p, _)| self.terms_of_row(self.unknowns + p, &size)).sum()
    }

    fn terms_of_row(&self, row: usize, size: impl Fn(usize) -> f64) -> f64 {
        let (first, last) = (self.row_starts[row], self.row_starts[row + 1]);
        let pattern = &self.problem.structure().pattern[first..last];
        pattern.iter().zip(&self.derivatives[first..last]).map(|(&(_, j), value)| value.abs() * size(j)).sum()
    }

    /// `dG_k/dy . direction`
    pub fn slope(&self, k: usize, direction: impl Fn(usize) -> f64) -> f64 {
        let row = self.states + k;
        let (first, last) = (self.row_starts[row], self.row_starts[row + 1]);
        let pattern = &self.problem.structure().pattern[first..last];
        pattern.iter().zip(&self.derivatives[first..last]).map(|(&(_, j), value)| value * direction(j)).sum()
    }

    /// Writes `-dPhi/dy` on the face to the places of the layout, from the derivatives as they are.
    pub fn negative_jacobian(&self, face: &[Place], places: &mut [f64]) {
        places.fill(0.0);
        let n = self.states;
        let structure = self.problem.structure();
        let entries = structure.pattern.iter().zip(&self.derivatives).zip(&self.layout.jacobian);
        for ((&(i, _), &value), &place) in entries {
            let is_on_face = if i < n {
                true
            } else if i < self.unknowns {
                face[i - n] == Place::Inside
            } else {
                let moving = structure.moving[i - self.unknowns];
                match moving.side {
                    Side::Lower => face[moving.variable] == Place::Lower,
                    Side::Upper => face[moving.variable] == Place::Upper,
                    Side::Radius => false,
                }
            };
            if is_on_face {
                places[place] -= value;
            }
        }
        for (&k, &place) in self.bounded.iter().zip(&self.layout.diagonal) {
            if face[k] != Place::Inside {
                places[place] += 1.0;
            }
        }
    }
}
