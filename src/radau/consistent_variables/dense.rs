//! The equations for the consistent variables of a small system, with the states eliminated.

use super::super::screening::contraction::{Enclosed, Errors};
use super::super::system::System;
use factorisation::{Singular, equilibrated};
use nalgebra::{DMatrix, DVector, Dyn, LU};
use numerics::Interval;
use problem::{Face, Mass};

pub(super) struct Dense {
    /// LU factors of the mass matrix `M`; `None` for the identity.
    mass: Option<LU<f64, Dyn, Dyn>>,
    /// Inverse of the mass matrix `M`; `None` for the identity.
    pub inverse_mass: Option<DMatrix<f64>>,
    /// Index of each variable among the free variables; `usize::MAX` for variables that are not free.
    place: Vec<usize>,
    /// The linear response of the free variables to residuals that was computed last.
    response: Option<Response>,
}

impl Dense {
    /// Factorises the mass matrix `M`; returns `None` if it is singular.
    pub fn new(system: &System<'_>) -> Option<Self> {
        let n = system.states;
        let mass = match system.mass() {
            Mass::Identity => None,
            Mass::Constant(entries) => {
                let mut mass = DMatrix::zeros(n, n);
                entries.iter().for_each(|&(i, j, value)| mass[(i, j)] += value);
                if !mass.clone().full_piv_lu().is_invertible() {
                    return None;
                }
                Some(mass.lu())
            }
        };
        let inverse_mass = mass.as_ref().and_then(|mass| mass.try_inverse());
        Some(Self { mass, inverse_mass, place: vec![usize::MAX; system.unknowns - n], response: None })
    }

    /// Computes a bound on the distance of each free variable from the solution of its equations, if `G` has the
    /// magnitudes `sizes` and the hidden constraints the magnitudes `hidden`, with the current derivatives of
    /// `system`. Returns false if the equations are singular.
    pub fn errors(
        &mut self,
        system: &System<'_>,
        inside: &[usize],
        sizes: &[f64],
        hidden: &[f64],
        out: &mut [f64],
    ) -> bool {
        let Some(response) = self.response(system, inside) else { return false };
        inside.iter().for_each(|&k| out[k] = 0.0);
        let columns = response.to_g.column_iter().zip(response.to_hidden.column_iter());
        for (&l, (to_g, to_hidden)) in inside.iter().zip(columns) {
            for ((&k, to_g), to_hidden) in inside.iter().zip(to_g.as_slice()).zip(to_hidden.as_slice()) {
                out[k] += to_g.abs() * sizes[l] + to_hidden.abs() * hidden[l];
            }
        }
        true
    }

    /// Computes the bounds of [`Self::errors`] for derivatives that are enclosed over a box in `jacobian`; `None` if
    /// the equations are singular.
    pub fn errors_over(
        &mut self,
        system: &System<'_>,
        inside: &[usize],
        jacobian: &[Interval],
        (sizes, hidden): (&[f64], &[f64]),
    ) -> Option<Errors> {
        let (n, count) = (system.states, inside.len());
        let place = |k: usize| inside.binary_search(&k).ok();
        let (mut d, mut c, mut b) =
            (Enclosed::zeros(count, count), Enclosed::zeros(count, n), Enclosed::zeros(n, count));
        for ((i, j, _), &value) in system.entries().zip(jacobian) {
            let column = j.checked_sub(n).and_then(place);
            match (i.checked_sub(n).filter(|_| i < system.unknowns).map(place), column) {
                (Some(Some(row)), Some(column)) => d.add((row, column), value),
                (Some(Some(row)), None) if j < n => c.add((row, j), value),
                (None, Some(column)) if i < n => b.add((i, column), value),
                _ => {}
            }
        }
        if let Some(inverse) = &self.inverse_mass {
            b = b.combined(inverse);
        }
        let response = self.response(system, inside)?;
        let (of_g, of_hidden) = (d.combined(&response.to_g), c.times(&b).combined(&response.to_hidden));
        let matrix = Enclosed { middle: of_g.middle + of_hidden.middle, radius: of_g.radius + of_hidden.radius };
        let of = |values: &[f64]| DVector::from_iterator(count, inside.iter().map(|&k| values[k]));
        Some(matrix.errors(&(response.to_g.abs() * of(sizes) + response.to_hidden.abs() * of(hidden))))
    }

    /// Returns the linear response of the free variables to residuals in `G` and in the hidden constraints, with the
    /// current derivatives of `system`; `None` if the equations are singular.
    pub fn response(&mut self, system: &System<'_>, inside: &[usize]) -> Option<&Response> {
        if !self.is_known(system, inside) {
            self.response = self.response_of(system, inside);
        }
        self.response.as_ref()
    }

    /// Whether the stored linear response of the variables is that of the present active face, free variables and
    /// derivatives.
    pub fn is_known(&self, system: &System<'_>, inside: &[usize]) -> bool {
        self.response.as_ref().is_some_and(|known| {
            known.jacobians == system.work.jacobians && known.inside == inside && known.blocks == system.face.blocks
        })
    }

    fn response_of(&mut self, system: &System<'_>, inside: &[usize]) -> Option<Response> {
        let Blocks { mut d, derivative, .. } = self.blocks(system, inside)?;
        let count = inside.len();
        // Equations in `z` alone have a unit of their own; scale them to the magnitude of the rows of `G`.
        let of_z: Vec<usize> = (0..count).filter(|&row| system.is_constraint(inside[row])).collect();
        let rest = (0..count).filter(|row| !of_z.contains(row)).map(|row| d.row(row).amax()).fold(0.0, f64::max);
        if rest > 0.0 {
            of_z.iter().for_each(|&row| d.row_mut(row).scale_mut(rest));
        }
        let (rank, combinations) = combinations(&d, system.set.has_blocks())?;
        let (mut matrix, mut of_g, mut of_hidden) =
            (d.clone(), DMatrix::zeros(count, count), DMatrix::zeros(count, count));
        for (row, left) in combinations.row_iter().enumerate() {
            let (from, of) = if row < rank { (&d, &mut of_g) } else { (&derivative, &mut of_hidden) };
            matrix.set_row(row, &(left * from));
            of.set_row(row, &left);
        }
        let inverse = matrix.try_inverse().filter(|inverse| inverse.iter().all(|entry| entry.is_finite()))?;
        let (to_g, to_hidden) = (&inverse * of_g, inverse * of_hidden);
        let (inside, blocks) = (inside.to_vec(), system.face.blocks.clone());
        Some(Response { jacobians: system.work.jacobians, inside, blocks, to_g, to_hidden })
    }

    /// Computes the Newton step of the free variables, to be subtracted from them, at the point of the last
    /// evaluation of `system`; returns false if the equations are singular.
    pub fn solve(
        &mut self,
        system: &System<'_>,
        inside: &[usize],
        phi: &[f64],
        drift: &[f64],
        step: &mut [f64],
    ) -> bool {
        let Some(solution) = self.newton_step(system, inside, phi, drift) else { return false };
        step.copy_from_slice(solution.as_slice());
        true
    }

    fn newton_step(
        &mut self,
        system: &System<'_>,
        inside: &[usize],
        phi: &[f64],
        drift: &[f64],
    ) -> Option<DVector<f64>> {
        let n = system.states;
        let Blocks { d, c, derivative } = self.blocks(system, inside)?;
        let g = DVector::from_fn(inside.len(), |a, _| phi[n + inside[a]]);
        let mut rates = DVector::from_column_slice(&phi[..n]);
        if let Some(mass) = &self.mass
            && !mass.solve_mut(&mut rates)
        {
            return None;
        }
        let hidden = DVector::from_fn(inside.len(), |a, _| drift[inside[a]]) + &c * rates;
        let (matrix, right) = if d.amax() == 0.0 {
            (derivative, hidden)
        } else {
            combine((&d, system.set.has_blocks()), &g, &derivative, &hidden)?
        };
        matrix.lu().solve(&right)
    }

    /// Computes the matrices of the equations of the free variables; returns `None` if the mass matrix `M` is
    /// singular.
    fn blocks(&mut self, system: &System<'_>, inside: &[usize]) -> Option<Blocks> {
        let (n, count) = (system.states, inside.len());
        let place = &mut self.place;
        place.fill(usize::MAX);
        for (a, &k) in inside.iter().enumerate() {
            place[k] = a;
        }
        let mut d = DMatrix::<f64>::zeros(count, count);
        let mut c = DMatrix::<f64>::zeros(count, n);
        let mut b = DMatrix::<f64>::zeros(n, count);
        system.visit_derivatives(&system.face, |i, j, _, value| {
            let column = if j >= n { place[j - n] } else { usize::MAX };
            if i < n {
                if column != usize::MAX {
                    b[(i, column)] += value;
                }
            } else if place[i - n] != usize::MAX {
                let row = place[i - n];
                if j < n {
                    c[(row, j)] += value;
                } else if column != usize::MAX {
                    d[(row, column)] += value;
                }
            }
        });
        if let Some(mass) = &self.mass
            && !mass.solve_mut(&mut b)
        {
            return None;
        }
        let derivative = &c * b;
        Some(Blocks { d, c, derivative })
    }
}

/// The matrices `D = G_z`, `C = G_x` and `C M^-1 F_z` of the equations of the free variables.
struct Blocks {
    d: DMatrix<f64>,
    c: DMatrix<f64>,
    derivative: DMatrix<f64>,
}

/// Linear response of the variables to residuals of the equations of the face and of the hidden constraints: the
/// error of the variables is `to_g Phi + to_hidden dPhi/dt`, except for equations in `z` alone, whose columns have
/// other units.
pub struct Response {
    jacobians: u64,
    pub inside: Vec<usize>,
    blocks: Vec<Face>,
    pub to_g: DMatrix<f64>,
    pub to_hidden: DMatrix<f64>,
}

/// Relative rank threshold: singular values below this fraction of the largest count as zero.
const RANK: f64 = 1e-10;

/// Returns the rank of `D`, and combinations of its rows, those that do not vanish first. Since rows and columns have
/// different units, both are those of the equilibrated matrix. With blocks, `D` is not equilibrated: the variables of
/// a block have one unit, and rows on curved faces may consist of rounding errors.
fn combinations(d: &DMatrix<f64>, has_blocks: bool) -> Option<(usize, DMatrix<f64>)> {
    let (scaled, of_rows, _) = match has_blocks {
        true => (d.clone(), vec![1.0; d.nrows()], Vec::new()),
        false => equilibrated(d.clone()),
    };
    let range = Singular::of(&scaled)?;
    let mut combinations = range.u.transpose();
    combinations.column_iter_mut().zip(of_rows).for_each(|(mut column, scale)| column.scale_mut(scale));
    Some((range.rank(RANK), combinations))
}

/// Returns the matrix and the right-hand side of the equations for the consistent variables: as many combinations of
/// the rows of `D`, with the right-hand side `g`, as `D` has rank, and combinations of the rows of the hidden
/// constraints (`derivative`, with the right-hand side `hidden`) for the left null space of `D`.
fn combine(
    (d, has_blocks): (&DMatrix<f64>, bool),
    g: &DVector<f64>,
    derivative: &DMatrix<f64>,
    hidden: &DVector<f64>,
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let (rank, combinations) = combinations(d, has_blocks)?;
    let (mut matrix, mut right) = (d.clone(), g.clone());
    for (row, left) in combinations.row_iter().enumerate() {
        let (from, value) = if row < rank { (d, g) } else { (derivative, hidden) };
        matrix.set_row(row, &(left * from));
        right[row] = (left * value)[0];
    }
    Some((matrix, right))
}
