//! Convex polyhedra: vertices, faces with outward unit normals, and edges with their two adjacent faces, as needed
//! for separating axes. Faces are planar polygons, not triangles: a box rests on the four corners of a face, not on
//! two triangles.

use nalgebra::{Matrix3, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::shape::ConvexPolyhedron;

/// A planar face of a polyhedron, oriented counter-clockwise as seen from outside.
#[derive(Clone, Debug, PartialEq)]
pub struct Face {
    /// The outward unit normal of the face.
    pub normal: Vector3<f64>,
    /// The value of `normal . x` for points `x` on the face, in metres.
    pub offset: f64,
    /// The indices of the polyhedron's vertices of the face, in counter-clockwise order.
    pub vertices: Vec<usize>,
}

/// An edge of a polyhedron between two faces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// The indices of the polyhedron's vertices at both ends of the edge.
    pub vertices: [usize; 2],
    /// The indices of the two faces of the polyhedron that meet at the edge.
    pub faces: [usize; 2],
}

/// A bounded convex polyhedron with a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyhedron {
    /// The vertices of the polyhedron in metres, in the body frame.
    pub vertices: Vec<Vector3<f64>>,
    /// The faces of the polyhedron.
    pub faces: Vec<Face>,
    /// The edges of the polyhedron, without duplicates.
    pub edges: Vec<Edge>,
}

impl Polyhedron {
    /// Returns the cuboid `[-a, a] x [-b, b] x [-c, c]` with the half side lengths `half = (a, b, c)`.
    pub fn cuboid(half: Vector3<f64>) -> Self {
        // The bits of the number `k` of a cuboid's vertex are the signs of its coordinates.
        let sign = |k: usize, axis: usize| if k >> axis & 1 == 1 { 1.0 } else { -1.0 };
        let vertices = (0..8).map(|k| Vector3::from_fn(|axis, _| sign(k, axis) * half[axis])).collect();
        let loops = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        Self::from_loops(vertices, loops.into_iter().map(Vec::from))
    }

    /// Returns the convex hull of the given points as a polyhedron; `None` if the points span no volume.
    pub fn hull(points: &[Vector3<f64>]) -> Option<Self> {
        let centre = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        let size = points.iter().map(|p| (p - centre).amax()).fold(0.0, f64::max);
        if !(size > 0.0 && size.is_finite()) {
            return None;
        }
        // Scale the points of the hull to unit size, since the thresholds of the collision library are absolute.
        let unit: Vec<Vector> =
            points.iter().map(|p| (p - centre) / size).map(|p| Vector::new(p.x, p.y, p.z)).collect();
        if !spans_volume(&unit) {
            return None;
        }
        let hull = ConvexPolyhedron::from_convex_hull(&unit)?;
        let vertices = hull.points().iter().map(|p| centre + Vector3::new(p.x, p.y, p.z) * size).collect();
        let loops = hull.faces().iter().map(|face| {
            let first = face.first_vertex_or_edge as usize;
            let range = first..first + face.num_vertices_or_edges as usize;
            hull.vertices_adj_to_face()[range].iter().map(|&v| v as usize).collect()
        });
        let polyhedron = Self::from_loops(vertices, loops);
        (polyhedron.volume() > 0.0 && polyhedron.is_closed()).then_some(polyhedron)
    }

    fn from_loops(vertices: Vec<Vector3<f64>>, loops: impl Iterator<Item = Vec<usize>>) -> Self {
        let faces: Vec<Face> = loops
            .map(|vertices_of| {
                let corner = |k: usize| vertices[vertices_of[k % vertices_of.len()]];
                // Newell's method: `area` is twice the vector area of the polygonal face.
                let area: Vector3<f64> =
                    (1..vertices_of.len()).map(|k| (corner(k) - corner(0)).cross(&(corner(k + 1) - corner(0)))).sum();
                let normal = area.normalize();
                let offset = vertices_of.iter().map(|&v| normal.dot(&vertices[v])).sum::<f64>();
                Face { normal, offset: offset / vertices_of.len() as f64, vertices: vertices_of }
            })
            .collect();
        let mut edges = Vec::new();
        let mut open = std::collections::HashMap::new();
        for (f, face) in faces.iter().enumerate() {
            for (k, &v) in face.vertices.iter().enumerate() {
                let w = face.vertices[(k + 1) % face.vertices.len()];
                match open.remove(&(w, v)) {
                    Some(other) => edges.push(Edge { vertices: [v, w], faces: [f, other] }),
                    None => drop(open.insert((v, w), f)),
                }
            }
        }
        Self { vertices, faces, edges }
    }

    /// Returns whether Euler's formula is satisfied, as it is if every edge was found with both adjacent faces.
    fn is_closed(&self) -> bool {
        let used: std::collections::HashSet<usize> =
            self.faces.iter().flat_map(|face| &face.vertices).copied().collect();
        used.len() + self.faces.len() == self.edges.len() + 2
    }

    /// Returns tetrahedra `(0, a, b, c)` with signed volumes that sum to the volume of the polyhedron, each as its
    /// volume and `[a, b, c]`.
    fn tetrahedra(&self) -> impl Iterator<Item = (f64, [Vector3<f64>; 3])> + '_ {
        self.faces.iter().flat_map(move |face| {
            let corner = move |k: usize| self.vertices[face.vertices[k]];
            (1..face.vertices.len() - 1).map(move |k| {
                let corners = [corner(0), corner(k), corner(k + 1)];
                (Matrix3::from_columns(&corners).determinant() / 6.0, corners)
            })
        })
    }

    /// Returns the volume of the polyhedron in cubic metres.
    pub fn volume(&self) -> f64 {
        self.tetrahedra().map(|(volume, _)| volume).sum()
    }

    /// Returns the centre of mass of the polyhedron at uniform density.
    pub fn centre(&self) -> Vector3<f64> {
        let moment: Vector3<f64> = self.tetrahedra().map(|(v, [a, b, c])| (a + b + c) * (v / 4.0)).sum();
        moment / self.volume()
    }

    /// Returns the second moment `int x x^T dV` of the polyhedron about the origin; for a tetrahedron of volume `V`
    /// with vertices `v_i`, `V/20 sum_ij (1 + delta_ij) v_i v_j^T`.
    pub fn second_moment(&self) -> Matrix3<f64> {
        self.tetrahedra()
            .map(|(v, [a, b, c])| {
                let s = a + b + c;
                (s * s.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose()) * (v / 20.0)
            })
            .sum()
    }

    /// Moves the origin of the body frame, in which the vertices are given, to `centre`.
    pub fn shift(&mut self, centre: &Vector3<f64>) {
        for vertex in &mut self.vertices {
            *vertex -= centre;
        }
        for face in &mut self.faces {
            face.offset -= face.normal.dot(centre);
        }
    }

    /// Returns the support point of the polyhedron: the vertex farthest in a direction.
    pub fn support(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        let farthest = self.vertices.iter().max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction)));
        farthest.copied().unwrap_or_else(Vector3::zeros)
    }

    /// Returns the point of the polyhedron's surface nearest to `p`, the outward normal at the nearest point, and the
    /// distance, negative inside.
    pub fn nearest(&self, p: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>, f64) {
        let height = |face: &Face| face.normal.dot(p) - face.offset;
        let highest = self.faces.iter().max_by(|a, b| height(a).total_cmp(&height(b)));
        let Some(face) = highest else { return (*p, Vector3::z(), 0.0) };
        let distance = height(face);
        if distance <= 0.0 {
            return (p - face.normal * distance, face.normal, distance);
        }
        let seen = self.faces.iter().filter(|face| height(face) > 0.0);
        let nearest = seen
            .map(|face| self.nearest_on_face(face, p))
            .min_by(|a, b| (a - p).norm_squared().total_cmp(&(b - p).norm_squared()));
        let point = nearest.unwrap_or(*p);
        let distance = (p - point).norm();
        // For points on the surface of the polyhedron, the normal is that of the face.
        let normal = if distance > f64::EPSILON * p.norm() { (p - point) / distance } else { face.normal };
        (point, normal, distance)
    }

    fn nearest_on_face(&self, face: &Face, p: &Vector3<f64>) -> Vector3<f64> {
        let foot = p - face.normal * (face.normal.dot(p) - face.offset);
        let sides = || {
            let n = face.vertices.len();
            (0..n).map(move |k| (self.vertices[face.vertices[k]], self.vertices[face.vertices[(k + 1) % n]]))
        };
        if sides().all(|(a, b)| face.normal.dot(&(b - a).cross(&(foot - a))) >= 0.0) {
            return foot;
        }
        let onto = |(a, b): (Vector3<f64>, Vector3<f64>)| {
            let d = b - a;
            a + d * ((foot - a).dot(&d) / d.norm_squared()).clamp(0.0, 1.0)
        };
        let nearest = sides().map(onto).min_by(|a, b| (a - foot).norm_squared().total_cmp(&(b - foot).norm_squared()));
        nearest.unwrap_or(foot)
    }
}

/// Returns whether points, scaled to unit size, have an extent (standard deviation) above 1e-3 in every direction.
fn spans_volume(points: &[Vector]) -> bool {
    let mut covariance = Matrix3::zeros();
    let mean = points.iter().fold(Vector3::zeros(), |sum, p| sum + Vector3::new(p.x, p.y, p.z)) / points.len() as f64;
    for p in points {
        let d = Vector3::new(p.x, p.y, p.z) - mean;
        covariance += d * d.transpose() / points.len() as f64;
    }
    points.len() >= 4 && covariance.symmetric_eigenvalues().min() > 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_given_by_its_corners_is_the_box_given_by_its_sides() {
        let half = Vector3::new(0.5, 1.0, 2.0);
        let cuboid = Polyhedron::cuboid(half);
        let mut points = cuboid.vertices.clone();
        points.push(Vector3::new(0.1, 0.2, -0.3));
        let hull = Polyhedron::hull(&points).unwrap();
        assert_eq!((hull.faces.len(), hull.edges.len()), (6, 12));
        assert!((hull.volume() - 8.0).abs() < 1e-14);
        assert_eq!((cuboid.faces.len(), cuboid.edges.len()), (6, 12));
        assert!((cuboid.volume() - 8.0).abs() < 1e-14);
        // The second moment of a box along an axis with half side length `a` is `int x^2 dV = V a^2 / 3`.
        let moment = hull.second_moment();
        assert!((moment - Matrix3::from_diagonal(&Vector3::new(2.0 / 3.0, 8.0 / 3.0, 32.0 / 3.0))).amax() < 1e-13);
    }

    #[test]
    fn the_corner_tetrahedron_has_the_moments_of_its_integrals() {
        let hull = Polyhedron::hull(&[Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()]).unwrap();
        assert!((hull.volume() - 1.0 / 6.0).abs() < 1e-15);
        assert!((hull.centre() - Vector3::repeat(0.25)).amax() < 1e-15);
        let moment = hull.second_moment();
        assert!((moment[(0, 0)] - 1.0 / 60.0).abs() < 1e-15 && (moment[(0, 1)] - 1.0 / 120.0).abs() < 1e-15);
    }

    #[test]
    fn flat_points_and_too_few_have_no_hull() {
        let flat = [Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::new(1.0, 1.0, 0.0)];
        assert!(Polyhedron::hull(&flat).is_none());
        assert!(Polyhedron::hull(&flat[..3]).is_none());
        assert!(Polyhedron::hull(&[Vector3::x(); 9]).is_none());
    }

    #[test]
    fn the_nearest_point_lies_on_a_face_an_edge_or_a_corner() {
        let cuboid = Polyhedron::cuboid(Vector3::new(1.0, 1.0, 1.0));
        let cases = [
            (Vector3::new(0.2, 0.3, 3.0), Vector3::new(0.2, 0.3, 1.0), 2.0),
            (Vector3::new(0.2, 4.0, 5.0), Vector3::new(0.2, 1.0, 1.0), 5.0),
            (Vector3::new(2.0, 3.0, -3.0), Vector3::new(1.0, 1.0, -1.0), 3.0),
            (Vector3::new(0.0, 0.9, 0.2), Vector3::new(0.0, 1.0, 0.2), -0.1),
        ];
        for (p, expected, distance) in cases {
            let (point, normal, found) = cuboid.nearest(&p);
            assert!((point - expected).amax() < 1e-15 && (found - distance).abs() < 1e-15, "{p}: {point}, {found}");
            assert!((point + normal * found - p).amax() < 1e-15);
        }
    }
}
