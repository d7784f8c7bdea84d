//! Filippov systems: `x' = f_i(t,x)` in region `i`, and a convex combination of the adjacent `f_i` on the boundaries.
//!
//! A system with two regions on either side of a surface `h = 0` (Filippov 1988, *Differential Equations with
//! Discontinuous Righthand Sides*, section 4):
//!
//! ```text
//! x' = (1 - z) f+ + z f-,    z in [0, 1],    0 <= h (z~ - z)  for all z~ in [0, 1]
//! ```
//!
//! A system with many regions, where region `i` is the set of points at which its indicator `g_i` is the smallest
//! (Stewart 1990, A high accuracy method for solving ODEs with discontinuous right-hand side):
//!
//! ```text
//! x' = sum_i z_i f_i,    z in the simplex,    0 <= <g, z~ - z>  for all z~ in the simplex
//! ```

use super::Rows;
use expression::{ExpressionError, Graph, Node, Tape};
use problem::{ConvexSet, Mass, Shape};

/// A region of a Filippov system, as nodes of an expression graph whose inputs are `t`, then the states `x`.
#[derive(Clone, Debug)]
pub struct Region {
    /// The indicator function `g_i` of region `i`, the smallest of all indicators inside the region.
    pub indicator: Node,
    /// The rates `f_i` inside region `i`, one per state of the Filippov system.
    pub rates: Vec<Node>,
}

/// Returns the equations of a Filippov system with two regions: rates `plus` where `surface` is positive, `minus` where
/// it is negative.
pub fn two_regions(graph: &mut Graph, surface: Node, plus: &[Node], minus: &[Node]) -> Rows {
    let z = graph.input(1 + plus.len());
    let mut rate = |(&plus, &minus)| {
        let difference = difference(graph, minus, plus);
        let share = graph.multiply(z, difference);
        graph.add(plus, share)
    };
    let rates = plus.iter().zip(minus).map(&mut rate).collect();
    let mut set = ConvexSet::free(1);
    (set.lower[0], set.upper[0]) = (0.0, 1.0);
    Rows { mass: Mass::Identity, rates, inequality: vec![surface], set, moving: Vec::new() }
}

/// Returns the difference of two rates. Summands that occur in both rates cancel symbolically and not only
/// numerically: rates that are affine on either side of the surface with equal slopes then are affine on the surface
/// too.
fn difference(graph: &mut Graph, minus: Node, plus: Node) -> Node {
    let difference = graph.subtract(minus, plus);
    let mut sum = graph.constant(0.0);
    for (term, factor) in graph.terms_of_sum(difference) {
        let summand = graph.multiply(factor, term);
        sum = graph.add(sum, summand);
    }
    if graph.inputs(sum).len() < graph.inputs(difference).len() { sum } else { difference }
}

/// Returns the equations of a Filippov system with `n` states and at least one region (Stewart's formulation).
pub fn many_regions(graph: &mut Graph, n: usize, regions: &[Region]) -> Rows {
    let mut rates = vec![graph.constant(0.0); n];
    for (i, region) in regions.iter().enumerate() {
        let z = graph.input(1 + n + i);
        for (sum, &rate) in rates.iter_mut().zip(&region.rates) {
            let share = graph.multiply(z, rate);
            *sum = graph.add(*sum, share);
        }
    }
    let mut set = ConvexSet::free(regions.len());
    set.bind((0..regions.len()).collect(), Shape::Simplex);
    let inequality = regions.iter().map(|region| region.indicator).collect();
    Rows { mass: Mass::Identity, rates, inequality, set, moving: Vec::new() }
}

/// Regions that a solution may enter immediately from a given point: the regions adjacent to the point whose rate
/// makes every other adjacent indicator grow faster than the region's own. If there are two or more, the boundary is
/// repulsive and solutions are not unique.
#[derive(Clone, Debug)]
pub struct Departures {
    t: f64,
    /// The compiled expressions of each region's indicator function and its derivatives, followed by the rates of all
    /// regions.
    tape: Tape,
    /// For each region, the inputs (`t` and states) with respect to which its indicator function is differentiated.
    inputs: Vec<Vec<usize>>,
}

impl Departures {
    /// Compiles the indicators, their gradients and the rates, for evaluation at time `t`.
    ///
    /// # Errors
    /// If the derivative of an indicator exceeds the size limits of `graph`.
    pub fn new(graph: &mut Graph, regions: &[Region], t: f64) -> Result<Self, ExpressionError> {
        let mut nodes: Vec<Node> = Vec::new();
        let mut inputs = Vec::new();
        for region in regions {
            let gradient = graph.gradient(region.indicator)?;
            nodes.push(region.indicator);
            nodes.extend(gradient.iter().map(|&(_, derivative)| derivative));
            inputs.push(gradient.into_iter().map(|(input, _)| input).collect());
        }
        nodes.extend(regions.iter().flat_map(|region| &region.rates));
        Ok(Self { t, tape: Tape::compile(graph, &nodes), inputs })
    }

    /// Binds new parameter values to the compiled indicators, gradients and rates of the regions.
    pub(super) fn bind(&mut self, parameters: &[f64]) {
        self.tape.bind(parameters);
    }

    /// Returns whether the state `x` is on a repulsive boundary between regions: whether solutions can enter two or
    /// more regions.
    pub fn repel(&mut self, x: &[f64]) -> bool {
        self.from(x).len() > 1
    }

    /// Returns the regions of the Filippov system that a solution may enter from the state `x`.
    pub fn from(&mut self, x: &[f64]) -> Vec<usize> {
        let regions = self.inputs.len();
        let mut point = vec![self.t];
        point.extend(x);
        let derivatives: usize = self.inputs.iter().map(Vec::len).sum();
        let mut values = vec![0.0; regions + derivatives + regions * x.len()];
        self.tape.evaluate(self.t, x, &mut values);

        let (mut indicators, mut normals, mut sizes) = (Vec::new(), Vec::new(), Vec::new());
        let mut rest = values.as_slice();
        for inputs in &self.inputs {
            let (own, after) = rest.split_at(1 + inputs.len());
            let mut normal = vec![0.0; point.len()];
            inputs.iter().zip(&own[1..]).for_each(|(&input, &value)| normal[input] = value);
            sizes.push(normal.iter().zip(&point).map(|(d, x)| (d * x).abs()).sum::<f64>());
            indicators.push(own[0]);
            normals.push(normal);
            rest = after;
        }
        // The time derivative of an indicator function along the rate of region `i`.
        let along = |i: usize, normal: &[f64]| {
            let rates = &rest[i * x.len()..(i + 1) * x.len()];
            normal[0] + normal[1..].iter().zip(rates).map(|(d, f)| d * f).sum::<f64>()
        };
        // Relative tolerance within which indicator functions of regions count as equal: the rounding error of their
        // linear terms.
        const ROUNDING: f64 = 1e-12;
        let least = indicators.iter().copied().fold(f64::INFINITY, f64::min);
        let meets = |i: usize| indicators[i] - least <= ROUNDING * sizes[i];
        let met: Vec<usize> = (0..regions).filter(|&i| meets(i)).collect();
        let leaves = |i: usize| {
            let own = along(i, &normals[i]);
            met.iter().all(|&j| j == i || along(i, &normals[j]) > own)
        };
        met.iter().copied().filter(|&i| leaves(i)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use expression::Scope;

    /// Returns the number of regions of a Filippov system that a solution can enter from `x`, with rates `plus` for
    /// `x > 0` and `minus` for `x < 0`.
    fn departures_from(x: f64, plus: &str, minus: &str) -> usize {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        let input = graph.input(1);
        scope.bind("x", input).expect("a new name");
        let mut node = |text: &str| graph.parse(text, &scope).expect("an expression");
        let regions = [("-x", plus), ("x", minus)]
            .map(|(indicator, rate)| Region { indicator: node(indicator), rates: vec![node(rate)] });
        Departures::new(&mut graph, &regions, 0.0).expect("derivatives").from(&[x]).len()
    }

    #[test]
    fn common_summands_of_rates_cancel() {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        let (time, state) = (graph.input(0), graph.input(1));
        scope.bind("t", time).expect("a new name");
        scope.bind("x", state).expect("a new name");
        let mut node = |text: &str| graph.parse(text, &scope).expect("an expression");
        let (minus, plus) = (node("1 - 3*x + sin(t)"), node("sin(t) - (3*x + 2)"));
        let jump = difference(&mut graph, minus, plus);
        assert_eq!(graph.value(jump), Some(3.0));
    }

    #[test]
    fn only_a_surface_that_repels_is_left_in_two_ways() {
        assert_eq!(departures_from(0.0, "1", "-1"), 2);
        assert_eq!(departures_from(0.0, "-1", "1"), 0);
        assert_eq!(departures_from(0.0, "1 + x", "2"), 1);
        assert_eq!(departures_from(1e-3, "1", "-1"), 1);
    }
}
