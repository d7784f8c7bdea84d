//! The cube root with identical results wherever the program is built: the cube roots of C libraries differ in the
//! last digit, even between the static and the dynamic library of one system.

/// Returns the cube root of any number, to within a unit in the last place: `powf`, corrected by a step of Newton's
/// method.
pub fn cube_root(a: f64) -> f64 {
    let size = a.abs();
    let root = size.powf(1.0 / 3.0);
    if root == 0.0 || !root.is_finite() {
        return root.copysign(a);
    }
    // Evaluate (root^3 - size) / (3 root^2) in factors that neither overflow nor vanish.
    (root - (root - size / root / root) / 3.0).copysign(a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubes_have_their_roots_at_every_size() {
        for k in 1..2000 {
            let root = f64::from(k);
            assert_eq!(cube_root(root * root * root), root);
            assert_eq!(cube_root(-root * root * root), -root);
        }
        for exponent in -350..340 {
            let root = 2.0_f64.powi(exponent);
            assert_eq!(cube_root(root * root * root), root);
        }
    }

    #[test]
    fn it_is_that_of_the_library_to_a_unit_in_the_last_place() {
        let mut a = 1e-300;
        while a < 1e300 {
            let (found, expected) = (cube_root(a), f64::cbrt(a));
            assert!((found - expected).abs() <= f64::EPSILON * expected, "{a}: {found} for {expected}");
            a *= 1.37;
        }
    }

    #[test]
    fn zeros_and_what_is_not_finite_stay() {
        assert_eq!(cube_root(0.0).to_bits(), 0.0_f64.to_bits());
        assert_eq!(cube_root(-0.0).to_bits(), (-0.0_f64).to_bits());
        assert_eq!(cube_root(f64::NEG_INFINITY), f64::NEG_INFINITY);
        assert!(cube_root(f64::NAN).is_nan());
    }
}
