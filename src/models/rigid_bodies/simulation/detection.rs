//! Contact detection of a time step: contacts that may close within the step, and overlaps at its end that detection
//! has missed.

use super::super::collision::{BroadPhase, ContactPoint, contacts};
use super::super::contact::{Contact, frame};
use super::super::load::Load;
use super::super::motion::Motion;
use super::{MoreauStepping, StepFailure, overlaps};
use nalgebra::Vector3;
use problem::Control;

/// Gap, relative to a body's size, below which contacts are included at any velocity, since the impulse of one contact
/// may close another nearby contact.
pub(in super::super) const NEAR: f64 = 0.01;

/// Number of pairs of bodies processed between two polls of [`Control`] for interruption.
const AT_ONCE: usize = 1 << 8;

/// Admissible penetration of bodies with joints at the end of a step, relative to the smaller body: half of 1e-3,
/// above which a solution is reported as inaccurate, because the next step measures penetration before resolving it.
/// A smaller value would halve steps whose penetration is never reported.
const UNSEEN: f64 = 5e-4;

/// Returns the detection margin around a body: its largest displacement in a step of size `h` in which forces change
/// its speed by `fall`, plus `NEAR` times its size.
pub(super) fn margin(motion: &Motion, reach: f64, fall: f64, h: f64) -> f64 {
    h * (motion.velocity.norm() + fall + motion.omega.norm() * reach) + NEAR * reach
}

impl MoreauStepping<'_> {
    /// Finds the contacts that may close within a step of size `h`.
    pub(super) fn detect(&mut self, h: f64, control: &Control) -> Result<(), StepFailure> {
        self.search(h, true, control)
    }

    /// Finds the contacts of the given pairs of bodies, by their indices in the multibody system, that are closed or
    /// nearly closed.
    pub(super) fn detect_between(
        &mut self,
        pairs: impl Iterator<Item = (u32, u32)>,
        control: &Control,
    ) -> Result<(), StepFailure> {
        self.pairs.clear();
        self.pairs.extend(pairs);
        self.search(0.0, false, control)
    }

    /// Finds the contacts that may close within a step of size `h`: between all pairs of nearby bodies if `sweeps`,
    /// otherwise between the pairs in `self.pairs`.
    fn search(&mut self, h: f64, sweeps: bool, control: &Control) -> Result<(), StepFailure> {
        let (scene, moving, places) = (self.scene, &self.moving, &self.places);
        let (load, most) = (&mut self.load, self.most_memory);
        load.begin(scene);
        let check = |load: &Load| {
            let bytes = load.bytes();
            if bytes <= most {
                return Ok(());
            }
            Err(StepFailure::TooMuchMemory { contacts: load.contacts, most_touched: load.most_touched(), bytes })
        };
        let given = |body: usize| self.given[body].map(|place| &self.prescribed[place as usize]);
        let margin = |body: usize| {
            let reach = scene.bodies[body].collider.reach();
            match (places[body], given(body)) {
                (Some(place), _) => margin(&moving[place as usize], reach, h * scene.gravity.norm(), h),
                (None, Some(given)) => {
                    let turns = given.omega.norm();
                    h * (given.velocity.norm() + if turns > 0.0 { turns * reach } else { 0.0 })
                }
                (None, None) => 0.0,
            }
        };
        let pose = |body: usize| match (places[body], given(body)) {
            (Some(place), _) => &moving[place as usize].pose,
            (None, Some(given)) => &given.pose,
            (None, None) => &scene.bodies[body].pose,
        };
        let bounds = |body: usize| {
            let (lower, upper) = scene.bodies[body].collider.bounds(pose(body));
            let margin = Vector3::repeat(margin(body));
            (lower - margin, upper + margin)
        };
        self.contacts.clear();
        if sweeps {
            self.pairs.clear();
            self.broad_phase.sweep(
                scene.bodies.len(),
                bounds,
                |body| places[body].is_some(),
                control,
                |a, b| {
                    self.pairs.push((a, b));
                    load.pairs += 1;
                    check(load)
                },
            )?;
            self.pairs.sort_unstable();
        }
        for (k, &(a, b)) in self.pairs.iter().enumerate() {
            if k % AT_ONCE == 0 {
                control.go_on()?;
            }
            if self.joined.contains(&(a, b)) || scene.is_apart(a, b) {
                continue;
            }
            let [i, j] = [a as usize, b as usize];
            let [first, second] = [i, j].map(|body| (&scene.bodies[body].collider, pose(body)));
            self.points.clear();
            contacts(first, second, margin(i) + margin(j), &mut self.points);
            let materials = [i, j].map(|body| scene.bodies[body].material);
            let law = scene.laws.of(materials[0], materials[1]);
            load.add([i, j].map(|body| places[body].map(|_| body)), self.points.len(), law);
            check(load)?;
            let grain = law.grain.map(|grain| &scene.laws.grains[grain as usize]);
            let new = |point: &ContactPoint| {
                let frame = grain.map_or_else(
                    || frame(&point.normal),
                    |grain| grain.frame(&point.normal, materials, [pose(i), pose(j)]),
                );
                let contact = Contact::new(point, frame, [places[i], places[j]], moving, law, (a, b));
                let surface =
                    |body| given(body).map_or_else(Vector3::zeros, |given| given.velocity_at(&point.position));
                if given(i).or(given(j)).is_some() { contact.carried([i, j].map(surface)) } else { contact }
            };
            let size = overlaps::smaller(scene, i, j);
            let sized = |contact| Contact { size, no_gap: overlaps::OVERLAP * size, ..contact };
            let Some(patch) = law.patch.map(|patch| &scene.laws.patches[patch as usize]) else {
                self.contacts.extend(self.points.iter().map(new).map(sized));
                continue;
            };
            let turning = [i, j].map(|body| given(body).map_or_else(Vector3::zeros, |given| given.omega));
            for force in self.points.iter().map(new).map(sized) {
                self.contacts.extend(force.on(patch, moving, turning));
            }
        }
        self.add_stops();
        Ok(())
    }

    /// Returns whether bodies with joints overlap at the end of a step, because of the curvature of their path or
    /// because joints moved them beyond the detection margin.
    pub(super) fn meets_unseen(&self, start: &[Motion], h: f64, control: &Control) -> Result<bool, StepFailure> {
        if !self.jointed.contains(&true) {
            return Ok(false);
        }
        let (scene, places) = (self.scene, &self.places);
        let is_jointed = |body: usize| places[body].is_some_and(|place| self.jointed[place as usize]);
        let reach = |body: usize| scene.bodies[body].collider.reach();
        let strays = |body: usize| {
            places[body].is_some_and(|place| {
                let (from, to) = (&start[place as usize], &self.moving[place as usize]);
                let way = (to.pose.translation.vector - from.pose.translation.vector).norm()
                    + from.pose.rotation.angle_to(&to.pose.rotation) * reach(body);
                self.jointed[place as usize] && way > margin(from, reach(body), h * scene.gravity.norm(), h)
            })
        };
        let overlap = |a: u32, b: u32| {
            let [a, b] = [a as usize, b as usize];
            let passes = self.joined.contains(&(a as u32, b as u32)) || scene.is_apart(a as u32, b as u32);
            if !is_jointed(a) && !is_jointed(b) || passes {
                return false;
            }
            let [first, second] = [a, b].map(|body| (&scene.bodies[body].collider, self.pose(body)));
            let mut points = Vec::new();
            contacts(first, second, 0.0, &mut points);
            points.iter().any(|point| -point.gap > UNSEEN * reach(a).min(reach(b)))
        };
        if !(0..scene.bodies.len()).any(strays) {
            return Ok(self.pairs.iter().any(|&(a, b)| overlap(a, b)));
        }
        let mut is_any = false;
        BroadPhase::default().sweep(
            scene.bodies.len(),
            |body| scene.bodies[body].collider.bounds(self.pose(body)),
            |body| places[body].is_some(),
            control,
            |a, b| {
                is_any |= overlap(a, b);
                Ok::<(), StepFailure>(())
            },
        )?;
        Ok(is_any)
    }
}
