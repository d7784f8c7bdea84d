//! Stability at the limits: stiffness, scales, horizons, blow-ups, degenerate inequalities, accumulating switches,
//! and extreme step sizes and output times. Results are compared with closed forms, or with properties that every
//! solution has.

mod bounds;
mod breakdown;
mod breaks;
mod degenerate;
mod ends;
mod harness;
mod outputs;
mod start;
mod steps;
mod stiffness;
mod switches;
mod table;
mod zeno;
