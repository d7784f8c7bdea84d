//! Grazing contacts: gaps that reach zero with almost no normal velocity.
//!
//! A gap is known to within `eps`, a fraction of its largest opening since the last contact. If the gap turns back,
//! or closes, within `eps` of zero, an impact with a velocity of up to `sqrt(2 a eps)` may have been missed or made
//! in error, where `a` is the acceleration of the gap. The subsequent motion is accurate to the square root of the
//! tolerance only, and the sequence of impacts may change (Nordmark 1991, *Non-periodic motion caused by grazing
//! incidence in an impact oscillator*).

use super::mode::Status;
use super::monitors::Ending;
use super::smooth_phase::SmoothPhase;
use radau::ALLOWED;

/// Number of bisections for the time at which the gap of a grazing contact turns from closing to opening.
const HALVINGS: usize = 40;

/// A contact that grazed: its gap nearly or just touched zero without an impact, or with a weak one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grazed {
    /// The time at which the contact grazed.
    pub t: f64,
    /// The index of the contact that grazed.
    pub contact: usize,
    /// The possible error of the normal velocity of the contact, as it may touch or not, in units of the tolerance of
    /// that velocity.
    pub change: f64,
}

impl SmoothPhase<'_, '_> {
    /// Records the contacts that graze between the times `begin` and `end` of the last step; `ending` is the event
    /// that ends the contact mode at `end`, if any.
    pub(super) fn note_grazing(&mut self, begin: f64, end: f64, ending: Option<Ending>) {
        let open: Vec<usize> = (0..self.mode.len()).filter(|&k| self.mode[k] == Status::Open).collect();
        for k in open {
            let (first, last) = (self.gap_at(k, begin), self.gap_at(k, end));
            // The largest opening of the gap, since the last contact, from which it closes.
            let mut highest = self.located.highest[k].or_wider(&first);
            let closes = ending == Some(Ending::Impact(k));
            let (t, nearest) = if closes {
                highest = highest.or_wider(&self.gap_at(k, 0.5 * (begin + end)));
                (end, Gap { gap: 0.0, ..last })
            } else if first.speed < 0.0 && last.speed > 0.0 {
                self.nearest(k, begin, end)
            } else {
                self.located.highest[k] = highest.or_wider(&last);
                continue;
            };
            self.located.highest[k] = if closes { Opening::default() } else { highest.or_wider(&last) };
            let Gap { gap, speed, acceleration, tolerance, gradient } = nearest;
            let known = ALLOWED * self.located.radau.rtol * highest.height(gradient);
            let possible = (2.0 * acceleration.abs() * known).sqrt();
            if gap <= known && speed.abs() <= possible {
                self.located.grazes = true;
                let restitution = self.located.structure.contacts[k].restitution;
                let change = (1.0 + restitution) * possible / tolerance;
                if self.located.grazed.is_none_or(|worst| change > worst.change) {
                    self.located.grazed = Some(Grazed { t, contact: k, change });
                }
            }
        }
    }

    /// Returns the time at which the gap of contact `k` is least (turns from closing to opening), and the gap at that
    /// time.
    fn nearest(&mut self, k: usize, begin: f64, end: f64) -> (f64, Gap) {
        let (mut falls, mut rises) = (begin, end);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (falls + rises);
            let side = if self.gap_at(k, middle).speed < 0.0 { &mut falls } else { &mut rises };
            *side = middle;
        }
        (rises, self.gap_at(k, rises))
    }

    fn gap_at(&mut self, k: usize, t: f64) -> Gap {
        let n = self.located.structure.coordinates;
        let mut x = vec![0.0; 2 * n];
        self.at(t, &mut x);
        self.watch.evaluate_at(t, &x);
        let v = &x[n..];
        let (structure, radau) = (&self.located.structure, &self.located.radau);
        let tolerances = radau.tolerances(n, v);
        let (row, constraints) = (structure.normal(k), self.watch.constraints());
        Gap {
            gap: constraints.values[structure.joints + k],
            speed: constraints.velocity(row, v),
            tolerance: constraints.size(row, &tolerances).max(f64::MIN_POSITIVE),
            acceleration: self.watch.rate_of_row(row),
            gradient: constraints.size(row, &radau.atol[..n]),
        }
    }
}

/// A gap at one time, with its first two time derivatives and the tolerance of the first.
#[derive(Clone, Copy, Debug)]
struct Gap {
    gap: f64,
    speed: f64,
    acceleration: f64,
    tolerance: f64,
    /// The size of the gradient of the gap, in units of the absolute tolerances of the coordinates.
    gradient: f64,
}

/// The largest opening of a gap since the last contact.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Opening {
    /// The largest value of the gap since the last contact.
    gap: f64,
    /// The largest quotient since the last contact of the gap and the size of its gradient: a distance, whichever
    /// function of the distance the gap is.
    distance: f64,
}

impl Opening {
    /// Returns the largest opening so far with its maxima raised to those of the gap at a later time, where that is
    /// larger.
    fn or_wider(self, gap: &Gap) -> Self {
        Self { gap: self.gap.max(gap.gap), distance: self.distance.max(gap.gap / gap.gradient) }
    }

    /// Returns the largest opening of the gap, converted to the unit that the gap has where its gradient is
    /// `gradient`; less than the largest gap if the gradient was much larger where the gap was largest.
    fn height(self, gradient: f64) -> f64 {
        self.gap.min(self.distance * gradient)
    }
}
