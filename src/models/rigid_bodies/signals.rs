//! Functions of time that drive joints and bodies, with their rates.

use expression::Tape;

/// The nodes and weights of Gauss on the unit interval, of order six: integrals are better than the steps they belong to.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Rounding of an expression, in parts of its largest term.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// The functions of a scene.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// Each function with its derivative by time.
    pub program: Tape,
    /// The functions.
    pub count: usize,
}

/// Functions over one step.
#[derive(Clone, Debug, Default)]
pub struct SignalStep {
    /// The values at the start, in the middle and at the end, and the rates at the end.
    pub start: Vec<f64>,
    pub middle: Vec<f64>,
    pub end: Vec<f64>,
    pub rates: Vec<f64>,
    /// The integrals over the step.
    pub integrals: Vec<f64>,
    /// The length of the step.
    pub h: f64,
}

impl Signals {
    /// The values and the rates at a time.
    pub fn at(&self, t: f64) -> (Vec<f64>, Vec<f64>) {
        if self.count == 0 {
            return Default::default();
        }
        let mut both = vec![0.0; 2 * self.count];
        self.program.clone().evaluate(t, &[], &mut both);
        both.chunks_exact(2).map(|pair| (pair[0], pair[1])).unzip()
    }

    /// How far values and rates at a time are off by rounding: what the largest number on the way to them leaves where it cancels.
    pub fn rounding(&self, t: f64) -> f64 {
        let mut program = self.program.clone();
        program.evaluate(t, &[], &mut vec![0.0; 2 * self.count]);
        ROUNDING * program.largest()
    }

    /// All that a step asks for.
    pub fn over(&self, t: f64, h: f64) -> SignalStep {
        if self.count == 0 {
            return SignalStep { h, ..SignalStep::default() };
        }
        let (end, rates) = self.at(t + h);
        let mut integrals = vec![0.0; self.count];
        for (node, weight) in GAUSS {
            let values = self.at(t + node * h).0;
            integrals.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * h * value);
        }
        SignalStep { start: self.at(t).0, middle: self.at(t + 0.5 * h).0, end, rates, integrals, h }
    }
}
