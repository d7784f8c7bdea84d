//! Derivatives of the times of breakpoints with respect to parameters.

use numerics::CENTRAL_DIFFERENCE;

/// Shift of a parameter for a central difference: the size of the shift, and the values, at the breakpoint, of the
/// functions whose sign changes are breakpoints and that are continuous there, with the parameter increased and
/// decreased by that size.
pub type Shift = (f64, [Vec<f64>; 2]);

/// Why the time of a breakpoint (a time at which equations change their form) has no derivative with respect to a
/// parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoSlope {
    /// The function whose sign change is the breakpoint touches zero at the breakpoint: its rate of change in time
    /// vanishes.
    Grazing,
    /// Several breakpoints coincide, and move apart when a parameter changes.
    Several,
}

/// Returns the derivative, with respect to each parameter, of the time of a breakpoint that lies between the
/// floating-point numbers `before` and `after`; `None` if no function changes sign between them. A parameter on which
/// the problem does not depend has no shift, and the derivative zero. `at` returns the values at a time of the
/// functions that change sign, and of the functions that are continuous through these sign changes.
///
/// # Errors
/// If the time is not differentiable: see [`NoSlope`].
pub fn break_slopes(
    [before, after]: [f64; 2],
    mut at: impl FnMut(f64) -> [Vec<f64>; 2],
    shifts: &[Option<Shift>],
) -> Option<Result<Vec<f64>, NoSlope>> {
    let [[breaks, left], [passed, right]] = [before, after].map(&mut at);
    let [signs, passed] =
        [breaks, passed].map(|values| values.iter().map(|value| *value >= 0.0).collect::<Vec<bool>>());
    let changed: Vec<usize> = (0..signs.len()).filter(|&k| signs[k] != passed[k]).collect();
    if changed.is_empty() {
        return None;
    }
    let by = CENTRAL_DIFFERENCE * before.abs().max(after.abs()).max(f64::MIN_POSITIVE.sqrt());
    let ends = [before - by, after + by];
    let [[_, first], [_, last]] = ends.map(&mut at);
    // A function that jumps at the breakpoint does so because a continuous function changes sign: only the latter
    // determines the time.
    let is_even = |k: &&usize| (right[**k] - left[**k]).abs() <= 0.5 * (last[**k] - first[**k]).abs();
    let mut slopes: Option<Vec<f64>> = None;
    for &k in changed.iter().filter(is_even) {
        let rate = (last[k] - first[k]) / (ends[1] - ends[0]);
        let of = |shift: &Option<Shift>| match shift {
            Some((size, [above, below])) => -(above[k] - below[k]) / (2.0 * size) / rate,
            None => 0.0,
        };
        let own: Vec<f64> = shifts.iter().map(of).collect();
        let is_alike = |(a, b): (&f64, &f64)| (a - b).abs() <= CENTRAL_DIFFERENCE * a.abs().max(b.abs());
        if slopes.as_ref().is_some_and(|slopes| !slopes.iter().zip(&own).all(is_alike)) {
            return Some(Err(NoSlope::Several));
        }
        slopes.get_or_insert(own);
    }
    let slopes = slopes.filter(|slopes| slopes.iter().all(|slope| slope.is_finite()));
    Some(slopes.ok_or(NoSlope::Grazing))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the derivative, with respect to the parameter `p`, of the time at which the parity of `floor(a(t, p))`
    /// changes.
    fn slope(a: fn(f64, f64) -> f64, p: f64, t: f64) -> Option<Result<Vec<f64>, NoSlope>> {
        let parity = |a: f64| if a.floor().rem_euclid(2.0) == 0.0 { 1.0 } else { -1.0 };
        let by = 1e-6;
        let shifts = [Some((by, [p + by, p - by].map(|p| vec![a(t, p)])))];
        break_slopes([t - 1e-12, t + 1e-12], |t| [vec![parity(a(t, p))], vec![a(t, p)]], &shifts)
    }

    #[test]
    fn a_jump_of_floor_moves_with_its_argument() {
        let is = |found: Option<Result<Vec<f64>, NoSlope>>, exact: f64| {
            let found = found.unwrap().unwrap();
            assert!((found[0] - exact).abs() < 1e-8, "{found:?} {exact}");
        };
        // At p = 0.5 the argument t - p of floor reaches 2 at t = 2.5, and the argument t/p reaches 2 at t = 1.
        is(slope(|t, p| t - p, 0.5, 2.5), 1.0);
        is(slope(|t, p| t / p, 0.5, 1.0), 2.0);
        assert_eq!(slope(|t, p| t - p, 0.5, 2.2), None);
    }

    #[test]
    fn breakpoints_that_move_apart_have_no_common_slope() {
        let values = |t: f64| [0, 1].map(|_| vec![t - 1.0, 2.0 * t - 2.0]);
        let shifts = [Some((1e-6, [vec![-1e-6, 0.0], vec![1e-6, 0.0]]))];
        let found = break_slopes([1.0 - 1e-15, 1.0 + 1e-15], values, &shifts);
        assert_eq!(found, Some(Err(NoSlope::Several)));
    }
}
