//! Reasons why a motion with impacts has no derivative.

use radau::NoDerivative as NoSmoothDerivative;

/// The reason why a motion with impacts has no derivative.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoDerivative {
    /// A smooth arc between events has no derivative.
    #[error(transparent)]
    Smooth(#[from] NoSmoothDerivative),
    /// A gap touches zero without an impact (grazing).
    #[error(
        "a contact is touched and not struck (grazing): the velocity after it changes by the root of what is changed before"
    )]
    Grazing,
    /// Several contacts have their events at one time.
    #[error(
        "several contacts meet at one time, and which is the first depends on what is changed: the motion after them differs \
         with their order"
    )]
    Several,
    /// An impact is on the border between stick and slip, or between closed and open.
    #[error(
        "an impact is on the border between stick and slip, or between push and no push: the motion after it has a kink there"
    )]
    Degenerate,
    /// The restitution of an impact was limited, as full restitution would have added energy.
    #[error(
        "an impact with its whole restitution would have added energy, and as much was taken as adds none: that share has no \
         derivative"
    )]
    Limited,
    /// Impacts without energy loss (restitution 1) accumulate, so that their limit has no derivative.
    #[error("impacts with a restitution of 1 crowd, which have no limit")]
    Elastic,
    /// The derivative of the initial state leads off a contact or joint that holds at the start.
    #[error(
        "a contact or a joint holds, and what is changed leads off it: a derivative would be one to one side only; vary what \
         keeps it, or begin apart from it"
    )]
    OffContact,
    /// Contact forces are not unique, and with them the time of an event.
    #[error(
        "contacts share a load in more than one way, so that the time at which one of them gives way is not unique"
    )]
    Redundant,
    /// A contact changes its status at a breakpoint in time.
    #[error(
        "a contact opens, is struck, or changes between stick and slip at a time at which given motions jump or have a corner: \
         of that passage no derivatives are made"
    )]
    AtBreak,
    /// The steps that the adjoint would store exceed the allowed memory.
    #[error(
        "the steps before it take {mebibytes} MiB, and adjoint mode stores no more of a motion with impacts; a shorter time \
         takes less, and forward mode stores none"
    )]
    TooLong {
        /// The memory that the adjoint may use for stored steps, in MiB.
        mebibytes: usize,
    },
    /// Time stepping took over from smooth motion.
    #[error("no smooth motion could go on, and time stepping did, of which no derivatives are made")]
    SteppedOver,
}
