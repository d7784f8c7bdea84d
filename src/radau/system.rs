//! A problem with the active face of `K` held fixed: the differential-algebraic system
//!
//! ```text
//! diag(M, 0) y' = Phi(t, y),    Phi = (F, G_i or l_i - z_i or u_i - z_i),    y = (x, z)
//! ```
//!
//! with [`FaceEquations`] in the rows of a block, and the counters of what was evaluated.

use super::face::{ActiveFace, Place};
use super::layout::Layout;
use super::recent::Recent;
use super::settings::StepError;
use numerics::Interval;
use problem::{Control, ConvexSet, Dvi, Face, FaceEquations, ForcingSlopes, Mass, Shape, Side, Structure, Workspace};
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
    /// Its sizes, mass, sparsity; `K` as it moves is [`System::set`].
    structure: Structure,
    /// Whether the outside asks to stop.
    pub outside: &'p Control,
    /// `n`
    pub states: usize,
    /// `n + m`
    pub unknowns: usize,
    /// The diagonal of `M`.
    pub mass_diagonal: Vec<f64>,
    /// Where the matrices of the stage equations stand in memory.
    pub layout: Arc<Layout>,
    /// `K`, its moving bounds as of the last evaluation.
    pub set: ConvexSet,
    workspace: Workspace,
    /// The variables that variational inequalities are solved for: those with a bound, and free ones that only these
    /// determine. The others are algebraic states.
    pub bounded: Vec<usize>,
    /// Those of them in no block.
    pub intervals: Vec<usize>,
    /// How far apart states are that their tolerances do not tell from each other; empty before these are known.
    pub tolerances: Vec<f64>,
    /// Whether derivatives may change within a step by more than a step makes them, at kinks of the rows in `y`.
    pub has_kinks: bool,
    /// See [`Dvi::pace`].
    pub pace: f64,
    /// The rows of `F` and `G` that may do within a step what its stages do not show.
    pub features: Vec<usize>,
    /// The active face.
    pub face: ActiveFace,
    /// The equations of each block where they were asked for last.
    pub equations: Vec<FaceEquations>,
    /// The same where the system was linearised.
    pub(super) linearised: Vec<FaceEquations>,
    /// `z` and `G` of one block.
    pub(super) members: (Vec<f64>, Vec<f64>),
    /// Rows `F`, `G`, moving bounds as of the last evaluation.
    pub values: Vec<f64>,
    /// Where that was, and whether all were finite: the same place is not evaluated twice.
    last: Option<(f64, bool)>,
    last_y: Vec<f64>,
    /// Earlier places, where there are variables: no event of others brings a step back to them.
    recent: Option<Recent>,
    /// Where each row of the Jacobian starts among its nonzeros.
    row_starts: Vec<usize>,
    /// Nonzeros of the Jacobian as of the last evaluation.
    pub derivatives: Vec<f64>,
    /// Counters.
    pub work: Work,
}

impl<'p> System<'p> {
    /// Wraps a problem that starts at `t`; every bounded variable starts on a bound.
    ///
    /// # Errors
    /// If its matrices would not fit into memory, or `outside` asks to stop.
    pub fn new(problem: &'p mut dyn Dvi, t: f64, outside: &'p Control) -> Result<Self, StepError> {
        let structure = problem.structure().clone();
        let (n, unknowns) = (structure.states, structure.unknowns());
        let mut mass_diagonal = vec![0.0; n];
        match &structure.mass {
            Mass::Identity => mass_diagonal.fill(1.0),
            Mass::Constant(entries) => {
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
        let intervals = bounded.iter().copied().filter(|&k| set.block_of(k).is_none()).collect();
        let places = (0..structure.variables)
            .map(|k| match (set.lower[k].is_finite(), set.upper[k].is_finite()) {
                (true, _) => Place::Lower,
                (false, true) => Place::Upper,
                (false, false) => Place::Inside,
            })
            .collect();
        let blocks = set.blocks().len();
        let face = ActiveFace { places, blocks: vec![Face::Interior; blocks] };
        let (rows, nonzeros) = (structure.rows(), structure.pattern.len());
        let row_starts = (0..=rows).map(|row| structure.pattern.partition_point(|&(i, _)| i < row)).collect();
        let has_kinks = !problem.kinks(t, &vec![0.0; unknowns]).is_empty();
        let pace = problem.pace();
        let features = problem.features().to_vec();
        let layout = Arc::new(Layout::new(&structure, &bounded, t, outside)?);
        Ok(Self {
            problem,
            structure,
            outside,
            states: n,
            unknowns,
            mass_diagonal,
            layout,
            set,
            workspace: Workspace::default(),
            bounded,
            intervals,
            tolerances: Vec::new(),
            has_kinks,
            pace,
            features,
            face,
            equations: vec![FaceEquations::default(); blocks],
            linearised: vec![FaceEquations::default(); blocks],
            members: (Vec::new(), Vec::new()),
            values: vec![0.0; rows],
            last: None,
            last_y: vec![0.0; unknowns],
            recent: (unknowns > n).then(|| Recent::new(unknowns, rows)),
            row_starts,
            derivatives: vec![0.0; nonzeros],
            work: Work::default(),
        })
    }

    /// Keeps the free variables beside those with a bound, where they cannot be eliminated while those are held.
    ///
    /// # Errors
    /// If its matrices would not fit into memory, or the outside asks to stop.
    pub fn keep_free(&mut self, t: f64) -> Result<(), StepError> {
        self.bounded = (0..self.unknowns - self.states).collect();
        self.intervals = self.bounded.iter().copied().filter(|&k| self.set.block_of(k).is_none()).collect();
        self.layout = Arc::new(Layout::new(&self.structure, &self.bounded, t, self.outside)?);
        Ok(())
    }

    /// The problem itself.
    pub fn problem(&mut self) -> &mut dyn Dvi {
        self.problem
    }

    /// How the slopes of its rows in time are sums of terms, where these are known.
    pub fn forcing_slopes(&self) -> Option<&ForcingSlopes> {
        self.problem.forcing_slopes()
    }

    /// `M`.
    pub fn mass(&self) -> &Mass {
        &self.structure.mass
    }

    /// Whether it is `x' = f(t, x)`: no mass matrix, no variables.
    pub fn is_explicit_ode(&self) -> bool {
        self.structure.mass == Mass::Identity && self.unknowns == self.states
    }

    /// Whether one Jacobian serves for all `(t, y)` on a face.
    pub fn constant_jacobian(&self) -> bool {
        self.structure.constant_jacobian && !self.is_curved()
    }

    /// Whether a block is on a curved face.
    pub fn is_curved(&self) -> bool {
        self.face.blocks.iter().any(|face| matches!(face, Face::Boundary(_)))
    }

    /// Whether a block moves along an edge of its set.
    pub fn is_on_edge(&self) -> bool {
        self.set.blocks().iter().zip(&self.face.blocks).any(|(block, face)| match (face, &block.shape) {
            (_, _) if self.face.holds(&block.members) => false,
            (Face::Edge(zeros), Shape::Simplex) => zeros.len() + 1 < block.members.len(),
            (Face::Edge(rows), _) => rows.len() < block.members.len(),
            _ => false,
        })
    }

    /// Whether the equation of variable `k` is `G_k = 0`: inside its interval, or in the interior of its block.
    pub fn is_inside(&self, k: usize) -> bool {
        let is_free = |b: usize| self.face.blocks[b] == Face::Interior;
        self.face.places[k] == Place::Inside && self.set.block_of(k).is_none_or(is_free)
    }

    /// Evaluates `F`, `G` and the bounds at `(t, y)`; false if a number is not finite.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> bool {
        if let Some(finite) = self.is_last(t, y) {
            return finite;
        }
        let mut values = std::mem::take(&mut self.values);
        let is_known = self.recall(t, y, &mut values);
        if !is_known {
            self.problem.evaluate(t, y, &mut values);
        }
        self.values = values;
        if !is_known {
            self.count(t, y);
        }
        self.arrive(t, y)
    }

    /// Whether the rows of the last evaluation, which was at `(t, y)`, are finite; `None` where it was elsewhere.
    #[inline]
    pub(super) fn is_last(&self, t: f64, y: &[f64]) -> Option<bool> {
        let is_same = |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits();
        let (_, finite) = self.last.filter(|(time, _)| *time == t)?;
        y.iter().zip(&self.last_y).all(is_same).then_some(finite)
    }

    /// Writes the rows at `(t, y)` where they were evaluated lately; false where not.
    pub(super) fn recall(&self, t: f64, y: &[f64], values: &mut [f64]) -> bool {
        let found = self.recent.as_ref().and_then(|recent| recent.find(t, y, values.len()));
        found.inspect(|found| values.copy_from_slice(found)).is_some()
    }

    /// Takes an evaluation at `(t, y)` into account, with the rows there at hand.
    pub(super) fn count(&mut self, t: f64, y: &[f64]) {
        self.work.rates += 1;
        if let Some(recent) = &mut self.recent {
            recent.keep(t, y, &self.values);
        }
    }

    /// Places the moving bounds by the rows at hand, which are those at `(t, y)`; false if one is not finite.
    pub(super) fn arrive(&mut self, t: f64, y: &[f64]) -> bool {
        for (p, moving) in self.structure.moving.iter().enumerate() {
            moving.place(self.values[self.unknowns + p], &mut self.set);
        }
        // Without an end at the first that is none: the loop is vectorised.
        let finite = self.values.iter().fold(true, |finite, value| finite & value.is_finite());
        self.last = Some((t, finite));
        self.last_y.copy_from_slice(y);
        finite
    }

    /// Adds to the value of `G_k`, which is then no longer that of the last evaluation.
    pub fn add_to_inequality(&mut self, k: usize, change: f64) {
        self.values[self.states + k] += change;
        self.last = None;
    }

    /// Evaluates `Phi` at `(t, y)` on the present face into `phi`; false if a number is not finite.
    pub fn phi(&mut self, t: f64, y: &[f64], phi: &mut [f64]) -> bool {
        let finite = self.evaluate(t, y);
        self.on_face(finite, y, phi)
    }

    /// `Phi` at `y`, where the rows were evaluated last; whether these were `finite`, and it is.
    pub(super) fn on_face(&mut self, finite: bool, y: &[f64], phi: &mut [f64]) -> bool {
        phi.copy_from_slice(&self.values[..self.unknowns]);
        for &k in &self.intervals {
            let row = self.states + k;
            match self.face.places[k] {
                Place::Lower => phi[row] = self.set.lower[k] - y[row],
                Place::Upper => phi[row] = self.set.upper[k] - y[row],
                Place::Inside => {}
                Place::Held | Place::Boundary(_) | Place::Vertex => phi[row] = 0.0,
            }
        }
        for b in 0..self.face.blocks.len() {
            let is_held = self.face.holds(&self.set.blocks()[b].members);
            if !is_held {
                self.equations_of(b, y);
            }
            for (i, &k) in self.set.blocks()[b].members.iter().enumerate() {
                phi[self.states + k] = if is_held { 0.0 } else { self.equations[b].value(i, &self.members.1) };
            }
        }
        finite && (self.face.blocks.is_empty() || phi.iter().all(|value| value.is_finite()))
    }

    /// Puts the variables of intervals in `y = (x, z)` that rest on a bound onto it, as of the last evaluation.
    pub fn put_on_bounds(&self, y: &mut [f64]) {
        for &k in &self.intervals {
            match self.face.places[k] {
                Place::Lower => y[self.states + k] = self.set.lower[k],
                Place::Upper => y[self.states + k] = self.set.upper[k],
                _ => {}
            }
        }
    }

    /// Puts the variables of `y = (x, z)` into `K` as of the last evaluation.
    pub fn project(&mut self, y: &mut [f64]) {
        self.set.project_all(&mut y[self.states..], &mut self.workspace);
    }

    /// Evaluates the derivatives at `(t, y)`; false if a number is not finite. Where a slope is infinite at `y`, as that of a
    /// root at zero, it is taken beside it, where the states differ by their tolerances.
    pub fn differentiate(&mut self, t: f64, y: &[f64]) -> bool {
        if self.structure.constant_jacobian && self.work.jacobians > 0 {
            return true;
        }
        self.work.jacobians += 1;
        self.problem.jacobian(t, y, &mut self.derivatives);
        self.derivatives.iter().all(|value| value.is_finite()) || self.differentiate_beside(t, y)
    }

    fn differentiate_beside(&mut self, t: f64, y: &[f64]) -> bool {
        [1.0, -1.0].into_iter().any(|side| {
            let mut beside = y.to_vec();
            beside.iter_mut().zip(&self.tolerances).for_each(|(y, tolerance)| *y += side * tolerance);
            self.problem.jacobian(t, &beside, &mut self.derivatives);
            self.derivatives.iter().all(|value| value.is_finite())
        })
    }

    /// The partial derivatives of `G` by `t` at `(t, y)`, into `values` (m).
    pub fn time_derivative(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.problem.time_derivative(t, y, values);
    }

    /// The nonzeros of the Jacobian as of the last differentiation, as `(row, column, value)`.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.structure.pattern.iter().zip(&self.derivatives).map(|(&(i, j), &value)| (i, j, value))
    }

    /// `out = diag(M, 0) y`
    pub fn multiply_by_mass(&self, y: &[f64], out: &mut [f64]) {
        let n = self.states;
        match &self.structure.mass {
            Mass::Identity => {
                out[..n].copy_from_slice(&y[..n]);
                out[n..].fill(0.0);
            }
            Mass::Constant(entries) => {
                out.fill(0.0);
                for &(i, j, value) in entries {
                    out[i] += value * y[j];
                }
            }
        }
    }

    /// `sum_j |dG_k/dy_j| size_j` for several sizes: how large the terms of `G_k` are, in which its rounding errors are
    /// measured.
    pub fn terms<const N: usize>(&self, k: usize, sizes: impl Fn(usize) -> [f64; N]) -> [f64; N] {
        self.terms_of_row(self.states + k, sizes)
    }

    /// The natural map of block `b` at the variables `z` as of the last evaluation, with `G` multiplied by `scale`.
    pub fn defect_of_block(&mut self, b: usize, z: &[f64], scale: f64) -> f64 {
        self.set.defect(b, z, &self.values[self.states..self.unknowns], scale, &mut self.workspace)
    }

    /// The same of the moving bounds of variable `k`.
    pub fn terms_of_bounds(&self, k: usize, size: impl Fn(usize) -> f64) -> f64 {
        let bounds = self.structure.moving.iter().enumerate().filter(|(_, moving)| moving.variable == k);
        bounds.map(|(p, _)| self.terms_of_row(self.unknowns + p, |j| [size(j)])[0]).sum()
    }

    pub fn terms_of_row<const N: usize>(&self, row: usize, sizes: impl Fn(usize) -> [f64; N]) -> [f64; N] {
        let mut sums = [0.0; N];
        for (j, value) in self.entries_of_row(row) {
            for (sum, size) in sums.iter_mut().zip(sizes(j)) {
                *sum += value.abs() * size;
            }
        }
        sums
    }

    /// The nonzeros of one row of the Jacobian as of the last differentiation, as `(column, value)`.
    pub fn entries_of_row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let (first, last) = (self.row_starts[row], self.row_starts[row + 1]);
        let pattern = &self.structure.pattern[first..last];
        pattern.iter().zip(&self.derivatives[first..last]).map(|(&(_, j), &value)| (j, value))
    }

    /// The nonzeros of one row of the Jacobian, as places among all of them and columns.
    pub fn places_of_row(&self, row: usize) -> impl Iterator<Item = (usize, usize)> {
        let (first, last) = (self.row_starts[row], self.row_starts[row + 1]);
        (first..last).zip(&self.structure.pattern[first..last]).map(|(at, &(_, j))| (at, j))
    }

    /// Whether a bound of variable `k` moves.
    pub fn moves(&self, k: usize) -> bool {
        self.structure.moving.iter().any(|moving| moving.variable == k)
    }

    /// One end of the interval of variable `k`, where rows of the problem are as in `values`.
    pub fn bound(&self, k: usize, side: Side, values: &[Interval]) -> Interval {
        let mut moving = self.structure.moving.iter().zip(&values[self.unknowns..]);
        match moving.find(|(moving, _)| moving.variable == k && moving.side == side) {
            Some((_, value)) => *value,
            None if side == Side::Lower => Interval::point(self.set.lower[k]),
            None => Interval::point(self.set.upper[k]),
        }
    }

    /// The radius of block `b`, of a ball, where rows of the problem are as in `values`; zero of other shapes.
    pub fn radius(&self, b: usize, values: &[Interval]) -> Interval {
        let block = &self.set.blocks()[b];
        let Shape::Ball { radius } = block.shape else { return Interval::point(0.0) };
        let mut moving = self.structure.moving.iter().zip(&values[self.unknowns..]);
        let own = moving.find(|(moving, _)| moving.side == Side::Radius && block.members.contains(&moving.variable));
        own.map_or(Interval::point(radius), |(_, value)| *value)
    }

    /// The nonzeros of `dG_k/dy` as of the last differentiation, as `(column, value)`.
    pub fn entries_of_variable(&self, k: usize) -> impl Iterator<Item = (usize, f64)> {
        self.entries_of_row(self.states + k)
    }

    /// Whether variables enter `G_k`, by the derivatives as of the last differentiation.
    pub fn has_variables(&self, k: usize) -> bool {
        self.entries_of_variable(k).any(|(j, value)| j >= self.states && value != 0.0)
    }

    /// `dG_k/dy . direction`
    pub fn slope(&self, k: usize, direction: impl Fn(usize) -> f64) -> f64 {
        self.entries_of_variable(k).map(|(j, value)| value * direction(j)).sum()
    }

    /// Writes `-dPhi/dy` on the face to the places of the layout, from the derivatives as they are.
    pub fn negative_jacobian(&self, face: &ActiveFace, places: &mut [f64]) {
        places.fill(0.0);
        self.visit_derivatives(face, |_, _, place, value| places[place] -= value);
    }

    /// Visits the terms of `dPhi/dy` on the face, from the derivatives as they are, as `(row, column, place, value)`.
    pub fn visit_derivatives(&self, face: &ActiveFace, mut visit: impl FnMut(usize, usize, usize, f64)) {
        let n = self.states;
        let structure = &self.structure;
        let Layout { jacobian, spread, own, diagonal, .. } = &*self.layout;
        for (at, (&(i, j), &value)) in structure.pattern.iter().zip(&self.derivatives).enumerate() {
            let (variable, side) = match i.checked_sub(self.unknowns) {
                _ if i < n => (None, None),
                None => (Some(i - n), None),
                Some(p) => (Some(structure.moving[p].variable), Some(structure.moving[p].side)),
            };
            let block = variable.and_then(|k| Some((self.set.block_of(k)?, k)));
            if let Some((b, k)) = block {
                let (members, equations) = (&self.set.blocks()[b].members, &self.linearised[b]);
                if face.holds(members) {
                    continue;
                }
                let column = members.iter().position(|member| *member == k).unwrap_or(0);
                for (row, (member, &place)) in members.iter().zip(&spread[at]).enumerate() {
                    let factor = match side {
                        Some(_) => equations.by_radius[row],
                        None => equations.combination_of(row)[column],
                    };
                    if factor != 0.0 {
                        visit(n + member, j, place, factor * value);
                    }
                }
                continue;
            }
            let is_on_face = match (variable, side) {
                (None, _) => true,
                (Some(k), None) => face.places[k] == Place::Inside,
                (Some(k), Some(Side::Lower)) => face.places[k] == Place::Lower,
                (Some(k), Some(Side::Upper)) => face.places[k] == Place::Upper,
                (Some(_), Some(Side::Radius)) => false,
            };
            if is_on_face {
                visit(variable.map_or(i, |k| n + k), j, jacobian[at], value);
            }
        }
        for (&k, &place) in self.bounded.iter().zip(diagonal) {
            let is_given = match self.set.block_of(k) {
                Some(_) => face.places[k] == Place::Held,
                None => face.places[k] != Place::Inside,
            };
            if is_given {
                visit(n + k, n + k, place, -1.0);
            }
        }
        for ((block, equations), places) in self.set.blocks().iter().zip(&self.linearised).zip(own) {
            if face.holds(&block.members) {
                continue;
            }
            let pairs = block.members.iter().flat_map(|k| block.members.iter().map(move |l| (k, l)));
            for (((k, l), &place), &value) in pairs.zip(places).zip(&equations.own) {
                if value != 0.0 {
                    visit(n + k, n + l, place, value);
                }
            }
        }
    }
}
