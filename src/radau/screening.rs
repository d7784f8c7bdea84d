//! Screening of a step by enclosures: can a monitor of its face change sign between the stages?
//!
//! The unknowns are polynomials over the step; their Bernstein coefficients bound their ranges, and thereby the
//! monitors (see [`monitors`]). A part of the step over which a monitor is not proven to keep its sign is bisected
//! (Kearfott 1996, *Rigorous Global Search*), the earliest part first. A monitor is proven to keep its sign if its
//! negative values stay within its uncertainty under the tolerances. Its sign change is seen if it is negative, with
//! consistent variables, at a point in between: there the step is cut.

mod block_monitors;
pub(super) mod contraction;
mod limits;
mod monitors;
mod on_face;
pub(super) mod part;
mod point;
mod reduced;
mod watched;

use super::face::Monitor;
use super::law::Excess;
use super::stepper::Radau;
use super::switches::Switching;
use super::tableau::interpolation_error;
use limits::{Limits, has_curved_monitors};
use monitors::{Enclosure, Found};
use on_face::{OnFace, Told};
use part::Part;
use watched::{Watched, watch};

/// Largest deviation of a given function of time from the polynomial through its values at the stages, relative to its
/// change over the step: beyond it, events between the stages may be as large as the change.
const RESOLVED: f64 = 1e-2;

/// Maximum number of parts of one step over which monitors are enclosed. Bisection of a part where a monitor starts
/// at zero gains a binary digit each time, so that monitors are decided down to `2^-50` of their range at both ends
/// of a step.
const MOST_PARTS: usize = 200;
/// Maximum number of parts of one step over which monitors are enclosed if hidden constraints alone determine
/// variables: over a part, the residual of hidden constraints shrinks no faster than the part, and costs more.
const MOST_HIDDEN: usize = 24;
/// Least fraction of a step that is worth a step of its own, if screening proves no more and no hidden constraints
/// determine variables: one of the maximum number of equal parts.
const SHORTEST: f64 = 1.0 / MOST_PARTS as f64;
/// Least fraction of a step that is worth a step of its own, if screening proves no more and hidden constraints
/// determine variables.
pub(super) const LEAST: f64 = 0.1;
/// Fraction of a step that is tried next if the equations of the face vary between the stages by more than their
/// values at the stages show: two halvings, since each attempt solves the stages anew.
pub(super) const UNRESOLVED: f64 = 0.25;
/// Number of halvings towards the beginning of a step, in the search for a point at which a monitor was still positive.
const RISES: i32 = 6;
/// Residual of a variational inequality, in units of the tolerances, up to which it counts as satisfied: one decimal
/// digit less than requested.
pub const ALLOWED: f64 = 10.0;

/// Result of the screening of a step for switches (changes of the active face of `K`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Screened {
    /// Proven: no monitor (event function) changes sign within the step.
    Proven,
    /// Sign changes of monitors (event functions) are neither excluded nor seen: parts of the step were left undecided,
    /// or the problem cannot be enclosed.
    Undecided,
    /// Sign changes of monitors (event functions) are not excluded, though the states determine every monitor: a proof
    /// would need too many parts of the step.
    Open,
    /// The variational inequality is violated at this time, with this excess (its residual in units of the
    /// tolerances).
    Missed(f64, Excess),
}

/// Result of the screening of monitors (event functions) between the stages, with positions as fractions of the step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Between {
    /// Proven: no monitor (event function) changes sign within the step.
    Proven,
    /// Nothing is proven, and no violation of a monitor (event function) was seen at the points examined.
    Undecided,
    /// Sign changes of monitors are neither excluded nor seen, although the states determine every monitor: smaller
    /// parts of the step would decide it.
    Open,
    /// Sign changes of monitors are neither excluded nor seen, and the equations of the active face vary between the
    /// stages by more than their values at the stages show.
    Unresolved,
    /// No monitor changes sign up to this point; the rest of the step was not examined.
    ProvenUpTo(f64),
    /// A monitor (event function) is violated at `theta`; no monitor changes sign up to `proven`.
    Violated { theta: f64, proven: f64 },
}

impl Between {
    /// Returns the point at which a monitor (event function) is seen violated in the step, and the point up to which no
    /// monitor changes sign.
    pub(super) fn violation(self) -> Option<(f64, f64)> {
        match self {
            Self::Violated { theta, proven } => Some((theta, proven)),
            _ => None,
        }
    }

    /// Returns the part of the step that is to be made first if an event was seen in the step, or is possible in the
    /// rest of the step.
    pub(super) fn part_before(self) -> Option<f64> {
        match self {
            Self::ProvenUpTo(theta) => Some(theta),
            Self::Violated { proven, .. } => Some(if proven >= LEAST { proven } else { 0.5 }),
            Self::Unresolved => Some(UNRESOLVED),
            Self::Proven | Self::Undecided | Self::Open => None,
        }
    }
}

/// Path in time and unknowns along which rows of the problem are evaluated within a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Along {
    /// Time varies, and the states are those at the beginning of the step.
    Time,
    /// Time varies, and the unknowns follow their polynomials.
    Polynomial,
}

/// Workspace of the screening of steps for switches.
#[derive(Debug, Default)]
pub(super) struct Screening {
    watched: Vec<Watched>,
    limits: Limits,
    enclosure: Enclosure,
    /// Parts of the step still to be examined, as a stack: the earliest is last.
    left: Vec<Part>,
    /// Unused parts of a step, kept so that their memory is reused.
    spare: Vec<Part>,
}

impl Radau<'_> {
    /// Screens the step of size `h` whose stages are solved, for switches between its stages.
    pub(super) fn screen_step(&mut self, h: f64) -> Between {
        let mut screening = std::mem::take(&mut self.switching.screening);
        let found = self.screen_parts(h, &mut screening);
        self.switching.screening = screening;
        match found {
            Between::Undecided | Between::Open | Between::Unresolved | Between::ProvenUpTo(_) => {
                self.violated_in_middles(h).map_or(found, |theta| Between::Violated { theta, proven: 0.0 })
            }
            found => found,
        }
    }

    fn screen_parts(&mut self, h: f64, screening: &mut Screening) -> Between {
        let Screening { watched, limits, enclosure, left, spare } = screening;
        watch(&self.system, watched);
        limits.start(&self.system, &self.control, self.uncertainties(h), &self.y);
        let has_blocks = self.system.set.has_blocks();
        spare.append(left);
        let mut whole = spare.pop().unwrap_or_default();
        let s = self.tableau().stages();
        whole.set_whole(self.tableau(), &self.y, &self.stages.z[..s * self.system.unknowns]);
        left.push(whole);
        let Self { system, control, switching, consistent, .. } = self;
        let Switching { inside, constraints, .. } = switching;
        let told = OnFace { system, control, inside, constraints, consistent: consistent.as_mut() }.told();
        // With blocks, a proof requires that equations determine all variables: on curved faces monitors are
        // evaluated from the polynomials of the variables, which may violate hidden constraints.
        let is_proof = !has_blocks || told != Told::InPart;
        let are_told = told != Told::InPart || watched.is_empty();
        let mut parts = 0;
        let (mut most, mut least) = if are_told { (MOST_PARTS, SHORTEST) } else { (MOST_HIDDEN, LEAST) };
        // Result of screening for the monitors that depend on hidden constraints, once no proof for them is attempted
        // any more.
        let mut given_up = None;
        while (has_blocks || !watched.is_empty())
            && let Some(mut part) = left.pop()
        {
            parts += 1;
            // In a shorter part, an event cannot be distinguished from the end of the step, where the rows may have a
            // breakpoint.
            if part.length * h > self.clock.rounding(h) {
                let span = (self.clock.t + part.begin * h, part.length * h);
                let Self { system, control, switching, consistent, .. } = self;
                let Switching { inside, constraints, .. } = switching;
                let mut on = OnFace { system, control, inside, constraints, consistent: consistent.as_mut() };
                match enclosure.prove(&mut on, &part, span, watched, limits) {
                    Found::Proven => {}
                    Found::Unproven { may_fail } if parts < most => {
                        if may_fail && self.is_violated_at(part.middle(), h) {
                            let (theta, proven) = (part.middle(), part.begin);
                            spare.push(part);
                            return Between::Violated { theta, proven };
                        }
                        let mut second = spare.pop().unwrap_or_default();
                        part.halve(&mut second);
                        left.extend([second, part]);
                        continue;
                    }
                    Found::Unproven { .. } if part.begin >= least => return Between::ProvenUpTo(part.begin),
                    // Attempt no further proof for the monitors (event functions) that depend on hidden constraints;
                    // the other monitors are still to be proven.
                    found @ (Found::Unproven { .. } | Found::Hopeless) if !are_told && given_up.is_none() => {
                        // Hidden constraints hold at the stages, so that the monitors there show nothing of what the
                        // unknowns do between the stages.
                        if self.is_unresolved(h, Along::Polynomial) {
                            return Between::Unresolved;
                        }
                        // The error test of the step resolves the states, and with them the monitors, but not rows
                        // that depend on time alone: only if these vary by more than the stages show are sign changes
                        // left open.
                        let is_open = found != Found::Hopeless && self.is_unresolved(h, Along::Time);
                        given_up = Some(if is_open { Between::Open } else { Between::Undecided });
                        let Self { system, switching, .. } = self;
                        watched.retain(|monitor| Enclosure::is_told(system, &mut switching.inside, monitor));
                        (most, least) = (parts + MOST_PARTS, SHORTEST);
                        left.push(part);
                        continue;
                    }
                    // The curved (nonlinear) monitors of blocks are bounded over boxes alone, which is too wide:
                    // leave them out. The flat (linear) monitors are still to be proven.
                    _ if limits.leave_out_curved(&self.system) => {
                        given_up.get_or_insert(Between::Undecided);
                        (most, least) = (parts + MOST_PARTS, SHORTEST);
                        left.push(part);
                        continue;
                    }
                    Found::Unproven { .. } if is_proof && self.are_monitors_flat() => return Between::Open,
                    Found::Unproven { .. } | Found::Hopeless | Found::Unknown => return Between::Undecided,
                }
            }
            spare.push(part);
        }
        given_up.unwrap_or(if is_proof { Between::Proven } else { Between::Undecided })
    }

    fn are_monitors_flat(&self) -> bool {
        (0..self.system.set.blocks().len()).all(|b| !has_curved_monitors(&self.system, b))
    }

    /// Whether rows of the problem vary by more than the stages of a step of size `h` show: at the midpoints between
    /// the stages they deviate from the polynomial through their values at the stages. Along time, these rows are all
    /// rows at the states at the beginning of the step; along the polynomials of the unknowns, they are the equations
    /// of the face that are not polynomials of low degree.
    fn is_unresolved(&mut self, h: f64, along: Along) -> bool {
        let n = self.system.states;
        let rows: Vec<usize> = match along {
            Along::Time => (0..self.system.values.len()).collect(),
            Along::Polynomial => {
                let features = self.system.features.iter().copied();
                features
                    .filter(|&row| row >= n && row < self.system.unknowns && self.system.is_inside(row - n))
                    .collect()
            }
        };
        if rows.is_empty() {
            return false;
        }
        let tableau = self.tableau();
        let (t, begin, evaluations) = (self.clock.t, self.y.clone(), self.system.work.rates);
        let mut at = |theta: f64| -> Vec<f64> {
            if along == Along::Time {
                self.system.evaluate(t + theta * h, &begin);
                return self.system.values.clone();
            }
            self.polynomial_at(theta);
            let y = &self.switching.scratch;
            self.system.evaluate(t + theta * h, y);
            // Linear terms follow the polynomials of the unknowns exactly, and are subtracted.
            let linear = |row: usize| self.system.slope(row - n, |j| y[j] - begin[j]);
            rows.iter().map(|&row| self.system.values[row] - linear(row)).collect()
        };
        let at_begin = at(0.0);
        let at_nodes: Vec<Vec<f64>> = tableau.c.iter().map(|&node| at(node)).collect();
        let mut weights = vec![0.0; tableau.stages()];
        let is_unresolved = tableau.middles().any(|theta| {
            tableau.increments_at(theta, &mut weights);
            at(theta).iter().zip(&at_begin).enumerate().any(|(i, (value, begin))| {
                let of_nodes = || at_nodes.iter().map(|values| values[i]);
                let ends = (begin.min(*value), begin.max(*value));
                let (least, most) = of_nodes().fold(ends, |(a, b), node| (a.min(node), b.max(node)));
                let off = interpolation_error(*value, *begin, of_nodes(), &weights).abs();
                off > RESOLVED * (most - least) && off > f64::EPSILON.sqrt() * most.abs().max(least.abs())
            })
        });
        // Evaluations for the screening are not counted as work of the method.
        self.system.work.rates = evaluations;
        is_unresolved
    }

    /// Whether a monitor (event function) of the active face is violated at the position `theta` of the step of size
    /// `h`, whose stages are solved.
    fn is_violated_at(&mut self, theta: f64, h: f64) -> bool {
        let mut there = std::mem::take(&mut self.switching.between);
        self.judged_monitors_at(theta, h, &mut there);
        let is_violated = there.iter().any(Monitor::is_violated);
        self.switching.between = there;
        is_violated
    }

    /// Whether a monitor that is violated at the position `theta` of the step of size `h`, whose stages are solved, was
    /// positive earlier in the step.
    pub(super) fn rises_before(&mut self, theta: f64, h: f64) -> bool {
        let (mut there, mut before) = (Vec::new(), Vec::new());
        self.judged_monitors_at(theta, h, &mut there);
        (1..=RISES).any(|k| {
            self.monitors_at(theta * 0.5_f64.powi(k), h, &mut before);
            there.iter().zip(&before).any(|(there, before)| there.is_violated() && before.value > before.noise)
        })
    }

    /// Returns the first midpoint between the stages at which a monitor (event function) is violated.
    fn violated_in_middles(&mut self, h: f64) -> Option<f64> {
        self.tableau().middles().find(|&theta| self.is_violated_at(theta, h))
    }

    /// Returns the result of the screening of the last step for switches; `None` if the step has no bounded variables.
    pub fn screened(&mut self) -> Option<Screened> {
        let found = self.last.screened?;
        // If the step ended its active face, the variables at the end of the step must still satisfy the variational
        // inequality.
        let end = self.last.t + self.last.h;
        if self.last.is_smooth
            && !self.continues
            && let Some(excess) = self.excess_within(end).filter(|found| found.excess > ALLOWED)
        {
            return Some(Screened::Missed(end, excess));
        }
        Some(match found {
            Between::Proven => Screened::Proven,
            Between::Undecided | Between::ProvenUpTo(_) => Screened::Undecided,
            Between::Open | Between::Unresolved => Screened::Open,
            Between::Violated { theta, .. } => {
                let t = self.last.t + theta * self.last.h;
                match self.excess_within(t).filter(|found| found.excess > ALLOWED) {
                    Some(excess) => Screened::Missed(t, excess),
                    // The violation of the monitor is within the uncertainty under the tolerances, and the rest of the
                    // step was not examined; this is frequent for monitors of blocks.
                    None if self.system.set.has_blocks() => Screened::Undecided,
                    None => Screened::Open,
                }
            }
        })
    }

    /// Returns the residual of the variational inequality, in units of the tolerances, at a time within the last
    /// step, on the face of the step and with variables consistent with the states, whether or not these variables
    /// lie in `K`.
    fn excess_within(&mut self, t: f64) -> Option<Excess> {
        let mut y = vec![0.0; self.system.unknowns];
        self.last.at(self.orders.last().tableau, t, &mut y);
        std::mem::swap(&mut self.system.face, &mut self.last.face);
        self.bring_onto_face(t, &mut y);
        let excess = self.law_excess(t, &y);
        std::mem::swap(&mut self.system.face, &mut self.last.face);
        excess
    }
}
