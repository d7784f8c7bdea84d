//! What a user may choose of contact, and how a run can fail.

/// How impacts at several contacts at once come about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImpactLaw {
    /// All at once.
    #[default]
    Simultaneous,
    /// One after the other.
    Sequential,
}

/// The choices of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The step size of time stepping.
    pub step: f64,
    /// Whether nobody chose it.
    pub default_step: bool,
    /// How simultaneous impacts come about.
    pub impact_law: ImpactLaw,
    /// The relative residual of the law of contact.
    pub tolerance: f64,
}

/// Why a step could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ContactError {
    /// Something is not a number.
    #[error(
        "a {what} is not finite at t = {t}: a division by zero, a function outside its domain, or a number too large"
    )]
    NotFinite {
        /// What.
        what: &'static str,
        /// When.
        t: f64,
    },
    /// A force is not a number.
    #[error(
        "the force on coordinate {component} (counted from 0) is not finite at t = {t}: a division by zero, a function \
         outside its domain, or a number too large"
    )]
    Force {
        /// The coordinate.
        component: usize,
        /// When.
        t: f64,
    },
    /// `M` has lost its inverse.
    #[error("the mass matrix is not positive definite at t = {t}")]
    MassNotPositive {
        /// When.
        t: f64,
    },
    /// The matrix of the implicit forces, or a response to an impulse, has no finite inverse.
    #[error("the matrix of the step is singular at t = {t}: take a smaller step")]
    Singular {
        /// When.
        t: f64,
    },
    /// A gap closes where its gradient vanishes.
    #[error(
        "the gap of contact {contact} (counted from 0) has no gradient where it closes, at t = {t}: that leaves no direction to \
         its impulse"
    )]
    Gradient {
        /// The contact.
        contact: usize,
        /// When.
        t: f64,
    },
    /// The law of contact was not solved.
    #[error(
        "the law of contact and friction at {contacts} contacts was not solved at t = {t} (residual {residual:e}): joints \
         and contacts may leave no way to move, or a smaller step may help"
    )]
    Unsolved {
        /// When.
        t: f64,
        /// How many contacts were near.
        contacts: usize,
        /// What was left.
        residual: f64,
    },
}

impl ContactError {
    /// The same by a clock that is ahead by so much.
    #[must_use]
    pub fn ahead(mut self, by: f64) -> Self {
        match &mut self {
            Self::NotFinite { t, .. }
            | Self::Force { t, .. }
            | Self::MassNotPositive { t }
            | Self::Singular { t }
            | Self::Gradient { t, .. }
            | Self::Unsolved { t, .. } => *t += by,
        }
        self
    }

    /// A stable word for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NotFinite { .. } | Self::Force { .. } => "not_finite",
            Self::MassNotPositive { .. } => "mass_not_positive",
            Self::Singular { .. } => "singular",
            Self::Gradient { .. } => "gap_without_gradient",
            Self::Unsolved { .. } => "contact_unsolved",
        }
    }
}
