//! Whether few values of a function show what it does between them.

use super::Interval;

/// The factor by which an enclosure may be wider than the range of what is seen: it is for sums and products of terms that
/// vary together.
const WIDER: f64 = 4.0;

/// The part of this range by which what is in the middle may differ from the mean of the ends: a pulse that happens to be in
/// the middle, or at an end, differs by all of it, or by half.
const BENT: f64 = 0.3;

/// Whether a function whose enclosure over an interval has this width shows what it does there: by the range of what is seen
/// of it at both ends and in the middle, and by how much the middle differs from the mean of the ends.
pub fn is_shown(width: f64, range: f64, bent: f64) -> bool {
    width <= WIDER * range && bent <= BENT * range
}

/// The same of values `seen` at the beginning, in the middle and at the end, where some more is allowed.
pub fn is_seen(enclosure: Interval, seen: [f64; 3], allowed: f64) -> bool {
    let (range, bent) = variation(seen);
    enclosure.defined && is_shown(enclosure.width() - allowed, range, bent - allowed)
}

/// The range of three values one after the other, and by how much the one in the middle differs from the mean of the others.
pub fn variation([first, middle, last]: [f64; 3]) -> (f64, f64) {
    let range = first.max(middle).max(last) - first.min(middle).min(last);
    (range, (middle - 0.5 * (first + last)).abs())
}
