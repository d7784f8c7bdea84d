//! Reading the collection, and the measure of an answer, apart from the library's own.

use dvi::vi::coulomb::CoulombProblem;
use nalgebra::{DMatrix, DVector, Vector3};
use serde_json::Value;
use std::path::Path;

pub struct Instance {
    pub problem: CoulombProblem,
    /// Impulses found by other solvers.
    pub reference: Vec<Vector3<f64>>,
}

pub fn read(name: &str) -> Instance {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/reference/fclib/{name}.json"));
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let value: Value = serde_json::from_slice(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let matrix = &value["W"];
    let problem = CoulombProblem::from_csr(
        &indices(&matrix["indptr"]),
        &indices(&matrix["indices"]),
        &numbers(&matrix["data"]),
        &numbers(&value["q"]),
        numbers(&value["mu"]),
    )
    .unwrap_or_else(|error| panic!("{name}: {error}"));
    let reference = numbers(&value["reference"]["r"]).chunks_exact(3).map(Vector3::from_column_slice).collect();
    Instance { problem, reference }
}

/// Every number of a list, or of a list of lists.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().expect("a number")],
    }
}

fn indices(value: &Value) -> Vec<usize> {
    let list = value.as_array().expect("a list of indices");
    list.iter().map(|index| index.as_u64().and_then(|i| usize::try_from(i).ok()).expect("an index")).collect()
}

/// The relative natural map with a dense `W` and another form of the projection than the library's, for `mu > 0`.
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

/// In the plane of the normal and `v_t` the cone is a wedge: what lies neither in it nor in its polar is nearest to the
/// edge.
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
