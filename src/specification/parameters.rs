//! Parameters may be expressions in each other, and so may definitions. The members of a JSON object have no order that every
//! writer keeps, so theirs is found here: each after those that it depends on.

use super::expression::Expression;
use super::ordered::Ordered;
use super::wording::abridged;
use expression::{Graph, Scope};

/// The entries with those first that others depend on, and how many of them these are: behind them come those that depend on
/// themselves. They may also name what has a name in `known`, whose parameters have their values in a graph.
pub(super) fn in_order<'a>(
    entries: &'a Ordered<Expression>,
    known: &Scope,
    values: &Graph,
) -> (Vec<(&'a str, &'a Expression)>, usize) {
    let entries: Vec<(&str, &Expression)> = entries.iter().collect();
    let (mut graph, mut scope) = (Graph::new(), known.with_tables_alone());
    for (i, (name, expression)) in entries.iter().enumerate() {
        // Of an expression the value is not known yet.
        let node = graph.parameter(i, if let Expression::Number(value) = expression { *value } else { f64::NAN });
        // A name that cannot be bound is reported when its value is.
        let _ = scope.bind(name, node);
    }
    for (i, name) in known.names().enumerate() {
        let value = known.get(name).and_then(|node| values.value(node));
        let node = match value {
            Some(value) => graph.constant(value),
            None => graph.input(i),
        };
        let _ = scope.bind_output(name, node);
    }
    let mut waiting = vec![0_usize; entries.len()];
    let mut dependents = vec![Vec::new(); entries.len()];
    for (i, (_, expression)) in entries.iter().enumerate() {
        let Expression::Text(text) = expression else { continue };
        let needed = match graph.parse(text, &scope) {
            Ok(node) => graph.parameters(node),
            // The range of a sum may depend on a value that is not known yet: whatever is named is needed.
            Err(_) => {
                let is_named = |name: &str| {
                    text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).any(|word| word == name)
                };
                (0..entries.len()).filter(|&other| other != i && is_named(entries[other].0)).collect()
            }
        };
        for needed in needed {
            waiting[i] += 1;
            dependents[needed].push(i);
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
    let ordered = order.len();
    order.extend((0..entries.len()).filter(|&i| waiting[i] > 0));
    (order.into_iter().map(|i| entries[i]).collect(), ordered)
}

/// What is wrong with entries of these names, which depend on themselves or on such.
pub(super) fn circular(names: &[String]) -> String {
    const SHOWN: usize = 8;
    let shown: Vec<String> = names.iter().take(SHOWN).map(|name| format!("`{}`", abridged(name))).collect();
    match shown.as_slice() {
        [name] => format!("{name} depends on itself"),
        names => format!("{} depend on each other", names.join(", ")),
    }
}
