//! The flow of a linear system with sinusoidal forcing, written as an autonomous linear system in more unknowns: the
//! states, one, and the sine and cosine of every wave. The flow is a matrix exponential, and a linear function of the
//! states has derivatives of all orders in closed form.

use crate::differential::signal::{Signal, Wave};
use nalgebra::{DMatrix, DVector, RowDVector};

/// The unknowns of the autonomous system: `n` states, one, then `sin(omega t + phase)` and `cos(omega t + phase)` of
/// each wave.
#[derive(Clone, Debug)]
pub struct Driven {
    states: usize,
    waves: Vec<Wave>,
}

impl Driven {
    pub fn new<'a>(states: usize, signals: impl Iterator<Item = &'a Signal>) -> Self {
        let mut waves: Vec<Wave> = Vec::new();
        for wave in signals.flat_map(|signal| &signal.waves) {
            if !waves.iter().any(|other| is_same(other, wave)) {
                waves.push(*wave);
            }
        }
        Self { states, waves }
    }

    pub fn unknowns(&self) -> usize {
        self.states + 1 + 2 * self.waves.len()
    }

    /// Returns a linear function of the states plus a signal, as a row over all unknowns.
    pub fn row(&self, of_states: &[f64], signal: &Signal) -> RowDVector<f64> {
        let mut row = RowDVector::zeros(self.unknowns());
        of_states.iter().enumerate().for_each(|(j, x)| row[j] = *x);
        row[self.states] = signal.constant;
        for wave in &signal.waves {
            let k = self.waves.iter().position(|other| is_same(other, wave)).expect("a wave of the system");
            row[self.states + 1 + 2 * k] += wave.amplitude;
        }
        row
    }

    /// Returns the matrix of the rates of all unknowns; `rows` are the rates of the states.
    pub fn rates(&self, rows: &[RowDVector<f64>]) -> DMatrix<f64> {
        let mut m = DMatrix::zeros(self.unknowns(), self.unknowns());
        rows.iter().enumerate().for_each(|(i, row)| m.set_row(i, row));
        for (k, wave) in self.waves.iter().enumerate() {
            let sine = self.states + 1 + 2 * k;
            (m[(sine, sine + 1)], m[(sine + 1, sine)]) = (wave.omega, -wave.omega);
        }
        m
    }

    /// Returns all unknowns of the autonomous system at the start time, from the initial states.
    pub fn start(&self, x: &[f64]) -> DVector<f64> {
        let waves = self.waves.iter().flat_map(|wave| [wave.phase.sin(), wave.phase.cos()]);
        DVector::from_iterator(self.unknowns(), x.iter().copied().chain([1.0]).chain(waves))
    }
}

fn is_same(a: &Wave, b: &Wave) -> bool {
    a.omega == b.omega && a.phase == b.phase
}

/// The linear system `y' = M y`, with the matrix of its flow over one step that is short enough to resolve the
/// fastest motion.
#[derive(Clone, Debug)]
pub struct Flow {
    pub m: DMatrix<f64>,
    pub h: f64,
    over_step: DMatrix<f64>,
}

/// The product of step size and norm of the balanced matrix, chosen so that the cubic interpolant over a step has an
/// error of about 1e-5.
const STEP: f64 = 0.1;

impl Flow {
    /// Computes the flow of `y' = M y` over a step of at most `longest`.
    pub fn new(m: DMatrix<f64>, longest: f64) -> Self {
        let h = longest.min(STEP / balanced_norm(&m));
        let columns: Vec<DVector<f64>> = (0..m.ncols())
            .map(|j| {
                let mut unit = DVector::zeros(m.ncols());
                unit[j] = 1.0;
                advance(&m, &unit, h)
            })
            .collect();
        Self { over_step: DMatrix::from_columns(&columns), m, h }
    }

    pub fn step(&self, y: &DVector<f64>) -> DVector<f64> {
        &self.over_step * y
    }

    /// Returns `exp(M s) y`, the flow over a fraction of a step.
    pub fn advance(&self, y: &DVector<f64>, s: f64) -> DVector<f64> {
        advance(&self.m, y, s)
    }
}

/// Returns `exp(M s) y` by its Taylor series, for short steps.
fn advance(m: &DMatrix<f64>, y: &DVector<f64>, s: f64) -> DVector<f64> {
    let (mut sum, mut term) = (y.clone(), y.clone());
    for k in 1..=16 {
        term = m * term * (s / k as f64);
        sum += &term;
    }
    sum
}

/// Returns the largest row sum of `M` after balancing of its rows and columns (Osborne 1960).
fn balanced_norm(m: &DMatrix<f64>) -> f64 {
    let n = m.nrows();
    let mut a = m.abs();
    for _ in 0..20 {
        for i in 0..n {
            let (row, column) = (a.row(i).sum() - a[(i, i)], a.column(i).sum() - a[(i, i)]);
            if row > 0.0 && column > 0.0 {
                let factor = (row / column).sqrt();
                a.row_mut(i).scale_mut(1.0 / factor);
                a.column_mut(i).scale_mut(factor);
            }
        }
    }
    // Forcing terms act on the states, but not vice versa: in sufficiently large units of the forcing terms, their
    // entries do not contribute to the norm.
    let is_state = |i: usize| a.column(i).sum() > 0.0 && a.row(i).sum() > 0.0;
    let rows = (0..n).filter(|&i| is_state(i)).map(|i| (0..n).filter(|&j| is_state(j)).map(|j| a[(i, j)]).sum::<f64>());
    rows.fold(f64::MIN_POSITIVE, f64::max)
}

/// A monitor: a linear function of the unknowns that must not be negative.
#[derive(Clone, Debug)]
pub struct Monitor {
    pub row: RowDVector<f64>,
    rate: RowDVector<f64>,
}

/// Relative zero tolerance of a monitor (a linear function of the unknowns), for the errors of rounding and
/// bisection.
pub const ZERO: f64 = 1e-9;
/// Relative tolerance by which a monitor (a linear function that must not be negative) may be negative between
/// events.
const SLACK: f64 = 1e-12;

impl Monitor {
    pub fn new(row: RowDVector<f64>, flow: &DMatrix<f64>) -> Self {
        Self { rate: &row * flow, row }
    }

    fn slack(&self, sizes: &DVector<f64>) -> f64 {
        SLACK * terms(&self.row, sizes)
    }

    /// Returns the first time within a step at which the monitor is below minus `factor` times its tolerance `SLACK`;
    /// `None` if there is none.
    pub fn leaves(
        &self,
        flow: &Flow,
        y: &DVector<f64>,
        next: &DVector<f64>,
        sizes: &DVector<f64>,
        factor: f64,
    ) -> Option<f64> {
        let (h, slack) = (flow.h, factor * self.slack(sizes));
        let at = |y: &DVector<f64>| (self.row.clone() * y)[0] + slack;
        let rate = |y: &DVector<f64>| (self.rate.clone() * y)[0] * h;
        let (p, q, dp, dq) = (at(y), at(next), rate(y), rate(next));
        // The least Bernstein coefficient bounds the cubic interpolant from below, with a margin for its error.
        let (second, third) = (p + dp / 3.0, q - dq / 3.0);
        let range = dp.abs() + dq.abs();
        if q >= 0.0 && second.min(third) > 1e-4 * range {
            return None;
        }
        let value = |s: f64| at(&flow.advance(y, s));
        const PARTS: usize = 32;
        let mut before = 0.0;
        for k in 1..=PARTS {
            let s = h * k as f64 / PARTS as f64;
            if value(s) < 0.0 {
                // The event of a monitor that starts above its tolerance is placed at the zero of the monitor: if it
                // were placed where the tolerance is exceeded, the delays would add up over hundreds of events.
                let zero = if value(before) >= slack { slack } else { 0.0 };
                let (mut low, mut high) = (before, s);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if value(middle) < zero { high = middle } else { low = middle }
                }
                return Some(high);
            }
            before = s;
        }
        None
    }
}

/// Returns the sum of the magnitudes of the terms of the linear function `row y`, for unknowns of the given sizes.
pub fn terms(row: &RowDVector<f64>, sizes: &DVector<f64>) -> f64 {
    row.iter().zip(sizes.iter()).map(|(c, size)| (c * size).abs()).sum()
}

/// Returns the sign of the linear function `row y` just after the current time along `y' = M y`: that of its first
/// derivative, from order zero, that exceeds the fraction `zero` of its terms; zero if there is none.
pub fn lexicographic_sign(
    row: &RowDVector<f64>,
    m: &DMatrix<f64>,
    y: &DVector<f64>,
    sizes: &DVector<f64>,
    zero: f64,
) -> f64 {
    let mut row = row.clone();
    for _ in 0..=m.nrows() {
        let value = (&row * y)[0];
        let terms = terms(&row, sizes);
        if value.abs() > zero * terms {
            return value.signum();
        }
        row *= m;
    }
    0.0
}
