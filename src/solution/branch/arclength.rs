//! Pseudo-arclength continuation (Keller 1977; Allgower and Georg 2003, *Introduction to Numerical Continuation Methods*): the
//! solutions `(w, p)` of `n` equations `r(w, p) = 0` form a curve, which is followed by steps along its tangent `t`,
//!
//! ```text
//! (r_w r_p) t = 0, |t| = 1;    r(w, p) = 0,  <t, (w, p) - (w_0, p_0)> = ds
//! ```
//!
//! so that the curve may turn back in `p`. A test function of the points whose sign changes between two successive
//! points is located by the step size `ds` from the first point, with the point solved anew in each iteration. Where
//! the structure of the solution changes (its type `Word`: the active faces, or the sequence of events in a period),
//! steps are halved until the border is known to the shortest step, and the branch continues behind the border if
//! there is a solution.

use crate::Failure;
use factorisation::Singular;
use nalgebra::{DMatrix, DVector};
use numerics::Bracket;

/// First, longest and shortest step along a branch of solutions, in units of the parameter interval or of the sizes of
/// the unknowns; borders (changes of the structure of the solution) are located to the shortest step.
const FIRST: f64 = 0.02;
const LONGEST: f64 = 0.05;
const SHORTEST: f64 = 1e-9;
/// Length of the first continuation step behind a border between two structures of the solution.
const AGAIN: f64 = 1e-3;
/// Growth factor of a step along the branch (`GROWTH`) after `STREAK` successive steps with at most `FEW` Newton
/// corrections each: near a border between two structures, steps that do not grow immediately halve the distance to it.
const GROWTH: f64 = 1.5;
const STREAK: usize = 3;
const FEW: usize = 4;
/// Largest number of Newton corrections of one point of the branch.
const CORRECTIONS: usize = 8;
/// Least cosine of the angles between the tangents at successive points of the branch and their chord: a sharper turn
/// needs shorter steps, and so does a jump to another piece of the curve that is nearly parallel.
const LEAST_COSINE: f64 = 0.9;
/// Largest number of iterations in which an event on the branch is located (`TRIALS`), and the width of the interval
/// to which it is located, relative to the step along the branch.
const TRIALS: usize = 60;
const WIDTH: f64 = 1e-9;
/// Largest distance of a point of the branch from the plane at the distance `ds` along the tangent in which Newton's
/// method seeks it, relative to `ds`.
const ON_PLANE: f64 = 1e-3;
/// Singular values of the Jacobian below this fraction of the largest count as zero, as in the search for a single
/// orbit.
const RANK: f64 = 1e-8;
/// Distance behind a border (a change of the structure of the solution) at which the continuation of the branch is
/// sought, in units of the parameter interval.
const BEHIND: f64 = 1e-4;

/// The equations of a family of solutions and their derivatives at one point.
pub struct Evaluation<W> {
    /// The residuals of the equations, in units of their tolerances.
    pub residual: DVector<f64>,
    /// The derivatives of the residuals with respect to `w` and `p`, `n` rows and `n + 1` columns, in the units of
    /// `w` and `p`.
    pub jacobian: DMatrix<f64>,
    /// The structure of the solution, which is constant along a smooth piece of the branch.
    pub word: W,
    /// The eigenvalues of a steady state or the multipliers of an orbit, as `[re, im]`, by which bifurcations are
    /// found.
    pub spectrum: Vec<[f64; 2]>,
    /// Whether the point solves the problem itself, and not only the equations of its structure (active face or
    /// sequence of events).
    pub is_admissible: bool,
    /// Whether the solution at this parameter is isolated, according to its eigenvalues or multipliers.
    pub is_single: bool,
}

/// A family of solutions, given by equations `r(w, p) = 0` for the unknowns `w` with a parameter `p`.
pub trait Family {
    /// The structure of a solution: the active face of a steady state, or the sequence of events of an orbit.
    type Word: Clone + PartialEq;

    /// Evaluates the equations, with the structure of a nearby solution if they need one.
    ///
    /// # Errors
    /// The reason why the equations have no value or no derivative.
    fn evaluate(&mut self, w: &[f64], p: f64, near: Option<&Self::Word>) -> Result<Evaluation<Self::Word>, Failure>;

    /// Returns a solution with another structure than that of `at`, the last point before a border: one at or
    /// slightly behind the border, near the unknowns `towards` and the parameter `p`.
    fn beyond(&mut self, at: &Solved<Self::Word>, towards: &[f64], p: f64) -> Option<(Vec<f64>, f64, Self::Word)>;

    /// Returns the solution `_at` in terms of other unknowns if these suit it better, such as the states at another
    /// point of a periodic orbit. `_way`, a change of the unknowns and of the parameter along the branch, is
    /// converted too.
    fn by_others(&mut self, _at: &Solved<Self::Word>, _way: (&[f64], f64)) -> Option<ByOthers<Self::Word>> {
        None
    }

    /// Records a point that has been added to the branch.
    fn accept(&mut self, _point: &Solved<Self::Word>) {}

    /// Whether a stop of the continuation is requested.
    fn is_stopped(&self) -> bool;
}

/// A solution of the family in terms of other unknowns, such as the states at another point of a periodic orbit.
pub struct ByOthers<W> {
    pub w: Vec<f64>,
    /// The change of the new unknowns along the branch.
    pub change: Vec<f64>,
    pub word: W,
}

/// A point of the branch that satisfies the equations.
#[derive(Clone, Debug)]
pub struct Solved<W> {
    pub w: Vec<f64>,
    pub p: f64,
    /// The unit tangent of the branch, in units of the sizes of the unknowns and of the parameter interval.
    pub tangent: DVector<f64>,
    pub word: W,
    pub spectrum: Vec<[f64; 2]>,
    /// Whether the branch is isolated at this point, without a family of other solutions beside it.
    pub is_single: bool,
}

/// A test function of the spectrum and the tangent at a point of the branch, whose changes of sign are events.
pub type Test = fn(&[[f64; 2]], &DVector<f64>) -> f64;

/// An event on a branch of solutions, such as a bifurcation or a change of structure.
#[derive(Clone, Debug)]
pub struct Found<W> {
    pub at: Solved<W>,
    /// The index of the last point of the branch before the event.
    pub after: usize,
    pub what: What<W>,
}

/// The kind of an event on a branch of solutions.
#[derive(Clone, Debug)]
pub enum What<W> {
    /// A test function, given by its index, changed sign.
    Test(usize),
    /// The structure of the solution changed; the new structure, if one was found.
    Border(Option<W>),
}

/// The branch of solutions that was followed, with its events.
pub struct Curve<W> {
    pub points: Vec<Solved<W>>,
    pub events: Vec<Found<W>>,
    /// The reason why the branch ends before the end of the parameter interval; `None` if it reaches the end.
    pub ended: Option<Failure>,
}

impl<W> Curve<W> {
    /// Returns a message about points of the branch whose solutions are not isolated, if there are any.
    pub fn doubt(&self, name: &str, what: &str) -> Option<String> {
        let count = self.points.iter().filter(|point| !point.is_single).count();
        let first = self.points.iter().find(|point| !point.is_single)?;
        Some(format!(
            "{count} of the {} points of the branch, the first where `{name}` is {:?}, are one each of many {what} that lie side \
             by side; folds and other events are not looked for among them",
            self.points.len(),
            first.p
        ))
    }
}

/// The interval of the continuation parameter, and the sizes of the unknowns.
pub struct Scales {
    pub from: f64,
    pub to: f64,
    pub unknowns: Vec<f64>,
}

impl Scales {
    fn of(&self, column: usize) -> f64 {
        self.unknowns.get(column).copied().unwrap_or((self.to - self.from).abs())
    }

    /// Returns the fraction of the parameter interval between its beginning and `p`.
    fn passed(&self, p: f64) -> f64 {
        (p - self.from) / (self.to - self.from)
    }
}

/// The pseudo-arclength continuation of a branch of solutions of a family of equations.
pub struct Continuation<'f, F: Family> {
    family: &'f mut F,
    scales: Scales,
    tests: &'f [Test],
}

impl<'f, F: Family> Continuation<'f, F> {
    pub fn new(family: &'f mut F, scales: Scales, tests: &'f [Test]) -> Self {
        Self { family, scales, tests }
    }

    /// Follows the branch from a point near `w` at the beginning of the parameter interval, over at most `most`
    /// points.
    ///
    /// # Errors
    /// The reason why there is no first point.
    pub fn follow(&mut self, w: &[f64], most: usize) -> Result<Curve<F::Word>, Failure> {
        let n = w.len();
        let mut ahead = DVector::zeros(n + 1);
        ahead[n] = 1.0;
        let from = self.scales.from;
        let first = self.correct((w, from), (w, from), &ahead, 0.0, None)?.0;
        let mut curve = Curve { points: Vec::new(), events: Vec::new(), ended: None };
        self.append(first, &mut curve);
        let (mut ds, mut streak) = (FIRST, 0);
        let (mut why, mut other) = (None, None);
        while curve.points.len() < most {
            let Some(last) = curve.points.last().cloned() else { break };
            if self.family.is_stopped() {
                curve.ended = Some(stopped(&last));
                return Ok(curve);
            }
            // In units of the parameter interval the parameter goes from 0 to 1; a branch that turns may return to its
            // beginning.
            let (passed, along) = (self.scales.passed(last.p), last.tangent[n]);
            let end = if along > 0.0 { 1.0 } else { 0.0 };
            let left = (end - passed) / along;
            if curve.points.len() > 1 && left.abs() <= SHORTEST {
                curve.ended = (end == 0.0).then(|| came_back(&last));
                return Ok(curve);
            }
            let is_last = along != 0.0 && ds >= left;
            let step = if is_last { left } else { ds };
            let made = if is_last { self.last_step(&last, step, end) } else { self.step(&last, step) };
            match made {
                Ok((next, corrections)) if next.word == last.word => {
                    let way = self.way(&last, &next);
                    let chord = &way / way.norm();
                    let cosines = [next.tangent.dot(&last.tangent), chord.dot(&last.tangent), chord.dot(&next.tangent)];
                    if cosines.iter().any(|cosine| *cosine < LEAST_COSINE) && step > 1e3 * SHORTEST {
                        (ds, streak) = (0.5 * step, 0);
                        continue;
                    }
                    self.locate((&last, &next), step, &mut curve);
                    self.append(next, &mut curve);
                    streak += 1;
                    if streak >= STREAK && corrections <= FEW {
                        ds = (GROWTH * ds).min(LONGEST);
                    }
                }
                outcome => {
                    match outcome {
                        Ok((point, _)) => other = Some(point.word),
                        Err(failure) => why = Some(failure),
                    }
                    (ds, streak) = (0.5 * step, 0);
                    if step > SHORTEST {
                        continue;
                    }
                    if !self.cross(&last, other.take(), &mut curve) {
                        curve.ended = Some(why.unwrap_or_else(|| ended(&last)));
                        return Ok(curve);
                    }
                    (ds, why) = (AGAIN, None);
                }
            }
        }
        curve.ended = curve.points.last().filter(|last| !self.is_at_end(last)).map(|last| too_many(last, most));
        Ok(curve)
    }

    /// Whether a point of the branch is at the end of the parameter interval towards which its tangent leads.
    fn is_at_end(&self, point: &Solved<F::Word>) -> bool {
        let end = if point.tangent[point.w.len()] > 0.0 { 1.0 } else { 0.0 };
        (self.scales.passed(point.p) - end).abs() <= SHORTEST
    }

    /// Makes a continuation step of length `ds` along the tangent; returns the point and the number of its Newton
    /// corrections.
    fn step(&mut self, last: &Solved<F::Word>, ds: f64) -> Result<(Solved<F::Word>, usize), Failure> {
        let n = last.w.len();
        let w: Vec<f64> = (0..n).map(|i| last.w[i] + ds * last.tangent[i] * self.scales.of(i)).collect();
        let p = last.p + ds * last.tangent[n] * self.scales.of(n) * self.direction();
        self.correct((&w, p), (&last.w, last.p), &last.tangent, ds, Some(&last.word))
    }

    /// Makes a continuation step to an end of the parameter interval, where the parameter is fixed.
    fn last_step(&mut self, last: &Solved<F::Word>, ds: f64, end: f64) -> Result<(Solved<F::Word>, usize), Failure> {
        let n = last.w.len();
        let w: Vec<f64> = (0..n).map(|i| last.w[i] + ds * last.tangent[i] * self.scales.of(i)).collect();
        let p = if end > 0.0 { self.scales.to } else { self.scales.from };
        let mut at_fixed = DVector::zeros(n + 1);
        at_fixed[n] = 1.0;
        let (mut point, corrections) = self.correct((&w, p), (&w, p), &at_fixed, 0.0, Some(&last.word))?;
        if point.tangent.dot(&last.tangent) < 0.0 {
            point.tangent = -point.tangent;
        }
        Ok((point, corrections))
    }

    /// Returns the difference of two points of the branch, in the units of tangents.
    fn way(&self, last: &Solved<F::Word>, next: &Solved<F::Word>) -> DVector<f64> {
        let n = last.w.len();
        let along = (next.p - last.p) / self.scales.of(n) * self.direction();
        let changes = (0..n).map(|i| (next.w[i] - last.w[i]) / self.scales.of(i));
        DVector::from_iterator(n + 1, changes.chain([along]))
    }

    fn append(&mut self, point: Solved<F::Word>, curve: &mut Curve<F::Word>) {
        self.family.accept(&point);
        curve.points.push(self.by_best(point));
    }

    /// Expresses a point of the branch in terms of those unknowns that suit it best, such as the states at another
    /// point of a periodic orbit.
    fn by_best(&mut self, point: Solved<F::Word>) -> Solved<F::Word> {
        let n = point.w.len();
        let way: Vec<f64> = (0..n).map(|i| point.tangent[i] * self.scales.of(i)).collect();
        let by_p = point.tangent[n] * self.scales.of(n) * self.direction();
        let Some(ByOthers { w, change, word }) = self.family.by_others(&point, (&way, by_p)) else { return point };
        let changes = change.iter().enumerate().map(|(i, change)| change / self.scales.of(i));
        let along = DVector::from_iterator(n + 1, changes.chain([point.tangent[n]]));
        let tangent = &along / along.norm();
        let made = self.correct((&w, point.p), (&w, point.p), &tangent, 0.0, Some(&word));
        made.ok().filter(|(made, _)| made.word == word).map_or(point, |(made, _)| made)
    }

    /// Returns the sign of the direction from the beginning to the end of the parameter interval.
    fn direction(&self) -> f64 {
        (self.scales.to - self.scales.from).signum()
    }

    /// Solves by Newton's method for the point of the branch at the distance `ds` from `origin` along `tangent`.
    fn correct(
        &mut self,
        (w, p): (&[f64], f64),
        origin: (&[f64], f64),
        tangent: &DVector<f64>,
        ds: f64,
        near: Option<&F::Word>,
    ) -> Result<(Solved<F::Word>, usize), Failure> {
        let n = w.len();
        let (mut w, mut p) = (w.to_vec(), p);
        let mut before = f64::INFINITY;
        for correction in 0..=CORRECTIONS {
            let evaluation = self.family.evaluate(&w, p, near)?;
            let distance = evaluation.residual.amax();
            let bordered = self.bordered(&evaluation.jacobian, tangent);
            let along: f64 = (0..n).map(|i| tangent[i] * (w[i] - origin.0[i]) / self.scales.of(i)).sum::<f64>()
                + tangent[n] * (p - origin.1) / self.scales.of(n) * self.direction();
            let off = ds - along;
            let is_on_plane = off.abs() <= ON_PLANE * ds.max(SHORTEST);
            if distance <= 1.0 && (is_on_plane || correction == CORRECTIONS) {
                if !evaluation.is_admissible {
                    return Err(inadmissible(&w, p));
                }
                let mut unit = DVector::zeros(n + 1);
                unit[n] = 1.0;
                let (direction, is_regular) = solve(bordered, &unit).ok_or_else(|| singular(&w, p))?;
                let tangent = &direction / direction.norm();
                let Evaluation { word, spectrum, is_single, .. } = evaluation;
                let is_single = is_single && is_regular;
                return Ok((Solved { w, p, tangent, word, spectrum, is_single }, correction));
            }
            if correction == CORRECTIONS || !distance.is_finite() || distance > 1e3 * before.max(1e3) {
                break;
            }
            before = distance;
            let mut right = DVector::zeros(n + 1);
            right.rows_mut(0, n).copy_from(&-&evaluation.residual);
            right[n] = off;
            let (change, _) = solve(bordered, &right).ok_or_else(|| singular(&w, p))?;
            (0..n).for_each(|i| w[i] += change[i] * self.scales.of(i));
            p += change[n] * self.scales.of(n) * self.direction();
        }
        Err(unsolved(&w, p))
    }

    /// Returns the Jacobian of the equations with respect to unknowns in units of their sizes, bordered by the tangent
    /// as the last row.
    fn bordered(&self, jacobian: &DMatrix<f64>, tangent: &DVector<f64>) -> DMatrix<f64> {
        let n = jacobian.nrows();
        let mut matrix = DMatrix::zeros(n + 1, n + 1);
        for column in 0..=n {
            let scale = self.scales.of(column) * if column == n { self.direction() } else { 1.0 };
            matrix.view_mut((0, column), (n, 1)).copy_from(&(jacobian.column(column) * scale));
        }
        matrix.row_mut(n).copy_from(&tangent.transpose());
        matrix
    }

    /// Locates the sign changes of the test functions between two successive points of the branch.
    fn locate(&mut self, (last, next): (&Solved<F::Word>, &Solved<F::Word>), ds: f64, curve: &mut Curve<F::Word>) {
        // Where solutions are not isolated, the test functions are meaningless.
        if !(last.is_single && next.is_single) {
            return;
        }
        let after = curve.points.len() - 1;
        for (number, test) in self.tests.iter().enumerate() {
            let value = |point: &Solved<F::Word>| test(&point.spectrum, &point.tangent);
            let (before, behind) = (value(last), value(next));
            if !(before.is_finite() && behind.is_finite()) || before == 0.0 || before.signum() == behind.signum() {
                continue;
            }
            // The bracketing root finder expects a function that falls from positive to negative values: the sign of
            // the test function is changed if it rises.
            let sign = before.signum();
            let mut bracket = Bracket::new((0.0, sign * before), (ds, sign * behind));
            let mut best = next.clone();
            for _ in 0..TRIALS {
                if bracket.width() <= WIDTH * ds {
                    break;
                }
                let trial = bracket.guess();
                let (a, b) = (bracket.before.0, bracket.behind.0);
                let trial = if trial > a && trial < b { trial } else { 0.5 * (a + b) };
                let Ok((point, _)) = self.step(last, trial) else { break };
                let found = sign * value(&point);
                best = point;
                if found == 0.0 || !found.is_finite() {
                    break;
                }
                bracket.narrow(trial, found);
            }
            curve.events.push(Found { at: best, after, what: What::Test(number) });
        }
    }

    /// Continues the branch behind a border (a change of the structure of the solution) if a solution exists there;
    /// returns whether it does.
    fn cross(&mut self, last: &Solved<F::Word>, other: Option<F::Word>, curve: &mut Curve<F::Word>) -> bool {
        let n = last.w.len();
        let ahead: Vec<f64> = (0..n).map(|i| last.tangent[i] * self.scales.of(i)).collect();
        let by_p = last.tangent[n] * self.scales.of(n) * self.direction();
        let behind: Vec<f64> = (0..n).map(|i| last.w[i] + BEHIND * ahead[i]).collect();
        let found = self.family.beyond(last, &behind, last.p + BEHIND * by_p);
        let next = found.and_then(|(w, p, word)| self.first_behind(last, (&w, p), &word));
        let what = What::Border(next.as_ref().map(|point| point.word.clone()).or(other));
        curve.events.push(Found { at: last.clone(), after: curve.points.len() - 1, what });
        let goes_on = next.is_some();
        if let Some(next) = next {
            self.append(next, curve);
        }
        goes_on
    }
}

impl<F: Family> Continuation<'_, F> {
    /// Returns the first point of the branch behind a border, with its tangent in the direction in which the branch
    /// continues.
    fn first_behind(
        &mut self,
        last: &Solved<F::Word>,
        (w, p): (&[f64], f64),
        word: &F::Word,
    ) -> Option<Solved<F::Word>> {
        let n = w.len();
        let mut at_fixed = DVector::zeros(n + 1);
        at_fixed[n] = 1.0;
        let (mut point, _) = self.correct((w, p), (w, p), &at_fixed, 0.0, Some(word)).ok()?;
        if self.way(last, &point).dot(&point.tangent) < 0.0 {
            point.tangent = -point.tangent;
        }
        // The tangent may have the wrong sign: the branch continues in that of the two directions in which a step
        // leads to a solution with the structure `word`.
        for _ in 0..2 {
            if self.step(&point, AGAIN).is_ok_and(|(next, _)| next.word == point.word) {
                return Some(point);
            }
            point.tangent = -point.tangent;
        }
        None
    }
}

/// Solves a square system of linear equations, by the solution of least norm if it is singular; returns the solution
/// and whether the system is regular.
fn solve(matrix: DMatrix<f64>, right: &DVector<f64>) -> Option<(DVector<f64>, bool)> {
    let rows = DVector::from_fn(matrix.nrows(), |i, _| {
        let largest = matrix.row(i).amax();
        if largest > 0.0 { largest.recip() } else { 1.0 }
    });
    let scaled = DMatrix::from_diagonal(&rows) * matrix;
    let right = right.component_mul(&rows);
    let svd = Singular::of(&scaled)?;
    let least = RANK * svd.values.first()?;
    let is_regular = svd.values.last().is_some_and(|value| *value > least);
    let found = svd.solve(&right, least);
    found.iter().all(|value| value.is_finite()).then_some((found, is_regular))
}

fn failure(code: &'static str, message: String, w: &[f64]) -> Failure {
    Failure { code: code.into(), message, time: 0.0, state: w.to_vec() }
}

fn stopped<W>(last: &Solved<W>) -> Failure {
    failure("cancelled", format!("the continuation was stopped where the parameter is {:?}", last.p), &last.w)
}

fn too_many<W>(last: &Solved<W>, most: usize) -> Failure {
    let message = format!(
        "the branch has {most} points, the most that it may have: give a larger `points`, or begin another branch where the \
         parameter is {:?}",
        last.p
    );
    failure("no_branch", message, &last.w)
}

fn came_back<W>(last: &Solved<W>) -> Failure {
    failure("no_branch", "the branch turned and came back to where its interval begins".to_owned(), &last.w)
}

fn ended<W>(last: &Solved<W>) -> Failure {
    let message = format!("the branch ends where the parameter is {:?}: behind it no solution was found", last.p);
    failure("no_branch", message, &last.w)
}

fn inadmissible(w: &[f64], p: f64) -> Failure {
    failure("no_branch", format!("where the parameter is {p:?} the solution leaves what its set allows"), w)
}

fn singular(w: &[f64], p: f64) -> Failure {
    failure("no_branch", format!("the equations of the branch are singular where the parameter is {p:?}"), w)
}

fn unsolved(w: &[f64], p: f64) -> Failure {
    failure("no_branch", format!("Newton's method found no solution near where the parameter is {p:?}"), w)
}
