//! Differential testing of derivatives: numbers in random problems become parameters, and the derivatives of all
//! fields by some of them, in forward and in adjoint mode, are compared with central differences of runs at a
//! tolerance that is ten thousand times tighter. A derivative is wrong if its error exceeds a hundred tolerances,
//! times the largest growth of a relative change; it is silently wrong if the verdict trusts it. Differences are
//! taken only if the events have one order for all changes of the parameter, and only if two differences, one with
//! twice the change, agree.

use super::problem::{Kind, Problem, View, generate};
use super::random::Random;
use dvi::problem::Control;
use dvi::solution::{Solution, Status};
use dvi::specification::Specification;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fmt::{Display, Formatter};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

/// The kinds of problems for which derivatives can be computed in both modes, forward and adjoint.
pub const KINDS: [Kind; 5] = [Kind::Complementarity, Kind::Circuit, Kind::Filippov, Kind::Sets, Kind::Mechanical];

/// Permitted error of a derivative in tolerances; it is multiplied by the growth of a relative change of the
/// parameter.
const TOLERANCES: f64 = 100.0;
/// Ratio of the tolerance of the runs with derivatives to that of the runs for central differences.
const TIGHTER: f64 = 1e4;
/// Tolerance at which forward and adjoint derivatives are compared with each other, and their permitted difference,
/// which is multiplied by the growth of a relative change of the parameter.
const EXACT: f64 = 1e-11;
const ALIKE: f64 = 1e-9;
/// Largest growth of a relative change of the parameter: problems with a larger one are not judged.
const MOST_GROWTH: f64 = 1e4;
/// Absolute tolerance of a field, relative to `rtol` and the scale of the problem.
const FLOOR: f64 = 1e-3;
/// Largest number of numbers of a problem that become parameters, and the number of parameters for which derivatives
/// are compared with central differences.
const PARAMETERS: usize = 5;
const DIFFERENCED: usize = 2;

/// A problem in which some numbers are replaced by named parameters.
struct Parametric {
    document: Value,
    values: Vec<f64>,
}

impl Parametric {
    fn new(problem: &dyn Problem, random: &mut Random) -> Self {
        let mut document = problem.document(&View::default());
        // Initial values of a system with joints do not become parameters, since they must satisfy the constraints.
        let is_held = problem.starts() == 0;
        let mut count = 0;
        visit(&mut document, is_held, &mut |_| {
            count += 1;
            None
        });
        let mut chosen: Vec<usize> = (0..PARAMETERS.min(count)).map(|_| random.whole(0, count - 1)).collect();
        chosen.sort_unstable();
        chosen.dedup();
        let (mut values, mut place) = (Vec::new(), 0);
        visit(&mut document, is_held, &mut |value| {
            let is_chosen = chosen.contains(&place);
            place += 1;
            is_chosen.then(|| {
                values.push(value);
                format!("par{}", values.len() - 1)
            })
        });
        Self { document, values }
    }

    fn names(&self) -> Vec<String> {
        (0..self.values.len()).map(|k| format!("par{k}")).collect()
    }

    /// Returns the document of the problem with the given parameter values and, if given, the integral of an expression
    /// as an additional field.
    fn with(&self, values: &[f64], integral: Option<&str>) -> Value {
        let mut document = self.document.clone();
        let parameters: Map<String, Value> =
            self.names().into_iter().zip(values.iter().map(|value| json!(value))).collect();
        for members in document.as_object_mut().expect("a problem").values_mut() {
            members["parameters"] = parameters.clone().into();
            if let Some(integral) = integral {
                members["integrals"] = json!({"total": integral});
            }
        }
        document
    }
}

/// Calls `name` for each number that may become a parameter, and replaces the number by the name that it returns.
fn visit(value: &mut Value, is_held: bool, name: &mut dyn FnMut(f64) -> Option<String>) {
    match value {
        Value::Number(number) => {
            let number = number.as_f64().unwrap_or(0.0);
            if number != 0.0
                && let Some(name) = name(number)
            {
                *value = name.into();
            }
        }
        Value::String(text) => {
            let (mut rest, mut written) = (text.clone(), String::new());
            while let Some((before, behind)) = rest.clone().split_once('(') {
                written.push_str(before);
                let end = behind.find(')').unwrap_or(0);
                let number = behind[..end].parse::<f64>().ok().filter(|number| *number != 0.0);
                match number.and_then(&mut *name) {
                    Some(name) => written.push_str(&name),
                    None => written.push_str(&format!("({}{}", &behind[..end], if end > 0 { ")" } else { "" })),
                }
                rest = behind[if end > 0 { end + 1 } else { 0 }..].to_owned();
            }
            written.push_str(&rest);
            *text = written;
        }
        Value::Array(entries) => entries.iter_mut().for_each(|entry| visit(entry, is_held, name)),
        Value::Object(members) => {
            for (key, member) in members {
                let is_start = matches!(key.as_str(), "initial" | "velocity" | "constraint");
                let is_name = matches!(key.as_str(), "name" | "nodes" | "of" | "slip" | "polyhedron");
                if !(is_name || is_held && is_start) {
                    visit(member, is_held, name);
                }
            }
        }
        _ => {}
    }
}

/// Judgement of the derivatives of a problem in one mode, forward or adjoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Finding {
    Right,
    /// The derivatives are right and not trusted.
    Alarm,
    /// The derivatives are wrong and trusted.
    Silent,
    Caught,
    /// There are no derivatives, and the error message says why.
    Refused,
    /// The run failed for a reason other than a missing derivative, or exceeded its time limit.
    Failed,
    /// The derivatives have no reference: the order of events changes with the parameter, the central differences do
    /// not agree, or changes of the parameter grow too much.
    Dropped,
}

/// Numbers of derivatives in a campaign, by kind of problem, mode and judgement.
#[derive(Debug, Default)]
pub struct Tally {
    counts: BTreeMap<(Kind, &'static str, Finding), u64>,
    reasons: BTreeMap<(Finding, String), (u64, Vec<String>)>,
    /// Largest difference between forward and adjoint derivatives that are both trusted, at the tolerance `EXACT`,
    /// relative to the size of the field and the growth of a relative change of the parameter.
    pub apart: f64,
    /// Problems whose forward and adjoint derivatives differ by more than is permitted, although both are trusted.
    pub unlike: Vec<String>,
}

impl Tally {
    fn note(&mut self, (kind, seed): (Kind, u64), mode: &'static str, finding: Finding, why: &str) {
        *self.counts.entry((kind, mode, finding)).or_default() += 1;
        if finding != Finding::Right {
            let (count, seeds) = self.reasons.entry((finding, why.to_owned())).or_default();
            *count += 1;
            if seeds.len() < 8 {
                seeds.push(format!("{} {seed} {mode}", kind.name()));
            }
        }
    }

    /// Returns the number of derivatives with the given judgement.
    pub fn of(&self, finding: Finding) -> u64 {
        self.counts.iter().filter(|((_, _, other), _)| *other == finding).map(|(_, count)| count).sum()
    }

    /// Returns the fraction of derivatives that have no reference.
    pub fn dropped(&self) -> f64 {
        self.of(Finding::Dropped) as f64 / self.counts.values().sum::<u64>().max(1) as f64
    }
}

impl Display for Tally {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        for ((kind, mode, finding), count) in &self.counts {
            writeln!(f, "{:16} {mode:8} {finding:?}: {count}", kind.name())?;
        }
        for finding in [
            Finding::Right,
            Finding::Alarm,
            Finding::Silent,
            Finding::Caught,
            Finding::Refused,
            Finding::Failed,
            Finding::Dropped,
        ] {
            writeln!(f, "all {finding:?}: {}", self.of(finding))?;
        }
        writeln!(f, "dropped: {:.1} %", 100.0 * self.dropped())?;
        for ((finding, why), (count, seeds)) in &self.reasons {
            writeln!(f, "  {finding:?}: {count} ({why}): {}", seeds.join(", "))?;
        }
        writeln!(f, "largest difference of both modes, as a part of size and growth: {:.1e}", self.apart)?;
        self.unlike.iter().try_for_each(|unlike| writeln!(f, "  unlike: {unlike}"))
    }
}

/// Compares derivatives of `count` random problems, whose seeds start at `first`.
pub fn run(count: u64, first: u64, kinds: &[Kind], time: Duration, threads: usize, tells: bool) -> Tally {
    let (next, tally) = (AtomicU64::new(0), Mutex::new(Tally::default()));
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let k = next.fetch_add(1, Relaxed);
                    if k >= count {
                        return;
                    }
                    let case = (kinds[(k % kinds.len() as u64) as usize], first + k);
                    judge(case, time, &tally, tells);
                }
            });
        }
    });
    tally.into_inner().expect("a tally")
}

/// Solves a specification. A failed run is returned as an error: its judgement, with the reason.
fn solve(document: &Value, time: Duration) -> Result<Solution, (Finding, String)> {
    let specification = Specification::from_json(document.to_string().as_bytes()).map_err(|errors| {
        let first = errors.first();
        (
            Finding::Failed,
            first.map_or(String::new(), |error| format!("specification: {} {}", error.pointer, error.code)),
        )
    })?;
    let solution = dvi::solve(&specification, &Control::with_deadline(Instant::now() + time));
    match (solution.status, &solution.error) {
        (Status::Completed, _) => Ok(solution),
        (_, Some(error)) if error.code == "no_derivative" => {
            // Take the reason from the error message, without the time at which derivatives end.
            let why = error.message.split_once(" from t = ").map_or("", |(_, why)| why);
            let why = why.split_once(": ").map_or("", |(_, why)| why);
            Err((Finding::Refused, why.split_once("; without").map_or(why, |(why, _)| why).to_owned()))
        }
        (_, error) => Err((Finding::Failed, error.as_ref().map_or(String::new(), |error| error.code.to_string()))),
    }
}

/// Final values of the fields of a run, their largest magnitudes, and the events without their times.
struct End {
    values: Vec<f64>,
    sizes: Vec<f64>,
    events: Vec<String>,
}

impl End {
    fn of(solution: &Solution, fields: &[String]) -> Self {
        let column = |name: &String| solution.trajectory.field(name).unwrap_or_else(|| panic!("no field `{name}`"));
        Self {
            values: fields.iter().map(|name| column(name).last().copied().unwrap_or(f64::NAN)).collect(),
            sizes: fields.iter().map(|name| column(name).iter().fold(0.0, |size: f64, x| size.max(x.abs()))).collect(),
            events: solution.trajectory.events.iter().map(|event| format!("{:?} {}", event.kind, event.of)).collect(),
        }
    }
}

fn exceeds(value: f64, most: f64) -> bool {
    value > most || value.is_nan()
}

/// Compares the derivatives of one problem, and records the judgements in `tally`.
fn judge(case: (Kind, u64), time: Duration, tally: &Mutex<Tally>, tells: bool) {
    let (kind, seed) = case;
    let problem = generate(kind, seed);
    let mut random = Random::new(seed ^ 0x0dd5_eed5);
    let rtol = random.scale(1e-8, 1e-5);
    let parametric = Parametric::new(problem.as_ref(), &mut random);
    let (names, values) = (parametric.names(), parametric.values.clone());
    let own = problem.fields();
    let of = random.whole(0, own.len() - 1);
    let integral = random.chance(0.4).then(|| format!("({})^2", own[of].name));
    let fields: Vec<String> =
        own.iter().map(|field| field.name.clone()).chain(integral.iter().map(|_| "total".to_owned())).collect();
    let objective = integral.as_ref().map_or_else(|| json!({"final": fields[of]}), |of| json!({"integral": of}));
    let target = if integral.is_some() { own.len() } else { of };
    let end = problem.end();
    let written = |values: &[f64], rtol: f64, sensitivities: Option<Value>, is_integral: bool| {
        let integral = integral.as_deref().filter(|_| is_integral);
        let floor = |time: i32| FLOOR * problem.smallest() * (0.1 * end).powi(time) * rtol;
        let atol: Map<String, Value> = own.iter().map(|field| (field.name.clone(), json!(floor(field.time)))).collect();
        let mut document = json!({"problem": parametric.with(values, integral), "time": {"end": end},
            "method": {"rtol": rtol, "atol": atol}});
        if kind == Kind::Mechanical {
            document["method"]["impacts"] = json!("locate");
        }
        if let Some(sensitivities) = sensitivities {
            document["sensitivities"] = sensitivities;
        }
        document
    };
    let forward = |rtol: f64| written(&values, rtol, Some(json!({"to": names, "of": fields})), true);
    let of_objective = json!({"to": names, "mode": "adjoint", "objective": objective});
    let adjoint = |rtol: f64| written(&values, rtol, Some(of_objective.clone()), false);
    let note = |mode, finding, why: &str| {
        tally.lock().expect("a tally").note(case, mode, finding, why);
        if tells && !matches!(finding, Finding::Right | Finding::Refused) {
            println!("{} {seed} {mode}: {finding:?} {why}", kind.name());
        }
    };
    let drop_both = |why: &str| ["forward", "adjoint"].into_iter().for_each(|mode| note(mode, Finding::Dropped, why));
    let [found, swept] = [forward(rtol), adjoint(rtol)].map(|document| solve(&document, time));
    let (found, swept) = match (found, swept) {
        (Ok(found), Ok(swept)) => (found, swept),
        (found, swept) => {
            for (mode, outcome) in [("forward", found.err()), ("adjoint", swept.err())] {
                match outcome {
                    Some((finding, why)) => note(mode, finding, &why),
                    None => note(mode, Finding::Dropped, "the other mode has no derivative"),
                }
            }
            return;
        }
    };
    let slope = |solution: &Solution, field: usize, by: usize| {
        let column = solution.trajectory.field(&format!("d{}/d{}", fields[field], names[by]));
        column.and_then(|column| column.last().copied()).unwrap_or(f64::NAN)
    };
    let here = End::of(&found, &fields);
    let size = |field: usize| here.sizes[field] + FLOOR * problem.smallest();
    let growth = |by: usize| {
        let of = |field: usize| (slope(&found, field, by) * values[by]).abs() / size(field);
        (0..fields.len()).map(of).fold(1.0, f64::max)
    };
    // Compare forward with adjoint derivatives at a tolerance so small that the difference between their step sequences
    // hardly matters.
    if let [Ok(forward), Ok(adjoint)] = [forward(EXACT), adjoint(EXACT)].map(|document| solve(&document, time)) {
        let is_trusted = forward.verdict.trusted && adjoint.verdict.trusted;
        for (by, name) in names.iter().enumerate().filter(|_| is_trusted) {
            let apart = (slope(&forward, target, by) - adjoint.gradient[name]).abs() * values[by].abs();
            let apart = apart / (size(target) * growth(by));
            let mut tally = tally.lock().expect("a tally");
            tally.apart = tally.apart.max(apart);
            if exceeds(apart, ALIKE) {
                let line = format!("{} {seed}: d{}/d{name} {apart:.1e}", kind.name(), fields[target]);
                tally.unlike.push(line);
            }
        }
    }
    let mut worst = [0.0_f64; 2];
    for (by, name) in names.iter().enumerate().take(DIFFERENCED) {
        let growth = growth(by);
        if exceeds(growth, MOST_GROWTH) {
            return drop_both("growth");
        }
        let tight = rtol / TIGHTER;
        let part = tight.cbrt() / growth;
        let moved = |multiple: f64| {
            let mut moved = values.clone();
            moved[by] *= 1.0 + multiple * part;
            solve(&written(&moved, tight, None, true), time).map(|solution| End::of(&solution, &fields))
        };
        let [Ok(above), Ok(below), Ok(far_above), Ok(far_below)] = [1.0, -1.0, 2.0, -2.0].map(moved) else {
            return drop_both("no difference");
        };
        if [&above, &far_above, &far_below].iter().any(|other| other.events != below.events) {
            return drop_both("order of events");
        }
        for field in 0..fields.len() {
            // Scale central differences to a change of the parameter by its own size.
            let near = (above.values[field] - below.values[field]) / (2.0 * part);
            let far = (far_above.values[field] - far_below.values[field]) / (4.0 * part);
            let allowed = TOLERANCES * rtol * growth * size(field);
            if exceeds((near - far).abs(), allowed) {
                return drop_both("differences do not agree");
            }
            let truth = (4.0 * near - far) / 3.0;
            let off = |slope: f64| ((slope * values[by] - truth) / allowed).abs();
            worst[0] = worst[0].max(off(slope(&found, field, by)));
            if field == target {
                worst[1] = worst[1].max(off(swept.gradient[name]));
            }
        }
    }
    for ((mode, solution), worst) in [("forward", &found), ("adjoint", &swept)].into_iter().zip(worst) {
        let verdict = &solution.verdict;
        let because = verdict.because.iter().map(|reason| reason.code.name()).collect::<Vec<_>>().join(" ");
        let finding = match (worst <= 1.0, verdict.trusted) {
            (true, true) => Finding::Right,
            (true, false) => Finding::Alarm,
            (false, true) => Finding::Silent,
            (false, false) => Finding::Caught,
        };
        if finding != Finding::Right && tells {
            let document = if mode == "forward" { forward(rtol) } else { adjoint(rtol) };
            let messages: Vec<&str> = verdict.because.iter().map(|reason| reason.message.as_str()).collect();
            println!("off by {worst:.1e} of the permitted; {}\n{document}", messages.join("; "));
        }
        note(mode, finding, &because);
    }
}
