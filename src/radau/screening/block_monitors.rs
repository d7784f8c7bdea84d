//! Lower ends of the monitors of blocks over a part of a step: from the box of the unknowns, with their errors; where hidden
//! constraints tell the variables, from enclosures of these at the roots of their equations (see [`Reduced`]).

use super::on_face::{OnFace, Told};
use super::part::Part;
use super::point::Point;
use super::reduced::{Reduced, Rows};
use super::watched::Watched;
use crate::face::{ActiveFace, Place};
use crate::system::System;
use numerics::Interval;
use problem::{Face, MonitorRange};

/// Room for the monitors of blocks.
#[derive(Debug, Default)]
pub(super) struct BlockMonitors {
    /// `z` and `G` of one block, and its monitors.
    z: Vec<Interval>,
    g: Vec<Interval>,
    monitors: Vec<MonitorRange>,
    /// `z` and `G` of each variable, reduced.
    forms: Vec<[Reduced; 2]>,
    /// The face that these are of; the Jacobian is constant.
    face: Option<ActiveFace>,
}

impl BlockMonitors {
    /// Whether no monitor falls below its limit where the unknowns and the rows are in these boxes, and the unknowns may be off
    /// by `errors`; of none where it is empty.
    pub fn are_proven_by_box(
        &mut self,
        system: &System<'_>,
        unknowns: &[Interval],
        rows: &[Interval],
        errors: &[f64],
        limits: &[[f64; 2]],
    ) -> bool {
        let n = system.states;
        let error = |j: usize| errors.get(j).copied().unwrap_or(0.0);
        let ball = |error: f64| Interval::new(-error, error);
        self.are_proven(system, rows, limits, |members, _, z, g| {
            z.extend(members.iter().map(|&k| unknowns[n + k] + ball(error(n + k))));
            let of_g = |k: usize| ball(system.terms(k, |j| [error(j)])[0]);
            g.extend(members.iter().map(|&k| rows[n + k] + of_g(k)));
        })
    }

    /// The same where hidden constraints tell the variables inside, by the slopes over a part that takes `h`, and the values in
    /// its middle. No block is on a curved face then.
    pub fn are_proven_by_slopes(
        &mut self,
        on: &mut OnFace<'_, '_>,
        slopes: &Rows,
        middle: &Point,
        rows: &[Interval],
        (part, h): (&Part, f64),
        limits: &[[f64; 2]],
    ) -> bool {
        let told = Told::ByHiddenConstraints;
        let mut forms = std::mem::take(&mut self.forms);
        forms.resize_with(on.system.unknowns - on.system.states, Default::default);
        if self.face.as_ref() != Some(&on.system.face) {
            self.face.get_or_insert_default().clone_from(&on.system.face);
            for (variable, forms) in forms.iter_mut().enumerate() {
                if on.system.set.block_of(variable).is_some() {
                    for (form, place) in forms.iter_mut().zip([Place::Inside, Place::Lower]) {
                        let monitor = Watched { variable, place, upper: false, limit: 0.0 };
                        form.set(on, told, slopes, &middle.y, &monitor);
                    }
                }
            }
        }
        let system = &*on.system;
        let n = system.states;
        let range = |form: &Reduced, value: f64| {
            let (value, rounding) = form.value(system, value, middle);
            let beside = 0.5 * form.slope(slopes, part, h).size() + rounding;
            Interval::new(value - beside, value + beside)
        };
        let are_proven = self.are_proven(system, rows, limits, |members, face, z, g| {
            z.extend(members.iter().map(|&k| match face {
                Face::Vertex => Interval::point(middle.y[n + k]),
                _ => range(&forms[k][0], middle.y[n + k]),
            }));
            g.extend(members.iter().map(|&k| match face {
                Face::Interior => Interval::point(0.0),
                _ => range(&forms[k][1], middle.values[n + k]),
            }));
        });
        self.forms = forms;
        are_proven
    }

    /// Whether no monitor falls below its limit where `members` tells the boxes of `z` and of `G` of a block.
    fn are_proven(
        &mut self,
        system: &System<'_>,
        rows: &[Interval],
        limits: &[[f64; 2]],
        members: impl Fn(&[usize], &Face, &mut Vec<Interval>, &mut Vec<Interval>),
    ) -> bool {
        let Self { z, g, monitors, .. } = self;
        system.set.blocks().iter().zip(&system.face.blocks).enumerate().all(|(b, (block, face))| {
            if system.face.holds(&block.members) {
                return true;
            }
            z.clear();
            g.clear();
            members(&block.members, face, z, g);
            block.shape.enclose_monitors(face, z, g, system.radius(b, rows), monitors);
            let [of_z, of_g] = limits[b];
            monitors.iter().all(|monitor| match monitor {
                MonitorRange::Distance(range) => range.defined && range.lo + of_z >= 0.0,
                MonitorRange::Multiplier(range) => range.defined && range.lo + of_g >= 0.0,
            })
        })
    }
}
