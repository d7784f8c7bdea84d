//! The nodal load vector `f`: the source at element centres and the inflow through the faces of sides, distributed to
//! their nodes. The load is evaluated at a time, or enclosed over a time interval.

use super::semidiscrete::{finite, go_on, side_key};
use super::{Condition, Field, Obstacle, ObstacleError};
use crate::finite_elements::{Element, Quadrature, Side};
use numerics::Interval;
use problem::Control;

/// The contribution of an element or a boundary face to the load on each of its nodes: `part` times the value of
/// `field` at the position `at`.
struct Share<'a> {
    field: &'a mut Field,
    /// The side of the domain for the contribution of a boundary face; `None` for that of an element.
    side: Option<Side>,
    at: [f64; 3],
    part: f64,
    nodes: &'a [usize],
}

/// Evaluates the load vector `f` at time `t`.
///
/// # Errors
/// If a value is not finite, or if `control` asks to stop.
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

/// Encloses the load vector `f` over a time interval, at the `wanted` nodes.
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

/// Visits the contributions of all elements and boundary faces to the load vector.
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
