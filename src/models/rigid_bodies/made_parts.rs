//! The parts into which a run divides its time steps. Joints, springs and forces that depend on motion divide a step
//! according to their own error, so that a second run with steps twice as long, made to estimate the error of the
//! first, would use the same parts and have the same errors. The second run uses parts that are at least twice as
//! long as those of the first run instead.

/// Relative difference below which the lengths of two parts of steps count as equal: the ends of parts are sums of
/// binary fractions of a step.
const WITHIN: f64 = 1e-6;

/// The parts into which the time steps of a run were divided, each as `[begin, end]`, in the order of time.
#[derive(Clone, Debug, Default)]
pub struct MadeParts {
    /// The parts of steps in which all bodies move together, in the order of time.
    whole: Vec<[f64; 2]>,
    /// For each moving body, the parts into which its island divided the steps, if the island has joints or
    /// motion-dependent forces.
    of_bodies: Vec<Vec<[f64; 2]>>,
}

impl MadeParts {
    /// Creates an empty record of parts for a number `moving` of moving bodies.
    pub fn new(moving: usize) -> Self {
        Self { whole: Vec::new(), of_bodies: vec![Vec::new(); moving] }
    }

    /// Records a part of a step in which all bodies move together.
    pub(super) fn add_whole(&mut self, part: [f64; 2]) {
        self.whole.push(part);
    }

    /// Records the parts into which an island divided a step, for each body of the island.
    pub(super) fn add(&mut self, bodies: &[u32], parts: &[[f64; 2]]) {
        bodies.iter().for_each(|&body| self.of_bodies[body as usize].extend_from_slice(parts));
    }

    /// Moves the recorded parts of steps that begin before the time `until` to `others`, and discards what was in
    /// `others` before.
    pub fn hand_over(&mut self, until: f64, others: &mut Self) {
        let move_parts = |from: &mut Vec<[f64; 2]>, to: &mut Vec<[f64; 2]>| {
            let over = from.partition_point(|[begin, _]| *begin < until);
            to.clear();
            to.extend(from.drain(..over));
        };
        move_parts(&mut self.whole, &mut others.whole);
        self.of_bodies.iter_mut().zip(&mut others.of_bodies).for_each(|(from, to)| move_parts(from, to));
    }

    /// Returns the length of the longest part of a step in which all bodies move together that overlaps the time
    /// interval `part`.
    pub(super) fn longest(&self, part: [f64; 2]) -> f64 {
        longest(&self.whole, part).unwrap_or(0.0)
    }

    /// Returns the length of the longest part into which the islands of the given bodies divided their steps that
    /// overlaps the time interval `part`.
    pub(super) fn longest_of(&self, bodies: &[u32], part: [f64; 2]) -> f64 {
        let of_bodies = bodies.iter().filter_map(|&body| longest(&self.of_bodies[body as usize], part));
        of_bodies.reduce(f64::max).unwrap_or_else(|| self.longest(part))
    }
}

/// Returns the length of the longest of the given parts of steps among those that overlap a time interval; `None` if
/// none overlaps it.
fn longest(parts: &[[f64; 2]], [from, to]: [f64; 2]) -> Option<f64> {
    let overlaps = |&&[begin, end]: &&[f64; 2]| end.min(to) - begin.max(from) > WITHIN * (to - from);
    parts.iter().filter(overlaps).map(|[begin, end]| end - begin).reduce(f64::max)
}

/// Returns whether a part of length `h` is at least twice as long as `longest`, the longest part of another run.
pub(super) fn is_twice(h: f64, longest: f64) -> bool {
    2.0 * longest <= h * (1.0 + WITHIN)
}

/// Returns whether a part of length `h` may be tried without halving it first, where `longest` is the longest part of
/// another run: false if half of `h` would also be at least twice as long as `longest`.
pub(super) fn may_try(h: f64, longest: f64) -> bool {
    4.0 * longest > h * (1.0 + WITHIN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_twice_as_long_as_the_longest_within_them() {
        let mut made = MadeParts::new(2);
        [[0.0, 1.0], [1.0, 2.0]].into_iter().for_each(|part| made.add_whole(part));
        made.add(&[1], &[[0.0, 0.5], [0.5, 1.0], [1.0, 2.0]]);
        let mut others = MadeParts::new(2);
        made.hand_over(2.0, &mut others);
        assert_eq!([others.longest_of(&[0], [0.0, 1.0]), others.longest_of(&[1], [0.0, 1.0])], [1.0, 0.5]);
        assert_eq!([others.longest_of(&[0, 1], [0.0, 2.0]), made.longest([0.0, 2.0])], [1.0, 0.0]);
        let halves = others.longest_of(&[1], [0.0, 1.0]);
        assert!(is_twice(1.0, halves) && may_try(1.0, halves) && !is_twice(0.5, halves) && !may_try(2.0, halves));
    }
}
