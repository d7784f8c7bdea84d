//! Warnings about kinks of a rate in a state. Such kinks are allowed, but the steps only locate changes of the active
//! face of the set `K`, and a kink does not change that face. If the same law is written with a variable in `K`, its
//! switches are located.

use expression::{Graph, Kink, Node};
use models::{Equations, KinkAdvice};
use solution::Warning;

/// Largest number of states listed in the warning about one kind of kink.
const SHOWN: usize = 6;

/// Returns one warning for each kind of kink in the rate of a state.
pub(super) fn warnings(state: &str, rate: Node, states: &[String], graph: &Graph) -> Vec<Warning> {
    let mut kinks: Vec<(&str, Vec<usize>)> = graph
        .kinks(rate)
        .into_iter()
        .map(|(function, inputs)| {
            let of_states = inputs.into_iter().filter(|input| (1..=states.len()).contains(input)).collect();
            (function, of_states)
        })
        .filter(|(_, inputs): &(_, Vec<usize>)| !inputs.is_empty())
        .collect();
    kinks.sort_unstable();
    kinks.dedup();
    kinks
        .into_iter()
        .map(|(function, inputs)| {
            let mut of: Vec<String> = inputs.iter().take(SHOWN).map(|i| format!("`{}`", states[i - 1])).collect();
            if inputs.len() > SHOWN {
                of.push("...".into());
            }
            Warning {
                code: "kink_in_rate",
                message: format!(
                    "the rate of `{state}` has a kink, `{function}` of {}, which switch location cannot see, so the \
                     order drops where it is crossed; write it as a set instead: {}",
                    of.join(", "),
                    remedy(function)
                ),
            }
        })
        .collect()
}

/// Returns the texts to report if steps chatter across a kink of the equations; `as_set` returns the problem with its
/// kinks rewritten as a set.
pub(super) fn advice(
    equations: &Equations,
    states: &[String],
    variables: &[String],
    as_set: impl FnOnce() -> Option<String>,
) -> KinkAdvice {
    let Equations::Symbolic(symbolic) = equations else { return KinkAdvice::default() };
    if symbolic.kinks().is_empty() {
        return KinkAdvice::default();
    }
    let name = |&input: &usize| match input.checked_sub(1) {
        None => "`t`".to_owned(),
        Some(i) => format!("`{}`", states.iter().chain(variables).nth(i).map_or("?", String::as_str)),
    };
    let named = |kink: &Kink| {
        let of: Vec<String> = kink.inputs.iter().take(SHOWN).map(name).collect();
        format!("`{}` of {}", kink.function, of.join(", "))
    };
    KinkAdvice { names: symbolic.kinks().iter().map(named).collect(), as_set: as_set() }
}

/// Returns how a function with a kink is written as a variational inequality, for a message.
fn remedy(function: &str) -> &'static str {
    match function {
        "abs" => "abs(a) = z*a with z in the box [-1, 1] and the inequality -a",
        "sign" => "sign(a) = z with z in the box [-1, 1] and the inequality -a",
        "min" => "min(a, b) = a - z with z nonnegative and the inequality z - (a - b)",
        "table" => {
            "sums of max(a - x_k, 0), or a table with \"interpolation\": \"pchip\", which has no kinks between its ends"
        }
        "max" => "max(a, b) = a + z with z nonnegative and the inequality z - (b - a)",
        _ => "heaviside(a) = z with z in the box [0, 1] and the inequality -a",
    }
}
