//! Static variational inequalities: a solution with a certificate of uniqueness, or the reason why there is none.

use super::run::{Plan, Stepper, run};
use super::{CheckCode, Diagnostics, Event, Failure, Solution, Status, ViCounts};
use models::{Inequality, StaticModel};
use nalgebra::DMatrix;
use numerics::Interval;
use problem::{Control, ConvexSet, Workspace};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Instant;
use utoipa::ToSchema;
use vi::{
    AffineVi, Certificate, Found, MOST_VARIABLES, Outcome, Portfolio, SINGULAR, SolverKind, SparseVi, Terms, Worst,
    certificate, least_relative_eigenvalue, start,
};

/// Largest number of variables for which the problem is solved again from other starting points to find other
/// solutions (`MOST_SEARCHED`), and the number of these starting points (`SEARCHES`).
const MOST_SEARCHED: usize = 60;
const SEARCHES: usize = 8;
/// Distance between two solutions of a static problem, relative to the size of the variables, above which they count as
/// different.
const APART: f64 = 1e-4;
/// Distance from a solution along a direction at which another solution is searched for, relative to the size of the
/// solution: well above the distance of solutions that count as equal, and near enough for Newton's method to converge.
const ASIDE: f64 = 1e-2;
/// Displacement of a point, relative to the size of the variables, above which its equations do not determine it
/// (`FAR`); and the growth of a residual over this displacement if the equation does determine it (`GROWN`).
const FAR: f64 = 1e-2;
const GROWN: f64 = 2.0;
/// Largest number of variables that a message names.
const NAMED: usize = 6;
/// Relative rounding error of the eigenvalues of the symmetric part of a positive semidefinite matrix.
const ROUNDING: f64 = 1e-11;

/// The settings for solving a static problem.
#[derive(Clone, Copy, Debug)]
pub struct StaticPlan {
    /// The solver of the affine variational inequalities in each Newton step.
    pub kind: SolverKind,
    /// The tolerance of the residual of the natural map, relative to the terms of `G`.
    pub tolerance: f64,
}

/// The solution of a static variational inequality.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
#[expect(non_snake_case, reason = "the function goes by the name that it has in the formula")]
pub struct StaticSolution {
    /// The variables at the solution, by name.
    pub z: BTreeMap<String, f64>,
    /// `G` at the solution, by the variable that each component is paired with.
    pub G: BTreeMap<String, f64>,
    /// The residual `max |z - P_K(z - G)|` of the natural map.
    pub residual: f64,
    /// Whether the solution is the only one, locally unique or one of many, with the reason.
    pub certificate: String,
}

/// The solution of a static problem in the form of a run that is complete from the beginning.
struct Point<'a> {
    z: &'a [f64],
}

impl Stepper for Point<'_> {
    fn t(&self) -> f64 {
        0.0
    }

    fn is_done(&self) -> bool {
        true
    }

    fn accepted(&self) -> u64 {
        0
    }

    fn states(&self) -> &[f64] {
        &[]
    }

    fn step(&mut self) -> Result<(), Failure> {
        Ok(())
    }

    fn values(&mut self, _t: f64, out: &mut [f64]) {
        out.copy_from_slice(self.z);
    }

    fn take_events(&mut self, _events: &mut Vec<Event>) {}

    fn observe(&mut self, _switched: bool, _diagnostics: &mut Diagnostics) {}

    fn finish(&mut self, _diagnostics: &mut Diagnostics) {}
}

/// Returns the diagnostics of a static problem that are known before the solve.
pub fn describe_static(model: &StaticModel) -> Diagnostics {
    let mut diagnostics =
        Diagnostics { method: "josephy_newton", built: vec!["variational inequality"], ..Diagnostics::default() };
    diagnostics.left_out.push("time: the problem is static".to_owned());
    if model.equations.structure().constant_jacobian {
        diagnostics.left_out.push("new Jacobians: the problem is linear".to_owned());
    }
    diagnostics
}

/// Solves a static variational inequality.
pub fn solve_static(model: &StaticModel, plan: &Plan, asked: StaticPlan, control: &Control) -> Solution {
    let began = Instant::now();
    let mut problem = model.inequality();
    let mut z = model.start.clone();
    let mut portfolio = Portfolio::new(z.len(), asked.kind);
    let found = portfolio.solve(&mut problem, asked.tolerance, &mut z, control);
    let plan = Plan { times: Some(vec![plan.start]), ..plan.clone() };
    let mut solution = run(&plan, control, describe_static(model), || Ok(Point { z: &z }));
    let mut search = Search { model, problem, portfolio, asked, control };
    let at = search.at(&z);
    record(model, &z, &at, asked, found, &mut solution.diagnostics);
    let is_finite = at.g.iter().all(|g| g.is_finite());
    let is_solved = found.report.outcome == Outcome::Solved && is_finite && solution.status == Status::Completed;
    let undetermined = is_solved.then(|| search.undetermined(&z, &at)).flatten();
    if let Some(row) = undetermined {
        let message = format!(
            "no solution was found, nor a proof that there is none: the inequality of `{0}` nearly vanishes where the search ended, \
             with `{0}` = {1:e}, and keeps its sign around: it may vanish at infinity only",
            search.name(row),
            z[row]
        );
        let failure = Failure { code: "vi_unsolved".into(), message, time: plan.start, state: Vec::new() };
        (solution.status, solution.error) = (Status::Failed, Some(failure));
    } else if is_solved {
        let names = &model.equations.variable_names;
        let certificate = search.certify(&z, &at, &mut solution.diagnostics);
        let by_name = |values: &[f64]| names.iter().cloned().zip(values.iter().copied()).collect();
        solution.solution =
            Some(StaticSolution { z: by_name(&z), G: by_name(&at.g), residual: at.worst.largest, certificate });
    } else if solution.status == Status::Completed {
        let (status, code, message) = search.why_not(&at, found);
        let failure = Failure { code: code.into(), message, time: plan.start, state: Vec::new() };
        (solution.status, solution.error) = (status, Some(failure));
    }
    solution.diagnostics.wall_seconds = began.elapsed().as_secs_f64();
    solution
}

/// The values of `G` and its Jacobian at a point, with the residual of the natural map.
struct At {
    g: Vec<f64>,
    derivatives: Vec<f64>,
    terms: Terms,
    worst: Worst,
}

/// Adds the evidence for a solution of the static problem to the diagnostics.
fn record(model: &StaticModel, z: &[f64], at: &At, asked: StaticPlan, found: Found, diagnostics: &mut Diagnostics) {
    let set = &model.equations.structure().set;
    let solver = found.method;
    diagnostics.method = solver;
    diagnostics.newton_iterations = found.iterations as u64;
    let residual = at.worst.largest;
    let largest_residual = if residual.is_finite() { residual } else { f64::MAX };
    let solves = found.starts as u64 + 1;
    diagnostics.vi = Some(ViCounts { solver, solves, largest_residual, ..ViCounts::default() });
    let bounded: Vec<usize> = (0..z.len()).filter(|&k| !set.is_free(k) || set.block_of(k).is_some()).collect();
    if !bounded.is_empty() && residual.is_finite() {
        diagnostics.complementarity.get_or_insert_default().observe(set, &bounded, z, &at.g, false);
    }
    let Worst { component, residual, terms, .. } = at.worst;
    diagnostics.checks.record(CheckCode::LawResidual, residual, asked.tolerance * terms, || {
        let name = model.equations.variable_names.get(component).map_or("?", String::as_str);
        format!("the residual of the natural map is {residual:.1e} at `{name}`, where its terms are up to {terms:.1e}")
    });
}

/// The search for a solution of a static variational inequality, with its solvers.
struct Search<'a> {
    model: &'a StaticModel,
    problem: Inequality,
    portfolio: Portfolio,
    asked: StaticPlan,
    control: &'a Control,
}

impl Search<'_> {
    fn at(&mut self, z: &[f64]) -> At {
        let structure = self.model.equations.structure();
        let mut g = vec![0.0; z.len()];
        let mut derivatives = vec![0.0; structure.pattern.len()];
        self.problem.evaluate(z, &mut g);
        self.problem.derivatives(z, &mut derivatives);
        let entries = structure.pattern.iter().copied().zip(derivatives.iter().copied());
        let terms = Terms::of(&structure.set, (z, &g), entries);
        let worst = Worst::of(&structure.set, (z, &g), &terms);
        At { g, derivatives, terms, worst }
    }

    fn jacobian(&self, at: &At) -> DMatrix<f64> {
        let m = at.g.len();
        let mut matrix = DMatrix::zeros(m, m);
        for (&place, value) in self.model.equations.structure().pattern.iter().zip(&at.derivatives) {
            matrix[place] += value;
        }
        matrix
    }

    fn name(&self, i: usize) -> &str {
        self.model.equations.variable_names.get(i).map_or("?", String::as_str)
    }

    /// Returns a row `G_i` of `G` whose equation `G_i = 0` does not determine the point, if there is one. Its
    /// residual and rounding error, divided by the largest derivative, correspond to a large displacement of a
    /// variable, and the residual keeps its sign and size over this displacement. Such rows occur if a search ends
    /// near a zero at infinity.
    fn undetermined(&mut self, z: &[f64], at: &At) -> Option<usize> {
        let structure = self.model.equations.structure();
        let (set, pattern) = (&structure.set, &structure.pattern);
        let m = z.len();
        let points: Vec<Interval> = z.iter().map(|z| Interval::point(*z)).collect();
        let mut enclosed = vec![Interval::LINE; structure.rows()];
        if !self.problem.equations.enclose(Interval::point(0.0), &points, &mut enclosed) {
            return None;
        }
        let size = z.iter().chain(&self.model.start).fold(0.0_f64, |most, z| most.max(z.abs()));
        let size = if size > 0.0 { size } else { 1.0 };
        let steepest = self.steepest(at);
        let is_inside =
            |i: usize| set.block_of(i).is_none() && (z[i] - set.lower[i]).min(set.upper[i] - z[i]) > FAR * size;
        let off = |i: usize| at.g[i].abs() + enclosed[i].width();
        let is_open = |&i: &usize| is_inside(i) && off(i).is_finite() && off(i) > FAR * size * steepest[i];
        let open: Vec<usize> = (0..m).filter(is_open).collect();
        let mut g = vec![0.0; m];
        open.into_iter().find(|&row| {
            let columns = pattern.iter().filter(|(i, _)| *i == row).map(|(_, j)| *j);
            let beside = columns.flat_map(|j| [(j, FAR * size), (j, -FAR * size)]);
            let mut grows = |(j, by): (usize, f64)| {
                let mut moved = z.to_vec();
                moved[j] += by;
                self.problem.evaluate(&moved, &mut g);
                // If the residual of the equation at the displaced point is not finite, nothing is known about its size
                // there.
                !(g[row].abs() <= GROWN * off(row) && g[row] * at.g[row] >= 0.0)
            };
            !beside.into_iter().any(&mut grows)
        })
    }

    /// Returns in words the certificate of whether a solution is unique. If other solutions exist, also adds a caveat.
    fn certify(&mut self, z: &[f64], at: &At, diagnostics: &mut Diagnostics) -> String {
        let structure = self.model.equations.structure();
        let is_affine = structure.constant_jacobian;
        if z.len() > MOST_VARIABLES {
            let message = format!(
                "the problem has {} variables, and uniqueness is examined only up to {MOST_VARIABLES}",
                z.len()
            );
            diagnostics.checks.caveat("uniqueness_not_guaranteed", format!("uniqueness is not guaranteed: {message}"));
            return format!("a solution: {message}");
        }
        let found = certificate(&self.jacobian(at), is_affine, (z, &at.g), &at.terms.sizes, &structure.set);
        let told = match &found {
            Certificate::Unique(least) => {
                return format!(
                    "the only solution: G is affine and its matrix positive definite, with {least:.3e} the least eigenvalue of \
                     its symmetric part"
                );
            }
            Certificate::UniqueOfConvex => {
                return "the only solution: G is affine and its matrix positive semidefinite, so that solutions form a \
                        convex set, and this one is isolated"
                    .to_owned();
            }
            Certificate::Continuum(direction) => {
                let moves = self.listed(direction);
                let message = format!("there are infinitely many solutions near this one: change {moves} together");
                diagnostics.checks.caveat("many_solutions", message.clone());
                return format!("one of many: {message}");
            }
            Certificate::Isolated(_, 0, 0) => {
                "locally unique: all variables are at a bound, and no inequality is zero there".to_owned()
            }
            Certificate::Isolated(least, inside, undecided) => {
                let also =
                    if *undecided > 0 { format!(" and {undecided} at a bound with G = 0") } else { String::new() };
                format!(
                    "locally unique: the derivative with respect to the {inside} variables inside their \
                     intervals{also} is regular, with {least:.3e} its least singular value"
                )
            }
            Certificate::Singular(_) => format!("a solution: {SINGULAR}"),
            Certificate::Nothing(why) => format!("a solution: {why}"),
        };
        let along = if let Certificate::Singular(direction) = &found { direction.as_slice() } else { &[] };
        match self.another(z, at, along) {
            Some(other) => {
                let moved: Vec<f64> = other.iter().zip(z).map(|(other, z)| other - z).collect();
                let most = moved.iter().fold(0.0_f64, |most, moved| most.max(moved.abs()));
                let shown: Vec<String> = (0..z.len())
                    .filter(|&i| moved[i].abs() > APART * most.max(z[i].abs()))
                    .take(NAMED)
                    .map(|i| format!("`{}` = {:.6}", self.name(i), other[i]))
                    .collect();
                let message = format!("there is another solution, with {}", shown.join(", "));
                diagnostics.checks.caveat("many_solutions", message.clone());
                format!("{told}; {message}")
            }
            None => {
                let message = format!(
                    "uniqueness is not guaranteed: {told}; no other solution was found from other starting points"
                );
                diagnostics.checks.caveat("uniqueness_not_guaranteed", message);
                told
            }
        }
    }

    /// Returns, for messages, the names of the variables that change most along a direction of other solutions, with
    /// their changes relative to the largest.
    fn listed(&self, direction: &[f64]) -> String {
        let largest = direction.iter().fold(0.0_f64, |most, v| if v.abs() > most.abs() { *v } else { most });
        let mut moved: Vec<usize> =
            (0..direction.len()).filter(|&i| direction[i].abs() > APART * largest.abs()).collect();
        moved.sort_by(|a, b| direction[*b].abs().total_cmp(&direction[*a].abs()));
        let parts: Vec<String> =
            moved.iter().take(NAMED).map(|&i| format!("`{}` by {:.3}", self.name(i), direction[i] / largest)).collect();
        let more = if moved.len() > NAMED { format!(" and {} more", moved.len() - NAMED) } else { String::new() };
        format!("{}{more}", parts.join(", "))
    }

    /// Returns the largest magnitude of the derivatives in each row of the Jacobian of `G`.
    fn steepest(&self, at: &At) -> Vec<f64> {
        let mut steepest = vec![0.0_f64; at.g.len()];
        let entries = self.model.equations.structure().pattern.iter().zip(&at.derivatives);
        for (&(row, _), slope) in entries.filter(|((row, _), _)| *row < at.g.len()) {
            steepest[row] = steepest[row].max(slope.abs());
        }
        steepest
    }

    /// Returns the size of the variables: of their values, and of the changes that would reduce `G` to zero by its
    /// derivatives.
    fn size(&self, z: &[f64], at: &At) -> f64 {
        let steepest = self.steepest(at);
        let changes = at.g.iter().zip(&steepest).filter(|(_, slope)| **slope > 0.0).map(|(g, slope)| g.abs() / slope);
        let size = z.iter().map(|z| z.abs()).chain(changes).fold(0.0, f64::max);
        if size > 0.0 && size.is_finite() { size } else { 1.0 }
    }

    /// Searches for another solution of the static problem, on both sides along the direction `along` if it is not
    /// empty, and from other starting points.
    fn another(&mut self, z: &[f64], at: &At, along: &[f64]) -> Option<Vec<f64>> {
        let size = self.size(z, at);
        let length = along.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let set = self.problem.set();
        let aside = |part: f64| {
            let by = part * size / length;
            let mut other: Vec<f64> = z.iter().zip(along).map(|(z, v)| z + by * v).collect();
            set.project_all(&mut other, &mut Workspace::default());
            other
        };
        let elsewhere = |number: usize| {
            let mut other = z.to_vec();
            start(number, (z, size), set, &mut other);
            other
        };
        let mut starts = Vec::new();
        if length > 0.0 {
            starts.extend([ASIDE, -ASIDE].map(aside));
        }
        if z.len() <= MOST_SEARCHED {
            starts.extend((1..=SEARCHES).map(elsewhere));
        }
        for mut other in starts {
            if self.control.poll().is_some() {
                return None;
            }
            let found = self.portfolio.once(&mut self.problem, self.asked.tolerance, &mut other, self.control);
            let distance = other.iter().zip(z).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            if found.report.outcome == Outcome::Solved && distance > APART * size {
                return Some(other);
            }
        }
        None
    }

    /// Returns the reason why the static problem was not solved, with a proof of infeasibility if there is one.
    fn why_not(&mut self, at: &At, found: Found) -> (Status, &'static str, String) {
        if let Some(stop) = self.control.poll() {
            let (code, message) = match stop {
                problem::Stop::Cancelled => ("cancelled", "cancelled before a solution was found".to_owned()),
                problem::Stop::Deadline => {
                    ("wall_time", "the wall-clock limit was reached; allow more with limits.wall_seconds".to_owned())
                }
            };
            return (Status::Stopped, code, message);
        }
        if let Some(why) = self.impossible(at, found) {
            return (Status::Failed, "no_solution", format!("there is no solution: {why}"));
        }
        let broken = at.g.iter().position(|g| !g.is_finite());
        let message = match broken {
            Some(i) => format!(
                "the inequality of `{}` is not finite where the search ended: a division by zero, a function outside \
                 its domain, or a number too large; give `initial` values at which it is finite, or bounds within its \
                 domain",
                self.name(i)
            ),
            None => format!(
                "no solution was found, nor a proof that there is none: from {} starting points the residual decreased \
                 to {:.1e}, most of it in the inequality of `{}`. Give nearer `initial` values or bounds, or check the \
                 sign of the inequality",
                found.starts + 1,
                at.worst.largest,
                self.name(at.worst.component)
            ),
        };
        (Status::Failed, "vi_unsolved", message)
    }

    /// Returns a proof that the static problem has no solution, if there is one.
    fn impossible(&mut self, at: &At, found: Found) -> Option<String> {
        let structure = self.model.equations.structure();
        let set = &structure.set;
        let m = at.g.len();
        let ranges: Vec<Interval> = (0..m).map(|i| Interval::new(set.lower[i], set.upper[i])).collect();
        let mut enclosed = vec![Interval::LINE; structure.rows()];
        if self.problem.equations.enclose(Interval::point(0.0), &ranges, &mut enclosed) {
            for (i, range) in enclosed.iter().enumerate().take(m).filter(|(i, _)| set.block_of(*i).is_none()) {
                if let Some(side) = presses(*range, set, i) {
                    return Some(format!(
                        "the inequality of `{}` is {side} for all values of the variables",
                        self.name(i)
                    ));
                }
            }
        }
        if !structure.constant_jacobian || m > MOST_VARIABLES || m == 0 {
            return None;
        }
        let matrix = self.jacobian(at);
        let mut q = vec![0.0; m];
        self.problem.evaluate(&vec![0.0; m], &mut q);
        if let Some(i) = (AffineVi { matrix: &matrix, q: &q, set }).contradiction() {
            return Some(format!("the inequality of `{}` is violated for all values of the variables", self.name(i)));
        }
        (found.ray && least_relative_eigenvalue(&matrix) >= -ROUNDING * m as f64).then(|| {
            "G is affine and its matrix positive semidefinite, and the path of Lemke's method ends on a ray: its inequalities \
             contradict each other within the set"
                .to_owned()
        })
    }
}

/// Returns the sign of the inequality of variable `i` if it excludes a solution: negative without an upper bound on
/// the variable, or positive without a lower bound.
fn presses(range: Interval, set: &ConvexSet, i: usize) -> Option<&'static str> {
    if !range.defined || range.is_empty() {
        return None;
    }
    match () {
        () if range.hi < 0.0 && set.upper[i] == f64::INFINITY => Some("negative"),
        () if range.lo > 0.0 && set.lower[i] == f64::NEG_INFINITY => Some("positive"),
        () => None,
    }
}
