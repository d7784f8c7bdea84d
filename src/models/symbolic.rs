//! A general differential variational inequality in symbolic expressions:
//!
//! ```text
//! M x' = F(t,x,z),    z in K(t,x),    <G(t,x,z), z~ - z> >= 0  for all z~ in K(t,x)
//! ```
//!
//! with `F` affine in `z`. Values, Jacobian and time derivatives are compiled to one [`Tape`] each; derivatives are
//! exact.

use super::{Equations, Linear, LinearRows, ParametricTerms};
use expression::{
    Assumption, Breaks, ExpressionError, Graph, IntervalWorkspace, Irregularities, Jumps, Kink, Kinks, Knots, Node,
    Pace, Tape,
};
use numerics::Interval;
use problem::{ConvexSet, Dvi, Mass, MovingBound, PLAIN_DEGREE, Structure};

/// The rows (rates, inequality functions, moving bounds) of a differential variational inequality as nodes of a
/// [`Graph`] whose inputs are `t`, then `x` (`n`), then `z` (`m`).
#[derive(Clone, Debug)]
pub struct Rows {
    /// The mass matrix `M` of the differential equations.
    pub mass: Mass,
    /// The rates `F`, one node of the graph per state.
    pub rates: Vec<Node>,
    /// The inequality functions `G`, one node of the graph per variable.
    pub inequality: Vec<Node>,
    /// The convex set `K` of the variables, with its constant bounds.
    pub set: ConvexSet,
    /// The bounds of `K` that vary with `(t, x)`.
    pub moving: Vec<(MovingBound, Node)>,
}

impl Rows {
    /// Returns the rows `F`, `G` and the moving bounds as the terms that may depend on parameters.
    pub fn terms(&self) -> ParametricTerms {
        let bounds = self.moving.iter().map(|(_, node)| node);
        let rows = self.rates.iter().chain(&self.inequality).chain(bounds).copied().collect();
        ParametricTerms { rows, ..ParametricTerms::default() }
    }
}

/// Why the rows `F`, `G` and the moving bounds cannot be compiled to a differential variational inequality.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LoweringError {
    /// A rate of `F` is not affine in the variables `z`.
    #[error("rate {rate} is not affine in variable {variable}")]
    NotAffine {
        /// The index in `F` of the rate that is not affine.
        rate: usize,
        /// The index in `z` of the variable in which the rate is not affine.
        variable: usize,
    },
    /// The derivative of a row of `F`, `G` or the moving bounds exceeds the size limits of the expression graph.
    #[error("row {row}: {error}")]
    Derivative {
        /// The index of the row, counted through `F`, `G` and the moving bounds.
        row: usize,
        /// The size limit of the expression graph that the derivative exceeds.
        error: ExpressionError,
    },
}

/// A differential variational inequality compiled from symbolic expressions, with its own workspace.
#[derive(Clone, Debug)]
pub struct Symbolic {
    structure: Structure,
    values: Tape,
    derivatives: Tape,
    time_derivatives: Tape,
    breaks: Breaks,
    pace: Pace,
    features: Vec<usize>,
    jumps: Jumps,
    knots: Knots,
    kinks: Kinks,
    /// Interval workspaces of the compiled expressions `values`, `derivatives` and `time_derivatives`, in this order.
    boxes: [IntervalWorkspace; 3],
    irregularities: Irregularities,
}

/// The derivatives of the rows of a differential variational inequality, as nodes of the expression graph.
struct Gradients {
    /// The rows `F`, `G` and the moving bounds, as nodes of the expression graph.
    outputs: Vec<Node>,
    /// The structural nonzeros of the Jacobian of the rows with respect to `y = (x, z)`, as `(row, column)`.
    pattern: Vec<(usize, usize)>,
    /// The derivatives of the rows with respect to `y = (x, z)`, at the structural nonzeros in `pattern`.
    by_unknowns: Vec<Node>,
    /// The time derivatives of the inequality functions `G`, one per variable.
    by_time: Vec<Node>,
    /// The kinks and jumps of the rows in the unknowns `y = (x, z)`.
    kinks: Kinks,
}

impl Gradients {
    fn new(graph: &mut Graph, rows: &Rows) -> Result<Self, Vec<LoweringError>> {
        let (n, m) = (rows.rates.len(), rows.inequality.len());
        let bounds = rows.moving.iter().map(|&(_, node)| node);
        let outputs: Vec<Node> = rows.rates.iter().chain(&rows.inequality).copied().chain(bounds).collect();
        let mut errors = Vec::new();
        let (mut pattern, mut by_unknowns) = (Vec::new(), Vec::new());
        let zero = graph.constant(0.0);
        let mut by_time = vec![zero; m];
        for (row, &output) in outputs.iter().enumerate() {
            let gradient = match graph.gradient(output) {
                Ok(gradient) => gradient,
                Err(error) => {
                    errors.push(LoweringError::Derivative { row, error });
                    continue;
                }
            };
            for (input, derivative) in gradient {
                let Some(column) = input.checked_sub(1) else {
                    if (n..n + m).contains(&row) {
                        by_time[row - n] = derivative;
                    }
                    continue;
                };
                if row < n && column >= n && graph.inputs(derivative).iter().any(|&input| input > n) {
                    errors.push(LoweringError::NotAffine { rate: row, variable: column - n });
                }
                if !graph.is_absent(derivative) {
                    pattern.push((row, column));
                    by_unknowns.push(derivative);
                }
            }
        }
        if !errors.is_empty() {
            return Err(errors);
        }
        let kinks = Kinks::new(graph, &outputs);
        Ok(Self { outputs, pattern, by_unknowns, by_time, kinks })
    }

    /// Returns the rows `F` and `G` as constant matrices and a forcing; `None` if a row is not affine in `y = (x, z)`
    /// with constant coefficients.
    fn affine(&self, graph: &mut Graph, rows: &Rows) -> Option<LinearRows> {
        let (n, count) = (rows.rates.len(), rows.rates.len() + rows.inequality.len());
        self.by_unknowns.iter().for_each(|&node| graph.assume(node, Assumption::Finite));
        let coefficients: Option<Vec<f64>> = self.by_unknowns.iter().map(|&node| graph.value(node)).collect();
        let coefficients = coefficients.filter(|coefficients| coefficients.iter().all(|value| value.is_finite()))?;
        // Rows with a jump, such as `sign`, have constant derivatives but are not affine.
        if !self.kinks.kinks().is_empty() {
            return None;
        }
        let mut forcing = Vec::with_capacity(count);
        for &row in &self.outputs[..count] {
            let zeros: Vec<(usize, f64)> =
                graph.inputs(row).into_iter().filter(|&input| input > 0).map(|input| (input, 0.0)).collect();
            let of_time = graph.substitute(row, &zeros).ok()?;
            graph.assume(of_time, Assumption::Finite);
            if graph.value(of_time).is_some_and(|value| !value.is_finite()) {
                return None;
            }
            forcing.push(of_time);
        }
        let matrix = self.pattern.iter().zip(coefficients).filter(|((row, _), _)| *row < count);
        let parametric = self.pattern.iter().zip(&self.by_unknowns);
        let parametric = parametric.filter(|((row, _), node)| *row < count && graph.number(**node).is_none());
        Some(LinearRows {
            mass: rows.mass.clone(),
            matrix: matrix.map(|(&(row, column), value)| (row, column, value)).collect(),
            parametric: parametric.map(|(&(row, column), &node)| (row, column, node)).collect(),
            inequality_forcing: forcing.split_off(n),
            state_forcing: forcing,
            set: rows.set.clone(),
            moving: rows.moving.clone(),
        })
    }
}

impl Equations {
    /// Differentiates and compiles the rows `F`, `G` and the moving bounds; the result is [`Linear`] if all rows are
    /// affine in `y` with constant coefficients.
    ///
    /// # Errors
    /// Every rate that is not affine in the variables, and every row whose derivative exceeds the size
    /// limits of `graph`.
    pub fn new(graph: &mut Graph, rows: Rows) -> Result<Self, Vec<LoweringError>> {
        let gradients = Gradients::new(graph, &rows)?;
        if let Some(affine) = gradients.affine(graph, &rows)
            && let Ok(linear) = Linear::new(graph, affine)
        {
            return Ok(Self::Linear(Box::new(linear)));
        }
        Ok(Self::Symbolic(Box::new(Symbolic::compile(graph, rows, gradients))))
    }
}

impl Symbolic {
    fn compile(graph: &mut Graph, rows: Rows, gradients: Gradients) -> Self {
        let Gradients { outputs, pattern, by_unknowns, by_time, kinks } = gradients;
        let structure = Structure {
            states: rows.rates.len(),
            variables: rows.inequality.len(),
            mass: rows.mass,
            set: rows.set,
            moving: rows.moving.into_iter().map(|(bound, _)| bound).collect(),
            pattern,
            constant_jacobian: by_unknowns.iter().all(|&derivative| graph.value(derivative).is_some()),
        };
        let tapes = [&outputs, &by_unknowns, &by_time].map(|nodes| Tape::compile(graph, nodes));
        let boxes = std::array::from_fn(|i| IntervalWorkspace::new(&tapes[i]));
        let [values, derivatives, time_derivatives] = tapes;
        let breaks = Breaks::new(graph, &outputs);
        let pace = Pace::new(graph, &outputs);
        let irregularities = Irregularities::new(graph, &outputs);
        Self {
            features: graph.beyond_degree(&outputs, PLAIN_DEGREE),
            jumps: Jumps::new(graph, &outputs),
            knots: Knots::new(graph, &outputs),
            structure,
            values,
            derivatives,
            time_derivatives,
            boxes,
            breaks,
            pace,
            kinks,
            irregularities,
        }
    }

    /// Binds new parameter values to the compiled expressions of the equations.
    pub(super) fn bind(&mut self, parameters: &[f64]) {
        for (tape, range) in
            [&mut self.values, &mut self.derivatives, &mut self.time_derivatives].into_iter().zip(&mut self.boxes)
        {
            tape.bind(parameters);
            range.bind(tape);
        }
        self.breaks.bind(parameters);
        self.jumps.bind(parameters);
        self.knots.bind(parameters);
        self.pace.bind(parameters);
        self.kinks.bind(parameters);
        self.irregularities.bind(parameters);
    }

    pub(super) fn structure_mut(&mut self) -> &mut Structure {
        &mut self.structure
    }

    /// Returns the kinks and jumps of the rows that depend on `y = (x, z)`, in the order of [`Dvi::kinks`].
    pub fn kinks(&self) -> &[Kink] {
        self.kinks.kinks()
    }

    /// Returns the points where the rows `F`, `G` and the moving bounds are not locally Lipschitz in states and
    /// variables.
    pub fn irregularities(&self) -> &Irregularities {
        &self.irregularities
    }
}

impl Dvi for Symbolic {
    fn structure(&self) -> &Structure {
        &self.structure
    }

    fn pace(&mut self) -> f64 {
        self.pace.fastest()
    }

    fn features(&self) -> &[usize] {
        &self.features
    }

    fn may_jump(&mut self, t: Interval, y: &[Interval]) -> bool {
        self.jumps.may_be_in(t, y)
    }

    fn may_pass_knot(&mut self, t: Interval, y: &[Interval]) -> bool {
        self.knots.may_be_in(t, y)
    }

    fn evaluate(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.values.evaluate(t, y, values);
    }

    fn evaluate_points(&mut self, times: &[f64], ys: &[f64], values: &mut [f64]) {
        self.values.evaluate_points(times, ys, values);
    }

    fn jacobian(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.derivatives.evaluate(t, y, values);
    }

    fn time_derivative(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.time_derivatives.evaluate(t, y, values);
    }

    fn enclose(&mut self, t: Interval, y: &[Interval], values: &mut [Interval]) -> bool {
        self.values.enclose(t, y, &mut self.boxes[0], values);
        true
    }

    fn enclose_derivatives(
        &mut self,
        t: Interval,
        y: &[Interval],
        jacobian: &mut [Interval],
        by_time: &mut [Interval],
    ) -> bool {
        self.derivatives.enclose(t, y, &mut self.boxes[1], jacobian);
        self.time_derivatives.enclose(t, y, &mut self.boxes[2], by_time);
        true
    }

    fn breaks(&mut self, t: f64) -> &[f64] {
        self.breaks.at(t)
    }

    fn break_courses(&mut self, t: f64) -> &[f64] {
        self.breaks.courses(t)
    }

    fn enclose_breaks(&mut self, t: Interval) -> &[Interval] {
        self.breaks.over(t)
    }

    fn kinks(&mut self, t: f64, y: &[f64]) -> &[f64] {
        self.kinks.at(t, y)
    }

    fn kink_gradient(&mut self, kink: usize, t: f64, y: &[f64], gradient: &mut Vec<(usize, f64)>) {
        gradient.clear();
        gradient.extend(self.kinks.gradient(kink, t, y));
    }
}
