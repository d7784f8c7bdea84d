//! Regression tests: the cost of every example, the solutions of problems from outside the project, and results that
//! must not depend on the units or on the horizon. Known failures are listed, and the lists may only shrink.

mod computing_time;
mod cost;
mod invariance;
mod known;
#[path = "../systems/reference.rs"]
mod reference;
mod strangers;
