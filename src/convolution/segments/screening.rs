//! Screening of an element by enclosure: does each quantity that the face requires to be positive stay so between the nodes?
//!
//! The functions of an element are analytic but at its beginning. On panels `[2^-k-1, 2^-k]` they are polynomials with a bound
//! of the remainder ([`panel`](super::panel)), `q` and the bounds are enclosed by interval arithmetic, and a part of a panel
//! over which a quantity is not proven is halved, as [`radau::screening`] does. Over the first panel of all, which begins at
//! zero, functions change no more than their moduli of continuity; panels are halved until that is enough, or they are too
//! short for a switch in them to count.

use super::Segments;
use super::advance::TINY;
use super::panel::{DEGREE, Panel};
use super::trial::{Trial, Violation};
use super::watched::{Function, Functions, Watched};
use crate::stepper::StepError;
use numerics::{Interval, bernstein};

/// The parts of one panel that are enclosed at most: halving gains a binary digit of the distance from a switch each time.
const MOST_PARTS: usize = 200;

/// What screening found of an element.
#[derive(Clone, Copy, Debug)]
pub enum Screened {
    /// Nothing is missed.
    Proven,
    /// A sign of the face is lost.
    Violated(Violation),
    /// `q` varies between the nodes in a way that they do not tell.
    Unresolved,
    /// Neither.
    Open,
}

/// A part of a panel: the coefficients of each quantity that is still to be proven there, without what stands beside it.
struct Stretch {
    panel: Panel,
    left: Vec<(usize, Vec<f64>)>,
}

/// What a polynomial is off by: what a shorter panel lessens, and what it does not, which counts as zero.
#[derive(Clone, Copy, Debug, Default)]
struct Remainder {
    of_interpolation: f64,
    of_rounding: f64,
}

/// What became of a panel.
#[derive(Default)]
struct Outcome {
    violation: Option<Violation>,
    is_unresolved: bool,
    is_open: bool,
}

impl Segments<'_> {
    /// Screens an element whose nodes show no loss of a sign.
    pub(super) fn screen(&mut self, trial: &Trial) -> Result<Screened, StepError> {
        let functions = self.functions(trial);
        let watched = self.watch(trial);
        let Some(begins) = self.begins(&functions, &watched)? else { return Ok(Screened::Open) };
        let mut outcome = Outcome::default();
        // Polynomials are themselves.
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

    /// Whether a function is a polynomial on the element.
    fn is_polynomial(&self, trial: &Trial, watched: &Watched) -> bool {
        watched.function != Function::Memory && !self.shapes[trial.shape].is_singular()
    }

    /// Of each quantity the end of a first panel over which it changes too little to be lost, or which is too short to count;
    /// nothing where the problem has no enclosure.
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

    /// The times of a panel.
    fn times(&self, panel: Panel, h: f64) -> Interval {
        let [from, to] = [panel.begin, panel.end()].map(|theta| self.t + theta * h);
        Interval::new(if panel.begin == 0.0 { from } else { from.next_down() }, to.next_up())
    }

    /// Screens quantities on a panel, by parts, the first part first.
    fn screen_panel(
        &mut self,
        functions: &Functions<'_>,
        watched: &[Watched],
        left: Vec<usize>,
        panel: Panel,
        outcome: &mut Outcome,
    ) -> Result<(), StepError> {
        let mut stack = vec![self.interpolate(functions, watched, &left, panel)?];
        let mut parts = 0;
        while let Some((stretch, remainders)) = stack.pop() {
            let Stretch { panel, mut left } = stretch;
            if left.is_empty() || outcome.violation.is_some_and(|found| found.theta <= panel.begin) {
                continue;
            }
            parts += 1;
            let h = functions.trial.h;
            if panel.length * h <= self.resolution(h) {
                continue;
            }
            let Some(found) = self.prove(functions, watched, (panel, &mut left, &remainders)) else {
                outcome.is_open = true;
                return Ok(());
            };
            let (violation, is_unresolved, needs_more) = found;
            outcome.is_unresolved |= is_unresolved;
            if let Some(violation) = violation {
                if outcome.violation.is_none_or(|first| violation.theta < first.theta) {
                    outcome.violation = Some(violation);
                }
                continue;
            }
            if is_unresolved {
                left.retain(|(i, _)| watched[*i].to.is_some());
            }
            if parts >= MOST_PARTS {
                outcome.is_open |= !left.is_empty();
                return Ok(());
            }
            let halves = panel.halves();
            if needs_more {
                let indices: Vec<usize> = left.iter().map(|(i, _)| *i).collect();
                for half in halves.into_iter().rev() {
                    stack.push(self.interpolate(functions, watched, &indices, half)?);
                }
            } else {
                let mut second = left.clone();
                for ((_, first), (_, second)) in left.iter_mut().zip(&mut second) {
                    bernstein::halve(first, second);
                }
                stack.push((Stretch { panel: halves[1], left: second }, remainders.clone()));
                stack.push((Stretch { panel: halves[0], left }, remainders));
            }
        }
        Ok(())
    }

    /// The polynomials of quantities on a panel, and what each may be off by.
    fn interpolate(
        &mut self,
        functions: &Functions<'_>,
        watched: &[Watched],
        left: &[usize],
        panel: Panel,
    ) -> Result<(Stretch, Vec<Remainder>), StepError> {
        let m = self.places.len();
        let mut remainders = vec![Remainder::default(); watched.len()];
        if left.is_empty() {
            return Ok((Stretch { panel, left: Vec::new() }, remainders));
        }
        let with_memory = left.iter().any(|&i| watched[i].function == Function::Memory);
        let mut values = vec![Vec::with_capacity(DEGREE + 1); left.len()];
        let mut at = [vec![0.0; m], vec![0.0; m], vec![0.0; m]];
        for place in 0..=DEGREE {
            let theta = panel.begin + self.interpolation.points[place] * panel.length;
            self.evaluate_functions(functions, theta, with_memory, &mut at)?;
            for (values, &i) in values.iter_mut().zip(left) {
                values.push(at[watched[i].function as usize][watched[i].variable]);
            }
        }
        for (values, &i) in values.iter().zip(left) {
            let largest = values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
            remainders[i].of_rounding = self.interpolation.growth * f64::EPSILON * largest;
            if !self.is_polynomial(functions.trial, &watched[i]) {
                remainders[i].of_interpolation = panel.remainder() * self.bound_on(functions, &watched[i], panel);
            }
        }
        let polynomials = left.iter().zip(&values).map(|(&i, values)| (i, self.interpolation.coefficients(values)));
        Ok((Stretch { panel, left: polynomials.collect() }, remainders))
    }

    /// Takes out of `left` what is proven on a panel. Of the others: a loss of a sign in the middle, whether `q` is seen not to
    /// be resolved there, and whether the remainders are what is in the way. Nothing where the problem has no enclosure.
    fn prove(
        &mut self,
        functions: &Functions<'_>,
        watched: &[Watched],
        (panel, left, remainders): (Panel, &mut Vec<(usize, Vec<f64>)>, &[Remainder]),
    ) -> Option<(Option<Violation>, bool, bool)> {
        let h = functions.trial.h;
        let times = self.times(panel, h);
        let over = self.forcing.enclose(times)?;
        let ranges: Vec<_> = left.iter().map(|(i, _)| watched[*i].beside_over(over)).collect();
        let mut rows_at = |theta: f64| self.forcing.rows_at(self.t + theta * h).to_vec();
        let in_middle = rows_at(panel.middle());
        let mut at_ends = [None, None];
        let (mut place, mut violation, mut is_unresolved, mut needs_more) = (0, None::<Violation>, false, false);
        left.retain(|(i, coefficients)| {
            let (watched, (range, slope)) = (&watched[*i], ranges[place]);
            place += 1;
            let sign = Interval::point(watched.sign);
            let Remainder { of_interpolation, of_rounding } = remainders[*i];
            // Above the first it is proven, below the second it is lost.
            let zero = -watched.limit - of_rounding;
            let (proven, lost) = (zero + of_interpolation, zero - of_interpolation);
            let whole = sign * (bernstein::range(coefficients) + range);
            if range.defined && whole.lo >= proven {
                return false;
            }
            let middle = watched.sign * (bernstein::value(coefficients, 0.5) + watched.beside_at(&in_middle));
            if middle < lost {
                match watched.to {
                    Some(to) if violation.is_none_or(|first| middle < first.value) => {
                        violation =
                            Some(Violation { theta: panel.middle(), variable: watched.variable, to, value: middle });
                    }
                    Some(_) => {}
                    None => is_unresolved = true,
                }
                return true;
            }
            let slope = sign * (bernstein::range_of_rate(coefficients) + slope * Interval::point(panel.length * h));
            let mut lower = middle - 0.5 * slope.magnitudes().1;
            if lower < proven && (slope.lo >= 0.0 || slope.hi <= 0.0) {
                // The least value is at an end.
                let end = usize::from(slope.lo < 0.0);
                let rows =
                    at_ends[end].get_or_insert_with(|| rows_at(if end == 0 { panel.begin } else { panel.end() }));
                lower = watched.sign * (bernstein::value(coefficients, end as f64) + watched.beside_at(rows));
            }
            needs_more |= lower < proven && lower >= lost;
            lower < proven || lower.is_nan()
        });
        Some((violation, is_unresolved, needs_more))
    }
}
