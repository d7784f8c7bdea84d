//! A grid of equal elements on an interval, a rectangle or a box. Nodes and elements are numbered with `x` the fastest.

/// A direction of the grid: the interval `[lower, upper]` in equal parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Where it begins.
    pub lower: f64,
    /// Where it ends, above `lower`.
    pub upper: f64,
    /// The number of parts, at least one.
    pub elements: usize,
}

impl Axis {
    /// The length of a part.
    pub fn spacing(&self) -> f64 {
        (self.upper - self.lower) / self.elements as f64
    }

    /// The number of points between and around the parts.
    pub fn nodes(&self) -> usize {
        self.elements + 1
    }

    /// The coordinate of a point; that of the last is `upper` to the last digit.
    pub fn node(&self, i: usize) -> f64 {
        let part = i as f64 / self.elements as f64;
        self.lower * (1.0 - part) + self.upper * part
    }

    fn centre(&self, element: usize) -> f64 {
        let part = (element as f64 + 0.5) / self.elements as f64;
        self.lower * (1.0 - part) + self.upper * part
    }
}

/// The product of one to three axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    axes: Vec<Axis>,
}

impl Grid {
    /// The grid on the product of the axes `x`, `y`, `z`, of which there are one to three.
    pub fn new(axes: Vec<Axis>) -> Self {
        debug_assert!((1..=3).contains(&axes.len()), "{} axes", axes.len());
        Self { axes }
    }

    /// The number of directions.
    pub fn dimension(&self) -> usize {
        self.axes.len()
    }

    /// The directions.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The number of nodes.
    pub fn nodes(&self) -> usize {
        self.axes.iter().map(Axis::nodes).product()
    }

    /// The number of elements.
    pub fn elements(&self) -> usize {
        self.axes.iter().map(|axis| axis.elements).product()
    }

    /// Nodes in each direction, the slowest first: the shape of a vector of nodal values as an array.
    pub fn shape(&self) -> Vec<usize> {
        self.axes.iter().rev().map(Axis::nodes).collect()
    }

    /// The place of a node in each direction; zero in those that the grid has not.
    pub fn indices(&self, node: usize) -> [usize; 3] {
        split(node, self.axes.iter().map(Axis::nodes))
    }

    /// The node at a place in each direction.
    pub fn node(&self, indices: [usize; 3]) -> usize {
        self.axes.iter().zip(indices).rev().fold(0, |node, (axis, i)| node * axis.nodes() + i)
    }

    /// The coordinates of a node; zero in directions that the grid has not.
    pub fn coordinates(&self, node: usize) -> [f64; 3] {
        let indices = self.indices(node);
        self.fill(|direction, axis| axis.node(indices[direction]))
    }

    /// The coordinates of the centre of an element.
    pub fn centre(&self, element: usize) -> [f64; 3] {
        let indices = split(element, self.axes.iter().map(|axis| axis.elements));
        self.fill(|direction, axis| axis.centre(indices[direction]))
    }

    /// The nodes of an element, `2^d` of them: bit `k` of the place among them says on which end of direction `k`.
    pub fn corners(&self, element: usize) -> impl Iterator<Item = usize> + '_ {
        let indices = split(element, self.axes.iter().map(|axis| axis.elements));
        let first = self.node(indices);
        (0..1 << self.dimension()).map(move |corner| first + self.offset(corner))
    }

    /// From the first corner of an element to another.
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

/// A number in a mixed base, the first digit the fastest.
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
