//! Rigid bodies with impacts and friction, of index two: impulses are the unknowns, velocities may jump (Moreau 1988,
//! *Unilateral contact and dry friction in finite freedom dynamics*; Stewart 2000, *Rigid-body dynamics with friction
//! and impact*, SIAM Review 42).
//!
//! - [`law`]: impact and friction of all contacts of one step at once, in contact coordinates, independent of `M` and
//!   of the geometry of contacts.
//! - [`energy`]: the energy balance of a run.
//! - [`EventDriven`]: smooth motion by Radau IIA from impact to impact, a [`SmoothPhase`] for each mode.
//! - [`tangents`]: the derivatives of an event-driven motion with respect to parameters and initial values.
//! - [`islands`]: contacts that share no moving body are solved separately.
//! - [`VelocityStep`]: one step of a system in generalised coordinates; [`TimeStepping`]: a run of velocity steps.

mod active_contacts;
mod contact_event;
mod delassus;
mod elapsed;
pub mod energy;
pub mod islands;
pub mod law;
mod locate;
mod settings;
pub mod tangents;
mod time_stepping;
mod velocity_step;
mod violations;

pub use contact_event::ContactEvent;
pub use elapsed::Elapsed;
pub use locate::{EventDriven, Grazed, ModeEvaluators, Passed, Screening, SmoothPhase};
pub use settings::{ContactError, ImpactLaw, Settings};
pub use time_stepping::TimeStepping;
pub use velocity_step::{Contacted, Forces, State, VelocityStep, Work};
pub use violations::{Violation, Violations};
