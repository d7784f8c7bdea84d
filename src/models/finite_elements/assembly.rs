//! Assembly of element matrices into a sparse matrix whose pattern is known in advance.

use super::Grid;
use factorisation::SparseMatrix;
use faer::sparse::SymbolicSparseColMat;
use nalgebra::DMatrix;

/// The nodes that a row of an assembled matrix couples with the row's own node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Neighbours {
    /// The row's own node and its neighbours along the axes: up to `2d + 1` nodes in `d` dimensions.
    AlongAxes,
    /// All nodes of the elements adjacent to the row's own node: up to `3^d` nodes in `d` dimensions.
    OfElements,
}

/// A sparse matrix over a grid, under assembly, with `components` unknowns per node; the unknowns of a node are
/// adjacent.
#[derive(Clone, Debug)]
pub struct Assembly {
    grid: Grid,
    components: usize,
    pattern: SymbolicSparseColMat<usize>,
    values: Vec<f64>,
}

impl Assembly {
    /// Creates a zero matrix with the sparsity pattern of the given neighbourhoods of nodes.
    pub fn new(grid: &Grid, components: usize, neighbours: Neighbours) -> Self {
        let nodes = grid.nodes();
        let mut starts = Vec::with_capacity(nodes * components + 1);
        let mut rows = Vec::new();
        let mut around = Vec::with_capacity(27);
        starts.push(0);
        for node in 0..nodes {
            nodes_around(grid, node, neighbours, &mut around);
            for _ in 0..components {
                rows.extend(around.iter().flat_map(|&row| (0..components).map(move |c| row * components + c)));
                starts.push(rows.len());
            }
        }
        let size = nodes * components;
        let values = vec![0.0; rows.len()];
        let pattern = SymbolicSparseColMat::new_checked(size, size, starts, None, rows);
        Self { grid: grid.clone(), components, pattern, values }
    }

    /// Adds `factor` times an element matrix to the assembled matrix; the rows and columns of the element matrix are
    /// ordered by corner of the element, then by component.
    pub fn add(&mut self, element: usize, factor: f64, local: &DMatrix<f64>) {
        let Self { grid, components, pattern, values } = self;
        let n = *components;
        for (b, column) in grid.corners(element).enumerate() {
            for (a, row) in grid.corners(element).enumerate() {
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let value = local[(a * n + i, b * n + j)];
                    if value != 0.0 {
                        let range = pattern.col_range(column * n + j);
                        let place = pattern.row_idx()[range.clone()].binary_search(&(row * n + i));
                        let place = place.expect("a pattern that holds the couplings of the local matrix");
                        values[range.start + place] += factor * value;
                    }
                }
            }
        }
    }

    /// Returns the assembled square matrix of size `nodes * components`.
    pub fn finish(self) -> SparseMatrix {
        SparseMatrix::new(self.pattern, self.values)
    }
}

/// Writes the neighbours of a node, itself included, to `around` in increasing order.
fn nodes_around(grid: &Grid, node: usize, neighbours: Neighbours, around: &mut Vec<usize>) {
    around.clear();
    let at = grid.indices(node);
    let range = |k: usize| match grid.axes().get(k) {
        Some(axis) => at[k].saturating_sub(1)..=(at[k] + 1).min(axis.nodes() - 1),
        None => 0..=0,
    };
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                let steps = x.abs_diff(at[0]) + y.abs_diff(at[1]) + z.abs_diff(at[2]);
                if neighbours == Neighbours::OfElements || steps <= 1 {
                    around.push(grid.node([x, y, z]));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finite_elements::{Axis, Element, Quadrature};

    fn grid() -> Grid {
        let axis = |upper, elements| Axis { lower: 0.0, upper, elements };
        Grid::new(vec![axis(1.0, 4), axis(2.0, 3), axis(1.5, 2)])
    }

    #[test]
    fn the_energy_of_a_linear_function_is_that_of_calculus() {
        let grid = grid();
        for (quadrature, neighbours) in
            [(Quadrature::Exact, Neighbours::OfElements), (Quadrature::Nodal, Neighbours::AlongAxes)]
        {
            let element = Element::of(&grid, quadrature);
            let mut assembly = Assembly::new(&grid, 1, neighbours);
            let local: DMatrix<f64> = (0..3).map(|k| element.gradients(k, k)).sum();
            (0..grid.elements()).for_each(|e| assembly.add(e, 2.0, &local));
            let matrix = assembly.finish();
            let u: Vec<f64> = (0..grid.nodes())
                .map(|node| {
                    let [x, y, z] = grid.coordinates(node);
                    x - 2.0 * y + 3.0 * z
                })
                .collect();
            let energy: f64 = matrix.triplet_iter().map(|entry| u[entry.row] * entry.val * u[entry.col]).sum();
            assert!((energy - 2.0 * 14.0 * 3.0).abs() < 1e-12, "{quadrature:?}: {energy}");
        }
    }

    #[test]
    fn the_components_of_a_node_stand_together() {
        let grid = grid();
        let mut assembly = Assembly::new(&grid, 2, Neighbours::OfElements);
        let local = DMatrix::from_fn(16, 16, |i, j| if i / 2 == j / 2 && i % 2 == 0 && j % 2 == 1 { 1.0 } else { 0.0 });
        (0..grid.elements()).for_each(|e| assembly.add(e, 1.0, &local));
        let matrix = assembly.finish();
        assert_eq!(matrix.nrows(), 2 * grid.nodes());
        for entry in matrix.triplet_iter().filter(|entry| *entry.val != 0.0) {
            assert_eq!((entry.row % 2, entry.col), (0, entry.row + 1));
        }
        let total: f64 = matrix.triplet_iter().map(|entry| entry.val).sum();
        assert!((total - 8.0 * grid.elements() as f64).abs() < 1e-12);
    }
}
