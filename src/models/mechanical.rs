//! Mechanical systems given by symbolic expressions. With the kinetic energy `T = v^T M v / 2`, a potential `V` and
//! forces `Q`, Lagrange's equations `d/dt dT/dv - dT/dq = Q - dV/dq` are
//!
//! ```text
//! M v' = f = Q - dV/dq + dT/dq - (d(M v)/dq) v - (dM/dt) v
//! ```
//!
//! All derivatives are exact. For joints and contact normals, `J` and `b` in `u = J v + b` are derivatives of
//! constraints and gaps; for slip directions, they are the coefficients of expressions that are affine in `v`.

mod coefficient;

pub use coefficient::slip_speed_input;

use coefficient::Coefficient;
use expression::{Breaks, ExpressionError, Graph, IntervalWorkspace, Jumps, Knots, Node, Tape};
use nalgebra::DMatrix;
use numerics::Interval;
use problem::{
    Constraints, ContactData, DynamicsRange, Energies, Mechanical, MechanicalStructure, PLAIN_DEGREE, Sensitivity,
    SensitivityRange,
};

/// The equations of a mechanical system with `n` coordinates, as nodes of an expression [`Graph`] whose inputs are `t`,
/// then the coordinates `q` (`n`), then the velocities `v` (`n`).
#[derive(Clone, Debug)]
pub struct MechanicalRows {
    /// The symmetric mass matrix `M` of the system by rows, `n * n` nodes.
    pub mass: Vec<Node>,
    /// The potential energy `V` of the mechanical system.
    pub potential: Node,
    /// The generalised forces `Q` on the system, one per coordinate.
    pub forces: Vec<Node>,
    /// The functions `phi` of the joint constraints `phi(t, q) = 0`.
    pub joints: Vec<Node>,
    /// The gap functions of the contacts, functions of `t` and the coordinates `q`.
    pub gaps: Vec<Node>,
    /// The slip velocities of all contacts, affine in the velocities `v`.
    pub slips: Vec<Node>,
    /// The contact laws (friction and restitution), one per contact.
    pub contacts: Vec<ContactData>,
    /// The coefficient of friction of each contact whose coefficient varies, with the slip speed as additional input
    /// [`slip_speed_input`]; `None` for constant coefficients.
    pub coefficients: Vec<Option<Node>>,
}

/// An error of differentiation: the part of a mechanical system whose derivative exceeds the size limits of the
/// expression graph.
#[derive(Clone, Debug, PartialEq)]
pub enum DifferentiationError {
    /// The part is the mass matrix `M`, the potential energy `V` or the forces `Q`.
    Dynamics(ExpressionError),
    /// The part is the function of the joint constraint with this index.
    Joint(usize, ExpressionError),
    /// The part is the gap function of the contact with this index.
    Gap(usize, ExpressionError),
    /// The part is the slip velocity with this index, counted over all contacts.
    Slip(usize, ExpressionError),
    /// The part is the coefficient of friction of the contact with this index.
    Coefficient(usize, ExpressionError),
}

/// A mechanical system compiled from symbolic expressions, with its own workspace.
#[derive(Clone, Debug)]
pub struct SymbolicMechanics {
    structure: MechanicalStructure,
    mass: Tape,
    forces: Tape,
    stiffness: Sparse,
    values: Tape,
    enclosures: Enclosures,
    drift: Tape,
    rows: Sparse,
    energies: Tape,
    bias: Tape,
    /// The derivatives with respect to `(q, v)` of the force balance, constraint accelerations and constraint
    /// velocities, stacked in this order, as compiled expressions.
    sensitivity: Sparse,
    /// The derivatives with respect to time of the force balance, constraint accelerations and constraint velocities,
    /// in one column, as compiled expressions.
    in_time: Sparse,
    /// The force balance, constraint accelerations, constraint velocities, and values of joint constraints and gaps, as
    /// nodes of the expression graph.
    terms: Vec<Node>,
    /// For each contact, the compiled coefficient of friction if it varies; `None` if it is constant.
    coefficients: Vec<Option<Coefficient>>,
    breaks: Breaks,
    jumps: Jumps,
    knots: Knots,
    /// The inputs of the compiled expressions after `t`: coordinates `q`, velocities `v`, accelerations `a`,
    /// multipliers `lambda`.
    inputs: Vec<f64>,
    scratch: Vec<f64>,
}

/// Interval workspaces for the compiled expressions of a mechanical system.
#[derive(Clone, Debug)]
struct Enclosures {
    values: IntervalWorkspace,
    drift: IntervalWorkspace,
    rows: IntervalWorkspace,
    forces: IntervalWorkspace,
    bias: IntervalWorkspace,
    mass: IntervalWorkspace,
    sensitivity: IntervalWorkspace,
    /// The intervals of the inputs of the compiled expressions: coordinates `q`, velocities `v`, accelerations `a`,
    /// multipliers `lambda`.
    inputs: Vec<Interval>,
    jacobian: Vec<Interval>,
}

/// The structural nonzeros of a matrix, and the compiled expressions of their values.
#[derive(Clone, Debug)]
struct Sparse {
    places: Vec<(usize, usize)>,
    tape: Tape,
}

impl Sparse {
    fn compile(graph: &mut Graph, entries: Vec<((usize, usize), Node)>) -> Self {
        let (places, nodes): (Vec<_>, Vec<Node>) =
            entries.into_iter().filter(|&(_, node)| !graph.is_absent(node)).unzip();
        Self { tape: Tape::compile(graph, &nodes), places }
    }
}

/// The indices of the inputs of the expression graph: time `t`, coordinates `q`, velocities `v`, accelerations `a` and
/// multipliers `lambda`.
struct Inputs {
    n: usize,
}

impl Inputs {
    fn q(&self, i: usize) -> usize {
        1 + i
    }

    fn v(&self, i: usize) -> usize {
        1 + self.n + i
    }

    fn a(&self, i: usize) -> usize {
        1 + 2 * self.n + i
    }

    fn lambda(&self, row: usize) -> usize {
        1 + 3 * self.n + row
    }
}

/// Returns the derivatives of an expression with respect to every input below `count`, zeros included.
fn derivatives(graph: &mut Graph, node: Node, count: usize) -> Result<Vec<Node>, ExpressionError> {
    let zero = graph.constant(0.0);
    let mut all = vec![zero; count];
    for (input, derivative) in graph.gradient(node)? {
        if let Some(place) = all.get_mut(input) {
            *place = derivative;
        }
    }
    Ok(all)
}

/// Returns the total time derivative of an expression from its partial derivatives, with `t' = 1` and `q' = v`.
fn along(graph: &mut Graph, derivatives: &[Node], n: usize) -> Node {
    let mut sum = derivatives[0];
    for i in 0..n {
        let v = graph.input(1 + n + i);
        let term = graph.multiply(derivatives[1 + i], v);
        sum = graph.add(sum, term);
    }
    sum
}

impl SymbolicMechanics {
    /// Differentiates and compiles a mechanical system.
    ///
    /// # Errors
    /// The first part of the system whose derivative exceeds the size limits of `graph`.
    pub fn new(graph: &mut Graph, rows: &MechanicalRows) -> Result<Self, DifferentiationError> {
        let n = rows.forces.len();
        let inputs = Inputs { n };
        let wide = 1 + 2 * n;
        let momenta = momenta(graph, &rows.mass, n);
        let forces = lagrange(graph, rows, &momenta).map_err(DifferentiationError::Dynamics)?;
        let mut stiffness = Vec::new();
        for (i, &f) in forces.iter().enumerate() {
            let by = derivatives(graph, f, wide).map_err(DifferentiationError::Dynamics)?;
            stiffness.extend((0..2 * n).map(|j| ((i, j), by[1 + j])));
        }

        // Build the expressions of the constraint velocities `u = J v + b`, row by row.
        let (mut velocities, mut drift, mut jacobian) = (Vec::new(), Vec::new(), Vec::new());
        let holonomic = rows.joints.iter().map(|&node| (node, true)).chain(rows.gaps.iter().map(|&node| (node, false)));
        for (row, (node, is_joint)) in holonomic.enumerate() {
            let refuse = |error| match is_joint {
                true => DifferentiationError::Joint(row, error),
                false => DifferentiationError::Gap(row - rows.joints.len(), error),
            };
            let by = derivatives(graph, node, wide).map_err(refuse)?;
            velocities.push(along(graph, &by, n));
            drift.push(by[0]);
            jacobian.extend((0..n).map(|j| ((j, row), by[inputs.q(j)])));
        }
        for (k, &node) in rows.slips.iter().enumerate() {
            let row = velocities.len();
            let by = derivatives(graph, node, wide).map_err(|error| DifferentiationError::Slip(k, error))?;
            let mut still = node;
            for j in 0..n {
                let v = graph.input(inputs.v(j));
                let term = graph.multiply(by[inputs.v(j)], v);
                still = graph.subtract(still, term);
            }
            velocities.push(node);
            drift.push(still);
            jacobian.extend((0..n).map(|j| ((j, row), by[inputs.v(j)])));
        }

        let lost = DifferentiationError::Dynamics;
        let mut bias = Vec::new();
        let mut sensitivity = Vec::new();
        let rate = |graph: &mut Graph, u: Node| -> Result<(Node, Node, Vec<Node>), ExpressionError> {
            let by = derivatives(graph, u, wide)?;
            let gamma = along(graph, &by, n);
            let mut acceleration = gamma;
            for j in 0..n {
                let a = graph.input(inputs.a(j));
                let term = graph.multiply(by[inputs.v(j)], a);
                acceleration = graph.add(acceleration, term);
            }
            Ok((gamma, acceleration, by))
        };
        let (mut later, mut in_time, mut accelerations) = (Vec::new(), Vec::new(), Vec::new());
        for (below, &u) in (n..).zip(&velocities) {
            let (gamma, acceleration, by) = rate(graph, u).map_err(lost)?;
            bias.push(gamma);
            accelerations.push(acceleration);
            let by_state = derivatives(graph, acceleration, wide).map_err(lost)?;
            sensitivity.extend((0..2 * n).map(|j| ((below, j), by_state[1 + j])));
            later.extend((0..2 * n).map(|j| ((below + velocities.len(), j), by[1 + j])));
            in_time.extend([((below, 0), by_state[0]), ((below + velocities.len(), 0), by[0])]);
        }
        sensitivity.extend(later);
        let mut terms = Vec::new();
        for (i, &force) in forces.iter().enumerate() {
            let mut balance = graph.negate(force);
            for j in 0..n {
                let a = graph.input(inputs.a(j));
                let term = graph.multiply(rows.mass[i * n + j], a);
                balance = graph.add(balance, term);
            }
            for &((j, row), node) in &jacobian {
                if j == i {
                    let lambda = graph.input(inputs.lambda(row));
                    let term = graph.multiply(node, lambda);
                    balance = graph.subtract(balance, term);
                }
            }
            let by = derivatives(graph, balance, wide).map_err(lost)?;
            sensitivity.extend((0..2 * n).map(|j| ((i, j), by[1 + j])));
            in_time.push(((i, 0), by[0]));
            terms.push(balance);
        }
        terms.extend(accelerations.into_iter().chain(velocities.iter().copied()));

        let [kinetic, potential, power] = energies(graph, rows, &momenta);
        let lagrangian = graph.subtract(kinetic, potential);
        let by_time = derivatives(graph, lagrangian, 1).map_err(lost)?[0];
        let energies = [kinetic, potential, power, graph.negate(by_time)];
        let mut coefficients = Vec::with_capacity(rows.coefficients.len());
        for (k, node) in rows.coefficients.iter().enumerate() {
            let coefficient = node.map(|node| Coefficient::new(graph, node, n)).transpose();
            coefficients.push(coefficient.map_err(|error| DifferentiationError::Coefficient(k, error))?);
        }
        let stiffness = Sparse::compile(graph, stiffness);
        let terms_in_time = Sparse::compile(graph, in_time);
        let constant = |nodes: &[Node]| nodes.iter().all(|&node| graph.value(node).is_some());
        let holonomic: Vec<Node> = rows.joints.iter().chain(&rows.gaps).copied().collect();
        terms.extend(&holonomic);
        let in_time = |nodes: &[Node]| nodes.iter().any(|&node| graph.inputs(node).contains(&0));
        let of_holonomic = jacobian.iter().filter(|((_, row), _)| *row < holonomic.len());
        let straight = of_holonomic.map(|(_, node)| *node).collect::<Vec<_>>();
        let varying: Vec<Node> = rows.coefficients.iter().flatten().copied().collect();
        let of_motion: Vec<Node> =
            [&rows.mass, &forces, &holonomic, &drift, &bias].into_iter().flatten().copied().collect();
        let all: Vec<Node> = of_motion.iter().chain(&varying).copied().collect();
        let structure = MechanicalStructure {
            coordinates: n,
            joints: rows.joints.len(),
            contacts: rows.contacts.clone(),
            constant_mass: constant(&rows.mass),
            constant_forces: stiffness.places.is_empty(),
            depends_on_time: [&rows.mass, &forces, &velocities, &holonomic, &varying].into_iter().any(|of| in_time(of)),
            has_features: [&all, &velocities].into_iter().any(|of| !graph.beyond_degree(of, PLAIN_DEGREE).is_empty()),
            has_features_of_forces: !graph.beyond_degree(&forces, PLAIN_DEGREE).is_empty(),
            affine_constraints: constant(&straight) && !in_time(&holonomic),
        };
        let values = Tape::compile(graph, &holonomic);
        let (breaks, jumps) = (Breaks::new(graph, &all), Jumps::new(graph, &of_motion));
        let knots = Knots::new(graph, &of_motion);
        let mass = Tape::compile(graph, &rows.mass);
        let sensitivity = Sparse::compile(graph, sensitivity);
        let (drift, bias) = (Tape::compile(graph, &drift), Tape::compile(graph, &bias));
        let (forces, jacobian) = (Tape::compile(graph, &forces), Sparse::compile(graph, jacobian));
        let enclosures = Enclosures {
            values: IntervalWorkspace::new(&values),
            drift: IntervalWorkspace::new(&drift),
            rows: IntervalWorkspace::new(&jacobian.tape),
            forces: IntervalWorkspace::new(&forces),
            bias: IntervalWorkspace::new(&bias),
            mass: IntervalWorkspace::new(&mass),
            sensitivity: IntervalWorkspace::new(&sensitivity.tape),
            inputs: Vec::new(),
            jacobian: Vec::new(),
        };
        Ok(Self {
            mass,
            forces,
            stiffness,
            enclosures,
            breaks,
            jumps,
            knots,
            values,
            drift,
            rows: jacobian,
            energies: Tape::compile(graph, &energies),
            bias,
            sensitivity,
            in_time: terms_in_time,
            terms,
            coefficients,
            inputs: vec![0.0; 3 * n + structure.rows()],
            scratch: Vec::new(),
            structure,
        })
    }

    /// Binds new parameter values to the compiled expressions of the mechanical system.
    pub(super) fn bind(&mut self, parameters: &[f64]) {
        let Enclosures { values, drift, rows, forces, bias, mass, sensitivity, .. } = &mut self.enclosures;
        let enclosed = [
            (&mut self.values, values),
            (&mut self.drift, drift),
            (&mut self.rows.tape, rows),
            (&mut self.forces, forces),
            (&mut self.bias, bias),
            (&mut self.mass, mass),
            (&mut self.sensitivity.tape, sensitivity),
        ];
        for (tape, ranges) in enclosed {
            tape.bind(parameters);
            ranges.bind(tape);
        }
        for tape in [&mut self.stiffness.tape, &mut self.energies, &mut self.in_time.tape] {
            tape.bind(parameters);
        }
        self.coefficients.iter_mut().flatten().for_each(|coefficient| coefficient.bind(parameters));
        self.breaks.bind(parameters);
        self.jumps.bind(parameters);
        self.knots.bind(parameters);
    }

    /// Returns the expressions whose derivatives with respect to parameters give those of the motion: the force
    /// balance `M a - f - J^T lambda` (`n`), the constraint accelerations `u' = J a + gamma` and velocities `u` (one
    /// per row of `J` each), and the values of joint constraints and gaps. They are nodes of the graph from which the
    /// system was compiled, with inputs `t`, `q`, `v`, `a`, `lambda`.
    pub fn terms(&self) -> &[Node] {
        &self.terms
    }

    /// Returns the contact laws for modification, so that new parameter values can be set in their coefficients.
    pub(super) fn contacts_mut(&mut self) -> &mut [ContactData] {
        &mut self.structure.contacts
    }

    fn place(&mut self, q: &[f64], v: &[f64]) {
        let n = self.structure.coordinates;
        self.inputs[..n].copy_from_slice(q);
        self.inputs[n..2 * n].copy_from_slice(v);
    }

    /// Sets the inputs of the compiled expressions to the coordinates `q` and zero velocities, for expressions that do
    /// not depend on velocities.
    fn place_at_rest(&mut self, q: &[f64]) {
        let n = self.structure.coordinates;
        self.inputs[..n].copy_from_slice(q);
        self.inputs[n..2 * n].fill(0.0);
    }
}

/// Returns the momenta `p = M v` as nodes of the expression graph.
fn momenta(graph: &mut Graph, mass: &[Node], n: usize) -> Vec<Node> {
    (0..n)
        .map(|i| {
            (0..n).fold(graph.constant(0.0), |sum, j| {
                let v = graph.input(1 + n + j);
                let term = graph.multiply(mass[i * n + j], v);
                graph.add(sum, term)
            })
        })
        .collect()
}

/// Returns the kinetic energy `T`, the potential energy `V` and the power `Q^T v` as nodes of the expression graph.
fn energies(graph: &mut Graph, rows: &MechanicalRows, momenta: &[Node]) -> [Node; 3] {
    let n = momenta.len();
    let mut products = [momenta, &rows.forces].map(|factors| {
        factors.iter().enumerate().fold(graph.constant(0.0), |sum, (i, &factor)| {
            let v = graph.input(1 + n + i);
            let term = graph.multiply(factor, v);
            graph.add(sum, term)
        })
    });
    let half = graph.constant(0.5);
    products[0] = graph.multiply(half, products[0]);
    [products[0], rows.potential, products[1]]
}

/// Returns the right-hand side `f` of Lagrange's equations `M v' = f` as nodes of the expression graph.
fn lagrange(graph: &mut Graph, rows: &MechanicalRows, momenta: &[Node]) -> Result<Vec<Node>, ExpressionError> {
    let n = momenta.len();
    let [kinetic, potential, _] = energies(graph, rows, momenta);
    let lagrangian = graph.subtract(kinetic, potential);
    let slope = derivatives(graph, lagrangian, 1 + n)?;
    let mut forces = Vec::with_capacity(n);
    for i in 0..n {
        let by = derivatives(graph, momenta[i], 1 + n)?;
        let transport = along(graph, &by, n);
        let force = graph.add(rows.forces[i], slope[1 + i]);
        forces.push(graph.subtract(force, transport));
    }
    Ok(forces)
}

impl Mechanical for SymbolicMechanics {
    fn structure(&self) -> &MechanicalStructure {
        &self.structure
    }

    fn mass(&mut self, t: f64, q: &[f64], mass: &mut DMatrix<f64>) {
        self.place_at_rest(q);
        // The expressions of the mass matrix `M` are in row order and the matrix is stored in column order, which does
        // not matter since `M` is symmetric.
        self.mass.evaluate(t, &self.inputs, mass.as_mut_slice());
    }

    fn forces(&mut self, t: f64, q: &[f64], v: &[f64], f: &mut [f64]) {
        self.place(q, v);
        self.forces.evaluate(t, &self.inputs, f);
    }

    fn stiffness(&mut self, t: f64, q: &[f64], v: &[f64], by_q: &mut DMatrix<f64>, by_v: &mut DMatrix<f64>) {
        self.place(q, v);
        let n = self.structure.coordinates;
        by_q.fill(0.0);
        by_v.fill(0.0);
        self.scratch.resize(self.stiffness.places.len(), 0.0);
        self.stiffness.tape.evaluate(t, &self.inputs, &mut self.scratch);
        for (&(i, j), &value) in self.stiffness.places.iter().zip(&self.scratch) {
            match j.checked_sub(n) {
                None => by_q[(i, j)] = value,
                Some(j) => by_v[(i, j)] = value,
            }
        }
    }

    fn constraints(&mut self, t: f64, q: &[f64], constraints: &mut Constraints) {
        self.place_at_rest(q);
        self.values.evaluate(t, &self.inputs, &mut constraints.values);
        self.drift.evaluate(t, &self.inputs, &mut constraints.drift);
        self.scratch.resize(self.rows.places.len(), 0.0);
        self.rows.tape.evaluate(t, &self.inputs, &mut self.scratch);
        for (&place, &value) in self.rows.places.iter().zip(&self.scratch) {
            constraints.transposed[place] = value;
        }
    }

    fn positions(&mut self, t: f64, q: &[f64], values: &mut [f64]) {
        self.place_at_rest(q);
        self.values.evaluate(t, &self.inputs, values);
    }

    fn enclose_positions(&mut self, t: Interval, q: &[Interval], values: &mut [Interval]) {
        self.values.enclose(t, q, &mut self.enclosures.values, values);
    }

    fn enclose_velocities(&mut self, t: Interval, q: &[Interval], v: &[Interval], values: &mut [Interval]) {
        let Enclosures { drift, rows, inputs, jacobian, .. } = &mut self.enclosures;
        inputs.clear();
        inputs.extend(q.iter().chain(v).copied());
        let mut all = vec![Interval::LINE; self.structure.rows()];
        self.drift.enclose(t, inputs, drift, &mut all);
        values.copy_from_slice(&all[..values.len()]);
        jacobian.resize(self.rows.places.len(), Interval::LINE);
        self.rows.tape.enclose(t, inputs, rows, jacobian);
        for (&(j, row), &by) in self.rows.places.iter().zip(&*jacobian) {
            if let Some(value) = values.get_mut(row) {
                *value = *value + by * v[j];
            }
        }
    }

    fn enclose_in_time(&mut self, t: Interval, q: &[f64], v: &[f64], values: &mut [Interval]) {
        let (n, rows) = (self.structure.coordinates, self.structure.rows());
        let Enclosures { drift, forces, bias, inputs, .. } = &mut self.enclosures;
        inputs.clear();
        inputs.extend(q.iter().chain(v).map(|x| Interval::point(*x)));
        let (of_forces, rest) = values.split_at_mut(n);
        let (of_drift, of_bias) = rest.split_at_mut(rows);
        self.forces.enclose(t, inputs, forces, of_forces);
        self.drift.enclose(t, inputs, drift, of_drift);
        self.bias.enclose(t, inputs, bias, of_bias);
    }

    fn enclose_forces(&mut self, t: Interval, q: &[Interval], v: &[Interval], f: &mut [Interval]) {
        let Enclosures { forces, inputs, .. } = &mut self.enclosures;
        inputs.clear();
        inputs.extend(q.iter().chain(v).copied());
        self.forces.enclose(t, inputs, forces, f);
    }

    fn enclose_dynamics(&mut self, t: Interval, q: &[Interval], v: &[Interval], range: &mut DynamicsRange) {
        let Enclosures { drift, rows, forces, bias, mass, inputs, jacobian, .. } = &mut self.enclosures;
        inputs.clear();
        inputs.extend(q.iter().chain(v).copied());
        self.mass.enclose(t, inputs, mass, &mut range.mass);
        self.forces.enclose(t, inputs, forces, &mut range.forces);
        self.drift.enclose(t, inputs, drift, &mut range.drift);
        self.bias.enclose(t, inputs, bias, &mut range.bias);
        jacobian.resize(self.rows.places.len(), Interval::LINE);
        self.rows.tape.enclose(t, inputs, rows, jacobian);
        range.rows.fill(Interval::point(0.0));
        for (&(j, row), &by) in self.rows.places.iter().zip(&*jacobian) {
            range.rows[row * q.len() + j] = by;
        }
    }

    fn enclose_sensitivity(
        &mut self,
        t: Interval,
        x: &[Interval],
        a: &[f64],
        lambda: &[f64],
        range: &mut SensitivityRange,
    ) {
        let (n, rows) = (self.structure.coordinates, self.structure.rows());
        let Enclosures { sensitivity, inputs, jacobian, .. } = &mut self.enclosures;
        inputs.clear();
        inputs.extend(x.iter().copied().chain(a.iter().chain(lambda).map(|value| Interval::point(*value))));
        jacobian.resize(self.sensitivity.places.len(), Interval::LINE);
        self.sensitivity.tape.enclose(t, inputs, sensitivity, jacobian);
        for (matrix, count) in [(&mut range.balance, n), (&mut range.acceleration, rows)] {
            matrix.clear();
            matrix.resize(count * 2 * n, Interval::point(0.0));
        }
        for (&(i, j), &value) in self.sensitivity.places.iter().zip(&*jacobian) {
            match i.checked_sub(n) {
                Some(i) if i < rows => range.acceleration[i * 2 * n + j] = value,
                None => range.balance[i * 2 * n + j] = value,
                Some(_) => {}
            }
        }
    }

    fn may_jump(&mut self, t: Interval, x: &[Interval]) -> bool {
        self.jumps.may_be_in(t, x) || self.coefficients.iter_mut().flatten().any(|mu| mu.may_jump(t, x))
    }

    fn may_pass_knot(&mut self, t: Interval, x: &[Interval]) -> bool {
        self.knots.may_be_in(t, x)
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

    fn friction(&mut self, k: usize, t: f64, q: &[f64], v: &[f64], slip_speed: f64) -> f64 {
        match &mut self.coefficients[k] {
            Some(coefficient) => coefficient.value(t, (q, v), slip_speed),
            None => self.structure.contacts[k].mu,
        }
    }

    fn friction_slopes(&mut self, k: usize, t: f64, q: &[f64], v: &[f64], slip_speed: f64, slopes: &mut [f64]) {
        match &mut self.coefficients[k] {
            Some(coefficient) => coefficient.slopes(t, (q, v), slip_speed, slopes),
            None => slopes.fill(0.0),
        }
    }

    fn enclose_friction(&mut self, k: usize, t: Interval, x: &[Interval], slip_speed: Interval) -> Interval {
        match &mut self.coefficients[k] {
            Some(coefficient) => coefficient.enclose(t, x, slip_speed),
            None => Interval::point(self.structure.contacts[k].mu),
        }
    }

    fn enclose_friction_slopes(
        &mut self,
        k: usize,
        t: Interval,
        x: &[Interval],
        slip_speed: Interval,
        slopes: &mut [Interval],
    ) {
        match &mut self.coefficients[k] {
            Some(coefficient) => coefficient.enclose_slopes(t, x, slip_speed, slopes),
            None => slopes.fill(Interval::point(0.0)),
        }
    }

    fn energies(&mut self, t: f64, q: &[f64], v: &[f64]) -> Energies {
        self.place(q, v);
        let mut values = [0.0; 4];
        self.energies.evaluate(t, &self.inputs, &mut values);
        let [kinetic, potential, power, drive] = values;
        Energies { kinetic, potential, power, drive }
    }

    fn bias(&mut self, t: f64, q: &[f64], v: &[f64], gamma: &mut [f64]) {
        self.place(q, v);
        self.bias.evaluate(t, &self.inputs, gamma);
    }

    fn sensitivity(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &[f64], out: &mut Sensitivity) {
        self.place(q, v);
        let (n, rows) = (self.structure.coordinates, self.structure.rows());
        self.inputs[2 * n..3 * n].copy_from_slice(a);
        self.inputs[3 * n..].copy_from_slice(lambda);
        out.balance.resize_mut(n, 2 * n, 0.0);
        out.acceleration.resize_mut(rows, 2 * n, 0.0);
        out.velocity.resize_mut(rows, 2 * n, 0.0);
        self.scratch.resize(self.sensitivity.places.len(), 0.0);
        self.sensitivity.tape.evaluate(t, &self.inputs, &mut self.scratch);
        for (&(i, j), &value) in self.sensitivity.places.iter().zip(&self.scratch) {
            match (i.checked_sub(n), i.checked_sub(n + rows)) {
                (_, Some(i)) => out.velocity[(i, j)] = value,
                (Some(i), None) => out.acceleration[(i, j)] = value,
                (None, None) => out.balance[(i, j)] = value,
            }
        }
    }

    fn sensitivity_in_time(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &[f64], out: &mut [f64]) {
        self.place(q, v);
        let n = self.structure.coordinates;
        self.inputs[2 * n..3 * n].copy_from_slice(a);
        self.inputs[3 * n..].copy_from_slice(lambda);
        self.scratch.resize(self.in_time.places.len(), 0.0);
        self.in_time.tape.evaluate(t, &self.inputs, &mut self.scratch);
        out.fill(0.0);
        for (&(i, _), &value) in self.in_time.places.iter().zip(&self.scratch) {
            out[i] = value;
        }
    }
}
