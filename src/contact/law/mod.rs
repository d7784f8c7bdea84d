//! The law of impact and friction for all contacts of one step, at the level of velocities. With impulses `r` and
//! relative velocities `u` in contact coordinates (normal, first tangent, second tangent), and the Delassus operator
//! `W`,
//!
//! ```text
//! u+ = W r + u_free,    0 <= r_n  _|_  u_n+ - w >= 0,    r_t in mu r_n B,    -u_t+ normal to mu r_n B at r_t
//! ```
//!
//! where `B` is the unit disk or a polygon in it. A contact patch has a second row, for its torque. The target `w` of
//! the normal velocity is
//!
//! - `-e u_n-` for a contact that closes within the step and had approached with `u_n- < 0` (Moreau 1988, on Newton's
//!   law: for one `e` and no friction `v+ = P - e N`, with `v- = P + N` split by the cone of admissible velocities and
//!   its polar, so that no energy is added whatever the number of contacts);
//! - `-gap/h` otherwise, for an open gap: the contact may close but not penetrate (Stewart and Trinkle 1996). A
//!   negative gap is not pushed out: that would add energy.
//!
//! With different `e`, or with friction, Newton's law may add energy (Kane and Levinson 1985). The contacts dissipate
//! `-<r, u+ + u->/2`; if that is negative, impulses are moved on a straight line towards those of `e = 0`, which
//! never add energy (Stewart 2000, section 3), until they add none. The line lies in the friction cones, which are
//! convex.

mod memory;
mod polyhedral;
mod sequential;
#[cfg(test)]
mod tests;
mod varying;

pub use memory::Size;
pub use sequential::sequential;
pub use varying::{Coefficients, admissible};

use nalgebra::{Matrix3, Vector3};
use polyhedral::Polyhedral;
use problem::Control;
use vi::Outcome;
use vi::coulomb::{BlockMatrix, Coulomb, CoulombProblem, Factored, Limits, ProximalSweeps, Role};

/// The admissible set of friction impulses, for `mu r_n = 1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cone {
    /// The unit disk: Coulomb's law itself, without approximation of its friction cone.
    Quadratic,
    /// A regular polygon with this number of corners, the first in the direction of the first tangent; two corners are
    /// a segment, for motion in a plane.
    Polyhedral(usize),
}

/// The Delassus operator `W` of the contacts, which maps impulses to velocity changes.
#[derive(Clone, Copy, Debug)]
pub enum Delassus<'a> {
    /// The Delassus operator `W` by its 3 x 3 blocks.
    Blocks(&'a BlockMatrix),
    /// The Delassus operator `W` by its factors, for many contacts; see [`is_factored`].
    Factors(&'a Factored),
}

impl Delassus<'_> {
    /// Returns the product `W r` of the Delassus operator with the contact impulses `r`.
    pub fn product(&self, r: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        match self {
            Self::Blocks(blocks) => (0..r.len()).map(|k| blocks.row_product(k, r)).collect(),
            Self::Factors(factors) => factors.product(r),
        }
    }

    /// Returns the diagonal block `W_kk` of the Delassus operator for contact `k`.
    fn diagonal(&self, k: usize) -> Matrix3<f64> {
        match self {
            Self::Blocks(blocks) => *blocks.diagonal(k),
            Self::Factors(factors) => factors.diagonal(k),
        }
    }
}

/// The contacts of one step: input of the contact law.
#[derive(Clone, Copy, Debug)]
pub struct Contacts<'a> {
    /// The Delassus operator `W` in 3 x 3 blocks. A direction in which a contact cannot slip has any positive
    /// diagonal entry, and zeros in the remainder of its row and column.
    pub delassus: Delassus<'a>,
    /// `u_free`, the contact velocities at the end of the step without impulses.
    pub free: &'a [Vector3<f64>],
    /// `u-`, the contact velocities at the beginning of the step.
    pub before: &'a [Vector3<f64>],
    /// The gap of each contact at the beginning of the step.
    pub gap: &'a [f64],
    /// The coefficient of friction of each contact.
    pub mu: &'a [f64],
    /// The coefficient of restitution of each contact, from 0 to 1.
    pub restitution: &'a [f64],
    /// The admissible set of friction impulses of each contact.
    pub cone: &'a [Cone],
    /// The role of each row, force or torque; empty if all contacts are point contacts. The torque of a patch has no
    /// gap and no restitution.
    pub roles: &'a [Role],
    /// The step size `h`, in which contacts may close.
    pub h: f64,
}

/// The outcome and the cost of solving the contact law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// The outcome of the last contact problem solved: whether its solution was found.
    pub outcome: Outcome,
    /// The name of the solver that found the solution of the contact problem.
    pub solver: &'static str,
    /// The number of contact problems solved.
    pub solves: u64,
    /// The total number of pivots or iterations of the solvers of the contact law.
    pub iterations: u64,
    /// The residual of the contact law, relative to the larger of velocities and impulses.
    pub residual: f64,
    /// The residual of the contact law with a proximal term, which is solved instead of the law itself for many
    /// contacts.
    pub proximal_residual: Option<f64>,
    /// The fraction of the restitution that was applied: below one if full restitution would have added energy.
    pub restitution: f64,
}

impl Report {
    /// Returns the report of a step without contacts.
    pub fn none() -> Self {
        Self {
            outcome: Outcome::Solved,
            solver: "none",
            solves: 0,
            iterations: 0,
            residual: 0.0,
            proximal_residual: None,
            restitution: 1.0,
        }
    }

    /// Records the result of a solve of Coulomb's law, and its residual with a proximal term, if any.
    fn take(&mut self, solved: vi::coulomb::Report, proximal: Option<f64>) {
        self.solver = solved.attempts.last().map_or("start", |attempt| attempt.method.name());
        self.iterations += solved.attempts.iter().map(|attempt| attempt.iterations as u64).sum::<u64>();
        self.residual = solved.evidence.relative;
        self.proximal_residual = proximal;
        self.outcome = match solved.outcome {
            Outcome::Limit if proximal.unwrap_or(self.residual) <= UNSOLVED => Outcome::Solved,
            outcome => outcome,
        };
    }

    /// Adds the solves and iterations of an earlier solve of the contact law in the same step to the report.
    #[must_use]
    pub fn after(self, earlier: &Self) -> Self {
        Self { solves: self.solves + earlier.solves, iterations: self.iterations + earlier.iterations, ..self }
    }

    /// Combines the reports of two contact problems of one step: outcome, residual and restitution are those of the
    /// worse.
    #[must_use]
    pub fn beside(self, other: &Self) -> Self {
        let worse = if other.outcome != Outcome::Solved { other } else { &self };
        Self {
            outcome: worse.outcome,
            residual: self.residual.max(other.residual),
            proximal_residual: worse_of(self.proximal_residual, other.proximal_residual),
            restitution: self.restitution.min(other.restitution),
            ..self
        }
    }
}

/// Returns the larger of two residuals of the contact law, either of which may be missing.
pub fn worse_of(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    a.into_iter().chain(b).reduce(f64::max)
}

/// The solvers of the contact law, with their workspace.
#[derive(Debug)]
pub struct Law {
    coulomb: Coulomb,
    proximal: ProximalSweeps,
    problem: CoulombProblem,
    polyhedral: Polyhedral,
    target: Vec<f64>,
    closing: Vec<bool>,
    inelastic: Vec<Vector3<f64>>,
}

/// Relative residual up to which an iterate of a solver of the contact law is accepted as a solution.
pub const UNSOLVED: f64 = 1e-6;

/// Iteration limit of the slowest solver of the contact law; a step that reaches it is reported as unsolved. Of 379
/// hard problems of heaps, a tenfold limit solved no more.
const MOST_ITERATIONS: usize = 300;

/// Largest number of contacts of one island for which a dense matrix is factorised; larger ones take seconds.
const MOST_FACTORISED: usize = 600;

/// Largest number of frictionless contacts for dense pivoting; for more contacts sweeps and sparse factors cost less.
const MOST_PIVOTED: usize = 100;

/// Whether an island has so many contacts that the contact law uses the factors of the Delassus operator instead of
/// its blocks.
pub fn is_factored(contacts: usize, friction: Option<Cone>) -> bool {
    contacts > MOST_FACTORISED && friction.is_none_or(|cone| cone == Cone::Quadratic)
}

/// The admissible set of a contact that can slip in one direction only: a segment.
const SEGMENT: Cone = Cone::Polyhedral(2);

/// An energy below this fraction of `sum |r| |u|`, with contact impulses `r` and velocities `u`, is rounding.
const ROUNDING: f64 = 1e-13;

impl Law {
    /// Allocates solvers for the given tolerance on the relative residual.
    pub fn new(tolerance: f64) -> Self {
        Self {
            coulomb: Coulomb::new(Limits {
                tolerance,
                iterations: MOST_ITERATIONS,
                factorised: MOST_FACTORISED,
                ..Limits::default()
            }),
            proximal: ProximalSweeps::default(),
            problem: CoulombProblem::default(),
            polyhedral: Polyhedral::default(),
            target: Vec::new(),
            closing: Vec::new(),
            inelastic: Vec::new(),
        }
    }

    /// Computes the contact impulses, starting from the impulses in `r`, which it overwrites. Only a report with
    /// [`Outcome::Solved`] is a solution.
    pub fn impulses(&mut self, contacts: &Contacts<'_>, r: &mut [Vector3<f64>], control: &Control) -> Report {
        let mut report = Report::none();
        self.closing.clear();
        self.closing.extend((0..r.len()).map(|k| contacts.approaches(k) && contacts.closes(k, contacts.free[k].x)));
        // Repeat until no further contact closes: a contact that closes only because others push it shows in the
        // solution.
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
        let blocks = match contacts.delassus {
            Delassus::Blocks(blocks) => blocks,
            Delassus::Factors(factors) => {
                let solved = self.proximal.solve(factors, &q, contacts.mu, r, &self.coulomb.limits, control);
                report.take(solved.report, Some(solved.solved));
                return;
            }
        };
        let round = |k: usize| contacts.mu[k] > 0.0 && contacts.cone[k] == Cone::Quadratic;
        let faceted = |k: usize| contacts.mu[k] > 0.0 && contacts.cone[k] != Cone::Quadratic;
        let pivots = r.len() <= MOST_PIVOTED || (0..r.len()).any(faceted);
        if pivots && contacts.roles.is_empty() && !(0..r.len()).any(round) {
            self.polyhedral.solve(contacts, blocks, &q, r, report, control);
            let over = matches!(report.outcome, Outcome::Solved | Outcome::Interrupted);
            if over || (0..r.len()).any(|k| faceted(k) && contacts.cone[k] != SEGMENT) {
                return;
            }
            // Contacts with dependent slip directions have bases that are singular up to rounding. For a single slip
            // direction a disk is a segment, so the solver for disks takes over.
            r.fill(Vector3::zeros());
            report.solves += 1;
        }
        let is_read = self.problem.replace(blocks, &q, contacts.mu).is_ok()
            && (contacts.roles.is_empty() || self.problem.take_roles(contacts.roles).is_ok());
        if is_read {
            let solved = self.coulomb.solve(&self.problem, r, control);
            report.take(solved, None);
        } else {
            report.outcome = Outcome::Breakdown;
        }
    }

    /// Moves contact impulses that add energy towards the impulses of the step without restitution, until they add
    /// none.
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
        // Along the line of impulses the dissipation is a concave parabola, determined by three points.
        let (start, _) = contacts.dissipation(&inelastic);
        let least = start.min(0.0);
        let middle: Vec<Vector3<f64>> = inelastic.iter().zip(&*r).map(|(a, b)| 0.5 * (a + b)).collect();
        let (middle, _) = contacts.dissipation(&middle);
        let curvature = 2.0 * (start + newton - 2.0 * middle);
        let slope = newton - start - curvature;
        // The larger root of start + slope s + curvature s^2 = least, by the formula that has no cancellation.
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
    /// Returns the velocity `u+` of every contact after the impulses `r`.
    pub fn after(&self, r: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        self.delassus.product(r).iter().zip(self.free).map(|(change, free)| change + free).collect()
    }

    /// Whether contact `k` can rebound: it approaches and has restitution.
    fn approaches(&self, k: usize) -> bool {
        self.restitution[k] > 0.0 && self.before[k].x < 0.0
    }

    /// Whether row `k` of the contact law is the torque of a contact patch.
    fn is_torque(&self, k: usize) -> bool {
        self.roles.get(k) == Some(&Role::Torque)
    }

    /// Whether contact `k` closes within the step if it moves with normal velocity `u_n`.
    fn closes(&self, k: usize, u_n: f64) -> bool {
        self.gap[k] <= 0.0 || self.gap[k] + self.h * u_n < 0.0
    }

    /// Returns the energy `-<r, u+ + u->/2` that the contact impulses `r` dissipate, and the sum of the absolute values
    /// of its terms.
    fn dissipation(&self, r: &[Vector3<f64>]) -> (f64, f64) {
        self.after(r).iter().zip(self.before).zip(r).fold((0.0, 0.0), |(sum, size), ((after, before), r)| {
            (sum - 0.5 * r.dot(&(after + before)), size + r.norm() * (after.norm() + before.norm()))
        })
    }
}
