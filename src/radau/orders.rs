//! The methods (numbers of stages) available to a run, and the selection of the present one.

use super::error_control::Rescaled;
use super::settings::{Settings, StageChoice};
use super::tableau::Tableau;

/// A method, given by its number of stages, with its rescaled tolerances.
#[derive(Clone, Copy)]
pub(super) struct Method {
    pub tableau: &'static Tableau,
    pub tolerance: Rescaled,
}

/// The methods available to a run, with the indices of the present method and of the method of the last accepted step.
#[derive(Clone)]
pub(super) struct Orders {
    methods: Vec<Method>,
    current: usize,
    last: usize,
}

impl Orders {
    pub fn new(settings: &Settings) -> Self {
        let counts = match settings.stages {
            StageChoice::Fixed(s) => vec![s],
            StageChoice::Auto => vec![3, 5, 7],
        };
        let adaptive = settings.step.is_none();
        let method =
            |s: usize| Method { tableau: Tableau::of(s), tolerance: Rescaled::new(s, settings.rtol, adaptive) };
        Self { methods: counts.into_iter().map(method).collect(), current: 0, last: 0 }
    }

    /// Returns the largest number of stages that a step of the run may have.
    pub fn most_stages(&self) -> usize {
        self.methods.iter().map(|method| method.tableau.stages()).max().unwrap_or(1)
    }

    /// Returns the least number of stages that a step of the run may have.
    pub fn fewest_stages(&self) -> usize {
        self.methods.iter().map(|method| method.tableau.stages()).min().unwrap_or(1)
    }

    /// Returns the method (number of stages and tolerances) of the present step.
    pub fn current(&self) -> &Method {
        &self.methods[self.current]
    }

    /// Returns the method (number of stages and tolerances) of the last accepted step.
    pub fn last(&self) -> &Method {
        &self.methods[self.last]
    }

    /// Whether the present step has as many stages as the last one.
    pub fn is_kept(&self) -> bool {
        self.last == self.current
    }

    /// Whether the number of stages may vary from step to step.
    pub fn are_several(&self) -> bool {
        self.methods.len() > 1
    }

    /// Records that a step with the present method was accepted.
    pub fn accept(&mut self) {
        self.last = self.current;
    }

    /// Selects more stages (1), fewer (-1) or as many stages (0) for the following steps; returns whether the number
    /// changes.
    pub fn change(&mut self, wish: isize) -> bool {
        self.set(self.current.saturating_add_signed(wish).min(self.methods.len() - 1))
    }

    /// Selects the fewest stages for the following steps; returns whether the number changes.
    pub fn take_fewest(&mut self) -> bool {
        self.set(0)
    }

    fn set(&mut self, new: usize) -> bool {
        std::mem::replace(&mut self.current, new) != new
    }
}
