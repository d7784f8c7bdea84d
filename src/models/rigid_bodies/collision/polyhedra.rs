//! Contacts of two convex polyhedra, by separating axes.
//!
//! The axis of largest separation is a face normal, or the cross product of two edges whose arcs on the unit sphere
//! of normals intersect (Gregorius 2013, *The separating axis test between convex polyhedra*). For a face axis, the
//! opposing face of the other polyhedron is clipped against the sides of the first face (Sutherland and Hodgman
//! 1974), which gives the corners of the contact patch; an edge axis gives one point. A face is preferred to an edge
//! pair unless the edge separation is larger by more than rounding, so that resting contacts keep their patch.

use super::ContactPoint;
use crate::rigid_bodies::polyhedron::{Face, Polyhedron};
use nalgebra::{Isometry3, Vector3};

/// Rounding tolerance of the separations of faces and edges, relative to the size of the bodies.
const ROUNDING: f64 = 1e-10;

/// Appends the contact points of two polyhedra. Returns false if the bodies are closer than the margin but their
/// closest features are neither a face nor two crossing edges.
pub(super) fn contacts(
    (a, at_a): (&Polyhedron, &Isometry3<f64>),
    (b, at_b): (&Polyhedron, &Isometry3<f64>),
    margin: f64,
    points: &mut Vec<ContactPoint>,
) -> bool {
    let b_in_a = at_a.inverse() * at_b;
    let a_in_b = b_in_a.inverse();
    let (by_a, face_a) = best_face(a, b, &b_in_a);
    let (by_b, face_b) = best_face(b, a, &a_in_b);
    if by_a > margin || by_b > margin {
        return true;
    }
    let size = a.vertices.iter().chain(&b.vertices).map(|v| v.amax()).fold(0.0, f64::max);
    let face = by_a.max(by_b);
    if let Some(edges) = best_edges(a, b, &b_in_a) {
        if edges.separation > margin {
            return true;
        }
        if edges.separation > face + ROUNDING * size {
            return edges.point(a, b, (at_a, &b_in_a), margin, points);
        }
    }
    let start = points.len();
    let normals = (a.faces[face_a].normal, b_in_a.rotation * b.faces[face_b].normal);
    // If two parallel edges are in contact, as at the ridge of two leaning cards, the normals of both faces are
    // contact normals.
    let is_ridge = (by_a - by_b).abs() <= RIDGE * size && normals.0.dot(&normals.1) > -FLAT;
    let takes_a = by_a >= by_b - ROUNDING * size;
    if takes_a || is_ridge {
        clip((a, face_a, at_a), (b, at_b), margin, points);
    }
    if !takes_a || is_ridge {
        let first = points.len();
        clip((b, face_b, at_b), (a, at_a), margin, points);
        for point in &mut points[first..] {
            *point = ContactPoint { id: point.id | OTHER_FACE, ..point.flipped() };
        }
    }
    points.len() > start
}

/// Difference of the face separations of two polyhedra, relative to their size, below which both faces are used for
/// parallel edges in contact: twice the penetration tolerance of bodies at rest.
const RIDGE: f64 = 1e-6;

/// The cosine of the angle below which opposing faces of two polyhedra count as parallel.
const FLAT: f64 = 0.999;

/// The bit of the identity number of a contact point that marks points on a face of the second body.
const OTHER_FACE: u64 = 1 << 31;

/// Returns the face of polyhedron `a` with the largest separation from polyhedron `b`, and the separation; `b_in_a` is
/// the pose of `b` in the frame of `a`.
fn best_face(a: &Polyhedron, b: &Polyhedron, b_in_a: &Isometry3<f64>) -> (f64, usize) {
    let mut best = (f64::NEG_INFINITY, 0);
    for (k, face) in a.faces.iter().enumerate() {
        let down = b_in_a.rotation.inverse() * -face.normal;
        let lowest = b_in_a.rotation * b.support(&down) + b_in_a.translation.vector;
        let height = face.normal.dot(&lowest) - face.offset;
        if height > best.0 {
            best = (height, k);
        }
    }
    best
}

/// A pair of edges of two polyhedra and their separating axis, in the frame of the first body.
struct EdgePair {
    separation: f64,
    axis: Vector3<f64>,
    edges: (usize, usize),
}

/// Returns the pair of edges of two polyhedra with the largest separation, among the pairs that form a face of the
/// Minkowski difference.
fn best_edges(a: &Polyhedron, b: &Polyhedron, b_in_a: &Isometry3<f64>) -> Option<EdgePair> {
    let mut best: Option<EdgePair> = None;
    for (j, edge_b) in b.edges.iter().enumerate() {
        let [p, q] = edge_b.vertices.map(|v| b_in_a.rotation * b.vertices[v] + b_in_a.translation.vector);
        let [n1, n2] = edge_b.faces.map(|f| -(b_in_a.rotation * b.faces[f].normal));
        let (along_b, arc_b) = (q - p, n2.cross(&n1));
        for (i, edge_a) in a.edges.iter().enumerate() {
            let [m1, m2] = edge_a.faces.map(|f| a.faces[f].normal);
            let arc_a = m2.cross(&m1);
            let (c1, c2, d1, d2) = (n1.dot(&arc_a), n2.dot(&arc_a), m1.dot(&arc_b), m2.dot(&arc_b));
            // Two arcs on the unit sphere intersect if the ends of each are on both sides of the other and both arcs
            // are in the same hemisphere.
            if c1 * c2 >= 0.0 || d1 * d2 >= 0.0 || c1 * d2 <= 0.0 {
                continue;
            }
            let [r, s] = edge_a.vertices.map(|v| a.vertices[v]);
            let Some(axis) = along_b.cross(&(s - r)).try_normalize(ROUNDING * along_b.norm() * (s - r).norm()) else {
                continue;
            };
            let axis = if axis.dot(&(m1 + m2)) < 0.0 { -axis } else { axis };
            let separation = axis.dot(&(p - r));
            if best.as_ref().is_none_or(|best| separation > best.separation) {
                best = Some(EdgePair { separation, axis, edges: (i, j) });
            }
        }
    }
    best
}

impl EdgePair {
    /// Appends the contact point of two edges, the midpoint of their closest points; returns false if a closest point
    /// is beyond an end of its edge.
    fn point(
        &self,
        a: &Polyhedron,
        b: &Polyhedron,
        (at_a, b_in_a): (&Isometry3<f64>, &Isometry3<f64>),
        margin: f64,
        points: &mut Vec<ContactPoint>,
    ) -> bool {
        let (i, j) = self.edges;
        let [r, s] = a.edges[i].vertices.map(|v| a.vertices[v]);
        let [p, q] = b.edges[j].vertices.map(|v| b_in_a.rotation * b.vertices[v] + b_in_a.translation.vector);
        let (along_a, along_b, between) = (s - r, q - p, p - r);
        let (aa, ab, bb) = (along_a.norm_squared(), along_a.dot(&along_b), along_b.norm_squared());
        let determinant = aa * bb - ab * ab;
        let x = (along_a.dot(&between) * bb - along_b.dot(&between) * ab) / determinant;
        let y = (along_a.dot(&between) * ab - along_b.dot(&between) * aa) / determinant;
        if !((0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y)) {
            return false;
        }
        if self.separation <= margin {
            let middle = 0.5 * (r + along_a * x + p + along_b * y);
            points.push(ContactPoint {
                position: at_a.rotation * middle + at_a.translation.vector,
                normal: at_a.rotation * self.axis,
                gap: self.separation,
                id: 1 << 30 | (i as u64) << 15 | j as u64,
                feature: 0,
            });
        }
        true
    }
}

/// A corner of a clipped face of a polyhedron, with its identity number.
#[derive(Clone, Copy)]
struct Corner {
    at: Vector3<f64>,
    id: u32,
}

/// Clips the face of polyhedron `b` that is most opposed to the given face of polyhedron `a` against the sides of the
/// face of `a`, and appends the remaining corners as contact points.
fn clip(
    (a, face, at_a): (&Polyhedron, usize, &Isometry3<f64>),
    (b, at_b): (&Polyhedron, &Isometry3<f64>),
    margin: f64,
    points: &mut Vec<ContactPoint>,
) {
    let reference = &a.faces[face];
    let normal = at_a.rotation * reference.normal;
    let in_b = at_b.rotation.inverse() * normal;
    let opposing = |face: &&Face| face.normal.dot(&in_b);
    let Some(incident) = b.faces.iter().min_by(|f, g| opposing(f).total_cmp(&opposing(g))) else { return };
    let mut polygon: Vec<Corner> = incident
        .vertices
        .iter()
        .map(|&v| Corner { at: at_b.rotation * b.vertices[v] + at_b.translation.vector, id: v as u32 })
        .collect();
    let corner = |k: usize| {
        let vertices = &reference.vertices;
        at_a.rotation * a.vertices[vertices[k % vertices.len()]] + at_a.translation.vector
    };
    for side in 0..reference.vertices.len() {
        let (from, to) = (corner(side), corner(side + 1));
        let outward = (to - from).cross(&normal).normalize();
        let tolerance = ROUNDING * (to - from).norm();
        polygon = cut(&polygon, |p| outward.dot(&(p - from)), tolerance, side as u32);
    }
    let origin = corner(0);
    for Corner { at, id } in polygon {
        let gap = normal.dot(&(at - origin));
        if gap <= margin {
            points.push(ContactPoint { position: at - normal * (0.5 * gap), normal, gap, id: id.into(), feature: 0 });
        }
    }
}

/// Returns the part of a polygon in which the linear function `height` is at most `rounding`, a tolerance for rounding
/// errors.
fn cut(polygon: &[Corner], height: impl Fn(&Vector3<f64>) -> f64, rounding: f64, side: u32) -> Vec<Corner> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (k, corner) in polygon.iter().enumerate() {
        let next = &polygon[(k + 1) % polygon.len()];
        let (here, there) = (height(&corner.at), height(&next.at));
        if here <= rounding {
            kept.push(*corner);
        }
        if (here <= rounding) != (there <= rounding) {
            let at = corner.at + (next.at - corner.at) * (here / (here - there)).clamp(0.0, 1.0);
            // The identity number of a new corner depends on the end of the edge that is cut off, whatever the
            // direction of the edge.
            let end = if here <= rounding { next.id } else { corner.id };
            kept.push(Corner { at, id: (end.wrapping_mul(31) ^ (side + 1) << 12) & 0x3fff_ffff });
        }
    }
    kept
}
