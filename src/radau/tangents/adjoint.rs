//! The adjoint of the derivatives along a run: the gradient of one number with respect to many directions.
//!
//! A step and a switch change the derivatives `S` of the states by a linear map, `S+ = A S + C`, one column per
//! direction. A number with the derivative `l+ S+ + g` at its end has the derivative `l S + (g + l+ C)` at its beginning,
//! with `l = l+ A`: one row `l` is carried backwards over the accepted steps, at a cost that does not depend on the
//! number of directions but for the products with `C`. The maps are those of [`Tangents`]:
//!
//! ```text
//! step:     K dX = (M dx_n, .., M dx_n) + C,  dx_{n+1} = dX_s:    K^T w = (0, .., l+),  l = M^T sum_i w_i,  g += C^T w
//! switch:   dx+ = dx- + j (a dx- + c),  dtau = a dx- + c:         l = l+ + a (l+ j),  g += c (l+ j)
//! ```
//!
//! so that the gradient is the derivative of the same steps, to rounding (the discrete adjoint; Hairer, Lubich and Wanner
//! 2006, VI.10.2; at events Hiskens and Pai 2000). The rows `a` and `c` of a switch are found along a basis of the
//! states and the directions, by [`Tangents::saltations`].
//!
//! Steps are stored in segments. If all of them would take more memory than allowed, the oldest segments are dropped
//! except for the point at which each begins, from which the run makes its steps a second time (checkpointing;
//! Griewank and Walther 2008, chapter 12, with one level): at most twice the work, in the memory allowed and that of
//! the points.
//!
//! The integral of a function `L(t, x, p)` over a step is a linear function of the quantities that determine the
//! polynomial of the derivatives within the step ([`IntegralWeights`]), whose weights are added to those of its
//! stages.

use super::{Directions, NoDerivative, Point, RowsBy, Saltation, Tangents};
use crate::dense_output::Step;
use crate::settings::StepError;
use crate::stepper::{LastStep, Radau, Saved};
use crate::tableau::Tableau;
use hybrid::OneStep;
use nalgebra::{DMatrix, DVector};
use problem::Dvi;

/// Counters of the work of a backward sweep of the adjoint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Number of steps over which costates were carried backwards.
    pub steps: u64,
    /// Number of evaluations of the derivatives of all rows, at the stages of steps.
    pub jacobians: u64,
    /// Number of factorisations of the transposed equations of the stages, each with one solution.
    pub factorisations: u64,
    /// Number of steps that were made a second time, since they were not stored.
    pub repeated: u64,
    /// Number of central differences, one for each state and direction, at breakpoints of time and of hidden
    /// constraints.
    pub differences: u64,
}

/// Number of segments of stored steps of a run that fit into the memory allowed at one time.
const SEGMENTS: usize = 8;

/// A segment of consecutive steps, with the switches at their ends.
struct Segment {
    /// The point of the run at which the segment begins.
    begin: (Saved, Point),
    /// The time of the run at which the segment ends.
    end: f64,
    /// The stored steps and switches of the segment; `None` if they were dropped.
    records: Option<Vec<Record>>,
    bytes: usize,
}

/// A step or a switch of a run, with the data that the backward sweep of the adjoint needs.
enum Record {
    Step {
        step: Box<StoredStep>,
        /// Magnitudes of the terms of the derivatives that are computed along the run, one per state; empty if they
        /// are not measured.
        terms: Vec<f64>,
    },
    Switch(Saltation),
}

/// The result of a backward sweep of the adjoint.
#[derive(Clone, Debug, Default)]
pub struct Swept {
    /// The derivatives of the differentiated quantity (one number, such as a state at the end or an integral) with
    /// respect to the directions.
    pub gradient: Vec<f64>,
    /// Magnitude of the terms that add up to the derivative of the number in the direction computed along the run:
    /// the largest over all steps of the sum, over the states, of the term of the derivative of the state times the
    /// derivative of the number with respect to that state, in absolute values. The gradient is known to the rounding
    /// of these terms, however much of them cancels.
    pub terms: f64,
}

impl Swept {
    /// Records the terms of the derivatives of the states in one step, with the derivatives of the differentiated
    /// quantity with respect to these states.
    pub fn note<'a>(&mut self, terms: &[f64], rows: impl IntoIterator<Item = &'a DVector<f64>>) {
        let of_row = |row: &DVector<f64>| row.iter().zip(terms).map(|(slope, term)| (slope * term).abs()).sum::<f64>();
        self.terms = self.terms.max(rows.into_iter().map(of_row).sum());
    }
}

/// Reason why a backward sweep of the adjoint over the steps of a run failed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum SweepError {
    /// The run has no derivative.
    #[error(transparent)]
    NoDerivative(#[from] NoDerivative),
    /// A step that was not stored could not be made a second time.
    #[error("a step that was made once failed the second time: {0}")]
    Step(#[from] StepError),
    /// Steps that were made a second time did not end where they did the first time.
    #[error("steps up to t = {t:?} that were made a second time are others than the first time")]
    NotRepeated {
        /// The time at which the steps of the segment ended the first time.
        t: f64,
    },
}

/// The adjoint of a run: the derivatives of one quantity with respect to many directions by a backward sweep.
pub struct Adjoint {
    /// Derivatives along a basis of the states, then along the directions.
    basis: Tangents,
    /// The derivatives of the states at the start of the run, one direction per column.
    initial: DMatrix<f64>,
    segments: Vec<Segment>,
    /// The number of bytes of the stored steps, and the largest number allowed.
    bytes: usize,
    most: usize,
    /// Counters of the work of backward sweeps.
    pub work: Work,
}

/// An accepted step of a run, stored for the backward sweep of the adjoint.
pub struct StoredStep {
    step: Step,
    tableau: &'static Tableau,
    /// Whether the polynomial of the derivatives is corrected by the slope at the beginning of the step.
    is_corrected: bool,
    /// Time at which the run left the step and began the next one.
    end: f64,
}

/// The derivative of an integral over a step as a linear function of the derivatives of the states at its beginning and
/// at its stages, of the slope that their polynomial lacks at the beginning, times the step size, and of the directions.
#[derive(Clone, Debug)]
pub struct IntegralWeights {
    /// Weights of the derivatives of the states at the beginning of the step.
    pub begin: DVector<f64>,
    /// Weights of the derivatives of the states at each stage.
    pub stages: Vec<DVector<f64>>,
    /// Weights of the slope that the polynomial of the derivatives lacks at the beginning of the step.
    pub slope: DVector<f64>,
    /// Derivatives of the integral over the step with respect to the directions themselves.
    pub directions: DVector<f64>,
    /// The integrals of the absolute values of the derivatives with respect to the states: a scale for weights of
    /// opposite signs that cancel.
    pub sizes: DVector<f64>,
}

impl Radau<'_> {
    /// Stores the last step, which the run left at time `end`; `is_corrected` tells whether the polynomial of the
    /// derivatives is corrected by the slope at the beginning of the step.
    pub fn store_step(&self, end: f64, is_corrected: bool) -> StoredStep {
        let mut step = self.last.clone();
        // Drop the slope at the end of the step that only the next step needs.
        step.end_slope = Vec::new();
        StoredStep { step, tableau: self.orders.last().tableau, is_corrected, end }
    }
}

impl StoredStep {
    /// Returns the stored step.
    pub fn step(&self) -> LastStep<'_> {
        let Step { t, h, y, z, .. } = &self.step;
        LastStep { t: *t, h: *h, y, z, tableau: self.tableau }
    }

    /// Returns the time at the beginning of the step, and the time at which the run left the step.
    pub fn ends(&self) -> (f64, f64) {
        (self.step.t, self.end)
    }

    /// Returns the number of bytes of memory that the stored step takes.
    pub fn bytes(&self) -> usize {
        let Step { y, z, slope, face, .. } = &self.step;
        let of_face = size_of_val(face.places.as_slice()) + size_of_val(face.blocks.as_slice());
        size_of::<Self>() + of_face + (y.len() + z.len() + slope.len()) * size_of::<f64>()
    }

    /// Writes the states at time `t` within the stored step to `x`.
    pub fn states_at(&mut self, t: f64, x: &mut [f64]) {
        let mut y = vec![0.0; self.step.y.len()];
        self.step.at(self.tableau, t, &mut y);
        x.copy_from_slice(&y[..x.len()]);
    }

    /// Writes the weights of the stages in the increment of the polynomial of the derivatives at time `t` to
    /// `stages`, and returns the weight of the slope that the polynomial lacks at the beginning, times the step size.
    pub fn weights_at(&self, t: f64, stages: &mut [f64]) -> f64 {
        let theta = (t - self.step.t) / self.step.h;
        self.tableau.increments_at(theta, stages);
        if self.is_corrected { self.tableau.bubble_at(theta) } else { 0.0 }
    }
}

impl Directions {
    /// Returns directions that are a basis of the initial values of `states` states, followed by the directions of
    /// `self`, which then leave the initial states unchanged.
    fn with_basis(self, states: usize) -> Self {
        let count = self.initial.ncols();
        let mut initial = DMatrix::zeros(states, states + count);
        initial.fill_with_identity();
        let Self { mut rows, mass, bounds, shifted, .. } = self;
        let mut own = DMatrix::zeros(0, 0);
        let rows: RowsBy = Box::new(move |t: f64, y: &[f64], out: &mut DMatrix<f64>| {
            if own.nrows() != out.nrows() {
                own = DMatrix::zeros(out.nrows(), count);
            }
            rows(t, y, &mut own);
            out.columns_mut(0, states).fill(0.0);
            out.columns_mut(states, count).copy_from(&own);
        });
        Self {
            initial,
            rows,
            mass: mass.into_iter().map(|(place, direction, value)| (place, states + direction, value)).collect(),
            bounds: bounds.into_iter().map(|(bound, direction, value)| (bound, states + direction, value)).collect(),
            shifted: (0..states).map(|_| None).chain(shifted).collect(),
        }
    }
}

impl Adjoint {
    /// Creates the adjoint at the start of a run of a problem. Stored steps take at most about `most` bytes.
    ///
    /// # Errors
    /// If the mass matrix is singular.
    pub fn new(problem: Box<dyn Dvi>, directions: Directions, most: usize) -> Result<Self, NoDerivative> {
        let states = problem.structure().states;
        let initial = directions.initial.clone();
        let mut basis = Tangents::new(problem, directions.with_basis(states))?;
        basis.is_basis = true;
        Ok(Self { basis, initial, segments: Vec::new(), bytes: 0, most, work: Work::default() })
    }

    /// Returns the number of bytes of memory of the steps stored for the backward sweep.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Prepares for the next step of a run, along which `tangents` are computed: begins a segment if the last one is
    /// full.
    pub fn prepare(&mut self, radau: &mut Radau<'_>, tangents: &Tangents) {
        if self.segments.last().is_some_and(|last| last.bytes < self.most / SEGMENTS) {
            return;
        }
        let begin = (radau.save(), tangents.point());
        self.segments.push(Segment { begin, end: radau.t(), records: Some(Vec::new()), bytes: 0 });
        let full = self.segments.len() - 1;
        for segment in &mut self.segments[..full] {
            if self.bytes <= self.most {
                break;
            }
            if segment.records.take().is_some() {
                self.bytes -= std::mem::take(&mut segment.bytes);
            }
        }
    }

    /// Stores the last accepted step of a run, over which `tangents` have been computed.
    ///
    /// # Errors
    /// Why there is no derivative from the end of this step on.
    pub fn store(&mut self, radau: &mut Radau<'_>, tangents: &Tangents) -> Result<(), NoDerivative> {
        let mut records = Vec::new();
        let bytes = self.record(radau, tangents, &mut records)?;
        if let Some(segment) = self.segments.last_mut() {
            segment.end = radau.t();
            segment.bytes += bytes;
            segment.records.get_or_insert_default().append(&mut records);
        }
        self.bytes += bytes;
        Ok(())
    }

    /// Appends the last accepted step of a run to `records` for the backward sweep, and returns the number of bytes
    /// that it takes.
    fn record(
        &mut self,
        radau: &mut Radau<'_>,
        tangents: &Tangents,
        records: &mut Vec<Record>,
    ) -> Result<usize, NoDerivative> {
        let step = radau.store_step(radau.t(), tangents.slopes[0].is_some());
        let terms = tangents.terms.as_ref().map_or(Vec::new(), |terms| terms.now.as_slice().to_vec());
        let mut bytes = size_of::<Record>() + step.bytes() + size_of_val(terms.as_slice());
        records.push(Record::Step { step: Box::new(step), terms });
        if radau.continues || radau.is_done() {
            return Ok(bytes);
        }
        let basis = &mut self.basis;
        basis.now.copy_from(&basis.directions.initial);
        let saltations = basis.saltations(radau)?;
        self.work.differences = basis.differences;
        for saltation in saltations {
            let numbers = saltation.jump.len() + saltation.times.len();
            bytes += size_of::<Record>() + numbers * size_of::<f64>();
            records.push(Record::Switch(saltation));
        }
        Ok(bytes)
    }

    /// Makes the steps of a segment, which were not stored, a second time, for the backward sweep.
    fn repeat(
        &mut self,
        Segment { begin: (saved, point), end, .. }: &Segment,
        radau: &mut Radau<'_>,
        tangents: &mut Tangents,
    ) -> Result<Vec<Record>, SweepError> {
        radau.restore(saved);
        tangents.restore(point);
        let mut records = Vec::new();
        while radau.t() < *end {
            tangents.advance(radau)??;
            self.record(radau, tangents, &mut records)?;
            self.work.repeated += 1;
        }
        if radau.t() == *end { Ok(records) } else { Err(SweepError::NotRepeated { t: *end }) }
    }

    /// Carries the derivatives of a number with respect to the states at the end of the run, and directly with
    /// respect to the directions, back to the start, and returns the gradient of the number. `integral` gives the
    /// weights of an integral over a step that the number contains; the last step comes first. The run, with
    /// `tangents` in one direction, ends where it was.
    ///
    /// # Errors
    /// Singular equations of a step, or steps that could not be made a second time.
    pub fn sweep(
        &mut self,
        (radau, tangents): (&mut Radau<'_>, &mut Tangents),
        (by_states, by_directions): (&[f64], &[f64]),
        mut integral: impl FnMut(&mut StoredStep) -> Option<IntegralWeights>,
    ) -> Result<Swept, SweepError> {
        let segments = std::mem::take(&mut self.segments);
        let end = segments.iter().any(|segment| segment.records.is_none()).then(|| radau.save());
        let mut costate = Costate {
            states: DVector::from_column_slice(by_states),
            slope: None,
            gradient: DVector::from_column_slice(by_directions),
        };
        let mut swept = Swept::default();
        for mut segment in segments.into_iter().rev() {
            let records = match segment.records.take() {
                Some(records) => records,
                None => self.repeat(&segment, radau, tangents)?,
            };
            // The derivatives of the differentiated quantity with respect to the states behind the switch that ends the
            // step.
            let mut behind: Option<DVector<f64>> = None;
            for record in records.into_iter().rev() {
                match record {
                    Record::Switch(saltation) => {
                        behind.get_or_insert_with(|| costate.states.clone());
                        costate.pass_switch(&saltation);
                    }
                    Record::Step { mut step, terms } => {
                        let weights = integral(&mut step);
                        let sizes = weights.as_ref().map(|weights| &weights.sizes);
                        swept.note(&terms, [&costate.states].into_iter().chain(&behind).chain(sizes));
                        behind = None;
                        self.step_back(&step, weights, &mut costate)?;
                    }
                }
            }
        }
        if let Some(end) = &end {
            radau.restore(end);
        }
        self.bytes = 0;
        costate.gradient += self.initial.tr_mul(&costate.states);
        swept.gradient = costate.gradient.as_slice().to_vec();
        Ok(swept)
    }

    /// Carries a costate (the derivatives of the differentiated quantity with respect to the states) backwards over one
    /// step.
    fn step_back(
        &mut self,
        stored: &StoredStep,
        weights: Option<IntegralWeights>,
        costate: &mut Costate,
    ) -> Result<(), NoDerivative> {
        let StoredStep { step, tableau, is_corrected, .. } = stored;
        let (n, unknowns, s) = (self.basis.mass.nrows(), step.y.len(), tableau.stages());
        let mut begin = DVector::zeros(n);
        let mut stages = vec![DVector::zeros(n); s];
        stages[s - 1] += &costate.states;
        // Adds to the row vectors of the stages, and of the beginning of the step, `row` times the derivative of the
        // increment of the polynomial; `of` are the weights of the stages in that increment.
        let mut add_increment = |of: &[f64], row: &DVector<f64>, begin: &mut DVector<f64>| {
            for (stage, weight) in stages.iter_mut().zip(of) {
                *stage += row * *weight;
                *begin -= row * *weight;
            }
        };
        if let Some(slope) = costate.slope.take() {
            add_increment(&tableau.end_weights(step.h), &slope, &mut begin);
        }
        let mut of_stages = Vec::new();
        if let Some(weights) = weights {
            begin += &weights.begin;
            costate.gradient += &weights.directions;
            of_stages = weights.stages;
            if *is_corrected {
                add_increment(&tableau.begin_weights(), &-&weights.slope, &mut begin);
                let slope = weights.slope * step.h;
                if n == unknowns {
                    self.add_slope(step, &slope, &mut begin, &mut costate.gradient)?;
                } else {
                    costate.slope = Some(slope);
                }
            }
        }
        let mut right = DVector::zeros(s * unknowns);
        for (i, stage) in stages.iter().enumerate() {
            right.rows_mut(i * unknowns, n).copy_from(stage);
        }
        for (i, stage) in of_stages.iter().enumerate() {
            let mut own = right.rows_mut(i * unknowns, n);
            own += stage;
        }
        let equations = self.basis.stage_equations(step, tableau)?;
        self.work.steps += 1;
        self.work.jacobians += s as u64;
        self.work.factorisations += 1;
        if !equations.matrix.transpose().lu().solve_mut(&mut right) || right.iter().any(|value| !value.is_finite()) {
            return Err(NoDerivative::Singular);
        }
        let count = self.initial.ncols();
        costate.gradient += equations.by_directions.columns(n, count).tr_mul(&right);
        let mut first = DVector::zeros(n);
        (0..s).for_each(|i| first += right.rows(i * unknowns, n));
        costate.states = begin + self.basis.mass.tr_mul(&first);
        Ok(())
    }

    /// Adds to the costate `row` times the slope (time derivative) of the derivatives of the states at the beginning of
    /// a step without variables.
    fn add_slope(
        &mut self,
        step: &Step,
        row: &DVector<f64>,
        begin: &mut DVector<f64>,
        gradient: &mut DVector<f64>,
    ) -> Result<(), NoDerivative> {
        let (rows, (rates, _)) = (self.basis.rows_at(step.t, &step.y), self.basis.rates(step.t, &step.y));
        self.work.jacobians += 1;
        let row = self.basis.mass.transpose().lu().solve(row).ok_or(NoDerivative::Singular)?;
        let n = row.len();
        *begin += rows.by_y.rows(0, n).tr_mul(&row);
        *gradient += rows.by_directions.view((0, n), (n, gradient.len())).tr_mul(&row);
        for &((i, j), direction, value) in &self.basis.directions.mass {
            gradient[direction - n] -= value * rates[j] * row[i];
        }
        Ok(())
    }
}

/// The costate: derivatives of the differentiated quantity with respect to the data that determine the rest of a run.
struct Costate {
    /// Derivatives of the differentiated quantity with respect to the states.
    states: DVector<f64>,
    /// Derivatives of the differentiated quantity with respect to the slope of the derivatives of the states at the end
    /// of the step before.
    slope: Option<DVector<f64>>,
    /// Derivatives of the differentiated quantity with respect to the directions.
    gradient: DVector<f64>,
}

impl Costate {
    fn pass_switch(&mut self, Saltation { jump, times }: &Saltation) {
        let jump: f64 = jump.iter().zip(self.states.iter()).map(|(jump, state)| jump * state).sum();
        let (by_states, by_directions) = times.split_at(self.states.len());
        self.states.iter_mut().zip(by_states).for_each(|(state, time)| *state += time * jump);
        self.gradient.iter_mut().zip(by_directions).for_each(|(slope, time)| *slope += time * jump);
    }
}
