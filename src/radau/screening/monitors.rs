//! Lower ends of the monitors over a part of a step.
//!
//! `G` and the bounds in interval arithmetic over the box of the unknowns hold every value of a monitor `m`; where that is
//! too wide, so does
//!
//! ```text
//! m(middle) + m' [-1/2, 1/2],    m' = G_t dt/du + sum_j G_yj dy_j/du    over the part, u in [0, 1],
//! ```
//!
//! or the value at one end where `m'` has one sign. The variables inside their intervals are the roots of `G_I = 0` and not
//! their polynomials, from which they differ by `e = |dG_I/dz_I|^-1 |G_I|`, to first order, and so do states that are bound by
//! constraints. Over the box monitors are lowered by what that makes of them; in the other form `m` stands for
//!
//! ```text
//! m - w G_I,    w dG_I/dz_I = dm/dz_I,
//! ```
//!
//! which is the monitor at the roots but for `|dm/dz_I - w dG_I/dz_I| e` over the box: of second order, and nothing where `G`
//! is linear. Monitors of blocks are taken from the box alone.

use super::MOST_PARTS;
use super::part::Part;
use crate::consistent::{Consistent, InverseMass};
use crate::constraints::Constraints;
use crate::face::Place;
use crate::inside::Inside;
use crate::newton_control::NewtonControl;
use crate::system::System;
use nalgebra::DVector;
use numerics::Interval;
use problem::{MonitorRange, Side};

/// A quantity that must not become negative on the face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watched {
    pub variable: usize,
    place: Place,
    /// Of a variable inside: whether the upper bound is meant.
    upper: bool,
    /// What counts as zero.
    limit: f64,
}

impl Watched {
    /// The monitor where `G` and `z` are these, and the bounds of the variable.
    fn of(&self, g: f64, z: f64, lower: f64, upper: f64) -> f64 {
        match self.place {
            Place::Lower => g,
            Place::Upper => -g,
            _ if self.upper => upper - z,
            _ => z - lower,
        }
    }

    /// The sign with which `G`, or `z` where the variable is inside, enters it.
    fn sign(&self) -> f64 {
        let is_negative = self.place == Place::Upper || self.place == Place::Inside && self.upper;
        if is_negative { -1.0 } else { 1.0 }
    }

    /// Its derivatives by the variables, from those of `G` as they are.
    fn by_variables(&self, system: &System<'_>) -> Vec<f64> {
        let n = system.states;
        let mut slopes = vec![0.0; system.unknowns - n];
        if self.place == Place::Inside {
            slopes[self.variable] = self.sign();
        } else {
            let of_variables = system.entries_of_variable(self.variable).filter(|(j, _)| *j >= n);
            of_variables.for_each(|(j, value)| slopes[j - n] += self.sign() * value);
        }
        slopes
    }
}

/// The equations of a face, with what brings the unknowns from their polynomials onto them.
pub(super) struct OnFace<'a, 'p> {
    pub system: &'a mut System<'p>,
    pub control: &'a NewtonControl,
    pub inside: &'a mut Inside,
    pub constraints: &'a mut Constraints,
    pub consistent: Option<&'a mut Consistent>,
}

/// Room for the enclosures over one part.
#[derive(Debug, Default)]
pub(super) struct Enclosure {
    ranges: Vec<Interval>,
    values: Vec<Interval>,
    jacobian: Vec<Interval>,
    by_time: Vec<Interval>,
    /// The unknowns in the middle.
    middle: Vec<f64>,
    /// How large the rows of `Phi` are that are no rates.
    residuals: Vec<f64>,
    /// How far the unknowns are from their polynomials.
    errors: Vec<f64>,
    /// How large `dG/dt` is of the variables inside.
    hidden: Vec<f64>,
    /// `M^-1 F` over the box.
    rates: Vec<Interval>,
    /// `z` and `G` of one block, and its monitors.
    members: [Vec<Interval>; 2],
    of_block: Vec<MonitorRange>,
    /// The monitors that the box does not prove.
    left: Vec<Watched>,
    /// Whether no number of parts that is worth its while would prove them.
    is_hopeless: bool,
}

/// A monitor without what the equations of the variables inside tell: `m - w G_I`.
#[derive(Debug)]
struct Reduced {
    /// `w`, by variable.
    weights: Vec<(usize, f64)>,
    /// Its derivatives by the unknowns over the box.
    gradient: Vec<(usize, Interval)>,
    /// That by time.
    by_time: Interval,
}

impl Reduced {
    /// Its value where the monitor is `value`, and what rounding leaves uncertain of it, at a point at which `system` was
    /// evaluated last.
    fn value(&self, system: &System<'_>, value: f64, y: &[f64]) -> (f64, f64) {
        let n = system.states;
        let mut of = (value, 0.0);
        for &(l, weight) in &self.weights {
            of.0 -= weight * system.values[n + l];
            of.1 += f64::EPSILON * weight.abs() * system.terms(l, |j| [y[j].abs()])[0];
        }
        of
    }

    /// What errors of the unknowns make of it.
    fn error(&self, errors: &[f64]) -> f64 {
        self.gradient.iter().filter(|(j, _)| errors[*j] != 0.0).map(|&(j, slope)| size(slope) * errors[j]).sum()
    }

    /// Its slope over a part that takes `h`, in units of the part.
    fn slope(&self, part: &Part, h: f64) -> Interval {
        let slope = part.rate_of_sum(&self.gradient) + self.by_time * Interval::point(h);
        if slope.defined { slope } else { Interval::LINE }
    }
}

/// Below this part of its terms a derivative is what rounding leaves of zero.
const TOLD: f64 = 1e-10;
/// By how much errors to first order may be short of what they are.
const CURVATURE: f64 = 2.0;

/// What is known of the monitors over a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    Proven,
    /// Not proven; whether one may be negative in the middle.
    Unproven {
        may_fail: bool,
    },
    /// No number of parts that is worth its while would prove a monitor.
    Hopeless,
    /// The problem has no enclosure.
    Unknown,
}

/// The monitors of the face, but for those of blocks, into `out`; each may fall to `-limit`, which is what `limits` say of
/// a variable and of its `G`.
pub(super) fn watch(system: &System<'_>, limits: impl Fn(usize) -> [f64; 2], out: &mut Vec<Watched>) {
    out.clear();
    for &k in &system.intervals {
        let place = system.face.places[k];
        let watched = |upper: bool, limit: f64| Watched { variable: k, place, upper, limit };
        match place {
            Place::Lower | Place::Upper => out.push(watched(false, limits(k)[1])),
            Place::Inside => {
                let ends = [(false, system.set.lower[k]), (true, system.set.upper[k])];
                let finite = ends.into_iter().filter(|(_, end)| end.is_finite());
                out.extend(finite.map(|(upper, _)| watched(upper, limits(k)[0])));
            }
            Place::Held | Place::Boundary(_) | Place::Vertex => {}
        }
    }
}

impl Enclosure {
    /// Whether no monitor falls below its limit over a part that begins at `t` and takes `h`; `limits` are those of blocks.
    pub fn prove(
        &mut self,
        on: &mut OnFace<'_, '_>,
        part: &Part,
        (t, h): (f64, f64),
        watched: &[Watched],
        limits: &[[f64; 2]],
    ) -> Found {
        let times = Interval::new(t.next_down(), (t + h).next_up());
        let are_told = on.inside.tells_all(on.system);
        let system = &mut *on.system;
        self.ranges.resize(system.unknowns, Interval::LINE);
        self.values.resize(system.values.len(), Interval::LINE);
        part.ranges(&mut self.ranges);
        if !system.problem().enclose(times, &self.ranges, &mut self.values) {
            return Found::Unknown;
        }
        self.residuals.clear();
        self.residuals.extend(self.values[..system.unknowns].iter().copied().map(size));
        self.middle.resize(system.unknowns, 0.0);
        part.values(0.5, &mut self.middle);
        self.find_errors(on, false);
        let system = &*on.system;
        let are_blocks_proven = self.are_blocks_proven(system, limits);
        let mut left = std::mem::take(&mut self.left);
        left.clear();
        left.extend(watched.iter().copied().filter(|monitor| {
            let lower = self.lower_end(system, monitor) - self.error_of(system, monitor);
            // Variables that only hidden constraints tell are known with the slopes.
            !are_told || lower < 0.0 || lower.is_nan()
        }));
        self.is_hopeless = false;
        let may_fail = !left.is_empty() && self.may_fail(on, part, (t, h), times, &mut left);
        let found = match are_blocks_proven && left.is_empty() {
            true => Found::Proven,
            false if self.is_hopeless => Found::Hopeless,
            false => Found::Unproven { may_fail: may_fail || !are_blocks_proven },
        };
        self.left = left;
        found
    }

    /// Takes out of `left` the monitors that their slopes prove; whether one that stays may be negative in the middle.
    fn may_fail(
        &mut self,
        on: &mut OnFace<'_, '_>,
        part: &Part,
        (t, h): (f64, f64),
        times: Interval,
        left: &mut Vec<Watched>,
    ) -> bool {
        let are_told = on.inside.tells_all(on.system);
        let (n, system) = (on.system.states, &mut *on.system);
        self.jacobian.resize(system.derivatives.len(), Interval::LINE);
        self.by_time.resize(system.unknowns - n, Interval::LINE);
        if !system.problem().enclose_derivatives(times, &self.ranges, &mut self.jacobian, &mut self.by_time) {
            return true;
        }
        if !system.evaluate(t + 0.5 * h, &self.middle) {
            return true;
        }
        // The equations of the variables inside in the same form: their values over the box are too wide for long steps.
        let equations = (0..system.unknowns - n).filter(|&k| system.face.places[k] == Place::Inside);
        for k in equations.filter(|&k| system.set.block_of(k).is_none()) {
            let slope = size(self.slope_of_row(system, part, h, n + k));
            let sharper = system.values[n + k].abs() + 0.5 * slope + on.control.noise_of_g(system, k, &self.middle);
            self.residuals[n + k] = self.residuals[n + k].min(sharper);
        }
        let forms: Vec<Reduced> = left.iter().map(|monitor| self.reduced(system, on.inside, monitor)).collect();
        let at_middle = |(monitor, form): (&Watched, &Reduced)| {
            form.value(system, value(system, monitor, &self.middle), &self.middle)
        };
        let middles: Vec<(f64, f64)> = left.iter().zip(&forms).map(at_middle).collect();
        // What is wrong in the middle itself says whether a monitor may be negative there.
        let over_part = std::mem::replace(
            &mut self.residuals,
            system.values[..system.unknowns].iter().map(|value| value.abs()).collect(),
        );
        if !are_told {
            self.find_hidden_in_middle(on, t + 0.5 * h);
        }
        self.find_errors(on, !are_told);
        let is_suspect = |(form, (middle, _)): (&Reduced, &(f64, f64))| {
            let error = form.error(&self.errors);
            *middle < CURVATURE * error || middle.is_nan() || error.is_nan()
        };
        let is_suspect: Vec<bool> = forms.iter().zip(&middles).map(is_suspect).collect();
        self.residuals = over_part;
        if !are_told {
            self.find_hidden(on);
        }
        self.find_errors(on, !are_told);
        let system = &mut *on.system;
        let mut ends = [None, None];
        let (mut index, mut may_fail) = (0, false);
        left.retain(|monitor| {
            let (form, (middle, rounding), suspect) = (&forms[index], middles[index], is_suspect[index]);
            index += 1;
            let (slope, error) = (form.slope(part, h), form.error(&self.errors));
            let allowed = error + rounding - monitor.limit;
            let mut is_proven = middle - 0.5 * size(slope) >= allowed;
            // Where the slope has one sign the least value is at an end.
            let end = if slope.lo >= 0.0 { 0 } else { 1 };
            if !is_proven && middle >= allowed && (slope.lo >= 0.0 || slope.hi <= 0.0) {
                let values = ends[end].get_or_insert_with(|| {
                    let mut y = vec![0.0; system.unknowns];
                    part.values(end as f64, &mut y);
                    let is_finite = system.evaluate(t + end as f64 * h, &y);
                    is_finite.then(|| (y, system.values.clone(), system.set.lower.clone(), system.set.upper.clone()))
                });
                if let Some((y, values, lower, upper)) = values {
                    let k = monitor.variable;
                    let row = system.states + k;
                    let value = monitor.of(values[row], y[row], lower[k], upper[k]);
                    let of_equations: f64 = form.weights.iter().map(|(l, w)| w * values[system.states + l]).sum();
                    is_proven = value - of_equations >= allowed;
                }
            }
            may_fail |= !is_proven && suspect;
            // The residual of a hidden constraint over a box shrinks with the box and no faster.
            self.is_hopeless |=
                !are_told && part.length == 1.0 && error > MOST_PARTS as f64 * (middle + monitor.limit).abs();
            !is_proven
        });
        may_fail
    }

    /// Whether no variable that hidden constraints alone tell enters a monitor, but for rounding, by the derivatives as they are.
    pub fn is_told(system: &System<'_>, inside: &mut Inside, monitor: &Watched) -> bool {
        let n = system.states;
        let mut own = monitor.by_variables(system);
        let mut weights = Vec::new();
        inside.weights(system, |l| own[l], &mut weights);
        let mut terms: Vec<f64> = own.iter().map(|x| x.abs()).collect();
        for (l, weight) in weights {
            for (j, x) in system.entries_of_variable(l).filter(|(j, _)| *j >= n) {
                own[j - n] -= weight * x;
                terms[j - n] += (weight * x).abs();
            }
        }
        (0..own.len()).all(|l| system.face.places[l] != Place::Inside || own[l].abs() <= TOLD * terms[l])
    }

    /// A monitor without what the equations of the variables inside tell, with the derivatives over the box; of a variable
    /// inside whose bound moves they are not known.
    fn reduced(&self, system: &System<'_>, inside: &mut Inside, monitor: &Watched) -> Reduced {
        let (n, k) = (system.states, monitor.variable);
        let own = monitor.by_variables(system);
        let mut gradient = vec![Interval::point(0.0); system.unknowns];
        let mut by_time = Interval::point(0.0);
        if monitor.place == Place::Inside {
            gradient[n + k] = Interval::point(own[k]);
            if system.moves(k) {
                by_time = Interval::LINE;
            }
        } else {
            self.add_row(system, k, monitor.sign(), &mut gradient, &mut by_time);
        }
        let mut weights = Vec::new();
        inside.weights(system, |l| own[l], &mut weights);
        for &(l, weight) in &weights {
            self.add_row(system, l, -weight, &mut gradient, &mut by_time);
        }
        let gradient = gradient.into_iter().enumerate().filter(|(_, slope)| *slope != Interval::point(0.0)).collect();
        Reduced { weights, gradient, by_time }
    }

    /// Adds `factor` times the derivatives of `G` of variable `k` over the box.
    fn add_row(&self, system: &System<'_>, k: usize, factor: f64, gradient: &mut [Interval], by_time: &mut Interval) {
        let factor = Interval::point(factor);
        for (at, j) in system.places_of_row(system.states + k) {
            gradient[j] = gradient[j] + factor * self.jacobian[at];
        }
        *by_time = *by_time + factor * self.by_time[k];
    }

    /// How far the unknowns may be from their polynomials, by the residuals of the equations of the face, and those of hidden
    /// constraints.
    fn find_errors(&mut self, on: &mut OnFace<'_, '_>, with_hidden: bool) {
        let OnFace { system, control, inside, constraints, consistent } = on;
        let n = system.states;
        inside.errors(system, &self.residuals[n..], &mut self.errors);
        if with_hidden && let Some(consistent) = consistent {
            consistent.find_errors(system, &self.residuals[n..], &self.hidden, &mut self.errors);
        }
        self.errors.splice(0..0, std::iter::repeat_n(0.0, n));
        for k in (0..system.unknowns - n).filter(|&k| system.face.places[k] != Place::Inside) {
            self.residuals[n + k] = 0.0;
        }
        constraints.add_errors(system, control, &self.middle, &self.residuals, &mut self.errors);
    }

    /// The rows of variables inside of `dG/dt = G_t + G_x M^-1 F` in the middle of the part, where `system` was evaluated last.
    fn find_hidden_in_middle(&mut self, on: &mut OnFace<'_, '_>, t: f64) {
        let OnFace { system, consistent, .. } = on;
        let n = system.states;
        self.hidden.clear();
        self.hidden.resize(system.unknowns - n, 0.0);
        system.time_derivative(t, &self.middle, &mut self.hidden);
        let rates = match consistent.as_ref().and_then(|consistent| consistent.inverse_mass()) {
            Some(InverseMass::Identity) => DVector::from_column_slice(&system.values[..n]),
            Some(InverseMass::Entries(inverse)) => inverse * DVector::from_column_slice(&system.values[..n]),
            None => DVector::from_element(n, f64::INFINITY),
        };
        for k in 0..self.hidden.len() {
            let along = system.slope(k, |j| if j < n { rates[j] } else { 0.0 });
            self.hidden[k] = (self.hidden[k] + along).abs();
        }
    }

    /// How large `dG/dt = G_t + G_x M^-1 F` is over the box of each variable inside.
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
        for k in (0..system.unknowns - n).filter(|&k| system.face.places[k] == Place::Inside) {
            let along =
                system.places_of_row(n + k).filter(|&(_, j)| j < n).map(|(at, j)| self.jacobian[at] * self.rates[j]);
            self.hidden[k] = size(along.fold(self.by_time[k], |sum, term| sum + term));
        }
    }

    /// Whether no monitor of a block falls below its limit over the box.
    fn are_blocks_proven(&mut self, system: &System<'_>, limits: &[[f64; 2]]) -> bool {
        let n = system.states;
        system.set.blocks().iter().zip(&system.face.blocks).enumerate().all(|(b, (block, face))| {
            if system.face.holds(&block.members) {
                return true;
            }
            let [z, g] = &mut self.members;
            z.clear();
            z.extend(block.members.iter().map(|&k| self.ranges[n + k]));
            g.clear();
            g.extend(block.members.iter().map(|&k| self.values[n + k]));
            block.shape.enclose_monitors(face, z, g, system.radius(b, &self.values), &mut self.of_block);
            let [of_z, of_g] = limits[b];
            self.of_block.iter().all(|monitor| match monitor {
                MonitorRange::Distance(range) => range.defined && range.lo + of_z >= 0.0,
                MonitorRange::Multiplier(range) => range.defined && range.lo + of_g >= 0.0,
            })
        })
    }

    /// The lower end of a monitor over the box with its limit added; NaN where it is not defined all over it.
    fn lower_end(&self, system: &System<'_>, monitor: &Watched) -> f64 {
        let (n, k) = (system.states, monitor.variable);
        let value = match monitor.place {
            Place::Lower => self.values[n + k],
            Place::Upper => -self.values[n + k],
            _ if monitor.upper => system.bound(k, Side::Upper, &self.values) - self.ranges[n + k],
            _ => self.ranges[n + k] - system.bound(k, Side::Lower, &self.values),
        };
        if value.defined { value.lo + monitor.limit } else { f64::NAN }
    }

    /// What the errors of the unknowns make of a monitor over the box.
    fn error_of(&self, system: &System<'_>, monitor: &Watched) -> f64 {
        let (n, k) = (system.states, monitor.variable);
        match monitor.place {
            Place::Inside => self.errors[n + k],
            _ => system.terms(k, |j| [self.errors[j]])[0],
        }
    }

    /// The slope of `G` in one row over the part.
    fn slope_of_row(&self, system: &System<'_>, part: &Part, h: f64, row: usize) -> Interval {
        let explicit = self.by_time[row - system.states] * Interval::point(h);
        let along = system.places_of_row(row).map(|(at, j)| self.jacobian[at] * part.rate(j));
        along.fold(explicit, |sum, term| sum + term)
    }
}

/// The largest size of a value in the interval; infinite where it is not defined all over the box.
fn size(interval: Interval) -> f64 {
    if interval.defined { interval.magnitudes().1 } else { f64::INFINITY }
}

/// A monitor at a point at which `system` was evaluated last.
fn value(system: &System<'_>, monitor: &Watched, y: &[f64]) -> f64 {
    let (row, k) = (system.states + monitor.variable, monitor.variable);
    monitor.of(system.values[row], y[row], system.set.lower[k], system.set.upper[k])
}
