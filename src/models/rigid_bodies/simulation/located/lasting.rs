//! A smooth arc without impacts. Bodies with sustained contacts move by a diagonally implicit Runge-Kutta method of
//! two stages (Alexander 1977), of order two and L-stable, over the length `s` of the arc,
//!
//! ```text
//! p_i = p + s (a_i1 f_1 + a_i2 f_2),    a_11 = a_22 = c,    a_21 = 1 - c,    c = 1 - 1/sqrt(2)
//! q+ = q (+) s ((1 - c) v_1 + c v_2),    p+ = p_2
//! ```
//!
//! with momenta `p` in world axes, so that the gyroscopic terms need no quadrature, and forces `f` of gravity and of
//! contacts. The contacts of each stage obey the contact law at the velocities of the stage: a stage is a step of
//! time stepping of length `c s`. The pose of a stage is extrapolated, with an error of second order in the step,
//! which causes an error of third order in the impulse. The method is stiffly accurate: the velocities at the end of
//! the arc obey the contact law.
//!
//! Gaps of sustained contacts are constrained on velocity level. The drift of a gap is closed by the velocity
//! `-gap/h`, for the whole step `h` and the gap at the beginning of the arc: the gap of an extrapolated pose has an
//! error of second order, and the velocity would have an error of first order.

use super::super::super::motion::Motion;
use super::super::{MoreauStepping, StepFailure};
use super::transition::{Begun, Next, Search};
use super::{Arc, Located};
use nalgebra::Vector3;
use problem::Control;
use std::f64::consts::FRAC_1_SQRT_2;

/// The diagonal coefficient `c` of the two-stage Runge-Kutta method by which smooth arcs are integrated.
const DIAGONAL: f64 = 1.0 - FRAC_1_SQRT_2;

/// The weight of the contact impulses of the first stage in the update at the end of the smooth arc, relative to those
/// in the stage.
const CARRIED: f64 = (1.0 - DIAGONAL) / DIAGONAL;

/// Maximum number of lengths tried for one smooth arc. Bisection takes about twenty; each contact that closes takes a
/// few, since the paths of bodies with sustained contacts depend on the length of the arc (in third order).
const TRIALS: usize = 64;

/// Relative change of the length of a smooth arc below which the arc is not computed again.
const SAME: f64 = 1e-12;

impl MoreauStepping<'_> {
    /// Moves the bodies along a smooth arc until the first contact closes or the force of a sustained contact jumps, at
    /// most for a time `rest`; the contacts of `self` must be those that may close within this time.
    pub(super) fn glide(&mut self, located: &mut Located, rest: f64, control: &Control) -> Result<(), StepFailure> {
        let (t, starts) = (self.t, self.moving.clone());
        let (report, forces) = (self.report, self.contact_forces.clone());
        let mut begun = self.begun(located);
        located.lasting.clear();
        located.lasting.extend(begun.iter().map(|begun| begun.key));
        let mut open: Vec<(u32, u32)> = self.contacts.iter().map(|contact| (contact.key.0, contact.key.1)).collect();
        open.dedup();
        // Do not search for closing contacts in pairs of bodies whose contacts are all sustained, if their contact
        // points persist while the bodies move.
        open.retain(|&(a, b)| {
            let of_pair = self.contacts.iter().map(|contact| contact.key).filter(|key| (key.0, key.1) == (a, b));
            self.is_patch((a, b)) || of_pair.into_iter().any(|key| !located.lasting.contains(&key))
        });
        located.opened = (t, Vec::new());
        let (mut s, mut search) = (rest, Search::new(rest));
        for trial in 1.. {
            let first = self.arc(located, &starts, &begun, [t, s], control)?;
            let change = self.change(located, &begun);
            let is_last = trial >= TRIALS;
            let next = match search.judge(s, change, (DIAGONAL * s, first)) {
                Next::Take => {
                    let closes = self.closes(located, &starts, &open, [t, s], control)?;
                    closes.filter(|earlier| *earlier < s * (1.0 - SAME)).inspect(|&earlier| {
                        search = Search::new(earlier);
                    })
                }
                Next::Try(length) => Some(length),
                Next::Without(opened) => {
                    begun.retain(|begun| !opened.contains(&begun.key));
                    opened.iter().for_each(|key| {
                        located.lasting.remove(key);
                        located.opened.1.push((key.0, key.1));
                        open.push((key.0, key.1));
                    });
                    open.sort_unstable();
                    open.dedup();
                    search = Search::new(rest);
                    Some(rest)
                }
            };
            match next {
                Some(length) if !is_last => {
                    self.moving.clone_from(&starts);
                    self.report = report;
                    self.contact_forces.clone_from(&forces);
                    s = length;
                }
                _ => break,
            }
        }
        located.leaving.extend(search.leaving());
        located.lasting.clear();
        located.lasting.extend(self.contacts.iter().map(|contact| contact.key));
        located.sticking.clear();
        located.sticking.extend(self.sticking(located));
        // At the end of the step, set the time exactly to the requested end time, free of rounding errors.
        self.t = if s == rest { located.begin + located.step } else { t + s };
        let times = [t - located.begin, self.t - located.begin];
        let work = [report.work, self.report.work];
        located.touched.iter_mut().zip(&self.held).for_each(|(touched, held)| *touched |= held);
        let is_exact = self.is_even(located, &starts, s);
        located.arcs.push(Arc { times, starts, ends: self.moving.clone(), held: self.held.clone(), work, is_exact });
        Ok(())
    }

    /// Returns whether all bodies moved with constant accelerations in a smooth arc of length `s`; `self` contains the
    /// bodies at the end of the arc.
    fn is_even(&self, located: &Located, starts: &[Motion], s: f64) -> bool {
        let fall = located.step * self.scene.gravity.norm();
        let bodies = self.scene.bodies.iter().filter(|body| !body.fixed);
        let mut motions = starts.iter().zip(&self.moving).zip(bodies);
        motions.all(|((start, end), body)| start.is_even(end, s, [fall, fall / body.collider.reach()]))
    }

    /// Moves the bodies along a smooth arc for a time `s` from the time `t` on, without impacts; returns the least slip
    /// of the sustained contacts in the first stage, relative to their slip at the beginning of the arc.
    fn arc(
        &mut self,
        located: &Located,
        starts: &[Motion],
        begun: &[Begun],
        [t, s]: [f64; 2],
        control: &Control,
    ) -> Result<f64, StepFailure> {
        self.held.fill(false);
        for body in begun.iter().flat_map(|begun| [begun.key.0, begun.key.1]) {
            if let Some(place) = self.places[body as usize] {
                self.held[place as usize] = true;
            }
        }
        let gravity = self.scene.gravity;
        for (motion, _) in self.moving.iter_mut().zip(&self.held).filter(|(_, is_held)| !**is_held) {
            motion.fly(s, &gravity);
        }
        self.contacts.clear();
        self.report.closed = 0;
        if begun.is_empty() {
            return Ok(f64::INFINITY);
        }
        let mut pairs: Vec<(u32, u32)> = begun.iter().map(|begun| (begun.key.0, begun.key.1)).collect();
        pairs.dedup();
        let held: Vec<usize> = (0..starts.len()).filter(|&place| self.held[place]).collect();
        let mut free = Vec::with_capacity(held.len());
        for &k in &held {
            let start = &starts[k];
            let kick = gravity * (DIAGONAL * s);
            self.moving[k] = start.moved([&start.velocity, &start.omega], DIAGONAL * s, [&kick, &Vector3::zeros()]);
            free.push(self.moving[k]);
        }
        self.stage(located, begun, &pairs, [t, DIAGONAL * s, s], CARRIED, control)?;
        let slip = self.least_slip(located, begun);
        let firsts: Vec<Motion> = held.iter().map(|&k| self.moving[k]).collect();
        for ((&k, free), first) in held.iter().zip(&free).zip(&firsts) {
            let kick = gravity * s + (first.velocity - free.velocity) * CARRIED;
            let turn = first.inertia_in_world() * (first.omega - free.omega) * CARRIED;
            self.moving[k] = starts[k].moved([&first.velocity, &first.omega], s, [&kick, &turn]);
        }
        self.stage(located, begun, &pairs, [t, s, s], 1.0, control)?;
        for (&k, first) in held.iter().zip(&firsts) {
            let second = self.moving[k];
            let mean = |a: &Vector3<f64>, b: &Vector3<f64>| a * (1.0 - DIAGONAL) + b * DIAGONAL;
            let momentum = second.inertia_in_world() * second.omega;
            let turn = momentum - starts[k].inertia_in_world() * starts[k].omega;
            self.moving[k] = starts[k].moved(
                [&mean(&first.velocity, &second.velocity), &mean(&first.omega, &second.omega)],
                s,
                [&(second.velocity - starts[k].velocity), &turn],
            );
        }
        self.report.closed = self.contacts.iter().filter(|contact| contact.impulse.x > 0.0).count();
        Ok(slip)
    }

    /// Solves the contact law for the sustained contacts of a stage at the time `passed` after `t`, in a smooth arc
    /// of length `s`, and adds their impulses, multiplied by `weight`, to the report. The solver starts from zero
    /// impulses: if the contact law does not determine the impulses, as for four feet on a floor, it then finds the
    /// same impulses in every run, whatever the steps.
    fn stage(
        &mut self,
        located: &Located,
        begun: &[Begun],
        pairs: &[(u32, u32)],
        [t, passed, s]: [f64; 3],
        weight: f64,
        control: &Control,
    ) -> Result<(), StepFailure> {
        self.ground_at(located, t + passed);
        self.detect_between(pairs.iter().copied(), control)?;
        let mut contacts = std::mem::take(&mut self.contacts);
        contacts.retain_mut(|contact| {
            match begun.iter().find(|begun| begun.key == contact.key) {
                Some(begun) => contact.gap = begun.gap,
                // New contact points of a contact patch between two bodies are sustained contacts as long as they are
                // closed.
                None if contact.gap > contact.no_gap || !self.is_patch((contact.key.0, contact.key.1)) => return false,
                None => {}
            }
            contact.law.restitution = 0.0;
            contact.before.x = 0.0;
            true
        });
        self.contacts = contacts;
        self.close();
        // The contact law closes a gap within its step of length `s`: scale the gap so that it is closed at the
        // velocity `-gap/h`, with the whole step `h`.
        self.contacts.iter_mut().for_each(|contact| contact.gap *= s / located.step);
        self.group();
        // The contact law evaluates coefficients of friction at the end of its step of length `s`: shift the time so
        // that this step ends at the time of the Runge-Kutta stage.
        let now = std::mem::replace(&mut self.t, t + passed - s);
        self.partition_into_islands();
        self.t = now;
        let solved = self.solve_each(|island, mechanism, law| island.solve(s, mechanism, law, control));
        control.go_on()?;
        solved?;
        self.check_law()?;
        for contact in self.contacts.iter_mut().filter(|contact| contact.impulse.x > 0.0) {
            contact.impulse *= weight;
            let of = |body: u32| (self.moving[body as usize].velocity, self.moving[body as usize].omega);
            contact.work = contact.impulse.component_mul(&contact.velocity(of));
        }
        self.book();
        Ok(())
    }
}
