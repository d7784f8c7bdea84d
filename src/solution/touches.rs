//! Touches: monitors (event functions) that reach zero within the uncertainty due to the tolerances, and turn back.
//! Whether such a monitor changes sign is unknown, whether or not the computed solution does.
//!
//! A monitor that rests at zero, such as the speed of a sticking body, certainly reaches and certainly leaves zero.
//!
//! The monitors are evaluated a second time, with enclosures widened by the tolerances of the states. The search for
//! events then treats zero as a band, which a monitor enters once and leaves to one side or the other.

use super::evaluation::{Along, EvaluationBuffer};
use super::run::Stepper;
use hybrid::{Crossing, Monitors};

/// The search during a run for touches: monitors (event functions) that reach zero within their uncertainty and turn
/// back.
pub(super) struct Touches {
    monitors: Monitors,
    /// The largest absolute value of each state so far.
    largest: Vec<f64>,
    /// The uncertainty of each state that the tolerances leave.
    uncertain: Vec<f64>,
    /// For each monitor, the time at which it last crossed zero (`crossed`), and the interval of time in which it was
    /// last exactly zero (`rested`).
    crossed: Vec<f64>,
    rested: Vec<[f64; 2]>,
    /// The time at which each monitor last entered the band around zero that the uncertainty of the states leaves.
    came: Vec<f64>,
    /// The first monitor that touches zero, and the time at which it leaves the band around zero.
    pub found: Option<(usize, f64)>,
}

/// A monitor counts as resting at zero, and not as touching it, if it is exactly zero for at least this fraction of
/// the time that it spends in the band around zero.
const RESTING: f64 = 0.5;

impl Touches {
    /// Creates the search for touches of the given number of monitors.
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

    /// Records a sign change of a monitor in the computed solution.
    pub fn note(&mut self, crossing: &Crossing) {
        let last = std::mem::replace(&mut self.crossed[crossing.monitor], crossing.t);
        if crossing.returns {
            self.rested[crossing.monitor] = [last, crossing.t];
        }
    }

    /// Searches the last step, which began at `begin`, for touches of the monitors with the indices `places`, until
    /// one touches zero; the crossings of the step must have been recorded.
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
