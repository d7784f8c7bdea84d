//! Restriction of certificates of uniqueness for equations that are not Lipschitz everywhere. A solution is unique
//! until it reaches a point where the equations are not Lipschitz (Picard and Lindelof). At a jump of the equations a
//! solution need not exist; at an infinite slope a solution exists (Peano), but others may branch off.

use super::{DviModel, Equations};
use analysis::{Analysis, Uniqueness};
use expression::{Irregularities, Irregularity};
use numerics::Interval;

impl DviModel {
    /// Returns the points where the equations of the model are not locally Lipschitz; `None` if they are locally
    /// Lipschitz on their domain.
    pub fn irregularities(&self) -> Option<Irregularities> {
        match &self.equations {
            Equations::Symbolic(equations) => {
                Some(equations.irregularities()).filter(|found| !found.is_empty()).cloned()
            }
            // Linear equations are Lipschitz, since their forcing depends on time alone; of equations given as Rust
            // functions, nothing is known.
            Equations::Linear(_) | Equations::Closures(_) => None,
        }
    }

    /// Restricts the certificate of uniqueness of an analysis that assumes Lipschitz equations, for a solution that
    /// starts from `x` at time `t`.
    pub(super) fn restricted(&self, analysis: Analysis, t: f64, x: &[f64]) -> Analysis {
        if !analysis.uniqueness.is_certified() {
            return analysis;
        }
        if self.is_opaque() {
            let because = format!(
                "{}; the equations are functions whose values alone are known: that they are Lipschitz is not proven",
                analysis.because
            );
            return Analysis { uniqueness: Uniqueness::NotCertified, because, ..analysis };
        }
        let Some(mut irregularities) = self.irregularities() else { return self.lipschitz(analysis) };
        let set = &self.structure().set;
        let variables = set.lower.iter().zip(&set.upper).map(|(&lower, &upper)| Interval::new(lower, upper));
        let start: Vec<Interval> = x.iter().map(|&x| Interval::point(x)).chain(variables).collect();
        if let Some(met) = irregularities.over(Interval::point(t), &start) {
            return self.uncertified(analysis, met, t);
        }
        let lines = vec![Interval::LINE; start.len()];
        let Some(met) = irregularities.over(Interval::LINE, &lines) else { return analysis };
        let because = format!(
            "{}; the equations are Lipschitz at the start, but not everywhere: {}. The solution is unique until it gets there",
            analysis.because,
            self.behaviour(met)
        );
        Analysis { uniqueness: Uniqueness::LocallyUnique, because, ..analysis }
    }

    fn lipschitz(&self, analysis: Analysis) -> Analysis {
        if self.structure().variables > 0 {
            return analysis;
        }
        Analysis { because: format!("{}; its rates are locally Lipschitz in the states", analysis.because), ..analysis }
    }

    /// Returns the analysis without its certificate of uniqueness, for a solution that reaches a point at time `t`
    /// where the equations are not Lipschitz.
    pub fn uncertified(&self, analysis: Analysis, met: &Irregularity, t: f64) -> Analysis {
        let behaviour = self.behaviour(met);
        let (uniqueness, because) = if met.jumps {
            let because = format!(
                "at t = {t} the equations are not continuous in the states: {behaviour}. A solution need not exist there, \
                 nor be the only one"
            );
            (Uniqueness::NotCertified, because)
        } else {
            let because = format!(
                "at t = {t} the equations are not Lipschitz in the states: {behaviour}. A solution exists, and others may \
                 branch off there"
            );
            (Uniqueness::ExistsNotCertified, because)
        };
        Analysis { uniqueness, because, ..analysis }
    }

    /// Describes, for messages, a point where the equations are not Lipschitz: the function, its behaviour (pole, jump,
    /// infinite slope), and the states and variables in its argument.
    fn behaviour(&self, met: &Irregularity) -> String {
        const SHOWN: usize = 4;
        let names: Vec<&String> = self.state_names.iter().chain(&self.variable_names).collect();
        let named = met.inputs.iter().filter_map(|&input| input.checked_sub(1).and_then(|i| names.get(i)));
        let mut of: Vec<String> = named.map(|name| format!("`{name}`")).collect();
        if of.len() > SHOWN {
            of.truncate(SHOWN);
            of.push("...".to_owned());
        }
        let of = of.join(", ");
        match (met.function, met.jumps) {
            ("/", _) => format!("a quotient with a divisor in {of} passes a pole"),
            ("^", true) => format!("a negative power of a term in {of} passes its pole"),
            ("^", false) => format!("a power below one of a term in {of} has an infinite slope"),
            ("ln" | "log10", _) => format!("`{}` of a term in {of} passes its pole", met.function),
            (function, true) => format!("`{function}` of a term in {of} jumps"),
            (function, false) => format!("`{function}` of a term in {of} has an infinite slope"),
        }
    }
}
