//! Periodic orbits, by shooting: the initial state `x_0` from which a run returns to itself after a period `T`,
//!
//! ```text
//! r(x_0, T) = x(T; x_0) - x_0 = 0,    (S - I) dx_0 + x'(T) dT = -r,    S = dx(T)/dx_0
//! ```
//!
//! by Newton's method with the monodromy matrix `S`, which is exact through switches ([`radau::Tangents`]; Aprille and
//! Trick 1972, *Steady-state analysis of nonlinear circuits with periodic inputs*, for smooth equations). `S` may be
//! singular, for example if a diode blocks or a body sticks; `S - I` is singular if orbits form families, of which the
//! nearest is chosen. With a free period, one state keeps its initial value. If a Newton step reduces neither the
//! residual nor its own correction, or there is no derivative, the run continues for another period, as the system itself would.

use super::contact::{ContactPlan, integrate_contact_once};
use super::integrate::integrate_once;
use super::multipliers;
use super::run::{Ended, Plan, ending};
use super::shooting::{Correction, Shot, Subject, modulus};
use super::statistics::OverTime;
use super::{CheckCode, Failure, Solution, Status};
use analysis::Analysis;
use models::{DviModel, MechanicalModel};
use nalgebra::DMatrix;
use problem::{Constraints, Control};
use radau::Settings;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Instant;
use utoipa::ToSchema;

/// Largest number of runs over one period in the search for an orbit. Newton's method needs a few; repeated periods of
/// the system itself approach a stable orbit by the modulus of its largest multiplier per period.
const MOST_SHOTS: u64 = 100;
/// Largest number of halvings of a Newton step that does not reduce the distance of the end of the run from its start:
/// another period of the system itself, which also reduces this distance, costs as much as one halving.
const HALVINGS: i32 = 1;
/// Least reduction of the residual, or of Newton's correction, relative to the fraction of the step taken (Deuflhard 2011,
/// *Newton Methods for Nonlinear Problems*, sections 3.1 and 3.3).
const GAIN: f64 = 0.25;
/// Largest relative change of a free period in one Newton step: derivatives with respect to the period are not valid
/// beyond it.
const MOST_OF_PERIOD: f64 = 0.5;
/// Largest number of runs until the state that fixes the phase returns to its initial value.
const RETURNS: usize = 8;
/// Distance in units of the tolerances, of which at least three digits are known: an orbit with a free period counts
/// as a point if no state would move further than this at its final rate over the period, and an orbit is uncertain
/// if the error of its start exceeds this distance.
const SEEN: f64 = 1e3;
/// Distance from the unit circle below which a Floquet multiplier counts as being on it, given the accuracy of the
/// derivatives.
const ON_CIRCLE: f64 = 1e-6;
/// Relative change of the derivatives over a step of Newton's method beyond which a nearby solution is not
/// guaranteed: the bound of Kantorovich's theorem, which is attained at a double root.
pub(super) const CHANGED: f64 = 0.5;
/// Largest number of states that a message about an orbit lists.
const TOLD: usize = 3;
/// Number of times in a period at which the right-hand sides of a problem are compared with those one period later.
/// These times, and their distances, are not simple fractions of the period, so that they meet edges of pulses by
/// chance only; they exclude the beginning of the period, where pulses often have an edge.
const COMPARED: u32 = 16;
/// Number of periods whose right-hand sides are compared with those of the next period: a function that repeats once
/// may still change later, for example by a pulse.
const PERIODS: u32 = 64;
/// Relative tolerance for right-hand sides that count as equal: rounding errors of the time, amplified by their
/// slopes.
const SAME: f64 = 1e-6;

/// The requested periodic orbit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Periodic {
    /// The period, or the initial guess of a free period.
    pub period: f64,
    /// If the period is free, the index of the state that keeps its initial value and so fixes the phase.
    pub phase: Option<usize>,
}

/// A periodic orbit and its stability.
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
    /// Number of runs over one period in the search.
    pub shots: u64,
    /// Distance of the end of the orbit from its beginning, in units of `atol + rtol |x|`.
    pub residual: f64,
    /// Mean, root mean square, minimum and maximum over the period of each field other than integrals.
    pub over_period: BTreeMap<String, OverTime>,
}

/// The search for a periodic orbit, with the number of its runs.
struct Search<'a> {
    subject: Subject<'a>,
    plan: &'a Plan,
    control: &'a Control,
    phase: Option<usize>,
    shots: u64,
}

/// Finds a periodic orbit of a differential variational inequality, and integrates once along it.
pub fn find_orbit(
    model: &DviModel,
    plan: &Plan,
    asked: Periodic,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let along = |plan: &Plan| integrate_once(model, plan, settings, analysis, control);
    find(Subject::Dvi(model, settings), plan, asked, along, control)
}

/// Finds a periodic orbit of a motion with located impacts, and integrates once along it.
pub fn find_orbit_of_motion(
    model: &MechanicalModel,
    plan: &Plan,
    asked: Periodic,
    (contact, settings): (&ContactPlan, &Settings),
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let along = |plan: &Plan| integrate_contact_once(model, plan, contact, analysis, control);
    find(Subject::Motion(model, contact, settings), plan, asked, along, control)
}

fn find(
    subject: Subject<'_>,
    plan: &Plan,
    asked: Periodic,
    along: impl Fn(&Plan) -> Ended,
    control: &Control,
) -> Solution {
    let began = Instant::now();
    let found = search_from_start(subject, plan, asked, control);
    let mut solution = run_along(subject, plan, asked, found, along, control);
    solution.diagnostics.wall_seconds = began.elapsed().as_secs_f64();
    solution
}

/// Searches for a periodic orbit from the initial values; returns the result and the number of runs over one period.
pub(super) fn search_from_start(
    subject: Subject<'_>,
    plan: &Plan,
    asked: Periodic,
    control: &Control,
) -> (Result<Shot, Missed>, u64) {
    let mut search = Search { subject, plan, control, phase: asked.phase, shots: 0 };
    let checked = check_forcing(subject, plan, asked.period, asked.phase.is_some());
    let found = checked.map_err(|failure| Box::new((None, failure))).and_then(|()| search.find(asked.period));
    (found, search.shots)
}

/// Integrates once along a periodic orbit, or from the state in which a failed search ended.
pub(super) fn run_along(
    subject: Subject<'_>,
    plan: &Plan,
    asked: Periodic,
    (found, shots): (Result<Shot, Missed>, u64),
    along: impl Fn(&Plan) -> Ended,
    control: &Control,
) -> Solution {
    let reached = found.as_ref().map_or_else(|missed| missed.0.as_ref(), Some);
    let (start, period) =
        reached.map_or_else(|| (plan.initial.clone(), asked.period), |shot| (shot.from.clone(), shot.period));
    // Output times are requested for the expected period, and are scaled to the actual period.
    let at = |t: &f64| plan.start + (t - plan.start) * (period / asked.period);
    let once = Plan {
        initial: start.clone(),
        end: plan.start + period,
        times: plan.times.as_ref().map(|times| times.iter().map(at).collect()),
        statistics: true,
        ..plan.clone()
    };
    let Ended { mut solution, x, statistics, .. } = along(&once);
    let diagnostics = &mut solution.diagnostics;
    let shot = match found {
        Ok(shot) if solution.status == Status::Completed => shot,
        Ok(_) => return solution,
        Err(missed) => {
            let (_, failure) = *missed;
            let (status, failure) = ending(control, failure);
            (solution.status, solution.error) = (status, Some(failure));
            // The run begins where the search ended, and is not an orbit.
            solution.collected = plan.reducers.as_ref().map_or_else(Vec::new, |reducers| reducers.nothing());
            return solution;
        }
    };
    let distances = x.iter().zip(&start).zip(&shot.scale).map(|((to, from), scale)| (to - from).abs() / scale);
    let residual = distances.fold(0.0, f64::max);
    // The permitted distance, in units of the tolerances, is the number of steps, whose errors add up: each is of the
    // size of the tolerance.
    let allowed = diagnostics.steps.accepted.max(1) as f64;
    diagnostics.checks.record(CheckCode::ReturnResidual, residual, allowed, || {
        format!("the end of the orbit differs from its beginning by {residual:.1e} times the tolerance")
    });
    if let Some(message) = uncertain_start(subject, &shot, asked.phase) {
        diagnostics.checks.caveat("orbit_uncertain", message);
    }
    let multipliers = multipliers::find(subject, plan, &shot, true, control, &mut diagnostics.checks);
    if let Err(why) = &shot.monodromy {
        let message =
            format!("the orbit has no derivative with respect to its initial values, and so no multipliers: {why}");
        diagnostics.checks.caveat("no_multipliers", message);
    }
    let mut stable = is_stable(&multipliers, asked.phase.is_some());
    if stable.is_some() && !is_decided(subject, plan, &shot, asked.phase, control) {
        stable = None;
        let message = "the multiplier that decides stability is nearer to the unit circle than it is known: the orbit is \
                       known to the tolerance only, within which this distance may change by half of itself or more; \
                       tighten `rtol`, or run from either side of the orbit";
        diagnostics.checks.caveat("stability_undecided", message.to_owned());
    }
    let names = subject.state_names().iter().cloned();
    solution.orbit = Some(Orbit {
        period,
        start: names.zip(start).collect(),
        stable,
        multipliers,
        shots,
        residual,
        over_period: statistics,
    });
    solution
}

/// Returns a message if the start of an orbit is uncertain: runs from all points of a neighbourhood return to their own
/// start within the tolerance.
fn uncertain_start(subject: Subject<'_>, shot: &Shot, phase: Option<usize>) -> Option<String> {
    let error = shot.uncertainty(phase, subject.settings().rtol)?;
    let parts = error.iter().zip(&shot.scale).map(|(error, scale)| error.abs() / scale);
    let (state, part) = parts.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    (part > SEEN).then(|| {
        format!(
            "runs return to their start, within the tolerance, from a distance of {:.1e} in `{}` around this orbit: one of its \
             multipliers is that near to 1, so that orbits form a family, or their place is known no better; or there is none, \
             and the states drift by less than the tolerance a period",
            error[state].abs(),
            subject.state_names()[state]
        )
    })
}

/// Whether the largest multiplier, if it is near the unit circle, keeps half of its distance from the circle when the
/// start is moved by its own error: near a fold of orbits the distance and the error both vanish with the square root
/// of the tolerance.
fn is_decided(subject: Subject<'_>, plan: &Plan, shot: &Shot, phase: Option<usize>, control: &Control) -> bool {
    let rtol = subject.settings().rtol;
    let distance = |shot: &Shot| largest_modulus(&shot.multipliers(), phase.is_some()).unwrap_or(0.0) - 1.0;
    let here = distance(shot);
    if here.abs() > rtol.sqrt() {
        return true;
    }
    // Multipliers are only as accurate as the relative tolerance of the runs: a largest modulus within it of 1 counts
    // as 1.
    if here.abs() <= rtol {
        return false;
    }
    let Some(error) = shot.uncertainty(phase, rtol) else { return true };
    [1.0, -1.0].into_iter().all(|sign| {
        let from: Vec<f64> = shot.from.iter().zip(&error).map(|(x, error)| x + sign * error).collect();
        let from = subject.allowed(plan, (&from, shot.period), control);
        let beside = subject.shoot(plan, (&from, shot.period), &[], control);
        beside.is_ok_and(|beside| beside.monodromy.is_ok() && (distance(&beside) - here).abs() < CHANGED * here.abs())
    })
}

/// Whether all Floquet multipliers are inside the unit circle, except the one nearest to 1 if the phase is free; `None`
/// if a multiplier is on the circle, or no multipliers are known.
pub(super) fn is_stable(multipliers: &[[f64; 2]], is_free: bool) -> Option<bool> {
    let largest = largest_modulus(multipliers, is_free)?;
    ((largest - 1.0).abs() > ON_CIRCLE).then_some(largest < 1.0)
}

/// Returns the largest modulus of the Floquet multipliers, except the one nearest to 1 if the phase is free; `None`
/// without multipliers.
fn largest_modulus(multipliers: &[[f64; 2]], is_free: bool) -> Option<f64> {
    let off_one = |[re, im]: &[f64; 2]| (re - 1.0).hypot(*im);
    let nearest =
        (0..multipliers.len()).min_by(|a, b| off_one(&multipliers[*a]).total_cmp(&off_one(&multipliers[*b])))?;
    let others = (0..multipliers.len()).filter(|k| !is_free || *k != nearest).map(|k| modulus(&multipliers[k]));
    Some(others.fold(0.0, f64::max))
}

/// The best run of a failed search for an orbit, if there was one, and the reason why it is not an orbit.
pub(super) type Missed = Box<(Option<Shot>, Failure)>;

/// Rejects a period after which the right-hand sides of the problem do not repeat, and a free period of a problem that
/// depends on time.
pub(super) fn check_forcing(subject: Subject<'_>, plan: &Plan, period: f64, is_free: bool) -> Result<(), Failure> {
    let mut rows_at = rows_at(subject, plan);
    let mut largest: Vec<f64> = Vec::new();
    for number in 0..if is_free { 1 } else { PERIODS } {
        let pairs: Vec<_> = (1..=COMPARED)
            .map(|k| {
                let part = (f64::from(k) * 0.618_033_988_749_894_8).fract();
                let t = plan.start + (f64::from(number) + part) * period;
                let after = if is_free { t + part * period } else { t + period };
                [(t, rows_at(t)), (after, rows_at(after))]
            })
            .collect();
        for (_, values) in pairs.iter().flatten() {
            largest.resize(values.len(), 0.0);
            largest.iter_mut().zip(values).for_each(|(largest, value)| *largest = largest.max(value.abs()));
        }
        let differs = |row: usize, [(_, now), (_, later)]: &[(f64, Vec<f64>); 2]| {
            (now[row] - later[row]).abs() > SAME * largest[row]
        };
        let found = (0..largest.len()).find_map(|row| Some((row, pairs.iter().find(|pair| differs(row, pair))?)));
        let Some((row, [(t, now), (_, later)])) = found else { continue };
        let what = match subject {
            Subject::Dvi(model, _) if row < model.structure().states => format!("the rate of `{}`", plan.names[row]),
            Subject::Dvi(..) => {
                format!("the inequality or bound of `{}`", plan.names.get(row).map_or("a bound", String::as_str))
            }
            Subject::Motion(..) => "a force, the mass matrix or a constraint".to_owned(),
        };
        let message = if is_free {
            format!(
                "{what} depends on time, so that the period is not free: give the period of the forcing as a number"
            )
        } else {
            format!(
                "{what} at t = {t:?} is {}, and a period later {}: it does not repeat after {period:?}",
                now[row], later[row]
            )
        };
        let (time, state) = (plan.start, plan.initial.clone());
        return Err(Failure { code: "not_periodic".into(), message, time, state });
    }
    Ok(())
}

/// Returns the right-hand sides of a problem at the initial state, as a function of time.
fn rows_at<'a>(subject: Subject<'a>, plan: &'a Plan) -> Box<dyn FnMut(f64) -> Vec<f64> + 'a> {
    match subject {
        Subject::Dvi(model, _) => {
            let mut problem = model.problem();
            let mut y = plan.initial.clone();
            y.resize(problem.structure().unknowns(), 0.0);
            let rows = problem.structure().rows();
            Box::new(move |t| {
                let mut values = vec![0.0; rows];
                problem.evaluate(t, &y, &mut values);
                values
            })
        }
        Subject::Motion(model, ..) => {
            let mut problem = model.problem();
            let structure = problem.structure().clone();
            let n = structure.coordinates;
            let (mut mass, mut constraints) = (DMatrix::zeros(n, n), Constraints::new(&structure));
            Box::new(move |t| {
                let (q, v) = plan.initial.split_at(n);
                let mut forces = vec![0.0; n];
                problem.mass(t, q, &mut mass);
                problem.forces(t, q, v, &mut forces);
                problem.constraints(t, q, &mut constraints);
                let Constraints { values, drift, transposed } = &constraints;
                forces.iter().chain(mass.iter()).chain(values).chain(drift).chain(transposed.iter()).copied().collect()
            })
        }
    }
}

impl Search<'_> {
    fn find(&mut self, period: f64) -> Result<Shot, Missed> {
        let initial = self.plan.initial.clone();
        let rtol = self.subject.settings().rtol;
        let mut shot = self.shoot(&initial, period).map_err(|failure| Box::new((None, failure)))?;
        // The largest number of directions (singular vectors) in which a Newton step has moved the start of the run.
        let mut directions = 0;
        loop {
            let distance = shot.distance();
            if distance <= 1.0 {
                return self.confirm(shot, directions);
            }
            let correction = shot.correction(self.phase, rtol, 0);
            if self.shots >= MOST_SHOTS {
                let is_singular = correction.as_ref().is_some_and(|(_, used)| *used < shot.from.len());
                let because = if is_singular {
                    "; a multiplier is 1 within the accuracy of the runs, so that there may be no orbit, as of a drive in \
                     resonance"
                } else {
                    ""
                };
                let message = format!(
                    "no orbit of period {} was found in {MOST_SHOTS} runs: the end of the last differs by \
                     {distance:.1e} times the tolerance from its beginning{because}; choose initial values nearer to the \
                     orbit, such as those after a transient",
                    shot.period
                );
                let failure = self.failure("no_orbit", message);
                return Err(Box::new((Some(shot), failure)));
            }
            let better = match correction {
                Some((correction, used)) => {
                    let better = self.damped(&shot, &correction);
                    if matches!(better, Ok(Some(_))) {
                        directions = directions.max(used);
                    }
                    better
                }
                None => Ok(None),
            };
            let next = better.and_then(|better| match better {
                Some(better) => Ok(better),
                None => self.returned(&shot),
            });
            shot = match next {
                Ok(next) => next,
                Err(failure) => return Err(Box::new((Some(shot), failure))),
            };
        }
    }

    /// Takes Newton steps from a run that returns to its start within the tolerance, until the steps are within the
    /// tolerance too. A run that returns need not be near an orbit: a slow drift also returns, relative to a large
    /// state or as it decays. With such a drift the derivatives change along each step by as much as the step itself.
    /// If the derivatives do not change so much, and steps no longer become shorter, the orbit is as accurate as the
    /// runs permit. Directions in which the search has moved the start remain corrected.
    fn confirm(&mut self, mut shot: Shot, directions: usize) -> Result<Shot, Missed> {
        let rtol = self.subject.settings().rtol;
        loop {
            let Some((correction, _)) = shot.correction(self.phase, rtol, directions) else { return self.moves(shot) };
            let moved = shot.size(&correction, rtol);
            if moved <= 1.0 {
                return self.moves(shot);
            }
            let period = shot.period + correction.1;
            if period <= 0.0 || self.shots >= MOST_SHOTS {
                return self.drifts(shot, moved);
            }
            let from: Vec<f64> = shot.from.iter().zip(&correction.0).map(|(x, change)| x + change).collect();
            let from = self.subject.allowed(self.plan, (&from, period), self.control);
            let next = match self.shoot(&from, period) {
                Ok(next) => next,
                Err(failure) if self.control.poll().is_some() => return Err(Box::new((Some(shot), failure))),
                Err(_) => return self.drifts(shot, moved),
            };
            let own = next.correction(self.phase, rtol, directions);
            let same = shot.correction_for(&next, self.phase, rtol, directions);
            let (Some((own, _)), Some((same, _))) = (own, same) else { return self.moves(shot) };
            let now = shot.size(&own, rtol);
            if now > (1.0 - GAIN) * moved {
                let apart = own.0.iter().zip(&same.0).map(|(own, same)| own - same).collect();
                if shot.size(&(apart, own.1 - same.1), rtol) > CHANGED * now {
                    return self.drifts(shot, moved);
                }
                let better = if next.distance() < shot.distance() { next } else { shot };
                return self.moves(better);
            }
            shot = next;
        }
    }

    /// Returns the failure of a search for an orbit whose run returns to its start within the tolerance, but is not
    /// near an orbit.
    fn drifts(&self, shot: Shot, moved: f64) -> Result<Shot, Missed> {
        let shot = self.moves(shot)?;
        let names = self.subject.state_names().iter().zip(&shot.from).take(TOLD);
        let at: Vec<String> = names.map(|(name, x)| format!("`{name}` = {x:.3e}")).collect();
        let message = format!(
            "no orbit was found: at {} a run over a period returns to within the tolerance, but Newton's method would move its \
             start by {moved:.1e} times the tolerance and does not converge: the states drift slowly, and there may be no \
             orbit; choose other initial values, tighten `rtol`, or follow an orbit from other parameters with `continue`",
            at.join(", ")
        );
        let failure = self.failure("no_orbit", message);
        Err(Box::new((Some(shot), failure)))
    }

    /// Makes the next run over one period by Newton's method, with the largest fraction of the Newton step that reduces
    /// the residual; returns `None` if no fraction does.
    fn damped(&mut self, shot: &Shot, correction: &Correction) -> Result<Option<Shot>, Failure> {
        let (change, of_period) = correction;
        let whole = (MOST_OF_PERIOD * shot.period / of_period.abs()).min(1.0);
        for halving in 0..=HALVINGS {
            let part = whole * 0.5_f64.powi(halving);
            let period = shot.period + part * of_period;
            if period <= 0.0 || self.shots >= MOST_SHOTS {
                continue;
            }
            let from: Vec<f64> = shot.from.iter().zip(change).map(|(x, change)| x + part * change).collect();
            let from = self.subject.allowed(self.plan, (&from, period), self.control);
            match self.shoot(&from, period) {
                Ok(next) if self.falls((shot, correction), &next, 1.0 - GAIN * part) => return Ok(Some(next)),
                Err(failure) if self.control.poll().is_some() => return Err(failure),
                Ok(_) | Err(_) => {}
            }
        }
        Ok(None)
    }

    /// Makes a run over one period from the end of another run; with a free period, from where the state that fixes the
    /// phase has its initial value again.
    fn returned(&mut self, shot: &Shot) -> Result<Shot, Failure> {
        let Some(phase) = self.phase else { return self.shoot(&shot.to, shot.period) };
        let (mut run, anchor) = (shot.clone(), shot.from[phase]);
        for _ in 0..RETURNS {
            let later = (anchor - run.to[phase]) / run.slope[phase];
            if (anchor - run.to[phase]).abs() <= run.scale[phase] {
                let mut from = run.to.clone();
                from[phase] = anchor;
                return self.shoot(&from, run.period);
            }
            let is_near = later.abs() <= MOST_OF_PERIOD * run.period;
            if !is_near || self.shots >= MOST_SHOTS {
                break;
            }
            self.shots += 1;
            run = self.subject.end(self.plan, (&shot.from, run.period + later), self.control)?;
        }
        self.shoot(&shot.to, shot.period)
    }

    /// Whether a run over one period is nearer to the orbit than the previous run, by its residual or by the size of
    /// its Newton correction.
    fn falls(&self, (shot, correction): (&Shot, &Correction), next: &Shot, to: f64) -> bool {
        let by_correction = || shot.contraction(correction, next, self.phase, self.subject.settings().rtol);
        next.distance() <= to * shot.distance() || by_correction().is_some_and(|part| part <= to)
    }

    /// Rejects a result of the search for an orbit with a free period that is a single point: a steady state.
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

    fn failure(&self, code: &'static str, message: String) -> Failure {
        Failure { code: code.into(), message, time: self.plan.start, state: self.plan.initial.clone() }
    }

    fn shoot(&mut self, from: &[f64], period: f64) -> Result<Shot, Failure> {
        self.shots += 1;
        self.subject.shoot(self.plan, (from, period), &[], self.control)
    }
}
