//! Numbers and texts collected from a run in place of its trajectory: values at its ends, extremes, means and integrals
//! along the dense output, counts and times of located events, and the mode word. Output times have no influence.

use super::columnar::checksum;
use super::evaluation::{Along, EvaluationBuffer};
use super::extremes::Extremes;
use super::impulse::Impulse;
use super::quadrature::{self, Integrals, integrate};
use super::run::Stepper;
use super::{Event, EventKind};
use expression::Tape;

/// Length in bytes above which a mode word, the text of successive modes, is cut.
const LONGEST_WORD: usize = 4 << 10;

/// The numbers and texts to collect from a run in place of its trajectory.
#[derive(Clone, Debug, Default)]
pub struct Reducers {
    /// The names of the collected columns.
    pub names: Vec<String>,
    /// The reductions of the run to a number or text, one per collected column.
    pub reductions: Vec<Reduction>,
    /// For each expression that is reduced, the outputs of the problem that it depends on.
    pub inputs: Vec<Vec<usize>>,
    /// The expressions that are reduced, compiled as functions of `t` and all outputs of the problem.
    pub program: Tape,
}

/// The computation of one number or text that is collected from a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Reduction {
    /// A functional (such as the mean) of an expression over the run.
    Value {
        /// The index of the expression in the program of all expressions.
        at: usize,
        /// The functional that reduces the expression over the run to a number.
        over: Over,
    },
    /// A sensitivity at the end of the run, by its index in [`Sensitivities::names`](super::Sensitivities::names).
    Derivative(usize),
    /// The number of events of the run that match a selection.
    Count(Selected),
    /// The time of the first event of the run that matches a selection.
    First(Selected),
    /// The time of the last event of the run that matches a selection.
    Last(Selected),
    /// The mode word: the sequence of modes of the run, as a text.
    ModeWord,
}

/// A functional that reduces an expression over a run to a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Over {
    /// The value of the expression at the end of the run.
    Final,
    /// The value of the expression at the start of the run.
    Initial,
    /// The minimum of the expression over the run.
    Min,
    /// The maximum of the expression over the run.
    Max,
    /// The maximum of the expression over the run minus its minimum.
    Ripple,
    /// The mean of the expression over the time of the run.
    Mean,
    /// The root mean square of the expression over the time of the run.
    Rms,
    /// The integral of the expression over the time of the run.
    Integral,
    /// The value of the expression at a given time.
    At(f64),
}

/// A selection of events by their kind and origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Selected {
    /// The kind of the selected events.
    pub kind: EventKind,
    /// The variable, contact or label of the selected events; `None` for any.
    pub of: Option<String>,
}

/// The number or text that a reduction has collected from a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Collected {
    /// A collected number; `None` if it is not finite, or the run ended too early.
    Number(Option<f64>),
    /// A collected count of events; `None` if the run did not reach its end.
    Count(Option<u32>),
    /// A collected text, the mode word; `None` if the run did not reach its end.
    Word(Option<String>),
}

impl Reducers {
    /// Whether values within steps of the run are needed, beside those at the ends of the run.
    pub fn is_dense(&self) -> bool {
        self.reductions.iter().any(|reduction| match reduction {
            Reduction::Value { over, .. } => !matches!(over, Over::Final | Over::Initial),
            _ => false,
        })
    }

    /// Returns the first collected column whose expression has no finite value, for a complete run. If an event of the
    /// user ended the run early (`is_early`), values at given times may lie after the end and do not count.
    pub(super) fn lost(&self, collected: &[Collected], is_early: bool) -> Option<&str> {
        let is_lost = |(reduction, found): (&Reduction, &Collected)| match reduction {
            Reduction::Value { over: Over::At(_), .. } if is_early => false,
            Reduction::Value { .. } | Reduction::Derivative(_) => *found == Collected::Number(None),
            _ => false,
        };
        let lost = self.reductions.iter().zip(collected).position(is_lost)?;
        self.names.get(lost).map(String::as_str)
    }

    /// Returns the collected numbers and texts of a run that never began, all of them missing.
    pub fn nothing(&self) -> Vec<Collected> {
        self.reductions.iter().map(Reduction::nothing).collect()
    }
}

impl Reduction {
    fn nothing(&self) -> Collected {
        match self {
            Self::Value { .. } | Self::Derivative(_) | Self::First(_) | Self::Last(_) => Collected::Number(None),
            Self::Count(_) => Collected::Count(None),
            Self::ModeWord => Collected::Word(None),
        }
    }
}

impl Selected {
    pub(super) fn takes(&self, event: &Event) -> bool {
        event.kind == self.kind && self.of.as_ref().is_none_or(|of| *of == event.of)
    }
}

/// The state of all reductions (collected numbers and texts) during a run.
pub(super) struct Reducing<'a> {
    of: &'a Reducers,
    place: EvaluationBuffer,
    start: f64,
    end: f64,
    at_start: Vec<f64>,
    at_end: Vec<f64>,
    /// For each reduction to the value at a given time, this value, if the run has reached that time.
    at_times: Vec<Option<f64>>,
    /// The integrands, as indices into the outputs of the problem followed by the values of the expressions, each with
    /// a flag whether it is squared.
    integrands: Vec<(usize, bool)>,
    integrals: Integrals,
    /// The functions whose extremes are needed, as indices into the outputs of the problem followed by the values of
    /// the expressions.
    extremes: Vec<usize>,
    found: Extremes,
    word: Option<Word>,
    has_times: bool,
}

impl<'a> Reducing<'a> {
    /// Creates the state of all reductions at the start of a run; `outputs` is the number of outputs of the problem.
    pub fn new(of: &'a Reducers, outputs: usize, stepper: &mut impl Stepper) -> Self {
        let mut integrands = Vec::new();
        let mut extremes = Vec::new();
        let mut count = 0;
        let mut has_times = false;
        for reduction in &of.reductions {
            let Reduction::Value { at, over } = reduction else { continue };
            count = count.max(at + 1);
            match over {
                Over::Mean | Over::Integral => integrands.push((outputs + at, false)),
                Over::Rms => integrands.push((outputs + at, true)),
                Over::Min | Over::Max | Over::Ripple => extremes.push(outputs + at),
                Over::At(_) => has_times = true,
                Over::Final | Over::Initial => {}
            }
        }
        integrands.sort_unstable();
        integrands.dedup();
        extremes.sort_unstable();
        extremes.dedup();
        let t = stepper.t();
        let word = of.reductions.contains(&Reduction::ModeWord).then(Word::default);
        let mut reducing = Self {
            of,
            place: EvaluationBuffer::new(&of.program, [outputs, count], !integrands.is_empty()),
            start: t,
            end: t,
            at_start: vec![0.0; count],
            at_end: vec![0.0; count],
            at_times: vec![None; of.reductions.len()],
            integrals: Integrals::new(integrands.len()),
            integrands,
            found: Extremes::new(extremes.len()),
            extremes,
            word,
            has_times,
        };
        if count > 0 {
            reducing.place.at(stepper, t);
            reducing.at_start.copy_from_slice(&reducing.place.values);
            reducing.at_end.copy_from_slice(&reducing.place.values);
        }
        reducing.look_at(stepper, t, t);
        if let Some(word) = &mut reducing.word
            && let Some(mode) = stepper.mode()
        {
            word.push(&mode);
        }
        reducing
    }

    /// Returns the largest relative uncertainty of a collected integral or mean.
    pub fn uncertainty(&self) -> Option<f64> {
        self.integrals.uncertainty().map(|(_, uncertainty)| uncertainty)
    }

    /// Returns the first collected column whose integral or mean is undefined because of an impulse, and the time of
    /// the impulse.
    pub fn undefined(&self) -> Option<(&str, f64)> {
        let (integral, t) = self.integrals.undefined()?;
        let (place, squared) = self.integrands[integral];
        let is_one = |over| if squared { over == Over::Rms } else { matches!(over, Over::Mean | Over::Integral) };
        Some((self.column(place, is_one)?, t))
    }

    /// Returns the collected column whose minimum or maximum is least certain: by how much the extreme may be exceeded,
    /// relative to its size, and at what time.
    pub fn open(&self) -> Option<(&str, f64, f64)> {
        let (extreme, by, t) = self.found.open()?;
        let is_one = |over| matches!(over, Over::Min | Over::Max | Over::Ripple);
        Some((self.column(self.extremes[extreme], is_one)?, by, t))
    }

    /// Returns the name of the first collected column that reduces a given expression by a functional that satisfies
    /// `is_one`; `place` is the index of the expression after all outputs of the problem.
    fn column(&self, place: usize, is_one: impl Fn(Over) -> bool) -> Option<&str> {
        let outputs = self.place.outputs.len();
        let is_one = |reduction: &Reduction| matches!(*reduction, Reduction::Value { at, over } if outputs + at == place && is_one(over));
        let column = self.of.reductions.iter().position(is_one)?;
        self.of.names.get(column).map(String::as_str)
    }

    /// Adds the last step of the run, from `begin` to `end`, with its events and impulses, to the reductions.
    pub fn step(
        &mut self,
        stepper: &mut impl Stepper,
        (begin, end): (f64, f64),
        events: &[Event],
        impulses: &[Impulse],
    ) {
        self.end = end;
        if let Some(word) = &mut self.word {
            match stepper.mode() {
                Some(mode) => word.push(&mode),
                None => events.iter().for_each(|event| word.push(&told(event))),
            }
        }
        let Self { place, extremes, integrands, integrals, found, .. } = self;
        if !integrands.is_empty() {
            integrate(begin, end, integrals, quadrature::Along { stepper, place, integrands });
            for impulse in impulses.iter().filter(|impulse| impulse.at <= end) {
                integrals.pass(impulse, place, integrands);
            }
        }
        found.step(begin, end, &mut Along { stepper, place, places: extremes, uncertain: &[] });
        self.look_at(stepper, begin, end);
    }

    /// Evaluates the reduced expressions at the requested times within a step.
    fn look_at(&mut self, stepper: &mut impl Stepper, begin: f64, end: f64) {
        if !self.has_times {
            return;
        }
        let of = self.of;
        for (k, reduction) in of.reductions.iter().enumerate() {
            if let Reduction::Value { at, over: Over::At(t) } = reduction
                && (begin..=end).contains(t)
            {
                self.place.at(stepper, *t);
                self.at_times[k] = Some(self.place.values[*at]);
            }
        }
    }

    /// Evaluates the reduced expressions at the end of the run.
    pub fn end(&mut self, stepper: &mut impl Stepper) {
        if !self.at_end.is_empty() && self.end > self.start {
            self.at_end.copy_from_slice(self.place.at(stepper, self.end));
        }
    }

    /// Returns the collected numbers and texts. If the run did not reach its end, they are missing, except values at
    /// times that the run has reached.
    pub fn finish(self, is_complete: bool, events: &[Event], derivatives: &[f64]) -> Vec<Collected> {
        let (time, outputs) = (self.end - self.start, self.place.outputs.len());
        let integral = |at: usize, squared: bool| {
            let place = self.integrands.iter().position(|known| *known == (outputs + at, squared));
            place.map_or(f64::NAN, |place| self.integrals.values[place])
        };
        let extremes = |at: usize| {
            let place = self.extremes.iter().position(|known| *known == outputs + at);
            place.map_or((f64::NAN, f64::NAN), |place| self.found.of(place))
        };
        let number = |value: f64| Collected::Number(Some(value).filter(|value| value.is_finite()));
        let word = self.word.map(Word::finish);
        let reduced = |(k, reduction): (usize, &Reduction)| match reduction {
            Reduction::Value { at, over: Over::Initial } => number(self.at_start[*at]),
            Reduction::Value { over: Over::At(_), .. } => number(self.at_times[k].unwrap_or(f64::NAN)),
            _ if !is_complete => reduction.nothing(),
            Reduction::Value { at, over } => number(match over {
                Over::Final | Over::Initial | Over::At(_) => self.at_end[*at],
                Over::Min => extremes(*at).0,
                Over::Max => extremes(*at).1,
                Over::Ripple => extremes(*at).1 - extremes(*at).0,
                Over::Mean => integral(*at, false) / time,
                Over::Rms => (integral(*at, true) / time).max(0.0).sqrt(),
                Over::Integral => integral(*at, false),
            }),
            Reduction::Derivative(at) => number(derivatives.get(*at).copied().unwrap_or(f64::NAN)),
            Reduction::Count(selected) => {
                let count = events.iter().filter(|event| selected.takes(event)).count();
                Collected::Count(u32::try_from(count).ok())
            }
            Reduction::First(selected) => {
                Collected::Number(events.iter().find(|event| selected.takes(event)).map(|event| event.t))
            }
            Reduction::Last(selected) => {
                Collected::Number(events.iter().rev().find(|event| selected.takes(event)).map(|event| event.t))
            }
            Reduction::ModeWord => Collected::Word(word.clone()),
        };
        self.of.reductions.iter().enumerate().map(reduced).collect()
    }
}

/// Formats an event as a letter of the mode word.
fn told(event: &Event) -> String {
    let kind = match event.kind {
        EventKind::Activated => "activated",
        EventKind::Deactivated => "deactivated",
        EventKind::Jumped => "jumped",
        EventKind::Impact => "impact",
        EventKind::LiftOff => "lift_off",
        EventKind::Stick => "stick",
        EventKind::Slip => "slip",
        EventKind::Crossed => "crossed",
    };
    format!("{}:{kind}", event.of)
}

/// A mode word under construction: letters joined by `>`, repetitions as `*n`.
#[derive(Debug, Default)]
struct Word {
    text: String,
    /// The last letter of the mode word, and the number of its repetitions.
    last: String,
    times: u64,
    /// Hash of the letters after the text has reached its largest length.
    hash: Option<u64>,
}

impl Word {
    /// Appends a letter to the mode word. Repetitions of an event are counted; a mode repeated from step to step is a
    /// single letter.
    fn push(&mut self, letter: &str) {
        let is_mode = !letter.contains(':');
        if letter == self.last {
            self.times += u64::from(!is_mode);
            return;
        }
        self.flush();
        letter.clone_into(&mut self.last);
        self.times = 1;
    }

    fn flush(&mut self) {
        if self.times == 0 {
            return;
        }
        let mut letter = if self.text.is_empty() { String::new() } else { ">".to_owned() };
        letter.push_str(&self.last);
        if self.times > 1 {
            letter.push_str(&format!("*{}", self.times));
        }
        match self.hash {
            None if self.text.len() + letter.len() <= LONGEST_WORD => self.text.push_str(&letter),
            hash => {
                let mut bytes = hash.unwrap_or_else(|| checksum(self.text.as_bytes())).to_le_bytes().to_vec();
                bytes.extend_from_slice(letter.as_bytes());
                self.hash = Some(checksum(&bytes));
            }
        }
    }

    fn finish(mut self) -> String {
        self.flush();
        if let Some(hash) = self.hash {
            self.text.push_str(&format!(">...#{hash:016x}"));
        }
        self.text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_events_are_counted_and_modes_are_not() {
        let mut word = Word::default();
        ["F.upper", "F.upper", "free", "F.upper"].iter().for_each(|letter| word.push(letter));
        assert_eq!(word.finish(), "F.upper>free>F.upper");
        let mut word = Word::default();
        ["a:impact", "a:impact", "b:impact", "a:impact"].iter().for_each(|letter| word.push(letter));
        assert_eq!(word.finish(), "a:impact*2>b:impact>a:impact");
    }

    #[test]
    fn a_long_word_is_cut_and_still_tells_one_from_another() {
        let word = |last: &str| {
            let mut word = Word::default();
            for k in 0..3000 {
                word.push(if k % 2 == 0 { "F.upper" } else { "F.lower" });
            }
            word.push(last);
            word.finish()
        };
        let (one, other) = (word("free"), word("F.upper"));
        assert!(one.len() < LONGEST_WORD + 30 && one != other, "{}", one.len());
        assert_eq!(one, word("free"));
    }
}
