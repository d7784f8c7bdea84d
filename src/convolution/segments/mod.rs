//! A run by segments: between two switches the variables at their bounds stay there, the others solve `w = 0`, a Volterra
//! equation of the first kind, by collocation with product integration (Brunner 2004, Collocation Methods for Volterra
//! Integral and Related Functional Differential Equations) on elements of any length. Where a sign of the face is lost the
//! element is shortened to end there ([`location`]), the face changes, and the next segment begins with the functions that
//! are singular like the solution is there ([`shape`]); all segments before are a source ([`past`]).

mod lag;
mod location;
mod past;
mod shape;
mod trial;

use super::kernel::Kernel;
use super::stepper::{Forcing, StepError};
use lag::Lag;
use nalgebra::DMatrix;
use past::Past;
use problem::{Control, ConvexSet, Dvi, Structure, Workspace};
use shape::Shape;
use trial::Trial;

/// Where a variable is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// At its lower bound.
    Lower,
    /// Between its bounds.
    Inside,
    /// At its upper bound.
    Upper,
    /// Where its bounds are equal.
    Fixed,
}

/// What a run is told.
#[derive(Clone, Debug)]
pub struct SegmentSettings {
    /// Polynomials on an element, from 1 to 9.
    pub stages: usize,
    /// Relative tolerance.
    pub rtol: f64,
    /// Absolute tolerance of each variable.
    pub atol: Vec<f64>,
    /// What the error of an element may be, against the tolerance.
    pub tolerance: f64,
    /// The first element tried.
    pub first: f64,
    /// The longest element.
    pub longest: f64,
}

/// A switch of a variable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switch {
    /// When.
    pub t: f64,
    /// The variable.
    pub variable: usize,
    /// Where it has gone.
    pub to: Place,
}

/// A term of the kernel.
struct Part {
    lag: Option<Lag>,
    level: usize,
    matrix: Vec<(usize, usize, f64)>,
}

/// A run.
pub struct Segments<'p> {
    forcing: Forcing<'p>,
    moves: bool,
    set: ConvexSet,
    shapes: [Shape; 2],
    terms: Vec<Part>,
    past: Past,
    t: f64,
    start: f64,
    end: f64,
    h: f64,
    longest: f64,
    /// The size of recent elements, against which one is tiny.
    usual: f64,
    rtol: f64,
    atol: Vec<f64>,
    tolerance: f64,
    is_first: bool,
    places: Vec<Place>,
    /// The places of the last element, none before the first.
    told: Option<Vec<Place>>,
    /// Changes of the face since the last element.
    flips: usize,
    /// Tiny elements one after the other.
    kinks: u32,
    /// The length of an element on which no face was found to hold, zero where the last was none, and whether it is next.
    unclear: (f64, bool),
    /// Where the first of some brief elements began, the last of which is the last of all.
    brief: Option<f64>,
    size: Vec<f64>,
    /// The integrals of the variables up to now, once, twice, .., by their polynomials.
    integrals: Vec<Vec<f64>>,
    /// The integral of the variables up to now.
    integral: Vec<f64>,
    switches: Vec<Switch>,
    /// Elements that were made again, shorter.
    pub rejected: u64,
    order: usize,
    control: &'p Control,
    work: Workspace,
}

/// An element that had to be this much shorter than usual adds nothing to a mean over time.
const TINY: f64 = 1.5e-8;
/// How fast the usual size follows elements that are shorter.
const FORGET: f64 = 0.9;
/// The part of the step that the error allows, and by how much an element may differ from the last.
const SAFETY: f64 = 0.9;
const LEAST: f64 = 0.1;
const MOST: f64 = 2.5;
/// By how much an element on which no face holds is longer than the one before.
const LONGER: f64 = 8.0;
/// Elements that may be rejected one after the other: they shrink to at most half each time.
const MOST_IN_A_ROW: u32 = 52;

impl<'p> Segments<'p> {
    /// Whether a problem can be solved so: variables in intervals, and few enough for full matrices.
    pub fn suit(structure: &Structure, stages: usize) -> bool {
        const UNKNOWNS: usize = 100;
        !structure.set.has_blocks() && structure.variables * stages <= UNKNOWNS
    }

    /// A run over `[start, end]`; `problem` has no states, its inequality is `q`.
    ///
    /// # Errors
    /// Values that are not finite, or an empty set.
    pub fn new(
        problem: &'p mut dyn Dvi,
        kernel: &Kernel,
        settings: &SegmentSettings,
        start: f64,
        end: f64,
        control: &'p Control,
    ) -> Result<Self, StepError> {
        let (m, moves) = (problem.structure().variables, !problem.structure().moving.is_empty());
        let mut set = problem.structure().set.clone();
        let fraction = kernel.terms.iter().map(|term| term.function.exponent.fract()).find(|e| *e > 0.0);
        let beta = fraction.map_or(0.0, |fraction| 1.0 - fraction);
        let levels = kernel.terms.iter().map(|term| term.function.integrations).max().unwrap_or(0);
        let shapes = [Shape::smooth(settings.stages), Shape::behind_switch(settings.stages, beta, levels)];
        let parts = kernel.terms.iter().map(|term| Part {
            lag: Lag::new(&term.function, beta),
            level: term.function.integrations,
            matrix: term.matrix.clone(),
        });
        let terms: Vec<Part> = parts.collect();
        let past = Past::new(m, &shapes, levels);
        let mut forcing = Forcing::new(problem);
        let q = forcing.at(start, 0, &mut set)?.to_vec();
        let place = |k: usize| match q[k] {
            _ if set.lower[k] == set.upper[k] && !moves => Place::Fixed,
            q if q > 0.0 && set.lower[k].is_finite() => Place::Lower,
            q if q < 0.0 && set.upper[k].is_finite() => Place::Upper,
            _ => Place::Inside,
        };
        Ok(Self {
            places: (0..m).map(place).collect(),
            forcing,
            moves,
            set,
            shapes,
            terms,
            past,
            t: start,
            start,
            end,
            h: settings.first.min(settings.longest),
            longest: settings.longest,
            usual: 0.0,
            rtol: settings.rtol,
            atol: settings.atol.clone(),
            tolerance: settings.tolerance,
            is_first: true,
            told: None,
            flips: 0,
            kinks: 0,
            unclear: (0.0, false),
            brief: None,
            size: vec![0.0; m],
            integrals: vec![vec![0.0; m]; levels],
            integral: vec![0.0; m],
            switches: Vec::new(),
            rejected: 0,
            order: settings.stages,
            control,
            work: Workspace::default(),
        })
    }

    /// The time reached.
    pub fn t(&self) -> f64 {
        self.t
    }

    /// Whether the end is reached.
    pub fn is_done(&self) -> bool {
        self.t >= self.end
    }

    /// The elements made.
    pub fn elements(&self) -> usize {
        self.past.elements.len()
    }

    /// The polynomials on an element.
    pub fn stages(&self) -> usize {
        self.order
    }

    /// The switches at the beginning of the last element, or none.
    pub fn take_switches(&mut self) -> Vec<Switch> {
        std::mem::take(&mut self.switches)
    }

    /// The smallest element that the time can be told by.
    fn resolution(&self, h: f64) -> f64 {
        8.0 * f64::EPSILON * self.t.abs().max(self.start.abs()).max((self.t + h).abs())
    }

    /// Makes the next element; there is one.
    ///
    /// # Errors
    /// Values that are not finite, an empty set, no solution, an interruption.
    pub fn step(&mut self) -> Result<(), StepError> {
        let mut in_a_row = 0;
        loop {
            if self.control.poll().is_some() {
                return Err(StepError::Interrupted { t: self.t });
            }
            let left = self.end - self.t;
            if std::mem::take(&mut self.unclear.1) {
                let h = self.unclear.0.min(left);
                let trial = self.trial(h)?;
                self.accept(&trial, h, true);
                return Ok(());
            }
            let wanted = self.h.min(self.longest);
            // The last two elements share what is left.
            let h = if wanted >= left { left } else { wanted.min(0.5 * left).max(wanted.min(left - wanted)) };
            let trial = self.trial(h)?;
            let is_tiny = h <= TINY * self.usual || h <= self.resolution(h);
            if self.kinks > MOST_IN_A_ROW || in_a_row > MOST_IN_A_ROW {
                let outcome = "no element is short enough";
                return Err(StepError::Unsolved { t: self.t, outcome, residual: f64::NAN });
            }
            // Forces may have a kink at the switch: only the element up to it can be accurate.
            let (trial, change) = match trial.violation {
                Some(violation) => self.locate(trial, violation)?,
                None => (Some(trial), None),
            };
            if let Some(trial) = trial {
                let h = trial.h;
                if trial.error > 1.0 && !is_tiny {
                    self.rejected += 1;
                    in_a_row += 1;
                    self.h = h * (SAFETY * trial.error.powf(-1.0 / self.order as f64)).clamp(LEAST, 0.5);
                    continue;
                }
                let wanted = self.h;
                self.accept(&trial, h, is_tiny && trial.error > 1.0);
                if let Some((variable, to)) = change {
                    self.rejected += 1;
                    self.h = wanted;
                    self.change(variable, to)?;
                }
                return Ok(());
            }
            self.rejected += 1;
            if let Some((variable, to)) = change {
                self.change(variable, to)?;
            }
        }
    }

    /// Moves a variable to another place, where a new segment begins.
    ///
    /// Where a force has a kink at the switch itself no face may hold for the time that rounding errors make: a tiny element,
    /// longer each time, is then made as it is, with the variable at its bound.
    fn change(&mut self, variable: usize, to: Place) -> Result<(), StepError> {
        self.is_first = true;
        self.flips += 1;
        if self.flips > 2 * self.places.len() + 2 {
            self.flips = 0;
            let length = if self.unclear.0 == 0.0 { self.resolution(0.0) } else { LONGER * self.unclear.0 };
            self.unclear = (length, true);
            if length > TINY * self.usual {
                let outcome = "no face holds behind a switch";
                return Err(StepError::Unsolved { t: self.t, outcome, residual: f64::NAN });
            }
            if to == Place::Inside {
                return Ok(());
            }
        }
        self.places[variable] = to;
        Ok(())
    }

    /// Takes an element into the past.
    fn accept(&mut self, trial: &Trial, h: f64, is_kink: bool) {
        let m = self.places.len();
        let shape = &self.shapes[trial.shape];
        let n = shape.len();
        let end = if h >= self.end - self.t { self.end } else { self.t + h };
        // What rounding errors make of a face next to a switch is not told.
        let is_brief = is_kink || h <= TINY * self.usual;
        if !is_brief {
            let t = self.brief.take().unwrap_or(self.t);
            for (variable, (last, now)) in self.told.iter().flatten().zip(&self.places).enumerate() {
                if last != now {
                    self.switches.push(Switch { t, variable, to: *now });
                }
            }
            self.told = Some(self.places.clone());
            (self.flips, self.kinks, self.unclear) = (0, 0, (0.0, false));
        } else {
            self.kinks += 1;
            self.brief.get_or_insert(self.t);
        }
        let integrals = shape.integrals.view((0, 0), (n, n)) * h;
        let mut coefficients = vec![trial.coefficients.clone()];
        for level in 0..self.integrals.len() {
            let mut integrated = shape.antiderivative(n) * &coefficients[level] * h;
            for k in 0..m {
                // The first function is one.
                integrated[(0, k)] += self.integrals[level][k];
                self.integrals[level][k] = shape.values.row(n - 1).columns(0, n).transpose().dot(&integrated.column(k));
            }
            coefficients.push(integrated);
        }
        let at_start = self.integral.clone();
        for k in 0..m {
            let column = trial.coefficients.column(k);
            self.integral[k] += (0..n).map(|j| integrals[(n - 1, j)] * column[j]).sum::<f64>();
            self.size[k] = self.size[k].max(trial.size[k]);
        }
        self.past.append(self.t, end, trial.shape, coefficients, at_start);
        self.t = end;
        self.is_first = is_kink;
        let factor = (SAFETY * trial.error.max(1e-12).powf(-1.0 / self.order as f64)).clamp(LEAST, MOST);
        if !is_brief {
            self.usual = (FORGET * self.usual).max(h);
        }
        self.h = if is_kink { LEAST * self.usual } else { h * factor };
    }

    /// Writes `z`, its integral and `w` at a time within the elements so far. `z` is the point of `K` nearest to the
    /// polynomial.
    ///
    /// # Errors
    /// Values that are not finite.
    pub fn outputs(&mut self, t: f64, out: &mut [f64]) -> Result<(), StepError> {
        let m = self.places.len();
        let q = self.forcing.at(t, 0, &mut self.set)?;
        let (z, rest) = out.split_at_mut(m);
        let (integral, w) = rest.split_at_mut(m);
        w.copy_from_slice(q);
        let last = self.past.elements.partition_point(|element| element.start < t).saturating_sub(1);
        let (mut sum, mut size) = (vec![0.0; m], vec![0.0; m]);
        let Some(element) = self.past.elements.get(last) else { return Ok(()) };
        let (shape, h) = (&self.shapes[element.shape], element.length());
        let theta = ((t - element.start) / h).clamp(0.0, 1.0);
        let mut row = vec![0.0; shape.len()];
        shape.evaluate(theta, &mut row);
        combine(&element.coefficients[0], &row, z);
        shape.integrate(theta, &mut row);
        combine(&element.coefficients[0], &row, integral);
        integral.iter_mut().zip(&element.integral).for_each(|(value, start)| *value = start + h * *value);
        for term in &mut self.terms {
            let element = &self.past.elements[last];
            sum.fill(0.0);
            match &mut term.lag {
                None => {
                    shape.evaluate(theta, &mut row);
                    combine(&element.coefficients[term.level], &row, &mut sum);
                }
                Some(lag) => {
                    if theta > 0.0 {
                        lag.within(shape, h, theta, &mut row)?;
                        combine(&element.coefficients[term.level], &row, &mut sum);
                    }
                    self.past.convolve(
                        lag,
                        &self.shapes,
                        term.level,
                        last,
                        (element.start, theta * h),
                        &mut sum,
                        &mut size,
                    )?;
                }
            }
            for &(row, column, value) in &term.matrix {
                w[row] += value * sum[column];
            }
        }
        self.set.project_all(z, &mut self.work);
        Ok(())
    }

    /// Writes the variables at a time within the elements so far, as they are.
    pub fn variables_at(&self, t: f64, z: &mut [f64]) {
        let last = self.past.elements.partition_point(|element| element.start < t).saturating_sub(1);
        let Some(element) = self.past.elements.get(last) else { return };
        let shape = &self.shapes[element.shape];
        let mut row = vec![0.0; shape.len()];
        shape.evaluate(((t - element.start) / element.length()).clamp(0.0, 1.0), &mut row);
        combine(&element.coefficients[0], &row, z);
    }

    /// The mean over time of the distance of each variable from what another run found.
    pub fn mean_distance(&self, other: &Self) -> Vec<f64> {
        let m = self.places.len();
        let (mut own, mut others, mut sums) = (vec![0.0; m], vec![0.0; m], vec![0.0; m]);
        let rule = crate::gauss_jacobi::gauss_jacobi(self.order, 0.0);
        for element in &self.past.elements {
            for &(x, weight) in &rule {
                let t = element.start + x * element.length();
                self.variables_at(t, &mut own);
                other.variables_at(t, &mut others);
                for (sum, (a, b)) in sums.iter_mut().zip(own.iter().zip(&others)) {
                    *sum += weight * element.length() * (a - b).abs();
                }
            }
        }
        sums.iter().map(|sum| sum / (self.t - self.start)).collect()
    }

    /// The largest absolute value of each variable.
    pub fn sizes(&self) -> &[f64] {
        &self.size
    }

    /// `K` where outputs were last asked for.
    pub fn set(&self) -> &ConvexSet {
        &self.set
    }

    /// The variables at the time reached.
    pub fn ends(&self) -> Vec<f64> {
        let mut z = vec![0.0; self.places.len()];
        self.variables_at(self.t, &mut z);
        z
    }
}

/// The combination of functions by coefficients.
fn combine(coefficients: &DMatrix<f64>, functions: &[f64], out: &mut [f64]) {
    for (value, column) in out.iter_mut().zip(coefficients.column_iter()) {
        *value = column.iter().zip(functions).map(|(c, f)| c * f).sum();
    }
}
