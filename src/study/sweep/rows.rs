//! Rows of the table of a sweep: members are solved one after the other on one thread.

use super::features;
use crate::solve::requested_end;
use problem::Control;
use solution::{
    CheckCode, Collected, Column, Counts, Lists, Plan, Reducers, Reduction, Solution, Status, Table, TableProvenance,
    Values, Words,
};
use specification::{Search, Specification, SpecificationError, SweepPlan};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Largest number of additional problems that are compiled in advance, for members whose values change the structure
/// of the equations.
const STRUCTURES: usize = 4;
/// Number of members whose equations are examined for a structure that differs from that of the specification.
const PROBES: usize = 32;
/// Largest number of characters of an error message in a row of the table of a sweep.
const ERROR: usize = 160;

/// Data that all members of a sweep share: compiled problems, reducers and columns of the table.
#[derive(Debug)]
pub struct Template<'s> {
    specification: &'s Specification,
    plan: &'s SweepPlan,
    reducers: Arc<Reducers>,
    /// The compiled problems: that of the specification, then variants with the other structures of equations found
    /// among the members.
    structures: Vec<Specification>,
    /// Code and message of the reason why no member of the sweep can be solved, if that is known in advance.
    lost: Option<(String, String)>,
    empty: Table,
}

/// Rows of the table of a sweep, under construction, for some of its members.
struct Rows {
    table: Table,
}

/// Code and message of the reason why a member of a sweep cannot be solved.
struct Refused {
    code: Cow<'static, str>,
    message: String,
}

impl<'s> Template<'s> {
    /// Compiles the problem, and variants of it for members whose values change the structure of the equations.
    pub fn new(specification: &'s Specification, control: &Control) -> Self {
        let plan = specification.sweep().expect("a sweep is asked for");
        let reducers = Arc::new(plan.reducers.clone());
        let empty = empty(specification, plan, &reducers);
        let (structures, lost) = (vec![specification.clone()], plan.chunk().lost);
        let mut template = Self { specification, plan, reducers, structures, lost, empty };
        if template.lost.is_none() {
            template.find_structures(control);
        }
        template
    }

    /// Returns the table of the sweep with all columns and no rows.
    pub fn empty(&self) -> Table {
        self.empty.clone()
    }

    /// Compiles a variant of the problem for each other structure of the equations that occurs in a sample of the
    /// members. The sample is fixed, so that every part of a sweep has equal variants.
    fn find_structures(&mut self, control: &Control) {
        if self.specification.model().parameters().is_none() {
            return;
        }
        let members = self.plan.members();
        let mut values = vec![0.0; self.plan.targets.len()];
        for probe in 0..PROBES.min(members) {
            if self.structures.len() > STRUCTURES || control.poll().is_some() {
                return;
            }
            let last = (members - 1) as u128;
            self.plan
                .design
                .write((probe as u128 * last / (PROBES.min(members).max(2) - 1) as u128) as usize, &mut values);
            if let Err(Unbound::Structure) = self.bind(&values)
                && let Ok(anew) = self.specification.member_anew(&values, control)
            {
                self.structures.push(anew);
            }
        }
    }

    /// Binds the parameter values of a member to the first of the compiled problems whose structure permits them.
    fn bind(&self, values: &[f64]) -> Result<Specification, Unbound> {
        let mut refused = Unbound::Structure;
        for structure in &self.structures {
            match structure.member(values) {
                Ok(bound) => return Ok(bound),
                Err(errors) if errors.iter().all(|error| ["structure_changes", "folded"].contains(&error.code)) => {}
                Err(errors) => refused = Unbound::Refused(errors),
            }
        }
        Err(refused)
    }

    fn member(&self, values: &[f64], control: &Control) -> Result<Specification, Refused> {
        if let Some((code, message)) = &self.lost {
            return Err(Refused { code: code.clone().into(), message: message.clone() });
        }
        if let Some(k) = values.iter().position(|value| !value.is_finite()) {
            let message = format!("`{}` is {}", self.plan.targets[k].name, values[k]);
            return Err(Refused { code: "not_finite".into(), message });
        }
        let errors = match self.bind(values) {
            Ok(bound) => return Ok(bound),
            Err(Unbound::Structure) => match self.specification.member_anew(values, control) {
                Ok(anew) => return Ok(anew),
                Err(errors) => errors,
            },
            Err(Unbound::Refused(errors)) => errors,
        };
        let first = errors.into_iter().next();
        Err(first.map_or(Refused { code: "defect".into(), message: String::new() }, |error| {
            let message = error.detail.lines().next().unwrap_or_default().to_owned();
            Refused { code: error.code.into(), message }
        }))
    }

    /// Returns the rows of `members`, which are solved one after the other; a member that `control` stopped has no
    /// row. `goes_on` receives the number of steps of each member, and returns whether to begin the next member.
    pub fn rows(&self, members: Range<usize>, control: &Control, mut goes_on: impl FnMut(u64) -> bool) -> Table {
        let mut rows = Rows { table: self.empty() };
        let mut values = vec![0.0; self.plan.targets.len()];
        for k in members {
            self.plan.design.write(k, &mut values);
            let row = self.member(&values, control).map(|member| {
                let plan = self.plan_of(&member);
                let mut solution = member.model().run(&member, &plan, control);
                solution.diagnostics.warnings.extend(member.warnings().cloned());
                solution.judge(requested_end(&member));
                solution
            });
            if control.poll().is_some() {
                return rows.table;
            }
            let steps = row.as_ref().map_or(0, |solution| solution.diagnostics.steps.accepted);
            rows.push(k, &values, row, &self.reducers);
            if !goes_on(steps) {
                break;
            }
        }
        rows.table
    }

    /// Returns the settings of a member's run. Unless the sweep keeps trajectories, the only output time is the end,
    /// at which the sensitivities are collected.
    fn plan_of(&self, member: &Specification) -> Plan {
        let mut plan = member.plan();
        if self.plan.kept.is_none() {
            plan.times = Some(vec![plan.end]);
            plan.fields = Vec::new();
        }
        // Take the reducers of the member and not those of the sweep: they have the parameter values of the member.
        plan.reducers = member.sweep().map(|sweep| Arc::new(sweep.reducers.clone()));
        plan
    }
}

/// Reason why the values of a member of a sweep cannot be bound to a compiled problem.
enum Unbound {
    /// The values change the structure of the equations of the compiled problem.
    Structure,
    /// The values are invalid, with the errors found.
    Refused(Vec<SpecificationError>),
}

impl Rows {
    fn push(&mut self, k: usize, values: &[f64], row: Result<Solution, Refused>, reducers: &Reducers) {
        let mut columns = self.table.columns.iter_mut().map(|column| &mut column.values);
        let mut number = |value: Option<f64>| {
            if let Some(column) = columns.next() {
                column.push_number(value);
            }
        };
        number(Some(k as f64));
        values.iter().for_each(|value| number(Some(*value)));
        let nothing;
        let collected = match &row {
            Ok(solution) => &solution.collected,
            Err(_) => {
                nothing = reducers.nothing();
                &nothing
            }
        };
        for value in collected {
            let Some(column) = columns.next() else { return };
            match value {
                Collected::Number(value) => column.push_number(*value),
                Collected::Count(count) => column.push_number(count.map(f64::from)),
                Collected::Word(word) => column.push_word(word.as_deref()),
            }
        }
        let solution = row.as_ref().ok();
        let is_completed = solution.is_some_and(|solution| solution.status == Status::Completed);
        self.table.failed += u64::from(!is_completed);
        let trusted = solution.is_some_and(|solution| solution.verdict.trusted);
        let status = match solution.map(|solution| solution.status) {
            Some(Status::Completed) => "completed",
            Some(Status::Stopped) => "stopped",
            Some(Status::Failed) | None => "failed",
        };
        let error = match &row {
            Ok(solution) => solution.error.as_ref().map(|error| (&*error.code, error.message.as_str())),
            Err(refused) => Some((&*refused.code, refused.message.as_str())),
        };
        let error = error.map(|(code, message)| format!("{code}: {message}").chars().take(ERROR).collect::<String>());
        let (steps, switches) =
            solution.map_or((0, 0), |solution| (solution.diagnostics.steps.accepted, solution.diagnostics.switches));
        let of_law = |solution: &Solution| solution.diagnostics.checks.get(CheckCode::LawResidual);
        let residual = solution.and_then(of_law).map(|(value, _)| value);
        let orbit = solution.and_then(|solution| solution.orbit.as_ref());
        let rest = solution.and_then(|solution| solution.steady_state.as_ref());
        let stable = match (orbit, rest) {
            (Some(orbit), _) => orbit.stable,
            (None, Some(rest)) => rest.stable,
            (None, None) => None,
        };
        let warnings = solution.map(warnings).filter(|warnings| !warnings.is_empty());
        let trajectory = solution.map(|solution| solution.trajectory.fields.as_slice()).unwrap_or_default();
        for column in columns.filter(|values| matches!(values, Values::Lists(_))).enumerate() {
            let (field, lists) = column;
            lists.push_list(trajectory.get(field).map(|field| field.values.as_slice()).unwrap_or_default());
        }
        let own = self.table.columns.len() - self.table.own();
        for Column { name, values } in &mut self.table.columns[own..] {
            match name.as_str() {
                "period" => values.push_number(orbit.map(|orbit| orbit.period)),
                "stable" => values.push_word(stable.map(|stable| if stable { "yes" } else { "no" })),
                "status" => values.push_word(Some(status)),
                "trusted" => values.push_number(Some(f64::from(u8::from(trusted)))),
                "error" => values.push_word(error.as_deref()),
                "steps" => values.push_number(Some(steps as f64)),
                "switches" => values.push_number(Some(switches as f64)),
                "residual" => values.push_number(residual),
                "warnings" => values.push_word(warnings.as_deref()),
                // All other columns of the table hold trajectories, and have been filled above.
                _ => {}
            }
        }
    }
}

/// Returns the codes of the verdict's reasons, the warnings and the caveats of a run, each once, joined by commas.
fn warnings(solution: &Solution) -> String {
    let mut codes: Vec<&str> = solution.verdict.because.iter().map(|reason| reason.code.name()).collect();
    codes.extend(solution.diagnostics.warnings.iter().map(|warning| warning.code));
    codes.extend(solution.verdict.caveats.iter().map(|caveat| caveat.code.as_str()));
    let mut told: Vec<&str> = Vec::with_capacity(codes.len());
    for code in codes {
        if !told.contains(&code) {
            told.push(code);
        }
    }
    told.join(",")
}

/// Returns the table of a sweep with all columns and no rows.
fn empty(specification: &Specification, plan: &SweepPlan, reducers: &Reducers) -> Table {
    let words = || Values::Words(Words::default());
    let mut columns = vec![("member", Values::Counts(Counts::default()))];
    columns.extend(plan.targets.iter().map(|target| (target.name.as_str(), Values::Numbers(Vec::new()))));
    for (name, reduction) in reducers.names.iter().zip(&reducers.reductions) {
        let values = match reduction {
            Reduction::Count(_) => Values::Counts(Counts::default()),
            Reduction::ModeWord => words(),
            _ => Values::Numbers(Vec::new()),
        };
        columns.push((name, values));
    }
    match specification.search() {
        Some(Search::Periodic(..)) => {
            columns.extend([("period", Values::Numbers(Vec::new())), ("stable", words())]);
        }
        Some(Search::SteadyState) => columns.push(("stable", words())),
        // A sweep cannot be combined with a fit or a branch.
        Some(Search::Fit(_) | Search::Branch(_)) | None => {}
    }
    columns.extend([
        ("status", words()),
        ("trusted", Values::Flags(Vec::new())),
        ("error", words()),
        ("steps", Values::Counts(Counts::default())),
        ("switches", Values::Counts(Counts::default())),
        ("residual", Values::Numbers(Vec::new())),
        ("warnings", words()),
    ]);
    let kept = plan.kept.as_deref();
    let of_trajectories: Vec<String> = kept.iter().flat_map(|kept| kept.columns()).collect();
    let length = kept.map_or(0, |kept| kept.times.len());
    columns.extend(of_trajectories.iter().map(|name| (name.as_str(), Values::Lists(Lists::new(length)))));
    Table {
        columns: columns.into_iter().map(|(name, values)| Column { name: name.to_owned(), values }).collect(),
        members: plan.members() as u64,
        failed: 0,
        swept: plan.targets.iter().map(|target| target.name.clone()).collect(),
        collected: reducers.names.clone(),
        times: kept.map_or_else(Vec::new, |kept| kept.times.clone()),
        provenance: TableProvenance {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            features: features(),
            digest: plan.digest.to_string(),
        },
    }
}
