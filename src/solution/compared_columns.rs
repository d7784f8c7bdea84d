//! The requested quantities of a run as columns that can be evaluated along any run: the outputs of the problem, the
//! user's definitions, integrands and monitors, and the expressions that a sweep collects.

use super::longer_steps::{Kind, Measure, Quantity};
use super::reducers::{Over, Reduction};
use super::run::Plan;
use expression::Tape;

/// The columns of a run for comparison with another run: the outputs of the problem, and the programs that compute the
/// other columns.
pub(super) struct Columns {
    outputs: usize,
    programs: [Tape; 2],
    /// For each column that a program computes, the outputs that it depends on.
    inputs: Vec<Vec<usize>>,
    counts: [usize; 2],
    changed: Vec<f64>,
}

impl Columns {
    /// Creates the columns of the quantities that the plan of a run requests.
    pub fn new(plan: &Plan) -> Self {
        let of = &plan.observables;
        let mut inputs = of.inputs.clone();
        let mut programs = [of.program.clone(), Tape::default()];
        let mut counts = [inputs.len(), 0];
        if let Some(reducers) = &plan.reducers {
            inputs.extend(reducers.inputs.iter().cloned());
            counts[1] = reducers.inputs.len();
            programs[1] = reducers.program.clone();
        }
        Self { outputs: plan.names.len(), programs, inputs, counts, changed: Vec::new() }
    }

    /// Returns the number of outputs of the problem, which are the first columns.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Returns the number of columns: the outputs of the problem and the computed columns.
    pub fn count(&self) -> usize {
        self.outputs + self.inputs.len()
    }

    /// Evaluates the columns after the outputs of the problem, which `y` already contains.
    pub fn evaluate(&mut self, t: f64, y: &mut [f64]) {
        let (outputs, mut rest) = y.split_at_mut(self.outputs);
        for (program, count) in self.programs.iter_mut().zip(self.counts) {
            let (own, others) = rest.split_at_mut(count);
            if count > 0 {
                program.evaluate(t, outputs, own);
            }
            rest = others;
        }
    }

    /// Writes the changes of the computed columns to `by`, which already contains small changes of the outputs of the
    /// problem; `y` are the columns before the change.
    pub fn displace(&mut self, t: f64, y: &[f64], by: &mut [f64]) {
        if self.inputs.is_empty() {
            return;
        }
        let mut changed = std::mem::take(&mut self.changed);
        changed.clear();
        changed.extend(y.iter().zip(&*by).map(|(y, by)| y + by));
        self.evaluate(t, &mut changed);
        for k in self.outputs..y.len() {
            by[k] = changed[k] - y[k];
        }
        self.changed = changed;
    }

    /// Writes to `held` whether each computed column is fixed (1) or not (0): it is if it depends on fixed outputs
    /// only. `held` already contains a nonzero number for each output of the problem that contacts hold fixed.
    pub fn hold(&self, held: &mut [f64]) {
        for (place, inputs) in self.inputs.iter().enumerate() {
            let is_held = inputs.iter().all(|&k| held[k] != 0.0);
            held[self.outputs + place] = if is_held { 1.0 } else { 0.0 };
        }
    }

    /// Writes bounds on the changes of the computed columns to `by`, which already contains bounds on small changes
    /// of the outputs of the problem. Each bound is the sum of the effects of all outputs; `y` are the unchanged
    /// columns.
    pub fn spread(&mut self, t: f64, y: &[f64], by: &mut [f64]) {
        if self.inputs.is_empty() {
            return;
        }
        let mut used: Vec<usize> = self.inputs.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        by[self.outputs..].fill(0.0);
        let mut changed = y.to_vec();
        for k in used {
            changed[k] = y[k] + by[k];
            self.evaluate(t, &mut changed);
            changed[k] = y[k];
            for (place, column) in (self.outputs..y.len()).enumerate() {
                let change = (changed[column] - y[column]).abs();
                if self.inputs[place].contains(&k) && change.is_finite() {
                    by[column] += change;
                }
            }
        }
    }

    /// Whether a plan keeps all outputs of the problem, which is the default.
    fn has_all(&self, plan: &Plan) -> bool {
        (0..self.outputs).all(|output| plan.fields.contains(&output))
    }

    /// Returns the quantities that a plan requests, for outputs of the given kinds; all states if it requests
    /// nothing. If all outputs are kept by default, only the states are compared, since they determine all other
    /// outputs.
    pub fn asked(&self, plan: &Plan, kinds: &[Kind]) -> Vec<Quantity> {
        let of = &plan.observables;
        let is_passed_over = |field: usize| {
            self.outputs > plan.initial.len()
                && (plan.initial.len()..self.outputs).contains(&field)
                && self.has_all(plan)
        };
        let kind = |column: usize| match column.checked_sub(self.outputs) {
            None => kinds[column],
            Some(place) if self.inputs[place].iter().all(|&k| kinds[k] == Kind::Continuous) => Kind::Continuous,
            Some(_) => Kind::Jumping,
        };
        let new = |name: &str, column: usize, measure: Measure| {
            Quantity::new(format!("`{name}`"), column, kind(column), measure)
        };
        let at_times = |mut of: Quantity| {
            of.is_at_times = of.measure == Measure::Values;
            of
        };
        let mut asked = Vec::new();
        for &field in plan.fields.iter().filter(|field| !is_passed_over(**field)) {
            let Some(own) = field.checked_sub(self.outputs) else {
                asked.push(at_times(new(&plan.names[field], field, Measure::Values)));
                continue;
            };
            let Some(name) = of.names.get(own) else { continue };
            let is_integral = own >= of.definitions();
            let measure = if is_integral { Measure::Integral { is_squared: false } } else { Measure::Values };
            asked.push(at_times(new(name, field, measure)));
        }
        for (k, monitor) in of.monitors.iter().enumerate() {
            let name = format!("the time at which {}", monitor.label);
            asked.push(new(&name, self.outputs + of.names.len() + k, Measure::Crossings));
        }
        for (name, reduction) in plan.reducers.iter().flat_map(|of| of.names.iter().zip(&of.reductions)) {
            if let Reduction::Value { at, over } = reduction {
                let measure = match over {
                    Over::Mean | Over::Integral => Measure::Integral { is_squared: false },
                    Over::Rms => Measure::Integral { is_squared: true },
                    Over::Final | Over::Initial | Over::Min | Over::Max | Over::Ripple | Over::At(_) => Measure::Values,
                };
                asked.push(new(name, self.outputs + self.counts[0] + at, measure));
            }
        }
        if asked.is_empty() && plan.reducers.is_none() {
            asked.extend((0..plan.initial.len()).map(|k| new(&plan.names[k], k, Measure::Values)));
        }
        asked
    }
}
