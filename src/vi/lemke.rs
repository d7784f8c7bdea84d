//! Complementary pivoting for the mixed linear complementarity problem over intervals, `l <= z <= u`, after Lemke:
//!
//! ```text
//! w = A z + q + theta d,    z_i = l_i, w_i >= 0   or   l_i < z_i < u_i, w_i = 0   or   z_i = u_i, w_i <= 0
//! ```
//!
//! From a `theta` for which the start is a solution, the path of solutions is followed through changes of basis until
//! `theta = 0`, or to infinity. The motion of the entering variable ends when a basic variable reaches a bound of its
//! interval, or the entering variable its own opposite bound. For copositive-plus `A` a ray proves that no solution
//! exists (Cottle, Pang and Stone 1992, sections 4.4 and 4.9; Dirkse and Ferris 1995, *The PATH solver*, for
//! intervals).
//!
//! The path starts from the active set of the incoming `z`; if that is correct, the path has length zero. The tableau
//! of the last basis contains the inverse of the basis matrix, which refines the solution against the original data;
//! if refinement does not make the solution exact, the path restarts from the same active set in a fresh tableau.

mod path;
mod ratio;
mod start;
mod tableau;

use super::equilibration::Equilibration;
use super::{Accuracy, AffineVi, EXACT, Outcome, Report, TOLERANCE, ViSolver};
use problem::Control;
use ratio::Perturbation;
use tableau::Tableau;

/// Pivot limit of one path, large enough for Murty's exponential problems of a dozen variables.
const PIVOTS: usize = 10_000;

/// Additional pivots allowed for each variable; paths of practical problems take one to three pivots for each.
const PIVOTS_PER_VARIABLE: usize = 50;

/// Largest number of fresh tableaus in one solve: for the guessed active set, for a start without a guess, and twice
/// to repair rounding.
const ROUNDS: usize = 4;

/// Largest number of refinements of the solution against the original data.
const REFINEMENTS: usize = 3;

/// The guessed activity of a component of `z`.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Face {
    Lower,
    Inside,
    Upper,
}

/// The reason why the path of complementary pivoting ended.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Ending {
    Complementary,
    Singular,
    Ray,
    Limit,
    Interrupted,
}

/// Lemke's method of complementary pivoting.
#[derive(Debug)]
pub struct Lemke {
    equilibration: Equilibration,
    tableau: Tableau,
    perturbation: Perturbation,
    /// The bounds of the intervals of the equilibrated problem.
    lower: Vec<f64>,
    upper: Vec<f64>,
    face: Vec<Face>,
    /// The values of the nonbasic components of `z`, by index.
    resting: Vec<f64>,
    free_rows: Vec<usize>,
    free_columns: Vec<usize>,
    inside: Vec<usize>,
    w: Vec<f64>,
    terms: Vec<f64>,
    trial: Vec<f64>,
    answer_before: Vec<f64>,
    pivots: usize,
}

impl Lemke {
    /// Allocates the workspace for problems of up to `m` variables; grows for a larger one.
    pub fn new(m: usize) -> Self {
        Self {
            equilibration: Equilibration::new(m),
            tableau: Tableau::new(m),
            perturbation: Perturbation { variable: vec![0; m], sense: vec![0.0; m] },
            lower: vec![0.0; m],
            upper: vec![0.0; m],
            face: vec![Face::Lower; m],
            resting: vec![0.0; m],
            free_rows: Vec::with_capacity(m),
            free_columns: Vec::with_capacity(m),
            inside: Vec::with_capacity(m),
            w: vec![0.0; m],
            terms: vec![0.0; m],
            trial: vec![0.0; m],
            answer_before: vec![0.0; m],
            pivots: 0,
        }
    }
}

impl ViSolver for Lemke {
    fn name(&self) -> &'static str {
        "lemke"
    }

    fn solve(&mut self, vi: &AffineVi<'_>, z: &mut [f64], control: &Control) -> Report {
        if vi.set.has_blocks() {
            return Report::UNSUITABLE;
        }
        self.resize(vi.q.len());
        if !self.equilibration.fit(vi) {
            return Report::BREAKDOWN;
        }
        self.scale_intervals(vi);
        self.guess(z);
        self.pivots = 0;
        let mut failure = Outcome::Breakdown;
        let mut best: Option<Accuracy> = None;
        for _ in 0..ROUNDS {
            let (guessed, before) = (!self.inside.is_empty(), self.pivots);
            let ending = self.pivot_to_end(vi, control);
            self.answer_before.copy_from_slice(z);
            self.read(vi, z);
            let found = self.refine(vi, z);
            let stuck = best.is_some() && self.pivots == before;
            match best {
                Some(best) if best.residual.is_finite() && !found.is_closer_than(&best) => {
                    z.copy_from_slice(&self.answer_before)
                }
                _ => best = Some(found),
            }
            failure = match ending {
                Ending::Complementary | Ending::Singular => Outcome::Breakdown,
                Ending::Ray => Outcome::Ray,
                Ending::Limit => Outcome::Limit,
                Ending::Interrupted => Outcome::Interrupted,
            };
            match ending {
                Ending::Complementary if stuck || found.componentwise <= TOLERANCE => break,
                Ending::Complementary => self.adopt_faces(),
                Ending::Ray | Ending::Singular if guessed => self.forget_guess(),
                _ => break,
            }
        }
        match best {
            Some(best) if best.residual.is_finite() => best.report(failure, self.pivots),
            _ => Report { iterations: self.pivots, ..Report::BREAKDOWN },
        }
    }
}

impl Lemke {
    fn resize(&mut self, m: usize) {
        if m == self.tableau.m {
            return;
        }
        self.equilibration.resize(m);
        self.tableau.resize(m);
        self.perturbation.variable.resize(m, 0);
        self.face.resize(m, Face::Lower);
        for vector in [
            &mut self.perturbation.sense,
            &mut self.lower,
            &mut self.upper,
            &mut self.resting,
            &mut self.w,
            &mut self.terms,
            &mut self.trial,
            &mut self.answer_before,
        ] {
            vector.resize(m, 0.0);
        }
    }

    fn scale_intervals(&mut self, vi: &AffineVi<'_>) {
        for (i, &c) in self.equilibration.inverse_column.iter().enumerate() {
            self.lower[i] = vi.set.lower[i] * c;
            self.upper[i] = vi.set.upper[i] * c;
        }
    }

    fn is_free(&self, i: usize) -> bool {
        self.lower[i] == f64::NEG_INFINITY && self.upper[i] == f64::INFINITY
    }

    /// Sets the guessed active set to that of a point `z`.
    fn guess(&mut self, z: &[f64]) {
        for (i, &c) in self.equilibration.inverse_column.iter().enumerate() {
            let z = z[i] * c;
            self.face[i] = if z > self.lower[i] && z < self.upper[i] {
                Face::Inside
            } else if z >= self.upper[i] {
                Face::Upper
            } else {
                Face::Lower
            };
        }
        self.list_inside();
    }

    /// Sets the guessed active set to that of the current basis: a basic component of `z` is inside its interval.
    fn adopt_faces(&mut self) {
        for i in 0..self.tableau.m {
            self.face[i] = if self.tableau.row_of(i).is_some() {
                Face::Inside
            } else if self.resting[i] == self.upper[i] {
                Face::Upper
            } else {
                Face::Lower
            };
        }
        self.list_inside();
    }

    fn forget_guess(&mut self) {
        self.face.fill(Face::Lower);
        self.list_inside();
    }

    fn list_inside(&mut self) {
        self.inside.clear();
        for (i, &face) in self.face.iter().enumerate() {
            let bounded = self.lower[i] > f64::NEG_INFINITY || self.upper[i] < f64::INFINITY;
            if face == Face::Inside && bounded {
                self.inside.push(i);
            }
        }
    }

    /// Writes `z` from the tableau, unscaled and projected onto `K`.
    fn read(&self, vi: &AffineVi<'_>, z: &mut [f64]) {
        for (i, &c) in self.equilibration.column.iter().enumerate() {
            let scaled = self.tableau.row_of(i).map_or(self.resting[i], |row| self.tableau.value[row]);
            z[i] = vi.set.project(i, scaled * c);
        }
    }

    /// Refines the solution iteratively: recomputes `w` of the variables inside their intervals, and moves `z` by the
    /// inverse in the tableau times `-w`.
    fn refine(&mut self, vi: &AffineVi<'_>, z: &mut [f64]) -> Accuracy {
        let m = self.tableau.m;
        let mut accuracy = vi.measure(z, &mut self.w, &mut self.terms);
        for _ in 0..REFINEMENTS {
            if accuracy.componentwise <= EXACT || accuracy.residual.is_nan() {
                break;
            }
            let correction = &mut self.tableau.value;
            correction.fill(0.0);
            for c in 0..m {
                let w = self.tableau.nonbasic[c];
                if w >= m && w < 2 * m {
                    let defect = self.w[w - m] * self.equilibration.row[w - m];
                    self.tableau.advance(c, -defect);
                }
            }
            for (i, &c) in self.equilibration.column.iter().enumerate() {
                let change = self.tableau.row_of(i).map_or(0.0, |row| self.tableau.value[row]);
                self.trial[i] = vi.set.project(i, z[i] + change * c);
            }
            let trial = vi.measure(&self.trial, &mut self.w, &mut self.terms);
            if trial.componentwise.is_nan() || trial.componentwise >= accuracy.componentwise {
                break;
            }
            z.copy_from_slice(&self.trial);
            accuracy = trial;
        }
        accuracy
    }
}
