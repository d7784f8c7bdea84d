//! Integration by segments. Between two switches the variables at their bounds stay there, the others solve `w = 0`, a
//! Volterra equation of the first kind, by collocation with product integration (Brunner 2004, Collocation Methods for
//! Volterra Integral and Related Functional Differential Equations) on elements of any length. Where a monitor of the
//! active set changes its sign, the element is shortened to end there (`location`), the active set changes, and the
//! next segment begins with functions that have the singularity of the solution (`shape`), as it does behind a break of
//! the forces (`breaks`); all earlier segments are a source (`past`). Each element is screened by enclosures for
//! changes of sign between its nodes (`screening`).

mod advance;
mod breaks;
mod lag;
mod location;
mod outputs;
mod panel;
mod past;
mod screening;
mod shape;
mod trial;
mod watched;

use super::forcing::Forcing;
use super::kernel::Kernel;
use super::stepper::StepError;
use hybrid::Breaks;
use lag::Lag;
use panel::Interpolation;
use past::Past;
use problem::{Control, ConvexSet, Dvi, Structure, Workspace};
use shape::Shape;

/// The activity of a variable: at a bound, between its bounds, or fixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// The variable is at its lower bound.
    AtLower,
    /// The variable is between its bounds.
    Inactive,
    /// The variable is at its upper bound.
    AtUpper,
    /// The variable is fixed by equal bounds.
    Fixed,
}

/// The settings of a run by segments.
#[derive(Clone, Debug)]
pub struct SegmentSettings {
    /// The number of polynomials on an element, from 1 to 9.
    pub stages: usize,
    /// The relative tolerance on the variables `z`.
    pub rtol: f64,
    /// The absolute tolerance on each variable, in its unit.
    pub atol: Vec<f64>,
    /// The admissible error of an element, in units of the tolerances.
    pub tolerance: f64,
    /// The length of the first trial element.
    pub first: f64,
    /// The largest admissible length of an element.
    pub longest: f64,
    /// The ends of the elements of an earlier run: elements are at most half as long as the earlier ones, so that the
    /// two runs share no mesh.
    pub before: Vec<f64>,
}

/// A switch: a change of the activity (at a bound, or between the bounds) of a variable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switch {
    /// The time of the switch.
    pub t: f64,
    /// Index of the variable.
    pub variable: usize,
    /// The activity of the variable after the switch.
    pub to: Activity,
}

/// A term of the kernel: its scalar function of the lag (time difference), the number of integrations of that function
/// over time, and the matrix that it multiplies.
struct Part {
    lag: Option<Lag>,
    level: usize,
    matrix: Vec<(usize, usize, f64)>,
}

/// A run of a problem with memory, integrated by segments.
pub struct Segments<'p> {
    forcing: Forcing<'p>,
    set: ConvexSet,
    shapes: [Shape; 2],
    terms: Vec<Part>,
    past: Past,
    t: f64,
    start: f64,
    end: f64,
    h: f64,
    longest: f64,
    before: Vec<f64>,
    /// The usual length of recent elements, relative to which an element is tiny.
    usual: f64,
    rtol: f64,
    atol: Vec<f64>,
    tolerance: f64,
    is_first: bool,
    places: Vec<Activity>,
    /// The activities of the variables on the last element on which switches are reported, neither tiny nor without a
    /// consistent active set; `None` before the first.
    told: Option<Vec<Activity>>,
    /// The number of changes of the active set (the activities of all variables) since the last element was accepted.
    flips: usize,
    /// The number of successive tiny elements, up to the last.
    kinks: u32,
    /// The length of the last element if no active set was consistent on it, zero otherwise; and whether the next
    /// element is made without a consistent active set.
    unclear: (f64, bool),
    /// The time at the beginning of the present series of elements on which switches are not reported (tiny ones, and
    /// those without a consistent active set); `None` if the last element was none of them.
    brief: Option<f64>,
    size: Vec<f64>,
    /// The integrals of the variables up to the current time, repeated once, twice, and so on, from their
    /// polynomials.
    integrals: Vec<Vec<f64>>,
    /// The integral of the variables up to the current time.
    integral: Vec<f64>,
    switches: Vec<Switch>,
    /// The number of elements that were rejected and repeated with a shorter length.
    pub rejected: u64,
    breaks: Breaks,
    interpolation: Interpolation,
    /// The number of elements proven free of switches.
    pub proven: u64,
    /// The number of elements not proven free of switches.
    pub open: u64,
    order: usize,
    control: &'p Control,
    work: Workspace,
}

impl<'p> Segments<'p> {
    /// Whether a problem is suited to segments: variables in intervals, few enough for dense matrices, and elements of
    /// higher order than steps.
    pub fn suit(structure: &Structure, stages: usize) -> bool {
        const UNKNOWNS: usize = 100;
        stages > 1 && !structure.set.has_blocks() && structure.variables * stages <= UNKNOWNS
    }

    /// Prepares a run over `[start, end]`; `problem` has no states, and its inequality is the function `q` of time.
    ///
    /// # Errors
    /// If values are not finite, or a set is empty.
    pub fn new(
        problem: &'p mut dyn Dvi,
        kernel: &Kernel,
        settings: &SegmentSettings,
        start: f64,
        end: f64,
        control: &'p Control,
    ) -> Result<Self, StepError> {
        let (m, moves) = (problem.structure().variables, !problem.structure().moving.is_empty());
        let mut set = problem.structure().set.clone();
        let fraction = kernel.terms.iter().map(|term| term.function.exponent.fract()).find(|e| *e > 0.0);
        let beta = fraction.map_or(0.0, |fraction| 1.0 - fraction);
        let levels = kernel.terms.iter().map(|term| term.function.integrations).max().unwrap_or(0);
        let shapes = [Shape::smooth(settings.stages), Shape::behind_switch(settings.stages, beta, levels)];
        let parts = kernel.terms.iter().map(|term| Part {
            lag: Lag::new(&term.function, beta),
            level: term.function.integrations,
            matrix: term.matrix.clone(),
        });
        let terms: Vec<Part> = parts.collect();
        let past = Past::new(m, &shapes, levels);
        let mut forcing = Forcing::new(problem);
        let q = forcing.at(start, 0, &mut set)?.to_vec();
        let place = |k: usize| match q[k] {
            _ if set.lower[k] == set.upper[k] && !moves => Activity::Fixed,
            q if q > 0.0 && set.lower[k].is_finite() => Activity::AtLower,
            q if q < 0.0 && set.upper[k].is_finite() => Activity::AtUpper,
            _ => Activity::Inactive,
        };
        Ok(Self {
            places: (0..m).map(place).collect(),
            forcing,
            set,
            shapes,
            terms,
            past,
            t: start,
            start,
            end,
            h: settings.first.min(settings.longest),
            longest: settings.longest,
            before: settings.before.clone(),
            usual: 0.0,
            rtol: settings.rtol,
            atol: settings.atol.clone(),
            tolerance: settings.tolerance,
            is_first: true,
            told: None,
            flips: 0,
            kinks: 0,
            unclear: (0.0, false),
            brief: None,
            size: vec![0.0; m],
            integrals: vec![vec![0.0; m]; levels],
            integral: vec![0.0; m],
            switches: Vec::new(),
            rejected: 0,
            breaks: Breaks::new(start),
            interpolation: Interpolation::new(),
            proven: 0,
            open: 0,
            order: settings.stages,
            control,
            work: Workspace::default(),
        })
    }

    /// Returns the time that the run has reached, the end of the last element.
    pub fn t(&self) -> f64 {
        self.t
    }

    /// Whether the run has reached its end time.
    pub fn is_done(&self) -> bool {
        self.t >= self.end
    }

    /// Returns the number of elements of the run so far.
    pub fn elements(&self) -> usize {
        self.past.elements.len()
    }

    /// Returns the times at the ends of the elements so far.
    pub fn mesh(&self) -> Vec<f64> {
        self.past.elements.iter().map(|element| element.end).collect()
    }

    /// Returns the largest admissible length of the next element.
    fn longest(&self) -> f64 {
        let next = self.before.partition_point(|end| *end <= self.t);
        // Take the longer of two neighbouring elements: switches of two runs differ, and so do the short elements
        // next to them.
        let ends = [next.checked_sub(1), Some(next), Some(next + 1)];
        let ends =
            ends.map(|place| place.map_or(self.start, |place| *self.before.get(place).unwrap_or(&f64::INFINITY)));
        let length = (ends[1] - ends[0]).max(if ends[2].is_finite() { ends[2] - ends[1] } else { 0.0 });
        self.longest.min(0.5 * length)
    }

    /// Returns the number of polynomials on an element that the settings ask for.
    pub fn stages(&self) -> usize {
        self.order
    }

    /// Removes and returns the switches at the beginning of the last element, if any.
    pub fn take_switches(&mut self) -> Vec<Switch> {
        std::mem::take(&mut self.switches)
    }

    /// Returns the length of the shortest element that floating-point times resolve.
    fn resolution(&self, h: f64) -> f64 {
        8.0 * f64::EPSILON * self.t.abs().max(self.start.abs()).max((self.t + h).abs())
    }
}
