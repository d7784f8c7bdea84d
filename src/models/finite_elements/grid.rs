//! A grid of equal elements on an interval, a rectangle or a box. Nodes and elements are numbered with `x` varying
//! fastest.

/// An axis of the grid: the interval `[lower, upper]`, divided into equal elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// The lower end of the interval that the axis divides.
    pub lower: f64,
    /// The upper end of the interval that the axis divides, above `lower`.
    pub upper: f64,
    /// The number of elements along the axis, at least one.
    pub elements: usize,
}

impl Axis {
    /// Returns the length of an element along the axis, the grid spacing.
    pub fn spacing(&self) -> f64 {
        (self.upper - self.lower) / self.elements as f64
    }

    /// Returns the number of nodes along the axis, one more than the number of elements.
    pub fn nodes(&self) -> usize {
        self.elements + 1
    }

    /// Returns the coordinate of node `i` of the axis; the last node is exactly at `upper`.
    pub fn node(&self, i: usize) -> f64 {
        let part = i as f64 / self.elements as f64;
        self.lower * (1.0 - part) + self.upper * part
    }

    fn centre(&self, element: usize) -> f64 {
        let part = (element as f64 + 0.5) / self.elements as f64;
        self.lower * (1.0 - part) + self.upper * part
    }
}

/// A grid of equal elements on the product of one to three axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    axes: Vec<Axis>,
}

impl Grid {
    /// Creates the grid on the product of one to three axes `x`, `y`, `z`.
    pub fn new(axes: Vec<Axis>) -> Self {
        debug_assert!((1..=3).contains(&axes.len()), "{} axes", axes.len());
        Self { axes }
    }

    /// Returns the dimension of the grid's domain, one to three.
    pub fn dimension(&self) -> usize {
        self.axes.len()
    }

    /// Returns the axes of the grid.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Returns the number of nodes of the grid.
    pub fn nodes(&self) -> usize {
        self.axes.iter().map(Axis::nodes).product()
    }

    /// Returns the number of elements of the grid.
    pub fn elements(&self) -> usize {
        self.axes.iter().map(|axis| axis.elements).product()
    }

    /// Returns the number of nodes per direction, slowest direction first: the shape of nodal values as a row-major
    /// array.
    pub fn shape(&self) -> Vec<usize> {
        self.axes.iter().rev().map(Axis::nodes).collect()
    }

    /// Returns the index of a node along each axis; zero in directions beyond the dimension of the grid.
    pub fn indices(&self, node: usize) -> [usize; 3] {
        split(node, self.axes.iter().map(Axis::nodes))
    }

    /// Returns the number of the node with the given index along each axis.
    pub fn node(&self, indices: [usize; 3]) -> usize {
        self.axes.iter().zip(indices).rev().fold(0, |node, (axis, i)| node * axis.nodes() + i)
    }

    /// Returns the coordinates of a node; zero in directions beyond the dimension of the grid.
    pub fn coordinates(&self, node: usize) -> [f64; 3] {
        let indices = self.indices(node);
        self.fill(|direction, axis| axis.node(indices[direction]))
    }

    /// Returns the coordinates of the centre of an element of the grid.
    pub fn centre(&self, element: usize) -> [f64; 3] {
        let indices = split(element, self.axes.iter().map(|axis| axis.elements));
        self.fill(|direction, axis| axis.centre(indices[direction]))
    }

    /// Returns the `2^d` corner nodes of an element; bit `k` of the corner number is 1 at the upper end of direction
    /// `k`.
    pub fn corners(&self, element: usize) -> impl Iterator<Item = usize> + '_ {
        let indices = split(element, self.axes.iter().map(|axis| axis.elements));
        let first = self.node(indices);
        (0..1 << self.dimension()).map(move |corner| first + self.offset(corner))
    }

    /// Returns the nodes of the element that contains a point of the domain, with the values of their shape functions
    /// at the point.
    pub fn interpolation(&self, point: [f64; 3]) -> Vec<(usize, f64)> {
        let (mut indices, mut parts) = ([0; 3], [0.0; 3]);
        for (direction, axis) in self.axes.iter().enumerate() {
            let place = (point[direction] - axis.lower) / axis.spacing();
            indices[direction] = (place.max(0.0) as usize).min(axis.elements - 1);
            parts[direction] = place - indices[direction] as f64;
        }
        let first = self.node(indices);
        let weight = |corner: usize| {
            let ends = (0..self.dimension()).map(|k| if corner >> k & 1 == 1 { parts[k] } else { 1.0 - parts[k] });
            ends.product()
        };
        (0..1 << self.dimension()).map(|corner| (first + self.offset(corner), weight(corner))).collect()
    }

    /// Returns the node number of a corner of an element less that of the first corner of the element.
    fn offset(&self, corner: usize) -> usize {
        self.node([corner & 1, corner >> 1 & 1, corner >> 2 & 1])
    }

    fn fill(&self, value: impl Fn(usize, &Axis) -> f64) -> [f64; 3] {
        let mut point = [0.0; 3];
        for (direction, (slot, axis)) in point.iter_mut().zip(&self.axes).enumerate() {
            *slot = value(direction, axis);
        }
        point
    }
}

/// Returns the digits of a number in a mixed radix, least significant digit first.
fn split(mut number: usize, bases: impl Iterator<Item = usize>) -> [usize; 3] {
    let mut digits = [0; 3];
    for (digit, base) in digits.iter_mut().zip(bases) {
        *digit = number % base;
        number /= base;
    }
    digits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_is_exact_for_products_of_linear_functions() {
        let axis = |lower, elements| Axis { lower, upper: 2.0, elements };
        let grid = Grid::new(vec![axis(-1.0, 3), axis(0.0, 4), axis(1.0, 1)]);
        let u = |[x, y, z]: [f64; 3]| (1.0 + x) * (2.0 - y) * (3.0 * z - 1.0);
        for point in [[-1.0, 0.0, 1.0], [2.0, 2.0, 2.0], [0.3, 1.7, 1.2], [0.0, 0.5, 1.5]] {
            let around = grid.interpolation(point);
            let value: f64 = around.iter().map(|&(node, weight)| weight * u(grid.coordinates(node))).sum();
            assert!((value - u(point)).abs() < 1e-13, "{point:?}: {value}");
        }
    }

    #[test]
    fn corners_enclose_the_centre_of_every_element() {
        let axis = |upper, elements| Axis { lower: -1.0, upper, elements };
        let grid = Grid::new(vec![axis(2.0, 3), axis(1.0, 2), axis(4.0, 5)]);
        assert_eq!((grid.nodes(), grid.elements(), grid.shape()), (72, 30, vec![6, 3, 4]));
        for element in 0..grid.elements() {
            let centre = grid.centre(element);
            for (corner, node) in grid.corners(element).enumerate() {
                assert_eq!(grid.node(grid.indices(node)), node);
                let x = grid.coordinates(node);
                for k in 0..3 {
                    let half = 0.5 * grid.axes()[k].spacing();
                    let expected = if corner >> k & 1 == 1 { half } else { -half };
                    assert!((x[k] - centre[k] - expected).abs() < 1e-14, "{element} {corner} {k}");
                }
            }
        }
    }
}
