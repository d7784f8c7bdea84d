//! Time derivatives of the forcing as sums of terms that the rows share. A term that occurs in several rows is stored
//! once, so that it cancels in linear combinations of the rows before interval enclosure.

use expression::{Graph, IntervalWorkspace, Node, Tape};
use numerics::Interval;
use problem::{ForcingSlopes, Sums};
use rustc_hash::FxHashMap;

/// The time derivatives of the forcing as sums of factors times terms that the rows share, with the compiled
/// expressions of the terms and of the factors.
#[derive(Clone, Debug)]
pub(super) struct Slopes {
    pub sums: ForcingSlopes,
    terms: Tape,
    over_box: IntervalWorkspace,
    /// The compiled expressions of the factors of all terms in the order of the sums, with a buffer for their values;
    /// `None` if no factor depends on parameters.
    factors: Option<(Tape, Vec<f64>)>,
}

/// The time derivatives of the forcing as linear combinations of shared terms, one per row of `F` or `G`, as pairs
/// `(term index, factor)` with factors as nodes of the expression graph.
type Symbolic = Vec<Vec<(usize, Node)>>;

impl Slopes {
    /// Splits the time derivatives `dF/dt`, `dG/dt` and `d^2G/dt^2` of the forcing (functions of time and parameters)
    /// into terms that the rows share.
    pub fn new(graph: &mut Graph, rates: &[Node], inequality: &[Node], curvature: &[Node]) -> Self {
        let mut terms: Vec<Node> = Vec::new();
        let mut places = FxHashMap::default();
        let mut symbolic = [rates, inequality, curvature].map(|nodes| -> Symbolic {
            let sum = |node: &Node| {
                let mut place = |term: Node| {
                    *places.entry(term).or_insert_with(|| {
                        terms.push(term);
                        terms.len() - 1
                    })
                };
                graph.terms_of_sum(*node).into_iter().map(|(term, factor)| (place(term), factor)).collect()
            };
            nodes.iter().map(sum).collect()
        });
        let value = |&(term, factor): &(usize, Node)| (term, graph.value(factor).unwrap_or(f64::NAN));
        let values = |sums: &Symbolic| -> Sums { sums.iter().map(|sum| sum.iter().map(value).collect()).collect() };
        let [rates, inequality, curvature] = symbolic.each_ref().map(values);
        let factors: Vec<Node> = symbolic.iter_mut().flatten().flatten().map(|(_, factor)| *factor).collect();
        let is_decided = factors.iter().any(|&factor| graph.number(factor).is_none());
        let program = Tape::compile(graph, &terms);
        Self {
            sums: ForcingSlopes { terms: terms.len(), rates, inequality, curvature },
            over_box: IntervalWorkspace::new(&program),
            terms: program,
            factors: is_decided.then(|| (Tape::compile(graph, &factors), vec![0.0; factors.len()])),
        }
    }

    /// Binds new parameter values to the compiled expressions, and updates the factors in the time derivatives of the
    /// forcing.
    pub fn bind(&mut self, parameters: &[f64]) {
        self.terms.bind(parameters);
        self.over_box.bind(&self.terms);
        let Some((tape, values)) = &mut self.factors else { return };
        tape.bind(parameters);
        tape.evaluate(0.0, &[], values);
        let ForcingSlopes { rates, inequality, curvature, .. } = &mut self.sums;
        let factors = rates.iter_mut().chain(inequality).chain(curvature).flatten().map(|(_, factor)| factor);
        factors.zip(values).for_each(|(factor, value)| *factor = *value);
    }

    /// Encloses all shared terms of the forcing's time derivatives over an interval of `t`.
    pub fn enclose(&mut self, t: Interval, terms: &mut [Interval]) {
        self.terms.enclose(t, &[], &mut self.over_box, terms);
    }
}
