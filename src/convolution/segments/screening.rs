//! Screening of an element by enclosure: proves that the monitors of the active set stay positive between the nodes.
//!
//! The functions of an element are analytic except at its beginning. On panels `[2^-k-1, 2^-k]` they are polynomials
//! with a bound of the remainder ([`panel`](super::panel)), `q` and the bounds are enclosed by interval arithmetic, and
//! a part of a panel with an unproven quantity is halved, as in [`radau::screening`]. Over the first panel, which
//! begins at zero, functions change by no more than their moduli of continuity; panels are halved until that is enough,
//! or they are too short for a switch in them to count.

use super::Segments;
use super::advance::TINY;
use super::panel::{DEGREE, Panel};
use super::trial::{Trial, Violation};
use super::watched::{Function, Functions, Watched};
use crate::stepper::StepError;
use numerics::{Interval, bernstein};

/// Largest number of parts of one panel on which quantities are enclosed: each halving of a part gains a binary digit
/// of the distance from a switch.
const MOST_PARTS: usize = 200;

/// The result of screening an element for switches between its nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Screened {
    /// Proven: no monitor (a quantity that is positive while the active set holds) changes its sign between the nodes.
    Proven,
    /// A monitor (a quantity that is positive while the active set holds) is negative between the nodes.
    Violated(Violation),
    /// The function `q` of the inequality, or a bound, varies between the nodes by more than its values at the nodes
    /// show.
    Unresolved,
    /// Changes of sign of monitors are neither excluded nor seen.
    Open,
}

/// A quantity `+-(F + s)`, with a function `F` of the element, that is not yet proven positive on a part of a panel:
/// its index, the Bernstein coefficients of `F`, and their remainder.
#[derive(Clone)]
struct Unproven {
    place: usize,
    coefficients: Vec<f64>,
    remainder: Remainder,
}

/// A part of a panel of the element, with the quantities that are not yet proven positive on it.
struct Stretch {
    panel: Panel,
    left: Vec<Unproven>,
}

/// What the values at the middle of a part of a panel show of the quantities that are not yet proven positive.
#[derive(Default)]
struct Seen {
    violation: Option<Violation>,
    /// Whether the function `q` of the inequality, or a bound, differs at the middle from the interpolant through its
    /// values at the nodes.
    is_unresolved: bool,
    /// Whether remainders prevent a proof: polynomials on shorter panels may have smaller ones.
    needs_more: bool,
}

/// The remainder of the polynomial of a screened quantity: of interpolation, which shorter panels reduce, and of
/// rounding, up to which a quantity counts as zero.
#[derive(Clone, Copy, Debug, Default)]
struct Remainder {
    of_interpolation: f64,
    of_rounding: f64,
}

/// The result of screening a panel of an element for switches.
#[derive(Default)]
struct Outcome {
    violation: Option<Violation>,
    is_unresolved: bool,
    is_open: bool,
}

impl Segments<'_> {
    /// Screens for switches an element whose monitors are positive at the nodes.
    pub(super) fn screen_element(&mut self, trial: &Trial) -> Result<Screened, StepError> {
        let functions = self.functions(trial);
        let watched = self.watch(trial);
        let Some(begins) = self.begins(&functions, &watched)? else { return Ok(Screened::Open) };
        let mut outcome = Outcome::default();
        // First screen those quantities that are polynomials on the whole element, without panels.
        let whole: Vec<usize> = (0..watched.len()).filter(|&i| self.is_polynomial(trial, &watched[i])).collect();
        self.screen_panel(&functions, &watched, whole, Panel::WHOLE, &mut outcome)?;
        let is_panelled = |i: &usize| !self.is_polynomial(trial, &watched[*i]);
        let panelled: Vec<usize> = (0..watched.len()).filter(is_panelled).collect();
        let mut begin = panelled.iter().map(|&i| begins[i]).fold(1.0, f64::min);
        while begin < 1.0 && outcome.violation.is_none_or(|found| found.theta > begin) {
            let left = panelled.iter().copied().filter(|&i| begins[i] <= begin).collect();
            self.screen_panel(&functions, &watched, left, Panel { begin, length: begin }, &mut outcome)?;
            begin *= 2.0;
        }
        Ok(match outcome {
            Outcome { violation: Some(violation), .. } => Screened::Violated(violation),
            Outcome { is_unresolved: true, .. } => Screened::Unresolved,
            Outcome { is_open: true, .. } => Screened::Open,
            _ => Screened::Proven,
        })
    }

    /// Whether the function `F` of a screened quantity `+-(F + s)` is a polynomial on the element.
    fn is_polynomial(&self, trial: &Trial, watched: &Watched) -> bool {
        watched.function != Function::Memory && !self.shapes[trial.shape].is_singular()
    }

    /// Returns, for each screened quantity, the end of a first panel over which the quantity changes too little to
    /// become negative, or which is too short to count; `None` if the problem has no enclosure.
    fn begins(&mut self, functions: &Functions<'_>, watched: &[Watched]) -> Result<Option<Vec<f64>>, StepError> {
        let m = self.places.len();
        let mut values = [vec![0.0; m], vec![0.0; m], vec![0.0; m]];
        let with_memory = watched.iter().any(|watched| watched.function == Function::Memory);
        self.evaluate_functions(functions, 0.0, with_memory, &mut values)?;
        let h = functions.trial.h;
        let least = (TINY * self.usual.max(h)).max(self.resolution(h)) / h;
        let mut begins = vec![0.0; watched.len()];
        let mut end = 1.0;
        while begins.contains(&0.0) {
            let times = self.times(Panel { begin: 0.0, length: end }, h);
            let Some(over) = self.forcing.enclose(times) else { return Ok(None) };
            let ranges: Vec<Interval> = watched.iter().map(|watched| watched.beside_over(over).0).collect();
            for (i, watched) in watched.iter().enumerate().filter(|(i, _)| ranges[*i].defined || end <= least) {
                if begins[i] > 0.0 {
                    continue;
                }
                let value = values[watched.function as usize][watched.variable];
                let range = Interval::point(watched.sign) * (Interval::point(value) + ranges[i]);
                if end <= least || range.lo - self.change_up_to(functions, watched, end) >= -watched.limit {
                    begins[i] = end;
                }
            }
            end *= 0.5;
        }
        Ok(Some(begins))
    }

    /// Returns the interval of time that a panel of the present element takes.
    fn times(&self, panel: Panel, h: f64) -> Interval {
        let [from, to] = [panel.begin, panel.end()].map(|theta| self.t + theta * h);
        Interval::new(if panel.begin == 0.0 { from } else { from.next_down() }, to.next_up())
    }

    /// Screens quantities for changes of sign on a panel, by parts of the panel in order of time.
    fn screen_panel(
        &mut self,
        functions: &Functions<'_>,
        watched: &[Watched],
        left: Vec<usize>,
        panel: Panel,
        outcome: &mut Outcome,
    ) -> Result<(), StepError> {
        let mut stack = vec![self.interpolate(functions, watched, &left, panel)?];
        let (mut parts, h) = (0, functions.trial.h);
        while let Some(mut stretch) = stack.pop() {
            let panel = stretch.panel;
            let is_behind = outcome.violation.is_some_and(|found| found.theta <= panel.begin);
            if stretch.left.is_empty() || is_behind || panel.length * h <= self.resolution(h) {
                continue;
            }
            parts += 1;
            let Some(seen) = self.prove(functions, watched, &mut stretch) else {
                outcome.is_open = true;
                return Ok(());
            };
            if let Some(violation) = seen.violation {
                if outcome.violation.is_none_or(|first| violation.theta < first.theta) {
                    outcome.violation = Some(violation);
                }
                continue;
            }
            if seen.is_unresolved {
                outcome.is_unresolved = true;
                stretch.left.retain(|unproven| watched[unproven.place].to.is_some());
            }
            if parts >= MOST_PARTS {
                outcome.is_open |= !stretch.left.is_empty();
                return Ok(());
            }
            let [first, second] = panel.halves();
            if seen.needs_more {
                let places: Vec<usize> = stretch.left.iter().map(|unproven| unproven.place).collect();
                for half in [second, first] {
                    stack.push(self.interpolate(functions, watched, &places, half)?);
                }
            } else {
                let mut behind = stretch.left.clone();
                for (before, behind) in stretch.left.iter_mut().zip(&mut behind) {
                    bernstein::halve(&mut before.coefficients, &mut behind.coefficients);
                }
                stack.push(Stretch { panel: second, left: behind });
                stack.push(Stretch { panel: first, left: stretch.left });
            }
        }
        Ok(())
    }

    /// Computes the interpolating polynomials of the screened quantities on a panel, with their remainders.
    fn interpolate(
        &mut self,
        functions: &Functions<'_>,
        watched: &[Watched],
        places: &[usize],
        panel: Panel,
    ) -> Result<Stretch, StepError> {
        if places.is_empty() {
            return Ok(Stretch { panel, left: Vec::new() });
        }
        let m = self.places.len();
        let with_memory = places.iter().any(|&place| watched[place].function == Function::Memory);
        let mut values = vec![Vec::with_capacity(DEGREE + 1); places.len()];
        let mut at = [vec![0.0; m], vec![0.0; m], vec![0.0; m]];
        for point in 0..=DEGREE {
            let theta = panel.begin + self.interpolation.points[point] * panel.length;
            self.evaluate_functions(functions, theta, with_memory, &mut at)?;
            for (values, &place) in values.iter_mut().zip(places) {
                values.push(at[watched[place].function as usize][watched[place].variable]);
            }
        }
        let polynomial = |(&place, values): (&usize, &Vec<f64>)| {
            let largest = values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
            let of_rounding = self.interpolation.growth * f64::EPSILON * largest;
            let of_interpolation = match self.is_polynomial(functions.trial, &watched[place]) {
                true => 0.0,
                false => panel.remainder() * self.bound_on(functions, &watched[place], panel),
            };
            let remainder = Remainder { of_interpolation, of_rounding };
            Unproven { place, coefficients: self.interpolation.coefficients(values), remainder }
        };
        Ok(Stretch { panel, left: places.iter().zip(&values).map(polynomial).collect() })
    }

    /// Removes the screened quantities that are proven positive on a part of a panel, and evaluates the others at its
    /// middle; returns `None` if the problem has no enclosure.
    fn prove(&mut self, functions: &Functions<'_>, watched: &[Watched], stretch: &mut Stretch) -> Option<Seen> {
        let (panel, h) = (stretch.panel, functions.trial.h);
        let times = self.times(panel, h);
        let over = self.forcing.enclose(times)?;
        let ranges: Vec<_> = stretch.left.iter().map(|unproven| watched[unproven.place].beside_over(over)).collect();
        let mut rows_at = |theta: f64| self.forcing.rows_at(self.t + theta * h).to_vec();
        let in_middle = rows_at(panel.middle());
        let mut at_ends = [None, None];
        let mut seen = Seen::default();
        let mut ranges = ranges.into_iter();
        stretch.left.retain(|Unproven { place, coefficients, remainder }| {
            let Some((range, slope)) = ranges.next() else { return true };
            let watched = &watched[*place];
            let sign = Interval::point(watched.sign);
            // A screened quantity is positive if its polynomial is at least `proven`, and negative if its polynomial is
            // below `lost`.
            let zero = -watched.limit - remainder.of_rounding;
            let (proven, lost) = (zero + remainder.of_interpolation, zero - remainder.of_interpolation);
            let whole = sign * (bernstein::range(coefficients) + range);
            if range.defined && whole.lo >= proven {
                return false;
            }
            let middle = watched.sign * (bernstein::value(coefficients, 0.5) + watched.beside_at(&in_middle));
            if middle < lost {
                match watched.to {
                    None => seen.is_unresolved = true,
                    Some(to) if seen.violation.is_none_or(|first| middle < first.value) => {
                        let (theta, variable) = (panel.middle(), watched.variable);
                        seen.violation = Some(Violation { theta, variable, to, value: middle });
                    }
                    Some(_) => {}
                }
                return true;
            }
            let slope = sign * (bernstein::range_of_rate(coefficients) + slope * Interval::point(panel.length * h));
            let mut lower = middle - 0.5 * slope.magnitudes().1;
            if lower < proven && (slope.lo >= 0.0 || slope.hi <= 0.0) {
                // If the slope of the screened quantity has one sign, its least value is at an end of the part.
                let end = usize::from(slope.lo < 0.0);
                let rows = at_ends[end].get_or_insert_with(|| rows_at([panel.begin, panel.end()][end]));
                lower = watched.sign * (bernstein::value(coefficients, end as f64) + watched.beside_at(rows));
            }
            seen.needs_more |= lower < proven && lower >= lost;
            lower < proven || lower.is_nan()
        });
        Some(seen)
    }
}
