//! What must stay as it is: the cost of every example, the answers to problems that came from outside, and answers that
//! do not depend on the units or on the horizon. What is wrong today is listed, and the lists may only shrink.

mod computing_time;
mod cost;
mod invariance;
mod known;
#[path = "../systems/reference.rs"]
mod reference;
mod strangers;
