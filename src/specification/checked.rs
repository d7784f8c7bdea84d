//! A specification that has passed every check.

use super::digest::{Digest, digest, hexadecimal};
use super::document::{Document, Limits, Problem, Time};
use super::draft::Draft;
use super::error::{Errors, SpecificationError};
use super::json::Json;
use super::label;
use super::lowering::{Lowering, MOST_UNKNOWNS, Start};
use super::method::{Method, ViSolverName, out_of_range};
use super::model::{Model, Request};
use super::observables;
use super::output::{Columns, Output};
use super::plan::MOST_STEPS;
use super::pointer::Pointer;
use super::repairs::Repairs;
use super::search::{self, Search};
use super::study::StudyPlan;
use super::sweep::{Nameable, Prepared, SweepPlan};
use super::times::Times;
use super::units;
use super::varied::varied;
use super::vectors::Vectors;
use analysis::Analysis;
use models::rigid_bodies::Load;
use problem::{Control, ConvexSet};
use solution::{Observables, Provenance, Sensitivities, Warning};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A specification that has passed every check, translated to a model that can be solved any number of times.
#[derive(Clone, Debug)]
pub struct Specification {
    label: Option<String>,
    problem: &'static str,
    model: Arc<dyn Model>,
    time: Time,
    pub(super) method: Method,
    pub(super) absolute_tolerances: Vec<f64>,
    pub(super) output_times: Option<Vec<f64>>,
    pub(super) output_fields: Vec<usize>,
    pub(super) observables: Observables,
    pub(super) sensitivities: Option<Sensitivities>,
    search: Option<Search>,
    pub(super) global_error: bool,
    pub(super) study: Option<StudyPlan>,
    sweep: Option<SweepPlan>,
    /// Whether the solution keeps interpolants of its output fields, as functions of time.
    pub(super) keeps_interpolants: bool,
    limits: Limits,
    /// Estimate of the memory for the contacts of rigid bodies at the start.
    pub(super) load: Load,
    pub(super) most_memory: usize,
    analysis: Analysis,
    /// Warnings about a robot description: parts left out, and names changed.
    remarks: Vec<Warning>,
    /// Digest of the text of the document; `None` once other parameter values have been bound.
    digest: Option<Digest>,
}

/// The version of the specification language.
const VERSION: u64 = 1;

impl Specification {
    /// Reads and checks a JSON document.
    ///
    /// # Errors
    /// Every error in the document, at least one.
    pub fn from_json(text: &[u8]) -> Result<Self, Vec<SpecificationError>> {
        Self::from_json_with(text, &Control::new())
    }

    /// Reads and checks a JSON document, stopping early if `control` asks for it: a short document may describe a large
    /// grid.
    ///
    /// # Errors
    /// Every error in the document, at least one; or, if `control` asked to stop, the interruption alone
    /// ([`SpecificationError::is_interruption`]).
    pub fn from_json_with(text: &[u8], control: &Control) -> Result<Self, Vec<SpecificationError>> {
        Draft::read(text)?.check(control)
    }

    /// Checks the meaning of a document. Errors in parts of the document that were replaced or repaired while reading
    /// are not reported twice.
    pub(super) fn check(
        document: Document,
        (repairs, vectors, prepared): (&Repairs, &Vectors, &Prepared),
        most_memory: usize,
        control: &Control,
        errors: &mut Errors,
    ) -> Option<Self> {
        let Document {
            schema: _,
            version,
            problem,
            time,
            method,
            output,
            limits,
            stop,
            sensitivities,
            periodic,
            steady_state,
            sweep,
            fit,
            study,
            view,
            label,
        } = document;
        let mut found = Errors::default();
        let root = Pointer::Root;
        check_version(version, &root.key("version"), &mut found);
        let asked = search::Request { periodic: periodic.as_ref(), steady_state: steady_state.as_ref() };
        let of_problem = root.key("problem");
        let of_problem = of_problem.key(problem.name());
        let varied = varied(sensitivities.as_ref(), fit.as_ref(), &asked);
        let unread = Start { time: None, control, sizes: &vectors.sizes, varied: &varied };
        let is_static = problem.written().is_static();
        if time.is_some() && is_static {
            let error = SpecificationError::new("/time", "conflict", "a static problem has no time");
            found.push(error.expected("no `time`"));
        }
        // A static problem does not depend on time, so that any horizon will do.
        let time = if is_static { Some(Time { start: 0.0, end: 1.0 }) } else { time };
        if time.is_none() && asked.key().is_none() && !repairs.explain("/time") {
            let error = SpecificationError::new("", "missing_key", "`time` is missing");
            errors.push(error.expected("`time`, such as `{\"end\": 10}`"));
        }
        let time = asked.time(time, (problem.written().named(), &of_problem), unread, &mut found);
        let horizon = time.and_then(|time| check_time(time, &root.key("time"), &mut found));
        let horizon = horizon.filter(|_| !repairs.touch("/time"));
        let time_of_start = horizon.map(|time| time.start).filter(|_| !repairs.touch("/problem"));
        let start = Start { time: time_of_start, ..unread };
        let model = (!repairs.reshape("/problem")).then(|| lower(&problem, start, &mut found)).flatten();

        let place = root.key("method");
        method.check(&place, horizon.map(|time| time.end - time.start), &mut found);
        let place_of_output = root.key("output");
        let output_times = output.times(horizon, &place_of_output, &mut found);
        check_limits(limits, &root.key("limits"), &mut found);
        label::check(label.as_deref(), &root.key("label"), &mut found);
        let specification = model.and_then(|model| {
            let absolute_tolerances = method.absolute_tolerances(&model.state_names(), &place, &mut found);
            let names = model.output_names();
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let time = time?;
            let differentiated = sensitivities.is_some().then(|| model.state_names().len());
            let named = problem.written().named();
            let request = observables::Request { named, stop: &stop, view: view.as_ref(), differentiated };
            let are_inputs = model.parameters().is_some();
            let observables = request.lower(&names, are_inputs, (&of_problem, start), &mut found);
            let objective = sensitivities.as_ref().and_then(|asked| asked.objective.as_ref());
            let is_adjoint = objective.is_some();
            request.check(&*model, (output.global_error, study.is_some(), is_adjoint), &mut found);
            let objective = objective.and_then(|objective| {
                let states = model.state_names().len();
                request.lower_objective(objective, &names, (are_inputs, states), (&of_problem, start), &mut found)
            });
            let is_lowered = objective.is_some() == is_adjoint;
            // The parameters of a problem with errors are unknown: keys that name parameters are checked once the
            // problem has none.
            let is_read = found.is_empty() && errors.is_empty() || model.parameters().is_some();
            let sensitivities = sensitivities.filter(|_| is_read && is_lowered).and_then(|asked| {
                let of_model = (&*model, &observables, &method);
                asked.check(of_model, &root.key("sensitivities"), objective, &mut found)
            });
            let alone = [
                ("sensitivities", sensitivities.is_some()),
                ("study", study.is_some()),
                ("stop", stop.iter().any(|stop| !stop.record)),
                ("output.global_error", output.global_error),
            ];
            let beside = [&alone[..], &[("sweep", sweep.is_some())]].concat();
            let of_search = (problem.written().named(), &of_problem, start);
            let search =
                is_read.then(|| asked.check((&*model, &method, time), of_search, &beside, &mut found)).flatten();
            let analyses = [
                ("periodic", periodic.is_some()),
                ("steady_state", steady_state.is_some()),
                ("sweep", sweep.is_some()),
            ];
            let others = [&analyses[..], &alone].concat();
            let fit = fit
                .filter(|_| is_read)
                .and_then(|fit| fit.check((&*model, &method, &observables), time, &others, &mut found));
            let search = search.or(fit.map(|fit| Search::Fit(Arc::new(fit))));
            if study.is_some() && is_static {
                found.report(
                    &root.key("study"),
                    "conflict",
                    "a `study` compares runs over time, and a static problem has none",
                );
            }
            if study.is_some() && sensitivities.is_some() {
                let why = "a `study` compares several runs, and only one of them has derivatives";
                found.report(&root.key("sensitivities"), "conflict", why);
            }
            if is_adjoint && sweep.is_some() {
                let place = root.key("sensitivities");
                let detail = "a `sweep` collects columns, and adjoint mode has none";
                let error = SpecificationError::new(place.key("mode").to_string(), "conflict", detail);
                found.push(
                    error.expected("forward mode, whose derivatives `collect` names, such as `{\"final\": \"dx/dm\"}`"),
                );
            }
            if study.is_some() && sweep.is_some() {
                found.report(
                    &root.key("sweep"),
                    "conflict",
                    "a `study` compares runs of one problem; a `sweep` solves many",
                );
            }
            let derivatives = sensitivities.as_ref().map_or(&[][..], |sensitivities| &sensitivities.names);
            let default = model.default_outputs();
            let columns = Columns { outputs: &names, default, observables: &observables, derivatives };
            let output_fields = output.fields(&columns, &place_of_output, &mut found);
            if let Some(set) = model.set() {
                check_solver(set, method.vi_solver, &place, &mut found);
            }
            let mut lacks_plan = false;
            let sweep = match sweep {
                None => None,
                Some(asked) => {
                    let labels: Vec<String> =
                        observables.monitors.iter().map(|monitor| monitor.label.clone()).collect();
                    let states = model.state_names().len();
                    let of_events = model.dvi().map(|model| model.variable_names.as_slice());
                    let nameable = Nameable {
                        outputs: &names,
                        states,
                        named: problem.written().named(),
                        derivatives,
                        of_events,
                        labels: &labels,
                        are_inputs,
                    };
                    let horizon = (time.start, time.end);
                    let mut plan = asked.check(prepared, &nameable, horizon, (&of_problem, start), &mut found);
                    if let Some(plan) = &mut plan {
                        let kept = (columns.named(&output_fields), output_times.as_deref());
                        plan.keep(&asked, kept, search.is_some(), &mut found);
                    }
                    lacks_plan = plan.is_none();
                    plan
                }
            };
            let is_right = errors.is_empty() && found.is_empty() && !lacks_plan;
            let analysis = is_right.then(|| model.analyse(time.start))?;
            model.check_method(&Request { analysis: &analysis, method: &method, time }, &mut found);
            if let Some(why) = model.no_global_error().filter(|_| output.global_error) {
                found.report(&place_of_output.key("global_error"), "conflict", why);
            }
            let study = study.filter(|_| !is_static).and_then(|study| {
                let named = (problem.written().named(), &of_problem);
                study.check((&*model, &method, time), named, &root.key("study"), &mut found)
            });
            let load = model.load(most_memory, control);
            Some(Self {
                label,
                problem: problem.name(),
                model,
                time,
                method,
                absolute_tolerances,
                output_times,
                output_fields,
                observables,
                sensitivities,
                search,
                global_error: output.global_error,
                study,
                sweep,
                keeps_interpolants: false,
                limits,
                load,
                most_memory,
                analysis,
                remarks: vectors.robot.remarks.iter().map(|remark| remark_on_robot(remark)).collect(),
                digest: None,
            })
        });
        if control.poll().is_some() {
            errors.push(SpecificationError::new("", "interrupted", "the check was stopped before its end"));
        }
        found.retain(|pointer| !repairs.explain(pointer));
        errors.append(found);
        specification
    }

    /// Reads and checks the tree of a document in which the numbers named in `values` (parameters, initial values and
    /// other numbers that a sweep may vary) have been given new values.
    pub(super) fn from_tree(
        tree: Json,
        values: &[(String, f64)],
        control: &Control,
    ) -> Result<Self, Vec<SpecificationError>> {
        Draft::of_tree(tree, values)?.check(control)
    }

    /// Returns this specification with its model replaced by one with equal names of states and outputs; definitions,
    /// integrals and collected values are bound to the given parameter values.
    pub(super) fn with_model(&self, model: Arc<dyn Model>, parameters: &[f64], analysis: Analysis) -> Self {
        let mut bound = Self { model, analysis, digest: None, ..self.clone() };
        bound.observables.bind(parameters);
        if let Some(sweep) = &mut bound.sweep {
            sweep.reducers.program.bind(parameters);
        }
        bound
    }

    /// Limits the number of accepted steps of a run to at most `most`.
    #[must_use]
    pub fn within_steps(mut self, most: u64) -> Self {
        self.limits.steps = Some(self.step_limit().unwrap_or(MOST_STEPS).min(most));
        self
    }

    /// Returns this specification without its study and with the given output times, increasing and within the horizon,
    /// in place of its own.
    ///
    /// # Errors
    /// Every error in the times.
    pub fn reporting_at(&self, times: Vec<f64>) -> Result<Self, Vec<SpecificationError>> {
        let mut errors = Errors::default();
        let output = Output { times: Times::List(times), ..Output::default() };
        let output_times = output.times(Some(self.time), &Pointer::Root.key("output"), &mut errors);
        match errors.is_empty() {
            true => Ok(Self { output_times, study: None, ..self.clone() }),
            false => Err(errors.into_list()),
        }
    }

    /// Returns this specification without its study. Its solution keeps interpolants of the fields
    /// ([`solution::Dense`]), if the method has any. The run chooses its step sizes as a run with output times inside
    /// the steps does.
    #[must_use]
    pub fn keeping_interpolants(&self) -> Self {
        Self { keeps_interpolants: true, study: None, ..self.clone() }
    }

    pub(super) fn with_digest(self, digest: Option<Digest>) -> Self {
        Self { digest, ..self }
    }

    /// Records `text` as the source of this specification, for its digest.
    #[must_use]
    pub fn of_text(self, text: &[u8]) -> Self {
        self.with_digest(Some(digest(text)))
    }

    /// Provenance of an answer: the program, the problem, the tolerances and the digest of the specification.
    pub fn provenance(&self) -> Provenance {
        let atol = self.absolute_tolerances.first().copied();
        Provenance {
            program: concat!("dvi ", env!("CARGO_PKG_VERSION")).to_owned(),
            label: self.label.clone(),
            problem: self.problem.to_owned(),
            digest: self.digest.as_ref().map(|digest| hexadecimal(digest)),
            rtol: self.method.rtol,
            atol: atol.filter(|atol| self.absolute_tolerances.iter().all(|other| other == atol)),
            step: self.method.step,
            units: self.units(),
        }
    }

    /// Returns the units of time and of the kept fields, by name; empty if the problem type leaves units to the user.
    fn units(&self) -> BTreeMap<String, String> {
        let Some(of_time) = units::of_time(self.problem) else { return BTreeMap::new() };
        let names = self.model.output_names();
        let kept = self.output_fields.iter().filter_map(|&field| names.get(field));
        let units = kept.filter_map(|name| Some((name.as_str(), units::of_output(self.problem, name)?)));
        units.chain([("t", of_time)]).map(|(name, unit)| (name.to_owned(), unit.to_owned())).collect()
    }

    /// Returns a control that stops a solve at the wall-clock limit of the specification, counted from now.
    pub fn control(&self) -> Control {
        let allowed = self.wall_seconds().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let deadline = allowed.and_then(|allowed| Instant::now().checked_add(allowed));
        deadline.map_or_else(Control::new, Control::with_deadline)
    }

    /// The user's label of the specification, at most 200 characters.
    pub fn label(&self) -> Option<&str> {
        self.label.as_deref()
    }

    /// The key of the problem type in the specification, such as `dvi`.
    pub fn problem(&self) -> &'static str {
        self.problem
    }

    /// The problem as a model: its equations, names and initial values.
    pub fn model(&self) -> &dyn Model {
        &*self.model
    }

    /// Warnings from the reading of the specification and its translation to a model.
    pub fn warnings(&self) -> impl Iterator<Item = &Warning> {
        self.model.warnings().iter().chain(&self.remarks)
    }

    /// The structural analysis of the problem (index, uniqueness) at the start.
    pub fn analysis(&self) -> &Analysis {
        &self.analysis
    }

    /// The time horizon of the run; the end is after the start.
    pub fn time(&self) -> Time {
        self.time
    }

    /// The numerical method and its settings; every setting is in its admissible range.
    pub fn method(&self) -> &Method {
        &self.method
    }

    /// The absolute tolerance of each state, positive.
    pub fn absolute_tolerances(&self) -> &[f64] {
        &self.absolute_tolerances
    }

    /// The requested output times, increasing and within the horizon; `None` to report at every step.
    pub fn output_times(&self) -> Option<&[f64]> {
        self.output_times.as_deref()
    }

    /// The columns of the trajectory to keep, as indices into the outputs of the problem followed by definitions and
    /// integrals.
    pub fn output_fields(&self) -> &[usize] {
        &self.output_fields
    }

    /// The user-defined quantities of the problem: definitions, integrals and events.
    pub fn observables(&self) -> &Observables {
        &self.observables
    }

    /// The requested sensitivities: derivatives of outputs with respect to parameters and initial values.
    pub fn sensitivities(&self) -> Option<&Sensitivities> {
        self.sensitivities.as_ref()
    }

    /// The search (orbit, steady state or fit) that replaces a run over the horizon.
    pub fn search(&self) -> Option<&Search> {
        self.search.as_ref()
    }

    /// Whether to estimate the global error at the end time.
    pub fn estimates_global_error(&self) -> bool {
        self.global_error
    }

    /// The requested study of error against run time (work-precision study).
    pub fn study(&self) -> Option<&StudyPlan> {
        self.study.as_ref()
    }

    /// The requested parameter sweep.
    pub fn sweep(&self) -> Option<&SweepPlan> {
        self.sweep.as_ref()
    }

    pub(super) fn sweep_mut(&mut self) -> Option<&mut SweepPlan> {
        self.sweep.as_mut()
    }

    /// The wall-clock time that the user allows for a solve, in seconds.
    pub fn wall_seconds(&self) -> Option<f64> {
        self.limits.wall_seconds
    }

    /// The user's limit on the steps of a run, accepted and rejected together.
    pub fn step_limit(&self) -> Option<u64> {
        self.limits.steps
    }
}

fn remark_on_robot(remark: &str) -> Warning {
    Warning { code: "robot", message: remark.to_owned() }
}

/// Translates the problem from the user's notation to a model; errors are appended to `errors`.
fn lower(problem: &Problem, start: Start<'_>, errors: &mut Errors) -> Option<Arc<dyn Model>> {
    let place = Pointer::Root.key("problem");
    let problem = problem.written();
    let unknowns = problem.unknowns();
    let place = place.key(problem.key());
    if unknowns > MOST_UNKNOWNS {
        let error = SpecificationError::new(place.to_string(), "too_many_unknowns", format!("{unknowns} unknowns"));
        errors.push(error.expected(format!("at most {MOST_UNKNOWNS} states and variables")));
        return None;
    }
    let (Lowering { errors: found, .. }, model) = problem.lower(&place, start);
    errors.append(found);
    model
}

/// Checks that the time horizon is finite and its end after its start.
fn check_time(time: Time, place: &Pointer<'_>, errors: &mut Errors) -> Option<Time> {
    if time.end > time.start && (time.end - time.start).is_finite() {
        return Some(time);
    }
    let detail = format!("the end {} does not come after the start {}", time.end, time.start);
    let error = SpecificationError::new(place.key("end").to_string(), "end_before_start", detail);
    errors.push(error.expected(format!("a time above {}, a finite distance away", time.start)));
    None
}

fn check_limits(limits: Limits, place: &Pointer<'_>, errors: &mut Errors) {
    if let Some(seconds) = limits.wall_seconds.filter(|seconds| *seconds <= 0.0) {
        out_of_range(&place.key("wall_seconds"), seconds, "above 0", errors);
    }
    if let Some(steps) = limits.steps.filter(|steps| !(1..=MOST_STEPS).contains(steps)) {
        out_of_range(&place.key("steps"), steps as f64, &format!("1 to {MOST_STEPS}"), errors);
    }
}

fn check_solver(set: &ConvexSet, solver: ViSolverName, place: &Pointer<'_>, errors: &mut Errors) {
    if set.has_blocks() && !solver.takes_blocks() {
        let detail = "this solver is one for intervals, and the set binds variables together";
        errors.push(
            SpecificationError::new(place.key("vi_solver").to_string(), "unsuitable_solver", detail)
                .expected("\"auto\", \"semismooth_newton\", \"conic\" or \"block_gauss_seidel\""),
        );
    }
}

fn check_version(version: Option<u64>, place: &Pointer<'_>, errors: &mut Errors) {
    if let Some(version) = version.filter(|version| *version != VERSION) {
        let detail = format!("version {version} of the language of specifications is not known here");
        let error = SpecificationError::new(place.to_string(), "unknown_version", detail);
        errors.push(error.expected(format!("{VERSION}, or nothing")));
    }
}
