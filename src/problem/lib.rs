//! The interface between steppers and a differential variational inequality:
//!
//! ```text
//! M x' = F(t,x,z) = f(t,x) + B(t,x) z,    z in K(t,x),    <G(t,x,z), z~ - z> >= 0  for all z~ in K(t,x)
//! ```
//!
//! with `n` states `x` and `m` variables `z`. A problem consists of its [`Structure`] and evaluations of values and
//! derivatives ([`Dvi`]). The unknowns of a stage of a time step are stored as `y = (x, z)`, of length `n + m`.

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

/// The kind of a bound of the convex set `K` that varies with `(t, x)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The lower end `l` of an interval of `K`.
    Lower,
    /// The upper end `u` of an interval of `K`.
    Upper,
    /// The radius of the ball that contains the variable in a block of `K`.
    Radius,
}

impl Side {
    /// Returns, for error messages, the kind of set that becomes empty when the bound moves too far, and the reason why
    /// it does.
    pub fn emptiness(self) -> (&'static str, &'static str) {
        match self {
            Self::Lower | Self::Upper => ("interval", "its lower bound exceeds its upper bound"),
            Self::Radius => ("ball", "its radius becomes negative"),
        }
    }
}

/// A bound of the convex set `K` that varies with `(t, x)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MovingBound {
    /// The index of the variable in `z` that the moving bound limits, below `m`.
    pub variable: usize,
    /// Which bound of the variable moves: the lower or the upper end of its interval, or the radius of its ball.
    pub side: Side,
}

impl MovingBound {
    /// Sets this bound of the convex set `set`, an end of an interval or the radius of a ball, to `value`.
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

/// The mass matrix `M` of the differential equations `M x' = F(t, x, z)`.
#[derive(Clone, Debug, PartialEq)]
pub enum Mass {
    /// The mass matrix is the identity, `M = I`.
    Identity,
    /// The mass matrix is constant, given as triplets `(row, column, value)` without duplicate entries; it may be
    /// singular.
    Constant(Vec<(usize, usize, f64)>),
}

/// The structure of a differential variational inequality: sizes, mass matrix, convex set and sparsity pattern.
#[derive(Clone, Debug)]
pub struct Structure {
    /// The number `n` of states `x`.
    pub states: usize,
    /// The number `m` of variables `z`.
    pub variables: usize,
    /// The mass matrix `M` of the differential equations.
    pub mass: Mass,
    /// The convex set `K` with its constant bounds; the values of the bounds listed in `moving` are arbitrary.
    pub set: ConvexSet,
    /// The bounds of `K` that vary with `(t, x)`, in the order in which [`Dvi::evaluate`] writes them.
    pub moving: Vec<MovingBound>,
    /// The structural nonzeros of the Jacobian of the problem, as `(row, column)` sorted by row, then column. Rows:
    /// rates `F` (`n`), inequality functions `G` (`m`), then moving bounds; columns: `x` (`n`), then `z` (`m`).
    pub pattern: Vec<(usize, usize)>,
    /// Whether the Jacobian of the problem does not depend on `(t, y)`.
    pub constant_jacobian: bool,
}

impl Structure {
    /// Returns `n + m`, the length of the vector of unknowns `y = (x, z)`.
    pub fn unknowns(&self) -> usize {
        self.states + self.variables
    }

    /// Returns whether the set of variable `k` in `K` is bounded at all times, with moving bounds counted as finite.
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

    /// Returns whether the set of some variable in `K` is unbounded but not the whole line, so that the variable may
    /// have impulses.
    pub fn has_impulses(&self) -> bool {
        (0..self.variables).any(|k| !self.set.is_free(k) && !self.is_bounded(k))
    }

    /// Returns the number of values that [`Dvi::evaluate`] writes: `n` rates, `m` inequality functions, and the moving
    /// bounds.
    pub fn rows(&self) -> usize {
        self.unknowns() + self.moving.len()
    }
}

/// Linear combinations of terms (functions of time), one per rate or inequality function of the problem, each as a list
/// of pairs `(index of a term, factor)`.
pub type Sums = Vec<Vec<(usize, f64)>>;

/// The time derivatives of the rates `F` and inequality functions `G` as linear combinations of terms that are
/// functions of time alone. Terms that several rows share cancel in linear combinations of rows before the terms are
/// enclosed by intervals.
#[derive(Clone, Debug, Default)]
pub struct ForcingSlopes {
    /// The number of terms (functions of time) that the time derivatives combine.
    pub terms: usize,
    /// The time derivatives `dF/dt` of the rates, one linear combination for each of the `n` states.
    pub rates: Sums,
    /// The time derivatives `dG/dt` of the inequality functions, one linear combination for each of the `m` variables.
    pub inequality: Sums,
    /// The second time derivatives `d^2G/dt^2` of the inequality functions, one linear combination for each of the `m`
    /// variables.
    pub curvature: Sums,
}

/// Largest degree of polynomials in the states that [`Dvi::features`] does not report as unresolved: three-stage Radau
/// IIA integrates them exactly along a straight line.
pub const PLAIN_DEGREE: u32 = 4;

/// A differential variational inequality that can be evaluated at `(t, y)` without allocation.
pub trait Dvi: Send {
    /// Returns the sizes, the convex set and the sparsity pattern of the problem.
    fn structure(&self) -> &Structure;

    /// Writes the rates `F` (`n`), the inequality functions `G` (`m`) and the moving bounds at `(t, y)` into `values`,
    /// of length [`Structure::rows`]. Undefined values are NaN or infinite; the caller must check.
    fn evaluate(&mut self, t: f64, y: &[f64], values: &mut [f64]);

    /// Evaluates the problem at several points at once; `ys` and `values` are concatenated by point. The results are
    /// bitwise equal to those of [`Dvi::evaluate`].
    fn evaluate_points(&mut self, times: &[f64], ys: &[f64], values: &mut [f64]) {
        let (unknowns, rows) = (self.structure().unknowns(), self.structure().rows());
        for (i, &t) in times.iter().enumerate() {
            self.evaluate(t, &ys[unknowns * i..][..unknowns], &mut values[rows * i..][..rows]);
        }
    }

    /// Writes the derivatives of `F`, `G` and the moving bounds with respect to `y = (x, z)`, in the order of
    /// [`Structure::pattern`].
    fn jacobian(&mut self, t: f64, y: &[f64], values: &mut [f64]);

    /// Writes the partial derivatives of the `m` inequality functions `G` with respect to `t` at `(t, y)`.
    fn time_derivative(&mut self, t: f64, y: &[f64], values: &mut [f64]);

    /// Encloses `F`, `G` and the moving bounds over a box of `(t, y)`, in the order of [`Dvi::evaluate`]. Returns false
    /// if the problem does not support enclosure.
    fn enclose(&mut self, _t: Interval, _y: &[Interval], _values: &mut [Interval]) -> bool {
        false
    }

    /// Encloses the derivatives of `F`, `G` and the moving bounds with respect to `y`, in the order of
    /// [`Structure::pattern`], and those of `G` with respect to `t`, over a box of `(t, y)`. Returns false if the
    /// problem does not support enclosure.
    fn enclose_derivatives(
        &mut self,
        _t: Interval,
        _y: &[Interval],
        _jacobian: &mut [Interval],
        _by_time: &mut [Interval],
    ) -> bool {
        false
    }

    /// Measures the variation of the derivatives with respect to `y` over three successive points `(t, y)`: for each
    /// derivative, its range and the difference of its middle value from the mean of its end values. An
    /// implementation whose [`Dvi::enclose_derivatives`] computes the derivatives from other quantities may measure
    /// the variation of those quantities instead.
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

    /// Returns the largest angular frequency of the explicit time dependence of `F`, `G` and the moving bounds, in
    /// radians per unit of time: the stages of a step resolve oscillations whose phase advances by less than half a
    /// turn. Zero without time dependence, infinite if unknown.
    fn pace(&mut self) -> f64 {
        0.0
    }

    /// Returns the rows, counted through `F`, `G` and the moving bounds, that are not polynomials of low degree in
    /// `y = (x, z)`: within a time step these rows may vary in ways that its stages do not resolve.
    fn features(&self) -> &[usize] {
        &[]
    }

    /// Returns whether a row of `F`, `G` or the moving bounds may have a jump that depends on `y` in a box of `(t,
    /// y)`.
    fn may_jump(&mut self, _t: Interval, _y: &[Interval]) -> bool {
        false
    }

    /// Returns whether a row of `F`, `G` or the moving bounds may pass a knot in a box of `(t, y)`: a value of `y` at
    /// which a derivative of the row, of some order, jumps.
    fn may_pass_knot(&mut self, _t: Interval, _y: &[Interval]) -> bool {
        false
    }

    /// Returns the time derivatives of `F` and `G` as linear combinations of terms; `None` if they are unknown or
    /// depend on `y`.
    fn forcing_slopes(&self) -> Option<&ForcingSlopes> {
        None
    }

    /// Encloses the terms of [`Dvi::forcing_slopes`] (functions of time) over an interval of `t`.
    fn enclose_forcing_slopes(&mut self, _t: Interval, _terms: &mut [Interval]) {}

    /// Returns the event functions of time, evaluated at `t`: where one of them changes sign, a row of `F`, `G` or the
    /// moving bounds has a kink or a jump that does not depend on `y`. The number of event functions is constant.
    fn breaks(&mut self, _t: f64) -> &[f64] {
        &[]
    }

    /// Returns, for each event function of [`Dvi::breaks`], a quantity that is smooth where the event function
    /// changes sign, such as the argument of a `floor`: its derivatives with respect to `t` and to parameters
    /// determine how the times of the sign changes move with the parameters.
    fn break_courses(&mut self, t: f64) -> &[f64] {
        self.breaks(t)
    }

    /// Encloses the event functions of [`Dvi::breaks`] over an interval of `t`; empty if they cannot be enclosed.
    fn enclose_breaks(&mut self, _t: Interval) -> &[Interval] {
        &[]
    }

    /// Returns the event functions of `(t, y)`: where one of them changes sign, a row of `F`, `G` or the moving bounds
    /// has a kink or a jump that depends on `y`. The number of event functions is constant.
    fn kinks(&mut self, _t: f64, _y: &[f64]) -> &[f64] {
        &[]
    }

    /// Writes the nonzero derivatives of one event function of [`Dvi::kinks`] with respect to `y`, as
    /// `(index in y, value)`.
    fn kink_gradient(&mut self, _kink: usize, _t: f64, _y: &[f64], gradient: &mut Vec<(usize, f64)>) {
        gradient.clear();
    }
}
