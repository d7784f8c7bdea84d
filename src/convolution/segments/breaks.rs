//! The [breaks](hybrid::Breaks), times at which the function `q` of the inequality or a bound has a kink or a jump:
//! an element ends at a break, and the next element has the singular basis functions of an element behind a switch.

use super::Segments;

impl Segments<'_> {
    /// Returns the length of an element of proposed length `h`, cut at the first break; and the first floating-point
    /// number after the break, if there is one.
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

    /// Begins a new segment behind a break.
    pub(super) fn pass_break(&mut self, after: f64) {
        self.breaks.pass(after);
        self.is_first = true;
    }
}
