//! States of rest, `0 in F(x, z) + N_K(z)` with `F` zero for the states: by steps of implicit Euler of growing length, each of
//! which is, for an infinite length, one of Josephy and Newton for that inclusion (Kelley and Keyes 1998, *Convergence analysis
//! of pseudo-transient continuation*). Steps begin as short as the system is fast, so that the state of rest is the one that it
//! comes to, if it comes to one; where it does not, an unstable one may be found.
//!
//! Eigenvalues `lambda` of the equations on the face there, `lambda diag(M, 0) v = Phi_y v`, are those of
//! `(sigma diag(M, 0) - Phi_y)^-1 diag(M, 0)`, which are `1/(sigma - lambda)`: what is infinite in one is zero in the other,
//! whatever the index.

use super::integrate::{failure, integrate_once};
use super::run::{Ended, Plan, ending};
use super::{CheckCode, Failure, Solution, Status};
use analysis::Analysis;
use models::DviModel;
use nalgebra::DMatrix;
use problem::Control;
use radau::{ActiveFace, Directions, Radau, Settings, StageChoice, Switches, Tangents};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Instant;
use utoipa::ToSchema;

/// By how much a step is longer than one that was made, and shorter than one that was not.
const GROWTH: f64 = 8.0;
const SHRINKS: f64 = 0.125;
/// A step is infinite where it is longer than the first by this: what a step of this length lacks to one of Newton's method is
/// its inverse, which is rounding.
const INFINITE: f64 = 1e16;
/// The most steps: those from the first length to the last, and as many again for what is nonlinear.
const MOST_STEPS: u64 = 400;
/// Eigenvalues of the inverse below this part of the largest are those of infinite ones: the root of rounding, as they are
/// double for each hidden constraint.
const INFINITE_EIGENVALUE: f64 = 1e-7;
/// What the rates of the states by themselves are multiplied by to shift eigenvalues: no simple number, as eigenvalues of small
/// problems often are.
const SHIFTS: [f64; 3] = [1.272_019_649_514, 1.839_286_755_214, 2.506_628_274_631];
/// The part of the largest eigenvalue within which a real part is zero, to the accuracy of a matrix that is not symmetric.
const ON_AXIS: f64 = 1e-9;
/// The times, in parts of the first step, at which the rows of a problem are compared.
const COMPARED: [f64; 4] = [1.0, 3.7, 1e2, 1e5];
/// Rows that differ by less than this part of the largest value are the same.
const SAME: f64 = 1e-9;

/// A state of rest.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct SteadyState {
    /// The states, by their names.
    pub states: BTreeMap<String, f64>,
    /// The variables.
    pub variables: BTreeMap<String, f64>,
    /// The eigenvalues of the equations there as `[re, im]`, the variables that rest on a bound held there, by falling real part.
    /// Empty where variables are on the boundary of a ball, a cone, a simplex or a polyhedron.
    pub eigenvalues: Vec<[f64; 2]>,
    /// Whether what is near comes nearer: all real parts are negative. Absent where one is zero, or none are known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stable: Option<bool>,
    /// By how much the last step of Newton's method changed the states, in units of `atol + rtol |x|`.
    pub residual: f64,
}

/// What was found.
pub(super) struct Rest {
    pub x: Vec<f64>,
    pub z: Vec<f64>,
    pub face: ActiveFace,
    pub residual: f64,
}

/// The state of rest that the start comes to.
pub(super) fn rest_of(model: &DviModel, plan: &Plan, settings: &Settings, control: &Control) -> Result<Rest, Failure> {
    Search { model, plan, settings, control }.find()
}

/// Whether all real parts are negative; `None` where one is zero, or none are known. They fall.
pub(super) fn is_stable(eigenvalues: &[[f64; 2]]) -> Option<bool> {
    let fastest = eigenvalues.iter().map(|[re, im]| re.hypot(*im)).fold(0.0, f64::max);
    let largest = eigenvalues.first().map(|[re, _]| *re);
    largest.filter(|re| re.abs() > ON_AXIS * fastest).map(|re| re < 0.0)
}

/// Finds a state of rest from the start, and runs from there for a while.
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
    let fastest = eigenvalues.iter().flatten().map(|[re, im]| re.hypot(*im)).fold(0.0, f64::max);
    let span = plan.end - plan.start;
    // As long as an unstable state of rest is not left.
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
    // Errors of the tolerance in every step add up to as many.
    let allowed = diagnostics.steps.accepted.max(1) as f64;
    diagnostics.checks.record(CheckCode::ReturnResidual, moved, allowed, || {
        format!("a run from the state of rest leaves it by {moved:.1e} times the tolerance until t = {end:?}")
    });
    if let Err(why) = &eigenvalues {
        diagnostics.checks.caveat("no_eigenvalues", format!("the state of rest has no eigenvalues: {why}"));
    }
    let eigenvalues = eigenvalues.unwrap_or_default();
    let stable = is_stable(&eigenvalues);
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

/// The eigenvalues of the equations at a state of rest, by falling real part.
pub(super) fn eigenvalues(model: &DviModel, t: f64, rest: &Rest) -> Result<Vec<[f64; 2]>, String> {
    let n = rest.x.len();
    let directions = Directions {
        initial: DMatrix::zeros(n, 0),
        rows: Box::new(|_, _, _| {}),
        mass: Vec::new(),
        bounds: Vec::new(),
        shifted: Vec::new(),
    };
    let mut tangents = Tangents::new(model.problem(), directions).map_err(|why| why.to_string())?;
    let y = [rest.x.as_slice(), &rest.z].concat();
    let [mass, by_y] = tangents.linearised(&rest.face, t, &y).map_err(|why| why.to_string())?;
    let rates = by_y.rows(0, n);
    // As large as the states' own rates, so that no digits of these are lost.
    let size = rates.columns(0, n).amax() / mass.amax();
    let size = if size > 0.0 { size } else { 1.0 };
    // One of them is no eigenvalue, unless all are.
    let solved = SHIFTS.iter().find_map(|part| {
        let shift = part * size;
        let ratio = (&mass * shift - &by_y).lu().solve(&mass)?;
        ratio.iter().all(|value| value.is_finite()).then_some((shift, ratio))
    });
    let Some((shift, ratio)) = solved else { return Err("its equations are singular".to_owned()) };
    // Variables have no rates, and add zeros alone.
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

/// A search.
struct Search<'a> {
    model: &'a DviModel,
    plan: &'a Plan,
    settings: &'a Settings,
    control: &'a Control,
}

impl Search<'_> {
    fn find(&self) -> Result<Rest, Failure> {
        let n = self.plan.initial.len();
        let mut x = self.plan.initial.clone();
        let first = self.first_step()?;
        self.check_time(first)?;
        let (mut h, mut made) = (first, 0);
        while made < MOST_STEPS {
            made += 1;
            if self.control.poll().is_some() {
                break;
            }
            let settings = Settings {
                stages: StageChoice::Fixed(1),
                step: Some(h),
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
            let is_last = h >= INFINITE * first && residual <= 1.0;
            x = next.to_vec();
            if is_last {
                return Ok(Rest { x, z: z.to_vec(), face: radau.face().clone(), residual });
            }
            h = (GROWTH * h).min(INFINITE * first);
        }
        let message =
            "no state of rest was found from here: the system may have none, or come to an orbit; begin nearer to one";
        Err(self.failure("no_steady_state", message.to_owned()))
    }

    /// A step in which no state changes by much.
    fn first_step(&self) -> Result<f64, Failure> {
        let mut problem = self.model.problem();
        let failed = |error| failure(self.plan, &self.model.kinks, &error, self.plan.start, &self.plan.initial);
        let settings = Settings { step: None, ..self.settings.clone() };
        let (start, end) = (self.plan.start, self.plan.end);
        let radau =
            Radau::new(&mut *problem, settings, start, &self.plan.initial, end, self.control).map_err(failed)?;
        Ok(radau.next_step().min(end - start))
    }

    /// Refuses a problem that depends on time.
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
                    "what belongs to `{name}` depends on time, so that nothing rests; `periodic` finds what repeats"
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
