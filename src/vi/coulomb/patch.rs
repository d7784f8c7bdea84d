//! The admissible set of impulses of a contact patch: two block rows, of the force `(r_n, f_1, f_2)`, and of the
//! torque `(tau, m_1, m_2)` in drilling and rolling,
//!
//! ```text
//! K = { r : (f, tau / a) in mu r_n L,  |m| <= b r_n },    u_n + mu sigma(u_f, a u_tau) + b |u_m|  in place of  u_n + mu |u_t|
//! ```
//!
//! with the [limit surface](super::limit_surface) `L`. With the set `S` of all `(f, tau, m)` that are admissible for
//! `r_n = 1`, Coulomb's law holds in a general form: friction has the largest power in `r_n S`, and de Saxce's term
//! is the support function of `S`. Torques are divided by a length, and angular velocities multiplied by it, that
//! makes them comparable with forces, such as a radius of gyration; `a` and `b` are the radius of the patch and the
//! coefficient of rolling friction in units of that length. If torques were divided by `a` and `b` themselves, a tiny
//! patch would have rows that almost vanish, and a huge one rows that outweigh the force.

use super::alart_curnier::Linearised;
use super::limit_surface::{Point, mean_speed};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector2, Vector3, Vector6};

/// The role of a block row of a contact problem with point contacts and contact patches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Role {
    /// The force of a point contact.
    #[default]
    Point,
    /// The force of a contact patch; its torque follows in the next row.
    Force(Reach),
    /// The torque of a contact patch.
    Torque,
}

/// The lengths of a contact patch, in units of the length by which its torques are divided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// The radius `a` of the patch, for drilling.
    pub drill: f64,
    /// The coefficient `b` of rolling friction.
    pub roll: f64,
}

/// A force-like and a torque-like vector of a contact patch: the values of its two block rows.
pub(super) type Pair = [Vector3<f64>; 2];

/// The admissible set of forces and torques of one contact patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PatchCone {
    pub mu: f64,
    pub reach: Reach,
}

/// Largest number of iterations for the normal impulse of a projection onto the patch's cone, and the relative
/// accuracy of that impulse.
const ITERATIONS: usize = 100;
const ACCURACY: f64 = 1e-15;

/// The friction components `(f_1, f_2, tau, m_1, m_2)` of a contact patch.
pub(super) type Parts = SMatrix<f64, 5, 1>;

/// The projection of a point onto `rho S`, with the set `S` of friction admissible for unit normal impulse, and its
/// derivatives by the point and by `rho`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projected {
    pub value: Parts,
    pub by_point: SMatrix<f64, 5, 5>,
    pub by_rho: Parts,
}

impl PatchCone {
    /// Returns the support function `mu sigma(u_f, a u_tau) + b |u_m|` of the admissible friction.
    pub fn support(self, u: &Pair) -> f64 {
        let Reach { drill, roll } = self.reach;
        self.mu * mean_speed(u[0].y.hypot(u[0].z), drill * u[1].x) + roll * u[1].y.hypot(u[1].z)
    }

    /// Returns the point nearest to a force and a torque of the given sizes in the set `scale L`, with the limit
    /// surface `L`, and its distance; `None` if they lie inside. For a patch without a radius only the force counts.
    fn nearest(self, slide: f64, drill: f64, scale: f64) -> Option<(Point, f64)> {
        let a = self.reach.drill;
        if a > 0.0 { Point::nearest(slide, drill, scale, a) } else { Point::nearest(slide, 0.0, scale, 1.0) }
    }

    /// Returns the velocity of the patch with its normal component augmented by the support function of the
    /// admissible friction.
    pub fn augment(self, mut u: Pair) -> Pair {
        u[0].x += self.support(&u);
        u
    }

    /// Returns the projection onto the patch's cone. Its normal impulse `nu` is the root of `nu - v_n = mu sigma(d_f) +
    /// b |d_m|`, with the distances `d` of the other components from `nu S`.
    pub fn project(self, v: Pair) -> Pair {
        let (slide, drill, roll) = (v[0].y.hypot(v[0].z), v[1].x.abs(), v[1].y.hypot(v[1].z));
        let (most, b) = (self.support(&v), self.reach.roll);
        if v[0].x + most <= 0.0 {
            return [Vector3::zeros(); 2];
        }
        let (mut lower, mut upper) = (v[0].x.max(0.0), v[0].x + most);
        let mut nu = lower;
        for _ in 0..ITERATIONS {
            let (mut value, mut slope) = (nu - v[0].x, 1.0);
            let scale = self.mu * nu;
            if let Some((point, distance)) = self.nearest(slide, drill, scale).filter(|_| self.mu > 0.0) {
                let (support, tilt) = (point.support(), point.slope());
                value -= self.mu * distance * support;
                slope += self.mu
                    * self.mu
                    * (support * support + distance * tilt * tilt / (scale * point.radius + distance));
            }
            if roll > b * nu {
                value -= b * (roll - b * nu);
                slope += b * b;
            }
            if value.abs() <= ACCURACY * upper {
                break;
            }
            *if value < 0.0 { &mut lower } else { &mut upper } = nu;
            let newton = nu - value / slope;
            let next = if newton > lower && newton < upper { newton } else { 0.5 * (lower + upper) };
            if next == nu {
                break;
            }
            nu = next;
        }
        joined(nu, &self.onto(&parts(&v), nu).value)
    }

    /// Returns the natural map, which is zero if and only if the contact law of the patch holds.
    pub fn natural_map(self, r: &Pair, u: &Pair) -> Pair {
        let augmented = self.augment(*u);
        let projected = self.project([r[0] - augmented[0], r[1] - augmented[1]]);
        [r[0] - projected[0], r[1] - projected[1]]
    }

    /// Returns the projection of `y` onto `rho S`, where `S` is the set of friction admissible for unit normal
    /// impulse.
    pub fn onto(self, y: &Parts, rho: f64) -> Projected {
        let mut of = Projected { value: *y, by_point: SMatrix::identity(), by_rho: Parts::zeros() };
        let scale = self.mu * rho;
        let (slide, drill) = (y[0].hypot(y[1]), y[2].abs());
        let e = if slide > 0.0 { Vector2::new(y[0], y[1]) / slide } else { Vector2::x() };
        let sign = y[2].signum();
        if let Some((point, distance)) = self.nearest(slide, drill, scale) {
            let [cosine, sine] = point.normal;
            let force = scale * point.at[0];
            (of.value[0], of.value[1], of.value[2]) = (e.x * force, e.y * force, sign * scale * point.at[1]);
            let bent = scale * point.radius;
            let along = if bent > 0.0 { bent / (bent + distance) } else { 0.0 };
            let turned = scale * point.across;
            let across = if turned > 0.0 { turned / (turned + distance) } else { 0.0 };
            let t = Vector3::new(-sine * e.x, -sine * e.y, sign * cosine);
            let a = Vector3::new(-e.y, e.x, 0.0);
            of.by_point
                .fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&(t * t.transpose() * along + a * a.transpose() * across));
            let by =
                Vector3::new(e.x * point.at[0], e.y * point.at[0], sign * point.at[1]) - t * (along * point.slope());
            of.by_rho.fixed_rows_mut::<3>(0).copy_from(&(by * self.mu));
        }
        if self.reach.drill <= 0.0 {
            of.value[2] = 0.0;
            of.by_point[(2, 2)] = 0.0;
        }
        let (roll, b) = (y[3].hypot(y[4]), self.reach.roll);
        let most = b * rho;
        if roll > most {
            let e = Vector2::new(y[3], y[4]) / roll;
            (of.value[3], of.value[4]) = (e.x * most, e.y * most);
            let turn = (nalgebra::Matrix2::identity() - e * e.transpose()) * (most / roll);
            of.by_point.fixed_view_mut::<2, 2>(3, 3).copy_from(&turn);
            of.by_rho.fixed_rows_mut::<2>(3).copy_from(&(e * b));
        }
        of
    }

    /// Returns the Alart-Curnier function of the patch: `r_n - [y_n]_+` and `r_s - P_{[y_n]_+ S}(y_s)`, `y = r - u`.
    pub fn value(self, r: &Pair, u: &Pair) -> Pair {
        let y = [r[0] - u[0], r[1] - u[1]];
        if y[0].x <= 0.0 {
            return *r;
        }
        let projected = joined(y[0].x, &self.onto(&parts(&y), y[0].x).value);
        [r[0] - projected[0], r[1] - projected[1]]
    }

    /// Returns the Alart-Curnier function and its derivative `P` by `-y`: its derivatives are `P` by `u` and `I - P`
    /// by `r`.
    pub fn linearise(self, r: &Pair, u: &Pair) -> (Vector6<f64>, Matrix6<f64>) {
        let y = [r[0] - u[0], r[1] - u[1]];
        let mut by_y = Matrix6::zeros();
        if y[0].x <= 0.0 {
            return (both(r), by_y);
        }
        let projected = self.onto(&parts(&y), y[0].x);
        let at = joined(y[0].x, &projected.value);
        by_y[(0, 0)] = 1.0;
        by_y.fixed_view_mut::<5, 1>(1, 0).copy_from(&projected.by_rho);
        by_y.fixed_view_mut::<5, 5>(1, 1).copy_from(&projected.by_point);
        (both(&[r[0] - at[0], r[1] - at[1]]), by_y)
    }

    /// Evaluates the Alart-Curnier function with its derivatives, split by block rows: for each row of the patch, its
    /// value, the derivatives by velocity and impulse of the row itself, and those by velocity and impulse of the
    /// other row.
    pub fn linearise_rows(self, r: &Pair, u: &Pair) -> [(Linearised, [Matrix3<f64>; 2]); 2] {
        let (value, by_y) = self.linearise(r, u);
        let by_r = Matrix6::identity() - by_y;
        let block = |m: &Matrix6<f64>, i: usize, j: usize| m.fixed_view::<3, 3>(3 * i, 3 * j).into_owned();
        [0, 1].map(|i| {
            let value = value.fixed_rows::<3>(3 * i).into_owned();
            let own = Linearised { value, by_u: block(&by_y, i, i), by_r: block(&by_r, i, i) };
            (own, [block(&by_y, i, 1 - i), block(&by_r, i, 1 - i)])
        })
    }
}

pub(super) fn both(pair: &Pair) -> Vector6<f64> {
    Vector6::new(pair[0].x, pair[0].y, pair[0].z, pair[1].x, pair[1].y, pair[1].z)
}

pub(super) fn pair(v: &Vector6<f64>) -> Pair {
    [Vector3::new(v[0], v[1], v[2]), Vector3::new(v[3], v[4], v[5])]
}

pub(super) fn parts(v: &Pair) -> Parts {
    Parts::new(v[0].y, v[0].z, v[1].x, v[1].y, v[1].z)
}

pub(super) fn joined(normal: f64, s: &Parts) -> Pair {
    [Vector3::new(normal, s[0], s[1]), Vector3::new(s[2], s[3], s[4])]
}

#[cfg(test)]
mod tests {
    use super::super::tests::{REACHES, Random};
    use super::*;

    fn any_pair(random: &mut Random) -> Pair {
        [0, 1].map(|_| random.vector() * 2.0)
    }

    fn dot(a: &Pair, b: &Pair) -> f64 {
        a[0].dot(&b[0]) + a[1].dot(&b[1])
    }

    /// Tests Moreau's decomposition of a vector: its projection onto the cone is orthogonal to the remainder, which
    /// lies in the polar cone.
    #[test]
    fn projections_split_vectors_between_the_cone_and_its_polar() {
        let mut random = Random(7);
        for (mu, reach) in [0.0, 0.1, 0.7, 3.0].into_iter().flat_map(|mu| REACHES.map(|reach| (mu, reach))) {
            let cone = PatchCone { mu, reach };
            for _ in 0..500 {
                let v = any_pair(&mut random);
                let z = cone.project(v);
                let rest = [v[0] - z[0], v[1] - z[1]];
                // Scale errors by the support function of friction, which weighs torques by the radius of the patch.
                let size = 1.0 + cone.support(&v);
                assert!(dot(&z, &rest).abs() < 1e-12 * size, "{mu} {reach:?} {v:?} {z:?}");
                assert!(rest[0].x + cone.support(&rest) < 1e-12 * size, "{mu} {reach:?} {v:?}");
                let again = cone.project(z);
                assert!((again[0] - z[0]).norm() + (again[1] - z[1]).norm() < 1e-12, "{mu} {reach:?} {v:?}");
            }
        }
    }

    #[test]
    fn the_derivative_of_the_projection_is_that_of_differences() {
        let mut random = Random(3);
        for k in 0..600 {
            let reach = [(1.0, 1.0), (0.2, 0.05), (3.0, 0.0)][k % 3];
            let cone = PatchCone { mu: 0.6, reach: Reach { drill: reach.0, roll: reach.1 } };
            let (mut r, u) = (any_pair(&mut random), [Vector3::zeros(); 2]);
            r[0].x = r[0].x.abs() + 0.1;
            let (_, by_y) = cone.linearise(&r, &u);
            let direction = both(&any_pair(&mut random));
            let step = 1e-6;
            let at = |s: f64| {
                let r = both(&r) + direction * s;
                r - both(&cone.value(&pair(&r), &u))
            };
            let difference = (at(step) - at(-step)) / (2.0 * step);
            let error = (by_y * direction - difference).norm();
            assert!(error < 1e-5 * (1.0 + difference.norm()), "{r:?}: {error:e}");
        }
    }
}
