//! Event times and their derivatives.

use super::linearised::{Columns, Linearised};
use super::{Directions, NoDerivative};
use crate::locate::{Ending, ModeEquations, Status};
use nalgebra::{DMatrix, RowDVector};
use problem::{EventKind, MechanicalStructure};

/// A monitor (event function) crosses zero if its rate exceeds this fraction of the terms of the rate, which is
/// rounding: grazing within the tolerances is detected by the run itself.
const TRANSVERSAL: f64 = 1e-13;

/// Derivatives of the states below this fraction of the largest derivatives so far are rounding errors.
const CANCELLED: f64 = 1e-9;

/// Smallest relative difference between successive flight times that counts as a decrease: flights that do not get
/// shorter have no limit.
const SHORTER: f64 = 1e-6;

/// The time of an event with its derivatives with respect to the directions.
#[derive(Clone, Debug, PartialEq)]
pub struct EventSlope {
    /// The time of the event.
    pub t: f64,
    /// The kind of event whose time is differentiated.
    pub kind: TimedEvent,
    /// The index of the contact at which the event occurs.
    pub contact: usize,
    /// The derivatives of the event time, one per direction.
    pub slopes: Vec<f64>,
    /// The transversality: the rate at which the monitor of the event crosses zero, in absolute value.
    pub transversality: f64,
}

/// An event whose time has derivatives with respect to the directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimedEvent {
    /// A contact event: impact, lift-off, stick or slip.
    Contact(EventKind),
    /// The limit of accumulating impacts of a contact.
    Accumulation,
}

/// A monitor (event function) at the event that it indicates: its rate of change along the motion, and its derivatives
/// at a fixed time.
pub(super) struct Crossed {
    pub rate: f64,
    /// The sum of the absolute values of the terms of the rate of the monitor.
    pub terms: f64,
    /// The derivatives of the monitor at a fixed time, one per direction.
    pub slopes: RowDVector<f64>,
    /// For each derivative, the sum of the absolute values of its terms.
    pub sizes: RowDVector<f64>,
}

impl Crossed {
    /// Evaluates the monitor (event function) of the event `ending` at a state with velocities and accelerations
    /// `rates`; `now` are the derivatives of the states, and `largest` the largest derivatives so far along the run.
    pub fn at(
        ending: Ending,
        equations: &ModeEquations,
        linearised: &Linearised,
        directions: &Directions,
        (rates, now, largest): (&[f64], &DMatrix<f64>, &DMatrix<f64>),
    ) -> Self {
        let structure = equations.shape();
        let columns = Columns { coordinates: structure.coordinates, directions: directions.count() };
        let mut gradient = RowDVector::zeros(columns.all());
        match ending {
            Ending::Impact(k) => gradient += linearised.values.row(structure.joints + k),
            Ending::Detachment(k) => gradient += linearised.lambda.row(structure.normal(k)),
            Ending::StickToSlip(k, _) => {
                let normal = structure.normal(k);
                gradient += linearised.lambda.row(normal) * structure.contacts[k].mu;
                for p in 0..columns.directions {
                    gradient[columns.direction(p)] += directions.mu[(k, p)] * equations.lambda[normal];
                }
                let friction = equations.friction(k);
                for row in structure.tangents(k) {
                    gradient -= linearised.lambda.row(row) * (equations.lambda[row] / friction);
                }
            }
            Ending::SlipToStick(k) => {
                if let Status::Slip(d) = equations.mode()[k] {
                    for (row, d) in structure.tangents(k).zip(d.iter()) {
                        gradient += linearised.velocity.row(row) * *d;
                    }
                }
            }
        }
        let time = gradient[columns.time()];
        let own = gradient.columns(2 * columns.coordinates, columns.directions);
        let by_state = gradient.columns(0, 2 * columns.coordinates);
        let terms = by_state.iter().zip(rates).map(|(by, rate)| (by * rate).abs()).sum::<f64>() + time.abs();
        // Where terms of the monitor's derivatives cancel, rounding errors of the size of the largest derivatives so
        // far remain.
        let sizes = by_state.abs() * (now.abs() + largest * CANCELLED) + own.abs();
        Self {
            rate: by_state.iter().zip(rates).map(|(by, rate)| by * rate).sum::<f64>() + time,
            terms,
            slopes: by_state * now + own,
            sizes,
        }
    }

    /// Extrapolates the rate and the derivatives of the monitor (event function) to a time `ahead` of the present one,
    /// given the rates of change of its rate and of its derivatives.
    pub fn move_to(&mut self, ahead: f64, of_rate: f64, of_slopes: &RowDVector<f64>) {
        self.rate += ahead * of_rate;
        self.slopes += of_slopes * ahead;
    }

    /// Returns the derivatives of the time at which the monitor (event function) crosses zero.
    pub fn times(&self) -> Result<RowDVector<f64>, NoDerivative> {
        let times = &self.slopes * (-1.0 / self.rate);
        let is_crossed = self.rate.abs() > TRANSVERSAL * self.terms && times.iter().all(|time| time.is_finite());
        if is_crossed { Ok(times) } else { Err(NoDerivative::Grazing) }
    }

    /// Whether the monitor (event function) remains zero to first order if the event time changes by `times`, one
    /// change per direction.
    pub fn agrees(&self, times: &RowDVector<f64>, tolerance: f64) -> bool {
        (0..times.len()).all(|p| {
            let moved = self.rate * times[p];
            (self.slopes[p] + moved).abs() <= tolerance * (self.sizes[p] + moved.abs() + self.terms * times[p].abs())
        })
    }
}

/// Returns the kind of contact event (impact, lift-off, slip or stick) that belongs to the end of a contact mode.
pub(super) fn kind(ending: Ending) -> EventKind {
    match ending {
        Ending::Impact(_) => EventKind::Impact,
        Ending::Detachment(_) => EventKind::LiftOff,
        Ending::StickToSlip(..) => EventKind::Slip,
        Ending::SlipToStick(_) => EventKind::Stick,
    }
}

/// Returns the contact of the event that ends a contact mode.
pub(super) fn contact(ending: Ending) -> usize {
    match ending {
        Ending::Impact(k) | Ending::Detachment(k) | Ending::StickToSlip(k, _) | Ending::SlipToStick(k) => k,
    }
}

/// Returns the event that takes contact `k` from one status to another; `None` if no monitor indicates such an event.
pub(super) fn between(structure: &MechanicalStructure, k: usize, from: Status, to: Status) -> Option<Ending> {
    match (from, to) {
        (Status::Open, Status::Open)
        | (Status::Frictionless, Status::Frictionless)
        | (Status::Stick, Status::Stick) => None,
        (Status::Open, _) => Some(Ending::Impact(k)),
        (_, Status::Open) => Some(Ending::Detachment(k)),
        (Status::Stick, Status::Slip(direction)) => Some(Ending::StickToSlip(k, direction)),
        (Status::Slip(_), Status::Stick) => Some(Ending::SlipToStick(k)),
        (Status::Slip(before), Status::Slip(after)) => {
            (structure.contacts[k].slips < 2 && before.dot(&after) < 0.0).then_some(Ending::SlipToStick(k))
        }
        (Status::Frictionless, _) | (_, Status::Frictionless) => None,
    }
}

/// The last three impacts of a contact, with the derivatives of their times.
#[derive(Clone, Debug, Default)]
pub(super) struct Flights {
    last: Vec<(f64, RowDVector<f64>)>,
}

impl Flights {
    /// Records the time of an impact of a contact with its derivatives.
    pub fn note(&mut self, t: f64, times: &RowDVector<f64>) {
        if self.last.len() == 3 {
            self.last.remove(0);
        }
        self.last.push((t, times.clone()));
    }

    /// Returns the time of the limit of accumulating impacts, and its derivatives: the time of the last impact plus the
    /// geometric series `T rho/(1 - rho)` of flights, each `rho` times as long as the one before.
    pub fn limit(&self) -> Option<(f64, RowDVector<f64>)> {
        let [(t0, s0), (t1, s1), (t2, s2)] = self.last.as_slice() else { return None };
        let (first, last) = (t1 - t0, t2 - t1);
        let (of_first, of_last) = (s1 - s0, s2 - s1);
        let rho = last / first;
        let left = 1.0 - rho;
        if !(left > SHORTER && rho > 0.0) {
            return None;
        }
        let slope = (&of_last / left + (&of_last - of_first * rho) / (left * left)) * rho;
        Some((t2 + last * rho / left, s2 + slope))
    }
}
