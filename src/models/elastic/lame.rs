//! Hooke's law of an isotropic body: stress `s = lambda tr(e) I + 2 mu e` for the strain `e`.

use crate::finite_elements::Element;
use nalgebra::DMatrix;

/// The Lame parameters of an isotropic material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lame {
    /// The first Lame parameter `lambda` of the material.
    pub first: f64,
    /// The shear modulus `mu` of the material, its second Lame parameter.
    pub shear: f64,
}

impl Lame {
    /// Returns the Lame parameters of a one-dimensional law, stress = `modulus` times strain, where `modulus` is
    /// Young's modulus of a bar, or the tension of a string.
    pub fn axial(modulus: f64) -> Self {
        Self { first: modulus, shear: 0.0 }
    }

    /// Returns the Lame parameters of a three-dimensional body, or of a body in plane strain, from Young's modulus and
    /// Poisson's ratio.
    pub fn solid(young: f64, poisson: f64) -> Self {
        let first = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
        Self { first, shear: young / (2.0 * (1.0 + poisson)) }
    }

    /// Returns the Lame parameters of a plate in plane stress, from Young's modulus and Poisson's ratio.
    pub fn plane_stress(young: f64, poisson: f64) -> Self {
        Self { first: young * poisson / (1.0 - poisson * poisson), shear: young / (2.0 * (1.0 + poisson)) }
    }

    /// Returns the element stiffness matrix `int s(N_a e_i) : e(N_b e_j)` with shape functions `N_a` and unit vectors
    /// `e_i`, for an element with as many directions as components; the components of a corner are adjacent.
    pub fn stiffness(self, element: &Element, components: usize) -> DMatrix<f64> {
        let gradients: Vec<DMatrix<f64>> =
            (0..components * components).map(|k| element.gradients(k / components, k % components)).collect();
        let of = |i: usize, j: usize| &gradients[i * components + j];
        let corners = of(0, 0).nrows();
        DMatrix::from_fn(corners * components, corners * components, |row, column| {
            let (a, i, b, j) = (row / components, row % components, column / components, column % components);
            let all = |k: usize| of(k, k)[(a, b)];
            let laplacian = if i == j { (0..components).map(all).sum() } else { 0.0 };
            self.first * of(i, j)[(a, b)] + self.shear * (of(j, i)[(a, b)] + laplacian)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finite_elements::{Axis, Grid, Quadrature};

    #[test]
    fn a_rigid_motion_costs_nothing_and_stretching_what_hooke_says() {
        let axis = |upper| Axis { lower: 0.0, upper, elements: 1 };
        let grid = Grid::new(vec![axis(2.0), axis(0.5), axis(1.5)]);
        let (young, poisson) = (1000.0, 0.3);
        let stiffness = Lame::solid(young, poisson).stiffness(&Element::of(&grid, Quadrature::Exact), 3);
        let energy = |u: &dyn Fn([f64; 3]) -> [f64; 3]| {
            let u = nalgebra::DVector::from_iterator(24, (0..8).flat_map(|node| u(grid.coordinates(node))));
            0.5 * (u.transpose() * &stiffness * u)[0]
        };
        assert!(energy(&|[x, y, z]| [1.0 - y + z, x, 2.0 - x]).abs() < 1e-10);
        // The state of uniaxial stress along `x`: strain 1 along `x`, and `-nu` (Poisson's ratio) across.
        let volume = 2.0 * 0.5 * 1.5;
        assert!((energy(&|[x, y, z]| [x, -poisson * y, -poisson * z]) - 0.5 * young * volume).abs() < 1e-10);
        // A pure shear by the angle 1 has the energy density `shear / 2`, with the shear modulus `shear`.
        let shear = young / (2.0 * (1.0 + poisson));
        assert!((energy(&|[_, y, _]| [y, 0.0, 0.0]) - 0.5 * shear * volume).abs() < 1e-10);
    }

    #[test]
    fn a_plate_stretches_freely_across_where_a_solid_does_not() {
        let axis = || Axis { lower: 0.0, upper: 1.0, elements: 1 };
        let grid = Grid::new(vec![axis(), axis()]);
        let energy = |lame: Lame| {
            let stiffness = lame.stiffness(&Element::of(&grid, Quadrature::Exact), 2);
            let u = nalgebra::DVector::from_iterator(8, (0..4).flat_map(|node| [grid.coordinates(node)[0], 0.0]));
            (u.transpose() * stiffness * u)[0]
        };
        assert!((energy(Lame::plane_stress(1.0, 0.25)) - 1.0 / (1.0 - 0.0625)).abs() < 1e-14);
        assert!((energy(Lame::solid(1.0, 0.25)) - 0.75 / (1.25 * 0.5)).abs() < 1e-14);
    }
}
