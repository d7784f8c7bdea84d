//! Stability at the limits: stiffness, scales, horizons, blow-ups, degenerate inequalities, accumulating switches, step
//! sizes and output times at their extremes. Every answer is from outside: a closed form, or what must hold of any run.

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
