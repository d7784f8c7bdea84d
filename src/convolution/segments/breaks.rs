//! The [breaks](hybrid::Breaks) of `q` and of the bounds: an element ends there, and the next has the functions that a switch
//! calls for as well.

use super::Segments;

impl Segments<'_> {
    /// The part of an element of length `h` up to the first break, and the first number after that.
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

    /// Begins anew behind a break.
    pub(super) fn pass_break(&mut self, after: f64) {
        self.breaks.pass(after);
        self.is_first = true;
    }
}
