//! Coefficients of friction `mu(t, q, v, s)` that vary in time, from place to place, and with the slip speed `s`
//! (Stribeck 1902). The slip speed is a separate input, since `|u_t|` is not differentiable in `v` at a sticking
//! contact; within one contact mode it is smooth.

use expression::{ExpressionError, Graph, IntervalWorkspace, Jumps, Node, Tape};
use numerics::Interval;

/// Returns the index of the graph input for the slip speed of a coefficient of friction, in a system with `n`
/// coordinates: it follows `t`, `q` and `v`, in place of the first acceleration, on which no coefficient depends.
pub fn slip_speed_input(n: usize) -> usize {
    1 + 2 * n
}

/// A compiled coefficient of friction with its derivatives with respect to `(q, v, s)`: coordinates, velocities and
/// slip speed.
#[derive(Clone, Debug)]
pub(super) struct Coefficient {
    value: Tape,
    slopes: Tape,
    /// The indices in `(q, v, s)` of the structurally nonzero derivatives of the coefficient of friction.
    places: Vec<usize>,
    of_value: IntervalWorkspace,
    of_slopes: IntervalWorkspace,
    jumps: Jumps,
    inputs: Vec<f64>,
    values: Vec<f64>,
    boxes: Vec<Interval>,
    ranges: Vec<Interval>,
}

impl Coefficient {
    /// Differentiates and compiles the coefficient of a contact in a system with `n` coordinates.
    ///
    /// # Errors
    /// If the derivative exceeds the size limits of `graph`.
    pub fn new(graph: &mut Graph, node: Node, n: usize) -> Result<Self, ExpressionError> {
        let gradient = graph.gradient(node)?;
        let by_state = gradient.into_iter().filter(|(input, _)| (1..=slip_speed_input(n)).contains(input));
        let (places, nodes): (Vec<usize>, Vec<Node>) = by_state.map(|(input, node)| (input - 1, node)).unzip();
        let (value, slopes) = (Tape::compile(graph, &[node]), Tape::compile(graph, &nodes));
        Ok(Self {
            of_value: IntervalWorkspace::new(&value),
            of_slopes: IntervalWorkspace::new(&slopes),
            jumps: Jumps::new(graph, &[node]),
            inputs: vec![0.0; 2 * n + 1],
            values: vec![0.0; places.len()],
            boxes: Vec::new(),
            ranges: vec![Interval::LINE; places.len()],
            places,
            value,
            slopes,
        })
    }

    /// Binds new parameter values to the compiled coefficient of friction and its derivatives.
    pub fn bind(&mut self, parameters: &[f64]) {
        for (tape, ranges) in [(&mut self.value, &mut self.of_value), (&mut self.slopes, &mut self.of_slopes)] {
            tape.bind(parameters);
            ranges.bind(tape);
        }
        self.jumps.bind(parameters);
    }

    fn place(&mut self, q: &[f64], v: &[f64], slip_speed: f64) {
        let (of_state, of_slip) = self.inputs.split_at_mut(q.len() + v.len());
        of_state[..q.len()].copy_from_slice(q);
        of_state[q.len()..].copy_from_slice(v);
        of_slip[0] = slip_speed;
    }

    fn place_box(&mut self, x: &[Interval], slip_speed: Interval) {
        self.boxes.clear();
        self.boxes.extend(x.iter().copied().chain([slip_speed]));
    }

    /// Evaluates the coefficient of friction at a state and a slip speed.
    pub fn value(&mut self, t: f64, (q, v): (&[f64], &[f64]), slip_speed: f64) -> f64 {
        self.place(q, v, slip_speed);
        let mut mu = [0.0];
        self.value.evaluate(t, &self.inputs, &mut mu);
        mu[0]
    }

    /// Writes the derivatives of the coefficient of friction with respect to `(q, v, s)`, where `s` is the slip
    /// speed.
    pub fn slopes(&mut self, t: f64, (q, v): (&[f64], &[f64]), slip_speed: f64, slopes: &mut [f64]) {
        self.place(q, v, slip_speed);
        self.slopes.evaluate(t, &self.inputs, &mut self.values);
        slopes.fill(0.0);
        for (&place, &value) in self.places.iter().zip(&self.values) {
            slopes[place] = value;
        }
    }

    /// Encloses the coefficient of friction over a box of `t`, states `x = (q, v)` and slip speeds.
    pub fn enclose(&mut self, t: Interval, x: &[Interval], slip_speed: Interval) -> Interval {
        self.place_box(x, slip_speed);
        let mut mu = [Interval::LINE];
        self.value.enclose(t, &self.boxes, &mut self.of_value, &mut mu);
        mu[0]
    }

    /// Returns whether the coefficient of friction may have a jump in a box of `t` and states `x = (q, v)`, at any slip
    /// speed.
    pub fn may_jump(&mut self, t: Interval, x: &[Interval]) -> bool {
        self.place_box(x, Interval::new(0.0, f64::INFINITY));
        self.jumps.may_be_in(t, &self.boxes)
    }

    /// Encloses the derivatives of the coefficient of friction with respect to `(q, v, s)` over a box of `t`, states
    /// `x = (q, v)` and slip speeds `s`.
    pub fn enclose_slopes(&mut self, t: Interval, x: &[Interval], slip_speed: Interval, slopes: &mut [Interval]) {
        self.place_box(x, slip_speed);
        self.slopes.enclose(t, &self.boxes, &mut self.of_slopes, &mut self.ranges);
        slopes.fill(Interval::point(0.0));
        for (&place, &range) in self.places.iter().zip(&self.ranges) {
            slopes[place] = range;
        }
    }
}
