//! Order of parameters and definitions by dependence. They may be expressions in each other, and writers of JSON do not
//! preserve the order of members, so each entry is sorted after those that it depends on.

use super::expression::Expression;
use super::ordered::Ordered;
use super::wording::abridged;
use expression::{Graph, Scope};

/// Sorts the entries by dependence; also returns how many entries could be sorted, after which those with circular
/// references follow. Entries may refer to names in `known`, whose parameters have their values in the graph
/// `values`.
pub(super) fn in_order<'a>(
    entries: &'a Ordered<Expression>,
    known: &Scope,
    values: &Graph,
) -> (Vec<(&'a str, &'a Expression)>, usize) {
    let entries: Vec<(&str, &Expression)> = entries.iter().collect();
    let (mut graph, mut scope) = (Graph::new(), known.with_tables_alone());
    for (i, (name, expression)) in entries.iter().enumerate() {
        // A parameter or definition that is an expression has no value yet: its value is known only once all are
        // ordered.
        let node = graph.parameter(i, if let Expression::Number(value) = expression { *value } else { f64::NAN });
        // A faulty name of a parameter or definition is reported later, when its value is read.
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
            // The range of a sum may depend on a value that is not known yet: assume dependence on every entry that is
            // named.
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

/// Returns the message about entries with circular references, direct or indirect.
pub(super) fn circular(names: &[String]) -> String {
    const SHOWN: usize = 8;
    let shown: Vec<String> = names.iter().take(SHOWN).map(|name| format!("`{}`", abridged(name))).collect();
    match shown.as_slice() {
        [name] => format!("{name} depends on itself"),
        names => format!("{} depend on each other", names.join(", ")),
    }
}
