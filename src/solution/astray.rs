//! Displacements of rigid bodies by errors of impacts: errors of the direction or speed after an impact, and
//! uncertain orders of impacts.

use super::misdirection::Misdirection;
use super::order_of_impacts::{Mistake, OrderOfImpacts};
use models::rigid_bodies::{MoreauStepping, Motion, MultibodySystem, OF_BODY};
use nalgebra::Vector3;

/// The errors of the motions of all bodies due to impacts so far.
pub(super) struct Astray {
    /// For each moving body, the errors of its velocity and of its angular velocity.
    bodies: Vec<[Misdirection; 2]>,
    /// The order of the impacts, compared with a run with longer steps; `None` if impacts are not located.
    order: Option<OrderOfImpacts>,
}

impl Astray {
    /// Creates the errors of the given number of moving bodies, whose impacts are located in time or not.
    pub fn new(bodies: usize, are_located: bool) -> Self {
        let order = are_located.then(|| OrderOfImpacts::new(bodies));
        Self { bodies: vec![Default::default(); bodies], order }
    }

    /// Adds the errors of the impacts in the last step of a run: a step of length `h` that began with the motions
    /// `starts` and ended at the time `t`.
    pub fn step(&mut self, scene: &MultibodySystem, run: &MoreauStepping<'_>, starts: &[Motion], [h, t]: [f64; 2]) {
        let directions = run.misdirected(starts, h);
        let errors = directions.into_iter().zip(run.restituted(starts, h)).zip(damped(scene, [starts, &run.ends], h));
        for ((of, motion), ((by, taken), damped)) in self.bodies.iter_mut().zip(&run.ends).zip(errors) {
            let [velocity, omega] = [by.0.zip_map(&taken.0, f64::hypot), by.1.zip_map(&taken.1, f64::hypot)];
            let [speed, spin] = speeds_of(motion);
            of[0].step(h, speed, [taken.0.norm(), damped[0]], velocity.as_slice());
            of[1].step(h, spin, [taken.1.norm(), damped[1]], omega.as_slice());
        }
        let Some(order) = &mut self.order else { return };
        order.take(false, run.impacts().iter().cloned());
        if run.is_passed() {
            order.forget(t);
        } else if self.bodies.iter().flatten().any(Misdirection::is_any) {
            for (of, held) in self.bodies.iter_mut().zip(run.held::<6>()) {
                of.iter_mut().zip(held.chunks(3)).for_each(|(of, held)| of.hold(held));
            }
        }
    }

    /// Adds the last step of a run with longer steps, from `begin` to `end`, and compares its impacts with those of
    /// the run, which has reached the motions `ends` at the time `t`. Returns whether the order of some impacts is
    /// uncertain.
    pub fn compare(
        &mut self,
        longer: &MoreauStepping<'_>,
        [begin, end]: [f64; 2],
        (ends, t): (&[Motion], f64),
    ) -> bool {
        let Some(order) = &mut self.order else { return false };
        if longer.is_passed() {
            order.forget(end);
            return false;
        }
        order.take(true, longer.impacts().iter().cloned());
        let mistakes = order.mistakes(end, end - begin);
        for Mistake { body, t: at, change } in &mistakes {
            let speeds = speeds_of(&ends[*body]);
            for ((of, change), speed) in self.bodies[*body].iter_mut().zip(change).zip(speeds) {
                of.mistake(t - at, speed, change.as_slice());
            }
        }
        !mistakes.is_empty()
    }

    /// Writes the displacements of the positions, orientations and velocities of all bodies that follow from the
    /// errors so far; `ends` are the motions at the end of the last step. Returns false if all displacements are
    /// zero.
    pub fn displace(&self, ends: &[Motion], out: &mut [f64]) -> bool {
        let mut is_any = false;
        for ((of, motion), out) in self.bodies.iter().zip(ends).zip(out.chunks_exact_mut(OF_BODY.len())) {
            let [speed, spin] = speeds_of(motion);
            let turned = of[1].of_place().map(|by| by * by).sum::<f64>().sqrt();
            out[..3].iter_mut().zip(of[0].of_place()).for_each(|(out, by)| *out = by);
            out[3..7].fill(0.5 * turned);
            out[7..10].iter_mut().zip(of[0].of_velocity(speed)).for_each(|(out, by)| *out = by);
            out[10..].iter_mut().zip(of[1].of_velocity(spin)).for_each(|(out, by)| *out = by);
            is_any |= out.iter().any(|by| *by != 0.0);
        }
        is_any
    }
}

/// Returns the speed and the angular speed of the motion of a body.
fn speeds_of(motion: &Motion) -> [f64; 2] {
    [motion.velocity.norm(), motion.omega.norm()]
}

/// Returns, for each moving body, the speed and the angular speed that a bouncing body would lose in a step of length
/// `h`, pressed by the contact forces of the step. Under an acceleration `a`, a bounce with speed `v` takes the time
/// `2 v/a` and leaves the speed `e v`: the speed decreases at the rate `(1 - e) a/2` until the body rests.
fn damped<'a>(
    scene: &MultibodySystem,
    [starts, ends]: [&'a [Motion]; 2],
    h: f64,
) -> impl Iterator<Item = [f64; 2]> + use<'a> {
    let part = 0.5 * (1.0 - scene.laws.largest_restitution());
    let fall: Vector3<f64> = h * scene.gravity;
    starts.iter().zip(ends).map(move |(before, after)| {
        let pressed = after.velocity - before.velocity - fall;
        [pressed, after.omega - before.omega].map(|change| part * change.norm())
    })
}
