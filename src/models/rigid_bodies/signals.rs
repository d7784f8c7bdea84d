//! Signals: functions of time that drive joints and bodies, with their time derivatives.

use expression::Tape;

/// The nodes and weights of Gauss quadrature of order six on the unit interval, which is more accurate than the time
/// stepping.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Rounding error of a signal, relative to the largest intermediate result of its expression.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// The signals of a multibody system, compiled to one program.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// The compiled expressions of all signals, each followed by its time derivative.
    pub program: Tape,
    /// The number of signals of the system.
    pub count: usize,
}

/// Values, rates and integrals of the signals over one time step.
#[derive(Clone, Debug, Default)]
pub struct SignalStep {
    /// The values of the signals at the beginning of the step.
    pub start: Vec<f64>,
    /// The values of the signals at the midpoint of the step.
    pub middle: Vec<f64>,
    /// The values of the signals at the end of the step.
    pub end: Vec<f64>,
    /// The time derivatives of the signals at the end of the step.
    pub rates: Vec<f64>,
    /// The integrals of the signals over the time step.
    pub integrals: Vec<f64>,
    /// The length of the time step over which the signals are integrated.
    pub h: f64,
}

impl Signals {
    /// Returns the values and the time derivatives of the signals at a time.
    pub fn at(&self, t: f64) -> (Vec<f64>, Vec<f64>) {
        if self.count == 0 {
            return Default::default();
        }
        let mut both = vec![0.0; 2 * self.count];
        self.program.clone().evaluate(t, &[], &mut both);
        both.chunks_exact(2).map(|pair| (pair[0], pair[1])).unzip()
    }

    /// Returns the rounding error of values and derivatives of the signals at a time, estimated from the largest
    /// intermediate result (cancellation).
    pub fn rounding(&self, t: f64) -> f64 {
        let mut program = self.program.clone();
        program.evaluate(t, &[], &mut vec![0.0; 2 * self.count]);
        ROUNDING * program.largest()
    }

    /// Evaluates and integrates the signals over a step of length `h` from time `t`.
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
