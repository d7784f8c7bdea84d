//! Steady states, `0 in F(x, z) + N_K(z)` with `F` zero for the states, by implicit Euler steps of growing size. As
//! the step size tends to infinity, a step becomes a Josephy-Newton step for this inclusion (Kelley and Keyes 1998,
//! *Convergence analysis of pseudo-transient continuation*). The first steps resolve the dynamics, and while the
//! rates grow, steps stay shorter than the time constant of this growth, so that the search leads to the steady state
//! that the system itself would approach. If the system approaches none, steps of any size are made, which may find
//! an unstable steady state.
//!
//! Eigenvalues `lambda` of the equations on the active face, `lambda diag(M, 0) v = Phi_y v`, follow from those of
//! `(sigma diag(M, 0) - Phi_y)^-1 diag(M, 0)`, which are `1/(sigma - lambda)`: infinite eigenvalues become zero, for
//! any index.

use super::integrate::{failure, integrate_once};
use super::orbit::CHANGED;
use super::run::{Ended, Plan, ending};
use super::{CheckCode, Failure, Solution, Status};
use analysis::Analysis;
use factorisation::Singular;
use hybrid::OneStep;
use models::DviModel;
use nalgebra::{DMatrix, DVector};
use problem::{Control, Face, Side};
use radau::{ActiveFace, Activity, Directions, Radau, Settings, StageChoice, Switches, Tangents};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Instant;
use utoipa::ToSchema;

/// Factors by which the step size of the search for a steady state grows after a successful step and shrinks after a
/// failed one.
const GROWTH: f64 = 8.0;
const SHRINKS: f64 = 0.125;
/// Largest step size of the search for a steady state while rates grow, relative to the time in which they grow by the
/// factor e: longer implicit steps lead back to the state that the solution leaves.
const OF_GROWTH: f64 = 0.5;
/// Duration of a run that leaves an unstable steady state, in units of the time in which its distance from that state
/// grows by the factor e: long enough to grow from rounding errors to the size of the states.
const OF_DEPARTURE: f64 = 40.0;
/// Largest number of steps of a run that leaves an unstable steady state.
const MOST_FOLLOWED: u64 = 10_000;
/// A step size of the search larger than the first one by this factor counts as infinite: the difference of the step
/// from a Newton step is of the order of the inverse factor, which is the order of rounding errors.
const INFINITE: f64 = 1e16;
/// Largest number of steps of the search for a steady state: those that take the step size from the first to the last,
/// and as many again for nonlinearity.
const MOST_STEPS: u64 = 400;
/// Eigenvalues of the shifted and inverted pencil of the linearised equations below this fraction of the largest belong
/// to infinite eigenvalues of the pencil. The square root of the rounding error is needed since each hidden constraint
/// makes such eigenvalues double.
const INFINITE_EIGENVALUE: f64 = 1e-7;
/// Factors of the shift of the pencil of the linearised equations, relative to the rates of the states. They avoid
/// simple numbers, which are often eigenvalues of small problems.
const SHIFTS: [f64; 3] = [1.272_019_649_514, 1.839_286_755_214, 2.506_628_274_631];
/// Relative tolerance below which the real part of an eigenvalue counts as zero: the accuracy of eigenvalues of an
/// unsymmetric matrix.
const ON_AXIS: f64 = 1e-9;
/// Times at which the right-hand sides of a problem are compared to detect a dependence on time, in units of the
/// first step size.
const COMPARED: [f64; 4] = [1.0, 3.7, 1e2, 1e5];
/// Relative difference at two times below which right-hand sides count as equal.
const SAME: f64 = 1e-9;

/// A steady state and its stability.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct SteadyState {
    /// The states at the steady state, by name.
    pub states: BTreeMap<String, f64>,
    /// The variables at the steady state, by name.
    pub variables: BTreeMap<String, f64>,
    /// The eigenvalues of the linearised equations as `[re, im]`, with the variables at a bound fixed there, by
    /// decreasing real part. Empty if variables are on the boundary of a ball, a cone, a simplex or a polyhedron.
    pub eigenvalues: Vec<[f64; 2]>,
    /// Whether the steady state is asymptotically stable: all real parts of the eigenvalues are negative. Absent if a
    /// real part is zero, or no eigenvalues are known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stable: Option<bool>,
    /// The change of the states in the last Newton step, in units of `atol + rtol |x|`.
    pub residual: f64,
}

/// The steady state that a search has found, with its active face.
pub(super) struct Rest {
    pub x: Vec<f64>,
    pub z: Vec<f64>,
    pub face: ActiveFace,
    pub residual: f64,
}

/// Returns the steady state that the search reaches from the initial values of the plan.
pub(super) fn rest_of(model: &DviModel, plan: &Plan, settings: &Settings, control: &Control) -> Result<Rest, Failure> {
    let search = Search { model, plan, settings, control };
    let found = match search.find(true) {
        Err(_) if control.poll().is_none() => search.find(false)?,
        found => found?,
    };
    Ok(search.stable_instead(&found).unwrap_or(found))
}

/// Returns the largest modulus of the eigenvalues of a steady state.
fn fastest(eigenvalues: &[[f64; 2]]) -> f64 {
    eigenvalues.iter().map(|[re, im]| re.hypot(*im)).fold(0.0, f64::max)
}

/// Whether the real parts of all eigenvalues of a steady state are negative; `None` if the largest is zero, or no
/// eigenvalues are given. Eigenvalues are in the order of decreasing real part.
pub(super) fn is_stable(eigenvalues: &[[f64; 2]]) -> Option<bool> {
    let fastest = fastest(eigenvalues);
    let largest = eigenvalues.first().map(|[re, _]| *re);
    largest.filter(|re| re.abs() > ON_AXIS * fastest).map(|re| re < 0.0)
}

/// Whether an eigenvalue of a steady state is zero, within the accuracy of the eigenvalues.
pub(super) fn has_zero(eigenvalues: &[[f64; 2]]) -> bool {
    let fastest = fastest(eigenvalues);
    eigenvalues.iter().any(|[re, im]| re.hypot(*im) <= ON_AXIS * fastest)
}

/// Finds a steady state near the initial values, and integrates from it for a short time.
pub fn find_steady_state(
    model: &DviModel,
    plan: &Plan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let began = Instant::now();
    let found = rest_of(model, plan, settings, control);
    let (start, eigenvalues) = match &found {
        Ok(rest) => (rest.x.clone(), eigenvalues(model, plan.start, rest)),
        Err(_) => (plan.initial.clone(), Ok(Vec::new())),
    };
    let fastest = eigenvalues.as_ref().map_or(0.0, |values| fastest(values));
    let span = plan.end - plan.start;
    // The run is so short that the solution does not leave an unstable steady state.
    let end = plan.start + if fastest > 0.0 { span.min(fastest.recip()) } else { span };
    let along = Plan { initial: start.clone(), end, times: Some(vec![plan.start, end]), ..plan.clone() };
    let Ended { mut solution, x, .. } = integrate_once(model, &along, settings, analysis, control);
    let diagnostics = &mut solution.diagnostics;
    diagnostics.wall_seconds = began.elapsed().as_secs_f64();
    let rest = match found {
        Ok(rest) if solution.status == Status::Completed => rest,
        Ok(_) => return solution,
        Err(failure) => {
            let (status, failure) = ending(control, failure);
            (solution.status, solution.error) = (status, Some(failure));
            return solution;
        }
    };
    let scale = settings.tolerances(0, &start);
    let moved = x.iter().zip(&start).zip(&scale).map(|((to, from), scale)| (to - from).abs() / scale);
    let moved = moved.fold(0.0, f64::max);
    // The permitted distance, in units of the tolerances, is the number of steps, whose errors add up: each is of the
    // size of the tolerance.
    let allowed = diagnostics.steps.accepted.max(1) as f64;
    diagnostics.checks.record(CheckCode::ReturnResidual, moved, allowed, || {
        format!("a run from the steady state departs from it by {moved:.1e} times the tolerance until t = {end:?}")
    });
    if let Err(why) = &eigenvalues {
        diagnostics
            .checks
            .caveat("no_eigenvalues", format!("the eigenvalues at the steady state could not be computed: {why}"));
    }
    let eigenvalues = eigenvalues.unwrap_or_default();
    let units = tolerances(settings, &rest);
    let weakest = weakest(model, plan.start, &rest, &units);
    let mut stable = is_stable(&eigenvalues);
    if stable.is_some()
        && let Some(why) = undecided(model, plan.start, (&rest, &units), weakest.as_ref(), &eigenvalues)
    {
        stable = None;
        diagnostics.checks.caveat("stability_undecided", why);
    }
    if let Some(why) = weakest.and_then(|weakest| weakest.doubt(&plan.names, &units)) {
        diagnostics.checks.caveat("steady_state_uncertain", why);
    }
    let named = |names: &[String], values: Vec<f64>| names.iter().cloned().zip(values).collect();
    solution.steady_state = Some(SteadyState {
        states: named(&model.state_names, rest.x),
        variables: named(&model.variable_names, rest.z),
        eigenvalues,
        stable,
        residual: rest.residual,
    });
    solution
}

/// Returns the eigenvalues of the linearised equations at a steady state, by decreasing real part.
pub(super) fn eigenvalues(model: &DviModel, t: f64, rest: &Rest) -> Result<Vec<[f64; 2]>, String> {
    let n = rest.x.len();
    let [mass, by_y] = linearised(model, t, rest)?;
    let rates = by_y.rows(0, n);
    // A shift of the order of the rates of the states preserves the digits of their eigenvalues.
    let size = rates.columns(0, n).amax() / mass.amax();
    let size = if size > 0.0 { size } else { 1.0 };
    // At least one of the shifts is not an eigenvalue, unless the pencil is singular.
    let solved = SHIFTS.iter().find_map(|part| {
        let shift = part * size;
        let ratio = (&mass * shift - &by_y).lu().solve(&mass)?;
        ratio.iter().all(|value| value.is_finite()).then_some((shift, ratio))
    });
    let Some((shift, ratio)) = solved else { return Err("its equations are singular".to_owned()) };
    // Algebraic variables would only add zero eigenvalues of the shifted and inverted pencil.
    let ratio = ratio.view((0, 0), (n, n)).into_owned();
    let values = ratio.complex_eigenvalues();
    let largest = values.iter().map(|value| value.norm()).fold(0.0, f64::max);
    let finite = values.iter().filter(|value| value.norm() > INFINITE_EIGENVALUE * largest);
    let mut found: Vec<[f64; 2]> = finite
        .map(|value| {
            let inverse = value.inv();
            [shift - inverse.re, -inverse.im]
        })
        .collect();
    found.sort_by(|a, b| b[0].total_cmp(&a[0]).then(b[1].total_cmp(&a[1])));
    Ok(found)
}

/// Returns the mass matrix and the Jacobian of the equations on the active face at a steady state.
fn linearised(model: &DviModel, t: f64, rest: &Rest) -> Result<[DMatrix<f64>; 2], String> {
    if rest.face.blocks.iter().any(|block| *block != Face::Interior) {
        return Err("variables are on the boundary of a ball, a cone, a simplex or a polyhedron".to_owned());
    }
    let directions = Directions {
        initial: DMatrix::zeros(rest.x.len(), 0),
        rows: Box::new(|_, _, _| {}),
        mass: Vec::new(),
        bounds: Vec::new(),
        shifted: Vec::new(),
    };
    let mut tangents = Tangents::new(model.problem(), directions).map_err(|why| why.to_string())?;
    let y = [rest.x.as_slice(), &rest.z].concat();
    tangents.linearised(&rest.face, t, &y).map_err(|why| why.to_string())
}

/// Returns the tolerances of states and variables; variables have no absolute tolerance of their own and take the
/// largest one.
fn tolerances(settings: &Settings, rest: &Rest) -> Vec<f64> {
    let absolute = settings.atol.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let mut found = settings.tolerances(0, &rest.x);
    found.extend(rest.z.iter().map(|z| absolute + settings.rtol * z.abs()));
    found
}

/// Returns the reason why the eigenvalues, by decreasing real part, do not decide the stability of a steady state;
/// `None` if they do.
fn undecided(
    model: &DviModel,
    t: f64,
    (rest, units): (&Rest, &[f64]),
    weakest: Option<&Weakest>,
    eigenvalues: &[[f64; 2]],
) -> Option<String> {
    if let Some(k) = on_border(model, t, rest, units) {
        let name = model.variable_names.get(k).map_or("a variable", String::as_str);
        return Some(format!(
            "`{name}` and its inequality are both on their border at the steady state, so that the eigenvalues hold to one \
             side of it only and do not decide stability: run from either side of it"
        ));
    }
    let (re, error) = (eigenvalues.first()?[0], weakest?.uncertainty(units)?);
    let n = rest.x.len();
    let is_open = [1.0, -1.0].into_iter().any(|sign| {
        let moved = |values: &[f64], errors: &[f64]| -> Vec<f64> {
            values.iter().zip(errors).map(|(value, error)| value + sign * error).collect()
        };
        let (x, z) = (moved(&rest.x, &error[..n]), moved(&rest.z, &error[n..]));
        let beside = Rest { x, z, face: rest.face.clone(), residual: rest.residual };
        let there = self::eigenvalues(model, t, &beside).ok().and_then(|values| Some(values.first()?[0]));
        there.is_none_or(|there| (there - re).abs() >= CHANGED * re.abs())
    });
    is_open.then(|| {
        format!(
            "the eigenvalue that decides stability, with the real part {re:.1e}, changes by half of itself or more within \
             the error of the steady state: it may be zero, as where two steady states meet; run from either side of it, or \
             tighten `rtol` and `atol`"
        )
    })
}

/// Returns a variable that is at a bound while its inequality is also zero: a nearby solution may be on either side
/// of the switch.
fn on_border(model: &DviModel, t: f64, rest: &Rest, units: &[f64]) -> Option<usize> {
    let mut problem = model.problem();
    let structure = problem.structure().clone();
    let (n, unknowns, rows) = (structure.states, structure.unknowns(), structure.rows());
    let mut y = [rest.x.as_slice(), &rest.z].concat();
    let mut at = |y: &[f64]| {
        let mut values = vec![0.0; rows];
        problem.evaluate(t, y, &mut values);
        values
    };
    let here = at(&y);
    // The error of each right-hand side that follows from the tolerances of the unknowns: the sum of its changes as
    // one unknown after the other changes by its tolerance.
    let mut errors = vec![0.0; rows];
    for (j, unit) in units.iter().enumerate() {
        let kept = y[j];
        y[j] = kept + unit;
        errors.iter_mut().zip(&at(&y)).zip(&here).for_each(|((error, there), here)| *error += (there - here).abs());
        y[j] = kept;
    }
    // Returns the value of a bound of a variable, and its error.
    let bound = |k: usize, side: Side| {
        let moving = structure.moving.iter().position(|moving| moving.variable == k && moving.side == side);
        let fixed = if side == Side::Lower { structure.set.lower[k] } else { structure.set.upper[k] };
        moving.map_or((fixed, 0.0), |p| (here[unknowns + p], errors[unknowns + p]))
    };
    (0..structure.variables).find(|&k| match rest.face.places[k] {
        Activity::AtLower | Activity::AtUpper => {
            // A variable with equal bounds cannot leave them.
            let ((lower, _), (upper, _)) = (bound(k, Side::Lower), bound(k, Side::Upper));
            lower < upper && here[n + k].abs() <= errors[n + k]
        }
        Activity::Inactive => [Side::Lower, Side::Upper].into_iter().any(|side| {
            let (value, error) = bound(k, side);
            (rest.z[k] - value).abs() <= units[n + k] + error
        }),
        _ => false,
    })
}

/// The direction in the space of states and variables in which the equations determine a steady state least: the
/// singular vector of the smallest singular value.
struct Weakest {
    /// The singular vector of the smallest singular value, of length 1, in units of the tolerances.
    direction: Vec<f64>,
    /// The Newton correction of the steady state in the least determined direction, in units of the tolerances; `None`
    /// if the equations are singular in this direction.
    corrected: Option<f64>,
}

impl Weakest {
    /// Returns the uncertainty of the states and variables of the steady state in the least determined direction: the
    /// Newton correction plus the tolerance.
    fn uncertainty(&self, units: &[f64]) -> Option<Vec<f64>> {
        let largest = self.direction.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let size = self.corrected.unwrap_or(0.0) + largest.recip();
        let found: Vec<f64> = self.direction.iter().zip(units).map(|(value, unit)| value * unit * size).collect();
        found.iter().all(|value| value.is_finite()).then_some(found)
    }

    /// Returns the reason why the steady state is uncertain, if it is.
    fn doubt(&self, names: &[String], units: &[f64]) -> Option<String> {
        let parts = self.direction.iter().enumerate();
        let (most, part) = parts.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
        let name = names.get(most)?;
        match self.corrected {
            None => Some(format!(
                "the equations do not determine the steady state in one direction, mainly that of `{name}`: others lie \
                 beside it, and initial values decide which is reached, or the rates vanish by rounding alone, and there \
                 is none"
            )),
            Some(corrected) => {
                let off = corrected * part.abs();
                (off > 1.0).then(|| {
                    format!(
                        "the steady state is known to {:.1e} only in `{name}`, which is {off:.1e} times the tolerance: its \
                         equations are nearly singular there, as where two steady states meet",
                        off * units[most]
                    )
                })
            }
        }
    }
}

/// Computes the direction in which the equations determine a steady state least.
fn weakest(model: &DviModel, t: f64, rest: &Rest, units: &[f64]) -> Option<Weakest> {
    let [_, mut matrix] = linearised(model, t, rest).ok()?;
    let (n, count) = (rest.x.len(), units.len());
    let mut problem = model.problem();
    let mut values = vec![0.0; problem.structure().rows()];
    problem.evaluate(t, &[rest.x.as_slice(), &rest.z].concat(), &mut values);
    // On the active face the equations of the variables hold exactly.
    let mut right = DVector::from_fn(count, |i, _| if i < n { -values[i] } else { 0.0 });
    for i in 0..count {
        let mut row = matrix.row_mut(i);
        row.iter_mut().zip(units).for_each(|(value, unit)| *value *= unit);
        let largest = row.amax();
        if largest > 0.0 {
            row /= largest;
            right[i] /= largest;
        }
    }
    let Singular { u: left, values, v_t: transposed } = Singular::of(&matrix)?;
    let last = values.len().checked_sub(1)?;
    let weakest = values[last];
    let is_singular = weakest <= f64::EPSILON * count as f64 * values[0];
    let corrected = (!is_singular).then(|| (left.column(last).dot(&right) / weakest).abs());
    Some(Weakest { direction: transposed.row(last).iter().copied().collect(), corrected })
}

/// The search for a steady state.
struct Search<'a> {
    model: &'a DviModel,
    plan: &'a Plan,
    settings: &'a Settings,
    control: &'a Control,
}

impl Search<'_> {
    /// Finds a steady state. If `follows` is set, steps of the search stay shorter than the time in which rates grow,
    /// so that the search follows the solution.
    fn find(&self, follows: bool) -> Result<Rest, Failure> {
        let n = self.plan.initial.len();
        let mut x = self.plan.initial.clone();
        let first = self.first_step()?;
        self.check_time(first)?;
        let (mut h, mut made, mut is_reached, mut speed) = (first, 0, false, 0.0);
        while made < MOST_STEPS {
            made += 1;
            if self.control.poll().is_some() {
                break;
            }
            let settings = Settings {
                stages: StageChoice::Fixed(1),
                step: Some(h),
                first_step: Some(first),
                switches: Switches::StepOver,
                interpolated: false,
                ..self.settings.clone()
            };
            let mut problem = self.model.problem();
            let end = self.plan.start + h;
            let run = Radau::new(&mut *problem, settings, self.plan.start, &x, end, self.control);
            let stepped = run.and_then(|mut radau| radau.step().map(|()| radau));
            let Ok(radau) = stepped else {
                h *= SHRINKS;
                if h < f64::EPSILON * first {
                    break;
                }
                continue;
            };
            let (next, z) = radau.y().split_at(n);
            let scale = self.settings.tolerances(0, next);
            let changes = next.iter().zip(&x).zip(&scale).map(|((to, from), scale)| (to - from).abs() / scale);
            let residual = changes.fold(0.0, f64::max);
            // The change of the states in an implicit Euler step is the step size times the rates at its end, so that
            // the rates are the change divided by the step size.
            let before = std::mem::replace(&mut speed, residual / h);
            let growth = if before > 0.0 && residual > 1.0 { (speed / before).ln() / h } else { 0.0 };
            let is_last = is_reached && residual <= 1.0;
            is_reached = h >= INFINITE * first && residual <= 1.0;
            // A state that still changes by its whole size in a step of infinite size from a steady state is zero.
            let settled = |(to, from): (&f64, &f64)| if is_last && (to - from).abs() >= to.abs() { 0.0 } else { *to };
            x = next.iter().zip(&x).map(settled).collect();
            if is_last {
                return Ok(Rest { x, z: z.to_vec(), face: radau.face().clone(), residual });
            }
            let most = if follows && growth > 0.0 { OF_GROWTH / growth } else { INFINITE * first };
            h = (GROWTH * h).min(most);
        }
        let message = "no steady state was found from these initial values: the system may have none, or approach an \
                       orbit; choose initial values nearer to one";
        Err(self.failure("no_steady_state", message.to_owned()))
    }

    /// Returns the stable steady state to which the solution leads, if an unstable one was found and the initial
    /// values are not at it.
    fn stable_instead(&self, found: &Rest) -> Option<Rest> {
        let scale = self.settings.tolerances(0, &found.x);
        let is_there =
            found.x.iter().zip(&self.plan.initial).zip(&scale).all(|((to, from), scale)| (to - from).abs() <= *scale);
        let values = eigenvalues(self.model, self.plan.start, found).ok()?;
        if is_there || is_stable(&values) != Some(false) {
            return None;
        }
        let end = self.plan.start + OF_DEPARTURE / values.first()?[0];
        let mut problem = self.model.problem();
        let (settings, start) = (self.settings.clone(), self.plan.start);
        let mut radau = Radau::new(&mut *problem, settings, start, &self.plan.initial, end, self.control).ok()?;
        while !radau.is_done() && radau.counts.accepted < MOST_FOLLOWED {
            if self.control.poll().is_some() {
                return None;
            }
            radau.step().ok()?;
        }
        let initial = radau.y()[..self.plan.initial.len()].to_vec();
        let later = Search { plan: &Plan { initial, ..self.plan.clone() }, ..*self };
        let rest = later.find(true).ok()?;
        let values = eigenvalues(self.model, start, &rest).ok()?;
        (is_stable(&values) == Some(true)).then_some(rest)
    }

    /// Returns the size of a first step of the search in which no state changes significantly.
    fn first_step(&self) -> Result<f64, Failure> {
        let mut problem = self.model.problem();
        let failed = |error| failure(self.plan, &self.model.kinks, &error, self.plan.start, &self.plan.initial);
        let settings = Settings { step: None, ..self.settings.clone() };
        let (start, end) = (self.plan.start, self.plan.end);
        let radau =
            Radau::new(&mut *problem, settings, start, &self.plan.initial, end, self.control).map_err(failed)?;
        let (x, z) = radau.y().split_at(self.plan.initial.len());
        let at = Rest { x: x.to_vec(), z: z.to_vec(), face: radau.face().clone(), residual: 0.0 };
        let fastest = fastest(&eigenvalues(self.model, start, &at).unwrap_or_default());
        let of_rates = if fastest > 0.0 { fastest.recip() } else { f64::INFINITY };
        Ok(radau.next_step().min(end - start).min(of_rates))
    }

    /// Rejects a problem whose right-hand sides depend on time, and which thus has no steady state.
    fn check_time(&self, first: f64) -> Result<(), Failure> {
        let mut problem = self.model.problem();
        let mut y = self.plan.initial.clone();
        y.resize(problem.structure().unknowns(), 0.0);
        let rows = problem.structure().rows();
        let mut at = |t: f64| {
            let mut values = vec![0.0; rows];
            problem.evaluate(t, &y, &mut values);
            values
        };
        let now = at(self.plan.start);
        for part in COMPARED {
            let later = at(self.plan.start + part * first);
            let largest = now.iter().chain(&later).fold(0.0_f64, |most, value| most.max(value.abs()));
            if let Some(row) = (0..rows).find(|row| (now[*row] - later[*row]).abs() > SAME * largest) {
                let name = self.plan.names.get(row).map_or("a bound", String::as_str);
                let message = format!(
                    "the equation of `{name}` depends on time, so that there is no steady state; `periodic` finds \
                     periodic orbits"
                );
                return Err(self.failure("not_autonomous", message));
            }
        }
        Ok(())
    }

    fn failure(&self, code: &'static str, message: String) -> Failure {
        Failure { code: code.into(), message, time: self.plan.start, state: self.plan.initial.clone() }
    }
}
