//! Lower bounds of the monitors over a part of a step.
//!
//! Interval arithmetic over the box of the unknowns gives `G` and the bounds, and thereby an enclosure of every value
//! of a monitor `m`. If that is too wide, another enclosure is
//!
//! ```text
//! m(middle) + m' [-1/2, 1/2],    m' = G_t dt/du + sum_j G_yj dy_j/du    over the part, u in [0, 1],
//! ```
//!
//! or the value at one end if `m'` has one sign. The free variables are the roots of `G_I = 0` rather than their
//! polynomials, from which they differ by `e = |dG_I/dz_I|^-1 |G_I|` to first order, and so do states that are bound by
//! constraints. Over the box, the monitors are lowered by the effect of these errors; in the second enclosure `m`
//! stands for
//!
//! ```text
//! m - w G_I,    w dG_I/dz_I = dm/dz_I,
//! ```
//!
//! which is the monitor at the roots up to `|dm/dz_I - w dG_I/dz_I| e` over the box: an error of second order, and zero
//! if `G` is linear. If hidden constraints determine variables and the Jacobian is constant, they are among the
//! equations,
//!
//! ```text
//! m - w G_I - v dG_I/dt,    dG/dt = G_t + G_x M^-1 F,
//! ```
//!
//! and the form depends on states and time alone, just as exactly. The residuals of other hidden constraints are
//! enclosed like those of `G`. For the monitors of blocks see [`BlockMonitors`].

use super::MOST_PARTS;
use super::block_monitors::{BlockMonitors, Over};
use super::limits::Limits;
use super::on_face::{OnFace, Told};
use super::part::Part;
use super::point::Point;
use super::reduced::{Reduced, Rows};
use super::watched::Watched;
use crate::consistent_variables::InverseMass;
use crate::face::{ActiveFace, Activity};
use crate::free_variables::FreeVariables;
use crate::system::System;
use nalgebra::DVector;
use numerics::Interval;

/// Workspace for the enclosures of monitors (event functions) over one part of a step.
#[derive(Debug, Default)]
pub(super) struct Enclosure {
    ranges: Vec<Interval>,
    values: Vec<Interval>,
    rows: Rows,
    middle: Point,
    ends: [Point; 2],
    /// The forms of the monitors of variables in intervals, [reduced](Reduced) by the equations of the free
    /// variables, in the order of the monitors.
    forms: Vec<Reduced>,
    /// The active face of `K` to which the reduced forms of the monitors belong; `None` if the derivatives, and with
    /// them the forms, vary on a face.
    face: Option<ActiveFace>,
    /// Magnitudes of the residuals of the equations of the active face of `K`: the rows of `Phi` that are not rates.
    residuals: Vec<f64>,
    /// Bounds on the distances of the unknowns from their polynomials.
    errors: Vec<f64>,
    /// Magnitudes of the hidden constraints `dG/dt` of the free variables.
    hidden: Vec<f64>,
    /// Ranges of the rates `M^-1 F` over the box of the unknowns.
    rates: Vec<Interval>,
    of_blocks: BlockMonitors,
    /// Indices of the monitors of variables in intervals that the enclosure over the box of the unknowns does not prove
    /// to keep their signs.
    left: Vec<usize>,
    /// Whether bisection into any reasonable number of parts of the step would not prove that the remaining monitors
    /// keep their signs.
    is_hopeless: bool,
    /// Whether derivatives vary so much over the last box that error bounds from the box are useless, and smaller
    /// boxes are needed.
    is_wide: bool,
}

/// Relative threshold: a derivative below this fraction of its terms consists of rounding errors.
const TOLD: f64 = 1e-10;
/// Safety factor for error bounds of the unknowns that are computed to first order.
const CURVATURE: f64 = 2.0;

/// Result of the attempt to prove that no monitor (event function) falls below minus its limit over a part of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    Proven,
    /// Not proven for the part of the step; `may_fail` tells that a monitor may be negative at the midpoint of the
    /// part.
    Unproven {
        may_fail: bool,
    },
    /// Bisection into any reasonable number of parts of the step would not prove that a monitor keeps its sign.
    Hopeless,
    /// The rows of the problem cannot be enclosed over the part of the step.
    Unknown,
}

impl Enclosure {
    /// Attempts to prove that no monitor (event function) falls below minus its limit over a part of a step that begins
    /// at time `t` and takes the time `h`.
    pub fn prove(
        &mut self,
        on: &mut OnFace<'_, '_>,
        part: &Part,
        (t, h): (f64, f64),
        watched: &[Watched],
        limits: &mut Limits,
    ) -> Found {
        let times = Interval::new(t.next_down(), (t + h).next_up());
        let told = on.told();
        let system = &mut *on.system;
        self.ranges.resize(system.unknowns, Interval::LINE);
        self.values.resize(system.values.len(), Interval::LINE);
        part.ranges(&mut self.ranges);
        if !system.problem().enclose(times, &self.ranges, &mut self.values) {
            return Found::Unknown;
        }
        self.residuals.clear();
        self.residuals.extend(self.values[..system.unknowns].iter().copied().map(Interval::size));
        self.middle.y.resize(system.unknowns, 0.0);
        part.values(0.5, &mut self.middle.y);
        // If derivatives vary, bound the limits and errors over the box of the unknowns.
        let is_linear = on.system.constant_jacobian();
        let mut are_rows_known = !is_linear && self.enclose_rows(on.system, times);
        if !is_linear {
            limits.follow(on.system, on.control, are_rows_known.then_some(&self.rows.jacobian));
        }
        let limits = &*limits;
        self.is_wide = false;
        if told == Told::ByEquations {
            self.find_errors(on, false, are_rows_known);
        }
        let system = &*on.system;
        // The errors of variables that hidden constraints determine only in part are unknown: use the polynomials of
        // these variables.
        let errors: &[f64] = if told == Told::ByEquations { &self.errors } else { &[] };
        let mut are_blocks_proven = match told {
            Told::ByHiddenConstraints => self.of_blocks.leave_open(system, limits),
            _ => self.of_blocks.are_proven_by_box(system, &self.ranges, &self.values, errors, limits),
        };
        let by_slopes = !are_blocks_proven && told != Told::InPart;
        let mut left = std::mem::take(&mut self.left);
        left.clear();
        left.extend((0..watched.len()).filter(|&at| {
            // If hidden constraints determine variables, the ranges of the unknowns over the step prove no sign: all
            // monitors are examined by enclosures of their slopes.
            told != Told::ByEquations || {
                let monitor = &watched[at];
                let lower = self.lower_end(system, monitor) + limits.of(monitor) - self.error_of(system, monitor);
                lower < 0.0 || lower.is_nan()
            }
        }));
        self.is_hopeless = false;
        let mut may_fail = false;
        if !left.is_empty() || by_slopes {
            are_rows_known = are_rows_known || self.enclose_rows(on.system, times);
            may_fail = !(are_rows_known && self.know_middle(on, told, part, (t, h))) || {
                let may_fail = self.may_fail(on, told, part, (t, h), (watched, limits), &mut left);
                if by_slopes {
                    let Self { of_blocks, rows, middle, values, errors, .. } = self;
                    let over = Over { told, slopes: rows, middle, rows: values, errors, part, h };
                    are_blocks_proven = of_blocks.are_proven_by_slopes(on, &over, limits);
                }
                may_fail
            };
        }
        let found = match are_blocks_proven && left.is_empty() {
            true => Found::Proven,
            false if self.is_hopeless => Found::Hopeless,
            false => Found::Unproven { may_fail: may_fail || !are_blocks_proven },
        };
        self.left = left;
        found
    }

    /// Evaluates the unknowns and the rows of the problem at the midpoint of the part of the step; returns whether all
    /// values are finite.
    fn know_middle(&mut self, on: &mut OnFace<'_, '_>, told: Told, part: &Part, (t, h): (f64, f64)) -> bool {
        self.middle.set(on.system, told, part, (t, h), 0.5);
        self.middle.is_finite
    }

    /// Encloses the derivatives of the rows of the problem over the box of the unknowns; returns whether the enclosures
    /// are known.
    fn enclose_rows(&mut self, system: &mut System<'_>, times: Interval) -> bool {
        let Rows { jacobian, by_time, terms } = &mut self.rows;
        jacobian.resize(system.derivatives.len(), Interval::LINE);
        by_time.resize(system.unknowns - system.states, Interval::LINE);
        terms.resize(system.forcing_slopes().map_or(0, |slopes| slopes.terms), Interval::LINE);
        system.problem().enclose_forcing_slopes(times, terms);
        system.problem().enclose_derivatives(times, &self.ranges, jacobian, by_time)
    }

    /// Updates the reduced forms of the monitors (event functions): of those with the indices `left` if derivatives
    /// vary, of all if the active face has changed.
    fn follow(&mut self, on: &mut OnFace<'_, '_>, told: Told, watched: &[Watched], left: &[usize]) {
        self.forms.resize_with(watched.len().max(self.forms.len()), Reduced::default);
        if !on.system.constant_jacobian() {
            self.face = None;
            left.iter().for_each(|&at| {
                self.forms[at].set(on, told, &self.rows, &self.middle.y, &watched[at].combination());
            });
        } else if self.face.as_ref() != Some(&on.system.face) {
            self.face.get_or_insert_default().clone_from(&on.system.face);
            self.forms
                .iter_mut()
                .zip(watched)
                .for_each(|(form, monitor)| form.set(on, told, &self.rows, &self.middle.y, &monitor.combination()));
        }
    }

    /// Removes from `left`, the indices of unproven monitors, those that the ranges of the slopes prove to keep their
    /// signs; returns whether one of the remaining monitors may be negative at the midpoint.
    fn may_fail(
        &mut self,
        on: &mut OnFace<'_, '_>,
        told: Told,
        part: &Part,
        (t, h): (f64, f64),
        (watched, limits): (&[Watched], &Limits),
        left: &mut Vec<usize>,
    ) -> bool {
        let n = on.system.states;
        // Reduced monitors that include all hidden constraints belong to states that satisfy their constraints: no
        // violation of these has to be allowed for.
        let has_errors = told != Told::ByHiddenConstraints;
        if has_errors {
            // The residuals of the equations of the free variables are bounded by their slopes as well: the ranges of
            // these residuals over the box are too wide for long steps.
            let system = &*on.system;
            let is_inside = |k: usize| system.face.places[k] == Activity::Inactive && system.set.block_of(k).is_none();
            for k in (0..system.unknowns - n).filter(|&k| is_inside(k)) {
                let slope = self.slope_of_row(system, part, h, n + k).size();
                let noise = on.control.noise_of_g(system, k, &self.middle.y);
                let sharper = self.middle.values[n + k].abs() + 0.5 * slope + noise;
                self.residuals[n + k] = self.residuals[n + k].min(sharper);
            }
        }
        self.follow(on, told, watched, left);
        let system = &*on.system;
        let at_middle =
            |&at: &usize| self.forms[at].value(system, self.middle.value(system, &watched[at]), &self.middle);
        let middles: Vec<(f64, f64)> = left.iter().map(at_middle).collect();
        let with_hidden = told == Told::InPart;
        if has_errors {
            self.find_errors_in_middle(on, with_hidden);
        }
        let error_of = |form: &Reduced, errors: &[f64]| if has_errors { form.error(errors) } else { 0.0 };
        let is_suspect = |(&at, (middle, _)): (&usize, &(f64, f64))| {
            let error = error_of(&self.forms[at], &self.errors);
            *middle < CURVATURE * error || middle.is_nan() || error.is_nan()
        };
        let is_suspect: Vec<bool> = left.iter().zip(&middles).map(is_suspect).collect();
        if with_hidden {
            self.find_hidden(on);
        }
        if has_errors {
            let is_linear = on.system.constant_jacobian();
            self.find_errors(on, with_hidden, !is_linear);
        }
        let system = &mut *on.system;
        let (mut index, mut may_fail, mut is_known) = (0, false, [false; 2]);
        left.retain(|&at| {
            let (form, monitor) = (&self.forms[at], &watched[at]);
            let ((middle, rounding), suspect) = (middles[index], is_suspect[index]);
            index += 1;
            let (slope, error) = (form.slope(&self.rows, part, h), error_of(form, &self.errors));
            // A negative value within the rounding error of a monitor is no event; slopes do not include the motion of
            // a bound.
            let moved = monitor.bound(system, &self.values).width();
            let limit = limits.of(monitor).max(limits.of_form(system, form));
            let allowed = moved + error + rounding - limit.max(2.0 * rounding);
            let mut is_proven = middle - 0.5 * slope.size() >= allowed;
            // If the slope of a monitor has one sign, its least value is at an end of the part.
            let end = if slope.lo >= 0.0 { 0 } else { 1 };
            if !is_proven && middle >= allowed && (slope.lo >= 0.0 || slope.hi <= 0.0) {
                let there = &mut self.ends[end];
                if !std::mem::replace(&mut is_known[end], true) {
                    there.set(system, told, part, (t, h), end as f64);
                }
                is_proven = there.is_finite && form.value(system, there.value(system, monitor), there).0 >= allowed;
            }
            may_fail |= !is_proven && suspect;
            // Bisection is hopeless if errors by hidden constraints are too large: over a box, the residual of a hidden
            // constraint shrinks no faster than the box.
            self.is_hopeless |= with_hidden && part.length == 1.0 && !self.is_wide && {
                // Compare with the size of the monitor in the whole part, since its value at the midpoint may happen
                // to vanish.
                let elsewhere = match monitor.place {
                    Activity::Inactive => self.ranges[n + monitor.variable].width(),
                    _ => 0.0,
                };
                error > MOST_PARTS as f64 * (middle + limits.of(monitor)).abs().max(elsewhere)
            };
            !is_proven
        });
        may_fail
    }

    /// Whether the variables that enter a monitor (event function) are determined without hidden constraints, up to
    /// rounding, by the current derivatives.
    pub fn is_told(system: &System<'_>, inside: &mut FreeVariables, monitor: &Watched) -> bool {
        let n = system.states;
        let mut own = monitor.combination().by_variables(system);
        let mut weights = Vec::new();
        inside.weights(system, |l| own[l], &mut weights);
        let mut terms: Vec<f64> = own.iter().map(|x| x.abs()).collect();
        for (l, weight) in weights {
            for (j, x) in system.entries_of_variable(l).filter(|(j, _)| *j >= n) {
                own[j - n] -= weight * x;
                terms[j - n] += (weight * x).abs();
            }
        }
        (0..own.len()).all(|l| system.face.places[l] != Activity::Inactive || own[l].abs() <= TOLD * terms[l])
    }

    /// Bounds the distances of the unknowns from their polynomials by the residuals of the equations of the active
    /// face, and of the hidden constraints: with the derivatives `over_box`, or with those of the last differentiation.
    fn find_errors(&mut self, on: &mut OnFace<'_, '_>, with_hidden: bool, over_box: bool) {
        let OnFace { system, control, inside, constraints, consistent } = on;
        let n = system.states;
        let (residuals, jacobian) = (&self.residuals[n..], &self.rows.jacobian);
        if over_box {
            self.is_wide |= inside.errors_over(system, jacobian, residuals, &mut self.errors);
        } else {
            inside.errors(system, residuals, &mut self.errors);
        }
        if with_hidden && let Some(consistent) = consistent {
            if over_box {
                self.is_wide |=
                    consistent.find_errors_over(system, jacobian, (residuals, &self.hidden), &mut self.errors);
            } else {
                consistent.find_errors(system, residuals, &self.hidden, &mut self.errors);
            }
        }
        self.errors.splice(0..0, std::iter::repeat_n(0.0, n));
        for k in (0..system.unknowns - n).filter(|&k| system.face.places[k] != Activity::Inactive) {
            self.residuals[n + k] = 0.0;
        }
        constraints.add_errors(system, control, &self.middle.y, &self.residuals, &mut self.errors);
    }

    /// Bounds the distances of the unknowns from their polynomials at the midpoint of the part, where `system` was
    /// evaluated last: they decide whether a monitor may be negative at the midpoint.
    fn find_errors_in_middle(&mut self, on: &mut OnFace<'_, '_>, with_hidden: bool) {
        let in_middle = self.middle.values[..on.system.unknowns].iter().map(|value| value.abs()).collect();
        let over_part = std::mem::replace(&mut self.residuals, in_middle);
        if with_hidden {
            self.find_hidden_in_middle(on);
        }
        self.find_errors(on, with_hidden, false);
        self.residuals = over_part;
    }

    /// Computes the magnitudes of the hidden constraints `dG/dt = G_t + G_x M^-1 F` at the midpoint of the part,
    /// where `system` was evaluated last.
    fn find_hidden_in_middle(&mut self, on: &mut OnFace<'_, '_>) {
        let OnFace { system, consistent, .. } = on;
        let n = system.states;
        self.hidden.clone_from(&self.middle.drift);
        let rates = match consistent.as_ref().and_then(|consistent| consistent.inverse_mass()) {
            Some(InverseMass::Identity) => DVector::from_column_slice(&self.middle.values[..n]),
            Some(InverseMass::Entries(inverse)) => inverse * DVector::from_column_slice(&self.middle.values[..n]),
            None => DVector::from_element(n, f64::INFINITY),
        };
        for k in 0..self.hidden.len() {
            let along = system.slope(k, |j| if j < n { rates[j] } else { 0.0 });
            self.hidden[k] = (self.hidden[k] + along).abs();
        }
    }

    /// Bounds the magnitude of the hidden constraint `dG/dt = G_t + G_x M^-1 F` over the box of the unknowns, for each
    /// free variable.
    fn find_hidden(&mut self, on: &OnFace<'_, '_>) {
        let OnFace { system, consistent, .. } = on;
        let n = system.states;
        self.rates.clear();
        match consistent.as_ref().and_then(|consistent| consistent.inverse_mass()) {
            Some(InverseMass::Identity) => self.rates.extend_from_slice(&self.values[..n]),
            Some(InverseMass::Entries(inverse)) => self.rates.extend(inverse.row_iter().map(|row| {
                let terms = row.iter().zip(&self.values).filter(|(entry, _)| **entry != 0.0);
                terms.fold(Interval::point(0.0), |sum, (&entry, &value)| sum + Interval::point(entry) * value)
            })),
            None => self.rates.resize(n, Interval::LINE),
        }
        self.hidden.clear();
        self.hidden.resize(system.unknowns - n, 0.0);
        for k in (0..system.unknowns - n).filter(|&k| system.face.places[k] == Activity::Inactive) {
            let along = system
                .places_of_row(n + k)
                .filter(|&(_, j)| j < n)
                .map(|(at, j)| self.rows.jacobian[at] * self.rates[j]);
            self.hidden[k] = along.fold(self.rows.by_time[k], |sum, term| sum + term).size();
        }
    }

    /// Returns the lower bound of a monitor (event function) over the box of the unknowns; NaN if the monitor is not
    /// defined on the whole box.
    fn lower_end(&self, system: &System<'_>, monitor: &Watched) -> f64 {
        let (n, k) = (system.states, monitor.variable);
        let value = match monitor.place {
            Activity::AtLower => self.values[n + k],
            Activity::AtUpper => -self.values[n + k],
            _ if monitor.upper => monitor.bound(system, &self.values) - self.ranges[n + k],
            _ => self.ranges[n + k] - monitor.bound(system, &self.values),
        };
        if value.defined { value.lo } else { f64::NAN }
    }

    /// Returns the effect of the errors of the unknowns on a monitor (event function) over the box.
    fn error_of(&self, system: &System<'_>, monitor: &Watched) -> f64 {
        let (n, k) = (system.states, monitor.variable);
        match monitor.place {
            Activity::Inactive => self.errors[n + k],
            _ => system.terms(k, |j| [self.errors[j]])[0],
        }
    }

    /// Returns the range of the slope of one row of `G` over a part of a step, with the part as the unit of time.
    fn slope_of_row(&self, system: &System<'_>, part: &Part, h: f64, row: usize) -> Interval {
        let explicit = self.rows.by_time[row - system.states] * Interval::point(h);
        let along = system.places_of_row(row).map(|(at, j)| self.rows.jacobian[at] * part.rate(j));
        along.fold(explicit, |sum, term| sum + term)
    }
}
