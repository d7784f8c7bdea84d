//! Variations of forces and friction coefficients between the times at which steps of a mechanical system evaluate
//! them: in time, and along the path of a step.

use super::unseen_data::{InTime, OfStates, OnWay, UnseenData};
use contact::{State, TimeStepping};
use nalgebra::{DMatrix, DVector};
use numerics::Interval;
use problem::{Constraints, Mechanical};

/// The displacements of coordinates and velocities by variations of forces and friction coefficients between the
/// times at which steps evaluate them.
#[derive(Default)]
pub(super) struct UnseenForces {
    in_time: UnseenData,
    on_way: Option<UnseenData>,
    /// For each contact, the integrals over steps of its friction coefficient.
    friction: Vec<UnseenData>,
    /// The displacements of coordinates and velocities by missed variations (`displaced`), and bounds on the errors of
    /// the displacements (`unknown`).
    displaced: [Vec<f64>; 2],
    unknown: [Vec<f64>; 2],
}

/// The forces of a mechanical system as functions of time and coordinates, with the velocities at the end of a step.
struct ForcesOfPlace<'s> {
    problem: &'s mut dyn Mechanical,
    v: &'s [f64],
}

impl OfStates for ForcesOfPlace<'_> {
    fn at(&mut self, t: f64, q: &[f64], out: &mut [f64]) {
        self.problem.forces(t, q, self.v, out);
    }

    fn enclose(&mut self, t: Interval, q: &[Interval], out: &mut [Interval]) {
        let v: Vec<Interval> = self.v.iter().map(|v| Interval::point(*v)).collect();
        self.problem.enclose_forces(t, q, &v, out);
    }
}

/// The friction coefficient of a contact as a function of time and coordinates, with the velocities at the end of a
/// step. For a sticking contact the coefficient is cut off at the value `most` that the contact needs.
struct FrictionOfPlace<'s> {
    problem: &'s mut dyn Mechanical,
    contact: usize,
    v: &'s [f64],
    slip_speed: f64,
    most: f64,
    state: Vec<Interval>,
}

impl OfStates for FrictionOfPlace<'_> {
    fn at(&mut self, t: f64, q: &[f64], out: &mut [f64]) {
        out[0] = self.problem.friction(self.contact, t, q, self.v, self.slip_speed).min(self.most);
    }

    fn enclose(&mut self, t: Interval, q: &[Interval], out: &mut [Interval]) {
        self.state.clear();
        self.state.extend(q.iter().copied().chain(self.v.iter().map(|v| Interval::point(*v))));
        let range = self.problem.enclose_friction(self.contact, t, &self.state, Interval::point(self.slip_speed));
        out[0] = Interval { lo: range.lo.min(self.most), hi: range.hi.min(self.most), ..range };
    }
}

/// The sum of the generalised impulses that one step misses, since forces and friction vary between the times at
/// which it evaluates them; and bounds on the error of this sum.
struct Impulses {
    sum: DVector<f64>,
    unknown: Vec<DVector<f64>>,
}

impl UnseenForces {
    /// Adds the impulses that the last step misses because forces and friction vary between the times at which it
    /// evaluates them, and returns the largest possible displacements of coordinates and velocities at its end by the
    /// impulses missed in all steps so far; `None` if there are none.
    pub fn step(&mut self, stepper: &mut TimeStepping<'_>, problem: &mut dyn Mechanical) -> Option<[Vec<f64>; 2]> {
        let structure = problem.structure();
        let n = structure.coordinates;
        let is_of_place = structure.has_features_of_forces;
        let is_rough = structure.contacts.iter().any(|contact| contact.varies);
        if !(structure.depends_on_time || is_of_place || is_rough) {
            return None;
        }
        let h = stepper.state.t - stepper.last.t;
        let mut made = Impulses { sum: DVector::zeros(n), unknown: Vec::new() };
        self.add_forces(stepper, problem, is_of_place, &mut made);
        if is_rough {
            self.add_friction(stepper, problem, &mut made);
        }
        for parts in self.displaced.iter_mut().chain(&mut self.unknown) {
            parts.resize(n, 0.0);
        }
        if made.sum.iter().any(|impulse| *impulse != 0.0) || !made.unknown.is_empty() {
            let State { t, q, .. } = &stepper.last;
            let mut mass = DMatrix::zeros(n, n);
            problem.mass(*t, q, &mut mass);
            let mass = mass.cholesky()?;
            let change = mass.solve(&made.sum);
            let mut left = DVector::zeros(n);
            made.unknown.iter().for_each(|impulse| left += mass.solve(impulse).abs());
            for ([places, velocities], change) in [(&mut self.displaced, change), (&mut self.unknown, left)] {
                for ((place, velocity), change) in places.iter_mut().zip(velocities).zip(&change) {
                    *place += h * (*velocity + 0.5 * change);
                    *velocity += change;
                }
            }
        } else {
            for [places, velocities] in [&mut self.displaced, &mut self.unknown] {
                places.iter_mut().zip(velocities).for_each(|(place, velocity)| *place += h * *velocity);
            }
        }
        let none = |parts: &[Vec<f64>; 2]| parts.iter().flatten().all(|by| *by == 0.0);
        if none(&self.displaced) && none(&self.unknown) {
            return None;
        }
        for (k, is_of_velocities) in [(0, false), (1, true)] {
            stepper.hold_back(&mut self.displaced[k], is_of_velocities);
            hold_back_bounds(&mut self.unknown[k], |by| stepper.hold_back(by, is_of_velocities));
        }
        Some([0, 1].map(|k| self.displaced[k].iter().zip(&self.unknown[k]).map(|(by, left)| by.abs() + left).collect()))
    }

    /// Adds the impulse of the forces in the last step minus that of the trapezoidal rule: a step takes the forces at
    /// its beginning, where its velocities are those of the middle.
    fn add_forces(
        &mut self,
        stepper: &TimeStepping<'_>,
        problem: &mut dyn Mechanical,
        is_of_place: bool,
        made: &mut Impulses,
    ) {
        let (n, depends_on_time) = (made.sum.len(), problem.structure().depends_on_time);
        let TimeStepping { state, last, .. } = stepper;
        let step = [last.t, state.t];
        let mut forces = ForcesOfPlace { problem, v: &state.v };
        if depends_on_time {
            let mut in_time = OnWay::new(&mut forces, step, [&last.q, &last.q]);
            if self.in_time.integrate(n, step, &mut in_time) {
                let left = self.in_time.integrals.iter().map(|[_, left]| *left).enumerate();
                made.unknown.extend(left.filter(|(_, left)| *left != 0.0).map(|(i, left)| {
                    let mut unknown = DVector::zeros(n);
                    unknown[i] = left;
                    unknown
                }));
                if !is_of_place {
                    made.sum += beyond_ends(&self.in_time, step, &mut in_time);
                }
            }
        }
        if is_of_place {
            let mut on_way = OnWay::new(&mut forces, step, [&last.q, &state.q]);
            let data = self.on_way.get_or_insert_with(UnseenData::of_way);
            if data.integrate(n, step, &mut on_way) {
                made.sum += beyond_ends(data, step, &mut on_way);
            }
        }
    }

    /// Adds the impulses of varying friction coefficients in the last step minus those of the coefficients at its
    /// end, which the step uses.
    fn add_friction(&mut self, stepper: &TimeStepping<'_>, problem: &mut dyn Mechanical, made: &mut Impulses) {
        let structure = problem.structure().clone();
        let TimeStepping { state, last, step, .. } = stepper;
        let contacted = &step.contacted;
        let acts = |&k: &usize| structure.contacts[k].varies && contacted.r[k].x > 0.0;
        let acting: Vec<usize> = (0..structure.contacts.len()).filter(acts).collect();
        if acting.is_empty() {
            return;
        }
        self.friction.resize(structure.contacts.len(), UnseenData::default());
        let mut at_start = Constraints::new(&structure);
        problem.constraints(last.t, &last.q, &mut at_start);
        let h = state.t - last.t;
        for k in acting {
            let (r, after) = (&contacted.r[k], &contacted.after[k]);
            let (used, slip_speed) = (r.y.hypot(r.z) / r.x, after.y.hypot(after.z));
            let most = if stepper.sticks(k) { used } else { f64::INFINITY };
            let speed = structure.contacts[k].slip_speed(&[after.y, after.z].into());
            let mut friction =
                FrictionOfPlace { problem, contact: k, v: &state.v, slip_speed: speed, most, state: Vec::new() };
            let row = structure.normal(k);
            let (gap, approach) = (at_start.values[row], -at_start.velocity(row, &last.v));
            let is_open = gap > stepper.closed(k);
            let until = if is_open && approach > 0.0 { (gap / approach).min(h) } else { 0.0 };
            let part = until / h;
            let there: Vec<f64> = last.q.iter().zip(&state.q).map(|(from, to)| from + part * (to - from)).collect();
            let acts = [last.t + until, state.t];
            let mut on_way = OnWay::new(&mut friction, acts, [&there, &state.q]);
            let [mean, left] = self.friction[k].mean(acts, is_open, &mut on_way);
            if mean == used && left == 0.0 {
                continue;
            }
            // The direction of the friction in the step, or opposite to the slip if the step has no friction.
            let along = if used > 0.0 {
                [r.y / (used * r.x), r.z / (used * r.x)]
            } else {
                [-after.y / slip_speed, -after.z / slip_speed]
            };
            let mut direction: DVector<f64> = DVector::zeros(made.sum.len());
            for (row, along) in structure.tangents(k).zip(along) {
                direction.iter_mut().zip(at_start.row(row)).for_each(|(sum, j)| *sum += along * j * r.x);
            }
            if direction.iter().all(|by| by.is_finite()) {
                made.sum += &direction * (mean - used);
                if left != 0.0 {
                    made.unknown.push(direction * left);
                }
            }
        }
    }
}

/// Returns the integrals over a step of the given functions minus those of the trapezoidal rule.
fn beyond_ends(data: &UnseenData, [from, to]: [f64; 2], of: &mut impl InTime) -> DVector<f64> {
    let count = data.integrals.len();
    let [mut at_start, mut at_end] = [vec![0.0; count], vec![0.0; count]];
    of.at(from, &mut at_start);
    of.at(to, &mut at_end);
    DVector::from_fn(count, |i, _| data.integrals[i][0] - 0.5 * (to - from) * (at_start[i] + at_end[i]))
}

/// Removes from bounds on a change of coordinates or velocities the components that contacts and joints do not allow,
/// separately for each component since it may have either sign. Bounds that would grow are kept.
fn hold_back_bounds(bounds: &mut [f64], mut hold_back: impl FnMut(&mut [f64])) {
    let mut held = vec![0.0; bounds.len()];
    for k in (0..bounds.len()).filter(|&k| bounds[k] != 0.0) {
        let mut one = vec![0.0; bounds.len()];
        one[k] = bounds[k];
        hold_back(&mut one);
        held.iter_mut().zip(one).for_each(|(held, one)| *held += one.abs());
    }
    let grows = held.iter().zip(&*bounds).any(|(held, bound)| held > bound);
    if !grows {
        bounds.copy_from_slice(&held);
    }
}
