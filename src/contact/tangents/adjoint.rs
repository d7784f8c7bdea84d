//! The adjoint of the derivatives along an event-driven motion: the gradient of one number with respect to many
//! directions, by the transposed maps of arcs and transitions, backwards over the stored steps ([`radau::Adjoint`]).
//! The map of a transition, `S+ = A S + C` for the derivatives `S` of the states, is computed along a basis of the
//! states and the directions during the forward run.

use super::arc::{ArcEquations, weights_at};
use super::{Directions, Jumped, NoDerivative, Tangents, TermsBy};
use crate::locate::{EventDriven, ModeSetting, SmoothPhase};
use nalgebra::{DMatrix, DVector};
use problem::Mechanical;
use radau::{AdjointWork, IntegralWeights, StoredStep, Swept};
use std::rc::Rc;

/// Part of the record of an event-driven run that the backward sweep of the adjoint reads.
enum Record {
    Arc {
        step: Box<StoredStep>,
        mode: Rc<ModeSetting>,
        /// Absolute values of the terms of the derivatives in the one direction that is computed along the forward
        /// run, one per state.
        terms: Vec<f64>,
    },
    /// A transition at the end of an arc, with the map `(A, C)` of the derivatives across it, and the derivatives of
    /// the increment that an integral has at the transition.
    Passage { map: DMatrix<f64>, gained: Option<DVector<f64>> },
}

impl Record {
    fn terms_mut(&mut self) -> Option<&mut Vec<f64>> {
        if let Self::Arc { terms, .. } = self { Some(terms) } else { None }
    }
}

/// Returns the derivatives, one per direction, of the increment of an integral at a jump whose time depends on the
/// directions.
pub type IntegrandJump<'a> = &'a mut dyn FnMut(&Jumped) -> Option<DVector<f64>>;

/// The adjoint (backward sweep) of the derivatives of the states along an event-driven motion.
pub struct Adjoint {
    /// Derivatives along a basis of the states, followed by the directions.
    basis: Tangents,
    /// The derivatives of the initial states, one direction per column.
    initial: DMatrix<f64>,
    identity: DMatrix<f64>,
    mode: Rc<ModeSetting>,
    records: Vec<Record>,
    bytes: usize,
    /// Cost counters of the adjoint of the run.
    pub work: AdjointWork,
}

impl Directions {
    /// Returns the directions of differentiation along a basis of `q` and `v`, followed by these directions with zero
    /// derivatives of the initial states.
    fn with_basis(self) -> Self {
        let (states, count) = (self.initial.nrows(), self.count());
        let mut initial = DMatrix::zeros(states, states + count);
        initial.fill_with_identity();
        let Self { mut terms, mu, restitution, sizes, shifted, .. } = self;
        let mut own = DMatrix::zeros(0, 0);
        let terms: TermsBy = Box::new(move |t: f64, y: &[f64], out: &mut DMatrix<f64>| {
            if own.nrows() != out.nrows() {
                own = DMatrix::zeros(out.nrows(), count);
            }
            terms(t, y, &mut own);
            out.columns_mut(0, states).fill(0.0);
            out.columns_mut(states, count).copy_from(&own);
        });
        let behind = |own: DMatrix<f64>| own.insert_columns(0, states, 0.0);
        let shifted = (0..states).map(|_| None).chain(shifted).collect();
        let sizes = std::iter::repeat_n(0.0, states).chain(sizes).collect();
        Self { initial, terms, mu: behind(mu), restitution: behind(restitution), sizes, shifted }
    }
}

impl Adjoint {
    /// Begins the adjoint at the start of a run of `problem`, before the derivatives in one direction that are
    /// computed along the run.
    ///
    /// # Errors
    /// The reason why there is no derivative from the start on.
    pub fn new(
        problem: Box<dyn Mechanical>,
        directions: Directions,
        located: &mut EventDriven<'_>,
    ) -> Result<Self, NoDerivative> {
        let initial = directions.initial.clone();
        let directions = directions.with_basis();
        let identity = directions.initial.clone();
        let transition = located.transition.clone();
        let basis = Tangents::begin_along(problem, (directions, true), (located, transition.as_ref()))?;
        let mode = Rc::new(basis.equations.setting());
        let mut adjoint =
            Self { basis, initial, identity, mode, records: Vec::new(), bytes: 0, work: AdjointWork::default() };
        if transition.is_some() {
            adjoint.note_passage(None);
        }
        Ok(adjoint)
    }

    /// Returns the number of bytes of memory of the steps stored for the backward sweep.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Sets the contact mode of the derivatives to that of a smooth phase that begins.
    pub fn begin(&mut self, phase: &SmoothPhase<'_, '_>) {
        self.basis.adopt_mode(phase);
        self.mode = Rc::new(phase.watch.setting());
    }

    /// Stores the last step of a phase; `tangents` are the derivatives in one direction, already computed over that
    /// step.
    ///
    /// # Errors
    /// The reason why there is no derivative from the end of the step on.
    pub fn store(
        &mut self,
        phase: &mut SmoothPhase<'_, '_>,
        tangents: &Tangents,
        integrand_jump: IntegrandJump<'_>,
    ) -> Result<(), NoDerivative> {
        let Some(radau) = &phase.method else { return Err(NoDerivative::SteppedOver) };
        let located = &*phase.located;
        let (begin, end) = located.last_arc();
        if end > begin {
            let step = radau.store_step(end, true);
            let terms = tangents.terms.as_slice().to_vec();
            self.bytes += size_of::<Record>() + step.bytes() + size_of_val(terms.as_slice());
            self.records.push(Record::Arc { step: Box::new(step), mode: self.mode.clone(), terms });
            self.basis.instant = None;
            self.basis.now.copy_from(&self.identity);
        } else if let Some(last) = self.records.iter_mut().rev().find_map(Record::terms_mut) {
            // A further transition at the end of the last stored arc: record its terms with the arc. No step precedes
            // it.
            last.iter_mut().zip(tangents.terms.iter()).for_each(|(last, terms)| *last = last.max(*terms));
        }
        let jumped = self.basis.pass_end(phase)?;
        self.work.differences = self.basis.differences;
        self.basis.events.clear();
        if jumped.is_some() || self.basis.now != self.identity {
            self.note_passage(jumped.as_ref().and_then(integrand_jump));
        }
        Ok(())
    }

    /// Stores a transition between contact modes for the backward sweep; its map is already composed with that of an
    /// earlier transition at the same time.
    fn note_passage(&mut self, gained: Option<DVector<f64>>) {
        let before = match self.records.pop() {
            Some(Record::Passage { gained, .. }) => gained,
            Some(arc) => {
                self.records.push(arc);
                self.bytes += size_of::<Record>() + size_of_val(self.basis.now.as_slice());
                None
            }
            None => None,
        };
        let gained = match (before, gained) {
            (Some(before), Some(gained)) => Some(before + gained),
            (before, gained) => before.or(gained),
        };
        self.records.push(Record::Passage { map: self.basis.now.clone(), gained });
    }

    /// Sweeps the derivatives of a number from the end back to the start, and returns its gradient with respect to
    /// the directions. The number has the derivatives `by_states` with respect to the states at the end, and depends
    /// on the directions also directly, with derivatives `by_directions`. `integral` returns the weights over a step
    /// of an integral that the number contains; it is called for the last step first.
    ///
    /// # Errors
    /// Fails if the equations of a step are singular.
    pub fn sweep(
        &mut self,
        by_states: &[f64],
        by_directions: &[f64],
        mut integral: impl FnMut(&mut StoredStep) -> Option<IntegralWeights>,
    ) -> Result<Swept, NoDerivative> {
        let mut swept = Swept::default();
        // The adjoint states (derivatives of the differentiated quantity with respect to the states) behind the
        // transition at the end of an arc.
        let mut behind: Option<DVector<f64>> = None;
        let mut states = DVector::from_column_slice(by_states);
        let mut gradient = DVector::from_column_slice(by_directions);
        let (n, count) = (states.len(), gradient.len());
        while let Some(record) = self.records.pop() {
            match record {
                Record::Passage { map, gained } => {
                    behind.get_or_insert_with(|| states.clone());
                    gradient += map.columns(n, count).tr_mul(&states);
                    states = map.columns(0, n).tr_mul(&states);
                    if let Some(gained) = gained {
                        states += gained.rows(0, n);
                        gradient += gained.rows(n, count);
                    }
                }
                Record::Arc { mut step, mode, terms } => {
                    let weights = integral(&mut step);
                    let sizes = weights.as_ref().map(|weights| &weights.sizes);
                    swept.note(&terms, [&states].into_iter().chain(&behind).chain(sizes));
                    behind = None;
                    self.basis.equations.adopt((*mode).clone());
                    self.step_back(&step, weights, &mut states, &mut gradient)?;
                }
            }
        }
        self.bytes = 0;
        gradient += self.initial.tr_mul(&states);
        swept.gradient = gradient.as_slice().to_vec();
        Ok(swept)
    }

    /// Carries the row of derivatives of the differentiated quantity with respect to the states backwards over one
    /// step.
    fn step_back(
        &mut self,
        stored: &StoredStep,
        integral: Option<IntegralWeights>,
        states: &mut DVector<f64>,
        gradient: &mut DVector<f64>,
    ) -> Result<(), NoDerivative> {
        let step = stored.step();
        let (n, s, h, tableau) = (states.len(), step.tableau.stages(), step.h, step.tableau);
        let count = gradient.len();
        let (of_stages, of_slope) = weights_at(tableau, (stored.ends().1 - step.t) / h);
        let mut begin = &*states * (1.0 - of_stages.iter().sum::<f64>());
        let mut slope = &*states * of_slope.unwrap_or(0.0);
        let mut stages: Vec<DVector<f64>> = of_stages.iter().map(|weight| &*states * *weight).collect();
        if let Some(integral) = integral {
            begin += integral.begin;
            slope += integral.slope;
            stages.iter_mut().zip(integral.stages).for_each(|(stage, own)| *stage += own);
            *gradient += integral.directions;
        }
        let singular = NoDerivative::Smooth(radau::NoDerivative::Singular);
        let Tangents { equations, directions, .. } = &mut self.basis;
        let ArcEquations { matrix, by_directions, at_begin: (by_x, by_directions_at_begin), .. } =
            ArcEquations::new(step, equations, directions).ok_or(singular)?;
        self.work.steps += 1;
        self.work.jacobians += s as u64 + 1;
        self.work.factorisations += 1;
        for (stage, weight) in stages.iter_mut().zip(tableau.begin_weights()) {
            *stage -= &slope * weight;
            begin += &slope * weight;
        }
        begin += by_x.tr_mul(&slope) * h;
        *gradient += by_directions_at_begin.columns(n, count).tr_mul(&slope) * h;
        let mut right = DVector::zeros(s * n);
        for (i, stage) in stages.iter().enumerate() {
            right.rows_mut(i * n, n).copy_from(stage);
        }
        if !matrix.transpose().lu().solve_mut(&mut right) || right.iter().any(|value| !value.is_finite()) {
            return Err(singular);
        }
        *gradient += by_directions.columns(n, count).tr_mul(&right);
        (0..s).for_each(|i| begin += right.rows(i * n, n));
        *states = begin;
        Ok(())
    }
}
