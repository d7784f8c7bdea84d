//! Variations of friction coefficients between the times at which steps of rigid bodies evaluate them, along the path
//! of the contacts in a step.

use super::unseen_data::{OfStates, OnWay, UnseenData, value};
use expression::IntervalWorkspace;
use models::rigid_bodies::{Coefficient, MoreauStepping, Motion, MultibodySystem, Rubbing};
use nalgebra::{Quaternion, Vector3};
use numerics::Interval;

/// The change of a body's position and orientation, or of its velocity and angular velocity.
type Change = (Vector3<f64>, Vector3<f64>);

/// The displacements of the bodies by variations of friction coefficients between the times at which steps evaluate
/// them.
pub(super) struct UnseenFriction {
    coefficients: Vec<(Coefficient, IntervalWorkspace, UnseenData)>,
    /// The displacements of each moving body by missed variations of friction (index 0), and bounds on their errors in
    /// the direction of the friction (index 1); for each the changes of position and orientation, then those of the
    /// velocities.
    displaced: [[Vec<Change>; 2]; 2],
}

/// The friction coefficient of a contact as a function of the contact point. For a sticking contact the coefficient
/// is cut off at the value `most` that the contact needs.
struct FrictionOfPlace<'s> {
    coefficient: &'s mut Coefficient,
    boxes: &'s mut IntervalWorkspace,
    slip_speed: f64,
    most: f64,
}

impl OfStates for FrictionOfPlace<'_> {
    fn at(&mut self, t: f64, place: &[f64], out: &mut [f64]) {
        let found = self.coefficient.at(t, &Vector3::from_column_slice(place), self.slip_speed);
        out[0] = found.unwrap_or_else(|value| value).min(self.most);
    }

    fn enclose(&mut self, t: Interval, place: &[Interval], out: &mut [Interval]) {
        let range = self.coefficient.enclose(t, place, self.slip_speed, self.boxes);
        out[0] = Interval { lo: range.lo.min(self.most), hi: range.hi.min(self.most), ..range };
    }
}

impl UnseenFriction {
    /// Prepares the estimate of missed variations of friction for the bodies of a scene; returns `None` if no friction
    /// coefficient varies.
    pub fn of(scene: &MultibodySystem) -> Option<Self> {
        let new = |coefficient: &Coefficient| {
            (coefficient.clone(), IntervalWorkspace::new(&coefficient.program), UnseenData::default())
        };
        let coefficients: Vec<_> = scene.laws.coefficients.iter().map(new).collect();
        let still = || vec![Change::default(); scene.bodies.iter().filter(|body| !body.fixed).count()];
        let displaced = [[still(), still()], [still(), still()]];
        (!coefficients.is_empty()).then_some(Self { coefficients, displaced })
    }

    /// Adds the displacements by the variations of friction coefficients in the last step of a run.
    pub fn step(&mut self, [from, to]: [f64; 2], simulation: &MoreauStepping<'_>) {
        let h = to - from;
        let mut changes = [0, 1].map(|part: usize| vec![Change::default(); self.displaced[part][1].len()]);
        for rubbing in simulation.rubbing(h) {
            let by = self.missed([from, to], &rubbing);
            for (changes, by) in changes.iter_mut().zip(by) {
                for (body, velocity, omega) in &rubbing.pushes {
                    changes[*body].0 += velocity * by;
                    changes[*body].1 += omega * by;
                }
            }
        }
        for ([places, velocities], changes) in self.displaced.iter_mut().zip(changes) {
            for ((place, velocity), change) in places.iter_mut().zip(&mut *velocities).zip(changes) {
                place.0 += (velocity.0 + change.0 * 0.5) * h;
                place.1 += (velocity.1 + change.1 * 0.5) * h;
                *velocity = (velocity.0 + change.0, velocity.1 + change.1);
            }
            let moves = |by: &[Change]| by.iter().any(|by| *by != Change::default());
            if moves(places) || moves(velocities) {
                simulation.restrain(h, false, places);
                simulation.restrain(h, true, velocities);
            }
        }
    }

    /// Returns the mean friction coefficient of a contact over a step minus the coefficient that the step used, and a
    /// bound on the error of this difference.
    fn missed(&mut self, [from, to]: [f64; 2], rubbing: &Rubbing) -> [f64; 2] {
        let Rubbing { places, slip_speed, used, .. } = rubbing;
        let (coefficient, boxes, data) = &mut self.coefficients[rubbing.coefficient];
        let most = if rubbing.is_stuck { *used } else { f64::INFINITY };
        let mut of_place = FrictionOfPlace { coefficient, boxes, slip_speed: *slip_speed, most };
        let closed = [from + rubbing.begin * (to - from), to];
        let mut on_way = OnWay::new(&mut of_place, closed, [places[0].as_slice(), places[1].as_slice()]);
        let seen = match rubbing.stages {
            Some(stages) if !rubbing.is_stuck => {
                stages.iter().map(|(part, weight)| weight * value(&mut on_way, from + part * (to - from))).sum()
            }
            _ => *used,
        };
        let [mean, left] = data.mean(closed, rubbing.is_struck, &mut on_way);
        [mean - seen, left]
    }

    /// Adds the displacement of a body by missed variations of friction, and bounds on the error of the displacement,
    /// to the outputs of the body.
    pub fn displace(&self, body: usize, motion: &Motion, out: &mut [f64]) {
        for [places, velocities] in &self.displaced {
            let ((place, turn), (velocity, omega)) = (places[body], velocities[body]);
            let turned = Quaternion::from_parts(0.0, 0.5 * turn) * motion.pose.rotation.into_inner();
            let all = place.iter().copied().chain([turned.w, turned.i, turned.j, turned.k]);
            let all = all.chain(velocity.iter().copied()).chain(omega.iter().copied());
            // A bound on an error may have either sign: it is added with the sign that enlarges the output.
            out.iter_mut().zip(all).for_each(|(out, by)| *out += if *out * by < 0.0 { -by } else { by });
        }
    }
}
