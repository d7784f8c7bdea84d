//! Roots of a function of time by false position, with the modification of Illinois (Dowell and Jarratt 1971): an end that is
//! kept twice counts half, so that both ends close in, with order 1.44.

/// Where a function is positive, a later point where it is not, and its values there, as far as they count for the next guess.
#[derive(Clone, Copy, Debug)]
pub struct Bracket {
    /// The point where it is positive.
    pub before: (f64, f64),
    /// The point behind it where it is not.
    pub behind: (f64, f64),
    kept: Option<End>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Before,
    Behind,
}

impl Bracket {
    /// Between two points with their values.
    pub fn new(before: (f64, f64), behind: (f64, f64)) -> Self {
        Self { before, behind, kept: None }
    }

    /// The next guess: the root of the line through both ends, which need be no number where their values are equal.
    pub fn guess(&self) -> f64 {
        let ((a, fa), (b, fb)) = (self.before, self.behind);
        a + (b - a) * (fa / (fa - fb))
    }

    /// How far the ends are apart.
    pub fn width(&self) -> f64 {
        self.behind.0 - self.before.0
    }

    /// Takes a point between the ends into account.
    pub fn narrow(&mut self, t: f64, value: f64) {
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

    /// The guesses that find the root of `f` between 0 and `end` to `tolerance`.
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
    fn roots_are_found_where_one_end_would_stay() {
        // Plain false position keeps the end at 1 of both and takes hundreds of guesses.
        assert!(guesses(|t| 0.1 - t.powi(9), 1.0, 0.1_f64.powf(1.0 / 9.0), 1e-14) < 15);
        assert!(guesses(|t| (-20.0 * t).exp() - 1e-3, 1.0, 1000.0_f64.ln() / 20.0, 1e-14) < 40);
        assert_eq!(guesses(|t| 1.0 - 4.0 * t, 1.0, 0.25, 1e-16), 1);
    }
}
