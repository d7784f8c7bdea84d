//! The friction of a disc with uniform pressure that slides and drills (Contensou 1963, *Couplage entre frottement de
//! glissement et frottement de pivotement dans la theorie de la toupie*; closed forms as in Farkas, Bartels, Unger
//! and Wolf 2003, *Frictional coupling between sliding and spinning motion*). For unit radius, normal force and
//! coefficient, the power of friction at the speed `v` and the angular velocity `w` about the normal is the mean
//! speed
//!
//! ```text
//! sigma(v, w) = 1/pi int |v + w x r| dA,    force f = d sigma / d v,    torque tau = d sigma / d w
//! ```
//!
//! `sigma` is the support function of a smooth convex set `L`, the limit surface, from `f = 1` in pure sliding to
//! `tau = 2/3` in pure drilling. With `(v, w) = (cos p, sin p)` and the complete elliptic integrals `B`, `D` and `C` of
//! the modulus `k = min(v/w, w/v)`,
//!
//! ```text
//! v >= w:  f = 4/(3 pi) (2 B + k'^2 D),      tau = 4 k/(9 pi) (3 B - D + C)
//! v <= w:  f = 4 k/(3 pi) (2 B + k'^2 D),    tau = 4/(9 pi) ((3 - k^2) B + (3 - 2 k^2) k'^2 D)
//! ```
//!
//! in which no terms cancel. The radius of curvature `sigma + sigma''` along the surface is `4/(3 pi) (1 +
//! k^2)^(3/2)` times `D - C` for `v >= w`, or `B + 2 k'^2 D` for `v <= w`.

use std::f64::consts::{FRAC_PI_2, PI};

/// The squared modulus of the elliptic integrals below which sums of equal weights are used, which converge as
/// `0.17^24`; above it the arithmetic-geometric mean is used.
const SMALL: f64 = 0.5;

/// `sin^2` at the midpoints of twelve equal parts of a quarter turn.
const SINES: [f64; 12] = [
    0.004_277_569_313_094_794,
    0.038_060_233_744_356_62,
    0.103_323_329_854_382_42,
    0.195_619_285_495_639_64,
    0.308_658_283_817_455_1,
    0.434_736_903_889_974_16,
    0.565_263_096_110_025_8,
    0.691_341_716_182_544_7,
    0.804_380_714_504_360_6,
    0.896_676_670_145_617_5,
    0.961_939_766_255_643_4,
    0.995_722_430_686_905_1,
];

/// Largest number of iterations for the normal of the surface point nearest to a given point. The bracket of the
/// normal halves in each iteration, and Newton's method takes three to six.
const ITERATIONS: usize = 100;

/// Relative accuracy of the direction of the normal of the nearest surface point.
const ACCURACY: f64 = 1e-16;

/// A point of the limit surface of friction force and torque, with its normal.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Point {
    /// The normal `(cos p, sin p)` of the surface at the point.
    pub normal: [f64; 2],
    /// The force and the torque, the coordinates of the point.
    pub at: [f64; 2],
    /// The force divided by the first component `cos p` of the normal.
    pub across: f64,
    /// The radius of curvature of the surface at the point.
    pub radius: f64,
}

/// Computes the complete elliptic integrals `B`, `k'^2 D`, `3 B - D + C` and `D - C` for the squared modulus `m =
/// k^2`.
fn integrals(m: f64) -> [f64; 4] {
    let rest = 1.0 - m;
    if m < SMALL {
        let (mut b, mut d, mut c) = (0.0, 0.0, 0.0);
        for s in SINES {
            let inverse = (1.0 - m * s).sqrt().recip();
            b += (1.0 - s) * inverse;
            d += s * inverse;
            c += s * (1.0 - s) * inverse * inverse * inverse;
        }
        let weight = FRAC_PI_2 / SINES.len() as f64;
        let [b, d, c] = [b, d, c].map(|sum| sum * weight);
        return [b, rest * d, 3.0 * b - d + c, d - c];
    }
    // The complete elliptic integral E, and k'^2 K, which vanishes with k'.
    let (e, of_k) = if rest <= 0.0 {
        (1.0, 0.0)
    } else {
        let (mut a, mut g, mut sum, mut power, mut c) = (1.0_f64, rest.sqrt(), 0.5 * m, 0.5, m.sqrt());
        while c.abs() > f64::EPSILON * a {
            c = 0.5 * (a - g);
            (a, g) = (0.5 * (a + g), (a * g).sqrt());
            power *= 2.0;
            sum += power * c * c;
        }
        let k = FRAC_PI_2 / a;
        (k * (1.0 - sum), rest * k)
    };
    let (b, d) = ((e - of_k) / m, (of_k - rest * e) / m);
    [b, d, b * (3.0 - 1.0 / m) + d / m, (b - d) / m]
}

impl Point {
    /// Returns the point with a normal of direction `(v, w)` of the surface stretched by `a` along the torque. The
    /// support function of the stretched surface is `sigma(v, a w)`. Its radius of curvature is `a^2 / s^3` times
    /// that of the original surface at the normal `(cos p, sin p)`, where `(v, a w) = s (cos p, sin p)`: the
    /// stretching has the determinant `a`.
    fn stretched(v: f64, w: f64, a: f64) -> Self {
        let size = v.hypot(w);
        let normal = [v / size, w / size];
        let Self { at, across, radius, .. } = Self::of(normal[0], a * normal[1]);
        let s = normal[0].hypot(a * normal[1]);
        Self { normal, at: [at[0], a * at[1]], across: across / s, radius: radius * (a / s) * (a / s) / s }
    }

    /// Returns the point of the limit surface whose normal has the direction `(v, w)`, both at least zero and not both
    /// zero.
    pub fn of(v: f64, w: f64) -> Self {
        let size = v.hypot(w);
        let normal = [v / size, w / size];
        let k = if v >= w { w / v } else { v / w };
        let [b, d, twist, bend] = integrals(k * k);
        let third = 4.0 / (3.0 * PI);
        let stretch = (1.0 + k * k).sqrt();
        let force = third * (2.0 * b + d);
        let curve = third * stretch * stretch * stretch;
        if v >= w {
            let at = [force, third / 3.0 * k * twist];
            Self { normal, at, across: force * stretch, radius: curve * bend }
        } else {
            let m = k * k;
            let at = [k * force, third / 3.0 * ((3.0 - m) * b + (3.0 - 2.0 * m) * d)];
            Self { normal, at, across: force * stretch, radius: curve * (b + 2.0 * d) }
        }
    }

    /// Returns the support function `sigma` of the limit surface at the normal of this point.
    pub fn support(&self) -> f64 {
        self.at[0] * self.normal[0] + self.at[1] * self.normal[1]
    }

    /// Returns the slope `d sigma / d p` of the support function by the angle of the normal.
    pub fn slope(&self) -> f64 {
        self.at[1] * self.normal[0] - self.at[0] * self.normal[1]
    }

    /// Returns the point nearest to `(b, c)`, both at least zero, of the set `scale L` stretched by `a > 0` along the
    /// torque, and its distance; returns `None` if `(b, c)` lies in the set.
    ///
    /// Where the distance to the supporting line with the normal `n`, `(b, c) n - scale sigma(n)`, is stationary,
    /// `(b, c)` lies on the normal line. It is outside the set if that distance is positive, and inside otherwise,
    /// since the set contains all smaller multiples of its points. Normals are pairs, not angles, so that small
    /// components keep their digits where the set is flat or long.
    pub fn nearest(b: f64, c: f64, scale: f64, a: f64) -> Option<(Self, f64)> {
        if b + c <= 0.0 {
            return None;
        }
        let (mut lower, mut upper) = ([1.0, 0.0], [0.0, 1.0]);
        let turn = |from: [f64; 2], to: [f64; 2]| from[0] * to[1] - from[1] * to[0];
        let size = b + c + scale;
        let mut point = Self::stretched(b, c, a);
        for _ in 0..ITERATIONS {
            let [x, y] = [b - scale * point.at[0], c - scale * point.at[1]];
            let [cosine, sine] = point.normal;
            let (along, distance) = (y * cosine - x * sine, x * cosine + y * sine);
            if along.abs() <= ACCURACY * size {
                break;
            }
            *if along > 0.0 { &mut lower } else { &mut upper } = point.normal;
            let angle = along / (distance + scale * point.radius);
            let newton = [cosine - angle * sine, sine + angle * cosine];
            let is_between = turn(lower, newton) > 0.0 && turn(newton, upper) > 0.0;
            let next = if is_between { newton } else { [lower[0] + upper[0], lower[1] + upper[1]] };
            let last = point.normal;
            point = Self::stretched(next[0], next[1], a);
            if point.normal == last {
                break;
            }
        }
        let distance = (b - scale * point.at[0]) * point.normal[0] + (c - scale * point.at[1]) * point.normal[1];
        (distance > 0.0).then_some((point, distance))
    }
}

/// Returns the mean speed `sigma(v, w)` of a disc of unit radius that slides at `v` and drills at `w`.
pub fn mean_speed(v: f64, w: f64) -> f64 {
    let (v, w) = (v.abs(), w.abs());
    if v + w > 0.0 { Point::of(v, w).support() * v.hypot(w) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the force, torque and power of friction by numerical integration over the disc.
    fn summed(v: f64, w: f64) -> [f64; 3] {
        let (rings, parts) = (400, 400);
        let mut sums = [0.0; 3];
        for i in 0..rings {
            let r = (f64::from(i) + 0.5) / f64::from(rings);
            for j in 0..parts {
                let (sine, cosine) = (2.0 * PI * (f64::from(j) + 0.5) / f64::from(parts)).sin_cos();
                let (x, y) = (v - w * r * sine, w * r * cosine);
                let speed = x.hypot(y);
                let weight = 2.0 * r / f64::from(rings * parts);
                let values = [x / speed, r * (y * cosine - x * sine) / speed, speed];
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        sums
    }

    #[test]
    fn force_torque_and_power_are_the_integrals_over_the_disc() {
        for (v, w) in [(1.0, 0.0), (1.0, 0.1), (1.0, 0.6), (1.0, 0.99), (0.9, 1.0), (0.5, 1.0), (0.05, 1.0), (0.0, 1.0)]
        {
            let point = Point::of(v, w);
            let [force, torque, power] = summed(v, w);
            let found = [point.at[0] - force, point.at[1] - torque, mean_speed(v, w) - power];
            assert!(found.iter().all(|error| error.abs() < 2e-5), "{v} {w}: {found:?}");
        }
        assert!(
            (Point::of(0.0, 1.0).at[1] - 2.0 / 3.0).abs() < 1e-15 && (Point::of(1.0, 0.0).at[0] - 1.0).abs() < 1e-15
        );
    }

    #[test]
    fn the_radius_of_curvature_is_that_of_the_surface() {
        let step = 1e-5;
        for stretch in [1.0, 0.3, 4.0] {
            for k in 0..32 {
                let angle = 0.02 + 0.048 * f64::from(k);
                let at = |angle: f64| Point::stretched(angle.cos(), angle.sin(), stretch);
                let (before, after) = (at(angle - step).at, at(angle + step).at);
                let arc = (after[0] - before[0]).hypot(after[1] - before[1]) / (2.0 * step);
                let radius = at(angle).radius;
                assert!((arc - radius).abs() < 1e-6 * (1.0 + radius), "{stretch} {angle}: {arc} {radius}");
            }
        }
    }

    #[test]
    fn a_point_on_a_normal_has_its_foot_there() {
        for stretch in [1.0, 1e-12, 1e-6, 1e-3, 0.1, 10.0, 1e4, 1e8] {
            for k in 0..=20 {
                // Take normals whose directions are spread evenly in the plane, and others that are spread evenly
                // over the stretched surface.
                let angle = FRAC_PI_2 * f64::from(k) / 20.0;
                for (v, w) in [(angle.cos().max(0.0) * stretch, angle.sin()), (angle.cos().max(0.0), angle.sin())] {
                    let point = Point::stretched(v, w, stretch);
                    for (scale, away) in [(1.0, 1e-9), (0.3, 0.2), (2.0, 50.0), (0.0, 1.0)] {
                        let place = |i: usize| (scale * point.at[i] + away * point.normal[i]).max(0.0);
                        let (x, y) = (place(0), place(1));
                        let size = x.max(y).max(away);
                        let Some((found, distance)) = Point::nearest(x, y, scale, stretch) else {
                            assert!(away < 1e-15 * size, "{stretch} {v} {w} {scale} {away}");
                            continue;
                        };
                        assert!((distance - away).abs() < 1e-13 * size, "{stretch} {v} {w} {scale} {away}: {distance}");
                        let off = (0..2).map(|i| (scale * (found.at[i] - point.at[i])).abs()).fold(0.0, f64::max);
                        assert!(off < 1e-7 * size, "{stretch} {v} {w} {scale} {away}: {off}");
                    }
                    let inside = Point::nearest(0.999 * point.at[0], 0.999 * point.at[1], 1.0, stretch);
                    assert!(inside.is_none(), "{stretch} {v} {w}");
                }
            }
        }
    }
}
