//! Kinks and jumps of expressions that depend on inputs after the first: sign changes of [switches](super::switches).
//! Kinks and jumps in the first input alone are [`Breaks`](super::Breaks).

use super::graph::{Graph, Node};
use super::tape::Tape;

/// A nonsmooth function in an expression, and the inputs of its argument.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kink {
    /// The name of the function in the language: `abs`, `sign`, `heaviside`, `min`, `max`, ..
    pub function: &'static str,
    /// The inputs of the event function whose sign changes are the kink, sorted.
    pub inputs: Vec<usize>,
}

/// The compiled event functions whose sign changes are the kinks of some expressions, with their derivatives.
#[derive(Clone, Debug, Default)]
pub struct Kinks {
    kinks: Vec<Kink>,
    tape: Tape,
    values: Vec<f64>,
    derivatives: Tape,
    /// The index of the kink and of the input to which each derivative of an event function belongs.
    places: Vec<(usize, usize)>,
    slopes: Vec<f64>,
}

impl Kinks {
    /// Compiles the event functions of the kinks of `nodes`, except those whose derivatives exceed the size limits of
    /// `graph`.
    pub fn new(graph: &mut Graph, nodes: &[Node]) -> Self {
        let (mut kinks, mut quantities) = (Vec::new(), Vec::new());
        let (mut derivatives, mut places) = (Vec::new(), Vec::new());
        for (function, quantity) in graph.kink_quantities(nodes) {
            let inputs = graph.inputs(quantity);
            if inputs.iter().all(|&input| input == 0) {
                continue;
            }
            let Ok(gradient) = graph.gradient(quantity) else { continue };
            for (input, derivative) in gradient.into_iter().filter(|&(input, _)| input > 0) {
                places.push((quantities.len(), input));
                derivatives.push(derivative);
            }
            quantities.push(quantity);
            kinks.push(Kink { function, inputs });
        }
        Self {
            tape: Tape::compile(graph, &quantities),
            values: vec![0.0; quantities.len()],
            derivatives: Tape::compile(graph, &derivatives),
            slopes: vec![0.0; places.len()],
            kinks,
            places,
        }
    }

    /// Binds new parameter values to the compiled event functions of the kinks and their derivatives.
    pub fn bind(&mut self, parameters: &[f64]) {
        self.tape.bind(parameters);
        self.derivatives.bind(parameters);
    }

    /// Returns the kinks, in the order of the values of [`at`](Self::at).
    pub fn kinks(&self) -> &[Kink] {
        &self.kinks
    }

    /// Returns the values of the event functions of the kinks at the first input `t` and the other inputs `rest`.
    pub fn at(&mut self, t: f64, rest: &[f64]) -> &[f64] {
        self.tape.evaluate(t, rest, &mut self.values);
        &self.values
    }

    /// Returns the derivatives of the event function of the kink with index `kink` at the first input `t` and the other
    /// inputs `rest`, as `(index in rest, value)`.
    pub fn gradient(&mut self, kink: usize, t: f64, rest: &[f64]) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.derivatives.evaluate(t, rest, &mut self.slopes);
        let slopes = self.places.iter().zip(&self.slopes);
        slopes.filter(move |((of, _), _)| *of == kink).map(|(&(_, input), &slope)| (input - 1, slope))
    }
}

impl Graph {
    /// Returns the event functions, each once, with the name of the function that has a kink where they change sign.
    fn kink_quantities(&mut self, nodes: &[Node]) -> Vec<(&'static str, Node)> {
        let terms = self.terms_below(nodes);
        let mut found: Vec<(&'static str, Node)> = terms.into_iter().filter_map(|node| self.switch(node)).collect();
        found.sort_unstable_by_key(|&(function, quantity)| (quantity, function));
        found.dedup_by_key(|&mut (_, quantity)| quantity);
        found
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scope;
    use super::*;

    #[test]
    fn what_depends_on_a_state_is_a_kink_with_its_slope() {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        for (index, name) in ["t", "x", "y"].into_iter().enumerate() {
            scope.bind(name, graph.input(index)).unwrap();
        }
        let node = graph.parse("heaviside(t - 2) + sign(3*x - t) + max(x, 2*y) - abs(3*x - t)", &scope).unwrap();
        let mut kinks = Kinks::new(&mut graph, &[node]);
        assert_eq!(kinks.kinks().len(), 2, "{:?}", kinks.kinks());
        let mut values = kinks.at(1.0, &[2.0, 3.0]).to_vec();
        values.sort_by(f64::total_cmp);
        assert_eq!(values, [-4.0, 5.0]);
        let of_time = kinks.kinks().iter().position(|kink| kink.inputs == [0, 1]).expect("the argument of sign");
        assert_eq!(kinks.gradient(of_time, 1.0, &[2.0, 3.0]).collect::<Vec<_>>(), [(0, 3.0)]);
    }
}
