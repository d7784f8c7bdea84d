//! Impulses and work over a step, by quadrature along the collocation polynomial.
//!
//! Where nothing moves, steps are long and forces may vary arbitrarily within a step. A part of a step is therefore
//! halved until the Gauss-Legendre rule with five nodes, of order ten, agrees with the rule on three of its nodes, of
//! order four: if the rule of order four has an error of `d`, that of order ten has an error of about `d^(10/4)`.

use super::EventDriven;
use super::mode::Status;
use super::smooth_phase::SmoothPhase;
use crate::delassus::dot;
use nalgebra::Vector3;

/// Gauss-Legendre nodes and weights on `[0, 1]`, and the weights of the rule on the first, third and fifth node.
const NODES: [f64; 5] =
    [0.046_910_077_030_668_004, 0.230_765_344_947_158_45, 0.5, 0.769_234_655_052_841_5, 0.953_089_922_969_332];
const WEIGHTS: [f64; 5] = [
    0.118_463_442_528_094_54,
    0.239_314_335_249_683_23,
    0.284_444_444_444_444_44,
    0.239_314_335_249_683_23,
    0.118_463_442_528_094_54,
];
const OF_THREE: [f64; 5] = [0.202_964_438_547_983_2, 0.0, 0.594_071_122_904_033_6, 0.0, 0.202_964_438_547_983_2];

/// The order of accuracy of the three-node rule divided by that of the five-node rule.
const ORDERS: f64 = 0.4;

/// The share of the relative tolerance of the run left to the quadrature of impulses and work.
const SHARE: f64 = 0.1;

/// The smallest part of the interval of integration that is halved, relative to the interval, and the largest number of
/// parts.
const SMALLEST: f64 = 1e-9;
const MOST_PARTS: usize = 4096;

/// Impulses of contacts, dissipation by friction, and the work of forces and of drives; or the time rates of all of
/// these.
#[derive(Clone, Debug)]
pub(super) struct Integrals {
    pub impulses: Vec<Vector3<f64>>,
    /// For each contact, the impulses that the contact law excludes: by normal forces that pull, and by friction
    /// beyond its bound.
    unlawful: Vec<[f64; 2]>,
    pub friction: f64,
    pub forces: f64,
    pub drives: f64,
}

impl Integrals {
    pub fn none(contacts: usize) -> Self {
        let (impulses, unlawful) = (vec![Vector3::zeros(); contacts], vec![[0.0; 2]; contacts]);
        Self { impulses, unlawful, friction: 0.0, forces: 0.0, drives: 0.0 }
    }

    pub fn add(&mut self, weight: f64, other: &Self) {
        self.impulses.iter_mut().zip(&other.impulses).for_each(|(sum, r)| *sum += r * weight);
        let unlawful = self.unlawful.iter_mut().zip(&other.unlawful);
        unlawful.for_each(|(sum, part)| sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += weight * part));
        self.friction += weight * other.friction;
        self.forces += weight * other.forces;
        self.drives += weight * other.drives;
    }

    /// Returns the scales of impulses and of energies: the sums of the absolute values of each.
    fn sizes(&self) -> [f64; 2] {
        let impulses = self.impulses.iter().map(Vector3::norm).sum();
        [impulses, self.friction.abs() + self.forces.abs() + self.drives.abs()]
    }
}

impl SmoothPhase<'_, '_> {
    /// Returns the impulses and the work between two times within the last step.
    pub(super) fn integrals(&mut self, begin: f64, end: f64) -> Integrals {
        let contacts = self.located.structure.contacts.len();
        let mut sum = Integrals::none(contacts);
        let least = SMALLEST * (end - begin);
        let tolerance = (SHARE * self.located.radau.rtol).powf(ORDERS);
        let atol = self.located.radau.atol[self.located.structure.coordinates..].iter().copied().fold(0.0, f64::max);
        let inside = self.parts.ends.iter().copied().filter(|t| begin < *t && *t < end);
        let ends: Vec<f64> = std::iter::once(begin).chain(inside).chain([end]).collect();
        let mut parts: Vec<(f64, f64)> = ends.windows(2).rev().map(|pair| (pair[0], pair[1])).collect();
        for passed in 1.. {
            let Some((a, b)) = parts.pop() else { break };
            let (mut five, mut error) = (Integrals::none(contacts), Integrals::none(contacts));
            let mut sizes = [0.0; 2];
            for ((node, weight), of_three) in NODES.into_iter().zip(WEIGHTS).zip(OF_THREE) {
                let rates = self.rates(a + node * (b - a));
                five.add(weight * (b - a), &rates);
                error.add((weight - of_three) * (b - a), &rates);
                sizes.iter_mut().zip(rates.sizes()).for_each(|(sum, size)| *sum += weight * (b - a) * size);
            }
            let [impulses, energy] = error.sizes();
            // An error of `atol` in velocities changes the energy by `atol` times the impulses; impulses have no
            // absolute tolerance.
            let rough = impulses > tolerance * sizes[0] || energy > tolerance * sizes[1] + atol * sizes[0];
            let middle = 0.5 * (a + b);
            if rough && b - a > least && a < middle && middle < b && passed + parts.len() < MOST_PARTS {
                parts.extend([(middle, b), (a, middle)]);
            } else {
                sum.add(1.0, &five);
            }
        }
        sum
    }

    /// Whether impulses that the contact law excludes change a velocity by more than the tolerances allow. The mode
    /// equations must have been evaluated within the last step.
    pub(super) fn is_unlawful(&self, integrals: &Integrals, v: &[f64]) -> bool {
        let EventDriven { structure, radau, .. } = &*self.located;
        let tolerances = radau.tolerances(v.len(), v);
        let is_large = |row: usize, impulse: f64| {
            let allowed = self.watch.constraints().size(row, &tolerances);
            impulse > 0.0 && self.watch.change_of_row(row, impulse).is_none_or(|change| change > allowed)
        };
        integrals.unlawful.iter().enumerate().any(|(k, [pull, beyond])| {
            is_large(structure.normal(k), *pull) || structure.tangents(k).any(|row| is_large(row, *beyond))
        })
    }

    /// Returns the contact forces and the powers at the time `t` within the last step.
    fn rates(&mut self, t: f64) -> Integrals {
        let n = self.located.structure.coordinates;
        let mut x = vec![0.0; 2 * n];
        self.at(t, &mut x);
        self.watch.evaluate_at(t, &x);
        self.note_violations(t, &x[..n]);
        let structure = &self.located.structure;
        let mut rates = Integrals::none(self.mode.len());
        for (k, force) in rates.impulses.iter_mut().enumerate().filter(|&(k, _)| self.mode[k].is_closed()) {
            force.x = self.watch.lambda[structure.normal(k)];
            let slip = self.watch.slip(k, &x[n..]);
            for (i, row) in structure.tangents(k).enumerate() {
                force[1 + i] = self.watch.lambda[row];
                rates.friction -= self.watch.lambda[row] * slip[i];
            }
            let excess = force.y.hypot(force.z) - self.watch.mu[k] * force.x;
            let beyond = if self.mode[k] == Status::Stick { excess.max(0.0) } else { 0.0 };
            rates.unlawful[k] = [(-force.x).max(0.0), beyond];
        }
        let energies = self.watch.problem().energies(t, &x[..n], &x[n..]);
        rates.forces = energies.power;
        rates.drives = energies.drive - dot(&self.watch.lambda, &self.watch.constraints().drift);
        rates
    }
}
