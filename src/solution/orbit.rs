//! Periodic orbits, by shooting: the initial state `x_0` from which a run returns to itself after a period `T`,
//!
//! ```text
//! r(x_0, T) = x(T; x_0) - x_0 = 0,    (S - I) dx_0 + x'(T) dT = -r,    S = dx(T)/dx_0
//! ```
//!
//! by Newton's method with the monodromy matrix `S`, which is exact through switches ([`radau::Tangents`]; Aprille and
//! Trick 1972, *Steady-state analysis of nonlinear circuits with periodic inputs*, for smooth equations). `S` may be
//! singular, for example if a diode blocks or a body sticks; `S - I` is singular if orbits form families, of which the
//! nearest is chosen. With a free period, one state keeps its initial value. If a Newton step does not reduce the
//! residual, or there is no derivative, the run continues for another period, as the system itself would.

use super::integrate::{failure, integrate_once};
use super::run::{Ended, Plan, ending};
use super::statistics::OverTime;
use super::{CheckCode, Failure, Solution, Status};
use analysis::Analysis;
use models::DviModel;
use nalgebra::{DMatrix, DVector};
use problem::Control;
use radau::{Directions, NoDerivative, Radau, Settings, Tangents};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Instant;
use utoipa::ToSchema;

/// Most runs over one period. Newton's method takes a handful; a system left to itself approaches its orbit by the
/// modulus of its multiplier per period.
const MOST_SHOTS: u64 = 100;
/// Most halvings of a Newton step that does not reduce the residual: another period of the system itself, which also
/// reduces it, costs as much as one halving.
const HALVINGS: i32 = 1;
/// Least reduction of the residual relative to the fraction of the step taken (Deuflhard 2011, *Newton Methods for
/// Nonlinear Problems*, section 3.1).
const GAIN: f64 = 0.25;
/// Singular values of `S - I` below this fraction of the largest count as zero: the square root of the accuracy of its
/// entries, which is close to that of doubles.
const RANK: f64 = 1e-8;
/// An orbit with a free period and a length below this number of tolerances counts as a point: fewer than three of its
/// digits are known.
const SEEN: f64 = 1e3;
/// A multiplier within this distance of the unit circle counts as being on it, given the accuracy of the derivatives.
const ON_CIRCLE: f64 = 1e-6;
/// Number of times at which the rows of a problem are compared with those one period later. Their distances are not
/// simple fractions of the period, so that they meet edges of pulses by chance only.
const COMPARED: u32 = 16;
/// Relative tolerance for rows that count as equal: rounding of the time, amplified by their slopes.
const SAME: f64 = 1e-6;

/// The requested orbit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Periodic {
    /// The period, or an initial guess of a free one.
    pub period: f64,
    /// For a free period, the state that keeps its initial value.
    pub phase: Option<usize>,
}

/// A periodic orbit.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Orbit {
    /// The period of the orbit.
    pub period: f64,
    /// The states at the beginning of the orbit, by name.
    pub start: BTreeMap<String, f64>,
    /// The Floquet multipliers as `[re, im]`, by decreasing modulus: the eigenvalues of the derivative of the states
    /// after one period with respect to those before. Empty if the derivative does not exist.
    pub multipliers: Vec<[f64; 2]>,
    /// Whether the orbit is asymptotically stable: all multipliers are inside the unit circle, except the one of a free
    /// phase. Absent if that is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stable: Option<bool>,
    /// Number of runs over one period.
    pub shots: u64,
    /// Distance of its end from its beginning, in units of `atol + rtol |x|`.
    pub residual: f64,
    /// Mean, root mean square, minimum and maximum over the period of each field other than integrals.
    pub over_period: BTreeMap<String, OverTime>,
}

/// A run over one period.
struct Shot {
    from: Vec<f64>,
    period: f64,
    to: Vec<f64>,
    /// The rates at the end.
    slope: Vec<f64>,
    /// The derivative of the end with respect to the beginning, or the reason why it does not exist.
    monodromy: Result<DMatrix<f64>, NoDerivative>,
    /// The tolerances of the states.
    scale: Vec<f64>,
}

impl Shot {
    /// The distance of the end from the beginning, in units of the tolerances.
    fn distance(&self) -> f64 {
        let parts = self.to.iter().zip(&self.from).zip(&self.scale);
        parts.map(|((to, from), scale)| (to - from).abs() / scale).fold(0.0, f64::max)
    }

    /// The Newton correction of the initial state and of the period.
    fn correction(&self, phase: Option<usize>, rtol: f64) -> Option<(Vec<f64>, f64)> {
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
        let right = DVector::from_fn(n, |i, _| (self.from[i] - self.to[i]) / self.scale[i]);
        let svd = matrix.try_svd(true, true, f64::EPSILON, 0)?;
        let rank = RANK * svd.singular_values.max();
        let found = svd.solve(&right, rank).ok()?;
        let mut change: Vec<f64> = found.iter().zip(&unit).map(|(value, unit)| value * unit).collect();
        let of_period = phase.map_or(0.0, |phase| std::mem::take(&mut change[phase]));
        (of_period.is_finite() && change.iter().all(|value| value.is_finite())).then_some((change, of_period))
    }

    /// The multipliers, by decreasing modulus.
    fn multipliers(&self) -> Vec<[f64; 2]> {
        let Ok(monodromy) = &self.monodromy else { return Vec::new() };
        let mut values: Vec<[f64; 2]> =
            monodromy.complex_eigenvalues().iter().map(|value| [value.re, value.im]).collect();
        values.sort_by(|a, b| modulus(b).total_cmp(&modulus(a)).then(b[1].total_cmp(&a[1])));
        values
    }
}

fn modulus([re, im]: &[f64; 2]) -> f64 {
    re.hypot(*im)
}

/// A search in progress.
struct Search<'a> {
    model: &'a DviModel,
    plan: &'a Plan,
    settings: &'a Settings,
    control: &'a Control,
    phase: Option<usize>,
    shots: u64,
}

/// Finds an orbit, and runs along it once.
pub fn find_orbit(
    model: &DviModel,
    plan: &Plan,
    asked: Periodic,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let began = Instant::now();
    let mut search = Search { model, plan, settings, control, phase: asked.phase, shots: 0 };
    let found = search.check_forcing(asked.period).and_then(|()| search.find(asked.period));
    let reached = found.as_ref().map_or_else(|missed| missed.0.as_ref(), Some);
    let (start, period) =
        reached.map_or_else(|| (plan.initial.clone(), asked.period), |shot| (shot.from.clone(), shot.period));
    // Output times were requested for the expected period; scale them to the actual one.
    let at = |t: &f64| plan.start + (t - plan.start) * (period / asked.period);
    let along = Plan {
        initial: start.clone(),
        end: plan.start + period,
        times: plan.times.as_ref().map(|times| times.iter().map(at).collect()),
        statistics: true,
        ..plan.clone()
    };
    let Ended { mut solution, x, statistics, .. } = integrate_once(model, &along, settings, analysis, control);
    let (shots, diagnostics) = (search.shots, &mut solution.diagnostics);
    diagnostics.wall_seconds = began.elapsed().as_secs_f64();
    let shot = match found {
        Ok(shot) if solution.status == Status::Completed => shot,
        Ok(_) => return solution,
        Err(missed) => {
            let (_, failure) = *missed;
            let (status, failure) = ending(control, failure);
            (solution.status, solution.error) = (status, Some(failure));
            return solution;
        }
    };
    let distances = x.iter().zip(&start).zip(&shot.scale).map(|((to, from), scale)| (to - from).abs() / scale);
    let residual = distances.fold(0.0, f64::max);
    // Tolerance-sized errors of the steps may add up to this number of tolerances.
    let allowed = diagnostics.steps.accepted.max(1) as f64;
    diagnostics.checks.record(CheckCode::ReturnResidual, residual, allowed, || {
        format!("the end of the orbit differs from its beginning by {residual:.1e} times the tolerance")
    });
    let multipliers = shot.multipliers();
    if let Err(why) = &shot.monodromy {
        let message =
            format!("the orbit has no derivative with respect to its initial values, and so no multipliers: {why}");
        diagnostics.checks.caveat("no_multipliers", message);
    }
    let names = model.state_names.iter().cloned();
    solution.orbit = Some(Orbit {
        period,
        start: names.zip(start).collect(),
        stable: is_stable(&multipliers, asked.phase.is_some()),
        multipliers,
        shots,
        residual,
        over_period: statistics,
    });
    solution
}

/// Whether all multipliers are inside the unit circle, except the one nearest to 1 if the phase is free; `None` if one
/// is on the circle, or none are known.
fn is_stable(multipliers: &[[f64; 2]], is_free: bool) -> Option<bool> {
    let off_one = |[re, im]: &[f64; 2]| (re - 1.0).hypot(*im);
    let nearest = (0..multipliers.len()).min_by(|a, b| off_one(&multipliers[*a]).total_cmp(&off_one(&multipliers[*b])));
    let left_out = nearest.filter(|_| is_free);
    nearest?;
    let others = (0..multipliers.len()).filter(|k| Some(*k) != left_out).map(|k| modulus(&multipliers[k]));
    let largest = others.fold(0.0, f64::max);
    ((largest - 1.0).abs() > ON_CIRCLE).then_some(largest < 1.0)
}

/// The best run, if there was one, and the reason why it is not an orbit.
type Missed = Box<(Option<Shot>, Failure)>;

impl Search<'_> {
    fn find(&mut self, period: f64) -> Result<Shot, Missed> {
        let initial = self.plan.initial.clone();
        let mut shot = self.shoot(&initial, period).map_err(|failure| Box::new((None, failure)))?;
        loop {
            let distance = shot.distance();
            if distance <= 1.0 {
                return self.moves(shot);
            }
            if self.shots >= MOST_SHOTS {
                let message = format!(
                    "no orbit of period {} was found in {MOST_SHOTS} runs: the end of the last differs by \
                     {distance:.1e} times the tolerance from its beginning; choose initial values nearer to the orbit, \
                     such as those after a transient",
                    shot.period
                );
                let failure = self.failure("no_orbit", message);
                return Err(Box::new((Some(shot), failure)));
            }
            let better = match shot.correction(self.phase, self.settings.rtol) {
                Some(correction) => self.damped(&shot, &correction),
                None => Ok(None),
            };
            let next = better.and_then(|better| match better {
                Some(better) => Ok(better),
                None => self.shoot(&shot.to, shot.period),
            });
            shot = match next {
                Ok(next) => next,
                Err(failure) => return Err(Box::new((Some(shot), failure))),
            };
        }
    }

    /// The next run by Newton's method, with the largest fraction of its step that reduces the residual; `None` if no
    /// fraction does.
    fn damped(&mut self, shot: &Shot, (change, of_period): &(Vec<f64>, f64)) -> Result<Option<Shot>, Failure> {
        for halving in 0..=HALVINGS {
            let part = 0.5_f64.powi(halving);
            let period = shot.period + part * of_period;
            if period <= 0.0 || self.shots >= MOST_SHOTS {
                continue;
            }
            let from: Vec<f64> = shot.from.iter().zip(change).map(|(x, change)| x + part * change).collect();
            match self.shoot(&from, period) {
                Ok(next) if next.distance() <= (1.0 - GAIN * part) * shot.distance() => return Ok(Some(next)),
                Err(failure) if self.control.poll().is_some() => return Err(failure),
                Ok(_) | Err(_) => {}
            }
        }
        Ok(None)
    }

    /// Refuses an orbit with a free period that is a single point.
    fn moves(&self, shot: Shot) -> Result<Shot, Missed> {
        let moved = shot.slope.iter().zip(&shot.scale).map(|(slope, scale)| (slope * shot.period).abs() / scale);
        if self.phase.is_none() || moved.fold(0.0, f64::max) > SEEN {
            return Ok(shot);
        }
        let message =
            "the search converged to a steady state, which has every period; choose initial values nearer to the orbit"
                .to_owned();
        let failure = self.failure("no_orbit", message);
        Err(Box::new((Some(shot), failure)))
    }

    /// Refuses a period after which the problem itself does not repeat, and a free period of a problem that depends on
    /// time.
    fn check_forcing(&self, period: f64) -> Result<(), Missed> {
        let mut problem = self.model.problem();
        let structure = problem.structure();
        let mut y = self.plan.initial.clone();
        y.resize(structure.unknowns(), 0.0);
        let (n, rows) = (structure.states, structure.rows());
        let mut at = |t: f64| {
            let mut values = vec![0.0; rows];
            problem.evaluate(t, &y, &mut values);
            (t, values)
        };
        let pairs: Vec<_> = (0..COMPARED)
            .map(|k| {
                let part = (f64::from(k) * 0.618_033_988_749_894_8).fract();
                let t = self.plan.start + part * period;
                let after = if self.phase.is_some() { t + part * period } else { t + period };
                [at(t), at(after)]
            })
            .collect();
        for row in 0..rows {
            let largest = pairs.iter().flatten().fold(0.0_f64, |most, (_, values)| most.max(values[row].abs()));
            let differs =
                |[(_, now), (_, later)]: &&[(f64, Vec<f64>); 2]| (now[row] - later[row]).abs() > SAME * largest;
            let Some([(t, now), (_, later)]) = pairs.iter().find(differs) else { continue };
            let name = self.plan.names.get(row).map_or("a bound", String::as_str);
            let what = if row < n { "the rate of" } else { "the inequality or bound of" };
            let message = match self.phase {
                Some(_) => format!(
                    "{what} `{name}` depends on time, so that the period is not free: give the period of the forcing \
                     as a number"
                ),
                None => format!(
                    "{what} `{name}` at t = {t:?} is {}, and a period later {}: it does not repeat after {period:?}",
                    now[row], later[row]
                ),
            };
            return Err(Box::new((None, self.failure("not_periodic", message))));
        }
        Ok(())
    }

    fn failure(&self, code: &'static str, message: String) -> Failure {
        Failure { code: code.into(), message, time: self.plan.start, state: self.plan.initial.clone() }
    }

    fn shoot(&mut self, from: &[f64], period: f64) -> Result<Shot, Failure> {
        self.shots += 1;
        let (n, plan) = (from.len(), self.plan);
        let failed = |error, t, x: &[f64]| failure(plan, &self.model.kinks, &error, t, x);
        let mut problem = self.model.problem();
        let end = plan.start + period;
        let mut radau = Radau::new(&mut *problem, self.settings.clone(), plan.start, from, end, self.control)
            .map_err(|error| failed(error, plan.start, from))?;
        let directions = Directions {
            initial: DMatrix::identity(n, n),
            rows: Box::new(|_, _, out| out.fill(0.0)),
            mass: Vec::new(),
            bounds: Vec::new(),
            shifted: (0..n).map(|_| None).collect(),
        };
        let mut tangents = Tangents::new(self.model.problem(), directions);
        while !radau.is_done() {
            if self.control.poll().is_some() || radau.counts.accepted >= plan.most_steps {
                let message = format!("{} steps were made within one period", radau.counts.accepted);
                return Err(Failure { code: "steps".into(), message, time: radau.t(), state: radau.y()[..n].to_vec() });
            }
            let at = radau.t();
            if let Err(error) = radau.step() {
                return Err(failed(error, at, &radau.y()[..n]));
            }
            if let Ok(followed) = &mut tangents
                && let Err(why) = followed.follow(&mut radau)
            {
                tangents = Err(why);
            }
        }
        let monodromy = tangents.map(|tangents| {
            let mut matrix = DMatrix::zeros(n, n);
            let mut row = vec![0.0; n];
            for state in 0..n {
                tangents.write(&radau, end, state, &mut row);
                matrix.row_mut(state).iter_mut().zip(&row).for_each(|(out, value)| *out = *value);
            }
            matrix
        });
        let scale = self.settings.tolerances(0, &radau.largest()[..n]);
        let (to, slope) = (radau.y()[..n].to_vec(), radau.slopes_at(end));
        Ok(Shot { from: from.to_vec(), period, to, slope, monodromy, scale })
    }
}
