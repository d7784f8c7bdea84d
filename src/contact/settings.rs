//! User settings of runs with contacts, and the errors that end such a run.

/// The law for simultaneous impacts at several contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImpactLaw {
    /// Simultaneous: one impact law for all contacts at once.
    #[default]
    Simultaneous,
    /// Sequential: Newton's impact law for one contact after the other.
    Sequential,
}

/// Settings of a run with contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The step size of time stepping.
    pub step: f64,
    /// Whether the step size of time stepping is the default.
    pub default_step: bool,
    /// The law for simultaneous impacts at several contacts.
    pub impact_law: ImpactLaw,
    /// The tolerance on the relative residual of the contact law.
    pub tolerance: f64,
}

/// The reason why a step of a system with contacts failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ContactError {
    /// A quantity of the mechanical system is not finite.
    #[error(
        "a {what} is not finite at t = {t}: a division by zero, a function outside its domain, or a number too large"
    )]
    NotFinite {
        /// The name of the quantity that is not finite, for the message.
        what: &'static str,
        /// The time at which the quantity is not finite.
        t: f64,
    },
    /// A generalised force is not finite.
    #[error(
        "the force on coordinate {component} (counted from 0) is not finite at t = {t}: a division by zero, a function \
         outside its domain, or a number too large"
    )]
    Force {
        /// The index of the coordinate on which the force that is not finite acts.
        component: usize,
        /// The time at which the force is not finite.
        t: f64,
    },
    /// The mass matrix `M` is not positive definite.
    #[error("the mass matrix is not positive definite at t = {t}")]
    MassNotPositive {
        /// The time at which the mass matrix is not positive definite.
        t: f64,
    },
    /// The matrix of the linearly implicit forces, or the response to an impulse, has no finite inverse.
    #[error("the matrix of the step is singular at t = {t}: take a smaller step")]
    Singular {
        /// The time at which the matrix has no finite inverse.
        t: f64,
    },
    /// The gradient of a gap vanishes where the gap closes.
    #[error(
        "the gap of contact {contact} (counted from 0) has no gradient where it closes, at t = {t}, so that \
         its impulse has no direction"
    )]
    Gradient {
        /// The index of the contact whose gap has no gradient.
        contact: usize,
        /// The time at which the gap closes.
        t: f64,
    },
    /// A coefficient of friction is negative or not finite.
    #[error(
        "the coefficient of friction of contact {contact} (counted from 0) is {mu} at t = {t}: it must not be negative"
    )]
    Friction {
        /// The index of the contact with the inadmissible coefficient of friction.
        contact: usize,
        /// The inadmissible coefficient of friction.
        mu: f64,
        /// The time at which the coefficient of friction is inadmissible.
        t: f64,
    },
    /// The contact law was not solved to its tolerance.
    #[error(
        "the law of contact and friction at {contacts} contacts was not solved at t = {t} (residual {residual:e}): \
         joints and contacts may block all motion, or a smaller step may help"
    )]
    Unsolved {
        /// The time at which the contact law was not solved.
        t: f64,
        /// The number of active contacts of the contact law that was not solved.
        contacts: usize,
        /// The relative residual that the solvers of the contact law reached.
        residual: f64,
    },
}

impl ContactError {
    /// Returns the error with its time shifted by `by`, the start time of a run whose clock starts at zero.
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

    /// Returns a stable identifier of the error for programs.
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
