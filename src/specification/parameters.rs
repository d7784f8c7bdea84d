//! Parameters may be expressions in each other. The members of a JSON object have no order that every writer keeps, so
//! theirs is found here: each after those that it depends on.

use super::expression::Expression;
use super::ordered::Ordered;
use expression::{Graph, Scope};

/// The parameters, which may use tables, with what they depend on first; those in a cycle come last, as they stand.
pub(super) fn in_order<'p>(parameters: &'p Ordered<Expression>, tables: &Scope) -> Vec<(&'p str, &'p Expression)> {
    let entries: Vec<(&str, &Expression)> = parameters.iter().collect();
    let (mut graph, mut scope) = (Graph::new(), tables.clone());
    for (i, (name, _)) in entries.iter().enumerate() {
        // Its value is not known yet.
        let node = graph.parameter(i, f64::NAN);
        // A name that cannot be bound is reported when its value is.
        let _ = scope.bind(name, node);
    }
    let mut waiting = vec![0_usize; entries.len()];
    let mut dependents = vec![Vec::new(); entries.len()];
    for (i, (_, expression)) in entries.iter().enumerate() {
        if let Expression::Text(text) = expression
            && let Ok(node) = graph.parse(text, &scope)
        {
            for needed in graph.parameters(node) {
                waiting[i] += 1;
                dependents[needed].push(i);
            }
        }
    }
    let mut order: Vec<usize> = (0..entries.len()).filter(|&i| waiting[i] == 0).collect();
    let mut next = 0;
    while next < order.len() {
        for &dependent in &dependents[order[next]] {
            waiting[dependent] -= 1;
            if waiting[dependent] == 0 {
                order.push(dependent);
            }
        }
        next += 1;
    }
    order.extend((0..entries.len()).filter(|&i| waiting[i] > 0));
    order.into_iter().map(|i| entries[i]).collect()
}
