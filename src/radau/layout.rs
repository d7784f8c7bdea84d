//! Storage of the matrices of the stage equations, `diag(M, 0)` with the mass matrix `M` and `-Phi_y`, the negative
//! Jacobian on a face: dense, column by column, if the system is small or full; otherwise sparse on the union of both
//! patterns, which is valid for every face and analysed once.

use super::footprint::check_memory;
use super::settings::StepError;
use factorisation::Analysis;
use faer::sparse::{Pair, SymbolicSparseColMat};
use problem::{Control, Mass, Structure};

/// Up to this many unknowns, a dense factorisation is faster than the bookkeeping of a sparse one.
const DENSE_AT_MOST: usize = 40;

/// A system too large for dense storage by default is stored sparse if at most one entry in this many may be nonzero:
/// with more, the factors fill in, and a dense factorisation is up to three times as fast, measured on chains, grids
/// and random patterns.
const SPARSITY: usize = 16;

/// Whether to use sparse storage for matrices with this number of unknowns and of structural nonzeros.
pub fn is_sparse(unknowns: usize, entries: usize) -> bool {
    unknowns > DENSE_AT_MOST && entries <= unknowns.saturating_mul(unknowns) / SPARSITY
}

/// Storage index, called place, of each entry of the matrices of the stage equations.
#[derive(Debug)]
pub struct Layout {
    /// Number of unknowns of the system, `n` states and `m` variables.
    pub unknowns: usize,
    /// Dense or sparse storage of the matrices of the stage equations.
    pub storage: Storage,
    /// Number of stored entries (places) of a matrix of the stage equations.
    pub places: usize,
    /// The entries of the mass matrix `M`, each with its storage index and value.
    pub mass: Vec<(usize, f64)>,
    /// For each row of the problem, whether it is the equation of a rate: the mass matrix `M` has an entry in this row.
    pub is_rate: Vec<bool>,
    /// For each state, whether it has a mass: the mass matrix `M` has an entry in its column.
    pub has_mass: Vec<bool>,
    /// The storage index of each entry in the problem's pattern of derivatives; an entry of a moving bound is in the
    /// row of its variable.
    pub jacobian: Vec<usize>,
    /// The storage index of the diagonal entry of each bounded variable.
    pub diagonal: Vec<usize>,
    /// For each entry of the pattern of derivatives in the row of a block, its storage indices in the rows of all
    /// members of the block; empty for other rows.
    pub spread: Vec<Vec<usize>>,
    /// The storage indices of the entries in the rows and columns of the members of each block, row by row, in the
    /// matrices of the stage equations.
    pub own: Vec<Vec<usize>>,
}

/// Storage of the entries of a matrix of the stage equations.
#[derive(Debug)]
pub enum Storage {
    /// Dense storage: all entries, column by column.
    Dense,
    /// Sparse storage: the entries of a sparsity pattern, in compressed columns.
    Sparse {
        /// Sparsity pattern of the matrices of the stage equations.
        pattern: SymbolicSparseColMat<usize>,
        /// Symbolic analysis of the sparsity pattern, for the factorisations.
        analysis: Analysis,
    },
}

impl Layout {
    /// Creates the layout for a problem whose variables with bounds are `bounded`; an interruption is reported at
    /// time `t`.
    ///
    /// # Errors
    /// If the matrices would not fit into memory, or `outside` asks to stop while a large one is analysed.
    pub fn new(structure: &Structure, bounded: &[usize], t: f64, outside: &Control) -> Result<Self, StepError> {
        let (n, unknowns) = (structure.states, structure.unknowns());
        let mass: Vec<(usize, usize, f64)> = match &structure.mass {
            Mass::Identity => (0..n).map(|i| (i, i, 1.0)).collect(),
            Mass::Constant(entries) => entries.clone(),
        };
        let row = |i: usize| if i < unknowns { i } else { n + structure.moving[i - unknowns].variable };
        let jacobian = structure.pattern.iter().map(|&(i, j)| (row(i), j));
        let diagonal = bounded.iter().map(|&k| (n + k, n + k));
        // An equation of the face of a block may combine the rows of all members of the block.
        let set = &structure.set;
        let members = |i: usize| match i.checked_sub(n).and_then(|_| set.block_of(row(i) - n)) {
            Some(block) => set.blocks()[block].members.as_slice(),
            None => &[],
        };
        let spread: Vec<Vec<(usize, usize)>> =
            structure.pattern.iter().map(|&(i, j)| members(i).iter().map(|k| (n + k, j)).collect()).collect();
        let square = |members: &[usize]| -> Vec<(usize, usize)> {
            members.iter().flat_map(|k| members.iter().map(move |l| (n + k, n + l))).collect()
        };
        let own: Vec<Vec<(usize, usize)>> = set.blocks().iter().map(|block| square(&block.members)).collect();
        let mut pairs: Vec<Pair<usize, usize>> = mass
            .iter()
            .map(|&(i, j, _)| (i, j))
            .chain(jacobian.clone())
            .chain(diagonal.clone())
            .chain(spread.iter().chain(&own).flatten().copied())
            .map(|(row, col)| Pair { row, col })
            .collect();
        pairs.sort_unstable_by_key(|pair| (pair.col, pair.row));
        pairs.dedup();
        let (storage, places) = if is_sparse(unknowns, pairs.len()) {
            let too_large = || StepError::TooLarge { what: "sparse factors", unknowns };
            let pattern = SymbolicSparseColMat::try_new_from_indices(unknowns, unknowns, &pairs);
            let (pattern, _) = pattern.map_err(|_| too_large())?;
            let stopped = || outside.poll().is_some();
            let none = || if stopped() { StepError::Interrupted { t } } else { too_large() };
            let analysis = Analysis::new_unless(pattern.as_ref(), stopped).ok_or_else(none)?;
            (Storage::Sparse { pattern, analysis }, pairs.len())
        } else {
            check_memory("dense factors", unknowns)?;
            (Storage::Dense, unknowns * unknowns)
        };
        let place = |(i, j): (usize, usize)| match &storage {
            Storage::Dense => i + j * unknowns,
            Storage::Sparse { pattern, .. } => {
                let column = pattern.col_range(j);
                column.start + pattern.row_idx()[column].partition_point(|&row| row < i)
            }
        };
        let mut is_rate = vec![false; unknowns];
        let mut has_mass = vec![false; n];
        for &(i, j, _) in &mass {
            (is_rate[i], has_mass[j]) = (true, true);
        }
        let mass = mass.iter().map(|&(i, j, value)| (place((i, j)), value)).collect();
        let (jacobian, diagonal) = (jacobian.map(place).collect(), diagonal.map(place).collect());
        let all = |pairs: Vec<Vec<(usize, usize)>>| -> Vec<Vec<usize>> {
            pairs.into_iter().map(|pairs| pairs.into_iter().map(place).collect()).collect()
        };
        let (spread, own) = (all(spread), all(own));
        Ok(Self { unknowns, storage, places, mass, is_rate, has_mass, jacobian, diagonal, spread, own })
    }

    /// Multiplies each row of a matrix of the stage equations by its factor in `factors`; `places` are the stored
    /// entries of the matrix.
    pub fn multiply_rows(&self, factors: &[f64], places: &mut [f64]) {
        match &self.storage {
            Storage::Dense => {
                for column in places.chunks_exact_mut(self.unknowns.max(1)) {
                    column.iter_mut().zip(factors).for_each(|(value, factor)| *value *= factor);
                }
            }
            Storage::Sparse { pattern, .. } => {
                places.iter_mut().zip(pattern.row_idx()).for_each(|(value, &row)| *value *= factors[row]);
            }
        }
    }
}
