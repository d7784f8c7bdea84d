//! The error measure of the FCLIB collection of frictional contact problems, implemented independently of the library.

use dvi::vi::coulomb::CoulombProblem;
use nalgebra::{DMatrix, DVector, Vector3};

/// The relative residual of the natural map of a frictional contact problem, with a dense Delassus matrix `W` and
/// another formula of the projection than the library's, for friction coefficients `mu > 0`.
pub fn natural_map(problem: &CoulombProblem, r: &[Vector3<f64>]) -> f64 {
    let n = problem.contacts();
    let mut dense = DMatrix::zeros(3 * n, 3 * n);
    for i in 0..n {
        for (j, block) in problem.matrix().row(i) {
            dense.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(block);
        }
    }
    let stack = |v: &[Vector3<f64>]| DVector::from_iterator(3 * n, v.iter().flatten().copied());
    let q = stack(problem.q());
    let r = stack(r);
    let u = &dense * &r + &q;
    let mut map = 0.0;
    for (k, &mu) in problem.mu().iter().enumerate() {
        let (r, u) = (r.fixed_rows::<3>(3 * k).into_owned(), u.fixed_rows::<3>(3 * k).into_owned());
        let y = r - u - Vector3::new(mu * u.y.hypot(u.z), 0.0, 0.0);
        map += (r - nearest_in_cone(y, mu)).norm_squared();
    }
    map.sqrt() / q.norm().max(r.norm()).max(u.norm())
}

/// Projects `v` onto the friction cone of a contact. In the plane of the normal and the tangential part of `v`, the
/// cone is a wedge: a vector neither in the wedge nor in its polar is projected onto the edge.
fn nearest_in_cone(v: Vector3<f64>, mu: f64) -> Vector3<f64> {
    let slip = v.y.hypot(v.z);
    let w = if slip == 0.0 { (1.0, 0.0) } else { (v.y / slip, v.z / slip) };
    let inside = mu * v.x >= slip;
    let polar = mu * slip <= -v.x;
    let edge = Vector3::new(1.0, mu * w.0, mu * w.1).normalize();
    if inside {
        v
    } else if polar {
        Vector3::zeros()
    } else {
        edge * edge.dot(&v)
    }
}
