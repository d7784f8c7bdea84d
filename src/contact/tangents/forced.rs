//! The derivatives across a change of contacts that is caused by a jump of forces: a push that sets in at a given
//! time moves a contact that friction held, or lifts it off. Its monitor is clearly positive before the jump and
//! clearly negative after it, along all directions; so the event time `tau` is that of the jump,
//!
//! ```text
//! q+ = q-,    dv+ = dv- + (a- - a+) dtau
//! ```

use super::event::{EventSlope, TimedEvent, between, contact, kind};
use super::transition::{Instant, ON_BOUND};
use super::{NoDerivative, Tangents};
use crate::locate::{Ending, EventDriven, Status, Transition};
use crate::velocity_step::State;
use hybrid::Shift;
use nalgebra::DMatrix;

/// The resolution of the clock, relative to the time, within which a jump of a monitor (event function) is located.
const CLOCK: f64 = 64.0 * f64::EPSILON;

impl Tangents {
    /// Carries the derivatives across a transition caused by a jump of forces; returns the derivatives of its time,
    /// for each coordinate. Returns `None` for other kinds of transition.
    ///
    /// # Errors
    /// The reason why there is no derivative.
    pub(super) fn pass_forced(
        &mut self,
        located: &mut EventDriven<'_>,
        transition: &Transition,
    ) -> Result<Option<DMatrix<f64>>, NoDerivative> {
        let Transition { before: State { t, q, v }, mode: from, impact: None, grazes: false, .. } = transition else {
            return Ok(None);
        };
        let Some(to) = located.mode.clone() else { return Ok(None) };
        let changes = (0..from.len()).filter_map(|k| between(&self.structure, k, from[k], to[k]));
        let endings: Vec<Ending> = changes.collect();
        let is_of_forces = |ending: &Ending| matches!(ending, Ending::Detachment(_) | Ending::StickToSlip(..));
        if endings.is_empty() || !endings.iter().all(is_of_forces) {
            return Ok(None);
        }
        let clock = CLOCK * t.abs();
        let (ends, x) = ([t - clock, t + clock], [q.as_slice(), v].concat());
        self.equations.evaluate_at(ends[0], &x);
        if !endings.iter().all(|ending| self.has_slack(*ending)) {
            return Ok(None);
        }
        let left = self.equations.a.clone();
        let Some(slopes) = self.break_slopes(ends) else { return Ok(None) };
        let slopes = slopes?;
        let unmoved = self.now.clone();
        let rates = [v.as_slice(), &left].concat();
        let least = located.tolerances_of_slips();
        self.equations.set_mode(&to, (&located.loads, &located.coefficients), &least);
        self.equations.evaluate_at(ends[1], &x);
        let n = self.structure.coordinates;
        let jump: Vec<f64> = left.iter().zip(&self.equations.a).map(|(left, right)| left - right).collect();
        let times = DMatrix::from_fn(n, slopes.len(), |_, direction| slopes[direction]);
        for (direction, time) in slopes.iter().enumerate() {
            jump.iter().enumerate().for_each(|(i, jump)| self.now[(n + i, direction)] += jump * time);
        }
        self.keep_to_constraints(&to, located, (&unmoved, &rates), &times)?;
        for ending in endings {
            let (kind, contact) = (TimedEvent::Contact(kind(ending)), contact(ending));
            // A monitor (event function) that jumps across its bound crosses it at an infinite rate.
            self.events.push(EventSlope { t: *t, kind, contact, slopes: slopes.clone(), transversality: f64::MAX });
        }
        self.instant = Some(Instant { times: times.clone(), happened: vec![true; n] });
        Ok(Some(times))
    }

    /// Whether the contact force whose monitor (event function) indicates the event `ending` is off its bound at the
    /// last evaluation, by more than rounding.
    fn has_slack(&self, ending: Ending) -> bool {
        let (equations, structure) = (&self.equations, &self.structure);
        let forces = equations.lambda.iter().fold(0.0_f64, |most, force| most.max(force.abs()));
        let slack = match ending {
            Ending::Detachment(k) => equations.lambda[structure.normal(k)],
            Ending::StickToSlip(k, _) => {
                equations.mu[k] * equations.lambda[structure.normal(k)] - equations.friction(k)
            }
            Ending::Impact(_) | Ending::SlipToStick(_) => return false,
        };
        slack > ON_BOUND * forces && equations.mode()[contact(ending)] != Status::Open
    }

    /// Returns the derivatives of the time of a breakpoint in time that lies between two times, one per direction;
    /// `None` if there is no breakpoint.
    pub(super) fn break_slopes(&mut self, ends: [f64; 2]) -> Option<Result<Vec<f64>, NoDerivative>> {
        let shifts = self.directions.shifted.iter_mut().map(|shifted| {
            let shifted = shifted.as_mut()?;
            self.differences += 1;
            Some((shifted.by, shifted.systems.each_mut().map(|system| system.break_courses(ends[0]).to_vec())))
        });
        let shifts: Vec<Option<Shift>> = shifts.collect();
        let problem = self.equations.problem();
        let at = |t: f64| [problem.breaks(t).to_vec(), problem.break_courses(t).to_vec()];
        let slopes = hybrid::break_slopes(ends, at, &shifts)?;
        Some(slopes.map_err(|cause| NoDerivative::Smooth(cause.into())))
    }
}
