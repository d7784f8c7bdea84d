//! Whether few values of a function show what it does between them.

use super::Interval;

/// The factor by which an enclosure may be wider than the range of what is seen: it is for sums and products of terms that
/// vary together.
const WIDER: f64 = 4.0;

/// The part of this range by which what is in the middle may differ from the mean of the ends: a pulse that happens to be in
/// the middle, or at an end, differs by all of it, or by half.
const BENT: f64 = 0.3;

/// Whether a function with this enclosure over an interval, `seen` at its beginning, in its middle and at its end, does nothing
/// else by more than is allowed.
pub fn is_shown(enclosure: Interval, seen: [f64; 3], allowed: f64) -> bool {
    let [first, middle, last] = seen;
    let range = first.max(middle).max(last) - first.min(middle).min(last);
    let bent = (middle - 0.5 * (first + last)).abs();
    enclosure.defined && enclosure.hi - enclosure.lo <= WIDER * range + allowed && bent <= BENT * range + allowed
}
