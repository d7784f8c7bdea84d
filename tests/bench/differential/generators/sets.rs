//! Random variational inequalities over sets of all kinds: with `D` positive definite, and with `D` zero and `C =
//! B^T`. In both cases the states are unique over any convex set.

use super::{LinearProblem, dissipative, faster, positive_definite, variables};
use crate::differential::linear::{Linear, Shape, transposed, zeros};
use crate::differential::random::Random;
use crate::differential::signal::Signal;

pub fn generate(random: &mut Random) -> LinearProblem {
    let mut set: Vec<(Shape, usize)> = (0..random.whole(1, 2)).map(|_| factor(random)).collect();
    let bounded = set.iter().all(|(shape, _)| is_bounded(shape));
    let m = variables(&set);
    let n = m.max(random.whole(1, 4));
    let omega = random.scale(0.5, 5.0);
    // With `D` zero, an unbounded set needs feasible initial states; a bounded set admits any.
    let regular = !bounded || random.chance(0.6);
    let a = dissipative(random, n, 50.0);
    let (b, c, d) = if regular {
        let d = positive_definite(random, m);
        (random.matrix(n, m), random.matrix(m, n), d)
    } else {
        let b = random.matrix(n, m);
        let c = transposed(&b);
        (b, c, zeros(m, m))
    };
    if random.chance(0.1) {
        set.reverse();
    }
    let system = Linear {
        initial: random.vector(n),
        a,
        b,
        c,
        d,
        drive: (0..n).map(|_| Signal::random(random, 1.0, omega, 2)).collect(),
        gap: (0..m).map(|_| Signal::random(random, 1.0, omega, 2)).collect(),
        set,
    };
    let speed = random.scale(1e-3, 1e3);
    let end = random.scale(3.0, 30.0) / (omega * speed) * std::f64::consts::TAU / 2.0;
    LinearProblem {
        system: faster(system, speed),
        end,
        is_unique: true,
        as_matrices: random.chance(0.5),
        energy: (!regular).then(|| vec![1.0; n]),
    }
}

fn is_bounded(shape: &Shape) -> bool {
    matches!(shape, Shape::Box(..) | Shape::Ball(_) | Shape::Simplex | Shape::Polyhedron(..))
}

fn factor(random: &mut Random) -> (Shape, usize) {
    match random.whole(0, 6) {
        0 => {
            let (lower, width) = (random.uniform(-1.0, 0.5), random.scale(0.1, 2.0));
            (Shape::Box(lower, lower + width), random.whole(1, 2))
        }
        1 => (Shape::Nonnegative, random.whole(1, 2)),
        2 => (Shape::Cone, random.whole(2, 3)),
        3 => (Shape::Ball(random.scale(0.1, 2.0)), random.whole(2, 3)),
        4 => (Shape::Simplex, random.whole(2, 3)),
        5 => {
            // Build a random polygon: a box cut by half planes that contain the origin.
            let mut a = vec![vec![1.0, 0.0], vec![-1.0, 0.0], vec![0.0, 1.0], vec![0.0, -1.0]];
            let mut b = vec![1.0; 4];
            for _ in 0..random.whole(0, 2) {
                let angle = random.uniform(0.0, std::f64::consts::TAU);
                a.push(vec![angle.cos(), angle.sin()]);
                b.push(random.uniform(0.2, 1.2));
            }
            (Shape::Polyhedron(a, b), 2)
        }
        _ => (Shape::Free, 1),
    }
}
