//! Questions to the user whether the sign of an inequality, or of its variable in a rate, is reversed, with the names
//! of the variables and states concerned.

use super::DviModel;
use analysis::{Analysis, Reversal};

impl DviModel {
    /// Appends the question whether a sign is reversed to the reason for the verdict on uniqueness, if the analysis
    /// found a sign that looks reversed.
    pub(super) fn questioned(&self, analysis: Analysis) -> Analysis {
        let Some(reversed) = analysis.reversed else { return analysis };
        const SHOWN: usize = 3;
        let structure = self.structure();
        let (n, set) = (structure.states, &structure.set);
        let bounded = (0..structure.variables).filter(|&k| !set.is_free(k) && set.lower[k] != set.upper[k]);
        let variables: Vec<usize> = bounded.take(SHOWN + 1).collect();
        let rates =
            structure.pattern.iter().filter(|(row, column)| *row < n && variables.iter().any(|k| n + k == *column));
        let mut rates: Vec<usize> = rates.map(|&(row, _)| row).collect();
        rates.dedup();
        let (of, one) = (list(&variables, &self.variable_names, SHOWN), variables.len() == 1);
        let inequality = if one { format!("the inequality of {of}") } else { format!("the inequalities of {of}") };
        let question = match reversed {
            Reversal::Inequality => format!("Is the sign of {inequality} reversed?"),
            Reversal::InequalityOrRate => {
                let noun = if rates.len() == 1 { "the rate" } else { "the rates" };
                let states = list(&rates, &self.state_names, SHOWN);
                format!("Is the sign of {inequality}, or of {of} in {noun} of {states}, reversed?")
            }
        };
        Analysis { because: format!("{}. {question}", analysis.because), ..analysis }
    }
}

/// Returns the first `shown` names of a list as text, followed by an ellipsis if there are more.
fn list(places: &[usize], names: &[String], shown: usize) -> String {
    let mut list: Vec<String> = places.iter().take(shown).map(|&place| format!("`{}`", names[place])).collect();
    if places.len() > shown {
        list.push("...".to_owned());
    }
    list.join(", ")
}
