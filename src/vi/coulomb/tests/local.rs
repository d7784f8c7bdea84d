//! Tests of the exact solution of one contact.

use super::super::{Evidence, solve_contact};
use super::{Random, problem};
use nalgebra::{DMatrix, Matrix3, Vector3};

#[test]
fn a_block_opens_sticks_or_slips_as_coulomb_says() {
    let (mass, mu) = (2.0, 0.5);
    let matrix = Matrix3::identity() / mass;
    let solve = |q| solve_contact(&matrix, &q, mu).expect("a solution");
    assert_eq!(solve(Vector3::new(0.1, 3.0, -1.0)), Vector3::zeros());
    assert_eq!(solve(Vector3::new(-1.0, 0.3, -0.39)), Vector3::new(2.0, -0.6, 0.78));
    // The block slips along (3, 4), and friction of the size `mu m |q_n|` opposes the slip.
    let r = solve(Vector3::new(-1.0, 3.0, 4.0));
    assert!((r - Vector3::new(2.0, -0.6, -0.8)).amax() < 1e-15);
}

#[test]
fn random_contacts_are_solved_to_rounding() {
    let mut random = Random(7);
    for case in 0..20_000 {
        let factor = random.matrix();
        let skew = Vector3::new(random.number(), random.number(), random.number()).cross_matrix();
        let scale = 10_f64.powf(4.0 * random.number());
        let matrix = (factor * factor.transpose() + Matrix3::identity() * 1e-3 + skew * 0.05) * scale;
        let q = random.vector();
        let mu = [0.0, 0.1, 0.7, 3.0][case % 4];
        let r = solve_contact(&matrix, &q, mu).expect("a solution");
        let dense = DMatrix::from_iterator(3, 3, matrix.iter().copied());
        let evidence = Evidence::of(&problem(&dense, vec![q], vec![mu]), &[r]);
        // The inverse of W amplifies rounding by its condition number, up to some 1e4 in these cases.
        assert!(evidence.relative < 1e-11, "case {case}: W {matrix} q {q} mu {mu} r {r}: {evidence:?}");
    }
}

#[test]
fn a_contact_that_cannot_slip_one_way_is_solved() {
    // A bead on a wire along the first tangent: the second tangential motion is blocked.
    let matrix = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
    let r = solve_contact(&matrix, &Vector3::new(-1.0, 2.0, 0.0), 0.5).expect("a solution");
    assert!((r - Vector3::new(1.0, -0.5, 0.0)).amax() < 1e-12, "{r}");
}

#[test]
fn nothing_stops_what_no_impulse_moves() {
    assert_eq!(solve_contact(&Matrix3::zeros(), &Vector3::new(-1.0, 0.0, 0.0), 0.5), None);
    assert_eq!(solve_contact(&Matrix3::zeros(), &Vector3::new(1.0, 0.0, 0.0), 0.5), Some(Vector3::zeros()));
}
