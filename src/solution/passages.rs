//! The switches and contact events of a run over one period, in cyclic order: the beginning of a period is a
//! convention, and an event that passes it does not change the orbit.

use problem::EventKind;
use radau::Activity;

/// A switch or contact event, without its time.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Passed {
    /// The switch of a variable, given by its index, from one activity (at a bound or free) to another.
    Switch(usize, Activity, Activity),
    /// An event of a contact, given by the index of the contact.
    Contact(usize, EventKind),
}

/// The switches and contact events of a run over one period.
#[derive(Clone, Debug, Default)]
pub(super) struct Passages {
    events: Vec<Passed>,
    /// The times of the events, as fractions of the period.
    phases: Vec<f64>,
}

impl Passages {
    /// Adds a switch or contact event at the time `phase`, given as a fraction of the period.
    pub fn push(&mut self, event: Passed, phase: f64) {
        self.events.push(event);
        self.phases.push(phase);
    }

    /// Returns the number of switches and contact events in the period.
    pub fn len(&self) -> usize {
        self.events.len()
    }

    /// Returns the switch or contact event with the given index.
    pub fn get(&self, number: usize) -> Option<&Passed> {
        self.events.get(number)
    }

    /// Returns a better time for the beginning of the period, as a fraction of the period: the middle of the longest
    /// interval without events. Returns `None` if the distance of the present beginning from its nearest event is at
    /// least half of the distance of that middle from its nearest event.
    pub fn far_from_all(&self) -> Option<f64> {
        let (first, last) = (*self.phases.first()?, *self.phases.last()?);
        let around = (last, first + 1.0);
        let pairs = self.phases.windows(2).map(|pair| (pair[0], pair[1])).chain([around]);
        let (begin, end) = pairs.max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)))?;
        let nearest = first.min(1.0 - last);
        (nearest < 0.25 * (end - begin)).then(|| (0.5 * (begin + end)).fract())
    }

    /// Returns the index of the first switch or contact event that differs from the event with the same index in
    /// `other`.
    pub fn first_difference(&self, other: &Self) -> usize {
        let shorter = self.len().min(other.len());
        self.events.iter().zip(&other.events).position(|(a, b)| a != b).unwrap_or(shorter)
    }

    /// Whether the events of `other` are the events of this run in cyclic order from the event `first` on, if each
    /// event moves the shorter way around the period and none overtakes another.
    fn are_turned(&self, other: &Self, first: usize) -> bool {
        let n = self.len();
        let pairs = (0..n).map(|k| (k, (first + k) % n));
        if !pairs.clone().all(|(k, ahead)| other.events[k] == self.events[ahead]) {
            return false;
        }
        let places: Vec<f64> = pairs
            .map(|(k, ahead)| {
                let moved = other.phases[k] - self.phases[ahead];
                let turn = if ahead < first { 1.0 } else { 0.0 };
                turn + self.phases[ahead] + moved - moved.round()
            })
            .collect();
        places.is_sorted() && places.iter().all(|place| *place <= places[0] + 1.0)
    }
}

impl PartialEq for Passages {
    /// Whether the cyclic sequences of events of two runs are equal, wherever the period begins.
    fn eq(&self, other: &Self) -> bool {
        self.events == other.events
            || (self.len() == other.len() && (1..self.len()).any(|first| self.are_turned(other, first)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passages(events: &[(usize, f64)]) -> Passages {
        let mut passages = Passages::default();
        events.iter().for_each(|&(contact, phase)| passages.push(Passed::Contact(contact, EventKind::Impact), phase));
        passages
    }

    #[test]
    fn an_event_that_passes_the_beginning_of_the_period_changes_nothing() {
        let before = passages(&[(0, 0.01), (1, 0.4), (2, 0.7)]);
        assert_eq!(before, passages(&[(1, 0.39), (2, 0.71), (0, 0.99)]));
        assert_eq!(passages(&[(0, 0.01), (1, 0.5)]), passages(&[(1, 0.5), (0, 0.99)]));
        assert_eq!(passages(&[(1, 0.5), (0, 0.99)]), passages(&[(0, 0.01), (1, 0.5)]));
    }

    #[test]
    fn the_place_far_from_all_events_is_sought_where_one_is_near_the_beginning() {
        assert_eq!(passages(&[]).far_from_all(), None);
        assert_eq!(passages(&[(0, 0.5)]).far_from_all(), None);
        assert_eq!(passages(&[(0, 0.0)]).far_from_all(), Some(0.5));
        assert_eq!(passages(&[(0, 0.25), (0, 0.5), (0, 0.875)]).far_from_all(), None);
        let place = passages(&[(0, 0.0625), (0, 0.125), (1, 0.625)]).far_from_all();
        assert_eq!(place, Some(0.375));
        assert_eq!(passages(&[(0, 0.5), (0, 0.9375)]).far_from_all(), Some(0.21875));
    }

    #[test]
    fn events_that_change_places_within_the_period_are_others() {
        assert_ne!(passages(&[(0, 0.49), (1, 0.5)]), passages(&[(1, 0.49), (0, 0.5)]));
        assert_ne!(passages(&[(0, 0.1), (1, 0.2), (2, 0.5)]), passages(&[(1, 0.15), (0, 0.16), (2, 0.5)]));
        assert_ne!(passages(&[(0, 0.1)]), passages(&[(0, 0.1), (0, 0.9)]));
    }
}
