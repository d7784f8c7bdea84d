//! The quantities screened on an element: `+-(F + s)`, which the active set requires not to fall below a limit, with
//! a function `F` of the element, and with `s` the function `q` of time or a bound.

use super::outputs::{Here, convolve};
use super::panel::Panel;
use super::trial::Trial;
use super::{Activity, Segments};
use crate::forcing::Over;
use crate::stepper::StepError;
use nalgebra::DMatrix;
use numerics::Interval;
use problem::Side;

/// Admissible deviation of a moving bound from its interpolant, relative to its change over the element: within it, the
/// nodes show the course of the bound, and the error estimate bounds its error. Bounds are enclosed without their slopes,
/// so that a proof takes as many parts as this fraction is small.
const SHOWN: f64 = 0.1;

/// Admissible deviation of `q` of an inactive variable from its interpolant, relative to its change over the element. A
/// judgement: the effect on `q` of a switch between the nodes has the size of its change, and an accurate element
/// deviates by far less than a hundredth of that; a value near one would miss such a switch, a much smaller one would
/// halve elements within tolerance.
const RESOLVED: f64 = 1e-2;

/// The function `F` in a screened quantity `+-(F + s)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Function {
    /// A variable `z` of the inequality.
    Variable,
    /// The convolution `m * z` of the kernel and the variables.
    Memory,
    /// The negative interpolant of `q` through its values at the nodes.
    Source,
}

/// The term `s` in a screened quantity `+-(F + s)`.
#[derive(Clone, Copy, Debug)]
pub(super) enum Beside {
    Constant(f64),
    /// A row of the forcing, `q` or a bound, times a factor.
    Row(usize, f64),
}

/// A screened quantity, which must not become negative.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watched {
    pub variable: usize,
    pub function: Function,
    pub sign: f64,
    pub beside: Beside,
    /// The new activity of the variable if the quantity is negative; `None` if a negative value means that the
    /// function `q` of the inequality or a bound is not resolved by its values at the nodes.
    pub to: Option<Activity>,
    /// The tolerance on the quantity, which must be at least `-limit`.
    pub limit: f64,
}

impl Watched {
    /// Returns the term `s` of the quantity `+-(F + s)` for the values `rows` of the forcing.
    pub fn beside_at(&self, rows: &[f64]) -> f64 {
        match self.beside {
            Beside::Constant(value) => value,
            Beside::Row(row, factor) => factor * rows[row],
        }
    }

    /// Returns the range of the term `s` of the quantity `+-(F + s)`, and of its derivative with respect to time.
    pub fn beside_over(&self, over: &Over) -> (Interval, Interval) {
        match self.beside {
            Beside::Constant(value) => (Interval::point(value), Interval::point(0.0)),
            Beside::Row(row, factor) => {
                let factor = Interval::point(factor);
                let slope = over.slopes.get(row).map_or(Interval::LINE, |slope| *slope * factor);
                (over.values[row] * factor, if slope.defined { slope } else { Interval::LINE })
            }
        }
    }
}

/// The functions `F` in the quantities screened on an element, with data for their bounds.
pub(super) struct Functions<'a> {
    pub trial: &'a Trial,
    /// The coefficients of the negative interpolant of `q` through its values at the nodes.
    pub sources: DMatrix<f64>,
    /// The bounds of the smooth factor `g` of the kernel and of its derivative, for each term of the kernel.
    factors: Vec<[f64; 2]>,
}

impl Segments<'_> {
    /// Returns the quantities to be screened on an element.
    pub(super) fn watch(&self, trial: &Trial) -> Vec<Watched> {
        let mut watched = Vec::new();
        for (k, place) in self.places.iter().enumerate() {
            let bound = |side: Side, value: f64| match self.forcing.row_of_bound(k, side) {
                Some(row) => Beside::Row(row, -1.0),
                None => Beside::Constant(-value),
            };
            let mut add = |function, sign, beside, to, limit| {
                watched.push(Watched { variable: k, function, sign, beside, to, limit });
            };
            let of_variable = self.allowed(k, self.size[k].max(trial.size[k])) + trial.noise[k];
            let of_inequality = trial.slack[k] + trial.noise[k];
            // A variable at a moving bound follows the polynomial through the values of the bound at the nodes.
            let follow = |side: Side, add: &mut dyn FnMut(Function, f64, Beside, Option<Activity>, f64)| {
                let Some(row) = self.forcing.row_of_bound(k, side) else { return };
                let shape = &self.shapes[trial.shape];
                let at_nodes = shape.values.columns(0, shape.len()) * trial.levels[0].column(k);
                let limit = SHOWN * (at_nodes.max() - at_nodes.min()) + of_variable;
                for sign in [1.0, -1.0] {
                    add(Function::Variable, sign, Beside::Row(row, -1.0), None, limit);
                }
            };
            match place {
                Activity::Inactive => {
                    let (lower, upper) = (self.set.lower[k], self.set.upper[k]);
                    let lower = Some(bound(Side::Lower, lower)).filter(|_| lower.is_finite());
                    let upper = Some(bound(Side::Upper, upper)).filter(|_| upper.is_finite());
                    if let Some(beside) = lower {
                        add(Function::Variable, 1.0, beside, Some(Activity::AtLower), of_variable);
                    }
                    if let Some(beside) = upper {
                        add(Function::Variable, -1.0, beside, Some(Activity::AtUpper), of_variable);
                    }
                    let column = trial.sources.column(k);
                    let limit = RESOLVED * (column.max() - column.min()) + trial.source_noise[k];
                    for sign in [1.0, -1.0] {
                        add(Function::Source, sign, Beside::Row(k, 1.0), None, limit);
                    }
                }
                Activity::AtLower => {
                    follow(Side::Lower, &mut add);
                    add(Function::Memory, 1.0, Beside::Row(k, 1.0), Some(Activity::Inactive), of_inequality);
                }
                Activity::AtUpper => {
                    follow(Side::Upper, &mut add);
                    add(Function::Memory, -1.0, Beside::Row(k, 1.0), Some(Activity::Inactive), of_inequality);
                }
                Activity::Fixed => {}
            }
        }
        watched
    }

    /// Prepares the functions `F` in the quantities screened on an element.
    pub(super) fn functions<'a>(&self, trial: &'a Trial) -> Functions<'a> {
        let shape = &self.shapes[trial.shape];
        let n = shape.len();
        let length = self.t - self.start + 2.0 * trial.h;
        let factors = self.terms.iter().map(|term| term.lag.as_ref().map_or([1.0, 0.0], |lag| lag.bounds(length)));
        Functions { trial, sources: shape.inverse(n) * trial.sources.rows(0, n) * -1.0, factors: factors.collect() }
    }

    /// Writes the functions of the screened quantities at the position `theta` in the element: the variables, the
    /// convolution `m * z`, and the interpolants of `q`.
    pub(super) fn evaluate_functions(
        &mut self,
        functions: &Functions<'_>,
        theta: f64,
        with_memory: bool,
        out: &mut [Vec<f64>; 3],
    ) -> Result<(), StepError> {
        let trial = functions.trial;
        let shape = &self.shapes[trial.shape];
        let mut row = vec![0.0; shape.len()];
        shape.evaluate(theta, &mut row);
        super::past::combine(&trial.levels[0], &row, &mut out[0]);
        super::past::combine(&functions.sources, &row, &mut out[2]);
        out[1].fill(0.0);
        if with_memory {
            let before = self.past.elements.len();
            let here = Here { before, shape, start: self.t, h: trial.h, levels: &trial.levels };
            convolve(&mut self.terms, (&self.past, &self.shapes), &here, theta, &mut out[1])?;
        }
        Ok(())
    }

    /// Bounds a function of the screened quantities on the Bernstein ellipse of a panel. The bound of the convolution
    /// `m * z` assumes the factor `g` of the kernel to be as smooth as the quadrature rules do.
    pub(super) fn bound_on(&self, functions: &Functions<'_>, watched: &Watched, panel: Panel) -> f64 {
        let (trial, k) = (functions.trial, watched.variable);
        let shape = &self.shapes[trial.shape];
        let (growth, reach) = (panel.growth(), panel.reach());
        let of = |matrix: &DMatrix<f64>, k: usize| shape.bound(matrix.column(k).iter().copied(), growth, reach);
        match watched.function {
            Function::Variable => of(&trial.levels[0], k),
            Function::Source => of(&functions.sources, k),
            Function::Memory => self.over_entries(k, |place, column| {
                let term = &self.terms[place];
                let here = of(&trial.levels[term.level], column);
                let Some(lag) = &term.lag else { return here };
                let before = self.past.largest[term.level][column];
                let ends =
                    [reach * trial.h, self.t - self.start + reach * trial.h].map(|end| lag.integral_of_power(end));
                functions.factors[place][0] * (here * ends[0] + before * ends[1])
            }),
        }
    }

    /// Bounds the change of a function of the screened quantities from the beginning of the element up to `theta`.
    pub(super) fn change_up_to(&self, functions: &Functions<'_>, watched: &Watched, theta: f64) -> f64 {
        let (trial, k) = (functions.trial, watched.variable);
        let shape = &self.shapes[trial.shape];
        let change = |matrix: &DMatrix<f64>| shape.change(matrix.column(k).iter().copied(), theta);
        match watched.function {
            Function::Variable => change(&trial.levels[0]),
            Function::Source => change(&functions.sources),
            Function::Memory => self.over_entries(k, |place, column| {
                let term = &self.terms[place];
                let length = theta * trial.h;
                let largest = |level: usize| {
                    let here: f64 = trial.levels[level].column(column).iter().map(|c| c.abs()).sum();
                    (here, here.max(self.past.largest[level][column]))
                };
                let Some(lag) = &term.lag else { return length * largest(term.level.saturating_sub(1)).1 };
                let [factor, slope] = functions.factors[place];
                let all = lag.integral_of_power(self.t - self.start + length);
                if term.level > 0 {
                    // The time derivative of the integral of a variable is the variable itself.
                    return length * largest(term.level - 1).1 * factor * all;
                }
                let (here, anywhere) = largest(0);
                let next = lag.integral_of_power(length);
                here * factor * next + anywhere * (factor * next + slope * length * all)
            }),
        }
    }

    /// Returns the uncertainty of the inequality `w` from errors of the variables within the tolerance since the
    /// beginning of the run.
    pub(super) fn uncertainty(&self, variable: usize) -> f64 {
        let length = self.t - self.start;
        self.over_entries(variable, |place, column| {
            let term = &self.terms[place];
            let allowed = self.allowed(column, self.size[column]) * length.powi(term.level as i32);
            term.lag.as_ref().map_or(allowed, |lag| allowed * lag.bounds(length)[0] * lag.integral_of_power(length))
        })
    }

    /// Sums `of(term, column)` over the terms of the kernel and the entries of one row of their matrices, times the
    /// absolute value of the entry.
    fn over_entries(&self, row: usize, of: impl Fn(usize, usize) -> f64) -> f64 {
        let mut sum = 0.0;
        for (place, term) in self.terms.iter().enumerate() {
            let entries = term.matrix.iter().filter(|entry| entry.0 == row);
            sum += entries.map(|&(_, column, value)| value.abs() * of(place, column)).sum::<f64>();
        }
        sum
    }
}
