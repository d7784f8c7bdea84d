use super::*;
use nalgebra::{DMatrix, Matrix3};

/// Returns the Delassus operator of the contacts of a row of balls, each contact between two neighbours, in the
/// normal direction alone.
fn line(masses: &[f64]) -> BlockMatrix {
    let n = masses.len() - 1;
    let mut blocks = Vec::new();
    for k in 0..n {
        let own = 1.0 / masses[k] + 1.0 / masses[k + 1];
        blocks.push((k, k, Matrix3::from_diagonal(&Vector3::new(own, own, own))));
        if k + 1 < n {
            let coupling = Matrix3::from_diagonal(&Vector3::new(-1.0 / masses[k + 1], 0.0, 0.0));
            blocks.extend([(k, k + 1, coupling), (k + 1, k, coupling)]);
        }
    }
    BlockMatrix::from_blocks(n, blocks).unwrap()
}

fn strike(
    delassus: &BlockMatrix,
    before: &[Vector3<f64>],
    mu: f64,
    restitution: &[f64],
) -> (Vec<Vector3<f64>>, Report) {
    let n = before.len();
    let contacts = Contacts {
        delassus: Delassus::Blocks(delassus),
        free: before,
        before,
        gap: &vec![0.0; n],
        mu: &vec![mu; n],
        restitution,
        cone: &vec![Cone::Quadratic; n],
        roles: &[],
        h: 1e-3,
    };
    let mut r = vec![Vector3::zeros(); n];
    let report = Law::new(1e-12).impulses(&contacts, &mut r, &Control::new());
    assert_eq!(report.outcome, Outcome::Solved);
    (r, report)
}

fn velocities(masses: &[f64], v: &[f64], r: &[Vector3<f64>]) -> Vec<f64> {
    let mut v = v.to_vec();
    for (k, r) in r.iter().enumerate() {
        v[k] -= r.x / masses[k];
        v[k + 1] += r.x / masses[k + 1];
    }
    v
}

#[test]
fn a_row_of_balls_struck_at_once_shares_the_blow() {
    // By Moreau's law with e = 1, v_1 = -(n - 2)/n, and the other velocities are 2/n.
    for n in [3, 5, 8] {
        let masses = vec![1.0; n];
        let mut before = vec![Vector3::zeros(); n - 1];
        before[0].x = -1.0;
        let (r, report) = strike(&line(&masses), &before, 0.0, &vec![1.0; n - 1]);
        let mut v = vec![0.0; n];
        v[0] = 1.0;
        let v = velocities(&masses, &v, &r);
        let share = 2.0 / n as f64;
        assert!((v[0] + (n as f64 - 2.0) / n as f64).abs() < 1e-13, "{v:?}");
        assert!(v[1..].iter().all(|v| (v - share).abs() < 1e-13), "{v:?}");
        assert_eq!(report.restitution, 1.0);
    }
}

#[test]
fn balls_struck_one_after_the_other_hand_the_blow_to_the_last() {
    let masses = [1.0; 5];
    let delassus = line(&masses);
    let before = [Vector3::new(-1.0, 0.0, 0.0), Vector3::zeros(), Vector3::zeros(), Vector3::zeros()];
    let contacts = Contacts {
        delassus: Delassus::Blocks(&delassus),
        free: &before,
        before: &before,
        gap: &[0.0; 4],
        mu: &[0.0; 4],
        restitution: &[1.0; 4],
        cone: &[Cone::Quadratic; 4],
        roles: &[],
        h: 1e-3,
    };
    let strikes = sequential(&contacts);
    assert_eq!(strikes.len(), 4);
    let mut r = vec![Vector3::zeros(); contacts.gap.len()];
    strikes.iter().for_each(|&(k, strike)| r[k] += strike);
    let v = velocities(&masses, &[1.0, 0.0, 0.0, 0.0, 0.0], &r);
    assert!(v[..4].iter().all(|v| v.abs() < 1e-15) && (v[4] - 1.0).abs() < 1e-15, "{v:?}");
}

/// A rod that strikes a rough floor with one end while it turns: Kane and Levinson's example, in which Newton's law
/// with Coulomb friction adds energy, over many angles and spins.
#[test]
fn no_energy_is_added_where_newtons_law_would_add_some() {
    let mut limited = 0;
    for i in 0..40 {
        for spin in [-6.0, -2.0, 0.0, 3.0, 8.0] {
            let angle = 0.1 + 0.035 * f64::from(i);
            let (sine, cosine) = angle.sin_cos();
            // A rod of unit mass, half length 1 and inertia 1/3: rows of the constraint Jacobian of its lower end by
            // (x, y, angle).
            let (n, t) = ([0.0, 1.0, -cosine], [1.0, 0.0, sine]);
            let inverse = [1.0, 1.0, 3.0];
            let dot = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|i| a[i] * inverse[i] * b[i]).sum::<f64>();
            let (nn, nt, tt) = (dot(&n, &n), dot(&n, &t), dot(&t, &t));
            let w = Matrix3::new(nn, nt, 0.0, nt, tt, 0.0, 0.0, 0.0, nn);
            let delassus = BlockMatrix::from_blocks(1, [(0, 0, w)]).unwrap();
            let v = [0.2, -1.0, spin];
            let along = |a: &[f64; 3]| (0..3).map(|i| a[i] * v[i]).sum::<f64>();
            let before = [Vector3::new(along(&n), along(&t), 0.0)];
            if before[0].x >= 0.0 {
                continue;
            }
            let (r, report) = strike(&delassus, &before, 0.5, &[1.0]);
            limited += usize::from(report.restitution < 1.0);
            let after: Vec<f64> = (0..3).map(|i| v[i] + inverse[i] * (n[i] * r[0].x + t[i] * r[0].y)).collect();
            let energy = |v: &[f64]| v.iter().zip(inverse).map(|(v, i)| 0.5 * v * v / i).sum::<f64>();
            assert!(
                energy(&after) <= energy(&v) * (1.0 + 1e-12),
                "{angle} {spin}: {} > {}",
                energy(&after),
                energy(&v)
            );
            assert!(r[0].y.abs() <= 0.5 * r[0].x * (1.0 + 1e-12), "outside the friction cone");
        }
    }
    assert!(limited > 0, "in none of the cases Newton's law adds energy");
}

#[test]
fn an_open_gap_may_close_and_no_more() {
    let delassus = BlockMatrix::from_blocks(1, [(0, 0, Matrix3::identity())]).unwrap();
    let free = [Vector3::new(-3.0, 0.0, 0.0)];
    let contacts = Contacts {
        delassus: Delassus::Blocks(&delassus),
        free: &free,
        before: &free,
        gap: &[2e-3],
        mu: &[0.0],
        restitution: &[0.0],
        cone: &[Cone::Quadratic],
        roles: &[],
        h: 1e-3,
    };
    let mut r = [Vector3::zeros()];
    Law::new(1e-12).impulses(&contacts, &mut r, &Control::new());
    assert!((contacts.gap[0] + contacts.h * contacts.after(&r)[0].x).abs() < 1e-15);
    // With restitution 0.5 the contact leaves with half of its approach velocity.
    let contacts = Contacts { restitution: &[0.5], ..contacts };
    Law::new(1e-12).impulses(&contacts, &mut r, &Control::new());
    assert!((contacts.after(&r)[0].x - 1.5).abs() < 1e-15);
}

#[test]
fn polygons_with_more_corners_come_to_the_disk() {
    // A random symmetric positive definite Delassus operator `W` of three contacts.
    let a = DMatrix::from_fn(9, 9, |i, j| ((i * 7 + j * 13) % 11) as f64 / 11.0 - 0.4);
    let w = &a * a.transpose() + DMatrix::identity(9, 9);
    let blocks = (0..9).map(|b| (b / 3, b % 3, w.fixed_view::<3, 3>(3 * (b / 3), 3 * (b % 3)).into_owned()));
    let delassus = BlockMatrix::from_blocks(3, blocks).unwrap();
    let free = [Vector3::new(-1.0, 2.0, 0.5), Vector3::new(-2.0, -1.0, 1.0), Vector3::new(-0.5, 0.3, -2.0)];
    let solve = |cone: Cone| {
        let contacts = Contacts {
            delassus: Delassus::Blocks(&delassus),
            free: &free,
            before: &free,
            gap: &[0.0; 3],
            mu: &[0.3; 3],
            restitution: &[0.0; 3],
            cone: &[cone; 3],
            roles: &[],
            h: 1e-3,
        };
        let mut r = [Vector3::zeros(); 3];
        let report = Law::new(1e-12).impulses(&contacts, &mut r, &Control::new());
        assert_eq!(report.outcome, Outcome::Solved);
        r
    };
    let exact = solve(Cone::Quadratic);
    let distance = |corners: usize| {
        let r = solve(Cone::Polyhedral(corners));
        r.iter().zip(&exact).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    };
    let (coarse, fine) = (distance(4), distance(64));
    assert!(coarse > 1e-3 && fine < 0.1 * coarse, "{coarse} {fine}");
}

#[test]
fn a_block_on_two_corners_whose_slips_differ_by_rounding_is_struck_by_the_law() {
    // A block that stands, tilted by a tiny angle, on two corners at (-b, -h) and (b, -h) from its centre, or hangs
    // from them like a pendulum.
    let (b, h, mu) = (0.1649, 0.3317, 0.1);
    let inertia = (b * b + h * h) / 3.0;
    for digits in 4..16 {
        for (upright, spin) in [(1.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (-1.0, 1.0)] {
            let tilt = 10.0_f64.powi(-digits);
            let (sine, cosine) = (upright * tilt, upright * (1.0 - 0.5 * tilt * tilt));
            // Rows of the constraint Jacobian `J` by angle, x and y: a normal and a slip of each corner.
            let corner = |side: f64| {
                [[-side * b * cosine + h * sine, 0.0, 1.0], [side * b * sine + h * cosine, 1.0, 0.0], [0.0; 3]]
            };
            let corners = [corner(1.0), corner(-1.0)];
            let v = [spin * 7.4e-4, 2.4e-4, -1e-4];
            let masses = [inertia, 1.0, 1.0];
            let block = |k: usize, l: usize| {
                let entry = |i: usize, j: usize| (0..3).map(|n| corners[k][i][n] * corners[l][j][n] / masses[n]).sum();
                let unused = if k == l { 1.0 } else { 0.0 };
                Matrix3::from_fn(|i, j| if i == 2 && j == 2 { unused } else { entry(i, j) })
            };
            let places = [(0, 0), (0, 1), (1, 0), (1, 1)];
            let delassus = BlockMatrix::from_blocks(2, places.map(|(k, l)| (k, l, block(k, l))).to_vec()).unwrap();
            let before = corners.map(|rows| Vector3::from_fn(|i, _| (0..3).map(|n| rows[i][n] * v[n]).sum()));
            let contacts = Contacts {
                delassus: Delassus::Blocks(&delassus),
                free: &before,
                before: &before,
                gap: &[0.0; 2],
                mu: &[mu; 2],
                restitution: &[0.8; 2],
                cone: &[Cone::Polyhedral(2); 2],
                roles: &[],
                h: 1.0,
            };
            let mut r = vec![Vector3::zeros(); 2];
            let report = Law::new(1e-12).impulses(&contacts, &mut r, &Control::new());
            assert_eq!(report.outcome, Outcome::Solved, "{digits} {upright} {spin}: {report:?}");
            assert!(report.residual < 1e-10, "{digits} {upright} {spin}: {report:?}");
            assert!(contacts.dissipation(&r).0 > -1e-18, "{digits} {upright} {spin}");
        }
    }
}
