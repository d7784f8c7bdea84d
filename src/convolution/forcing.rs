//! The forcing of a problem with memory: the function `q` of time and the moving bounds, at a time and enclosed over
//! an interval of time.

use super::stepper::StepError;
use numerics::Interval;
use problem::{ConvexSet, Dvi, MovingBound, Side};

/// The forcing of a problem without states, whose inequality is the function `q` of time.
pub(crate) struct Forcing<'p> {
    problem: &'p mut dyn Dvi,
    zeros: Vec<f64>,
    values: Vec<f64>,
    over: Over,
}

/// Enclosures of the forcing over an interval of time.
#[derive(Default)]
pub(crate) struct Over {
    /// Enclosures of the function `q`, then of the moving bounds in their order.
    pub values: Vec<Interval>,
    /// Enclosures of the time derivatives of the function `q`.
    pub slopes: Vec<Interval>,
    zeros: Vec<Interval>,
    jacobian: Vec<Interval>,
}

impl<'p> Forcing<'p> {
    /// Prepares the evaluation of the forcing of a problem without states.
    pub fn new(problem: &'p mut dyn Dvi) -> Self {
        let structure = problem.structure();
        let (zeros, values) = (vec![0.0; structure.variables], vec![0.0; structure.rows()]);
        let over = Over {
            values: vec![Interval::LINE; structure.rows()],
            slopes: vec![Interval::LINE; structure.variables],
            zeros: vec![Interval::point(0.0); structure.variables],
            jacobian: vec![Interval::LINE; structure.pattern.len()],
        };
        Self { problem, zeros, values, over }
    }

    /// Returns the forcing `q` at time `t`, and sets the moving bounds in `set`, where the variables of the problem
    /// begin at index `offset`.
    pub fn at(&mut self, t: f64, offset: usize, set: &mut ConvexSet) -> Result<&[f64], StepError> {
        self.problem.evaluate(t, &self.zeros, &mut self.values);
        if let Some(row) = self.values.iter().position(|value| !value.is_finite()) {
            return Err(StepError::NotFinite { row, t });
        }
        let (q, bounds) = self.values.split_at(self.zeros.len());
        for (moving, &value) in self.problem.structure().moving.iter().zip(bounds) {
            let MovingBound { variable, side } = *moving;
            let place = offset + variable;
            MovingBound { variable: place, side }.place(value, set);
            if set.lower[place] > set.upper[place] || (side == Side::Radius && value < 0.0) {
                return Err(StepError::EmptySet { variable, side, t });
            }
        }
        Ok(q)
    }

    /// Returns the values of `q` and of the moving bounds at time `t`, without a check that they are finite.
    pub fn rows_at(&mut self, t: f64) -> &[f64] {
        self.problem.evaluate(t, &self.zeros, &mut self.values);
        &self.values
    }

    /// Encloses `q`, the moving bounds and the time derivatives of `q` over an interval of time; `None` if the problem
    /// has no enclosure.
    pub fn enclose(&mut self, times: Interval) -> Option<&Over> {
        let Over { values, slopes, zeros, jacobian } = &mut self.over;
        let is_enclosed = self.problem.enclose(times, zeros, values)
            && self.problem.enclose_derivatives(times, zeros, jacobian, slopes);
        is_enclosed.then_some(&self.over)
    }

    /// Returns the index of the row that holds one moving bound of a variable.
    pub fn row_of_bound(&self, variable: usize, side: Side) -> Option<usize> {
        let bound = MovingBound { variable, side };
        let structure = self.problem.structure();
        structure.moving.iter().position(|moving| *moving == bound).map(|place| self.zeros.len() + place)
    }

    /// Returns the problem whose functions of time are the forcing.
    pub fn problem(&mut self) -> &mut dyn Dvi {
        self.problem
    }
}
