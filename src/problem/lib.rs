//! What a stepper sees of a differential variational inequality:
//!
//! ```text
//! M x' = F(t,x,z) = f(t,x) + B(t,x) z,    z in K(t,x),    <G(t,x,z), z~ - z> >= 0  for all z~ in K(t,x)
//! ```
//!
//! with `n` states `x` and `m` variables `z`. A problem is its [`Structure`], which is data, and two evaluations.
//! Stage unknowns are stored as `y = (x, z)`, of length `n + m`.

mod control;
mod convex_set;
mod event;
mod mechanical;
mod warning;

use numerics::{Interval, variation};

pub use control::{Control, Interrupted, Stop};
pub use convex_set::{
    Block, BlockWorkspace, ConvexSet, Derivative, Face, FaceEquations, FlatMonitor, Monitor, MonitorRange, Polyhedron,
    Shape, Workspace,
};
pub use event::{Event, EventKind};
pub use mechanical::{
    Constraints, ContactData, DynamicsRange, Energies, Mechanical, MechanicalStructure, Sensitivity, SensitivityRange,
};
pub use warning::Warning;

/// What a moving bound is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The lower end of an interval, `l`.
    Lower,
    /// The upper end of an interval, `u`.
    Upper,
    /// The radius of the ball that the variable is in.
    Radius,
}

impl Side {
    /// What is empty where this passes the other end, or zero, and why.
    pub fn emptiness(self) -> (&'static str, &'static str) {
        match self {
            Self::Lower | Self::Upper => ("interval", "its lower bound passes its upper bound"),
            Self::Radius => ("ball", "its radius turns negative"),
        }
    }
}

/// A bound of `K` that varies with `(t, x)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MovingBound {
    /// The index of the bounded variable, below `m`.
    pub variable: usize,
    /// What of its interval or ball moves.
    pub side: Side,
}

impl MovingBound {
    /// Sets the bound in `set` to `value`.
    pub fn place(self, value: f64, set: &mut ConvexSet) {
        match self.side {
            Side::Lower => set.lower[self.variable] = value,
            Side::Upper => set.upper[self.variable] = value,
            Side::Radius => {
                if let Some(block) = set.block_of(self.variable) {
                    set.set_radius(block, value);
                }
            }
        }
    }
}

/// The mass matrix `M` of the differential part.
#[derive(Clone, Debug, PartialEq)]
pub enum Mass {
    /// `M = I`.
    Identity,
    /// A constant matrix as `(row, column, value)`, at most one entry a place; it may be singular.
    Constant(Vec<(usize, usize, f64)>),
}

/// The shape of a problem: sizes, set, sparsity.
#[derive(Clone, Debug)]
pub struct Structure {
    /// `n`, the number of states.
    pub states: usize,
    /// `m`, the number of variables.
    pub variables: usize,
    /// The mass matrix.
    pub mass: Mass,
    /// `K` with its constant bounds; places of `moving` bounds hold any value.
    pub set: ConvexSet,
    /// The bounds that vary, in the order in which [`Dvi::evaluate`] writes them.
    pub moving: Vec<MovingBound>,
    /// The places of the Jacobian that may be nonzero, as `(row, column)` sorted by row, then column.
    /// Rows: `F` (n), `G` (m), moving bounds. Columns: `x` (n), `z` (m).
    pub pattern: Vec<(usize, usize)>,
    /// Whether the Jacobian is the same at every `(t, y)`.
    pub constant_jacobian: bool,
}

impl Structure {
    /// `n + m`, the length of `y`.
    pub fn unknowns(&self) -> usize {
        self.states + self.variables
    }

    /// Whether variable `k` is in a bounded set, whatever its bounds are at a time.
    pub fn is_bounded(&self, k: usize) -> bool {
        let moves = |side| self.moving.contains(&MovingBound { variable: k, side });
        match self.set.block_of(k).map(|block| &self.set.blocks()[block].shape) {
            Some(Shape::Ball { .. } | Shape::Simplex) => true,
            Some(Shape::SecondOrderCone | Shape::Polyhedron(_)) => false,
            None => {
                (self.set.lower[k].is_finite() || moves(Side::Lower))
                    && (self.set.upper[k].is_finite() || moves(Side::Upper))
            }
        }
    }

    /// Whether a variable is in a set that is unbounded and not the whole line, so that it may have impulses.
    pub fn has_impulses(&self) -> bool {
        (0..self.variables).any(|k| !self.set.is_free(k) && !self.is_bounded(k))
    }

    /// The length of what [`Dvi::evaluate`] writes: `n + m +` moving bounds.
    pub fn rows(&self) -> usize {
        self.unknowns() + self.moving.len()
    }
}

/// Sums of terms, one a row, as `(term, factor)`.
pub type Sums = Vec<Vec<(usize, f64)>>;

/// The slopes of rows in time, as sums of terms that are functions of time alone: in a combination of rows what they have in
/// common falls out before it is enclosed.
#[derive(Clone, Debug, Default)]
pub struct ForcingSlopes {
    /// The number of terms.
    pub terms: usize,
    /// `dF/dt` (n).
    pub rates: Sums,
    /// `dG/dt` (m).
    pub inequality: Sums,
    /// `d^2G/dt^2` (m).
    pub curvature: Sums,
}

/// The degree up to which polynomials in the states are no features: on a straight way three stages of Radau IIA integrate
/// them exactly.
pub const PLAIN_DEGREE: u32 = 4;

/// A differential variational inequality, ready to be evaluated without allocation.
pub trait Dvi: Send {
    /// Sizes, set and sparsity.
    fn structure(&self) -> &Structure;

    /// Writes `F` (n), `G` (m) and the moving bounds at `(t, y)` into `values`, of length [`Structure::rows`].
    /// What is not defined there comes out as NaN or an infinity, for the caller to check.
    fn evaluate(&mut self, t: f64, y: &[f64], values: &mut [f64]);

    /// Writes the same at several points, one after the other as their `y` stand in `ys`, with the same bits.
    fn evaluate_points(&mut self, times: &[f64], ys: &[f64], values: &mut [f64]) {
        let (unknowns, rows) = (self.structure().unknowns(), self.structure().rows());
        for (i, &t) in times.iter().enumerate() {
            self.evaluate(t, &ys[unknowns * i..][..unknowns], &mut values[rows * i..][..rows]);
        }
    }

    /// Writes the derivatives of the same rows by `y`, in the order of [`Structure::pattern`].
    fn jacobian(&mut self, t: f64, y: &[f64], values: &mut [f64]);

    /// Writes the partial derivatives of `G` (m) by `t` at `(t, y)`.
    fn time_derivative(&mut self, t: f64, y: &[f64], values: &mut [f64]);

    /// Writes intervals that hold `F`, `G` and the moving bounds wherever `(t, y)` is in a box, in the order of
    /// [`Dvi::evaluate`]; false where the problem cannot be enclosed.
    fn enclose(&mut self, _t: Interval, _y: &[Interval], _values: &mut [Interval]) -> bool {
        false
    }

    /// The same of the derivatives by `y`, in the order of [`Structure::pattern`], and of those of `G` by `t`.
    fn enclose_derivatives(
        &mut self,
        _t: Interval,
        _y: &[Interval],
        _jacobian: &mut [Interval],
        _by_time: &mut [Interval],
    ) -> bool {
        false
    }

    /// Writes how the derivatives by `y` vary between three points one after the other, at these times and in these `y`: their
    /// range, and by how much the middle differs from the mean of the ends. Where [`Dvi::enclose_derivatives`] makes them of
    /// others, these may vary in place of them.
    fn vary_derivatives(&mut self, times: [f64; 3], y: &[f64], variations: &mut [(f64, f64)]) {
        let mut of = times.map(|_| vec![0.0; variations.len()]);
        for ((t, y), values) in times.iter().zip(y.chunks_exact(y.len() / 3)).zip(&mut of) {
            self.jacobian(*t, y, values);
        }
        let [first, middle, last] = &of;
        for (at, out) in variations.iter_mut().enumerate() {
            *out = variation([first[at], middle[at], last[at]]);
        }
    }

    /// How fast the rows vary with time whatever `y` is, in radians a unit of time: the stages of a step in which no phase
    /// passes by half a turn show them. Zero where they do not depend on time, infinite where nothing is known of them.
    fn pace(&mut self) -> f64 {
        0.0
    }

    /// The rows, of `F` and `G`, that are no polynomials of low degree in `y`, in order: within a step they may do what its stages
    /// do not show.
    fn features(&self) -> &[usize] {
        &[]
    }

    /// Whether a row may jump, by what depends on `y`, somewhere in a box.
    fn may_jump(&mut self, _t: Interval, _y: &[Interval]) -> bool {
        false
    }

    /// How the slopes of the rows in time are sums of terms; `None` where these are not known, or depend on `y`.
    fn forcing_slopes(&self) -> Option<&ForcingSlopes> {
        None
    }

    /// Writes intervals that hold the terms of [`Dvi::forcing_slopes`] wherever `t` is in an interval.
    fn enclose_forcing_slopes(&mut self, _t: Interval, _terms: &mut [Interval]) {}

    /// The quantities, at `t`, at whose changes of sign a row has a kink or a jump whatever `y` is; as many at any time.
    fn breaks(&mut self, _t: f64) -> &[f64] {
        &[]
    }

    /// Intervals that hold these quantities wherever `t` is in an interval; none where they cannot be enclosed.
    fn enclose_breaks(&mut self, _t: Interval) -> &[Interval] {
        &[]
    }

    /// The quantities at `(t, y)` at whose changes of sign a row has a kink or a jump that depends on `y`; as many anywhere.
    fn kinks(&mut self, _t: f64, _y: &[f64]) -> &[f64] {
        &[]
    }

    /// Writes the nonzero derivatives of one of them by `y` at `(t, y)`, as `(place in y, value)`.
    fn kink_gradient(&mut self, _kink: usize, _t: f64, _y: &[f64], gradient: &mut Vec<(usize, f64)>) {
        gradient.clear();
    }
}
