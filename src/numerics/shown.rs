//! Criteria for whether a few samples of a function represent its behaviour between them.

use super::Interval;

/// Largest admissible ratio of the width of an enclosure of a function to the range of its sampled values. It exceeds
/// one, since interval arithmetic overestimates sums and products of terms that vary together.
pub const WIDER: f64 = 4.0;

/// Largest admissible deviation of the middle one of three sampled values from the mean of the other two, relative to
/// the range of the three: for a pulse at the middle point it is the whole range, for a pulse at an end half of it.
const BENT: f64 = 0.3;

/// Whether three samples represent a function over an interval, given the `width` of its enclosure, the `range` of
/// its values at both ends and in the middle, and the deviation `bent` of the middle value from the mean of the end
/// values.
pub fn is_shown(width: f64, range: f64, bent: f64) -> bool {
    width <= WIDER * range && bent <= BENT * range
}

/// Applies [`is_shown`] to the values `seen` at the beginning, in the middle and at the end of an interval. The width
/// of the enclosure and the deviation of the middle value are first reduced by `allowed`.
pub fn is_seen(enclosure: Interval, seen: [f64; 3], allowed: f64) -> bool {
    let (range, bent) = variation(seen);
    enclosure.defined && is_shown(enclosure.width() - allowed, range, bent - allowed)
}

/// Returns the range of three consecutive values, and the deviation of the middle value from the mean of the other
/// two.
pub fn variation([first, middle, last]: [f64; 3]) -> (f64, f64) {
    let range = first.max(middle).max(last) - first.min(middle).min(last);
    (range, (middle - 0.5 * (first + last)).abs())
}
