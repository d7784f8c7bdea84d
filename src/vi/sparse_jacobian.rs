//! The sparse Jacobian `F'(z)` of a nonlinear variational inequality, and factors of the Jacobian with rows scaled
//! and a diagonal added; all have one sparsity pattern, which is analysed once.

use super::{Terms, Worst};
use factorisation::{Analysis, SparseLu, SparseMatrix};
use faer::sparse::Triplet;
use problem::{Control, ConvexSet};

/// A diagonal entry of the Jacobian below this fraction of the largest entry of its row is too small to scale the row
/// by.
const SMALL_DIAGONAL: f64 = 1.0 / 64.0;

/// A nonlinear variational inequality with a sparse Jacobian.
pub trait SparseVi {
    /// Returns the set `K`, of dimension `m`.
    fn set(&self) -> &ConvexSet;

    /// Returns the positions `(row, column)` of `F'` that may be nonzero.
    fn pattern(&self) -> &[(usize, usize)];

    /// Whether the Jacobian `F'` is constant.
    fn is_affine(&self) -> bool {
        false
    }

    /// Returns the shape of the grid whose nodes are the variables, with the last index fastest; `None` if there is
    /// no grid.
    fn grid(&self) -> Option<Vec<usize>> {
        None
    }

    /// Writes the function `F(z)`, of length `m`. Undefined components are NaN or infinite.
    fn evaluate(&mut self, z: &[f64], f: &mut [f64]);

    /// Writes the entries of the Jacobian `F'(z)`, in the order of the pattern.
    fn derivatives(&mut self, z: &[f64], values: &mut [f64]);
}

/// Evaluates `F(z)`, the entries of `F'(z)`, and the sizes of the terms of `F`.
pub(super) fn evaluated(vi: &mut dyn SparseVi, z: &[f64]) -> (Vec<f64>, Vec<f64>, Terms) {
    let mut f = vec![0.0; z.len()];
    let mut derivatives = vec![0.0; vi.pattern().len()];
    vi.evaluate(z, &mut f);
    vi.derivatives(z, &mut derivatives);
    let entries = vi.pattern().iter().copied().zip(derivatives.iter().copied());
    let terms = Terms::of(vi.set(), (z, &f), entries);
    (f, derivatives, terms)
}

/// The sparse Jacobian `F'` and the factors of a system built from it.
pub(super) struct SparseJacobian {
    /// The Jacobian `F'`, with an entry stored for each diagonal position.
    matrix: SparseMatrix,
    /// The index of each entry of the pattern among the stored values of the matrix (`places`), and of each diagonal
    /// entry (`diagonal`).
    places: Vec<usize>,
    diagonal: Vec<usize>,
    system: SparseMatrix,
    factors: SparseLu<f64>,
    derivatives: Vec<f64>,
}

impl SparseJacobian {
    /// Allocates the Jacobian and the factors for `m` variables and a sparsity pattern; returns `None` if the factors
    /// do not fit into memory, or `control` asks to stop.
    pub fn new(m: usize, pattern: &[(usize, usize)], control: &Control) -> Option<Self> {
        let entries = pattern.iter().copied().chain((0..m).map(|i| (i, i)));
        let triplets: Vec<Triplet<usize, usize, f64>> = entries.map(|(i, j)| Triplet::new(i, j, 0.0)).collect();
        let matrix = SparseMatrix::try_new_from_triplets(m, m, &triplets).ok()?;
        let place = |(i, j): (usize, usize)| {
            let range = matrix.symbolic().col_range(j);
            let rows = &matrix.symbolic().row_idx()[range.clone()];
            rows.binary_search(&i).ok().map(|at| range.start + at)
        };
        let places = pattern.iter().map(|&at| place(at)).collect::<Option<Vec<usize>>>()?;
        let diagonal = (0..m).map(|i| place((i, i))).collect::<Option<Vec<usize>>>()?;
        let analysis = Analysis::new_unless(matrix.symbolic(), || control.poll().is_some())?;
        Some(Self {
            system: matrix.clone(),
            matrix,
            factors: SparseLu::new(&analysis)?,
            derivatives: vec![0.0; places.len()],
            places,
            diagonal,
        })
    }

    /// Evaluates the Jacobian `F'(z)`; returns false if an entry is not finite.
    pub fn evaluate(&mut self, vi: &mut dyn SparseVi, z: &[f64]) -> bool {
        vi.derivatives(z, &mut self.derivatives);
        let (_, values) = self.matrix.parts_mut();
        values.fill(0.0);
        self.places.iter().zip(&self.derivatives).for_each(|(&place, value)| values[place] += value);
        values.iter().all(|value| value.is_finite())
    }

    /// Computes the row scales `S` that bring `z` and `S F` to one unit: the inverse of the diagonal entry if it is
    /// large enough, otherwise of the largest entry of the row.
    pub fn scales(&self, scale: &mut [f64]) {
        let mut largest = vec![0.0_f64; scale.len()];
        for (&i, a) in self.matrix.symbolic().row_idx().iter().zip(self.matrix.val()) {
            largest[i] = largest[i].max(a.abs());
        }
        for ((scale, largest), &place) in scale.iter_mut().zip(&largest).zip(&self.diagonal) {
            let own = self.matrix.val()[place].abs();
            let size = if own >= SMALL_DIAGONAL * largest { own } else { *largest };
            *scale = if size > 0.0 { size.recip() } else { 1.0 };
        }
    }

    /// Returns the entries of column `j` of the Jacobian, with their rows.
    pub fn column(&self, j: usize) -> impl Iterator<Item = (&usize, &f64)> {
        self.matrix.symbolic().row_idx_of_col_raw(j).iter().zip(self.matrix.val_of_col(j))
    }

    /// Returns the component with the worst residual at a point `z` with the value `F(z)`, where the Jacobian was
    /// evaluated last.
    pub fn worst(&self, set: &ConvexSet, (z, f): (&[f64], &[f64])) -> Worst {
        let entries = (0..z.len()).flat_map(|j| self.column(j).map(move |(&i, a)| ((i, j), *a)));
        Worst::of(set, (z, f), &Terms::of(set, (z, f), entries))
    }

    /// Factorises the system whose row `i` is row `i` of `F'` times the first number of `row(i)`, with the second
    /// number added to the diagonal.
    pub fn factorise(&mut self, row: impl Fn(usize) -> (f64, f64), control: &Control) -> bool {
        let (symbolic, values) = self.system.parts_mut();
        for ((value, a), &i) in values.iter_mut().zip(self.matrix.val()).zip(symbolic.row_idx()) {
            *value = row(i).0 * a;
        }
        for (i, &place) in self.diagonal.iter().enumerate() {
            values[place] += row(i).1;
        }
        self.factors.factorise_unless(&self.system, || control.poll().is_some())
    }

    /// Solves the factorised linear system in place of its right-hand side; returns false if the solution is not
    /// finite.
    pub fn solve(&mut self, right: &mut [f64]) -> bool {
        self.factors.solve(right)
    }
}
