//! Assembly of the operator matrix `A(t)` from coefficients at element centres, with exponential fitting: along each
//! direction, the diffusion `a` is raised to
//!
//! ```text
//! a* = a p coth p,    p = |b| h / (2a),
//! ```
//!
//! with the advection `b` and the element length `h`, so that in one dimension with constant `a`, `b` and `f` the
//! nodal values of a stationary `u` are exact (Allen and Southwell 1955; Scharfetter and Gummel 1969). The method is
//! of second order if the grid resolves `a / b`, and free of oscillations otherwise. With nodal quadrature,
//! off-diagonal entries are never positive.

use super::semidiscrete::{finite, go_on};
use super::{Field, Obstacle, ObstacleDataError, ObstacleError};
use crate::finite_elements::{Assembly, Element};
use factorisation::SparseMatrix;
use nalgebra::DMatrix;
use problem::Control;

/// Assembles the operator matrix `A` at time `t`; `matrix` must be zero.
///
/// # Errors
/// If a coefficient is not finite, if diffusion is negative, or if `control` asks to stop.
pub(super) fn stiffness(
    problem: &mut Obstacle,
    mut matrix: Assembly,
    t: f64,
    control: &Control,
) -> Result<SparseMatrix, ObstacleError> {
    let Obstacle { grid, quadrature, diffusion, advection, reaction, .. } = problem;
    let element = Element::of(grid, *quadrature);
    let directions = 0..grid.dimension();
    let gradients: Vec<DMatrix<f64>> = directions.clone().map(|q| element.gradients(q, q)).collect();
    let derivatives: Vec<DMatrix<f64>> = directions.clone().map(|q| element.derivative(q)).collect();
    let mass = element.mass();
    let mut local = DMatrix::zeros(mass.nrows(), mass.ncols());
    let add = |local: &mut DMatrix<f64>, factor: f64, matrix: &DMatrix<f64>| {
        local.zip_apply(matrix, |local, value| *local += factor * value);
    };
    for index in 0..grid.elements() {
        go_on(index, t, control)?;
        let at = grid.centre(index);
        local.fill(0.0);
        for q in directions.clone() {
            let (a, b) = coefficients(&mut diffusion[q], advection.get_mut(q), t, at)?;
            add(&mut local, fitted(a, b.abs() * grid.axes()[q].spacing()), &gradients[q]);
            add(&mut local, b, &derivatives[q]);
        }
        if let Some(field) = reaction {
            add(&mut local, finite("reaction", field, t, at)?, &mass);
        }
        matrix.add(index, 1.0, &local);
    }
    Ok(matrix.finish())
}

/// Checks all coefficients of the operator at time `t`.
///
/// # Errors
/// If a coefficient is not finite, if diffusion is negative, or if `control` asks to stop.
pub(super) fn check_coefficients(problem: &mut Obstacle, t: f64, control: &Control) -> Result<(), ObstacleError> {
    let Obstacle { grid, diffusion, advection, reaction, .. } = problem;
    for index in 0..grid.elements() {
        go_on(index, t, control)?;
        let at = grid.centre(index);
        for (q, diffusion) in diffusion.iter_mut().enumerate() {
            coefficients(diffusion, advection.get_mut(q), t, at)?;
        }
        if let Some(field) = reaction {
            finite("reaction", field, t, at)?;
        }
    }
    Ok(())
}

/// Returns the diffusion coefficient `a` and the advection velocity `b` along one direction.
fn coefficients(
    diffusion: &mut Field,
    advection: Option<&mut Field>,
    t: f64,
    at: [f64; 3],
) -> Result<(f64, f64), ObstacleDataError> {
    let a = finite("diffusion", diffusion, t, at)?;
    if a < 0.0 {
        return Err(ObstacleDataError::NegativeDiffusion { value: a, at, t });
    }
    let b = advection.map_or(Ok(0.0), |field| finite("advection", field, t, at))?;
    Ok((a, b))
}

/// Returns the largest element Peclet number `|b| h / (2a)` at time `t`.
///
/// # Errors
/// If `control` asks to stop.
pub fn largest_peclet(problem: &mut Obstacle, t: f64, control: &Control) -> Result<f64, ObstacleError> {
    let Obstacle { grid, diffusion, advection, .. } = problem;
    let mut largest = 0.0_f64;
    for (q, (a, b)) in diffusion.iter_mut().zip(advection).enumerate() {
        let half = 0.5 * grid.axes()[q].spacing();
        for element in 0..grid.elements() {
            go_on(element, t, control)?;
            let at = grid.centre(element);
            let flow = half * b.at(t, at).abs();
            if flow > 0.0 {
                largest = largest.max(flow / a.at(t, at));
            }
        }
    }
    Ok(largest)
}

/// Returns the exponentially fitted diffusion `a p coth p` for the Peclet number `p = flow / (2a)`, where `flow` is
/// `|b| h`.
fn fitted(a: f64, flow: f64) -> f64 {
    // For a small Peclet number `p`, `p coth p - 1 = p^2/3 - ..` is below rounding, and the formula would divide zero
    // by zero if `flow` and `a` are zero.
    if flow <= 1e-8 * a {
        return a;
    }
    // For zero diffusion `a = 0`, the Peclet number `p` is infinite and the fitted diffusion is `flow / 2`.
    0.5 * flow / (0.5 * flow / a).tanh()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fitting_spans_from_diffusion_to_upwinding() {
        assert_eq!((fitted(2.0, 0.0), fitted(0.0, 3.0), fitted(0.0, 0.0)), (2.0, 1.5, 0.0));
        assert!((fitted(1.0, 2.0) - 1.0 / 1.0_f64.tanh()).abs() < 1e-15);
        let (near, series) = (fitted(1.0, 2e-3), 1.0 + 1e-6 / 3.0);
        assert!((near - series).abs() < 1e-12, "{near} {series}");
    }
}
