//! Tests of the Delassus operator in factored form, and of sweeps with a proximal term.

use super::Random;
use crate::Outcome;
use crate::coulomb::{
    BlockMatrix, Coulomb, CoulombProblem, Factored, FrictionCone, Grip, Limits, Mobility, ProximalSweeps,
};
use nalgebra::{Matrix3, Vector3};
use problem::Control;

/// Returns contacts of random bodies with each other and with the ground, and the blocks `J_k M^-1 J_l^T` of their
/// operator.
fn random_contacts(random: &mut Random, bodies: u32, contacts: usize) -> (Factored, BlockMatrix) {
    let mobilities: Vec<Mobility> = (0..bodies)
        .map(|_| {
            let matrix = random.matrix();
            Mobility { linear: 1.0 + random.number().abs(), angular: matrix * matrix.transpose() + Matrix3::identity() }
        })
        .collect();
    let grips: Vec<Grip> = (0..contacts as u32)
        .map(|k| Grip {
            bodies: [(k % 3 != 0).then_some(k % bodies), Some((k + 1) % bodies)],
            frame: random.matrix(),
            arms: [random.vector(), random.vector()],
        })
        .collect();
    let side = |grip: &Grip, body: u32| {
        let on = |side: usize| grip.bodies[side] == Some(body);
        let zero = Matrix3::zeros();
        match (on(0), on(1)) {
            (true, _) => (-grip.frame, grip.frame * grip.arms[0].cross_matrix()),
            (_, true) => (grip.frame, -grip.frame * grip.arms[1].cross_matrix()),
            _ => (zero, zero),
        }
    };
    let block = |k: &Grip, l: &Grip| {
        (0..bodies).fold(Matrix3::zeros(), |sum, body| {
            let ((e_k, a_k), (e_l, a_l)) = (side(k, body), side(l, body));
            let mobility = &mobilities[body as usize];
            sum + e_k * e_l.transpose() * mobility.linear + a_k * mobility.angular * a_l.transpose()
        })
    };
    let blocks = (0..contacts).flat_map(|k| (0..contacts).map(move |l| (k, l)));
    let blocks = BlockMatrix::from_blocks(contacts, blocks.map(|(k, l)| (k, l, block(&grips[k], &grips[l]))));
    (Factored::new(mobilities.clone(), grips), blocks.expect("indices in range"))
}

#[test]
fn factors_and_blocks_are_one_operator() {
    let mut random = Random(1);
    let (factors, blocks) = random_contacts(&mut random, 5, 12);
    let r: Vec<Vector3<f64>> = (0..12).map(|_| random.vector()).collect();
    let mut twists = Vec::new();
    factors.twists(&r, &mut twists);
    for (k, product) in factors.product(&r).iter().enumerate() {
        assert!((product - blocks.row_product(k, &r)).norm() < 1e-12);
        assert!((factors.diagonal(k) - blocks.diagonal(k)).norm() < 1e-12);
    }
    // Update the velocities of the bodies for a change of one impulse, and compare with the product of the operator
    // and all impulses.
    let change = random.vector();
    factors.push(7, &change, &mut twists);
    let mut more = r;
    more[7] += change;
    let product = factors.product(&more);
    assert!((0..12).all(|k| (product[k] - factors.row_product(k, &twists)).norm() < 1e-12));
}

#[test]
fn sweeps_in_factors_find_the_solution_of_the_other_methods() {
    let mut random = Random(2);
    let mut solved = 0;
    for _ in 0..20 {
        // Take as many contacts as bodies: impulses are then mostly unique.
        let (factors, blocks) = random_contacts(&mut random, 6, 6);
        let q: Vec<Vector3<f64>> = (0..6).map(|_| random.vector()).collect();
        let mu = vec![0.3; 6];
        let problem = CoulombProblem::new(blocks, q.clone(), mu.clone()).unwrap();
        let mut known = vec![Vector3::zeros(); 6];
        let limits = Limits::default();
        let report = Coulomb::new(limits).solve(&problem, &mut known, &Control::new());
        let mut r = vec![Vector3::zeros(); 6];
        let found = ProximalSweeps::default().solve(&factors, &q, &mu, &mut r, &limits, &Control::new());
        if report.outcome == Outcome::Solved && found.report.evidence.relative < 1e-9 {
            let off = r.iter().zip(&known).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            solved += usize::from(off < 1e-7);
        }
    }
    assert!(solved >= 15, "{solved} of 20");
}

/// Four contacts under the corners of a plate: the law with a proximal term has a solution to any tolerance, which
/// carries the weight and has every impulse in its cone, though the law without the term has many solutions.
#[test]
fn redundant_contacts_carry_the_weight() {
    let plate = Mobility { linear: 0.5, angular: Matrix3::from_diagonal(&Vector3::new(3.0, 3.0, 1.5)) };
    let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
    let frame = Matrix3::from_rows(&[Vector3::z().transpose(), Vector3::x().transpose(), Vector3::y().transpose()]);
    let grip = |&(x, y): &(f64, f64)| Grip {
        bodies: [None, Some(0)],
        frame,
        arms: [Vector3::zeros(), Vector3::new(x, y, -0.1)],
    };
    let factors = Factored::new([plate], corners.iter().map(grip));
    // The plate falls at 1 and slides at 0.2 along x: a friction coefficient of 0.5 stops both.
    let q = vec![Vector3::new(-1.0, 0.2, 0.0); 4];
    let mut r = vec![Vector3::zeros(); 4];
    let limits = Limits { tolerance: 1e-12, ..Limits::default() };
    let found = ProximalSweeps::default().solve(&factors, &q, &[0.5; 4], &mut r, &limits, &Control::new());
    assert_eq!(found.report.outcome, Outcome::Solved);
    let sum: Vector3<f64> = r.iter().sum();
    assert!((sum - Vector3::new(2.0, -0.4, 0.0)).norm() < 1e-9, "{sum}");
    let cone = FrictionCone { mu: 0.5 };
    assert!(r.iter().all(|r| (cone.project(*r) - r).norm() < 1e-12));
}
