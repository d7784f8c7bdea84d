//! Breaks of `q` and of the bounds: times at which they have a kink or a jump, as one with `heaviside(t - 1)` has. An element
//! ends there, and the next has the functions that a switch calls for as well. What changes its sign there is sampled over
//! an element; its first change is bisected down to rounding.

use super::Segments;

/// Samples an element. No element is longer than twice the time between the last two breaks, or since the last: periodic
/// forcing is sampled eight times between two of its breaks.
const SAMPLES: u32 = 16;
/// Breaks closer to each other than this many units of rounding are one: those of `t - 1` and `3*t - 3` are at one time, but for a
/// few units, or for as many as digits cancel in a longer expression. Fewer would take such a pair for an element of its
/// own; many more, as far as `TINY`, for one break where an element between two would count.
const ONE: f64 = 1e3;

/// What is remembered of breaks.
#[derive(Debug)]
pub(super) struct Breaks {
    /// The last break or the start, and the time to it from the one before.
    last: f64,
    gap: f64,
    /// The first number after the break at which the present element begins.
    after: Option<f64>,
}

impl Breaks {
    /// For a run that starts at `t`.
    pub fn new(t: f64) -> Self {
        Self { last: t, gap: f64::INFINITY, after: None }
    }
}

impl Segments<'_> {
    /// The part of an element of length `h` up to the first break, and the first number after that.
    pub(super) fn up_to_break(&mut self, h: f64) -> (f64, Option<f64>) {
        let first = self.breaks.after.filter(|after| *after > self.t).unwrap_or(self.t);
        let signs: Vec<bool> = self.forcing.breaks(first).iter().map(|value| *value >= 0.0).collect();
        if signs.is_empty() {
            return (h, None);
        }
        let h = h.min(2.0 * self.breaks.gap.max(self.t - self.breaks.last));
        // A break right behind the element is one at its end.
        let beyond = self.resolution(h);
        let mut has_broken = |t: f64| {
            let values = self.forcing.breaks(t).iter();
            values.zip(&signs).any(|(value, sign)| (*value >= 0.0) != *sign)
        };
        let mut before = first;
        for sample in 1..=SAMPLES {
            let mut after = self.t + (h + beyond) * f64::from(sample) / f64::from(SAMPLES);
            if after > before && has_broken(after) {
                loop {
                    let middle = before + 0.5 * (after - before);
                    if middle <= before || middle >= after {
                        break;
                    }
                    *if has_broken(middle) { &mut after } else { &mut before } = middle;
                }
                if before - self.t <= self.resolution(0.0) {
                    self.pass_break(after);
                    return self.up_to_break(h);
                }
                return (before - self.t, Some(after));
            }
            before = after.max(first);
        }
        (h, None)
    }

    /// Begins anew behind a break.
    pub(super) fn pass_break(&mut self, after: f64) {
        let gap = after - self.breaks.last;
        if gap > ONE * f64::EPSILON * after.abs() {
            self.breaks.gap = gap;
        }
        (self.breaks.last, self.breaks.after) = (after, Some(after));
        self.is_first = true;
    }
}
