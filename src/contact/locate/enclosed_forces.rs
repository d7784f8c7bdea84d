//! Enclosures of the forces of closed contacts and of accelerations between the points of a step. Let `a` and
//! `lambda` be the accelerations and multipliers at a point `m` in a box of times and states. Elsewhere in the box
//!
//! ```text
//! M da - G dlambda = r = f + G lambda - M a,    C da = w = -gamma - C a,
//! ```
//!
//! With the matrix `K` of these equations, and `K_m` at the point `m`, `(da, dlambda)` is `K_m^-1 (r, w)`, linear in
//! the enclosed quantities, up to the remainder `K_m^-1 (K - K_m) (da, dlambda)`. The remainder is of second order in
//! the width of the box, and zero if masses and directions are constant in the box.

use super::mode::Status;
use super::mode_equations::{ModeEquations, Solved};
use nalgebra::{DMatrix, Vector2};
use numerics::{Interval, variation};
use problem::{DynamicsRange, SensitivityRange};
use std::ops::Range;

/// Largest factor by which changes of the matrix `K` may feed back on accelerations and multipliers. The sum of the
/// Neumann series of the remainder is at most `1/(1 - factor)` times its first term, finite for any factor below one;
/// for one half it is twice the first term. Close to one the bound would be too wide to prove anything; for a small
/// limit parts of a step would be halved, which halves the factor, although their forces are known well enough.
const FEEDBACK: f64 = 0.5;

/// Enclosures of accelerations and contact forces over a box of times and states.
pub(super) struct Forces {
    /// Enclosures of the accelerations, one per coordinate.
    pub a: Vec<Interval>,
    /// Enclosures of the multipliers of all rows of `J`; those of sliding friction are not updated.
    pub lambda: Vec<Interval>,
    /// Enclosures of masses, forces, directions (rows of `J`), drift of contact velocities and bias of contact
    /// accelerations.
    pub dynamics: DynamicsRange,
}

impl Forces {
    /// Encloses the slip of contact `k` in the given tangential direction, for velocities `v`.
    pub fn slip(&self, equations: &ModeEquations, k: usize, v: &[Interval], direction: Vector2<f64>) -> Interval {
        self.along(&self.dynamics.drift, v, equations.shape().tangents(k), direction)
    }

    /// Encloses the rate of the slip of contact `k` in a constant tangential direction.
    pub fn slip_rate(&self, equations: &ModeEquations, k: usize, direction: Vector2<f64>) -> Interval {
        self.along(&self.dynamics.bias, &self.a, equations.shape().tangents(k), direction)
    }

    /// Encloses `d^T (free + J x)` for some rows of `J`: the slip if `free` and `x` are drift and velocities, the
    /// slip rate if they are bias and accelerations.
    fn along(&self, free: &[Interval], x: &[Interval], rows: Range<usize>, direction: Vector2<f64>) -> Interval {
        let terms = rows.zip(direction.iter());
        sum(terms.map(|(row, d)| Interval::point(*d) * (free[row] + product(self.dynamics.row(row), x))))
    }
}

/// The inverse of the matrix `K_m` of the mode equations at the middle of a box, in blocks: accelerations `a` and
/// multipliers `l` by forces `r` and by biases `w`.
pub(crate) struct Inverse {
    a_by_r: DMatrix<f64>,
    a_by_w: DMatrix<f64>,
    l_by_r: DMatrix<f64>,
    l_by_w: DMatrix<f64>,
}

impl Inverse {
    fn new(solved: &Solved) -> Self {
        let n = solved.matrix.nrows();
        let inverse_mass = solved.mass.solve(&DMatrix::identity(n, n));
        let l_by_r = -(&solved.inverse * (&solved.c * &inverse_mass));
        let a_by_r = &inverse_mass + &solved.y * &l_by_r;
        Self { a_by_r, a_by_w: &solved.y * &solved.inverse, l_by_r, l_by_w: solved.inverse.clone() }
    }

    /// Encloses `(da, dlambda) = K_m^-1 (r, w)` for interval right-hand sides.
    fn apply(&self, r: &[Interval], w: &[Interval]) -> (Vec<Interval>, Vec<Interval>) {
        let of = |by_r: &DMatrix<f64>, by_w: &DMatrix<f64>, i: usize| {
            let along_r = sum(r.iter().enumerate().map(|(j, r)| Interval::point(by_r[(i, j)]) * *r));
            along_r + sum(w.iter().enumerate().map(|(j, w)| Interval::point(by_w[(i, j)]) * *w))
        };
        let a = (0..r.len()).map(|i| of(&self.a_by_r, &self.a_by_w, i)).collect();
        (a, (0..w.len()).map(|i| of(&self.l_by_r, &self.l_by_w, i)).collect())
    }

    /// Returns the terms of `-da_i/dx_j`, as pairs of a factor and a derivative by `x_j`: derivatives of `M a - f - G
    /// lambda` and, in the held `rows`, of `C a + gamma`. `x` has `count` components.
    fn terms_of_slope(
        &self,
        (i, j): (usize, usize),
        count: usize,
        rows: &[usize],
        slopes: &SensitivityRange,
    ) -> impl Iterator<Item = (f64, Interval)> {
        let of_balance = (0..self.a_by_r.ncols()).map(move |k| (self.a_by_r[(i, k)], slopes.balance[k * count + j]));
        let of_rows = rows.iter().enumerate();
        let of_rows = of_rows.map(move |(l, &row)| (self.a_by_w[(i, l)], slopes.acceleration[row * count + j]));
        of_balance.chain(of_rows)
    }
}

/// Enclosure of the friction of a sliding contact over a box, per unit of its normal force; contacts that do not
/// slide have no directions.
#[derive(Clone)]
struct Friction {
    directions: Vec<Interval>,
    mu: Interval,
}

impl Solved {
    fn whole_inverse(&self) -> &Inverse {
        self.whole_inverse.get_or_init(|| Inverse::new(self))
    }
}

impl ModeEquations {
    /// Encloses accelerations and multipliers over a box of times and states, about the point `m` of the last
    /// evaluation; returns `None` if they are not bounded over the box, or multipliers are not unique.
    pub(super) fn enclose(&mut self, t: Interval, x: &[Interval], m: &[f64]) -> Option<Forces> {
        let n = self.shape().coordinates;
        let (q, v) = x.split_at(n);
        let mut dynamics = DynamicsRange::new(self.shape());
        self.problem().enclose_dynamics(t, q, v, &mut dynamics);
        let friction = self.friction_over(t, x, &dynamics)?;
        let (r, w) = self.residuals(t, x, m, &dynamics, &friction);
        let solved = self.solved_last().filter(|solved| solved.shift.is_none())?;
        let rows = self.rows();
        // The columns of `G` (generalised forces of unit multipliers), one for each held row.
        let columns: Vec<Vec<Interval>> = rows.iter().map(|&row| self.push_of(row, &dynamics, &friction)).collect();
        let inverse = solved.whole_inverse();
        let (mut da, mut dl) = inverse.apply(&r, &w);
        // Applies the remainder `K_m^-1 (K - K_m)` to `(da, dlambda)`; a second application yields the terms of
        // higher order.
        let feed = |da: &[Interval], dl: &[Interval]| {
            let of_mass = |i: usize, j: usize| dynamics.mass[i * n + j] - Interval::point(solved.matrix[(i, j)]);
            let r: Vec<Interval> = (0..n)
                .map(|i| {
                    let pushes = columns.iter().enumerate();
                    let pushes = sum(pushes.map(|(l, column)| (column[i] - Interval::point(solved.g[(i, l)])) * dl[l]));
                    pushes - sum((0..n).map(|j| of_mass(i, j) * da[j]))
                })
                .collect();
            let w: Vec<Interval> = rows
                .iter()
                .enumerate()
                .map(|(l, &row)| {
                    let entries = dynamics.row(row).iter().enumerate();
                    -sum(entries.map(|(j, entry)| (*entry - Interval::point(solved.c[(l, j)])) * da[j]))
                })
                .collect();
            inverse.apply(&r, &w)
        };
        let (more_a, more_l) = feed(&da, &dl);
        let grown = |of: &[Interval], more: &[Interval]| -> Vec<Interval> {
            of.iter().zip(more).map(|(of, more)| ball(of.size() + more.size())).collect()
        };
        let (all_a, all_l) = (grown(&da, &more_a), grown(&dl, &more_l));
        let (again_a, again_l) = feed(&all_a, &all_l);
        let ratio = |more: &Interval, all: &Interval| if more.size() > 0.0 { more.size() / all.size() } else { 0.0 };
        let pairs = again_a.iter().zip(&all_a).chain(again_l.iter().zip(&all_l));
        let feedback = pairs.map(|(more, all)| ratio(more, all)).fold(0.0, f64::max);
        if feedback.is_nan() || feedback >= FEEDBACK {
            return None;
        }
        let rest = |more: &Interval| ball(more.size() / (1.0 - feedback));
        da.iter_mut().zip(&again_a).for_each(|(da, more)| *da = *da + rest(more));
        dl.iter_mut().zip(&again_l).for_each(|(dl, more)| *dl = *dl + rest(more));
        let a = self.a.iter().zip(&da).map(|(a, da)| Interval::point(*a) + *da).collect();
        let mut lambda: Vec<Interval> = self.lambda.iter().map(|lambda| Interval::point(*lambda)).collect();
        rows.iter().zip(&dl).for_each(|(&row, dl)| lambda[row] = lambda[row] + *dl);
        Some(Forces { a, lambda, dynamics })
    }

    /// Encloses the derivatives of accelerations by `x` over a box, row by row: `-K_m^-1` times the derivatives of `M
    /// a - f - G lambda` and of `C a + gamma`, with the point `m` of the last evaluation in the box. Products of
    /// changes of `M`, of directions and of slips with changes of `a` and `lambda` are neglected. Returns false if
    /// the equations have no unique solution.
    pub(super) fn enclose_slopes(&mut self, t: Interval, x: &[Interval], slopes: &mut [Interval]) -> bool {
        let (a, lambda) = (self.a.clone(), self.lambda.clone());
        let mut range = SensitivityRange::default();
        self.problem().enclose_sensitivity(t, x, &a, &lambda, &mut range);
        self.add_slopes_of_friction(t, x, &mut range);
        let Some(solved) = self.solved_last().filter(|solved| solved.shift.is_none()) else { return false };
        let (inverse, rows, count) = (solved.whole_inverse(), self.rows(), x.len());
        for (at, slope) in slopes.iter_mut().enumerate() {
            let terms = inverse.terms_of_slope((at / count, at % count), count, rows, &range);
            *slope = -sum(terms.map(|(factor, range)| Interval::point(factor) * range));
        }
        true
    }

    /// For each derivative of accelerations by `x`, sums the [`variation`]s of its terms over three successive
    /// points, with `K_m`, accelerations and multipliers at the middle point, where the equations were evaluated
    /// last.
    pub(super) fn vary_slopes(&mut self, times: [f64; 3], x: &[f64], variations: &mut [(f64, f64)]) {
        let (a, lambda, count) = (self.a.clone(), self.lambda.clone(), x.len() / 3);
        let mut at = 0;
        let of: [SensitivityRange; 3] = times.map(|t| {
            let mut range = SensitivityRange::default();
            let point: Vec<Interval> = x[at..at + count].iter().map(|x| Interval::point(*x)).collect();
            self.problem().enclose_sensitivity(Interval::point(t), &point, &a, &lambda, &mut range);
            self.add_slopes_of_friction(Interval::point(t), &point, &mut range);
            at += count;
            range
        });
        let Some(solved) = self.solved_last() else { return };
        let (inverse, rows) = (solved.whole_inverse(), self.rows());
        for (at, out) in variations.iter_mut().enumerate() {
            let [first, middle, last] =
                of.each_ref().map(|range| inverse.terms_of_slope((at / count, at % count), count, rows, range));
            let terms = first.zip(middle).zip(last);
            *out = terms.fold((0.0, 0.0), |(range, bent), (((factor, first), (_, middle)), (_, last))| {
                let varied = variation([first.lo, middle.lo, last.lo]);
                (range + f64::abs(factor) * varied.0, bent + f64::abs(factor) * varied.1)
            });
        }
    }

    /// Adds the derivatives of friction coefficients to those of `M a - f - G lambda`, with slip and friction
    /// directions at the point of the last evaluation.
    fn add_slopes_of_friction(&mut self, t: Interval, x: &[Interval], range: &mut SensitivityRange) {
        let n = self.shape().coordinates;
        for k in 0..self.shape().contacts.len() {
            let middle: Vec<f64> = x[n..].iter().map(|v| v.ball().0).collect();
            let Some((push, of_speed)) = self.varying_friction(k, &middle) else { continue };
            let rows = self.shape().tangents(k);
            let slips = rows.clone().map(|row| {
                let along = self.constraints().row(row).iter().zip(&x[n..]).map(|(j, v)| Interval::point(*j) * *v);
                Interval::point(self.constraints().drift[row]) + sum(along)
            });
            let speed = self.speed_over(k, &slips.collect::<Vec<_>>());
            let by_velocity: Vec<f64> = (0..n)
                .map(|j| {
                    rows.clone().zip(of_speed.iter()).map(|(row, slope)| self.constraints().row(row)[j] * slope).sum()
                })
                .collect();
            let mut slopes = vec![Interval::point(0.0); 2 * n + 1];
            self.problem().enclose_friction_slopes(k, t, x, speed, &mut slopes);
            let by_speed = slopes[2 * n];
            for (j, slope) in slopes[..2 * n].iter_mut().enumerate() {
                if let Some(along) = j.checked_sub(n).map(|j| by_velocity[j]).filter(|along| *along != 0.0) {
                    *slope = *slope + by_speed * Interval::point(along);
                }
            }
            for (i, push) in push.iter().enumerate().filter(|(_, push)| **push != 0.0) {
                for (j, slope) in slopes[..2 * n].iter().enumerate() {
                    let entry = &mut range.balance[i * 2 * n + j];
                    *entry = *entry + Interval::point(*push) * *slope;
                }
            }
        }
    }

    /// Encloses the slip speed on which the friction coefficient of contact `k` depends; `slips` encloses its slip
    /// velocities.
    fn speed_over(&self, k: usize, slips: &[Interval]) -> Interval {
        let contact = &self.shape().contacts[k];
        match self.mode()[k] {
            Status::Slip(direction) if contact.slips < 2 => {
                let along = sum(slips.iter().zip(direction.iter()).map(|(slip, d)| *slip * Interval::point(*d)));
                Interval::new(along.lo.max(0.0), along.hi.max(0.0)).defined_if(along.defined)
            }
            Status::Slip(_) => {
                let scales = [1.0, 1.0 / contact.ratio];
                let squares = slips.iter().zip(scales).map(|(slip, scale)| (*slip * Interval::point(scale)).square());
                sum(squares).sqrt()
            }
            Status::Open | Status::Frictionless | Status::Stick => Interval::point(0.0),
        }
    }

    /// Encloses the residuals `r` and `w` over the box; if slip directions are constant, by the mean value theorem
    ///
    /// ```text
    /// r = r(t, m) - (d(M a - f - J^T lambda)/dx) (x - m) - J_t^T d (mu - mu(m)) lambda_n,
    /// w = w(t, m) - (d(C a + gamma)/dx) (x - m)
    /// ```
    fn residuals(
        &mut self,
        t: Interval,
        x: &[Interval],
        m: &[f64],
        dynamics: &DynamicsRange,
        friction: &[Friction],
    ) -> (Vec<Interval>, Vec<Interval>) {
        let turns = friction.iter().any(|friction| friction.directions.len() > 1);
        // The mean value theorem does not hold across a jump.
        if turns || self.problem().may_jump(t, x) {
            return self.residuals_of(dynamics, friction);
        }
        let mut at_middle = friction.to_vec();
        at_middle.iter_mut().zip(&self.mu).for_each(|(friction, mu)| friction.mu = Interval::point(*mu));
        let (a, lambda) = (self.a.clone(), self.lambda.clone());
        let mut slopes = SensitivityRange::default();
        self.problem().enclose_sensitivity(t, x, &a, &lambda, &mut slopes);
        let from: Vec<Interval> = x.iter().zip(m).map(|(x, m)| *x - Interval::point(*m)).collect();
        let along = |matrix: &[Interval], row: usize| -product(&matrix[row * x.len()..(row + 1) * x.len()], &from);
        let (mut r, mut w) = (vec![Interval::point(0.0); m.len() / 2], vec![Interval::point(0.0); self.rows().len()]);
        if self.shape().depends_on_time {
            let still: Vec<Interval> = m.iter().map(|m| Interval::point(*m)).collect();
            let (q, v) = still.split_at(m.len() / 2);
            let mut in_time = DynamicsRange::new(self.shape());
            self.problem().enclose_dynamics(t, q, v, &mut in_time);
            (r, w) = self.residuals_of(&in_time, &at_middle);
        }
        for (k, of_contact) in friction.iter().enumerate().filter(|&(k, _)| self.shape().contacts[k].varies) {
            let excess = of_contact.mu - at_middle[k].mu;
            let force = Interval::point(self.lambda[self.shape().normal(k)]) * excess;
            for (row, d) in self.shape().tangents(k).zip(&of_contact.directions) {
                r.iter_mut().zip(dynamics.row(row)).for_each(|(r, entry)| *r = *r - *entry * *d * force);
            }
        }
        r.iter_mut().enumerate().for_each(|(i, r)| *r = *r + along(&slopes.balance, i));
        w.iter_mut().zip(self.rows()).for_each(|(w, &row)| *w = *w + along(&slopes.acceleration, row));
        (r, w)
    }

    /// Encloses the residuals `r` (force balance) and `w` (held accelerations) of the mode equations by interval
    /// evaluation of their definitions.
    fn residuals_of(&self, dynamics: &DynamicsRange, friction: &[Friction]) -> (Vec<Interval>, Vec<Interval>) {
        let n = self.shape().coordinates;
        let rows = self.rows();
        let columns: Vec<Vec<Interval>> = rows.iter().map(|&row| self.push_of(row, dynamics, friction)).collect();
        let of_balance = |i: usize| {
            let pushes = rows.iter().zip(&columns);
            let pushes = sum(pushes.map(|(&row, column)| column[i] * Interval::point(self.lambda[row])));
            let inertia = sum((0..n).map(|j| dynamics.mass[i * n + j] * Interval::point(self.a[j])));
            dynamics.forces[i] + pushes - inertia
        };
        let of_row = |&row: &usize| {
            let along = dynamics.row(row).iter().zip(&self.a).map(|(j, a)| *j * Interval::point(*a));
            -(dynamics.bias[row] + sum(along))
        };
        ((0..n).map(of_balance).collect(), rows.iter().map(of_row).collect())
    }

    /// Encloses the generalised force of a unit multiplier of a held row: the row itself and, for the normal of a
    /// sliding contact, its friction.
    fn push_of(&self, row: usize, dynamics: &DynamicsRange, friction: &[Friction]) -> Vec<Interval> {
        let shape = self.shape();
        let mut push = dynamics.row(row).to_vec();
        let contact = row.checked_sub(shape.joints).filter(|k| *k < friction.len());
        for (k, friction) in contact.into_iter().map(|k| (k, &friction[k])) {
            for (tangent, d) in shape.tangents(k).zip(&friction.directions) {
                let factor = friction.mu * *d;
                push.iter_mut().zip(dynamics.row(tangent)).for_each(|(push, entry)| *push = *push - factor * *entry);
            }
        }
        push
    }

    /// Encloses the friction of sliding contacts over the box; returns `None` if a direction may turn by any angle,
    /// or a coefficient is undefined somewhere in the box.
    fn friction_over(&mut self, t: Interval, x: &[Interval], dynamics: &DynamicsRange) -> Option<Vec<Friction>> {
        let v = &x[x.len() / 2..];
        let contacts = self.shape().contacts.len();
        let of_contact = |k: usize| {
            let contact = self.shape().contacts[k];
            let mut friction = Friction { directions: Vec::new(), mu: Interval::point(contact.mu) };
            let Status::Slip(direction) = self.mode()[k] else { return Some(friction) };
            let slip = |row: usize| dynamics.drift[row] + product(dynamics.row(row), v);
            let slips: Vec<Interval> = self.shape().tangents(k).map(slip).collect();
            friction.directions = if contact.slips < 2 {
                vec![Interval::point(direction.x)]
            } else {
                let least = self.least_slip(k);
                let way = slips.iter().zip(direction.iter()).map(|(slip, d)| *slip + Interval::point(d * least));
                let way: Vec<Interval> = way.collect();
                let length = sum(way.iter().map(|way| way.square())).sqrt();
                if !(length.defined && length.lo > 0.0) {
                    return None;
                }
                way.iter().map(|way| *way / length).collect()
            };
            if contact.varies {
                let speed = self.speed_over(k, &slips);
                friction.mu = self.problem().enclose_friction(k, t, x, speed);
                let is_bounded = friction.mu.defined && friction.mu.size().is_finite();
                return is_bounded.then_some(friction);
            }
            Some(friction)
        };
        (0..contacts).map(of_contact).collect()
    }
}

fn sum(terms: impl Iterator<Item = Interval>) -> Interval {
    terms.fold(Interval::point(0.0), |sum, term| sum + term)
}

fn product(row: &[Interval], of: &[Interval]) -> Interval {
    sum(row.iter().zip(of).map(|(row, of)| *row * *of))
}

fn ball(radius: f64) -> Interval {
    Interval::new(-radius, radius)
}
