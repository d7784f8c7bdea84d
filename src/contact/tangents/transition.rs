//! The derivatives across the end of a smooth arc: of the time of its event, of the impact, and of the state in the
//! new mode.

use super::event::{Crossed, EventSlope, TimedEvent, between, contact, kind};
use super::impact::{self, Blow, Moved};
use super::linearised::{Columns, Linearised, Place, Terms, solve};
use super::{NoDerivative, Tangents};
use crate::locate::{Ending, EventDriven, Impact, ModeEquations, Status, Transition, held};
use crate::velocity_step::State;
use nalgebra::{DMatrix, RowDVector, Vector3};
use problem::Constraints;

/// Tolerances: two events are one if the derivatives of their times agree to the fraction `ALIKE`; derivatives may
/// miss the constraints of a mode by the fraction `ALIKE`, or `OFF` times the relative tolerance of the run, and by
/// `MOST_OFF` at most.
const ALIKE: f64 = 1e-6;
const OFF: f64 = 1e3;
const MOST_OFF: f64 = 0.1;

/// A monitor (event function) counts as zero if its value is below this fraction of the size of its terms.
pub(super) const ON_BOUND: f64 = 1e-6;

/// Sets of coordinates that one event moves together: bodies coupled by masses, joints, or contacts with an impulse.
struct Islands {
    of: Vec<usize>,
}

impl Islands {
    /// Builds the islands of coordinates that move together at an event; `groups` are the rows of `J` that act
    /// together: those of a joint, or of all directions of a contact.
    fn new(mass: &DMatrix<f64>, constraints: &Constraints, groups: impl Iterator<Item = Vec<usize>>) -> Self {
        let n = mass.nrows();
        let mut islands = Self { of: (0..n).collect() };
        for i in 0..n {
            for j in 0..i {
                if mass[(i, j)] != 0.0 {
                    islands.join(i, j);
                }
            }
        }
        for rows in groups {
            let mut moved = (0..n).filter(|&i| rows.iter().any(|&row| constraints.row(row)[i] != 0.0));
            if let Some(first) = moved.next() {
                moved.for_each(|other| islands.join(first, other));
            }
        }
        islands
    }

    fn join(&mut self, i: usize, j: usize) {
        let (from, to) = (self.of[i], self.of[j]);
        self.of.iter_mut().filter(|island| **island == from).for_each(|island| *island = to);
    }

    /// Returns the island of coordinates that a row of `J` belongs to.
    fn of_row(&self, constraints: &Constraints, row: usize) -> Option<usize> {
        constraints.row(row).iter().position(|j| *j != 0.0).map(|i| self.of[i])
    }
}

/// The derivatives of the time of the last transition, for each coordinate, and whether the transition belonged to
/// the island of that coordinate.
#[derive(Clone, Debug)]
pub(super) struct Instant {
    pub times: DMatrix<f64>,
    pub happened: Vec<bool>,
}

/// The roots of a gap near an impact, whose time is known to the rounding of the clock only: for short flights this
/// rounding is a sizeable fraction of the flight, and of the derivatives divided by its length.
#[derive(Clone, Copy, Debug, Default)]
struct Root {
    /// The time from the located impact to the root of the gap on the arc before the impact.
    ahead: f64,
    /// The contact whose gap closes at the impact.
    contact: Option<usize>,
}

impl Root {
    /// Returns the gap divided by its velocity at the last evaluation, with velocities `v` after the impact: the time
    /// since the root of the gap on the arc after the impact. Zero if the contact does not open.
    fn since(&self, equations: &ModeEquations, v: &[f64]) -> f64 {
        let Some(k) = self.contact.filter(|&k| equations.mode()[k] == Status::Open) else { return 0.0 };
        let (structure, constraints) = (equations.shape(), equations.constraints());
        let row = structure.normal(k);
        let speed = constraints.velocity(row, v);
        if speed > ALIKE * constraints.terms(row, v) { constraints.values[structure.joints + k] / speed } else { 0.0 }
    }
}

impl Tangents {
    /// Rejects a run that begins with an impact if a direction changes the gap of a contact struck at the start.
    pub(super) fn check_start(
        &mut self,
        located: &EventDriven<'_>,
        transition: &Transition,
    ) -> Result<(), NoDerivative> {
        let Some(impact) = transition.impact.as_ref().filter(|_| !self.is_basis) else { return Ok(()) };
        let structure = self.structure.clone();
        let columns = Columns { coordinates: structure.coordinates, directions: self.directions.count() };
        let State { t, q, v } = &located.state;
        let none = (vec![0.0; structure.coordinates], vec![0.0; structure.rows()]);
        let place = Place { t: *t, q, v, a: &none.0, lambda: &none.1 };
        let terms = Terms::at(self.equations.problem(), &structure, place, &mut self.directions);
        let struck = (0..structure.contacts.len()).filter(|&k| impact.contacted.r[k].x > 0.0);
        for gradient in struck.map(|k| terms.values.row(structure.joints + k)) {
            for (column, now) in self.now.column_iter().enumerate() {
                let (of_x, own) = (gradient.columns(0, now.nrows()), gradient[columns.direction(column)]);
                let size = (of_x.abs() * now.abs())[(0, 0)] + own.abs();
                if ((of_x * now)[(0, 0)] + own).abs() > ALIKE * size {
                    return Err(NoDerivative::OffContact);
                }
            }
        }
        Ok(())
    }

    /// Carries the derivatives of the states across a transition, to the state and mode of the run; returns the
    /// derivatives of the event time, for each coordinate.
    pub(super) fn pass(
        &mut self,
        located: &mut EventDriven<'_>,
        transition: &Transition,
    ) -> Result<DMatrix<f64>, NoDerivative> {
        let Transition { before: State { t, q, v }, impact, ending, .. } = transition;
        if let Some(Impact { accumulates: Some(k), .. }) = impact
            && self.structure.contacts[*k].restitution == 1.0
        {
            return Err(NoDerivative::Elastic);
        }
        if transition.grazes {
            return Err(NoDerivative::Grazing);
        }
        if impact.as_ref().is_some_and(|impact| impact.is_limited) {
            return Err(NoDerivative::Limited);
        }
        let Some(mode) = located.mode.clone() else { return Err(NoDerivative::SteppedOver) };
        let (n, p) = (self.structure.coordinates, self.directions.count());
        let mut moved = Moved {
            q: self.now.rows(0, n).into_owned(),
            v: self.now.rows(n, n).into_owned(),
            times: DMatrix::zeros(n, p),
        };
        let unmoved = self.now.clone();
        let mut rates = [v.as_slice(), &vec![0.0; n]].concat();
        let mut roots = vec![Root::default(); n];
        if let Some(ending) = ending {
            let x = [q.as_slice(), v].concat();
            let linearised = Linearised::at(&mut self.equations, *t, &x, &mut self.directions)
                .ok_or(NoDerivative::Smooth(radau::NoDerivative::Singular))?;
            rates[n..].copy_from_slice(&self.equations.a);
            roots = self.find_times(*ending, (transition, &mode), (&linearised, &rates), &mut moved.times)?;
        }
        for (i, Root { ahead, .. }) in roots.iter().enumerate() {
            let mut q = moved.q.row_mut(i);
            q += moved.v.row(i) * *ahead + moved.times.row(i) * (rates[i] + ahead * rates[n + i]);
            let mut v = moved.v.row_mut(i);
            v += moved.times.row(i) * rates[n + i];
        }
        let mut velocities = v.clone();
        if let Some(impact) = impact {
            self.pass_blows((*t, q, &mut velocities), impact, &mut moved)?;
        }
        let least = located.tolerances_of_slips();
        self.equations.set_mode(&mode, (&located.loads, &located.coefficients), &least);
        let State { q, v, .. } = &located.state;
        self.equations.evaluate_at(*t, &[q.as_slice(), v].concat());
        for (i, root) in roots.iter().enumerate() {
            let (a, since) = (self.equations.a[i], root.since(&self.equations, v));
            let of_v = moved.v.row(i) - moved.times.row(i) * a;
            let of_q = moved.q.row(i) - moved.times.row(i) * (v[i] - since * a) + &of_v * since;
            self.now.row_mut(i).copy_from(&of_q);
            self.now.row_mut(n + i).copy_from(&of_v);
        }
        if self.now.iter().any(|value| !value.is_finite()) {
            return Err(NoDerivative::Smooth(radau::NoDerivative::Singular));
        }
        for (i, rate) in rates.iter().enumerate() {
            let of_time = moved.times.row(i % n).abs() * rate.abs();
            let mut terms = self.terms.row_mut(i);
            terms += unmoved.row(i).abs() + of_time;
        }
        self.keep_to_constraints(&mode, located, (&unmoved, &rates), &moved.times)?;
        Ok(moved.times)
    }

    /// Computes the derivatives of the times of the events that end a smooth arc, for each coordinate; records them,
    /// and returns the roots of the gaps that close.
    fn find_times(
        &mut self,
        ending: Ending,
        (transition, after): (&Transition, &[Status]),
        (linearised, rates): (&Linearised, &[f64]),
        times: &mut DMatrix<f64>,
    ) -> Result<Vec<Root>, NoDerivative> {
        let Transition { before: State { t, q, v }, mode, impact, .. } = transition;
        let structure = self.structure.clone();
        let constraints = self.equations.constraints().clone();
        let mut mass = DMatrix::zeros(q.len(), q.len());
        self.equations.problem().mass(*t, q, &mut mass);
        let first = contact(ending);
        let has_impulse = |k: usize| impact.as_ref().is_some_and(|impact| impact.contacted.r[k].x > 0.0);
        let contacts = 0..structure.contacts.len();
        let coupled = |k: &usize| has_impulse(*k) || mode[*k].is_closed() || after[*k].is_closed();
        let of_contact = |k: usize| std::iter::once(structure.normal(k)).chain(structure.tangents(k)).collect();
        let of_joints = (0..structure.joints).map(|row| vec![row]);
        let groups = of_joints.chain(contacts.clone().filter(coupled).map(of_contact));
        let islands = Islands::new(&mass, &constraints, groups);
        let state = (rates, &self.now, &self.largest);
        let crossed = |ending: Ending| Crossed::at(ending, &self.equations, linearised, &self.directions, state);
        let is_of_forces = |ending: &Ending| matches!(ending, Ending::Detachment(_) | Ending::StickToSlip(..));

        let mut events = vec![ending];
        for k in contacts.filter(|&k| k != first) {
            let normal = structure.normal(k);
            let approaches = || constraints.velocity(normal, v) < -ALIKE * constraints.terms(normal, v);
            let gap = constraints.values[structure.joints + k];
            let meets = mode[k] == Status::Open
                && impact.as_ref().is_some_and(|impact| {
                    has_impulse(k) || impact.contacted.before[k].x < 0.0 && approaches() && gap.is_finite()
                });
            if meets {
                events.push(Ending::Impact(k));
            } else if impact.is_none()
                && let Some(other) = between(&structure, k, mode[k], after[k])
                && self.is_on_bound(other, v)
            {
                events.push(other);
            }
        }
        let mut found: Vec<(usize, RowDVector<f64>)> = Vec::new();
        // A transition that immediately follows an earlier event has the time of that event, along all directions.
        let mut followed: Vec<usize> = Vec::new();
        for (i, &island) in islands.of.iter().enumerate() {
            if let Some(instant) = self.instant.as_ref().filter(|instant| instant.happened[i])
                && !followed.contains(&island)
            {
                followed.push(island);
                found.push((island, instant.times.row(i).into_owned()));
            }
        }
        let mut roots = vec![Root::default(); q.len()];
        for event in events {
            let k = contact(event);
            if linearised.is_redundant && is_of_forces(&event) {
                return Err(NoDerivative::Redundant);
            }
            let mut monitor = crossed(event);
            let island = islands.of_row(&constraints, structure.normal(k)).ok_or(NoDerivative::Grazing)?;
            let slopes = match found.iter().find(|(other, _)| *other == island) {
                Some((_, times)) if followed.contains(&island) => times.clone(),
                Some((_, times)) if monitor.agrees(times, ALIKE) => times.clone(),
                Some((_, times)) if self.is_basis => times.clone(),
                Some(_) => return Err(NoDerivative::Several),
                None => {
                    if let Ending::Impact(k) = event {
                        let ahead = -constraints.values[structure.joints + k] / monitor.rate;
                        let ahead = if ahead.is_finite() { ahead } else { 0.0 };
                        let root = Root { ahead, contact: Some(k) };
                        let of_island = islands.of.iter().zip(&mut roots).filter(|(of, _)| **of == island);
                        of_island.for_each(|(_, place)| *place = root);
                        let row = structure.normal(k);
                        let (n, p) = (q.len(), self.directions.count());
                        let speed = linearised.velocity.row(row);
                        let speeds = speed.columns(0, 2 * n) * &self.now + speed.columns(2 * n, p);
                        monitor.move_to(ahead, self.equations.rate_of_row(row), &speeds);
                    }
                    let slopes = monitor.times()?;
                    found.push((island, slopes.clone()));
                    slopes
                }
            };
            let transversality = monitor.rate.abs();
            let recorded = |t: f64, kind: TimedEvent, slopes: &RowDVector<f64>| EventSlope {
                t,
                kind,
                contact: k,
                slopes: slopes.iter().copied().collect(),
                transversality,
            };
            let accumulates = impact.as_ref().is_some_and(|impact| impact.accumulates == Some(k));
            if let Ending::Impact(_) = event {
                self.flights[k].note(*t, &slopes);
            }
            if accumulates {
                let (t, slopes) = self.flights[k].limit().unwrap_or((*t, slopes));
                self.events.push(recorded(t, TimedEvent::Accumulation, &slopes));
            } else {
                self.events.push(recorded(*t, TimedEvent::Contact(kind(event)), &slopes));
            }
        }
        let mut happened = vec![false; q.len()];
        for (i, island) in islands.of.iter().enumerate() {
            if let Some((_, slopes)) = found.iter().find(|(other, _)| other == island) {
                times.row_mut(i).copy_from(slopes);
                happened[i] = true;
            }
        }
        self.instant = Some(Instant { times: times.clone(), happened });
        Ok(roots)
    }

    /// Whether the monitor (event function) of the event `ending` is zero at the last evaluation; for an impact,
    /// whether the gap closes with a nonzero velocity.
    fn is_on_bound(&self, ending: Ending, v: &[f64]) -> bool {
        let (equations, structure) = (&self.equations, &self.structure);
        let forces = equations.lambda.iter().fold(0.0_f64, |most, force| most.max(force.abs()));
        match ending {
            Ending::Impact(k) => {
                let (row, constraints) = (structure.normal(k), equations.constraints());
                constraints.velocity(row, v).abs() > ON_BOUND * constraints.terms(row, v)
            }
            Ending::Detachment(k) => equations.lambda[structure.normal(k)].abs() <= ON_BOUND * forces,
            Ending::StickToSlip(k, _) => {
                let bound = structure.contacts[k].mu * equations.lambda[structure.normal(k)];
                (bound - equations.friction(k)).abs() <= ON_BOUND * forces
            }
            Ending::SlipToStick(k) => {
                let terms = structure.tangents(k).map(|row| equations.constraints().terms(row, v));
                equations.slip(k, v).norm() <= ON_BOUND * terms.fold(0.0, f64::max)
            }
        }
    }

    /// Carries velocities and derivatives across the successive blows (instantaneous impulses) of an impact.
    fn pass_blows(
        &mut self,
        (t, q, v): (f64, &[f64], &mut Vec<f64>),
        impact: &Impact,
        moved: &mut Moved,
    ) -> Result<(), NoDerivative> {
        let structure = self.structure.clone();
        let mut rest = impact.contacted.r.clone();
        let none = vec![Vector3::zeros(); rest.len()];
        let problem = self.equations.problem();
        for &(k, strike) in &impact.strikes {
            let mut r = none.clone();
            r[k] = strike;
            rest[k] -= strike;
            let blow = Blow { r: &r, rebounds: impact.rebounds };
            impact::pass(problem, &structure, (t, q, v), &blow, &mut self.directions, moved)?;
        }
        let size = impact.contacted.r.iter().map(Vector3::norm).fold(0.0, f64::max);
        // The impulses that remain after the sequential strikes are rounding errors, unless the number of strikes
        // reached its limit: the simultaneous impact law then applies the remaining impulses.
        let is_rest = |r: &Vector3<f64>| r.norm() > ON_BOUND * size;
        if impact.strikes.is_empty() || rest.iter().any(is_rest) {
            let blow = Blow { r: &rest, rebounds: impact.rebounds };
            impact::pass(problem, &structure, (t, q, v), &blow, &mut self.directions, moved)?;
        }
        Ok(())
    }

    /// Projects the derivatives onto the linearised constraints of a mode, with the least change in the metric of
    /// `M`.
    ///
    /// # Errors
    /// Fails if the derivatives violate the constraints by more than the errors of the run explain.
    pub(super) fn keep_to_constraints(
        &mut self,
        mode: &[Status],
        located: &EventDriven<'_>,
        (before, rates): (&DMatrix<f64>, &[f64]),
        times: &DMatrix<f64>,
    ) -> Result<(), NoDerivative> {
        let rows = held(&self.structure, mode);
        if rows.is_empty() {
            return Ok(());
        }
        let structure = self.structure.clone();
        let (n, p) = (structure.coordinates, self.directions.count());
        let columns = Columns { coordinates: n, directions: p };
        let State { t, q, v } = &located.state;
        let (a, lambda) = (self.equations.a.clone(), self.equations.lambda.clone());
        let place = Place { t: *t, q, v, a: &a, lambda: &lambda };
        let terms = Terms::at(self.equations.problem(), &structure, place, &mut self.directions);
        let tolerance = ALIKE.max(OFF * located.radau.rtol).min(MOST_OFF);
        // The scale for terms of the derivatives that may cancel: the derivatives before and after, and their shift by
        // the change of the event time.
        let mut size = self.now.abs() + before.abs();
        // Forces that balance each other leave rounding errors of the size of the largest derivative, in units of the
        // tolerances.
        let atol = &located.radau.atol[..2 * n];
        for (mut size, largest) in size.column_iter_mut().zip(self.largest.column_iter()) {
            let parts = largest.iter().zip(atol).filter(|(_, atol)| **atol > 0.0).map(|(largest, atol)| largest / atol);
            let most = f64::EPSILON.sqrt() * parts.fold(0.0, f64::max);
            let rounding =
                largest.iter().zip(atol).map(|(largest, atol)| (f64::EPSILON.sqrt() * largest).max(most * atol));
            size.iter_mut().zip(rounding).for_each(|(size, rounding)| *size += rounding);
        }
        // Terms of the derivatives that cancel, such as those of a mass that cancels out, also leave rounding errors.
        size.zip_apply(&self.terms, |size, terms| *size += f64::EPSILON.sqrt() * terms);
        for (i, (after, before)) in v.iter().chain(&a).zip(rates).enumerate() {
            let mut row = size.row_mut(i);
            row += times.row(i % n).abs() * (after.abs() + before.abs());
        }
        let singular = NoDerivative::Smooth(radau::NoDerivative::Singular);
        let mut mass = DMatrix::zeros(n, n);
        self.equations.problem().mass(*t, q, &mut mass);
        let transposed = &self.equations.constraints().transposed;
        let holonomic: Vec<usize> =
            rows.iter().copied().filter(|&row| row < structure.joints + structure.contacts.len()).collect();
        for (held, of, first) in [(&holonomic, &terms.values, 0), (&rows, &terms.velocity, n)] {
            let off = DMatrix::from_fn(held.len(), p, |i, column| {
                let gradient = of.row(held[i]);
                let by_state = gradient.columns(0, 2 * n) * self.now.column(column);
                by_state[(0, 0)] + gradient[columns.direction(column)]
            });
            for (i, &row) in held.iter().enumerate() {
                let gradient = of.row(row);
                for column in 0..p {
                    let scale = (gradient.columns(0, 2 * n).abs() * size.column(column))[(0, 0)]
                        + gradient[columns.direction(column)].abs();
                    if !self.is_basis && off[(i, column)].abs() > tolerance * scale {
                        return Err(NoDerivative::OffContact);
                    }
                }
            }
            let count = held.len();
            let mut matrix = DMatrix::zeros(n + count, n + count);
            let mut right = DMatrix::zeros(n + count, p);
            matrix.view_mut((0, 0), (n, n)).copy_from(&mass);
            for (i, &row) in held.iter().enumerate() {
                matrix.view_mut((0, n + i), (n, 1)).copy_from(&transposed.column(row));
                matrix.view_mut((n + i, 0), (1, n)).copy_from(&transposed.column(row).transpose());
            }
            right.rows_mut(n, count).copy_from(&-off);
            let change = solve(matrix, &right).ok_or(singular)?;
            let mut now = self.now.rows_mut(first, n);
            now += change.rows(0, n);
        }
        Ok(())
    }
}
