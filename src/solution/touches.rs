//! Touches: monitors that come to zero within what the tolerances leave uncertain, and turn back. Whether such a monitor
//! changes its sign is not known, whichever way the computed solution has it.
//!
//! A monitor that rests at zero, as the speed of a body that sticks, has come there for certain, and leaves for certain.
//!
//! The monitors are followed a second time, with enclosures widened by the tolerances of the states. The search for events
//! then takes zero for a band, which a monitor reaches once, and leaves to one side or the other.

use super::evaluation::{Along, EvaluationBuffer};
use super::run::Stepper;
use hybrid::{Crossing, Monitors};

/// The search for touches during a run.
pub(super) struct Touches {
    monitors: Monitors,
    /// The largest size of each state so far.
    largest: Vec<f64>,
    /// The uncertainty of each state.
    uncertain: Vec<f64>,
    /// The last crossing of each monitor, and when it last rested at zero.
    crossed: Vec<f64>,
    rested: Vec<[f64; 2]>,
    /// When each monitor last came to zero within the tolerances.
    came: Vec<f64>,
    /// The first monitor that touches zero, and the time at which it leaves.
    pub found: Option<(usize, f64)>,
}

/// The part of its stay near zero for which a monitor that rests is zero: it comes and leaves within far less.
const RESTING: f64 = 0.5;

impl Touches {
    /// Begins to follow so many monitors.
    pub fn new(monitors: usize, start: f64) -> Self {
        Self {
            monitors: Monitors::new(monitors),
            largest: Vec::new(),
            uncertain: Vec::new(),
            crossed: vec![start; monitors],
            rested: vec![[start; 2]; monitors],
            came: vec![start; monitors],
            found: None,
        }
    }

    /// Notes a crossing of a monitor as it was computed.
    pub fn note(&mut self, crossing: &Crossing) {
        let last = std::mem::replace(&mut self.crossed[crossing.monitor], crossing.t);
        if crossing.returns {
            self.rested[crossing.monitor] = [last, crossing.t];
        }
    }

    /// Follows the monitors at these places over the last step, from `begin` on, until one touches zero; the crossings of the
    /// step have been noted.
    pub fn follow(&mut self, stepper: &mut impl Stepper, place: &mut EvaluationBuffer, places: &[usize], begin: f64) {
        let end = stepper.t();
        let Some((rtol, atol)) = stepper.tolerances().filter(|_| self.found.is_none()) else { return };
        self.largest.resize(atol.len(), 0.0);
        self.largest.iter_mut().zip(stepper.states()).for_each(|(largest, x)| *largest = largest.max(x.abs()));
        self.uncertain.clear();
        self.uncertain.extend(self.largest.iter().zip(atol).map(|(largest, atol)| atol + rtol * largest));
        let mut along = Along { stepper, place, places, uncertain: &self.uncertain };
        let mut from = begin;
        while let Some(crossing) = self.monitors.next(&mut along, from, end) {
            let Crossing { t, monitor, returns, .. } = crossing;
            from = t;
            let came = std::mem::replace(&mut self.came[monitor], t);
            let [begin, end] = self.rested[monitor];
            if returns && end.min(t) - begin.max(came) < RESTING * (t - came) {
                self.found = Some((monitor, t));
                return;
            }
        }
    }
}
