//! `f` at the nodes: the source at the centre of each element and what flows in through each face of a side, shared out to
//! their nodes; at a time, or enclosed over an interval of time.

use super::semidiscrete::{finite, go_on, side_key};
use super::{Condition, Field, Obstacle, ObstacleError};
use crate::finite_elements::{Element, Quadrature, Side};
use numerics::Interval;
use problem::Control;

/// What an element or a face gives to each of its nodes: `part` times the value of `field` there.
struct Share<'a> {
    field: &'a mut Field,
    /// The side that a face belongs to.
    side: Option<Side>,
    at: [f64; 3],
    part: f64,
    nodes: &'a [usize],
}

/// `f` at time `t`.
///
/// # Errors
/// A value that is not finite; or `control` asks to stop.
pub(super) fn load_at(
    problem: &mut Obstacle,
    load: &mut [f64],
    t: f64,
    control: &Control,
) -> Result<(), ObstacleError> {
    load.fill(0.0);
    each(problem, t, control, |Share { field, side, at, part, nodes }| {
        let value = match side {
            None => finite("source", field, t, at)?,
            Some(side) => finite(&side_key(side, "neumann"), field, t, at)?,
        };
        nodes.iter().for_each(|&node| load[node] += part * value);
        Ok(())
    })
}

/// Intervals that hold `f` at all these times at the nodes that are wanted.
///
/// # Errors
/// If `control` asks to stop.
pub(super) fn load_over(
    problem: &mut Obstacle,
    wanted: &[bool],
    load: &mut [Interval],
    t: Interval,
    control: &Control,
) -> Result<(), ObstacleError> {
    load.fill(Interval::point(0.0));
    each(problem, t.lo, control, |Share { field, at, part, nodes, .. }| {
        if nodes.iter().any(|&node| wanted[node]) {
            let value = Interval::point(part) * field.over(t, &at.map(Interval::point));
            nodes.iter().for_each(|&node| load[node] = load[node] + value);
        }
        Ok(())
    })
}

/// Visits what elements and faces give.
fn each(
    problem: &mut Obstacle,
    t: f64,
    control: &Control,
    mut visit: impl FnMut(Share<'_>) -> Result<(), ObstacleError>,
) -> Result<(), ObstacleError> {
    let Obstacle { grid, source, conditions, .. } = problem;
    if let Some(field) = source {
        let part = Element::of(grid, Quadrature::Nodal).volume() / (1 << grid.dimension()) as f64;
        let mut nodes = Vec::new();
        for element in 0..grid.elements() {
            go_on(element, t, control)?;
            nodes.clear();
            nodes.extend(grid.corners(element));
            visit(Share { field, side: None, at: grid.centre(element), part, nodes: &nodes })?;
        }
    }
    for (side, condition) in Side::all(grid.dimension()).zip(conditions) {
        let Condition::Neumann(field) = condition else { continue };
        if field.constant() == Some(0.0) {
            continue;
        }
        let area = grid.face_area(side);
        for face in grid.faces_on(side) {
            let part = area / face.nodes.len() as f64;
            visit(Share { field, side: Some(side), at: face.centre, part, nodes: &face.nodes })?;
        }
    }
    Ok(())
}
