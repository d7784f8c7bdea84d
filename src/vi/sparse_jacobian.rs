//! The sparse derivative of a nonlinear variational inequality, `F'(z)`, and factors of it with rows scaled and a diagonal added:
//! of one pattern, which is analysed once.

use super::{Terms, Worst};
use factorisation::{Analysis, SparseLu, SparseMatrix};
use faer::sparse::Triplet;
use problem::{Control, ConvexSet};

/// A diagonal entry below this part of the largest in its row says nothing about the scale of the row.
const SMALL_DIAGONAL: f64 = 1.0 / 64.0;

/// A nonlinear variational inequality with a sparse derivative.
pub trait SparseVi {
    /// `K`, of dimension `m`.
    fn set(&self) -> &ConvexSet;

    /// The places of `F'` that may be nonzero, as `(row, column)`.
    fn pattern(&self) -> &[(usize, usize)];

    /// Whether `F'` is constant.
    fn is_affine(&self) -> bool {
        false
    }

    /// The shape of the grid whose nodes the variables are, with the last index fastest, if they are those of one.
    fn grid(&self) -> Option<Vec<usize>> {
        None
    }

    /// Writes `F(z)` (m). What is not defined comes out as NaN or an infinity.
    fn evaluate(&mut self, z: &[f64], f: &mut [f64]);

    /// Writes the entries of `F'(z)`, in the order of the pattern.
    fn derivatives(&mut self, z: &[f64], values: &mut [f64]);
}

/// `F(z)`, the entries of `F'(z)`, and the sizes of the terms of `F`.
pub(super) fn evaluated(vi: &mut dyn SparseVi, z: &[f64]) -> (Vec<f64>, Vec<f64>, Terms) {
    let mut f = vec![0.0; z.len()];
    let mut derivatives = vec![0.0; vi.pattern().len()];
    vi.evaluate(z, &mut f);
    vi.derivatives(z, &mut derivatives);
    let entries = vi.pattern().iter().copied().zip(derivatives.iter().copied());
    let terms = Terms::of(vi.set(), (z, &f), entries);
    (f, derivatives, terms)
}

/// `F'` and the factors of a system that it makes up.
pub(super) struct SparseJacobian {
    /// `F'`, with a place for each entry of the diagonal.
    matrix: SparseMatrix,
    /// The place of each entry of the pattern in the values of the matrix, and of each of the diagonal.
    places: Vec<usize>,
    diagonal: Vec<usize>,
    system: SparseMatrix,
    factors: SparseLu<f64>,
    derivatives: Vec<f64>,
}

impl SparseJacobian {
    /// For `m` variables and a pattern; nothing where the factors do not fit into memory, or `control` asks to stop.
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

    /// Takes `F'(z)`; false where an entry is not finite.
    pub fn evaluate(&mut self, vi: &mut dyn SparseVi, z: &[f64]) -> bool {
        vi.derivatives(z, &mut self.derivatives);
        let (_, values) = self.matrix.parts_mut();
        values.fill(0.0);
        self.places.iter().zip(&self.derivatives).for_each(|(&place, value)| values[place] += value);
        values.iter().all(|value| value.is_finite())
    }

    /// The scales of rows that bring `z` and `S F` to one unit: the inverse of the diagonal where that says something, else of
    /// the largest entry.
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

    /// The entries of a column with their rows.
    pub fn column(&self, j: usize) -> impl Iterator<Item = (&usize, &f64)> {
        self.matrix.symbolic().row_idx_of_col_raw(j).iter().zip(self.matrix.val_of_col(j))
    }

    /// How far a point `z` with `F(z)` is from a solution, where the Jacobian is that there.
    pub fn worst(&self, set: &ConvexSet, (z, f): (&[f64], &[f64])) -> Worst {
        let entries = (0..z.len()).flat_map(|j| self.column(j).map(move |(&i, a)| ((i, j), *a)));
        Worst::of(set, (z, f), &Terms::of(set, (z, f), entries))
    }

    /// Factorises the system whose row `i` is that of `F'` times the first number, with the second added on the diagonal.
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

    /// Solves the system that was factorised, in place; false where the solution is not finite.
    pub fn solve(&mut self, right: &mut [f64]) -> bool {
        self.factors.solve(right)
    }
}
