//! The sides of a grid, and the faces of elements on them.

use super::Grid;

/// A side of a rectangular domain, normal to an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Side {
    /// The direction of the side's normal: 0, 1 or 2 for `x`, `y` or `z`.
    pub direction: usize,
    /// Whether the side is at the upper end of the axis to which it is normal.
    pub is_upper: bool,
}

/// A face of a finite element on a side of the domain.
#[derive(Clone, Debug, PartialEq)]
pub struct Face {
    /// The `2^(d-1)` nodes of the element face, in `d` dimensions.
    pub nodes: Vec<usize>,
    /// The coordinates of the centre of the element face.
    pub centre: [f64; 3],
}

impl Side {
    /// Returns all sides of a domain of the given dimension, in the order of [`Side::place`].
    pub fn all(dimension: usize) -> impl Iterator<Item = Self> {
        (0..dimension).flat_map(|direction| [false, true].map(|is_upper| Self { direction, is_upper }))
    }

    /// Returns the name of the side in a specification: `x_min`, `x_max`, `y_min`, ...
    pub fn name(self) -> &'static str {
        ["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"][self.place()]
    }

    /// Returns the index of the side in [`Side::all`].
    pub fn place(self) -> usize {
        2 * self.direction + usize::from(self.is_upper)
    }
}

impl Grid {
    /// Returns the nodes on a side of the grid, in increasing order.
    pub fn nodes_on(&self, side: Side) -> impl Iterator<Item = usize> + '_ {
        let axis = &self.axes()[side.direction];
        let at = if side.is_upper { axis.nodes() - 1 } else { 0 };
        let stride: usize = self.axes()[..side.direction].iter().map(|axis| axis.nodes()).product();
        let block = stride * axis.nodes();
        (0..self.nodes() / block).flat_map(move |outer| {
            let first = outer * block + at * stride;
            first..first + stride
        })
    }

    /// Returns the faces of elements on a side of the grid; they cover the side.
    pub fn faces_on(&self, side: Side) -> impl Iterator<Item = Face> + '_ {
        let axis = &self.axes()[side.direction];
        let at = if side.is_upper { axis.elements - 1 } else { 0 };
        let stride: usize = self.axes()[..side.direction].iter().map(|axis| axis.elements).product();
        let block = stride * axis.elements;
        (0..self.elements() / block).flat_map(move |outer| {
            let first = outer * block + at * stride;
            (first..first + stride).map(move |element| self.face(element, side))
        })
    }

    /// Returns the area of an element face on a side; one for a one-dimensional grid, where the side is a point.
    pub fn face_area(&self, side: Side) -> f64 {
        let along = self.axes().iter().enumerate().filter(|(direction, _)| *direction != side.direction);
        along.map(|(_, axis)| axis.spacing()).product()
    }

    fn face(&self, element: usize, side: Side) -> Face {
        let Side { direction, is_upper } = side;
        let on_side = |(corner, _): &(usize, usize)| (corner >> direction & 1 == 1) == is_upper;
        let nodes = self.corners(element).enumerate().filter(on_side).map(|(_, node)| node).collect();
        let mut centre = self.centre(element);
        let axis = &self.axes()[direction];
        centre[direction] = if is_upper { axis.upper } else { axis.lower };
        Face { nodes, centre }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finite_elements::Axis;

    #[test]
    fn the_sides_are_where_their_coordinate_is_at_its_end_and_have_their_area() {
        let lengths = [3.0, 2.0, 5.0];
        for dimension in 1..=3 {
            let axes = (0..dimension).map(|k| Axis { lower: 1.0, upper: 1.0 + lengths[k], elements: 2 + k });
            let grid = Grid::new(axes.collect());
            for side in Side::all(dimension) {
                let k = side.direction;
                let end = if side.is_upper { 1.0 + lengths[k] } else { 1.0 };
                let there: Vec<usize> = (0..grid.nodes()).filter(|&i| grid.coordinates(i)[k] == end).collect();
                assert_eq!(grid.nodes_on(side).collect::<Vec<_>>(), there, "{}", side.name());
                let faces: Vec<Face> = grid.faces_on(side).collect();
                assert!(faces.iter().flat_map(|face| &face.nodes).all(|node| there.contains(node)));
                let area: f64 = (0..dimension).filter(|&other| other != k).map(|other| lengths[other]).product();
                assert!((faces.len() as f64 * grid.face_area(side) - area).abs() < 1e-13);
                for face in &faces {
                    let of = |j: usize| face.nodes.iter().map(|&node| grid.coordinates(node)[j]).sum::<f64>();
                    let mean = [0, 1, 2].map(|j| of(j) / face.nodes.len() as f64);
                    assert!((0..3).all(|j| (mean[j] - face.centre[j]).abs() < 1e-14), "{mean:?} {:?}", face.centre);
                }
            }
        }
    }
}
