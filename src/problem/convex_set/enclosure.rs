//! Interval enclosures, over a box of `z` and `G`, of the event functions (monitors) of an active face of `K`, in the
//! order of [`FaceEquations::monitors`](super::FaceEquations).

use super::block::Shape;
use super::face::{Elimination, Face};
use super::polyhedron::Polyhedron;
use numerics::Interval;

/// The interval enclosure of an event function (monitor) of a face of a block of `K`, in the unit of `z` or of `G`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MonitorRange {
    /// The enclosure of the distance to an inactive inequality of the block, in the unit of `z`.
    Distance(Interval),
    /// The enclosure of the multiplier of an active inequality of the block, in the unit of `G`.
    Multiplier(Interval),
}

use MonitorRange::{Distance, Multiplier};

/// An event function (monitor) of a face of a block of `K` that is affine in `z` and `G`:
/// `constant + sum c_i z_i + sum d_i G_i` over the members of the block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlatMonitor {
    /// The constant term of the affine event function.
    pub constant: f64,
    /// The coefficients `c` of `z` in the event function, as pairs `(member of the block, c)`.
    pub of_z: Vec<(usize, f64)>,
    /// The coefficients `d` of `G` in the event function, as pairs `(member of the block, d)`; empty if the event
    /// function is a distance.
    pub of_g: Vec<(usize, f64)>,
}

impl FlatMonitor {
    /// Returns the range of the affine event function over a box of `z` and `G`.
    pub fn range(&self, z: &[Interval], g: &[Interval]) -> Interval {
        let of = |terms: &[(usize, f64)], of_members: &[Interval]| {
            sum(terms.iter().map(|&(i, factor)| Interval::point(factor) * of_members[i]))
        };
        Interval::point(self.constant) + of(&self.of_z, z) + of(&self.of_g, g)
    }
}

impl Shape {
    /// Returns whether all event functions (monitors) of a face of the block are affine in `z` and `G`.
    pub fn is_flat(&self, face: &Face) -> bool {
        matches!((self, face), (Self::Simplex | Self::Polyhedron(_), Face::Interior | Face::Edge(_)))
    }

    /// Returns the affine event functions (monitors) of a face of a block with `members` components, in the order of
    /// [`FaceEquations::monitors`](super::FaceEquations); `None` if they are nonlinear.
    pub fn flat_monitors(&self, face: &Face, members: usize) -> Option<Vec<FlatMonitor>> {
        let slack = |polyhedron: &Polyhedron, j: usize| FlatMonitor {
            constant: polyhedron.offset(j),
            of_z: polyhedron.normal(j).iter().enumerate().map(|(i, normal)| (i, -normal)).collect(),
            of_g: Vec::new(),
        };
        match (self, face) {
            (Self::Polyhedron(polyhedron), Face::Interior) => {
                Some((0..polyhedron.rows()).map(|j| slack(polyhedron, j)).collect())
            }
            (Self::Simplex, Face::Interior) => Some(Vec::new()),
            (Self::Simplex, Face::Edge(zeros)) => {
                let pivot = (0..members).find(|i| !zeros.contains(i)).unwrap_or(0);
                let monitor = |i: usize| match zeros.contains(&i) {
                    true => FlatMonitor { of_g: vec![(i, 1.0), (pivot, -1.0)], ..FlatMonitor::default() },
                    false => FlatMonitor { of_z: vec![(i, 1.0)], ..FlatMonitor::default() },
                };
                Some((0..members).map(monitor).collect())
            }
            (Self::Polyhedron(polyhedron), Face::Edge(rows)) => {
                let Elimination { pivots, inverse, .. } = Elimination::of(polyhedron, rows);
                let count = pivots.len();
                let multiplier = |at: usize| FlatMonitor {
                    of_g: pivots.iter().enumerate().map(|(q, &p)| (p, -inverse[q * count + at])).collect(),
                    ..FlatMonitor::default()
                };
                let monitor = |j: usize| match rows.iter().position(|row| *row == j) {
                    Some(at) => multiplier(at),
                    None => slack(polyhedron, j),
                };
                Some((0..polyhedron.rows()).map(monitor).collect())
            }
            _ => None,
        }
    }

    /// Encloses the nonlinear event functions (monitors), which become negative where a solution leaves a face of the
    /// block, over a box of `z` and `G`; `radius` encloses the radius of a ball and is ignored for other shapes.
    pub fn enclose_monitors(
        &self,
        face: &Face,
        z: &[Interval],
        g: &[Interval],
        radius: Interval,
        out: &mut Vec<MonitorRange>,
    ) {
        out.clear();
        match (self, face) {
            (Self::Ball { .. }, Face::Interior) => out.push(Distance(radius - norm(z))),
            (Self::SecondOrderCone, Face::Interior) => out.push(Distance(z[0] - norm(&z[1..]))),
            (_, Face::Interior) => {}
            (Self::Ball { .. }, Face::Vertex) => out.push(Distance(-radius)),
            (_, Face::Vertex) => out.push(Multiplier(g[0] - norm(&g[1..]))),
            (Self::Ball { .. }, _) => {
                out.push(Multiplier(-sum(z.iter().zip(g).map(|(z, g)| *z * *g)) / norm(z)));
            }
            _ => out.extend([Multiplier(g[0]), Distance(z[0])]),
        }
    }
}

fn sum(terms: impl Iterator<Item = Interval>) -> Interval {
    terms.fold(Interval::point(0.0), |sum, term| sum + term)
}

/// Encloses the Euclidean norm over the box `x` of intervals.
fn norm(x: &[Interval]) -> Interval {
    sum(x.iter().map(|x| x.square())).sqrt()
}
