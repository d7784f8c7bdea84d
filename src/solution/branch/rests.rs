//! Branches of steady states. On an active face the states and variables solve `F = 0` with `G = 0` for free
//! variables and `z = bound` for the others; a border is where a free variable reaches a bound, or the inequality at
//! a bound reaches zero. From a border the branch continues with that variable free, or at its bound, in the
//! direction of the parameter that has such a solution, which may be backwards.

use super::arclength::{Continuation, Curve, Evaluation, Family, Found, Scales, Solved, Test, What};
use super::test_functions::{OF_RESTS, is_confirmed};
use super::{Branch, BranchEvent, BranchEventKind, BranchPlan};
use crate::run::ending;
use crate::sensitivities::{By, directions};
use crate::steady_state::{Rest, eigenvalues, find_steady_state, has_zero, is_stable, rest_of};
use crate::{Failure, Plan, Solution};
use analysis::Analysis;
use models::DviModel;
use nalgebra::{DMatrix, DVector};
use problem::{Control, Side};
use radau::{ActiveFace, Activity, Settings, Tangents};
use std::collections::BTreeMap;
use std::time::Instant;

/// Permitted violation of a bound or inequality at a steady state, relative to the size of the variables, if it exceeds
/// the relative tolerance.
const SLACK: f64 = 1e-8;

/// States of a steady state below this fraction of their absolute tolerance are set to zero.
const AT_ZERO: f64 = 1e-3;

/// Follows a branch of steady states of a differential variational inequality.
pub fn follow_rests(
    model: &DviModel,
    plan: &Plan,
    asked: &BranchPlan,
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let began = Instant::now();
    let values = model.parameters.as_ref().map_or_else(Vec::new, |parameters| parameters.values().to_vec());
    let span = (asked.to - asked.from).abs();
    let mut rests =
        Rests { model, plan, settings, parameter: asked.parameter, span, size: 1.0, values, control, solved: 0 };
    let curve = first(&mut rests, asked).and_then(|(w, sizes)| {
        let tests: Vec<Test> = OF_RESTS.iter().map(|(test, _)| *test).collect();
        let scales = Scales { from: asked.from, to: asked.to, unknowns: sizes };
        Continuation::new(&mut rests, scales, &tests).follow(&w, asked.points)
    });
    let last = curve.as_ref().ok().and_then(|curve| curve.points.last());
    let at = last.map_or(asked.from, |point| point.p);
    let bound = rests.bound(at).unwrap_or_else(|_| model.clone());
    let mut plan = plan.clone();
    plan.observables.bind(&rests.values_at(at));
    plan.initial = last.map_or_else(|| bound.initial.clone(), |point| point.w[..bound.initial.len()].to_vec());
    // Newton's method ends at a small nonzero value for a state that is exactly zero: such values are set to zero.
    for (x, atol) in plan.initial.iter_mut().zip(&settings.atol) {
        *x = if x.abs() < AT_ZERO * atol { 0.0 } else { *x };
    }
    let mut solution = find_steady_state(&bound, &plan, settings, analysis, control);
    solution.diagnostics.wall_seconds = began.elapsed().as_secs_f64();
    match curve {
        Ok(curve) => {
            if let Some(doubt) = curve.doubt(&asked.name, "states of rest") {
                solution.diagnostics.checks.caveat("steady_state_uncertain", doubt);
            }
            told(&rests, asked, curve).tell(&mut solution);
        }
        Err(failure) => {
            let (status, failure) = ending(control, failure);
            (solution.status, solution.error) = (status, Some(failure));
        }
    }
    solution
}

/// The family of steady states over the continuation parameter.
struct Rests<'a> {
    model: &'a DviModel,
    plan: &'a Plan,
    settings: &'a Settings,
    parameter: usize,
    /// The length of the parameter interval of the continuation.
    span: f64,
    /// The size of the unknowns (states and variables) at the beginning of the branch.
    size: f64,
    values: Vec<f64>,
    control: &'a Control,
    solved: u64,
}

/// The equation of one variable on an active face, and the inequality that the face requires.
struct Sided {
    /// The residual of the equation, which is zero if the variable is on the active face.
    value: f64,
    /// The margin of the inequality; negative if the solution is not on this active face.
    margin: f64,
}

impl Rests<'_> {
    fn failure(&self, message: String) -> Failure {
        Failure { code: "no_branch".into(), message, time: self.plan.start, state: self.plan.initial.clone() }
    }

    fn values_at(&self, p: f64) -> Vec<f64> {
        let mut values = self.values.clone();
        values[self.parameter] = p;
        values
    }

    fn bound(&self, p: f64) -> Result<DviModel, Failure> {
        self.model.with_parameters(&self.values_at(p)).map_err(|why| self.failure(why.to_string()))
    }

    /// Returns the rates at a point of the branch, and for each variable the equation and the inequality of an active
    /// face.
    fn rows(&self, model: &DviModel, w: &[f64], face: &ActiveFace) -> (Vec<f64>, Vec<Sided>) {
        let mut problem = model.problem();
        let structure = problem.structure().clone();
        let (n, unknowns) = (structure.states, structure.unknowns());
        let mut values = vec![0.0; structure.rows()];
        problem.evaluate(self.plan.start, w, &mut values);
        let bound = |k: usize, side: Side| {
            let moving = structure.moving.iter().position(|moving| moving.variable == k && moving.side == side);
            let fixed = if side == Side::Lower { structure.set.lower[k] } else { structure.set.upper[k] };
            moving.map_or(fixed, |p| values[unknowns + p])
        };
        let sided = |k: usize| {
            let (z, g) = (w[n + k], values[n + k]);
            let [lower, upper] = [Side::Lower, Side::Upper].map(|side| bound(k, side));
            match face.places[k] {
                Activity::AtLower => Sided { value: z - lower, margin: g },
                Activity::AtUpper => Sided { value: z - upper, margin: -g },
                _ => Sided { value: g, margin: (z - lower).min(upper - z) },
            }
        };
        (values[..n].to_vec(), (0..structure.variables).map(sided).collect())
    }
}

impl Family for Rests<'_> {
    type Word = ActiveFace;

    fn evaluate(&mut self, w: &[f64], p: f64, near: Option<&ActiveFace>) -> Result<Evaluation<ActiveFace>, Failure> {
        self.solved += 1;
        let model = self.bound(p)?;
        let n = model.structure().states;
        let face = match near {
            Some(face) => face.clone(),
            None => {
                let plan = Plan { initial: w[..n].to_vec(), ..self.plan.clone() };
                rest_of(&model, &plan, self.settings, self.control)?.face
            }
        };
        if face.blocks.iter().any(|block| *block != problem::Face::Interior) {
            let why = "variables are on the boundary of a ball, a cone, a simplex or a polyhedron, along which branches are not followed";
            return Err(self.failure(why.to_owned()));
        }
        let (rates, sided) = self.rows(&model, w, &face);
        let directions = directions(&model, &[By::Parameter(self.parameter)]).map_err(|why| self.failure(why))?;
        let mut tangents = Tangents::new(model.problem(), directions).map_err(|why| self.failure(why.to_string()))?;
        let [by_y, by_parameter] =
            tangents.derivatives(&face, self.plan.start, w).map_err(|why| self.failure(why.to_string()))?;
        let count = w.len();
        let mut jacobian = DMatrix::zeros(count, count + 1);
        jacobian.columns_mut(0, count).copy_from(&by_y);
        // Column `count` of the Jacobian holds the derivatives with respect to the parameter; those of bounds have the
        // sign of the residual.
        jacobian.set_column(count, &by_parameter.column(0));
        let mut residual = DVector::zeros(count);
        let mut is_admissible = true;
        let largest = w.iter().map(|x| x.abs()).fold(0.0, f64::max);
        let of_variables = self.settings.atol.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        for row in 0..count {
            let tolerance = |i: usize| {
                // Variables have no absolute tolerance of their own: each takes the largest one of the states.
                let own = self.settings.atol.get(i).map(|atol| atol + self.settings.rtol * w[i].abs());
                own.unwrap_or(of_variables + self.settings.rtol * largest)
            };
            // At a fold the derivatives with respect to the states vanish: the tolerance of the parameter then scales
            // the residual.
            let of_parameter = by_parameter[(row, 0)].abs() * self.settings.rtol * self.span.max(p.abs());
            let size = (0..count).map(|i| by_y[(row, i)].abs() * tolerance(i)).sum::<f64>() + of_parameter;
            let size = if size > 0.0 { size } else { f64::MIN_POSITIVE };
            residual[row] = match row.checked_sub(n) {
                None => rates[row],
                Some(k) => sided[k].value,
            } / size;
            let mut row = jacobian.row_mut(row);
            row /= size;
        }
        for (k, Sided { margin, .. }) in sided.iter().enumerate() {
            let size = w[n + k].abs() + largest.max(self.size);
            is_admissible &= *margin >= -self.settings.rtol.max(SLACK) * size.max(f64::MIN_POSITIVE);
        }
        let rest = Rest { x: w[..n].to_vec(), z: w[n..].to_vec(), face: face.clone(), residual: 0.0 };
        let spectrum = eigenvalues(&model, self.plan.start, &rest).map_err(|why| self.failure(why))?;
        let is_single = !has_zero(&spectrum);
        Ok(Evaluation { residual, jacobian, word: face, spectrum, is_admissible, is_single })
    }

    fn beyond(&mut self, at: &Solved<ActiveFace>, towards: &[f64], p: f64) -> Option<(Vec<f64>, f64, ActiveFace)> {
        // The variable whose activity changes at the border is the one that violates its inequality on the old active
        // face most, slightly behind the border.
        let model = self.bound(p).ok()?;
        let (_, sided) = self.rows(&model, towards, &at.word);
        let (k, _) = sided.iter().enumerate().min_by(|a, b| a.1.margin.total_cmp(&b.1.margin))?;
        let structure = model.structure();
        let n = structure.states;
        let mut face = at.word.clone();
        face.places[k] = match face.places[k] {
            Activity::AtLower | Activity::AtUpper => Activity::Inactive,
            Activity::Inactive => {
                let here = self.bound(at.p).ok()?;
                let of = |side| {
                    let mut face = at.word.clone();
                    face.places[k] = side;
                    self.rows(&here, &at.w, &face).1.get(k).map_or(f64::INFINITY, |sided| sided.value.abs())
                };
                if of(Activity::AtLower) <= of(Activity::AtUpper) { Activity::AtLower } else { Activity::AtUpper }
            }
            _ => return None,
        };
        (at.w.len() > n).then(|| (at.w.clone(), at.p, face))
    }

    fn is_stopped(&self) -> bool {
        self.control.poll().is_some()
    }
}

/// Returns the first steady state of the branch, and the sizes of its unknowns.
fn first(rests: &mut Rests<'_>, asked: &BranchPlan) -> Result<(Vec<f64>, Vec<f64>), Failure> {
    let model = rests.bound(asked.from)?;
    let plan = Plan { initial: model.initial.clone(), ..rests.plan.clone() };
    let rest = rest_of(&model, &plan, rests.settings, rests.control)?;
    let w = [rest.x, rest.z].concat();
    let largest = w.iter().map(|x| x.abs()).fold(0.0, f64::max);
    // A steady state below the tolerances counts as zero; its unknowns have the size one.
    let least = rests.settings.atol.iter().copied().fold(0.0, f64::max);
    let size = if largest > least { largest } else { 1.0 };
    rests.size = size;
    let sizes = vec![size; w.len()];
    Ok((w, sizes))
}

/// Converts the branch of steady states to named states, variables and events.
fn told(rests: &Rests<'_>, asked: &BranchPlan, curve: Curve<ActiveFace>) -> Branch {
    let n = rests.model.state_names.len();
    let named = |w: &[f64]| -> BTreeMap<String, f64> {
        rests.model.state_names.iter().cloned().zip(w[..n].iter().copied()).collect()
    };
    let mut branch = Branch { name: asked.name.clone(), shots: rests.solved, ..Branch::default() };
    for point in &curve.points {
        branch.parameter.push(point.p);
        branch.points.push(named(&point.w));
        branch.stable.push(is_stable(&point.spectrum));
        branch.spectrum.push(point.spectrum.clone());
    }
    for Found { at, after, what } in &curve.events {
        let (kind, of) = match what {
            What::Test(number) => (OF_RESTS[*number].1, None),
            What::Border(other) => {
                let changed = other.as_ref().and_then(|other| {
                    let pairs = at.word.places.iter().zip(&other.places);
                    pairs.into_iter().position(|(before, after)| before != after)
                });
                (BranchEventKind::Border, changed.and_then(|k| rests.model.variable_names.get(k).cloned()))
            }
        };
        if is_confirmed(kind, &at.spectrum) {
            let point = named(&at.w);
            branch.events.push(BranchEvent { at: at.p, kind, after: *after as u64, point, period: None, of });
        }
    }
    branch.ended = curve.ended.map(|failure| failure.message);
    branch
}
