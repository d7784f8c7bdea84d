//! The linear complementarity system
//!
//! ```text
//! M x' = A x + B z + a(t),    z in K(t,x),    G = C x + D z + g(t)
//! ```
//!
//! The matrices are stored as one sparse matrix `[A B; C D]`, which is also the Jacobian. The forcing `(a, g)` and
//! the moving bounds of `K`, if any, are symbolic expressions.

use super::ParametricTerms;
use super::forcing_slopes::Slopes;
use expression::{Breaks, ExpressionError, Graph, IntervalWorkspace, MOST_LANES, Node, Pace, Tape};
use numerics::Interval;
use problem::{ConvexSet, Dvi, ForcingSlopes, Mass, MovingBound, Structure};

/// The matrices, forcing and convex set of a linear complementarity system with `n` states and `m` variables.
#[derive(Clone, Debug)]
pub struct LinearRows {
    /// The mass matrix `M` of the linear complementarity system.
    pub mass: Mass,
    /// The matrix `[A B; C D]` of the system as triplets `(row, column, value)` in any order, without duplicate
    /// entries.
    pub matrix: Vec<(usize, usize, f64)>,
    /// The entries of `[A B; C D]` that depend on parameters, as triplets `(row, column, node of the expression graph)`
    /// in any order.
    pub parametric: Vec<(usize, usize, Node)>,
    /// The forcing `a` of the `n` rates, functions of `t` alone.
    pub state_forcing: Vec<Node>,
    /// The forcing `g` of the `m` inequality functions, functions of `t` alone.
    pub inequality_forcing: Vec<Node>,
    /// The convex set `K` of the variables, with its constant bounds.
    pub set: ConvexSet,
    /// The bounds of `K` that vary with `(t, x)`.
    pub moving: Vec<(MovingBound, Node)>,
}

impl LinearRows {
    /// Returns the forcing, moving bounds and matrix entries of the system, as the terms that may depend on parameters.
    pub fn terms(&self) -> ParametricTerms {
        let bounds = self.moving.iter().map(|(_, node)| node);
        let rows = self.state_forcing.iter().chain(&self.inequality_forcing).chain(bounds).copied().collect();
        ParametricTerms { rows, coefficients: self.parametric.clone(), ..ParametricTerms::default() }
    }
}

/// A compiled linear complementarity system with its own workspace.
#[derive(Clone, Debug)]
pub struct Linear {
    structure: Structure,
    /// The values of the entries of `[A B; C D]`, which come first in the sparsity pattern, before the derivatives of
    /// moving bounds.
    coefficients: Vec<f64>,
    /// Indices into `coefficients` of the entries of `[A B; C D]` that depend on parameters.
    parametric: Vec<u32>,
    /// The compiled expressions of the entries of `[A B; C D]` that depend on parameters, with a buffer for their
    /// values.
    decided: (Tape, Vec<f64>),
    /// The column of each entry of `[A B; C D]` in `coefficients`, as `u32` to save memory bandwidth, since every
    /// evaluation reads all columns.
    columns: Vec<u32>,
    /// For each row of `[A B; C D]`, the index in `coefficients` behind its last entry.
    row_ends: Vec<usize>,
    /// The compiled expressions of the forcing `a`, `g` and of the moving bounds.
    forcing: Tape,
    bound_derivatives: Tape,
    time_derivatives: Tape,
    /// The time derivatives of the forcing `a` and `g`, and the second time derivatives of `g`; `None` if one exceeds
    /// the size limits of the expression graph.
    slopes: Option<Slopes>,
    breaks: Breaks,
    pace: Pace,
    /// Interval workspaces of the compiled expressions `forcing`, `bound_derivatives` and `time_derivatives`, in this
    /// order.
    boxes: [IntervalWorkspace; 3],
    /// The midpoint and the radius of the interval of each unknown.
    balls: Vec<(f64, f64)>,
    /// The values of each unknown at several evaluation points, side by side for vectorisation.
    lanes: Vec<f64>,
}

impl Linear {
    /// Compiles the forcing and sorts the matrix entries by rows.
    ///
    /// # Errors
    /// The index of the first moving bound or component of `g` (counted after the moving bounds) whose
    /// derivative exceeds the size limits of `graph`.
    pub fn new(graph: &mut Graph, rows: LinearRows) -> Result<Self, (usize, ExpressionError)> {
        let (n, m) = (rows.state_forcing.len(), rows.inequality_forcing.len());
        let mut matrix = rows.matrix;
        matrix.sort_unstable_by_key(|&(row, column, _)| (row, column));
        let columns = matrix.iter().map(|&(_, column, _)| u32::try_from(column).expect("fewer than 2^32 unknowns"));
        let columns = columns.collect();
        let row_ends = (0..n + m).map(|row| matrix.partition_point(|&(i, _, _)| i <= row)).collect();
        let mut pattern: Vec<(usize, usize)> = matrix.iter().map(|&(row, column, _)| (row, column)).collect();
        let place = |&(row, column, _): &(usize, usize, Node)| {
            let place = pattern.binary_search(&(row, column)).expect("an entry of the matrix");
            u32::try_from(place).expect("fewer than 2^32 entries")
        };
        let parametric: Vec<u32> = rows.parametric.iter().map(place).collect();
        let terms: Vec<Node> = rows.parametric.iter().map(|&(.., node)| node).collect();
        let decided = (Tape::compile(graph, &terms), vec![0.0; terms.len()]);
        let coefficients = matrix.into_iter().map(|(_, _, value)| value).collect();
        let mut derivatives = Vec::new();
        for (k, &(_, bound)) in rows.moving.iter().enumerate() {
            let gradient = graph.gradient(bound).map_err(|error| (k, error))?;
            for (input, derivative) in gradient.into_iter().filter(|&(input, _)| input > 0) {
                pattern.push((n + m + k, input - 1));
                derivatives.push(derivative);
            }
        }
        let zero = graph.constant(0.0);
        let mut by_time_of = |node: Node| -> Result<Node, ExpressionError> {
            let gradient = graph.gradient(node)?;
            Ok(gradient.first().map_or(zero, |&(_, derivative)| derivative))
        };
        let mut by_time = Vec::with_capacity(m);
        for (k, &g) in rows.inequality_forcing.iter().enumerate() {
            by_time.push(by_time_of(g).map_err(|error| (rows.moving.len() + k, error))?);
        }
        let slopes = rows.state_forcing.iter().chain(&by_time).map(|&node| by_time_of(node));
        let slopes: Option<Vec<Node>> = slopes.collect::<Result<_, _>>().ok();
        let slopes = slopes.map(|slopes| Slopes::new(graph, &slopes[..n], &by_time, &slopes[n..]));
        let outputs: Vec<Node> = rows
            .state_forcing
            .into_iter()
            .chain(rows.inequality_forcing)
            .chain(rows.moving.iter().map(|&(_, node)| node))
            .collect();
        let structure = Structure {
            states: n,
            variables: m,
            mass: rows.mass,
            set: rows.set,
            moving: rows.moving.into_iter().map(|(bound, _)| bound).collect(),
            pattern,
            constant_jacobian: derivatives.iter().all(|&derivative| graph.value(derivative).is_some()),
        };
        let tapes = [&outputs, &derivatives, &by_time].map(|nodes| Tape::compile(graph, nodes));
        let boxes = std::array::from_fn(|i| IntervalWorkspace::new(&tapes[i]));
        let [forcing, bound_derivatives, time_derivatives] = tapes;
        Ok(Self {
            structure,
            coefficients,
            parametric,
            decided,
            columns,
            row_ends,
            forcing,
            bound_derivatives,
            time_derivatives,
            slopes,
            boxes,
            balls: Vec::new(),
            lanes: Vec::new(),
            breaks: Breaks::new(graph, &outputs),
            pace: Pace::new(graph, &outputs),
        })
    }
}

impl Linear {
    /// Binds new parameter values to the compiled expressions, and updates the matrix entries that depend on
    /// parameters.
    pub(super) fn bind(&mut self, parameters: &[f64]) {
        let (tape, values) = &mut self.decided;
        tape.bind(parameters);
        tape.evaluate(0.0, &[], values);
        for (&place, &value) in self.parametric.iter().zip(values.iter()) {
            self.coefficients[place as usize] = value;
        }
        for (tape, range) in [&mut self.forcing, &mut self.bound_derivatives, &mut self.time_derivatives]
            .into_iter()
            .zip(&mut self.boxes)
        {
            tape.bind(parameters);
            range.bind(tape);
        }
        if let Some(slopes) = &mut self.slopes {
            slopes.bind(parameters);
        }
        self.breaks.bind(parameters);
        self.pace.bind(parameters);
    }

    /// Adds the product of the matrix `[A B; C D]` with the unknowns `y` to `values`, for at most `L` evaluation points
    /// at once.
    fn add_products<const L: usize>(&mut self, ys: &[f64], values: &mut [f64]) {
        let (unknowns, rows) = (self.structure.unknowns(), self.structure.rows());
        self.lanes.resize(L * unknowns, 0.0);
        let lanes = self.lanes.as_chunks_mut::<L>().0;
        for (point, y) in ys.chunks_exact(unknowns).enumerate() {
            lanes.iter_mut().zip(y).for_each(|(lanes, y)| lanes[point] = *y);
        }
        let mut first = 0;
        for (row, &end) in self.row_ends.iter().enumerate() {
            let products = products(&self.columns[first..end], &self.coefficients[first..end], lanes);
            values[row..].iter_mut().step_by(rows).zip(products).for_each(|(value, product)| *value += product);
            first = end;
        }
    }

    pub(super) fn structure_mut(&mut self) -> &mut Structure {
        &mut self.structure
    }
}

impl Dvi for Linear {
    fn structure(&self) -> &Structure {
        &self.structure
    }

    fn pace(&mut self) -> f64 {
        self.pace.fastest()
    }

    fn evaluate(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.forcing.evaluate(t, y, values);
        let mut first = 0;
        for (value, &end) in values.iter_mut().zip(&self.row_ends) {
            let [product] = products(&self.columns[first..end], &self.coefficients[first..end], y.as_chunks::<1>().0);
            *value += product;
            first = end;
        }
    }

    fn evaluate_points(&mut self, times: &[f64], ys: &[f64], values: &mut [f64]) {
        self.forcing.evaluate_points(times, ys, values);
        let (unknowns, rows) = (self.structure.unknowns(), self.structure.rows());
        for begin in (0..times.len()).step_by(MOST_LANES) {
            let end = times.len().min(begin + MOST_LANES);
            let (ys, values) = (&ys[unknowns * begin..unknowns * end], &mut values[rows * begin..rows * end]);
            match end - begin {
                1 => self.add_products::<1>(ys, values),
                2..=4 => self.add_products::<4>(ys, values),
                5 | 6 => self.add_products::<6>(ys, values),
                _ => self.add_products::<MOST_LANES>(ys, values),
            }
        }
    }

    fn jacobian(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        let (constant, varying) = values.split_at_mut(self.coefficients.len());
        constant.copy_from_slice(&self.coefficients);
        if !varying.is_empty() {
            self.bound_derivatives.evaluate(t, y, varying);
        }
    }

    fn time_derivative(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.time_derivatives.evaluate(t, y, values);
    }

    fn enclose(&mut self, t: Interval, y: &[Interval], values: &mut [Interval]) -> bool {
        self.forcing.enclose(t, y, &mut self.boxes[0], values);
        self.balls.clear();
        self.balls.extend(y.iter().map(|range| range.ball()));
        let mut first = 0;
        for (value, &end) in values.iter_mut().zip(&self.row_ends) {
            *value = *value + range_of_product(&self.columns[first..end], &self.coefficients[first..end], &self.balls);
            first = end;
        }
        true
    }

    fn enclose_derivatives(
        &mut self,
        t: Interval,
        y: &[Interval],
        jacobian: &mut [Interval],
        by_time: &mut [Interval],
    ) -> bool {
        let (constant, varying) = jacobian.split_at_mut(self.coefficients.len());
        for (entry, &coefficient) in constant.iter_mut().zip(&self.coefficients) {
            *entry = Interval::point(coefficient);
        }
        if !varying.is_empty() {
            self.bound_derivatives.enclose(t, y, &mut self.boxes[1], varying);
        }
        self.time_derivatives.enclose(t, y, &mut self.boxes[2], by_time);
        true
    }

    fn forcing_slopes(&self) -> Option<&ForcingSlopes> {
        self.slopes.as_ref().map(|slopes| &slopes.sums)
    }

    fn enclose_forcing_slopes(&mut self, t: Interval, terms: &mut [Interval]) {
        if let Some(slopes) = &mut self.slopes {
            slopes.enclose(t, terms);
        }
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
}

/// The number of independent partial sums per row of a sparse matrix product, for instruction-level parallelism.
const PARTS: usize = 4;

/// Returns the products of a sparse matrix row with the unknowns at `L` evaluation points, where `y[j]` holds unknown
/// `j` at all points. The product at a point is bitwise equal for all `L`.
#[inline(always)]
fn products<const L: usize>(columns: &[u32], coefficients: &[f64], y: &[[f64; L]]) -> [f64; L] {
    let add = |sums: &mut [f64; L], column: u32, coefficient: f64| {
        let y = &y[column as usize];
        sums.iter_mut().zip(y).for_each(|(sum, y)| *sum += coefficient * y);
    };
    let (columns, last_columns) = columns.as_chunks::<PARTS>();
    let (coefficients, last_coefficients) = coefficients.as_chunks::<PARTS>();
    let mut parts = [[0.0; L]; PARTS];
    for (columns, coefficients) in columns.iter().zip(coefficients) {
        for k in 0..PARTS {
            add(&mut parts[k], columns[k], coefficients[k]);
        }
    }
    let [a, b, c, d] = parts;
    let mut sums = std::array::from_fn(|lane| (a[lane] + b[lane]) + (c[lane] + d[lane]));
    for (&column, &coefficient) in last_columns.iter().zip(last_coefficients) {
        add(&mut sums, column, coefficient);
    }
    sums
}

/// Encloses the product of a sparse row with unknowns given as `(midpoint, radius)`: the product with the midpoints,
/// plus or minus the sum of the product of absolute values with the radii and the rounding errors (Rump 1999, *Fast
/// and parallel interval arithmetic*).
fn range_of_product(columns: &[u32], coefficients: &[f64], balls: &[(f64, f64)]) -> Interval {
    let (mut middle, mut radius, mut size) = (0.0_f64, 0.0_f64, 0.0_f64);
    for (&column, coefficient) in columns.iter().zip(coefficients) {
        let (of_middle, of_radius) = balls[column as usize];
        let term = coefficient * of_middle;
        middle += term;
        size += term.abs();
        radius += coefficient.abs() * of_radius;
    }
    // The rounding error of a sum of `k` products is at most `k` rounding units relative to the sum of absolute
    // values; two further units cover the rounding of `middle - half` and `middle + half`.
    let rounding = (columns.len() + 2) as f64 * f64::EPSILON * (size + radius);
    let half = (radius + rounding).next_up();
    if half.is_finite() && middle.is_finite() { Interval::new(middle - half, middle + half) } else { Interval::LINE }
}
