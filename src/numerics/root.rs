//! Roots of a function of time by the Illinois modification of false position (Dowell and Jarratt 1971): the function
//! value at an end that is kept twice is halved, so that both ends converge to the root, with order 1.44.

/// A bracket of a root: a point where the function is positive, and a later point where it is not. The function
/// values at both points are stored; one of them may have been halved for the next guess.
#[derive(Clone, Copy, Debug)]
pub struct Bracket {
    /// The point where the function is positive, and the function value, which may have been halved.
    pub before: (f64, f64),
    /// The later point where the function is not positive, and the function value, which may have been halved.
    pub behind: (f64, f64),
    kept: Option<End>,
    /// The initial width of the bracket, and the number of guesses that have narrowed it.
    first_width: f64,
    guesses: i32,
}

/// Number of guesses by which [`Bracket::guess_apart`] may exceed bisection. On a smooth function, false position
/// needs fewer guesses than bisection.
const BEYOND_BISECTION: i32 = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Before,
    Behind,
}

impl Bracket {
    /// Creates the bracket between two points, each given with its function value.
    pub fn new(before: (f64, f64), behind: (f64, f64)) -> Self {
        Self { before, behind, kept: None, first_width: behind.0 - before.0, guesses: 0 }
    }

    /// Returns the next guess of the root: the root of the chord through both ends, which may not be finite if the
    /// values are equal.
    pub fn guess(&self) -> f64 {
        let ((a, fa), (b, fb)) = (self.before, self.behind);
        a + (b - a) * (fa / (fa - fb))
    }

    /// Returns the next guess of the root, at least `least` from both ends, or the middle of a narrower bracket. If a
    /// guess is within rounding of an end, the next guess thus closes the bracket from the other side (Brent 1973,
    /// *Algorithms for minimization without derivatives*, section 4.2). After `j` guesses the bracket is no wider
    /// than `2^(8 - j)` of its first width, even if the function jumps (the projection of Oliveira and Takahashi
    /// 2021, *ACM Trans. Math. Softw.* 47).
    pub fn guess_apart(&self, least: f64) -> f64 {
        let (a, b) = (self.before.0, self.behind.0);
        let permitted = self.first_width * 2.0_f64.powi(BEYOND_BISECTION - 1 - self.guesses);
        let (from, to) = ((a + least).max(b - permitted), (b - least).min(a + permitted));
        let guess = self.guess();
        // The comparison is also false if the guess is not finite.
        if from <= to && guess.is_finite() { guess.clamp(from, to) } else { 0.5 * (a + b) }
    }

    /// Returns the distance between the ends of the bracket.
    pub fn width(&self) -> f64 {
        self.behind.0 - self.before.0
    }

    /// Replaces an end of the bracket by the point `t` between the ends, where the function has the given value.
    pub fn narrow(&mut self, t: f64, value: f64) {
        self.guesses += 1;
        if value <= 0.0 {
            self.behind = (t, value);
            if self.kept.replace(End::Before) == Some(End::Before) {
                self.before.1 *= 0.5;
            }
        } else {
            self.before = (t, value);
            if self.kept.replace(End::Behind) == Some(End::Behind) {
                self.behind.1 *= 0.5;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the number of guesses that find the root of `f` between 0 and `end` to `tolerance`.
    fn guesses(f: impl Fn(f64) -> f64, end: f64, root: f64, tolerance: f64) -> usize {
        let mut bracket = Bracket::new((0.0, f(0.0)), (end, f(end)));
        (1..)
            .take(100)
            .find(|_| {
                let guess = bracket.guess();
                bracket.narrow(guess, f(guess));
                (guess - root).abs() <= tolerance
            })
            .unwrap_or(usize::MAX)
    }

    #[test]
    fn a_bracket_closes_where_values_are_rounding() {
        // A smooth function with the root sqrt 2, and a function that jumps at sqrt 2.
        let close = |f: &dyn Fn(f64) -> f64| {
            let mut bracket = Bracket::new((1.0, f(1.0)), (2.0, f(2.0)));
            let count = (0..).take_while(|_| {
                let t = bracket.guess_apart(f64::EPSILON);
                let is_wide = bracket.width() > 2.0 * f64::EPSILON;
                if is_wide {
                    bracket.narrow(t, f(t));
                }
                is_wide
            });
            let count = count.count();
            assert!((bracket.behind.0 - 2.0_f64.sqrt()).abs() <= 4.0 * f64::EPSILON, "{bracket:?}");
            count
        };
        assert!(close(&|t| 2.0 - t * t) <= 10, "{}", close(&|t| 2.0 - t * t));
        // For the function that jumps, bisection takes 51 guesses.
        for (before, behind) in [(1.0, -1e-9), (1e-9, -1.0), (1.0, -1.0), (1.0, -1e300)] {
            assert!(close(&|t| if t * t < 2.0 { before } else { behind }) <= 51 + 8);
        }
    }

    #[test]
    fn roots_are_found_where_one_end_would_stay() {
        // Plain false position keeps the end at 1 for the first two functions, and takes hundreds of guesses.
        assert!(guesses(|t| 0.1 - t.powi(9), 1.0, 0.1_f64.powf(1.0 / 9.0), 1e-14) < 15);
        assert!(guesses(|t| (-20.0 * t).exp() - 1e-3, 1.0, 1000.0_f64.ln() / 20.0, 1e-14) < 40);
        assert_eq!(guesses(|t| 1.0 - 4.0 * t, 1.0, 0.25, 1e-16), 1);
    }
}
