//! The first time in a smooth arc at which an open contact closes.
//!
//! The gap `g` between two bodies has a second derivative of at least `-B`, where `B` follows from their
//! accelerations, their rotations and their relative velocity: distances of convex bodies are convex functions of a
//! translation. From a time with `g > 0` on there is therefore no contact before the positive root `d` of
//!
//! ```text
//! g + g' d - B d^2/2 = 0
//! ```
//!
//! and the search continues at this root: it never passes a contact, and converges to it like Newton's method
//! (conservative advancement, with the normal velocity). A contact that opens has `g = 0` and `g' > 0` at first, so
//! that the only root is that of the next contact.
//!
//! Contacts of polyhedra or capsules with each other appear and vanish as features of their surfaces pass each other,
//! and the bound holds for each contact point as long as it exists. A contact that the search nevertheless passes is
//! found by its overlap, and located by bisection.

use super::super::super::collision::{ContactPoint, contacts};
use super::super::super::motion::Motion;
use super::super::detection::margin;
use super::super::overlaps::OVERLAP;
use super::super::{MoreauStepping, StepFailure};
use super::Located;
use nalgebra::{Isometry3, Vector3};
use problem::Control;

/// Rounding error of the gap between two bodies, relative to their coordinates and sizes.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Minimum advance in time of the search for closing contacts, relative to the smooth arc: grazing contacts of shorter
/// duration are skipped.
const LEAST: f64 = 1e-3;

/// The factor by which accelerations of a body within a smooth arc may exceed their mean.
const UNEVEN: f64 = 2.0;

/// Relative rounding error of approach velocities: those below this fraction of the speeds of the surfaces are treated
/// as zero.
const SLOW: f64 = 1e-9;

/// Accuracy in time, relative to the smooth arc, to which the closing of a contact is bisected if the bound on the
/// second derivative of the gap is violated.
const PAST: f64 = 1e-12;

/// Maximum number of times at which one pair of bodies is examined for closing contacts. The smooth arc ends at the
/// last of them, and another arc continues the search.
const POINTS: usize = 200;

/// The motion of a body over a smooth arc.
enum Course<'a> {
    /// The body is at rest at this pose during the smooth arc.
    Rests(&'a Isometry3<f64>),
    /// The body has prescribed motion; the index is that among the bodies with prescribed motion.
    Given(usize),
    /// The body moves freely from this state at the beginning of the smooth arc.
    Flies(&'a Motion),
    /// The body moves with sustained contacts between these states at both ends of the smooth arc.
    Held(&'a Motion, &'a Motion),
}

/// The pose and the velocities of a body at one time of a smooth arc.
#[derive(Clone, Copy)]
struct At {
    pose: Isometry3<f64>,
    velocity: Vector3<f64>,
    omega: Vector3<f64>,
}

impl At {
    fn of(motion: &Motion) -> Self {
        Self { pose: motion.pose, velocity: motion.velocity, omega: motion.omega }
    }

    fn velocity_at(&self, place: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.omega.cross(&(place - self.pose.translation.vector))
    }
}

impl MoreauStepping<'_> {
    /// Returns the first time after the beginning `t` of a smooth arc of length `s` at which a contact between the
    /// given pairs of bodies closes that is not sustained; `None` if there is none. `self` holds the bodies at the
    /// end of the arc.
    pub(super) fn closes(
        &self,
        located: &Located,
        starts: &[Motion],
        pairs: &[(u32, u32)],
        [t, s]: [f64; 2],
        control: &Control,
    ) -> Result<Option<f64>, StepFailure> {
        let mut first = None;
        for &(a, b) in pairs {
            control.go_on()?;
            let until = first.unwrap_or(s);
            first = self.closes_of(located, starts, [a, b], [t, s, until]).or(first);
        }
        Ok(first)
    }

    fn course<'a>(&'a self, starts: &'a [Motion], body: usize) -> Course<'a> {
        match (self.places[body], self.given[body]) {
            (Some(place), _) if self.held[place as usize] => {
                Course::Held(&starts[place as usize], &self.moving[place as usize])
            }
            (Some(place), _) => Course::Flies(&starts[place as usize]),
            (None, Some(place)) => Course::Given(place as usize),
            (None, None) => Course::Rests(&self.scene.bodies[body].pose),
        }
    }

    /// Returns the pose and the velocities of a body at a time `d` after the beginning `t` of a smooth arc of length
    /// `s`.
    fn at(&self, located: &Located, course: &Course<'_>, [t, s, d]: [f64; 3]) -> At {
        match *course {
            Course::Rests(pose) => At { pose: *pose, velocity: Vector3::zeros(), omega: Vector3::zeros() },
            Course::Given(place) => {
                let mut given = self.prescribed[place];
                if let Some(by) = &self.scene.bodies[given.body].motion {
                    let passed = t + d - located.begin;
                    given.at(by, &self.scene.signals, &located.grounds[place], [located.begin, passed]);
                }
                At { pose: given.pose, velocity: given.velocity, omega: given.omega }
            }
            Course::Flies(start) => {
                let mut motion = *start;
                motion.fly(d, &self.scene.gravity);
                At::of(&motion)
            }
            Course::Held(start, end) => At::of(&start.between(end, s, d)),
        }
    }

    fn closes_of(&self, located: &Located, starts: &[Motion], pair: [u32; 2], [t, s, until]: [f64; 3]) -> Option<f64> {
        let bodies = pair.map(|body| body as usize);
        let colliders = bodies.map(|body| &self.scene.bodies[body].collider);
        let reaches = colliders.map(|collider| collider.reach());
        let courses = bodies.map(|body| self.course(starts, body));
        let at = |d: f64| [0, 1].map(|side| self.at(located, &courses[side], [t, s, d]));
        let samples = [at(0.0), at(0.5 * s), at(s)];
        let room: f64 = [0, 1].iter().map(|&side| self.room(&courses[side], &samples, side, reaches[side], s)).sum();
        let bend = bend(&samples, reaches, s);
        let far = samples[0].iter().map(|at| at.pose.translation.vector.amax()).fold(0.0, f64::max);
        let size = reaches[0].min(reaches[1]);
        let closed = ROUNDING * (far + size);
        let is_patch = self.is_patch((pair[0], pair[1])) && located.lasting.iter().any(|key| [key.0, key.1] == pair);
        let fall = located.step * self.scene.gravity.norm();
        let (mut d, mut clear, mut high) = (0.0, 0.0, None);
        let mut floors: Vec<(u64, f64)> = Vec::new();
        let mut points: Vec<ContactPoint> = Vec::new();
        for _ in 0..POINTS {
            let now = at(d);
            points.clear();
            contacts((colliders[0], &now[0].pose), (colliders[1], &now[1].pose), room, &mut points);
            points.retain(|point| !located.lasting.contains(&(pair[0], pair[1], point.id)));
            if d == 0.0 {
                // The gap of a contact that is opening may be negative at the beginning of the smooth arc, within the
                // gap tolerance.
                floors.extend(points.iter().map(|point| (point.id, point.gap.min(0.0))));
            }
            let (mut advance, mut deepest) = (f64::INFINITY, None::<f64>);
            for point in &points {
                let floor = floors.iter().find(|(id, _)| *id == point.id).map_or(0.0, |(_, floor)| *floor);
                let gap = point.gap - floor;
                let [v, w] = [0, 1].map(|side| now[side].velocity_at(&point.position));
                let rate = point.normal.dot(&(w - v));
                if is_patch && gap.abs() <= OVERLAP * size && -rate <= fall {
                    continue;
                }
                if gap <= closed && -rate > SLOW * (v.norm() + w.norm()) && d > 0.0 {
                    deepest = Some(deepest.map_or(gap, |deepest| deepest.min(gap)));
                }
                let root = (rate * rate + 2.0 * bend * gap.max(0.0)).sqrt();
                let ahead = if rate < 0.0 { 2.0 * gap.max(0.0) / (root - rate) } else { (rate + root) / bend };
                let ahead = if ahead.is_nan() { f64::INFINITY } else { ahead };
                advance = advance.min(if gap <= closed { ahead.max(LEAST * s) } else { ahead });
            }
            let least = PAST * s;
            d = match (deepest, high) {
                (Some(gap), _) if gap < -2.0 * closed && d - clear > least => {
                    // The bound on the second derivative of the gap is violated: the contact closes between the last
                    // time without a contact and the current time.
                    high = Some(d);
                    0.5 * (clear + d)
                }
                (Some(_), _) => return Some(d),
                (None, Some(high)) if high - d <= least => return Some(high),
                (None, Some(high)) => {
                    clear = d;
                    if d + advance < high { d + advance } else { 0.5 * (d + high) }
                }
                (None, None) if d >= until => return None,
                (None, None) => {
                    clear = d;
                    (d + advance).min(until)
                }
            };
        }
        Some(d)
    }

    /// Returns an upper bound on the displacement of any point of a body in a smooth arc of length `s`.
    fn room(&self, course: &Course<'_>, samples: &[[At; 2]; 3], side: usize, reach: f64, s: f64) -> f64 {
        match course {
            Course::Flies(motion) | Course::Held(motion, _) => margin(motion, reach, s * self.scene.gravity.norm(), s),
            Course::Given(_) => {
                let speed = samples.iter().map(|at| at[side].velocity.norm()).fold(0.0, f64::max);
                let spin = samples.iter().map(|at| at[side].omega.norm()).fold(0.0, f64::max);
                s * (speed + if spin > 0.0 { spin * reach } else { 0.0 })
            }
            Course::Rests(_) => 0.0,
        }
    }
}

/// Returns a bound `B` on the negative second derivative of the gaps of two bodies over a smooth arc of length `s`,
/// from the states of both bodies at its beginning, in its middle and at its end.
fn bend(samples: &[[At; 2]; 3], reaches: [f64; 2], s: f64) -> f64 {
    let apart = (samples[0][1].pose.translation.vector - samples[0][0].pose.translation.vector).norm();
    let (mut bend, mut spins) = (0.0, 0.0_f64);
    for side in [0, 1] {
        let rate = |of: &dyn Fn(&At) -> Vector3<f64>| {
            let change = |k: usize| (of(&samples[k + 1][side]) - of(&samples[k][side])).norm();
            UNEVEN * change(0).max(change(1)) / (0.5 * s)
        };
        let spin = samples.iter().map(|at| at[side].omega.norm()).fold(0.0, f64::max);
        let turning = spin * spin + rate(&|at| at.omega);
        bend += rate(&|at| at.velocity);
        if turning > 0.0 {
            // The size of a half space is infinite: use the distance and the size of the other body to bound the
            // position of the contact point.
            bend += turning * reaches[side].min(apart + reaches[1 - side]);
        }
        spins = spins.max(spin);
    }
    let speed = |at: &[At; 2]| (at[1].velocity - at[0].velocity).norm();
    bend + 2.0 * spins * samples.iter().map(speed).fold(0.0, f64::max)
}
