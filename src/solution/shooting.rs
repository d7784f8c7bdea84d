//! Runs over one period with the derivatives of their end states: for a differential variational inequality by Radau
//! IIA, and for a motion with located impacts.

use super::contact::{ContactPlan, failure_of};
use super::integrate::failure;
use super::passages::{Passages, Passed};
use super::sensitivities::{By, directions, directions_of_motion};
use super::{Failure, Plan};
use contact::{Elapsed, EventDriven, ModeEvaluators, SmoothPhase, State, tangents};
use factorisation::Singular;
use hybrid::OneStep;
use models::{DviModel, MechanicalModel};
use nalgebra::{DMatrix, DVector};
use problem::Control;
use radau::{Radau, Settings, Switch, Tangents};

/// Singular values of `S - I`, where `S` is the monodromy matrix, below this fraction of the largest count as zero:
/// the square root of the accuracy of the entries of `S`, which is close to that of doubles. Singular values below
/// the relative tolerance, to which `S` approximates the derivative of the motion, also count as zero: a multiplier
/// so near to 1 is not distinguished from 1.
const RANK: f64 = 1e-8;

/// Time before the end of a period at which a start is projected onto the admissible set, as a fraction of the
/// period: far less than the duration of a switch, and far more than rounding errors of time.
const BEFORE_END: f64 = 1e-9;

/// The reason given for a missing monodromy matrix if the run was made without derivatives.
const NOT_ASKED: &str = "derivatives were not asked for";

/// A Newton correction of a periodic orbit: changes of the initial state and of the period.
pub(super) type Correction = (Vec<f64>, f64);

/// The result of a run over one period.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    pub from: Vec<f64>,
    pub period: f64,
    pub to: Vec<f64>,
    /// The rates of the states at the end of the run over one period.
    pub slope: Vec<f64>,
    /// The monodromy matrix: the derivative of the end state of the run with respect to its start, or the reason why it
    /// does not exist.
    pub monodromy: Result<DMatrix<f64>, String>,
    /// The derivative of the end state with respect to each requested parameter; meaningless if there is no monodromy
    /// matrix.
    pub by_parameters: DMatrix<f64>,
    /// The error tolerances of the states, absolute plus relative.
    pub scale: Vec<f64>,
    /// The switches and contact events of the run over one period.
    pub passages: Passages,
}

impl Shot {
    /// Returns the distance of the end of the run from its start, in units of the tolerances of the states.
    pub fn distance(&self) -> f64 {
        let parts = self.to.iter().zip(&self.from).zip(&self.scale);
        parts.map(|((to, from), scale)| (to - from).abs() / scale).fold(0.0, f64::max)
    }

    /// Returns the Newton correction of the initial state and of the period, and the number of singular vectors of the
    /// equations that it uses.
    pub fn correction(&self, phase: Option<usize>, rtol: f64, directions: usize) -> Option<(Correction, usize)> {
        self.correction_for(self, phase, rtol, directions)
    }

    /// Returns the Newton correction of another run, computed with the derivatives of this run. A direction in which
    /// a multiplier is 1 within the accuracy of the run is corrected only if it is one of the first `directions`, and
    /// its singular value exceeds rounding errors.
    pub fn correction_for(
        &self,
        other: &Self,
        phase: Option<usize>,
        rtol: f64,
        directions: usize,
    ) -> Option<(Correction, usize)> {
        let n = self.from.len();
        let (matrix, unit) = self.equations(phase, rtol)?;
        let right = DVector::from_fn(n, |i, _| (other.from[i] - other.to[i]) / self.scale[i]);
        let Singular { u: left, values, v_t: transposed } = Singular::of(&matrix)?;
        let largest = values.first().copied()?;
        let least = (RANK * largest).max(rtol);
        let rounding = n as f64 * f64::EPSILON * largest.max(1.0);
        let mut found: DVector<f64> = DVector::zeros(n);
        let mut used = 0;
        for (k, value) in values.iter().enumerate() {
            if *value > least || k < directions && *value > rounding {
                found += transposed.row(k).transpose() * (left.column(k).dot(&right) / *value);
                used += 1;
            }
        }
        let mut change: Vec<f64> = found.iter().zip(&unit).map(|(value, unit)| value * unit).collect();
        let of_period = phase.map_or(0.0, |phase| std::mem::take(&mut change[phase]));
        let is_finite = of_period.is_finite() && change.iter().all(|value| value.is_finite());
        is_finite.then_some(((change, of_period), used))
    }

    /// Returns the uncertainty of the start of an orbit in the direction to which the end of the run is least
    /// sensitive: the displacement of the start that changes the distance of the end from the start by one tolerance.
    pub fn uncertainty(&self, phase: Option<usize>, rtol: f64) -> Option<Vec<f64>> {
        let (matrix, unit) = self.equations(phase, rtol)?;
        let Singular { values, v_t: transposed, .. } = Singular::of(&matrix)?;
        let last = values.len().checked_sub(1)?;
        let gain = values[last].max(rtol).recip();
        let mut change: Vec<f64> =
            transposed.row(last).iter().zip(&unit).map(|(value, unit)| value * unit * gain).collect();
        if let Some(phase) = phase {
            change[phase] = 0.0;
        }
        Some(change)
    }

    /// Returns the matrix of Newton's method for a periodic orbit in units of the tolerances, and these units. The
    /// column of a free period replaces that of the state that fixes the phase.
    fn equations(&self, phase: Option<usize>, rtol: f64) -> Option<(DMatrix<f64>, Vec<f64>)> {
        let n = self.from.len();
        let mut matrix = self.monodromy.as_ref().ok()? - DMatrix::identity(n, n);
        let mut unit = self.scale.clone();
        if let Some(phase) = phase {
            matrix.set_column(phase, &DVector::from_column_slice(&self.slope));
            unit[phase] = rtol * self.period;
        }
        for (i, mut row) in matrix.row_iter_mut().enumerate() {
            row.iter_mut().zip(&unit).for_each(|(value, unit)| *value *= unit / self.scale[i]);
        }
        Some((matrix, unit))
    }

    /// Returns the size of a Newton correction of the orbit, in units of the tolerances of this run.
    pub fn size(&self, (change, of_period): &Correction, rtol: f64) -> f64 {
        let parts = change.iter().zip(&self.scale).map(|(change, scale)| change / scale);
        parts.chain([of_period / (rtol * self.period)]).fold(0.0, |most: f64, part| most.max(part.abs()))
    }

    /// Returns the size of the correction of another run, computed with the derivatives of this run, relative to the
    /// correction `own` of this run (the natural monotonicity test of Deuflhard 2011, *Newton Methods for Nonlinear
    /// Problems*, section 3.3.1). The ratio does not depend on the units of the residual, and accepts a run that
    /// enters another mode although its residual hardly decreases.
    pub fn contraction(&self, own: &Correction, other: &Self, phase: Option<usize>, rtol: f64) -> Option<f64> {
        let own = self.size(own, rtol);
        let (correction, _) = self.correction_for(other, phase, rtol, 0)?;
        (own > 0.0).then_some(self.size(&correction, rtol) / own)
    }

    /// Returns the Floquet multipliers, the eigenvalues of the monodromy matrix, by decreasing modulus.
    pub fn multipliers(&self) -> Vec<[f64; 2]> {
        let Ok(monodromy) = &self.monodromy else { return Vec::new() };
        let mut values: Vec<[f64; 2]> =
            monodromy.complex_eigenvalues().iter().map(|value| [value.re, value.im]).collect();
        values.sort_by(|a, b| modulus(b).total_cmp(&modulus(a)).then(b[1].total_cmp(&a[1])));
        values
    }
}

pub(super) fn modulus([re, im]: &[f64; 2]) -> f64 {
    re.hypot(*im)
}

/// The system whose periodic orbits are sought.
#[derive(Clone, Copy)]
pub(super) enum Subject<'a> {
    /// A differential variational inequality, with the settings of Radau IIA.
    Dvi(&'a DviModel, &'a Settings),
    /// A motion with located impacts, with its contact settings and those of Radau IIA.
    Motion(&'a MechanicalModel, &'a ContactPlan, &'a Settings),
}

impl<'a> Subject<'a> {
    /// Returns the settings of Radau IIA.
    pub fn settings(self) -> &'a Settings {
        match self {
            Self::Dvi(_, settings) | Self::Motion(_, _, settings) => settings,
        }
    }

    /// Returns the names of the states of the system.
    pub fn state_names(self) -> &'a [String] {
        match self {
            Self::Dvi(model, _) => &model.state_names,
            Self::Motion(model, ..) => &model.state_names,
        }
    }

    /// Makes a run over one period from a start, and differentiates the end state with respect to the start and to the
    /// parameters `parameters`.
    pub fn shoot(
        self,
        plan: &Plan,
        (from, period): (&[f64], f64),
        parameters: &[usize],
        control: &Control,
    ) -> Result<Shot, Failure> {
        let initial = (0..from.len()).map(By::Initial);
        let by: Vec<By> = initial.chain(parameters.iter().map(|&k| By::Parameter(k))).collect();
        match self {
            Self::Dvi(model, settings) => shoot_dvi((model, settings), plan, (from, period), &by, control),
            Self::Motion(model, contact, settings) => {
                shoot_motion((model, contact, settings), plan, (from, period), &by, control)
            }
        }
    }

    /// Makes a run over one period without derivatives; the result has no monodromy matrix.
    pub fn end(self, plan: &Plan, (from, period): (&[f64], f64), control: &Control) -> Result<Shot, Failure> {
        match self {
            Self::Dvi(model, settings) => shoot_dvi((model, settings), plan, (from, period), &[], control),
            Self::Motion(model, contact, settings) => {
                shoot_motion((model, contact, settings), plan, (from, period), &[], control)
            }
        }
    }

    /// Projects a start onto the admissible states: those to which impulses move the states at the start and, since a
    /// periodic orbit returns there, at the end of a period.
    pub fn allowed(self, plan: &Plan, (from, period): (&[f64], f64), control: &Control) -> Vec<f64> {
        let mut from = from.to_vec();
        let Self::Dvi(model, settings) = self else { return from };
        for t in [plan.start + (1.0 - BEFORE_END) * period, plan.start] {
            let mut problem = model.problem();
            let end = t + BEFORE_END * period;
            if let Ok(radau) = Radau::new(&mut *problem, settings.clone(), t, &from, end, control)
                && radau.jumped().is_some()
            {
                from = radau.y()[..from.len()].to_vec();
            }
        }
        from
    }
}

fn too_many(accepted: u64, time: f64, state: &[f64]) -> Failure {
    let message = format!("{accepted} steps were made within one period");
    Failure { code: "steps".into(), message, time, state: state.to_vec() }
}

fn shoot_dvi(
    (model, settings): (&DviModel, &Settings),
    plan: &Plan,
    (from, period): (&[f64], f64),
    by: &[By],
    control: &Control,
) -> Result<Shot, Failure> {
    let n = from.len();
    let failed = |error, t, x: &[f64]| failure(plan, &model.kinks, &error, t, x);
    let mut problem = model.problem();
    let end = plan.start + period;
    let mut radau = Radau::new(&mut *problem, settings.clone(), plan.start, from, end, control)
        .map_err(|error| failed(error, plan.start, from))?;
    let mut passages = Passages::default();
    // A change of the active face at the start of the run is not a switch.
    radau.take_switches();
    let mut tangents = if by.is_empty() {
        Err(NOT_ASKED.to_owned())
    } else {
        directions(model, by)
            .and_then(|directions| Tangents::new(model.problem(), directions).map_err(|why| why.to_string()))
    };
    while !radau.is_done() {
        if control.poll().is_some() || radau.counts.accepted >= plan.most_steps {
            return Err(too_many(radau.counts.accepted, radau.t(), &radau.y()[..n]));
        }
        let at = radau.t();
        let stepped = match &mut tangents {
            Ok(tangents) => tangents.advance(&mut radau),
            Err(_) => radau.step().map(Ok),
        };
        match stepped {
            Ok(Ok(())) => {}
            Ok(Err(why)) => tangents = Err(why.to_string()),
            Err(error) => return Err(failed(error, at, &radau.y()[..n])),
        }
        for Switch { t, variable, from, to } in radau.take_switches() {
            passages.push(Passed::Switch(variable, from, to), (t - plan.start) / period);
        }
    }
    let slopes = tangents.map(|tangents| {
        let mut matrix = DMatrix::zeros(n, by.len());
        let mut row = vec![0.0; by.len()];
        for state in 0..n {
            tangents.write(&radau, end, state, &mut row);
            matrix.row_mut(state).copy_from_slice(&row);
        }
        matrix
    });
    let scale = settings.tolerances(0, &radau.largest()[..n]);
    let (to, slope) = (radau.y()[..n].to_vec(), radau.slopes_at(end));
    Ok(shot((from, period), (to, slope), slopes, scale, passages))
}

fn shoot_motion(
    (model, contact, settings): (&MechanicalModel, &ContactPlan, &Settings),
    plan: &Plan,
    (from, period): (&[f64], f64),
    by: &[By],
    control: &Control,
) -> Result<Shot, Failure> {
    let n = from.len() / 2;
    let failed = |error: contact::ContactError, x: &[f64]| failure_of(model, error.ahead(plan.start), plan.start, x);
    let mut problem = Elapsed::new(model.problem(), plan.start);
    let state = State { t: 0.0, q: from[..n].to_vec(), v: from[n..].to_vec() };
    let run = EventDriven::new(&mut problem, &contact.settings, settings.clone(), state, period, control);
    let mut located = run.map_err(|error| failed(error, from))?;
    let system = || Box::new(Elapsed::new(model.problem(), plan.start));
    let mut evaluators = ModeEvaluators::new(|| system());
    let mut tangents = if by.is_empty() {
        Err(NOT_ASKED.to_owned())
    } else {
        directions_of_motion(model, by, plan.start).and_then(|directions| {
            tangents::Tangents::new(system(), directions, &mut located).map_err(|why| why.to_string())
        })
    };
    located.new_events.clear();
    let mut largest: Vec<f64> = from.iter().map(|x| x.abs()).collect();
    let mut passages = Passages::default();
    let mut slope = vec![0.0; 2 * n];
    while !located.is_done() {
        let mut phase = SmoothPhase::new(&mut located, &mut evaluators, control);
        if let Ok(tangents) = &mut tangents {
            tangents.begin(&mut phase);
        }
        while !phase.is_over() {
            let state = |phase: &SmoothPhase<'_, '_>| {
                let State { q, v, .. } = &phase.located.state;
                [q.as_slice(), v].concat()
            };
            if control.poll().is_some() || phase.located.accepted >= plan.most_steps {
                return Err(too_many(phase.located.accepted, plan.start + phase.located.state.t, &state(&phase)));
            }
            if let Err(error) = phase.advance() {
                return Err(failed(error, &state(&phase)));
            }
            let x = state(&phase);
            largest.iter_mut().zip(&x).for_each(|(largest, x)| *largest = largest.max(x.abs()));
            for event in phase.located.new_events.drain(..) {
                passages.push(Passed::Contact(event.contact, event.kind), event.t / period);
            }
            if let Ok(followed) = &mut tangents {
                match followed.follow(&mut phase) {
                    Ok(_) => slope = followed.rates(&x),
                    Err(why) => tangents = Err(why.to_string()),
                }
            }
        }
    }
    let State { q, v, .. } = &located.state;
    let to = [q.as_slice(), v].concat();
    let slopes = tangents.map(|tangents| tangents.at(period));
    let scale = settings.tolerances(0, &largest);
    Ok(shot((from, period), (to, slope), slopes, scale, passages))
}

fn shot(
    (from, period): (&[f64], f64),
    (to, slope): (Vec<f64>, Vec<f64>),
    slopes: Result<DMatrix<f64>, String>,
    scale: Vec<f64>,
    passages: Passages,
) -> Shot {
    let n = from.len();
    let by_parameters = slopes
        .as_ref()
        .map_or_else(|_| DMatrix::zeros(n, 0), |slopes| slopes.columns(n, slopes.ncols() - n).into_owned());
    let monodromy = slopes.map(|slopes| slopes.columns(0, n).into_owned());
    Shot { from: from.to_vec(), period, to, slope, monodromy, by_parameters, scale, passages }
}
