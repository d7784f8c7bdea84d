//! The tangent matrix of the joint equations over a step, including the geometric stiffness of joint impulses.
//!
//! With the angular velocity `w` of a body over a step of size `h` and `s = h w`, a vector `d` fixed in the body has
//! the mean `d_m = (d + d+)/2 = B d` over the step, where `B = (1 - [s]x/2)^-1`, and
//!
//! ```text
//! d(d_m) = D dw,    D = -(h/2) B [d_m]x,    d(d+) = 2 D dw
//! ```
//!
//! so that the product `alpha . beta` of every equation, and the wrenches of its impulse, have closed-form derivatives.

use super::super::joint::Beta;
use super::super::midpoint::Midpoint;
use super::super::motion::Motion;
use super::{Instant, Linked, REDUNDANT};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// The index of the first row or column of the velocity in the six-dimensional matrix block of a body.
const V: usize = 0;
/// The index of the first row or column of the angular velocity in the six-dimensional matrix block of a body.
const W: usize = 3;

/// Adds joint impulses to the momentum balances of the bodies, and assembles the linearised joint equations; returns
/// false if the step is too long for a drive.
pub fn assemble(linked: &mut Linked<'_>, midpoint: &Midpoint) -> bool {
    (0..linked.joints.len()).all(|k| assemble_joint(linked, midpoint, k))
}

fn assemble_joint(linked: &mut Linked<'_>, midpoint: &Midpoint, k: usize) -> bool {
    let (joint, h) = (linked.joints[k], midpoint.h);
    let [mean, end] = [(&midpoint.means, Instant::Mean), (&midpoint.ends, Instant::End)]
        .map(|(frames, at)| linked.frames(frames, at, k).map(|frame| *frame));
    let ([mean_first, mean_second], [end_first, end_second]) = (&mean, &end);
    let (mean, end) = ([mean_first, mean_second], [end_first, end_second]);
    let (arms, apart) = joint.arms(mean);
    let (_, apart_at_end) = joint.arms(end);
    let driving = linked.driving[k];
    let places = linked.linkage.pairs[k].map(|body| body.map(|body| linked.bodies[body as usize] as usize));
    // The derivative `D = -(h/2) B [d]x` of a vector with the mean `d` that is fixed in one of the bodies, with respect
    // to the body's mean angular velocity.
    let turning = |side: usize, d: &Vector3<f64>| {
        places[side].map_or_else(Matrix3::zeros, |body| midpoint.turning[body] * d.cross_matrix() * (-0.5 * h))
    };
    let levers = [turning(0, &arms[0]), turning(1, &arms[1])];
    let mut stiffness = [[Matrix6::<f64>::zeros(); 2]; 2];
    let mut wrenches = [Matrix6::<f64>::zeros(); 2];
    let mut gradients = [Matrix6::<f64>::zeros(); 2];
    let mut rests = Vector6::zeros();
    // The total impulse of those joint equations whose directions are not fixed in a body (but in the world, or along a
    // spring).
    let mut pull = Vector3::zeros();
    let mut add = |at: [usize; 2], row: usize, column: usize, block: &Matrix3<f64>| {
        let mut view = stiffness[at[0]][at[1]].fixed_view_mut::<3, 3>(row, column);
        view += block;
    };
    let drive = joint.drive.as_ref();
    let of_drive = drive.and_then(|drive| drive.equation(driving.reference));
    for (i, equation) in joint.equations.iter().chain(&of_drive).enumerate() {
        let lambda = linked.impulses[k][i];
        let [alpha, alpha_at_end] = [mean[1], end[1]].map(|second| equation.alpha.in_world(second));
        let turns = equation.alpha.turns();
        let of_alpha = if turns { turning(1, &alpha) } else { Matrix3::zeros() };
        let (beta, beta_at_end, of_beta, is_point) = match equation.beta {
            Beta::Apart => (apart, apart_at_end, levers[0], true),
            Beta::First(b) => {
                let [beta, at_end] = [mean[0], end[0]].map(|first| first.axes * b);
                (beta, at_end, turning(0, &beta), false)
            }
        };
        let force = if is_point { alpha } else { Vector3::zeros() };
        let lever = if is_point { arms[0] } else { beta };
        let opposite = if is_point { arms[1] } else { Vector3::zeros() };
        let back = if turns { alpha.cross(&beta) } else { Vector3::zeros() } - opposite.cross(&alpha);
        put(&mut wrenches[0], i, &force, &lever.cross(&alpha));
        put(&mut wrenches[1], i, &-force, &back);
        // The joint equations are divided by the step size `h`; the derivative of a body-fixed vector at the end of the
        // step is `2 D`.
        let per_time = 2.0 / h;
        let end_force = if is_point { alpha_at_end } else { Vector3::zeros() };
        let mut second = if turns { of_alpha.tr_mul(&beta_at_end) * per_time } else { Vector3::zeros() };
        if is_point {
            second -= levers[1].tr_mul(&alpha_at_end) * per_time;
        }
        put(&mut gradients[0], i, &end_force, &(of_beta.tr_mul(&alpha_at_end) * per_time));
        put(&mut gradients[1], i, &-end_force, &second);
        rests[i] = -alpha_at_end.dot(&beta_at_end) / h;
        if !turns {
            pull += alpha * lambda;
            continue;
        }
        let (a, b) = (alpha.cross_matrix() * lambda, (opposite + beta).cross_matrix() * lambda);
        add([0, 0], W, W, &(a * of_beta));
        add([0, 1], W, W, &(lever.cross_matrix() * of_alpha * -lambda));
        add([1, 1], W, W, &(b * of_alpha));
        add([1, 0], W, W, &(a * -of_beta));
        if is_point {
            add([0, 1], V, W, &(of_alpha * -lambda));
            add([1, 1], V, W, &(of_alpha * lambda));
            add([1, 0], W, V, &(a * (-0.5 * h)));
            add([1, 1], W, V, &(a * (0.5 * h)));
        }
    }
    let place_of_drive = joint.equations.len();
    let mut yields = Matrix6::zeros();
    if let Some(drive) = drive {
        let i = place_of_drive;
        let mut deviation = -rests[i] * h - drive.offset(driving.reference);
        if of_drive.is_none() {
            // The direction of a spring's force is `n = 2 p / (l + l+)`, with the mean `p` of the difference of the
            // anchors and their distances `l` and `l+` at both ends of the step.
            let sum = driving.start + apart_at_end.norm();
            let [along, at_end] = [(apart * 2.0, sum), (apart_at_end, apart_at_end.norm())]
                .map(|(vector, size)| if size > 0.0 { vector / size } else { Vector3::zeros() });
            deviation = apart_at_end.norm() - driving.reference;
            put(&mut wrenches[0], i, &along, &arms[0].cross(&along));
            put(&mut wrenches[1], i, &-along, &-arms[1].cross(&along));
            put(&mut gradients[0], i, &at_end, &(levers[0].tr_mul(&at_end) * (2.0 / h)));
            put(&mut gradients[1], i, &-at_end, &-(levers[1].tr_mul(&at_end) * (2.0 / h)));
            let lambda = linked.impulses[k][i];
            pull += along * lambda;
            // The derivative of the spring's direction is `dn = 2 / (l + l+) (1 - n n+^T) dp`.
            let bend = if sum > 0.0 {
                (Matrix3::identity() - along * at_end.transpose()) * (2.0 * lambda / sum)
            } else {
                Matrix3::zeros()
            };
            let half = Matrix3::identity() * (0.5 * h);
            for (side, kind, way) in [(0, V, half), (0, W, levers[0]), (1, V, -half), (1, W, -levers[1])] {
                let change = bend * way;
                add([0, side], V, kind, &-change);
                add([0, side], W, kind, &(arms[0].cross_matrix() * -change));
                add([1, side], V, kind, &change);
                add([1, side], W, kind, &(arms[1].cross_matrix() * change));
            }
        }
        let Some([slope, weight, rest]) = drive.linearise(&driving, deviation, linked.impulses[k][i], h) else {
            return false;
        };
        for gradient in &mut gradients {
            let mut row = gradient.row_mut(i);
            row *= slope;
        }
        rests[i] = -rest;
        yields[(i, i)] = -weight;
    }
    if pull != Vector3::zeros() {
        add([0, 0], W, W, &(pull.cross_matrix() * levers[0]));
        add([1, 1], W, W, &(pull.cross_matrix() * -levers[1]));
    }
    let plan = &linked.linkage.plan;
    let node = (linked.bodies.len() + k) as u32;
    let (pair, slots) = (linked.linkage.pairs[k], linked.linkage.slots[k]);
    let mut diagonal = Vector6::zeros();
    for (side, body) in pair.into_iter().enumerate() {
        let (Some(body), Some(place)) = (body, places[side]) else { continue };
        linked.x[body as usize] += wrenches[side].tr_mul(&linked.impulses[k]);
        linked.matrix.add(plan, slots.rows[side], &gradients[side]);
        linked.matrix.add(plan, slots.columns[side], &wrenches[side].transpose());
        diagonal += mobilities(&wrenches[side], &midpoint.start[place]) * 0.5;
        for (other_side, other) in pair.into_iter().enumerate() {
            if other.is_some() {
                linked.matrix.add(plan, slots.bodies[side][other_side], &stiffness[side][other_side]);
            }
        }
    }
    linked.x[node as usize] = rests;
    if drive.is_some_and(|drive| !drive.prescribes()) {
        diagonal[place_of_drive] = 0.0;
    }
    linked.diagonals[k] = diagonal * -REDUNDANT;
    linked.matrix.add(plan, node, &yields);
    true
}

fn put(matrix: &mut Matrix6<f64>, row: usize, force: &Vector3<f64>, torque: &Vector3<f64>) {
    matrix.fixed_view_mut::<1, 3>(row, V).copy_from(&force.transpose());
    matrix.fixed_view_mut::<1, 3>(row, W).copy_from(&torque.transpose());
}

/// Returns the contribution of a body to the diagonal of the matrix `G M^-1 G^T` of a joint, with the constraint
/// gradients `G` and the masses `M`.
pub fn mobilities(rows: &Matrix6<f64>, motion: &Motion) -> Vector6<f64> {
    Vector6::from_fn(|i, _| {
        let row = rows.row(i);
        let force = Vector3::new(row[0], row[1], row[2]);
        let torque = Vector3::new(row[3], row[4], row[5]);
        force.norm_squared() / motion.mass + torque.dot(&(motion.mobility * torque))
    })
}
