//! User settings of contact, and errors of a run.

/// The law for simultaneous impacts at several contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImpactLaw {
    /// All contacts at once.
    #[default]
    Simultaneous,
    /// One contact after the other.
    Sequential,
}

/// The settings of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The step size of time stepping.
    pub step: f64,
    /// Whether the step size is the default.
    pub default_step: bool,
    /// The law for simultaneous impacts.
    pub impact_law: ImpactLaw,
    /// The tolerance on the relative residual of the law of contact.
    pub tolerance: f64,
}

/// The reason why a step failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ContactError {
    /// A quantity is not finite.
    #[error(
        "a {what} is not finite at t = {t}: a division by zero, a function outside its domain, or a number too large"
    )]
    NotFinite {
        /// The name of the quantity.
        what: &'static str,
        /// The time.
        t: f64,
    },
    /// A force is not finite.
    #[error(
        "the force on coordinate {component} (counted from 0) is not finite at t = {t}: a division by zero, a function \
         outside its domain, or a number too large"
    )]
    Force {
        /// The coordinate.
        component: usize,
        /// The time.
        t: f64,
    },
    /// `M` is not positive definite.
    #[error("the mass matrix is not positive definite at t = {t}")]
    MassNotPositive {
        /// The time.
        t: f64,
    },
    /// The matrix of the implicit forces, or a response to an impulse, has no finite inverse.
    #[error("the matrix of the step is singular at t = {t}: take a smaller step")]
    Singular {
        /// The time.
        t: f64,
    },
    /// A gap closes where its gradient vanishes.
    #[error(
        "the gap of contact {contact} (counted from 0) has no gradient where it closes, at t = {t}, so that \
         its impulse has no direction"
    )]
    Gradient {
        /// The contact.
        contact: usize,
        /// The time.
        t: f64,
    },
    /// A coefficient of friction is negative or not finite.
    #[error(
        "the coefficient of friction of contact {contact} (counted from 0) is {mu} at t = {t}: it must not be negative"
    )]
    Friction {
        /// The contact.
        contact: usize,
        /// The coefficient.
        mu: f64,
        /// The time.
        t: f64,
    },
    /// The law of contact was not solved.
    #[error(
        "the law of contact and friction at {contacts} contacts was not solved at t = {t} (residual {residual:e}): \
         joints and contacts may block all motion, or a smaller step may help"
    )]
    Unsolved {
        /// The time.
        t: f64,
        /// The number of active contacts.
        contacts: usize,
        /// The relative residual.
        residual: f64,
    },
}

impl ContactError {
    /// The error with its time shifted by `by`, for a clock that is ahead.
    #[must_use]
    pub fn ahead(mut self, by: f64) -> Self {
        match &mut self {
            Self::NotFinite { t, .. }
            | Self::Force { t, .. }
            | Self::MassNotPositive { t }
            | Self::Singular { t }
            | Self::Gradient { t, .. }
            | Self::Friction { t, .. }
            | Self::Unsolved { t, .. } => *t += by,
        }
        self
    }

    /// A stable identifier for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NotFinite { .. } | Self::Force { .. } => "not_finite",
            Self::MassNotPositive { .. } => "mass_not_positive",
            Self::Singular { .. } => "singular",
            Self::Gradient { .. } => "gap_without_gradient",
            Self::Friction { .. } => "friction_negative",
            Self::Unsolved { .. } => "contact_unsolved",
        }
    }
}
