//! The [breaks](hybrid::Breaks), times at which the function `q` of the inequality or a bound has a kink or a jump:
//! an element ends at a break, and the next element has the singular basis functions of an element behind a switch.

use super::Segments;

impl Segments<'_> {
    /// Returns the length of an element, at most the proposed length `h`, that ends at the first break (kink or jump of
    /// the data) if there is one; and the first floating-point number after that break.
    pub(super) fn up_to_break(&mut self, h: f64) -> (f64, Option<f64>) {
        let part = self.breaks.up_to_break(self.forcing.problem(), self.t, h);
        match self.breaks.after() {
            Some(after) if part <= 0.0 => {
                self.pass_break(after);
                self.up_to_break(h)
            }
            after => (part, after),
        }
    }

    /// Records that the run continues at time `after`, behind a break (kink or jump of the data), with a new segment.
    pub(super) fn pass_break(&mut self, after: f64) {
        self.breaks.pass(after);
        self.is_first = true;
    }
}
