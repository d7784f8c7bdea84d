//! Derivatives of the user's definitions and integrals: `D_x dx/dp + D_p` for a definition `D(t, x, p)`, and the
//! integral of this expression for an integral. If a state jumps at a time `tau` that depends on `p`, the integrand
//! jumps too, and the derivative of the integral changes by `(D(x-) - D(x+)) dtau`.

use super::By;
use crate::observables::{Argument, ObservableSlopes, Observables};
use crate::quadrature::{self, Integrals};
use expression::Tape;
use nalgebra::{DMatrix, DVector};

/// The derivatives of the user's definitions and integrals along a run.
pub(super) struct ObservedSlopes {
    of: ObservableSlopes,
    /// The program of the user's definitions, integrands and monitors, with buffers for the outputs of the problem and
    /// for the values of the program.
    program: Tape,
    outputs: Vec<f64>,
    values: Vec<f64>,
    definitions: usize,
    integrals: usize,
    /// The index of each parameter with respect to which derivatives are requested, the index of its direction of
    /// differentiation, and its speed along the direction.
    directions: Vec<(usize, usize, f64)>,
    count: usize,
    /// The derivatives of the user's integrals at the beginning and at the end of the last step, one row per integral.
    begun: DMatrix<f64>,
    ended: DMatrix<f64>,
    step: (f64, f64),
}

/// A jump of the states at a time that depends on the parameters: the states before and after the jump, and the
/// derivatives of the time of the jump of each state.
pub(super) struct Jump {
    pub t: f64,
    pub before: Vec<f64>,
    pub after: Vec<f64>,
    pub times: DMatrix<f64>,
}

impl ObservedSlopes {
    /// Prepares the derivatives of the user's definitions and integrals at the start of a run of a problem with
    /// `outputs` outputs, with respect to all parameters and initial values in `by`.
    pub fn new(observables: &Observables, outputs: usize, by: &[By], start: f64) -> Self {
        let parameter = |(direction, by): (usize, &By)| match *by {
            By::Parameter(parameter) => Some((parameter, direction, 1.0)),
            By::Initial(_) => None,
        };
        let directions = by.iter().enumerate().filter_map(parameter).collect();
        Self::along(observables, outputs, (directions, by.len()), start)
    }

    /// Prepares the derivatives of the user's definitions and integrals at the start of a run along a single direction,
    /// in which each parameter moves at its own speed.
    pub fn together(observables: &Observables, outputs: usize, (by, speeds): (&[By], &[f64]), start: f64) -> Self {
        let parameter = |(by, speed): (&By, &f64)| match *by {
            By::Parameter(parameter) => Some((parameter, 0, *speed)),
            By::Initial(_) => None,
        };
        let directions = by.iter().zip(speeds).filter_map(parameter).collect();
        Self::along(observables, outputs, (directions, 1), start)
    }

    /// Prepares the derivatives of the user's definitions and integrals at the start of a run along `count` directions
    /// in which no parameter changes.
    pub fn of_states(observables: &Observables, outputs: usize, count: usize, start: f64) -> Self {
        Self::along(observables, outputs, (Vec::new(), count), start)
    }

    fn along(
        observables: &Observables,
        outputs: usize,
        (directions, count): (Vec<(usize, usize, f64)>, usize),
        start: f64,
    ) -> Self {
        let none = DMatrix::zeros(observables.integrals, count);
        Self {
            of: observables.slopes.clone(),
            program: observables.program.clone(),
            outputs: vec![0.0; outputs],
            values: vec![0.0; observables.names.len() + observables.monitors.len()],
            definitions: observables.definitions(),
            integrals: observables.integrals,
            directions,
            count,
            begun: none.clone(),
            ended: none,
            step: (start, start),
        }
    }

    /// Returns the derivatives of the user's definitions and integrands at states `x` with the derivatives `slopes`.
    fn at(&mut self, t: f64, x: &[f64], slopes: &DMatrix<f64>) -> DMatrix<f64> {
        let mut values = vec![0.0; self.of.pattern.len()];
        self.of.program.evaluate(t, x, &mut values);
        let mut out = DMatrix::zeros(self.definitions + self.integrals, self.count);
        for (&(row, argument), value) in self.of.pattern.iter().zip(values) {
            match argument {
                Argument::State(state) => {
                    let mut row = out.row_mut(row);
                    row += slopes.row(state) * value;
                }
                Argument::Parameter(parameter) => {
                    let directions = self.directions.iter().filter(|(of, ..)| *of == parameter);
                    directions.for_each(|&(_, direction, speed)| out[(row, direction)] += speed * value);
                }
            }
        }
        out
    }

    /// Integrates the derivatives of the user's integrands between two times.
    fn integral(&mut self, from: f64, to: f64, mut along: impl FnMut(f64) -> (Vec<f64>, DMatrix<f64>)) -> DMatrix<f64> {
        let (first, integrals, count) = (self.definitions, self.integrals, self.count);
        let mut sums = Integrals::new(integrals * count);
        quadrature::integrate(from, to, &mut sums, |t: f64, out: &mut [f64]| {
            let (x, slopes) = along(t);
            out.copy_from_slice(self.at(t, &x, &slopes).rows(first, integrals).into_owned().as_slice());
        });
        DMatrix::from_column_slice(integrals, count, &sums.values)
    }

    /// Adds a step between two times to the derivatives of the user's integrals; `along` returns the states and their
    /// derivatives at a time within the step.
    pub fn step(
        &mut self,
        (from, to): (f64, f64),
        along: impl FnMut(f64) -> (Vec<f64>, DMatrix<f64>),
        jump: Option<&Jump>,
    ) {
        if self.integrals == 0 {
            return;
        }
        self.begun.copy_from(&self.ended);
        self.step = (from, to);
        if to > from {
            let gained = self.integral(from, to, along);
            self.ended += gained;
        }
        if let Some(jump) = jump {
            self.pass(jump);
        }
    }

    /// Returns the change of the derivatives of the only integral at a jump of the states, one per direction; `None` if
    /// there is no integral.
    pub fn gained(&mut self, jump: &Jump) -> Option<DVector<f64>> {
        if self.integrals == 0 {
            return None;
        }
        self.ended.fill(0.0);
        self.pass(jump);
        Some(self.ended.row(0).transpose())
    }

    /// Adds the changes of the derivatives of the user's integrals at a jump of the states, at which the integrands
    /// jump.
    fn pass(&mut self, jump: &Jump) {
        let Jump { t, before, after, times } = jump;
        let Self { program, outputs, values, definitions, integrals, .. } = self;
        let integrands = *definitions..*definitions + *integrals;
        let mut integrands = |x: &[f64]| {
            outputs[..x.len()].copy_from_slice(x);
            program.evaluate(*t, outputs, values);
            values[integrands.clone()].to_vec()
        };
        // States of independent parts of a motion may jump at times with different derivatives: their jumps are
        // applied one after the other.
        let mut x = before.clone();
        let mut last = integrands(&x);
        let mut open: Vec<usize> = (0..x.len()).collect();
        while let Some(&first) = open.first() {
            let moves: Vec<usize> = open.iter().copied().filter(|&i| times.row(i) == times.row(first)).collect();
            moves.iter().for_each(|&i| x[i] = after[i]);
            open.retain(|i| !moves.contains(i));
            let next = integrands(&x);
            for (integral, (before, after)) in last.iter().zip(&next).enumerate() {
                let mut row = self.ended.row_mut(integral);
                row += times.row(first) * (before - after);
            }
            last = next;
        }
    }

    /// Returns the derivatives of the user's definitions and integrals at a time within the last step.
    pub fn write(&mut self, t: f64, mut along: impl FnMut(f64) -> (Vec<f64>, DMatrix<f64>)) -> DMatrix<f64> {
        let (x, slopes) = along(t);
        let mut out = self.at(t, &x, &slopes);
        if self.integrals > 0 {
            let integrals = match t < self.step.1 {
                true => self.integral(self.step.0, t, along) + &self.begun,
                false => self.ended.clone(),
            };
            out.rows_mut(self.definitions, self.integrals).copy_from(&integrals);
        }
        out
    }
}
