//! Branches of periodic orbits, by shooting with the derivatives of each run with respect to its start and to the
//! parameter.

use super::arclength::{ByOthers, Continuation, Curve, Evaluation, Family, Found, Scales, Solved, Test, What};
use super::cut::CutOpen;
use super::test_functions::{OF_ORBITS, is_confirmed};
use super::{Branch, BranchEvent, BranchEventKind, BranchPlan};
use crate::bindable::Bindable;
use crate::contact::ContactPlan;
use crate::multipliers;
use crate::orbit::{Missed, Periodic, is_stable, run_along, search_from_start};
use crate::passages::{Passages, Passed};
use crate::run::ending;
use crate::shooting::Shot;
use crate::verdict::Checks;
use crate::{Failure, Plan, Solution, Status};
use analysis::Analysis;
use expression::Tape;
use factorisation::Singular;
use models::{DviModel, MechanicalModel};
use nalgebra::{DMatrix, DVector};
use numerics::CENTRAL_DIFFERENCE;
use problem::Control;
use radau::Settings;
use std::time::Instant;

/// Largest distance between an orbit behind a border (a change of its events) and the orbit at the border, relative to
/// the largest unknown.
const NEAR: f64 = 0.1;
/// The largest number of Newton corrections of an orbit behind a border (a change of its events).
const CORRECTIONS: usize = 12;

/// Returns the name of the variable or contact that an event belongs to.
fn name(model: &Bindable<'_>, of: &Passed) -> Option<String> {
    match (model, of) {
        (Bindable::Dvi(model), Passed::Switch(variable, ..)) => model.variable_names.get(*variable).cloned(),
        (Bindable::Motion(model, _), Passed::Contact(contact, _)) => model.contacts.get(*contact).cloned(),
        _ => None,
    }
}

/// The settings of the runs over one period, and the structural analysis of the problem.
#[derive(Clone, Copy)]
struct How<'a> {
    settings: &'a Settings,
    analysis: &'a Analysis,
}

/// Follows a branch of periodic orbits of a differential variational inequality.
pub fn follow_orbits(
    model: &DviModel,
    plan: &Plan,
    (asked, periodic, program): (&BranchPlan, Periodic, Option<&Tape>),
    settings: &Settings,
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let how = How { settings, analysis };
    follow(&Bindable::Dvi(Box::new(model.clone())), plan, (asked, periodic, program), how, control)
}

/// Follows a branch of periodic orbits of a motion with located impacts.
pub fn follow_orbits_of_motion(
    model: &MechanicalModel,
    plan: &Plan,
    (asked, periodic, program): (&BranchPlan, Periodic, Option<&Tape>),
    (contact, settings): (&ContactPlan, &Settings),
    analysis: &Analysis,
    control: &Control,
) -> Solution {
    let how = How { settings, analysis };
    follow(&Bindable::Motion(Box::new(model.clone()), contact), plan, (asked, periodic, program), how, control)
}

/// The family of periodic orbits over the continuation parameter.
struct Orbits<'a> {
    model: &'a Bindable<'a>,
    how: How<'a>,
    plan: &'a Plan,
    parameter: usize,
    values: Vec<f64>,
    periodic: Periodic,
    /// The constant value of the state that fixes the phase of an orbit with a free period.
    anchor: f64,
    /// The period of the orbit as a function of the parameters, if it is given.
    program: Option<Tape>,
    control: &'a Control,
    shots: u64,
    /// For each point of the branch, the states at the beginning of the period, and the period; `None` if a run
    /// fails.
    places: Vec<Option<(Vec<f64>, f64)>>,
}

impl Orbits<'_> {
    fn failure(&self, message: String) -> Failure {
        Failure { code: "no_branch".into(), message, time: self.plan.start, state: self.plan.initial.clone() }
    }

    fn values_at(&self, p: f64) -> Vec<f64> {
        let mut values = self.values.clone();
        values[self.parameter] = p;
        values
    }

    /// Returns the period of the orbit at the parameter value `p`, if it is given.
    fn period_at(&mut self, p: f64) -> f64 {
        let values = self.values_at(p);
        let Some(program) = &mut self.program else { return self.periodic.period };
        program.bind(&values);
        let mut period = [0.0];
        program.evaluate(0.0, &[], &mut period);
        period[0]
    }

    /// Returns the start and the period of an orbit with the unknowns `w`.
    fn start(&mut self, w: &[f64], p: f64) -> (Vec<f64>, f64) {
        let mut from = w.to_vec();
        match self.periodic.phase {
            Some(phase) => {
                let period = std::mem::replace(&mut from[phase], self.anchor);
                (from, period)
            }
            None => (from, self.period_at(p)),
        }
    }

    fn shoot(&mut self, w: &[f64], p: f64, after: f64) -> Result<Shot, Failure> {
        let (from, period) = self.start(w, p);
        self.run((&from, period), p, after)
    }

    /// Makes a run over one period that begins at the cut of the orbit, at the time `after` after the start time of
    /// the plan.
    fn run(&mut self, (from, period): (&[f64], f64), p: f64, after: f64) -> Result<Shot, Failure> {
        if !(period > 0.0 && period.is_finite()) {
            return Err(self.failure(format!("the period is {period:?} where the parameter is {p:?}")));
        }
        let model = self.model.bound(&self.values_at(p)).map_err(|why| self.failure(why))?;
        self.shots += 1;
        let plan = self.plan_from(after);
        model.subject(self.how.settings).shoot(&plan, (from, period), &[self.parameter], self.control)
    }

    /// Returns the plan of runs that begin at the cut of the orbit, at the time `after` after the start time of the
    /// given plan.
    fn plan_from(&self, after: f64) -> Plan {
        Plan { start: self.plan.start + after, ..self.plan.clone() }
    }

    /// Returns the states of an orbit at the beginning of its period, and the period; `None` if the run from the cut
    /// of the orbit (the point at which the continuation lets the period begin) to there fails.
    fn at_beginning(&mut self, point: &Solved<CutOpen>) -> Option<(Vec<f64>, f64)> {
        let (from, period) = self.start(&point.w, point.p);
        let after = point.word.after;
        let left = period * (after / period).ceil() - after;
        if left <= 0.0 {
            return Some((from, period));
        }
        let model = self.model.bound(&self.values_at(point.p)).ok()?;
        let subject = model.subject(self.how.settings);
        let run = subject.end(&self.plan_from(after), (&from, left), self.control).ok()?;
        Some((run.to, period))
    }

    fn unknowns(&self, shot: &Shot) -> Vec<f64> {
        let mut w = shot.from.clone();
        if let Some(phase) = self.periodic.phase {
            w[phase] = shot.period;
        }
        w
    }
}

impl Family for Orbits<'_> {
    type Word = CutOpen;

    fn evaluate(&mut self, w: &[f64], p: f64, near: Option<&Self::Word>) -> Result<Evaluation<Self::Word>, Failure> {
        let after = near.map_or(0.0, |near| near.after);
        let shot = self.shoot(w, p, after)?;
        let n = w.len();
        let monodromy = shot.monodromy.as_ref().map_err(|why| self.failure(why.clone()))?;
        let slope = DVector::from_column_slice(&shot.slope);
        let mut jacobian = DMatrix::zeros(n, n + 1);
        jacobian.columns_mut(0, n).copy_from(&(monodromy - DMatrix::identity(n, n)));
        let mut by_parameter = shot.by_parameters.column(0).into_owned();
        match self.periodic.phase {
            Some(phase) => jacobian.set_column(phase, &slope),
            None => {
                let by = CENTRAL_DIFFERENCE * if p == 0.0 { 1.0 } else { p.abs() };
                let of_period = (self.period_at(p + by) - self.period_at(p - by)) / (2.0 * by);
                by_parameter += &slope * of_period;
            }
        }
        jacobian.set_column(n, &by_parameter);
        for (i, mut row) in jacobian.row_iter_mut().enumerate() {
            row /= shot.scale[i];
        }
        let residual = DVector::from_fn(n, |i, _| (shot.to[i] - shot.from[i]) / shot.scale[i]);
        let mut spectrum = shot.multipliers();
        if self.periodic.phase.is_some() {
            // An orbit with a free phase always has a multiplier 1: the nearest to 1 is removed.
            let off = |value: &[f64; 2]| (value[0] - 1.0).hypot(value[1]);
            let nearest = (0..spectrum.len()).min_by(|a, b| off(&spectrum[*a]).total_cmp(&off(&spectrum[*b])));
            nearest.map(|nearest| spectrum.remove(nearest));
        }
        let word = CutOpen { passages: shot.passages, after };
        let is_single = spectrum.iter().all(|[re, im]| (re - 1.0).hypot(*im) > self.how.settings.rtol);
        Ok(Evaluation { residual, jacobian, word, spectrum, is_admissible: true, is_single })
    }

    fn beyond(&mut self, at: &Solved<Self::Word>, towards: &[f64], p: f64) -> Option<(Vec<f64>, f64, Self::Word)> {
        let mut w = towards.to_vec();
        for _ in 0..CORRECTIONS {
            let Evaluation { residual, jacobian, word, .. } = self.evaluate(&w, p, Some(&at.word)).ok()?;
            if residual.amax() <= 1.0 {
                let sizes = at.w.iter().map(|x| x.abs()).fold(f64::MIN_POSITIVE, f64::max);
                let is_near = w.iter().zip(&at.w).all(|(w, at)| (w - at).abs() <= NEAR * sizes.max(at.abs()));
                return (word != at.word && is_near).then_some((w, p, word));
            }
            let n = w.len();
            let svd = Singular::of(&jacobian.columns(0, n).into_owned())?;
            let change = svd.solve(&-residual, f64::EPSILON.sqrt() * svd.values.first()?);
            w.iter_mut().zip(change.iter()).for_each(|(w, change)| *w += change);
        }
        None
    }

    fn by_others(&mut self, at: &Solved<Self::Word>, (way, by_p): (&[f64], f64)) -> Option<ByOthers<Self::Word>> {
        // With a free phase, another cut would need another value of the state that fixes the phase.
        if self.periodic.phase.is_some() {
            return None;
        }
        let (from, period) = self.start(&at.w, at.p);
        let later = at.word.better(period)?;
        let model = self.model.bound(&self.values_at(at.p)).ok()?;
        let plan = self.plan_from(at.word.after);
        let subject = model.subject(self.how.settings);
        let run = subject.shoot(&plan, (&from, later), &[self.parameter], self.control).ok()?;
        let along = run.monodromy.ok()? * DVector::from_column_slice(way) + run.by_parameters.column(0) * by_p;
        // The forcing is periodic: the position of the cut is taken modulo the period.
        let after = (at.word.after + later) % period;
        let passages = self.shoot(&run.to, at.p, after).ok()?.passages;
        let change = along.iter().copied().collect();
        Some(ByOthers { w: run.to, change, word: CutOpen { passages, after } })
    }

    fn accept(&mut self, point: &Solved<Self::Word>) {
        let place = self.at_beginning(point);
        self.places.push(place);
    }

    fn is_stopped(&self) -> bool {
        self.control.poll().is_some()
    }
}

fn follow(
    model: &Bindable<'_>,
    plan: &Plan,
    (asked, periodic, program): (&BranchPlan, Periodic, Option<&Tape>),
    how: How<'_>,
    control: &Control,
) -> Solution {
    let began = Instant::now();
    let mut orbits = Orbits {
        model,
        how,
        plan,
        parameter: asked.parameter,
        values: model.values().to_vec(),
        periodic,
        anchor: 0.0,
        program: program.cloned(),
        control,
        shots: 0,
        places: Vec::new(),
    };
    let (curve, at) = match first(&mut orbits, asked).and_then(|(w, sizes)| {
        let tests: Vec<Test> = OF_ORBITS.iter().map(|(test, _)| *test).collect();
        let scales = Scales { from: asked.from, to: asked.to, unknowns: sizes };
        Continuation::new(&mut orbits, scales, &tests).follow(&w, asked.points)
    }) {
        Ok(curve) => {
            let at = curve.points.last().map_or(asked.from, |point| point.p);
            (Ok(curve), at)
        }
        Err(failure) => (Err(failure), asked.from),
    };
    let mut solution = along_last(&mut orbits, (&curve, at), control);
    solution.diagnostics.wall_seconds = began.elapsed().as_secs_f64();
    match curve {
        Ok(curve) => {
            let checks = &mut solution.diagnostics.checks;
            if solution.status == Status::Completed {
                check(&mut orbits, &curve, checks);
            }
            if let Some(doubt) = curve.doubt(&asked.name, "orbits") {
                checks.caveat("orbit_uncertain", doubt);
            }
            let branch = told(&mut orbits, asked, curve);
            branch.tell(&mut solution);
        }
        Err(failure) => {
            let (status, failure) = ending(control, failure);
            (solution.status, solution.error) = (status, Some(failure));
        }
    }
    solution
}

/// Returns the first orbit of the branch, sought from the initial values, and the sizes of its unknowns.
fn first(orbits: &mut Orbits<'_>, asked: &BranchPlan) -> Result<(Vec<f64>, Vec<f64>), Failure> {
    let model = orbits.model.bound(&orbits.values_at(asked.from)).map_err(|why| orbits.failure(why))?;
    let subject = model.subject(orbits.how.settings);
    let period = orbits.period_at(asked.from);
    let initial = model.initial().to_vec();
    let plan = Plan { initial, end: orbits.plan.start + period, ..orbits.plan.clone() };
    let (found, shots) = search_from_start(subject, &plan, Periodic { period, ..orbits.periodic }, orbits.control);
    orbits.shots += shots;
    let shot = found.map_err(|missed: Missed| missed.1)?;
    let settings = orbits.how.settings;
    // A state below its absolute tolerance counts as zero; its size is one.
    let sizes = shot.scale.iter().zip(&settings.atol).map(|(scale, atol)| {
        let largest = (scale - atol) / settings.rtol;
        if largest > *atol { largest } else { 1.0 }
    });
    let mut sizes: Vec<f64> = sizes.collect();
    if let Some(phase) = orbits.periodic.phase {
        sizes[phase] = shot.period;
        orbits.anchor = shot.from[phase];
    }
    Ok((orbits.unknowns(&shot), sizes))
}

/// Runs once along the last orbit of the branch, or from the initial values if there is none.
fn along_last(
    orbits: &mut Orbits<'_>,
    (curve, at): (&Result<Curve<CutOpen>, Failure>, f64),
    control: &Control,
) -> Solution {
    let model = orbits.model.bound(&orbits.values_at(at)).unwrap_or_else(|_| orbits.model.clone());
    let last = curve.as_ref().ok().and_then(|curve| curve.points.last());
    let shot = last.and_then(|last| {
        let (from, period) = orbits.places.last().cloned().flatten()?;
        orbits.run((&from, period), last.p, 0.0).ok()
    });
    let period = shot.as_ref().map_or(orbits.periodic.period, |shot| shot.period);
    let found = shot.ok_or_else(|| Box::new((None, orbits.failure("there is no orbit".to_owned()))));
    let mut plan = Plan { initial: model.initial().to_vec(), ..orbits.plan.clone() };
    plan.observables.bind(&orbits.values_at(at));
    plan.end = plan.start + period;
    plan.times = orbits.plan.times.as_ref().map(|times| {
        let at = |t: &f64| plan.start + (t - plan.start) * (period / orbits.periodic.period);
        times.iter().map(at).collect()
    });
    let How { analysis, settings } = orbits.how;
    let along = |plan: &Plan| model.run_once(plan, settings, analysis, control);
    let asked = Periodic { period, ..orbits.periodic };
    run_along(model.subject(settings), &plan, asked, (found, orbits.shots), along, control)
}

/// Verifies the multipliers of the first orbit, of the last orbit, and of orbits at bifurcations by differences of
/// runs. On a border an orbit has one-sided derivatives only.
fn check(orbits: &mut Orbits<'_>, curve: &Curve<CutOpen>, checks: &mut Checks) {
    let tested = curve.events.iter().filter(|found| matches!(found.what, What::Test(_)));
    for point in curve.points.first().into_iter().chain(curve.points.last()).chain(tested.map(|found| &found.at)) {
        let after = point.word.after;
        let Ok(shot) = orbits.shoot(&point.w, point.p, after) else { continue };
        let Ok(model) = orbits.model.bound(&orbits.values_at(point.p)) else { continue };
        let plan = orbits.plan_from(after);
        multipliers::find(model.subject(orbits.how.settings), &plan, &shot, false, orbits.control, checks);
    }
}

/// Converts the branch of orbits to named states, variables and events.
fn told(orbits: &mut Orbits<'_>, asked: &BranchPlan, curve: Curve<CutOpen>) -> Branch {
    let (names, model) = (orbits.plan.names.clone(), orbits.model);
    let mut branch = Branch { name: asked.name.clone(), shots: orbits.shots, ..Branch::default() };
    let named = |from: Vec<f64>| names.iter().cloned().zip(from).collect();
    let places = orbits.places.clone().into_iter().map_while(|place| place);
    for (point, (from, period)) in curve.points.iter().zip(places) {
        branch.parameter.push(point.p);
        branch.points.push(named(from));
        branch.period.push(period);
        branch.stable.push(is_stable(&point.spectrum, false));
        branch.spectrum.push(point.spectrum.clone());
    }
    for Found { at, after, what } in &curve.events {
        let (kind, of) = match what {
            What::Test(number) => (OF_ORBITS[*number].1, None),
            What::Border(other) => border(&at.word.passages, other.as_ref().map(|other| &other.passages)),
        };
        if !is_confirmed(kind, &at.spectrum) {
            continue;
        }
        let Some((from, period)) = orbits.at_beginning(at) else { continue };
        let (point, of) = (named(from), of.and_then(|of| name(model, &of)));
        branch.events.push(BranchEvent { at: at.p, kind, after: *after as u64, point, period: Some(period), of });
    }
    branch.ended = curve.ended.map(|failure| failure.message);
    branch
}

/// Returns the kind of a border of the branch, and the event of the orbit that changes: grazing if the number of events
/// changes, since a bound or contact is then touched.
fn border(before: &Passages, after: Option<&Passages>) -> (BranchEventKind, Option<Passed>) {
    let Some(after) = after else { return (BranchEventKind::Grazing, None) };
    let longer = if after.len() > before.len() { after } else { before };
    let of = longer.get(before.first_difference(after)).cloned();
    let kind = if before.len() == after.len() { BranchEventKind::Border } else { BranchEventKind::Grazing };
    (kind, of)
}
