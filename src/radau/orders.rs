//! The numbers of stages that a run may have, and that of the present step.

use super::error_control::Rescaled;
use super::settings::{Settings, StageChoice};
use super::tableau::Tableau;

/// A method with its tolerances.
#[derive(Clone, Copy)]
pub(super) struct Method {
    pub tableau: &'static Tableau,
    pub tolerance: Rescaled,
}

/// The methods of a run, and which of them makes the present step.
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

    /// The most stages of a step.
    pub fn most_stages(&self) -> usize {
        self.methods.iter().map(|method| method.tableau.stages()).max().unwrap_or(1)
    }

    /// The method of the present step.
    pub fn current(&self) -> &Method {
        &self.methods[self.current]
    }

    /// The method of the last accepted step.
    pub fn last(&self) -> &Method {
        &self.methods[self.last]
    }

    /// Whether both have as many stages.
    pub fn is_kept(&self) -> bool {
        self.last == self.current
    }

    /// Whether there is a choice.
    pub fn are_several(&self) -> bool {
        self.methods.len() > 1
    }

    /// Takes note of an accepted step.
    pub fn accept(&mut self) {
        self.last = self.current;
    }

    /// Takes more stages (1), fewer (-1) or as many (0) from now on; whether that makes a difference.
    pub fn change(&mut self, wish: isize) -> bool {
        self.set(self.current.saturating_add_signed(wish).min(self.methods.len() - 1))
    }

    /// Takes the fewest stages from now on; whether that makes a difference.
    pub fn take_fewest(&mut self) -> bool {
        self.set(0)
    }

    fn set(&mut self, new: usize) -> bool {
        std::mem::replace(&mut self.current, new) != new
    }
}
