//! Lower bounds of the monitors of blocks over a part of a step: from the box of the unknowns, with their errors, and
//! where the box is too wide from slopes (see [`Reduced`]). On flat faces, where monitors are linear, these are the
//! slopes of the monitors; in the interior of curved sets and at their vertices, the slopes of `z` and `G`. Curved
//! faces have the box alone.

use super::limits::Limits;
use super::on_face::{OnFace, Told};
use super::part::Part;
use super::point::Point;
use super::reduced::{Reduced, Rows};
use super::watched::Combination;
use crate::face::ActiveFace;
use crate::system::System;
use numerics::Interval;
use problem::{Block, Face, FlatMonitor, MonitorRange, Shape};

/// Rounding error of a Euclidean norm, relative to the norm.
const NORM_ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Workspace for the monitors (event functions) of blocks of variables.
#[derive(Debug, Default)]
pub(super) struct BlockMonitors {
    /// Ranges of `z` and of `G` for one block, and of its monitors.
    z: Vec<Interval>,
    g: Vec<Interval>,
    monitors: Vec<MonitorRange>,
    /// The blocks whose monitors are not yet proven to keep their signs by the ranges (box) of the unknowns.
    open: Vec<usize>,
    /// The linear forms of `z` and `G` in the monitors of each block, with their reductions by the equations of the
    /// active face of `K`.
    moving: Vec<Vec<(FlatMonitor, Reduced)>>,
    /// The active face of `K` to which the linear forms of the blocks belong.
    face: Option<ActiveFace>,
    /// Whether the linear forms of the blocks are reduced by the equations of the active face of `K`.
    are_reduced: bool,
}

/// Data of the screening for switches over a part of a step; the part takes the time `h`.
pub(super) struct Over<'a> {
    /// Which equations determine the free variables on the active face.
    pub told: Told,
    pub slopes: &'a Rows,
    /// Values of the unknowns and the rows at the midpoint of the part of the step.
    pub middle: &'a Point,
    /// The ranges of the rows of the problem over the part.
    pub rows: &'a [Interval],
    /// Bounds on the distances of the unknowns from their polynomials over the part.
    pub errors: &'a [f64],
    pub part: &'a Part,
    pub h: f64,
}

impl BlockMonitors {
    /// Marks the monitors of all blocks as not yet proven to keep their signs, except those left out of the proof;
    /// returns whether no block is left to prove.
    pub fn leave_open(&mut self, system: &System<'_>, limits: &Limits) -> bool {
        self.open.clear();
        self.open.extend((0..system.set.blocks().len()).filter(|&b| !limits.is_left_out(b)));
        self.open.is_empty()
    }

    /// Whether no monitor (event function) of a block falls below minus its limit if the unknowns and the rows lie in
    /// the boxes `unknowns` and `rows`, and the unknowns err by `errors` (empty for no errors).
    pub fn are_proven_by_box(
        &mut self,
        system: &System<'_>,
        unknowns: &[Interval],
        rows: &[Interval],
        errors: &[f64],
        limits: &Limits,
    ) -> bool {
        self.take_face(system);
        let n = system.states;
        let error = |j: usize| errors.get(j).copied().unwrap_or(0.0);
        let ball = |error: f64| Interval::new(-error, error);
        self.open.clear();
        for b in 0..system.set.blocks().len() {
            let (block, face) = (&system.set.blocks()[b], &system.face.blocks[b]);
            let Self { z, g, .. } = self;
            z.clear();
            z.extend(block.members.iter().map(|&k| unknowns[n + k] + ball(error(n + k))));
            g.clear();
            let of_g = |k: usize| ball(system.terms(k, |j| [error(j)])[0]);
            g.extend(block.members.iter().map(|&k| rows[n + k] + of_g(k)));
            let [of_z, of_g] = limits.of_block(system, b);
            let is_proven = limits.is_left_out(b)
                || system.face.holds(&block.members)
                || match block.shape.is_flat(face) {
                    true => self.moving[b].iter().all(|(monitor, _)| {
                        let limit = if monitor.of_g.is_empty() { of_z } else { of_g };
                        let range = monitor.range(&self.z, &self.g);
                        range.defined && range.lo + limit >= 0.0
                    }),
                    false => self.is_curved_proven(block, face, system.radius(b, rows), [of_z, of_g]),
                };
            if !is_proven {
                self.open.push(b);
            }
        }
        self.open.is_empty()
    }

    /// Whether the ranges of slopes prove that no monitor falls below minus its limit, among the monitors of those
    /// blocks that are not proven so far.
    pub fn are_proven_by_slopes(&mut self, on: &mut OnFace<'_, '_>, over: &Over<'_>, limits: &Limits) -> bool {
        self.take_face(on.system);
        self.reduce(on, over);
        let system = &*on.system;
        let moving = std::mem::take(&mut self.moving);
        let mut open = std::mem::take(&mut self.open);
        open.retain(|&b| !self.is_proven_by_slopes(system, b, &moving[b], over, limits.of_block(system, b)));
        let are_proven = open.is_empty();
        (self.moving, self.open) = (moving, open);
        are_proven
    }

    fn is_proven_by_slopes(
        &mut self,
        system: &System<'_>,
        b: usize,
        moving: &[(FlatMonitor, Reduced)],
        over: &Over<'_>,
        [of_z, of_g]: [f64; 2],
    ) -> bool {
        let (block, face) = (&system.set.blocks()[b], &system.face.blocks[b]);
        let (n, middle) = (system.states, over.middle);
        if system.face.holds(&block.members) {
            return true;
        }
        let form_of = |(monitor, form): &(FlatMonitor, Reduced)| {
            let sum = |terms: &[(usize, f64)], of: &[f64]| -> f64 {
                terms.iter().map(|&(i, factor)| factor * of[n + block.members[i]]).sum()
            };
            let value = monitor.constant + sum(&monitor.of_z, &middle.y) + sum(&monitor.of_g, &middle.values);
            let (value, rounding) = form.value(system, value, middle);
            let error = if over.told == Told::ByHiddenConstraints { 0.0 } else { form.error(over.errors) };
            Form { value, slope: form.slope(over.slopes, over.part, over.h), error: rounding + error }
        };
        match face {
            _ if block.shape.is_flat(face) => moving.iter().all(|moving| {
                let limit = if moving.0.of_g.is_empty() { of_z } else { of_g };
                form_of(moving).range().lo + limit >= 0.0
            }),
            Face::Boundary(_) | Face::Edge(_) => false,
            Face::Interior | Face::Vertex => {
                // Second-order cones and balls are sets of revolution: only the norm of the members around the axis
                // matters.
                let forms: Vec<Form> = moving.iter().map(form_of).collect();
                let (axis, around) = forms.split_at(usize::from(block.shape == Shape::SecondOrderCone));
                let members = axis.iter().map(Form::range).chain([norm(around)]);
                let Self { z, g, .. } = self;
                z.clear();
                g.clear();
                if *face == Face::Interior {
                    z.extend(members);
                    g.resize(z.len(), Interval::point(0.0));
                } else {
                    g.extend(members);
                    z.resize(g.len(), Interval::point(0.0));
                }
                self.is_curved_proven(block, face, system.radius(b, over.rows), [of_z, of_g])
            }
        }
    }

    /// Updates the linear forms in the monitors of the blocks to the active face of `system`.
    fn take_face(&mut self, system: &System<'_>) {
        if self.face.as_ref() == Some(&system.face) {
            return;
        }
        self.face.get_or_insert_default().clone_from(&system.face);
        let blocks = system.set.blocks().iter().zip(&system.face.blocks);
        let with_room = |monitor: FlatMonitor| (monitor, Reduced::default());
        self.moving = blocks.map(|(block, face)| moving(block, face).into_iter().map(with_room).collect()).collect();
        self.are_reduced = false;
    }

    /// Reduces the linear forms in the monitors of the blocks by the equations of the active face of `K`.
    fn reduce(&mut self, on: &mut OnFace<'_, '_>, over: &Over<'_>) {
        if std::mem::replace(&mut self.are_reduced, true) && on.system.constant_jacobian() {
            return;
        }
        for b in 0..self.moving.len() {
            let members = on.system.set.blocks()[b].members.clone();
            let of = |terms: &[(usize, f64)]| terms.iter().map(|&(i, factor)| (members[i], factor)).collect();
            for (monitor, form) in &mut self.moving[b] {
                let own = Combination { variables: of(&monitor.of_z), rows: of(&monitor.of_g) };
                form.set(on, over.told, over.slopes, &over.middle.y, &own);
            }
        }
    }

    /// Whether no monitor of a block whose monitors are curved (nonlinear) falls below minus its limit if `z` and `G`
    /// lie in the boxes `self.z` and `self.g`.
    fn is_curved_proven(&mut self, block: &Block, face: &Face, radius: Interval, [of_z, of_g]: [f64; 2]) -> bool {
        block.shape.enclose_monitors(face, &self.z, &self.g, radius, &mut self.monitors);
        self.monitors.iter().all(|monitor| match monitor {
            MonitorRange::Distance(range) => range.defined && range.lo + of_z >= 0.0,
            MonitorRange::Multiplier(range) => range.defined && range.lo + of_g >= 0.0,
        })
    }
}

/// Values of a linear form of `z` and `G` over a part of a step.
struct Form {
    /// Value of the linear form at the midpoint of the part of the step.
    value: f64,
    /// Range of the slope of the linear form over the part of the step, with the part as the unit of time.
    slope: Interval,
    /// Bound on the error of the values of the linear form over the part of the step.
    error: f64,
}

impl Form {
    fn range(&self) -> Interval {
        let beside = 0.5 * self.slope.size() + self.error;
        Interval::new(self.value - beside, self.value + beside)
    }
}

/// Returns the range over the part of the Euclidean norm of a vector of linear forms. The norm changes only by the
/// slopes along that vector; they are small where the vector rotates, as a friction force of constant magnitude does.
fn norm(forms: &[Form]) -> Interval {
    let sum = |terms: &mut dyn Iterator<Item = Interval>| terms.fold(Interval::point(0.0), |sum, term| sum + term);
    let by_box = sum(&mut forms.iter().map(|form| form.range().square())).sqrt();
    if by_box.lo <= 0.0 {
        return by_box;
    }
    let value = forms.iter().map(|form| form.value * form.value).sum::<f64>().sqrt();
    let along = sum(&mut forms.iter().map(|form| form.range() * form.slope)) / by_box;
    let errors = forms.iter().map(|form| form.error).sum::<f64>() + NORM_ROUNDING * value;
    let beside = 0.5 * along.size() + errors;
    Interval::new(by_box.lo.max(value - beside), by_box.hi.min(value + beside))
}

/// Returns the linear forms of a block on a face: its monitors if they are linear, otherwise the linear quantities from
/// which the monitors are computed.
fn moving(block: &Block, face: &Face) -> Vec<FlatMonitor> {
    let members = block.members.len();
    let each = |of: fn(usize) -> FlatMonitor| (0..members).map(of).collect();
    match (block.shape.flat_monitors(face, members), face) {
        (Some(monitors), _) => monitors,
        (None, Face::Interior) => each(|i| FlatMonitor { of_z: vec![(i, 1.0)], ..FlatMonitor::default() }),
        (None, Face::Vertex) => each(|i| FlatMonitor { of_g: vec![(i, 1.0)], ..FlatMonitor::default() }),
        (None, _) => Vec::new(),
    }
}
