//! Derivatives of a differential variational inequality with respect to its parameters: those of `F`, `G` and moving
//! bounds at `(t, y)`, and those of the constants (initial states, mass matrix, constant bounds). The derivatives are
//! exact (reverse-mode differentiation).

use super::parameters::Source;
use expression::{ExpressionError, Graph, Node, Tape};
use problem::MovingBound;

/// Compiled expressions of the derivatives of a problem with respect to its parameters, with their own workspace.
#[derive(Clone, Debug)]
pub struct Slopes {
    /// The structural nonzeros of the derivatives of the rows `F`, `G` and the moving bounds with respect to
    /// parameters, as pairs `(row, parameter)`.
    pattern: Vec<(usize, usize)>,
    rows: Tape,
    /// The chain rule for inputs that are functions of the parameters (circuit coefficients); `None` without such
    /// inputs.
    chain: Option<Chain>,
    initial: Constants<usize>,
    mass: Constants<(usize, usize)>,
    bounds: Constants<MovingBound>,
    /// The derivatives of the contact coefficients with respect to parameters, by their index in
    /// [`ParametricTerms::contacts`](super::ParametricTerms::contacts).
    contacts: Constants<usize>,
}

/// The chain rule for circuit coefficients: maps derivatives with respect to the inputs of the compiled expressions
/// (parameters and circuit coefficients) to derivatives with respect to parameters.
#[derive(Clone, Debug)]
struct Chain {
    /// For each derivative with respect to an input of the compiled expressions, the structural nonzeros (indices into
    /// the pattern of [`Slopes`]) to which it contributes, with factors.
    shares: Vec<Vec<(usize, f64)>>,
    values: Vec<f64>,
}

/// The derivatives, with respect to parameters, of constants that depend on them, each with the position `P` of the
/// constant and the index of the parameter.
#[derive(Clone, Debug)]
struct Constants<P> {
    places: Vec<(P, usize)>,
    tape: Tape,
    values: Vec<f64>,
}

impl Slopes {
    pub(super) fn new(source: &Source) -> Result<Self, ExpressionError> {
        let mut graph = source.graph.clone();
        let terms = &source.terms;
        let mut rows = terms.rows.clone();
        for &(row, column, coefficient) in &terms.coefficients {
            let unknown = graph.input(1 + column);
            let term = graph.multiply(coefficient, unknown);
            rows[row] = graph.add(rows[row], term);
        }
        let (pattern, nodes) = derivatives(&mut graph, rows.into_iter().enumerate())?;
        let rows = Tape::compile(&graph, &nodes);
        let initial = terms.initial.iter().copied().enumerate();
        let mass = terms.mass.iter().map(|&(row, column, node)| ((row, column), node));
        Ok(Self {
            initial: Constants::new(&mut graph, initial)?,
            mass: Constants::new(&mut graph, mass)?,
            bounds: Constants::new(&mut graph, terms.bounds.iter().copied())?,
            contacts: Constants::new(&mut graph, terms.contacts.iter().copied().enumerate())?,
            pattern,
            rows,
            chain: None,
        })
    }

    /// Adds the chain rule for inputs that are functions of the parameters. `slopes[parameter][input]` are the
    /// derivatives of these inputs, which are numbered after the parameters in the compiled expressions.
    pub(super) fn follow(&mut self, slopes: &[Vec<f64>]) {
        let parameters = slopes.len();
        let shares_of = |input: usize| -> Vec<(usize, f64)> {
            match input.checked_sub(parameters) {
                None => vec![(input, 1.0)],
                Some(k) => (0..parameters).map(|by| (by, slopes[by][k])).filter(|share| share.1 != 0.0).collect(),
            }
        };
        let all = self.pattern.iter().map(|&(row, input)| (row, shares_of(input)));
        let shares: Vec<(usize, Vec<(usize, f64)>)> = all.collect();
        let mut pattern: Vec<(usize, usize)> =
            shares.iter().flat_map(|(row, shares)| shares.iter().map(|&(by, _)| (*row, by))).collect();
        pattern.sort_unstable();
        pattern.dedup();
        let place = |row: usize, by: usize| pattern.partition_point(|&found| found < (row, by));
        let placed = |(row, shares): (usize, Vec<(usize, f64)>)| {
            shares.into_iter().map(|(by, factor)| (place(row, by), factor)).collect()
        };
        let shares: Vec<Vec<(usize, f64)>> = shares.into_iter().map(placed).collect();
        self.chain = Some(Chain { values: vec![0.0; shares.len()], shares });
        self.pattern = pattern;
    }

    pub(super) fn bind(&mut self, parameters: &[f64]) {
        self.rows.bind(parameters);
        self.initial.bind(parameters);
        self.mass.bind(parameters);
        self.bounds.bind(parameters);
        self.contacts.bind(parameters);
    }

    /// Returns the structural nonzeros of the derivatives as `(row, parameter)`, sorted by row; rows are `F` (`n`),
    /// `G` (`m`), then moving bounds, or for a mechanical system the [force balance and constraint
    /// functions](super::SymbolicMechanics::terms).
    pub fn pattern(&self) -> &[(usize, usize)] {
        &self.pattern
    }

    /// Writes the derivatives of the rows `F`, `G` and the moving bounds with respect to the parameters at `(t, y)`,
    /// one per structural nonzero.
    pub fn evaluate(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        let Some(Chain { shares, values: raw }) = &mut self.chain else { return self.rows.evaluate(t, y, values) };
        self.rows.evaluate(t, y, raw);
        values.fill(0.0);
        for (shares, &slope) in shares.iter().zip(raw.iter()) {
            shares.iter().for_each(|&(place, factor)| values[place] += factor * slope);
        }
    }

    /// Returns the derivatives of the initial states with respect to parameters, as `(state, parameter, value)`.
    pub fn initial(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.initial.iter()
    }

    /// Returns the derivatives of the mass matrix with respect to parameters, as `((row, column), parameter, value)`.
    pub fn mass(&self) -> impl Iterator<Item = ((usize, usize), usize, f64)> {
        self.mass.iter()
    }

    /// Returns the derivatives of the contact coefficients that depend on parameters, as `(index of the coefficient,
    /// index of the parameter, value)`.
    pub fn contacts(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.contacts.iter()
    }

    /// Returns the derivatives of the constant bounds with respect to parameters, as `(bound, parameter, value)`.
    pub fn bounds(&self) -> impl Iterator<Item = (MovingBound, usize, f64)> {
        self.bounds.iter()
    }
}

impl<P: Copy> Constants<P> {
    fn new(graph: &mut Graph, terms: impl Iterator<Item = (P, Node)>) -> Result<Self, ExpressionError> {
        let (places, nodes) = derivatives(graph, terms)?;
        Ok(Self { values: vec![0.0; nodes.len()], tape: Tape::compile(graph, &nodes), places })
    }

    fn bind(&mut self, parameters: &[f64]) {
        self.tape.bind(parameters);
        self.tape.evaluate(0.0, &[], &mut self.values);
    }

    fn iter(&self) -> impl Iterator<Item = (P, usize, f64)> {
        self.places.iter().zip(&self.values).map(|(&(place, parameter), &value)| (place, parameter, value))
    }
}

/// The derivatives of a list of expressions with respect to parameters: for each derivative, the position of its
/// expression in the problem (such as a row) and the index of the parameter; and the derivatives as graph nodes, in the
/// same order.
type Derivatives<P> = (Vec<(P, usize)>, Vec<Node>);

/// Differentiates expressions, each given with its position in the problem, with respect to all parameters.
fn derivatives<P: Copy>(
    graph: &mut Graph,
    terms: impl Iterator<Item = (P, Node)>,
) -> Result<Derivatives<P>, ExpressionError> {
    let (mut places, mut nodes) = (Vec::new(), Vec::new());
    for (place, node) in terms {
        for (parameter, derivative) in graph.gradient_by_parameters(node)? {
            places.push((place, parameter));
            nodes.push(derivative);
        }
    }
    Ok((places, nodes))
}
