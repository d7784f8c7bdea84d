//! The values of the members of a sweep. The values of member `k` depend on the design, the seed and `k` alone, so
//! that members can be computed in any order and on any machine.

use super::range::Range;
use super::sobol::{MOST_DIMENSIONS, Sobol};
use crate::choices::choices;
use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};
use std::sync::OnceLock;

choices! {
    /// The construction of the members of a sweep from the ranges.
    DesignName {
        "grid" Grid: "Every combination of the points of the ranges; the last name varies fastest."
        "zip" Zip: "The first points of all ranges, the second points of all, and so on; all ranges have equally many."
        "random" Random: "`count` independent draws."
        "sobol" Sobol: "`count` points of the Sobol sequence with Owen's scrambling; preferably a power of two."
        "latin_hypercube" LatinHypercube: "`count` draws, one in each of `count` equally probable strata of every \
                                           range."
        "table" Table: "The rows of `table`."
    }
}

/// A design of a sweep: the ranges of the swept numbers, and the number of members.
#[derive(Clone, Debug)]
pub struct Design {
    kind: Kind,
    ranges: Vec<Range>,
    members: usize,
}

#[derive(Clone, Debug)]
enum Kind {
    Grid,
    Zip,
    /// Independent random draws for each member, with the seed of the random numbers.
    Random(u64),
    Sobol(Sobol),
    /// A Latin hypercube, with the seed of the random numbers and the stratum of each member in each dimension; the
    /// strata are computed on first use, since the check of a specification does not need them.
    LatinHypercube(u64, OnceLock<Vec<Vec<u32>>>),
}

/// Largest number of dimensions (swept numbers) of a Sobol design.
pub const MOST_SOBOL: usize = MOST_DIMENSIONS;

impl Design {
    /// Creates a design over ranges that suit it, with the given number of members; the ranges of a table are its
    /// columns.
    pub fn new(name: DesignName, ranges: Vec<Range>, members: usize, seed: u64) -> Self {
        let kind = match name {
            DesignName::Grid => Kind::Grid,
            DesignName::Zip | DesignName::Table => Kind::Zip,
            DesignName::Random => Kind::Random(seed),
            DesignName::Sobol => Kind::Sobol(Sobol::new(ranges.len(), seed)),
            DesignName::LatinHypercube => Kind::LatinHypercube(seed, OnceLock::new()),
        };
        Self { kind, ranges, members }
    }

    /// The number of members of the sweep.
    pub fn members(&self) -> usize {
        self.members
    }

    /// The range of values of each swept number.
    pub fn ranges(&self) -> &[Range] {
        &self.ranges
    }

    /// Whether the members of the sweep form a full grid, the Cartesian product of the points of all ranges.
    pub fn is_grid(&self) -> bool {
        matches!(self.kind, Kind::Grid)
    }

    /// Writes the values of the swept numbers in member `k` to `out`.
    pub fn write(&self, k: usize, out: &mut [f64]) {
        match &self.kind {
            Kind::Grid => {
                let mut rest = k;
                for (range, value) in self.ranges.iter().zip(out).rev() {
                    let points = range.points().unwrap_or(1).max(1);
                    *value = range.point(rest % points);
                    rest /= points;
                }
            }
            Kind::Zip => self.ranges.iter().zip(out).for_each(|(range, value)| *value = range.point(k)),
            Kind::Random(seed) => {
                let mut draws = draws(*seed, k as u64);
                self.ranges.iter().zip(out).for_each(|(range, value)| *value = range.quantile(unit(&mut draws)));
            }
            Kind::Sobol(sobol) => {
                for (d, (range, value)) in self.ranges.iter().zip(out).enumerate() {
                    *value = range.quantile(sobol.coordinate(k as u32, d));
                }
            }
            Kind::LatinHypercube(seed, slices) => {
                let slices = slices.get_or_init(|| {
                    (0..self.ranges.len() as u64).map(|d| permutation(self.members, *seed, d)).collect()
                });
                let mut draws = draws(*seed, k as u64);
                for ((range, slices), value) in self.ranges.iter().zip(slices).zip(out) {
                    let slice = slices.get(k).copied().unwrap_or(0);
                    let u = (f64::from(slice) + unit(&mut draws)) / self.members as f64;
                    *value = range.quantile(u.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON / 2.0));
                }
            }
        }
    }
}

/// Returns the random number stream of one member of the sweep.
fn draws(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut draws = ChaCha8Rng::seed_from_u64(seed);
    draws.set_stream(stream);
    draws
}

/// Draws a random number in `(0, 1)`: the midpoint of one of 2^52 cells.
fn unit(draws: &mut ChaCha8Rng) -> f64 {
    ((draws.next_u64() >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
}

/// Draws a random permutation of `0..count` (Fisher and Yates), from a random number stream that no member of the sweep
/// uses.
fn permutation(count: usize, seed: u64, dimension: u64) -> Vec<u32> {
    let mut draws = draws(seed, u64::MAX - dimension);
    let mut slices: Vec<u32> = (0..count as u32).collect();
    for k in (1..slices.len()).rev() {
        // The remainder of a 64-bit number has a negligible bias, below 2^-32.
        slices.swap(k, (draws.next_u64() % (k as u64 + 1)) as usize);
    }
    slices
}

#[cfg(test)]
mod tests {
    use super::super::range::Rule;
    use super::*;

    fn unit_range() -> Range {
        Range::Rule(Rule::Uniform((0.0, 1.0)))
    }

    fn members(design: &Design) -> Vec<Vec<f64>> {
        let mut values = vec![0.0; design.ranges.len()];
        let member = |k| {
            design.write(k, &mut values);
            values.clone()
        };
        (0..design.members).map(member).collect()
    }

    #[test]
    fn the_last_name_of_a_grid_varies_fastest() {
        let ranges = vec![Range::List(vec![1.0, 2.0]), Range::Rule(Rule::Linspace((0.0, 1.0, 3)))];
        let grid = members(&Design::new(DesignName::Grid, ranges, 6, 0));
        assert_eq!(grid, [[1.0, 0.0], [1.0, 0.5], [1.0, 1.0], [2.0, 0.0], [2.0, 0.5], [2.0, 1.0]]);
    }

    #[test]
    fn each_slice_of_a_latin_hypercube_has_one_member() {
        let design = Design::new(DesignName::LatinHypercube, vec![unit_range(); 3], 1000, 5);
        let members = members(&design);
        for d in 0..3 {
            let mut slices: Vec<usize> = members.iter().map(|member| (member[d] * 1000.0) as usize).collect();
            slices.sort_unstable();
            assert!(slices.iter().copied().eq(0..1000), "{d}");
        }
        assert!(members.iter().filter(|member| (member[0] - member[1]).abs() < 0.05).count() < 200);
    }

    #[test]
    fn draws_depend_on_the_seed_and_the_number_alone() {
        for name in [DesignName::Random, DesignName::Sobol] {
            let few = members(&Design::new(name, vec![unit_range(); 2], 10, 7));
            let many = members(&Design::new(name, vec![unit_range(); 2], 1000, 7));
            assert_eq!(few, many[..10]);
            assert_ne!(few, members(&Design::new(name, vec![unit_range(); 2], 10, 8)));
            let mean = many.iter().map(|member| member[0]).sum::<f64>() / 1000.0;
            assert!((mean - 0.5).abs() < 4.0 / 12.0_f64.sqrt() / 1000.0_f64.sqrt(), "{mean}");
        }
    }

    #[test]
    fn means_over_sobol_points_converge_faster_than_those_over_random_ones() {
        // The integral of x y e^(x y) over the unit square, by the series of the exponential: the sum of 1 / (k! (k +
        // 2)^2).
        let exact: f64 =
            (0..30).map(|k| (1..=k).map(f64::from).product::<f64>().recip() / f64::from(k + 2).powi(2)).sum();
        let error = |name, count: usize, seed| {
            let of = |member: &Vec<f64>| member[0] * member[1] * (member[0] * member[1]).exp();
            let members = members(&Design::new(name, vec![unit_range(); 2], count, seed));
            members.iter().map(of).sum::<f64>() / count as f64 - exact
        };
        let spread = |name, count| (0..16).map(|seed| f64::powi(error(name, count, seed), 2)).sum::<f64>().sqrt() / 4.0;
        for (name, least, most) in [(DesignName::Random, 0.35, 0.65), (DesignName::Sobol, 1.3, 1.8)] {
            let order = (spread(name, 64) / spread(name, 4096)).ln() / 64.0_f64.ln();
            assert!((least..most).contains(&order), "{name:?}: {order}");
        }
    }
}
