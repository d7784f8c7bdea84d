//! A problem with the active face of `K` held fixed: the differential-algebraic system
//!
//! ```text
//! diag(M, 0) y' = Phi(t, y),    Phi = (F, G_i or l_i - z_i or u_i - z_i),    y = (x, z)
//! ```
//!
//! The rows of a block of `K` are its [`FaceEquations`]. This module evaluates the rows at one point, and
//! [`derivatives`] has their derivatives.

mod derivatives;

use super::face::{ActiveFace, Activity};
use super::layout::Layout;
use super::recent::Recent;
use super::settings::StepError;
use super::work::Work;
use numerics::Interval;
use problem::{Control, ConvexSet, Dvi, Face, FaceEquations, ForcingSlopes, Mass, Shape, Side, Structure, Workspace};
use std::sync::Arc;

/// A problem on an active face of `K`, with the values of one evaluation and of one Jacobian.
pub struct System<'p> {
    problem: &'p mut dyn Dvi,
    /// The structure of the problem: sizes, mass matrix and sparsity. The set `K` with its moving bounds is in
    /// [`System::set`].
    structure: Structure,
    /// The caller's control, which may ask to stop.
    pub outside: &'p Control,
    /// Number of states `n` of the problem.
    pub states: usize,
    /// Number of unknowns: `n` states and `m` variables.
    pub unknowns: usize,
    /// The diagonal of the mass matrix `M`.
    pub mass_diagonal: Vec<f64>,
    /// Storage layout of the matrices of the stage equations.
    pub layout: Arc<Layout>,
    /// The set `K`, with its moving bounds as of the last evaluation.
    pub set: ConvexSet,
    workspace: Workspace,
    /// The variables that variational inequalities are solved for: those with a bound and, if the unbounded variables
    /// cannot be eliminated while the bounded ones are fixed, all others. Variables not listed are algebraic states.
    pub bounded: Vec<usize>,
    /// The variables in `bounded` that belong to no block, each in an interval.
    pub intervals: Vec<usize>,
    /// Tolerance of each state, within which states count as equal; empty before tolerances are set.
    pub tolerances: Vec<f64>,
    /// Whether the rows have kinks in `y`: derivatives may then change abruptly within a step.
    pub has_kinks: bool,
    /// Whether rows of the problem may have knots, values of the unknowns at which a derivative jumps.
    pub has_knots: bool,
    /// Largest angular frequency of the explicit time dependence of the rows; see [`Dvi::pace`].
    pub pace: f64,
    /// Rows of `F` and `G` that may vary within a step in ways that its stages do not show.
    pub features: Vec<usize>,
    /// The active face of `K` whose equations are solved.
    pub face: ActiveFace,
    /// Equations of the active face of each block, as of their last evaluation.
    pub equations: Vec<FaceEquations>,
    /// Equations of the active face of each block, as of the last linearisation.
    pub(super) linearised: Vec<FaceEquations>,
    /// Values of `z` and `G` for the members of one block, as workspace.
    pub(super) members: (Vec<f64>, Vec<f64>),
    /// Values of the rows (`F`, `G` and the moving bounds) as of the last evaluation.
    pub values: Vec<f64>,
    /// Time of the last evaluation, and whether all rows were finite; the point of the last evaluation is not evaluated
    /// again.
    last: Option<(f64, bool)>,
    last_y: Vec<f64>,
    /// Values of the rows at points evaluated earlier; `None` without variables, since only events of variables bring a
    /// step back to earlier points.
    recent: Option<Recent>,
    /// Index of the first nonzero of each row of the Jacobian in `derivatives`.
    row_starts: Vec<usize>,
    /// Nonzeros of the Jacobian as of the last evaluation.
    pub derivatives: Vec<f64>,
    /// The derivatives that [`System::exchange_derivatives`] has set aside.
    exchanged: Vec<f64>,
    /// Counters of evaluations, factorisations and Newton iterations of the run.
    pub work: Work,
}

impl<'p> System<'p> {
    /// Wraps a problem that starts at time `t`; every bounded variable starts on a bound.
    ///
    /// # Errors
    /// If the matrices of the stage equations would not fit into memory, or `outside` asks to stop.
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
            // Set a moving bound to a finite value until its first evaluation, so that its variable counts as bounded
            // on that side.
            moving.place(0.0, &mut set);
        }
        let bounded: Vec<usize> = (0..structure.variables).filter(|&k| !set.is_free(k)).collect();
        let intervals = bounded.iter().copied().filter(|&k| set.block_of(k).is_none()).collect();
        let places = (0..structure.variables)
            .map(|k| match (set.lower[k].is_finite(), set.upper[k].is_finite()) {
                (true, _) => Activity::AtLower,
                (false, true) => Activity::AtUpper,
                (false, false) => Activity::Inactive,
            })
            .collect();
        let blocks = set.blocks().len();
        let face = ActiveFace { places, blocks: vec![Face::Interior; blocks] };
        let (rows, nonzeros) = (structure.rows(), structure.pattern.len());
        let row_starts = (0..=rows).map(|row| structure.pattern.partition_point(|&(i, _)| i < row)).collect();
        let has_kinks = !problem.kinks(t, &vec![0.0; unknowns]).is_empty();
        let has_knots = problem.may_pass_knot(Interval::LINE, &vec![Interval::LINE; unknowns]);
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
            has_knots,
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
            exchanged: Vec::new(),
            work: Work::default(),
        })
    }

    /// Adds the unbounded variables to `bounded`, if they cannot be eliminated while the bounded ones are held fixed.
    ///
    /// # Errors
    /// If the matrices of the stage equations would not fit into memory, or the caller asks to stop.
    pub fn keep_free(&mut self, t: f64) -> Result<(), StepError> {
        self.bounded = (0..self.unknowns - self.states).collect();
        self.intervals = self.bounded.iter().copied().filter(|&k| self.set.block_of(k).is_none()).collect();
        self.layout = Arc::new(Layout::new(&self.structure, &self.bounded, t, self.outside)?);
        Ok(())
    }

    /// Returns the problem whose rows are evaluated.
    pub fn problem(&mut self) -> &mut dyn Dvi {
        self.problem
    }

    /// Returns the partial derivatives of the rows of the problem with respect to time as sums of terms, if these sums
    /// are known.
    pub fn forcing_slopes(&self) -> Option<&ForcingSlopes> {
        self.problem.forcing_slopes()
    }

    /// Returns the mass matrix `M`.
    pub fn mass(&self) -> &Mass {
        &self.structure.mass
    }

    /// Whether the system is `x' = f(t, x)`: no mass matrix, no variables.
    pub fn is_explicit_ode(&self) -> bool {
        self.structure.mass == Mass::Identity && self.unknowns == self.states
    }

    /// Whether one Jacobian is valid for all times and unknowns `(t, y)` on a face.
    pub fn constant_jacobian(&self) -> bool {
        self.structure.constant_jacobian && !self.is_curved()
    }

    /// Whether a block is on a curved face of its set, so that its equations are nonlinear.
    pub fn is_curved(&self) -> bool {
        self.face.blocks.iter().any(|face| matches!(face, Face::Boundary(_)))
    }

    /// Whether a block lies on an edge of its set and can move along it.
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
        self.face.places[k] == Activity::Inactive && self.set.block_of(k).is_none_or(is_free)
    }

    /// Evaluates `F`, `G` and the moving bounds at `(t, y)`; returns false if a number is not finite.
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
            self.record(t, y);
        }
        self.set_last(t, y)
    }

    /// Whether all rows of the last evaluation are finite; `None` if that evaluation was not at `(t, y)`.
    #[inline]
    pub(super) fn is_last(&self, t: f64, y: &[f64]) -> Option<bool> {
        let is_same = |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits();
        let (_, finite) = self.last.filter(|(time, _)| *time == t)?;
        y.iter().zip(&self.last_y).all(is_same).then_some(finite)
    }

    /// Copies the values of the rows of the problem at `(t, y)` to `values` if they were evaluated recently; returns
    /// false otherwise.
    pub(super) fn recall(&self, t: f64, y: &[f64], values: &mut [f64]) -> bool {
        let found = self.recent.as_ref().and_then(|recent| recent.find(t, y, values.len()));
        found.inspect(|found| values.copy_from_slice(found)).is_some()
    }

    /// Counts one evaluation at `(t, y)` and stores its rows, which are in `self.values`, for later evaluations at
    /// that point.
    pub(super) fn record(&mut self, t: f64, y: &[f64]) {
        self.work.rates += 1;
        if let Some(recent) = &mut self.recent {
            recent.keep(t, y, &self.values);
        }
    }

    /// Records `(t, y)` as the point of the last evaluation, with the rows in `self.values`, and sets the moving
    /// bounds; returns false if a row is not finite.
    pub(super) fn set_last(&mut self, t: f64, y: &[f64]) -> bool {
        for (p, moving) in self.structure.moving.iter().enumerate() {
            moving.place(self.values[self.unknowns + p], &mut self.set);
        }
        // Read the values of all rows, even behind one that is not finite, so that the loop is vectorised.
        let finite = self.values.iter().fold(true, |finite, value| finite & value.is_finite());
        self.last = Some((t, finite));
        self.last_y.copy_from_slice(y);
        finite
    }

    /// Adds `change` to the value of `G_k`, which then differs from that of the last evaluation.
    pub fn add_to_inequality(&mut self, k: usize, change: f64) {
        self.values[self.states + k] += change;
        self.last = None;
    }

    /// Evaluates `Phi`, the rows of the system on the active face of `K`, at `(t, y)` into `phi`; returns false if a
    /// number is not finite.
    pub fn phi(&mut self, t: f64, y: &[f64], phi: &mut [f64]) -> bool {
        let finite = self.evaluate(t, y);
        self.on_face(finite, y, phi)
    }

    /// Evaluates `Phi`, the rows of the system on the active face of `K`, at `y`, the point of the last evaluation,
    /// into `phi`; returns whether the rows of the problem (`finite`) and `phi` are finite.
    pub(super) fn on_face(&mut self, finite: bool, y: &[f64], phi: &mut [f64]) -> bool {
        phi.copy_from_slice(&self.values[..self.unknowns]);
        for &k in &self.intervals {
            let row = self.states + k;
            match self.face.places[k] {
                Activity::AtLower => phi[row] = self.set.lower[k] - y[row],
                Activity::AtUpper => phi[row] = self.set.upper[k] - y[row],
                Activity::Inactive => {}
                Activity::Fixed | Activity::Boundary(_) | Activity::Vertex => phi[row] = 0.0,
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

    /// Sets the variables of `y = (x, z)` that rest on a bound of an interval to that bound, as of the last evaluation.
    pub fn put_on_bounds(&self, y: &mut [f64]) {
        for &k in &self.intervals {
            match self.face.places[k] {
                Activity::AtLower => y[self.states + k] = self.set.lower[k],
                Activity::AtUpper => y[self.states + k] = self.set.upper[k],
                _ => {}
            }
        }
    }

    /// Projects the variables of `y = (x, z)` onto the set `K` with its moving bounds as of the last evaluation.
    pub fn project(&mut self, y: &mut [f64]) {
        self.set.project_all(&mut y[self.states..], &mut self.workspace);
    }

    /// Writes `diag(M, 0) y`, the product of the mass matrix and the states, to `out`.
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

    /// Returns the residual of the natural map of block `b` at the values `z` of its variables, with `G` of the last
    /// evaluation multiplied by `scale`.
    pub fn defect_of_block(&mut self, b: usize, z: &[f64], scale: f64) -> f64 {
        self.set.defect(b, z, &self.values[self.states..self.unknowns], scale, &mut self.workspace)
    }

    /// Returns the range of one end of the interval of variable `k`, given the ranges `values` of the rows of the
    /// problem.
    pub fn bound(&self, k: usize, side: Side, values: &[Interval]) -> Interval {
        let mut moving = self.structure.moving.iter().zip(&values[self.unknowns..]);
        match moving.find(|(moving, _)| moving.variable == k && moving.side == side) {
            Some((_, value)) => *value,
            None if side == Side::Lower => Interval::point(self.set.lower[k]),
            None => Interval::point(self.set.upper[k]),
        }
    }

    /// Returns the range of the radius of block `b`, given the ranges `values` of the rows of the problem; zero
    /// unless the block is a ball.
    pub fn radius(&self, b: usize, values: &[Interval]) -> Interval {
        let block = &self.set.blocks()[b];
        let Shape::Ball { radius } = block.shape else { return Interval::point(0.0) };
        let mut moving = self.structure.moving.iter().zip(&values[self.unknowns..]);
        let own = moving.find(|(moving, _)| moving.side == Side::Radius && block.members.contains(&moving.variable));
        own.map_or(Interval::point(radius), |(_, value)| *value)
    }
}
