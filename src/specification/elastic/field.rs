//! Expressions in time and space, evaluated at the nodes of a grid.

use crate::directions::DIRECTIONS;
use crate::error::SpecificationError;
use crate::expression::Expression;
use crate::lowering::Lowering;
use crate::pointer::Pointer;
use expression::Node;
use models::finite_elements::Grid;

/// An expression in time and space. At a point it becomes an expression in `t` alone, or zero after an error, which is
/// reported.
pub(super) struct Field<'a> {
    node: Option<Node>,
    /// Number of points of the grid at which the expression has been evaluated so far.
    points: usize,
    dimension: usize,
    place: &'a Pointer<'a>,
}

impl<'a> Field<'a> {
    pub(super) fn read(expression: &Expression, grid: &Grid, place: &'a Pointer<'a>, lowering: &mut Lowering) -> Self {
        Self { node: lowering.node(expression, place), points: 0, dimension: grid.dimension(), place }
    }

    pub(super) fn at(&mut self, point: [f64; 3], lowering: &mut Lowering) -> Node {
        let zero = lowering.graph.constant(0.0);
        self.points += 1;
        let Some(node) = self.node.filter(|_| lowering.goes_on(self.points)) else { return zero };
        let numbers: Vec<(usize, f64)> = (1..=self.dimension).zip(point).collect();
        match lowering.graph.substitute(node, &numbers) {
            Ok(node) => match lowering.graph.value(node).filter(|value| !value.is_finite()) {
                None => node,
                Some(value) => {
                    let detail = format!("this is {value} at {}", point_named(point, self.dimension));
                    self.fail("not_finite", detail, "a finite value at every node", lowering)
                }
            },
            Err(error) => self.fail(error.code, error.message, "fewer elements, or a shorter expression", lowering),
        }
    }

    /// Returns the value of the expression at a point, for an expression that must not depend on time.
    pub(super) fn value(&mut self, point: [f64; 3], lowering: &mut Lowering) -> f64 {
        let node = self.at(point, lowering);
        lowering.graph.value(node).unwrap_or_else(|| {
            self.fail("depends_on_time", "this depends on `t`".into(), "an expression in the coordinates", lowering);
            0.0
        })
    }

    /// Reports an error of the expression, which evaluates to zero from then on, so that the error is reported once.
    fn fail(&mut self, code: &'static str, detail: String, expected: &str, lowering: &mut Lowering) -> Node {
        let error = SpecificationError::new(self.place.to_string(), code, detail);
        lowering.errors.push(error.expected(expected));
        self.node = None;
        lowering.graph.constant(0.0)
    }
}

fn point_named(point: [f64; 3], dimension: usize) -> String {
    let named: Vec<String> =
        DIRECTIONS.iter().zip(point).take(dimension).map(|(name, value)| format!("{name} = {value}")).collect();
    named.join(", ")
}
