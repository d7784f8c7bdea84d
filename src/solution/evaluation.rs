//! Functions of the outputs of a problem, evaluated and enclosed along the last step of a method.

use super::run::Stepper;
use expression::{IntervalWorkspace, Sight, Tape};
use hybrid::Followed;
use numerics::Interval;

/// A program in `t` and the outputs of a problem, with buffers for one evaluation.
pub(super) struct EvaluationBuffer {
    program: Tape,
    sight: Sight,
    boxes: IntervalWorkspace,
    /// The outputs of the problem.
    pub outputs: Vec<f64>,
    /// The values of the program.
    pub values: Vec<f64>,
    output_ranges: Vec<Interval>,
    ranges: Vec<Interval>,
}

impl EvaluationBuffer {
    /// Buffers for a program with so many values, of a problem with so many outputs; `integrates` if its values are
    /// integrated.
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

    /// Evaluates at a time within the last step.
    pub fn at(&mut self, stepper: &mut impl Stepper, t: f64) -> &[f64] {
        stepper.values(t, &mut self.outputs);
        self.program.evaluate(t, &self.outputs, &mut self.values);
        &self.values
    }

    /// Evaluates where the problem has the given outputs.
    pub fn take(&mut self, t: f64, outputs: &[f64]) -> &[f64] {
        self.outputs.copy_from_slice(outputs);
        self.program.evaluate(t, outputs, &mut self.values);
        &self.values
    }

    /// Encloses outputs and values between two times within the last step, where the first outputs are uncertain by these
    /// amounts; `None` if they cannot be enclosed.
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

    /// The same at the time of the last evaluation, with values on the side of their jumps that it took.
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

    /// Begins with the samples of a part of a step for integrals.
    pub fn begin(&mut self) {
        if self.sight.is_needed() {
            self.sight.begin();
        }
    }

    /// Adds what was evaluated last to the samples.
    pub fn sample(&mut self) {
        if self.sight.is_needed() {
            self.sight.sample(&self.program);
        }
    }

    /// Bounds what the samples do not show of the values, between two times; returns whether there is anything.
    pub fn judge(&mut self, from: f64, to: f64) -> bool {
        if self.sight.is_needed() {
            self.sight.judge(&self.program, Interval::new(from, to));
        }
        self.sight.is_needed()
    }

    /// A bound on what the samples do not show at a place among outputs, which are smooth, then values; and its size.
    pub fn hidden(&mut self, place: usize) -> (f64, f64) {
        let value = place.checked_sub(self.outputs.len());
        value.map_or((0.0, 0.0), |value| self.sight.hidden(&self.program, value))
    }

    /// What was evaluated last, by its place among outputs, then values.
    pub fn got(&self, place: usize) -> f64 {
        of_both([&self.outputs, &self.values], place)
    }
}

/// What stands at a place among outputs, then values.
fn of_both<T: Copy>([outputs, values]: [&[T]; 2], place: usize) -> T {
    place.checked_sub(outputs.len()).map_or_else(|| outputs[place], |value| values[value])
}

/// Some of the outputs and values along the last step of a method.
pub(super) struct Along<'a, S> {
    pub stepper: &'a mut S,
    pub place: &'a mut EvaluationBuffer,
    /// Their places among outputs, then values.
    pub places: &'a [usize],
    /// By how much the first outputs are uncertain.
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
