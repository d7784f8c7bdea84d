//! The law of impact and friction for all contacts of one step, at the level of velocities. With impulses `r` and
//! relative velocities `u` in contact coordinates (normal, first tangent, second tangent), and the Delassus operator `W`,
//!
//! ```text
//! u+ = W r + u_free,    0 <= r_n  _|_  u_n+ - w >= 0,    r_t in mu r_n B,    -u_t+ normal to mu r_n B at r_t
//! ```
//!
//! where `B` is the unit disk or a polygon in it. The target `w` of the normal velocity is
//!
//! - `-e u_n-` for a contact that closes within the step and had approached with `u_n- < 0` (Moreau 1988, on Newton's
//!   law: for one `e` and no friction `v+ = P - e N`, with `v- = P + N` split by the cone of admissible velocities and its
//!   polar, so that no energy is added whatever the number of contacts);
//! - `-gap/h` otherwise, for a gap that is open: the contact may close and no more (Stewart and Trinkle 1996). A negative
//!   gap is not pushed out: that would add energy.
//!
//! With different `e`, or with friction, Newton's law may add energy (Kane and Levinson 1985). The contacts dissipate
//! `-<r, u+ + u->/2`; where that comes out negative, impulses are moved on a straight line towards those of `e = 0`, which
//! never add any (Stewart 2000, section 3), until they add none. The line lies in the friction cones, as they are convex.

mod memory;
mod polyhedral;
mod sequential;
#[cfg(test)]
mod tests;

pub use memory::Size;
pub use sequential::sequential;

use nalgebra::Vector3;
use polyhedral::Polyhedral;
use problem::Control;
use vi::Outcome;
use vi::coulomb::{BlockMatrix, Coulomb, CoulombProblem, Evidence, Limits};

/// The set that friction is taken from, for `mu r_n = 1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cone {
    /// The unit disk: Coulomb's law itself.
    Quadratic,
    /// A regular polygon with so many corners, the first in the direction of the first tangent; two are a segment, for
    /// motion in a plane.
    Polyhedral(usize),
}

/// The contacts of one step.
#[derive(Clone, Copy, Debug)]
pub struct Contacts<'a> {
    /// `W`, in 3 x 3 blocks; a direction in which a contact cannot slip has any positive diagonal and zeros beside it.
    pub delassus: &'a BlockMatrix,
    /// `u_free`, the velocities at the end of the step without impulses.
    pub free: &'a [Vector3<f64>],
    /// `u-`, the velocities at its beginning.
    pub before: &'a [Vector3<f64>],
    /// The gaps at its beginning.
    pub gap: &'a [f64],
    /// The coefficients of friction.
    pub mu: &'a [f64],
    /// The coefficients of restitution, from 0 to 1.
    pub restitution: &'a [f64],
    /// The sets that friction is taken from.
    pub cone: &'a [Cone],
    /// The step size.
    pub h: f64,
}

/// How a law was solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// How the last problem ended.
    pub outcome: Outcome,
    /// The solver that answered.
    pub solver: &'static str,
    /// Problems solved.
    pub solves: u64,
    /// Pivots or iterations in all.
    pub iterations: u64,
    /// What is left of the law, relative to the larger of velocities and impulses.
    pub residual: f64,
    /// The part of the restitution that was applied: below one where the whole would have added energy.
    pub restitution: f64,
}

impl Report {
    /// The report of a law that was solved after another: its own, with the work of both.
    #[must_use]
    pub fn after(self, earlier: &Self) -> Self {
        Self { solves: self.solves + earlier.solves, iterations: self.iterations + earlier.iterations, ..self }
    }

    /// The report of a step that takes two laws to be solved: that of the worse.
    #[must_use]
    pub fn beside(self, other: &Self) -> Self {
        let worse = if other.outcome != Outcome::Solved { other } else { &self };
        Self {
            outcome: worse.outcome,
            residual: self.residual.max(other.residual),
            restitution: self.restitution.min(other.restitution),
            ..self
        }
    }
}

/// The solvers of the law, with their room.
#[derive(Debug)]
pub struct Law {
    coulomb: Coulomb,
    problem: CoulombProblem,
    polyhedral: Polyhedral,
    target: Vec<f64>,
    closing: Vec<bool>,
    inelastic: Vec<Vector3<f64>>,
}

/// A residual above this is no solution.
pub const UNSOLVED: f64 = 1e-6;

/// Iterations of the slowest solver: a step that is not solved in so many is better told than waited for.
const MOST_ITERATIONS: usize = 3_000;

/// Above so many contacts in one island a factorisation takes seconds.
const MOST_FACTORISED: usize = 600;

/// Above so many contacts without friction sweeps and sparse factors cost less than dense pivots.
const MOST_PIVOTED: usize = 100;

/// The set of a contact that can slip in one direction alone.
const SEGMENT: Cone = Cone::Polyhedral(2);

/// Energy below this fraction of `sum |r| |u|` is rounding.
const ROUNDING: f64 = 1e-13;

impl Law {
    /// Solvers that reach this relative residual.
    pub fn new(tolerance: f64) -> Self {
        Self {
            coulomb: Coulomb::new(Limits {
                tolerance,
                iterations: MOST_ITERATIONS,
                factorised: MOST_FACTORISED,
                ..Limits::default()
            }),
            problem: CoulombProblem::default(),
            polyhedral: Polyhedral::default(),
            target: Vec::new(),
            closing: Vec::new(),
            inelastic: Vec::new(),
        }
    }

    /// Finds the impulses, starting from those in `r`. A report with `Solved` is to be trusted; any other is no answer.
    pub fn impulses(&mut self, contacts: &Contacts<'_>, r: &mut [Vector3<f64>], control: &Control) -> Report {
        let mut report = Report {
            outcome: Outcome::Solved,
            solver: "none",
            solves: 0,
            iterations: 0,
            residual: 0.0,
            restitution: 1.0,
        };
        self.closing.clear();
        self.closing.extend((0..r.len()).map(|k| contacts.approaches(k) && contacts.closes(k, contacts.free[k].x)));
        // A contact that closes only because others push it is found in the solution.
        for _ in 0..=r.len() {
            self.set_targets(contacts, 1.0);
            self.solve(contacts, r, &mut report, control);
            let mut found = false;
            for (k, (closing, r)) in self.closing.iter_mut().zip(&*r).enumerate() {
                if !*closing && r.x > 0.0 && contacts.approaches(k) {
                    (*closing, found) = (true, true);
                }
            }
            if !found || report.outcome != Outcome::Solved || control.poll().is_some() {
                break;
            }
        }
        if report.outcome == Outcome::Solved && self.closing.contains(&true) {
            self.spend_no_more_than_there_is(contacts, r, &mut report, control);
        }
        report
    }

    fn set_targets(&mut self, contacts: &Contacts<'_>, restitution: f64) {
        self.target.clear();
        self.target.extend((0..contacts.gap.len()).map(|k| {
            if self.closing[k] {
                -restitution * contacts.restitution[k] * contacts.before[k].x
            } else {
                -contacts.gap[k].max(0.0) / contacts.h
            }
        }));
    }

    fn solve(&mut self, contacts: &Contacts<'_>, r: &mut [Vector3<f64>], report: &mut Report, control: &Control) {
        let shifted = contacts.free.iter().zip(&self.target);
        let q: Vec<Vector3<f64>> = shifted.map(|(u, w)| Vector3::new(u.x - w, u.y, u.z)).collect();
        report.solves += 1;
        let round = |k: usize| contacts.mu[k] > 0.0 && contacts.cone[k] == Cone::Quadratic;
        let faceted = |k: usize| contacts.mu[k] > 0.0 && contacts.cone[k] != Cone::Quadratic;
        let pivots = r.len() <= MOST_PIVOTED || (0..r.len()).any(faceted);
        if pivots && !(0..r.len()).any(round) {
            self.polyhedral.solve(contacts, &q, r, report, control);
            let over = matches!(report.outcome, Outcome::Solved | Outcome::Interrupted);
            if over || (0..r.len()).any(|k| faceted(k) && contacts.cone[k] != SEGMENT) {
                return;
            }
            // Contacts that share a slip have bases that are singular but for rounding; a segment is a disk too.
            r.fill(Vector3::zeros());
            report.solves += 1;
        }
        if self.problem.replace(contacts.delassus, &q, contacts.mu).is_ok() {
            let solved = self.coulomb.solve(&self.problem, r, control);
            let Evidence { relative, .. } = solved.evidence;
            report.solver = solved.attempts.last().map_or("start", |attempt| attempt.method.name());
            report.iterations += solved.attempts.iter().map(|attempt| attempt.iterations as u64).sum::<u64>();
            report.residual = relative;
            report.outcome = match solved.outcome {
                Outcome::Limit if relative <= UNSOLVED => Outcome::Solved,
                outcome => outcome,
            };
        } else {
            report.outcome = Outcome::Breakdown;
        }
    }

    /// Moves impulses that add energy towards inelastic ones.
    fn spend_no_more_than_there_is(
        &mut self,
        contacts: &Contacts<'_>,
        r: &mut [Vector3<f64>],
        report: &mut Report,
        control: &Control,
    ) {
        let (newton, size) = contacts.dissipation(r);
        if newton >= -ROUNDING * size {
            return;
        }
        self.set_targets(contacts, 0.0);
        let mut inelastic = std::mem::take(&mut self.inelastic);
        inelastic.clear();
        inelastic.extend_from_slice(r);
        self.solve(contacts, &mut inelastic, report, control);
        // Along the line dissipation is a concave parabola, known by three of its points.
        let (start, _) = contacts.dissipation(&inelastic);
        let least = start.min(0.0);
        let middle: Vec<Vector3<f64>> = inelastic.iter().zip(&*r).map(|(a, b)| 0.5 * (a + b)).collect();
        let (middle, _) = contacts.dissipation(&middle);
        let curvature = 2.0 * (start + newton - 2.0 * middle);
        let slope = newton - start - curvature;
        // The larger root of start + slope s + curvature s^2 = least, in the form that does not cancel.
        let discriminant = (slope * slope - 4.0 * curvature * (start - least)).max(0.0).sqrt();
        let part = if slope > 0.0 {
            -0.5 * (slope + discriminant) / curvature
        } else {
            2.0 * (start - least) / (discriminant - slope)
        };
        let part = if part.is_finite() { part.clamp(0.0, 1.0) } else { 0.0 };
        for (r, inelastic) in r.iter_mut().zip(&inelastic) {
            *r = inelastic + (*r - inelastic) * part;
        }
        report.restitution = part;
        self.inelastic = inelastic;
    }
}

impl Contacts<'_> {
    /// `u+` of contact `k`.
    pub fn after(&self, k: usize, r: &[Vector3<f64>]) -> Vector3<f64> {
        self.delassus.row_product(k, r) + self.free[k]
    }

    /// Whether the contact can rebound.
    fn approaches(&self, k: usize) -> bool {
        self.restitution[k] > 0.0 && self.before[k].x < 0.0
    }

    /// Whether it closes within the step if it moves with normal velocity `u_n`.
    fn closes(&self, k: usize, u_n: f64) -> bool {
        self.gap[k] <= 0.0 || self.gap[k] + self.h * u_n < 0.0
    }

    /// `-<r, u+ + u->/2`, and the size of its terms.
    fn dissipation(&self, r: &[Vector3<f64>]) -> (f64, f64) {
        (0..r.len()).fold((0.0, 0.0), |(sum, size), k| {
            let (after, before) = (self.after(k, r), self.before[k]);
            (sum - 0.5 * r[k].dot(&(after + before)), size + r[k].norm() * (after.norm() + before.norm()))
        })
    }
}
