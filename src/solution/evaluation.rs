//! Functions of the outputs of a problem, evaluated and enclosed along the last step of a method.

use super::run::Stepper;
use expression::{IntervalWorkspace, Sight, Tape};
use hybrid::Followed;
use numerics::Interval;

/// A compiled program of functions of `t` and the outputs of a problem, with buffers for its evaluation.
pub(super) struct EvaluationBuffer {
    program: Tape,
    sight: Sight,
    boxes: IntervalWorkspace,
    /// The outputs of the problem at the last evaluation.
    pub outputs: Vec<f64>,
    /// The values of the program's functions at the last evaluation.
    pub values: Vec<f64>,
    output_ranges: Vec<Interval>,
    ranges: Vec<Interval>,
}

impl EvaluationBuffer {
    /// Creates the buffers for a program that computes `values` values, for a problem with `outputs` outputs;
    /// `integrates` is set if the values are integrated.
    pub fn new(program: &Tape, [outputs, values]: [usize; 2], integrates: bool) -> Self {
        Self {
            program: program.clone(),
            sight: if integrates { Sight::new(program) } else { Sight::default() },
            boxes: IntervalWorkspace::new(program),
            outputs: vec![0.0; outputs],
            values: vec![0.0; values],
            output_ranges: vec![Interval::LINE; outputs],
            ranges: vec![Interval::LINE; values],
        }
    }

    /// Evaluates the program at a time within the last step of the method `stepper`.
    pub fn at(&mut self, stepper: &mut impl Stepper, t: f64) -> &[f64] {
        stepper.values(t, &mut self.outputs);
        self.program.evaluate(t, &self.outputs, &mut self.values);
        &self.values
    }

    /// Evaluates the program at the time `t` with given outputs of the problem.
    pub fn take(&mut self, t: f64, outputs: &[f64]) -> &[f64] {
        self.outputs.copy_from_slice(outputs);
        self.program.evaluate(t, outputs, &mut self.values);
        &self.values
    }

    /// Encloses outputs and values of the program between two times within the last step, with the first outputs
    /// widened by their uncertainties `uncertain`; returns `None` if they cannot be enclosed.
    pub fn enclose(
        &mut self,
        stepper: &mut impl Stepper,
        (from, to): (f64, f64),
        uncertain: &[f64],
    ) -> Option<[&[Interval]; 2]> {
        self.enclose_outputs(stepper, (from, to), uncertain)?;
        let Self { program, boxes, output_ranges, ranges, .. } = self;
        program.enclose(Interval::new(from, to), output_ranges, boxes, ranges);
        Some([output_ranges, ranges])
    }

    /// Encloses outputs and values of the program at the time of the last evaluation; functions that jump there are
    /// enclosed on the side of the last evaluation.
    fn enclose_at(&mut self, stepper: &mut impl Stepper, t: f64, uncertain: &[f64]) -> Option<[&[Interval]; 2]> {
        self.enclose_outputs(stepper, (t, t), uncertain)?;
        let Self { program, boxes, output_ranges, ranges, .. } = self;
        program.enclose_as_evaluated(Interval::point(t), output_ranges, boxes, ranges);
        Some([output_ranges, ranges])
    }

    fn enclose_outputs(&mut self, stepper: &mut impl Stepper, (from, to): (f64, f64), uncertain: &[f64]) -> Option<()> {
        self.output_ranges.fill(Interval::LINE);
        if !stepper.enclose(from, to, &mut self.output_ranges) {
            return None;
        }
        for (range, by) in self.output_ranges.iter_mut().zip(uncertain) {
            *range = *range + Interval::new(-by, *by);
        }
        Some(())
    }

    /// Discards all samples of the program, and begins those of another part of a step, over which its values are to be
    /// integrated.
    pub fn begin(&mut self) {
        if self.sight.is_needed() {
            self.sight.begin();
        }
    }

    /// Adds the last evaluation of the program to the samples of the current part of a step.
    pub fn sample(&mut self) {
        if self.sight.is_needed() {
            self.sight.sample(&self.program);
        }
    }

    /// Bounds the variation of the program's values between two times that the samples do not show; returns whether
    /// samples may miss variation of any value.
    pub fn judge(&mut self, from: f64, to: f64) -> bool {
        if self.sight.is_needed() {
            self.sight.judge(&self.program, Interval::new(from, to));
        }
        self.sight.is_needed()
    }

    /// Returns a bound on the variation that the samples of a function do not show, and the size of the function;
    /// both zero for outputs, which are smooth. The function is given by its index into the outputs of the problem
    /// followed by the values of the program.
    pub fn hidden(&mut self, place: usize) -> (f64, f64) {
        let value = place.checked_sub(self.outputs.len());
        value.map_or((0.0, 0.0), |value| self.sight.hidden(&self.program, value))
    }

    /// Returns the value in the last evaluation of the function with the index `place` into the outputs of the
    /// problem followed by the values of the program.
    pub fn got(&self, place: usize) -> f64 {
        of_both([&self.outputs, &self.values], place)
    }
}

/// Returns the element with the index `place` of the list `outputs` followed by the list `values`.
fn of_both<T: Copy>([outputs, values]: [&[T]; 2], place: usize) -> T {
    place.checked_sub(outputs.len()).map_or_else(|| outputs[place], |value| values[value])
}

/// Selected outputs of the problem and values of a program as functions of time along the last step of a method.
pub(super) struct Along<'a, S> {
    pub stepper: &'a mut S,
    pub place: &'a mut EvaluationBuffer,
    /// The selected functions, as indices into the outputs of the problem followed by the values of the program.
    pub places: &'a [usize],
    /// The uncertainties of the first outputs of the problem, by which their enclosures are widened.
    pub uncertain: &'a [f64],
}

impl<S: Stepper> Followed for Along<'_, S> {
    fn monitors(&mut self, t: f64, out: &mut [f64]) {
        self.place.at(self.stepper, t);
        out.iter_mut().zip(self.places).for_each(|(out, &place)| *out = self.place.got(place));
    }

    fn enclose(&mut self, from: f64, to: f64, out: &mut [Interval]) -> bool {
        let Some(ranges) = self.place.enclose(self.stepper, (from, to), self.uncertain) else { return false };
        out.iter_mut().zip(self.places).for_each(|(out, &place)| *out = of_both(ranges, place));
        true
    }

    fn enclose_at(&mut self, t: f64, out: &mut [Interval]) -> bool {
        let Some(ranges) = self.place.enclose_at(self.stepper, t, self.uncertain) else { return false };
        out.iter_mut().zip(self.places).for_each(|(out, &place)| *out = of_both(ranges, place));
        true
    }
}
