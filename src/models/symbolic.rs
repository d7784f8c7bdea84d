//! The general form, in expressions:
//!
//! ```text
//! M x' = F(t,x,z),    z in K(t,x),    <G(t,x,z), z~ - z> >= 0  for all z~ in K(t,x)
//! ```
//!
//! with `F` affine in `z`. Values, Jacobian and time derivatives are one [`Tape`] each; derivatives are exact.

use expression::{Breaks, ExpressionError, Graph, IntervalWorkspace, Irregularities, Kink, Kinks, Node, Tape};
use numerics::Interval;
use problem::{ConvexSet, Dvi, Mass, MovingBound, Structure};

/// The rows of a problem as nodes of a [`Graph`] whose inputs are `t`, then `x` (n), then `z` (m).
#[derive(Clone, Debug)]
pub struct Rows {
    /// `M`.
    pub mass: Mass,
    /// `F`, one a state.
    pub rates: Vec<Node>,
    /// `G`, one a variable.
    pub inequality: Vec<Node>,
    /// `K` with its constant bounds.
    pub set: ConvexSet,
    /// The bounds that vary with `(t, x)`.
    pub moving: Vec<(MovingBound, Node)>,
}

/// Why rows are no differential variational inequality.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The derivative of a rate by a variable depends on the variables.
    #[error("rate {rate} is not affine in variable {variable}")]
    NotAffine {
        /// The row of `F`.
        rate: usize,
        /// The index of the variable.
        variable: usize,
    },
    /// A row could not be differentiated.
    #[error("row {row}: {error}")]
    Derivative {
        /// The row, counted through `F`, `G` and the moving bounds.
        row: usize,
        /// The bound that was passed.
        error: ExpressionError,
    },
}

/// A problem in expressions, with registers of its own.
#[derive(Clone, Debug)]
pub struct Symbolic {
    structure: Structure,
    values: Tape,
    derivatives: Tape,
    time_derivatives: Tape,
    breaks: Breaks,
    kinks: Kinks,
    /// Those of the three tapes over boxes.
    boxes: [IntervalWorkspace; 3],
    irregularities: Irregularities,
}

impl Symbolic {
    /// Differentiates and compiles the rows.
    ///
    /// # Errors
    /// Every rate that is not affine in the variables, and every row whose derivative passes the bounds of `graph`.
    pub fn new(graph: &mut Graph, rows: Rows) -> Result<Self, Vec<Refusal>> {
        let (n, m) = (rows.rates.len(), rows.inequality.len());
        let outputs: Vec<Node> = rows
            .rates
            .iter()
            .chain(&rows.inequality)
            .copied()
            .chain(rows.moving.iter().map(|&(_, node)| node))
            .collect();
        let mut refusals = Vec::new();
        let (mut pattern, mut derivatives) = (Vec::new(), Vec::new());
        let zero = graph.constant(0.0);
        let mut by_time = vec![zero; m];
        for (row, &output) in outputs.iter().enumerate() {
            let gradient = match graph.gradient(output) {
                Ok(gradient) => gradient,
                Err(error) => {
                    refusals.push(Refusal::Derivative { row, error });
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
                    refusals.push(Refusal::NotAffine { rate: row, variable: column - n });
                }
                if graph.value(derivative) != Some(0.0) {
                    pattern.push((row, column));
                    derivatives.push(derivative);
                }
            }
        }
        if !refusals.is_empty() {
            return Err(refusals);
        }
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
        let [values, derivatives, time_derivatives] = tapes;
        let (breaks, kinks) = (Breaks::new(graph, &outputs), Kinks::new(graph, &outputs));
        let irregularities = Irregularities::new(graph, &outputs);
        Ok(Self { structure, values, derivatives, time_derivatives, boxes, breaks, kinks, irregularities })
    }

    /// What has a kink or a jump that depends on `y`, in the order of [`Dvi::kinks`].
    pub fn kinks(&self) -> &[Kink] {
        self.kinks.kinks()
    }

    /// Where the rows are not locally Lipschitz in states and variables.
    pub fn irregularities(&self) -> &Irregularities {
        &self.irregularities
    }
}

impl Dvi for Symbolic {
    fn structure(&self) -> &Structure {
        &self.structure
    }

    fn evaluate(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        self.values.evaluate(t, y, values);
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

    fn kinks(&mut self, t: f64, y: &[f64]) -> &[f64] {
        self.kinks.at(t, y)
    }

    fn kink_gradient(&mut self, kink: usize, t: f64, y: &[f64], gradient: &mut Vec<(usize, f64)>) {
        gradient.clear();
        gradient.extend(self.kinks.gradient(kink, t, y));
    }
}
