//! Test functions of multipliers or eigenvalues, and of the tangent of a branch, that change sign at bifurcations
//! (Kuznetsov 2004, *Elements of Applied Bifurcation Theory*, section 10.2). All are real, since complex numbers
//! occur in conjugate pairs.

use super::BranchEventKind;
use super::arclength::Test;
use nalgebra::{Complex, DVector};

/// Imaginary part, relative to the modulus, below which a pair of multipliers or eigenvalues counts as real: only a
/// complex pair gives a torus or an oscillation, not two real numbers with the same product or sum.
const REAL: f64 = 1e-6;

fn complex([re, im]: &[f64; 2]) -> Complex<f64> {
    Complex::new(*re, *im)
}

/// Returns the real part of a product of complex factors, each scaled to a modulus of at most one to avoid overflow.
fn product(factors: impl Iterator<Item = Complex<f64>>) -> f64 {
    factors.fold(Complex::new(1.0, 0.0), |product, factor| product * (factor / factor.norm().max(1.0))).re
}

/// Returns the component of the tangent of a branch along the parameter: zero at a fold.
fn fold(_: &[[f64; 2]], tangent: &DVector<f64>) -> f64 {
    tangent[tangent.len() - 1]
}

/// Returns `prod (1 - mu)` over the multipliers `mu` times the sign of the tangent's parameter component: the sign
/// changes where the branch meets another, and not at a fold, where both factors change sign.
fn branching_of_orbits(spectrum: &[[f64; 2]], tangent: &DVector<f64>) -> f64 {
    product(spectrum.iter().map(|value| Complex::new(1.0, 0.0) - complex(value))) * fold(spectrum, tangent).signum()
}

fn branching_of_rests(spectrum: &[[f64; 2]], tangent: &DVector<f64>) -> f64 {
    product(spectrum.iter().map(|value| -complex(value))) * fold(spectrum, tangent).signum()
}

/// Returns `prod (1 + mu)` over the multipliers `mu`: zero at a period doubling.
fn flip(spectrum: &[[f64; 2]], _: &DVector<f64>) -> f64 {
    product(spectrum.iter().map(|value| Complex::new(1.0, 0.0) + complex(value)))
}

fn pairs(spectrum: &[[f64; 2]]) -> impl Iterator<Item = (Complex<f64>, Complex<f64>)> + '_ {
    (0..spectrum.len()).flat_map(move |i| (0..i).map(move |j| (complex(&spectrum[i]), complex(&spectrum[j]))))
}

/// Returns `prod (1 - mu_i mu_j)` over pairs of multipliers: zero where a complex pair is on the unit circle.
fn torus(spectrum: &[[f64; 2]], _: &DVector<f64>) -> f64 {
    product(pairs(spectrum).map(|(a, b)| Complex::new(1.0, 0.0) - a * b))
}

/// Returns `prod (lambda_i + lambda_j)` over pairs of eigenvalues: zero where a pair is imaginary.
fn oscillation(spectrum: &[[f64; 2]], _: &DVector<f64>) -> f64 {
    product(pairs(spectrum).map(|(a, b)| a + b))
}

/// The test functions of periodic orbits, with the bifurcations that they detect.
pub(super) const OF_ORBITS: [(Test, BranchEventKind); 4] = [
    (fold, BranchEventKind::Fold),
    (branching_of_orbits, BranchEventKind::Branching),
    (flip, BranchEventKind::Flip),
    (torus, BranchEventKind::NeimarkSacker),
];

/// The test functions of steady states, with the bifurcations that they detect.
pub(super) const OF_RESTS: [(Test, BranchEventKind); 3] = [
    (fold, BranchEventKind::Fold),
    (branching_of_rests, BranchEventKind::Branching),
    (oscillation, BranchEventKind::Hopf),
];

/// Whether the zero of a test function is the bifurcation `kind`: for tori and oscillations the pair of multipliers or
/// eigenvalues must be complex.
pub(super) fn is_confirmed(kind: BranchEventKind, spectrum: &[[f64; 2]]) -> bool {
    let nearest = |off: fn(Complex<f64>, Complex<f64>) -> f64| {
        pairs(spectrum).min_by(|a, b| off(a.0, a.1).total_cmp(&off(b.0, b.1)))
    };
    let pair = match kind {
        BranchEventKind::NeimarkSacker => nearest(|a, b| (Complex::new(1.0, 0.0) - a * b).norm()),
        BranchEventKind::Hopf => nearest(|a, b| (a + b).norm()),
        _ => return true,
    };
    pair.is_some_and(|(a, b)| a.im.abs() > REAL * a.norm() && (a - b.conj()).norm() <= REAL * a.norm())
}
