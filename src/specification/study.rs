//! A study of error against run time (work-precision study): one problem at a series of tolerances or step sizes, and
//! numbers of stages.

use super::checked::Specification;
use super::document::Time;
use super::error::{Errors, SpecificationError};
use super::expression::Expression;
use super::lowering::{Lowering, Named, Start};
use super::method::{Impacts, Method, check_rtol, check_stages, check_step, out_of_range};
use super::model::{Model, WithStages};
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::stages::Stages;
use super::wording::{abridged, listed};
use expression::{Tape, nearest};
use problem::Control;
use serde::Deserialize;
use utoipa::ToSchema;

/// The same problem solved at each of several tolerances or step sizes: the answer contains error against run time.
/// Give either `rtol` or `step`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StudyRequest {
    /// Relative tolerances of the runs; absolute tolerances are scaled in proportion.
    pub rtol: Option<Vec<f64>>,
    /// Fixed step sizes of the runs.
    pub step: Option<Vec<f64>>,
    /// Numbers of Radau IIA stages of the runs. Default: `stages` of `method`.
    pub stages: Option<Vec<Stages>>,
    /// Exact solutions, as expressions in `t` and the parameters, by the name of a state or variable. Default: a more
    /// accurate run as reference.
    #[schema(value_type = Option<std::collections::BTreeMap<String, Expression>>)]
    pub exact: Option<Ordered<Expression>>,
    /// Number of solves per run, whose median is the run time. Default 3.
    #[serde(default = "default_repeats")]
    #[schema(minimum = 1, maximum = 25, default = 3)]
    pub repeats: u64,
}

fn default_repeats() -> u64 {
    3
}

/// Largest number of runs of a work-precision study, not counting repeats.
const MOST_RUNS: usize = 64;
/// Largest number of repeated solves per run of a work-precision study.
const MOST_REPEATS: u64 = 25;

/// The setting that controls the accuracy of a run of a study: tolerance or step size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rung {
    /// A relative tolerance of the run, which adapts its steps.
    Tolerance(f64),
    /// A fixed step size of the run.
    Step(f64),
}

/// A work-precision study that has passed every check.
#[derive(Clone, Debug)]
pub struct StudyPlan {
    /// The tolerances or step sizes of the runs, in the order of the document.
    pub rungs: Vec<Rung>,
    /// The numbers of Radau IIA stages of the runs of the study.
    pub stages: Vec<Stages>,
    /// Number of solves per run, of whose times the median is the run time.
    pub repeats: usize,
    /// The exact solution that errors are measured against, if the user gives one.
    pub exact: Option<Exact>,
}

/// Exact values of some outputs of the problem, known at any time.
#[derive(Clone, Debug)]
pub struct Exact {
    /// Indices of the outputs whose exact values are known.
    pub fields: Vec<usize>,
    /// Exact value of each of `fields`, as a function of time alone.
    pub values: Tape,
}

impl StudyRequest {
    /// Checks a work-precision study of a model; `named` are the named quantities of the problem, whose pointer is
    /// `problem`.
    pub(super) fn check(
        &self,
        (model, method, time): (&dyn Model, &Method, Time),
        (named, problem): (Named<'_>, &Pointer<'_>),
        place: &Pointer<'_>,
        errors: &mut Errors,
    ) -> Option<StudyPlan> {
        let mut found = Errors::default();
        let rungs = self.rungs(model, time, place, &mut found);
        let stages = self.stages(model, method, place, &mut found);
        if !(1..=MOST_REPEATS).contains(&self.repeats) {
            let range = format!("1 to {MOST_REPEATS}");
            out_of_range(&place.key("repeats"), self.repeats as f64, &range, &mut found);
        }
        let runs = rungs.len().saturating_mul(stages.len());
        if runs > MOST_RUNS {
            let error = SpecificationError::new(place.to_string(), "too_many_runs", format!("{runs} runs"));
            found.push(error.expected(format!("at most {MOST_RUNS}")));
        }
        let exact = self.exact.as_ref().map(|exact| {
            let names = model.output_names();
            check_exact(exact, &names, (named, problem), &place.key("exact"), &mut found)
        });
        let plan = found.is_empty().then_some(StudyPlan { rungs, stages, repeats: self.repeats as usize, exact });
        errors.append(found);
        plan
    }

    fn rungs(&self, model: &dyn Model, time: Time, place: &Pointer<'_>, errors: &mut Errors) -> Vec<Rung> {
        let conflict = |detail: &str, expected: &str| {
            SpecificationError::new(place.to_string(), "conflict", detail).expected(expected)
        };
        match (&self.rtol, &self.step) {
            (Some(_), Some(_)) => errors.push(conflict("both `rtol` and `step` are given", "one of them")),
            (None, None) => errors.push(conflict("neither `rtol` nor `step` is given", "one of them")),
            (Some(_), None) if !model.varied().tolerance => {
                errors.push(conflict("rigid bodies are time-stepped with a fixed step, without a tolerance", "`step`"));
            }
            (Some(tolerances), None) => {
                let place = place.key("rtol");
                check_length(tolerances.len(), &place, errors);
                tolerances.iter().enumerate().for_each(|(i, rtol)| check_rtol(*rtol, &place.index(i), errors));
                return tolerances.iter().map(|rtol| Rung::Tolerance(*rtol)).collect();
            }
            (None, Some(steps)) => {
                let place = place.key("step");
                check_length(steps.len(), &place, errors);
                let horizon = Some(time.end - time.start);
                steps.iter().enumerate().for_each(|(i, step)| check_step(*step, horizon, &place.index(i), errors));
                return steps.iter().map(|step| Rung::Step(*step)).collect();
            }
        }
        Vec::new()
    }

    fn stages(&self, model: &dyn Model, method: &Method, place: &Pointer<'_>, errors: &mut Errors) -> Vec<Stages> {
        let Some(stages) = &self.stages else { return vec![method.stages] };
        let place = place.key("stages");
        check_length(stages.len(), &place, errors);
        let has_stages = match model.varied().stages {
            WithStages::Always => true,
            WithStages::Located => method.impacts != Some(Impacts::TimeStepping),
            WithStages::Never => false,
        };
        if !has_stages {
            let error =
                SpecificationError::new(place.to_string(), "conflict", "this problem is not solved by Radau IIA");
            errors.push(error.expected("`stages` to be left out"));
        }
        let fixed = self.step.is_some();
        stages.iter().enumerate().for_each(|(i, stages)| check_stages(*stages, fixed, &place.index(i), errors));
        stages.clone()
    }
}

fn check_length(length: usize, place: &Pointer<'_>, errors: &mut Errors) {
    if length == 0 {
        let error = SpecificationError::new(place.to_string(), "empty", "there is nothing to run");
        errors.push(error.expected("at least one value"));
    }
}

fn check_exact(
    exact: &Ordered<Expression>,
    names: &[String],
    (named, problem): (Named<'_>, &Pointer<'_>),
    place: &Pointer<'_>,
    errors: &mut Errors,
) -> Exact {
    // Errors in the parameters of the problem are reported when it is translated to its model.
    let control = Control::new();
    let mut lowering = Lowering::new(Start { time: None, control: &control, sizes: &[], varied: &[] }, named, problem);
    lowering.errors = Errors::default();
    let (mut fields, mut nodes) = (Vec::new(), Vec::new());
    for (name, value) in exact.iter() {
        let place = place.key(name);
        match names.iter().position(|known| known == name) {
            Some(field) => {
                fields.push(field);
                nodes.extend(lowering.node(value, &place));
            }
            None => {
                let detail = format!("`{}` is neither a state nor a variable", abridged(name));
                let error = SpecificationError::new(place.to_string(), "unknown_name", detail);
                let names = || names.iter().map(String::as_str);
                lowering.errors.push(error.expected(listed(names())).did_you_mean(nearest(name, names())));
            }
        }
    }
    check_length(exact.len(), place, &mut lowering.errors);
    errors.append(lowering.errors);
    Exact { fields, values: Tape::compile(&lowering.graph, &nodes) }
}

impl Specification {
    /// Returns this specification with the tolerance or step size `rung` and the number of stages `stages`, and with
    /// output of the columns `fields` at `times`.
    pub fn variant(&self, rung: Rung, stages: Stages, times: Vec<f64>, fields: Vec<usize>) -> Self {
        let mut variant = self.clone();
        let method = &mut variant.method;
        method.stages = stages;
        match rung {
            Rung::Tolerance(rtol) => {
                let ratio = rtol / method.rtol;
                (method.rtol, method.step) = (rtol, None);
                method.impacts = method.impacts.map(|_| Impacts::Locate);
                variant.absolute_tolerances.iter_mut().for_each(|atol| *atol *= ratio);
            }
            Rung::Step(step) => {
                method.step = Some(step);
                (method.first_step, method.min_step, method.max_step) = (None, None, None);
            }
        }
        variant.output_times = Some(times);
        variant.output_fields = fields;
        (variant.global_error, variant.study) = (false, None);
        variant
    }
}
