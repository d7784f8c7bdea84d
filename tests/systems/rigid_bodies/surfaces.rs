//! Friction with a coefficient that varies with position, time and slip speed, and anisotropic friction, compared
//! with closed forms.

use super::{on_the_ground, stepped};
use crate::systems::harness::{column, distance, last, solve};
use crate::systems::reference::example;
use dvi::problem::Control;
use dvi::solution::Solution;
use dvi::specification::Specification;
use serde_json::{Value, json};

const G: f64 = 9.81;

/// A body of unit mass that touches the ground at its centre of mass, so that friction does not rotate it.
fn puck(velocity: [f64; 2]) -> Value {
    json!({"name": "puck", "shape": {"sphere": {"radius": 0.05}}, "mass": 1, "centre_of_mass": [0, 0, -0.05],
        "inertia": [0.01, 0.01, 0.01], "position": [0, 0, 0.05], "velocity": [velocity[0], velocity[1], 0]})
}

fn cube(velocity: f64) -> Value {
    json!({"name": "puck", "shape": {"box": {"size": [0.2, 0.2, 0.1]}}, "mass": 1, "position": [0, 0, 0.05],
        "velocity": [velocity, 0, 0]})
}

/// Asserts that the run is trusted, that the contact law was solved to its tolerance, and that friction dissipated
/// the energy `lost`.
fn assert_sound(solution: &Solution, lost: f64) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let residual = solution.diagnostics.vi.as_ref().unwrap().largest_residual;
    assert!(residual <= 1e-10, "{residual:e}");
    let booked = last(solution, "dissipated_by_friction");
    assert!((booked - lost).abs() < 1e-9 * lost.max(1.0), "{booked} for {lost}");
}

/// A block that slides under Stribeck's law of friction has `v' = -g (a + b exp(-v/c))`, with the solution `exp(v/c) =
/// ((a exp(v_0/c) + b) exp(-a g t/c) - b)/a`.
#[test]
fn a_block_under_stribecks_law_follows_its_closed_form() {
    let (a, b, c, start) = (0.2, 0.15, 0.5, 2.0_f64);
    let exact = |t: f64| (((a * (start / c).exp() + b) * (-a * G * t / c).exp() - b) / a).max(1.0).ln() * c;
    let errors = [2e-3, 1e-3].map(|h| {
        let contacts = json!({"friction": "0.2 + 0.15*exp(-slip_speed/0.5)"});
        let solution = solve(&stepped(on_the_ground(&[cube(start)], &contacts, 1.2, h)));
        assert_sound(&solution, 0.5 * start * start);
        assert!(last(&solution, "puck.vx").abs() < 1e-10);
        distance(&solution, "puck.vx", exact)
    });
    // A solver that used a constant friction coefficient of 0.2 would have an error of 0.3 m/s in the block's velocity.
    assert!(errors[1] < 2e-3 && errors[1] < 0.6 * errors[0], "{errors:?}");
}

/// With the friction coefficient `mu = mu_0 (1 + x)` the sliding body obeys `x'' = -g mu_0 (1 + x)`, an oscillation
/// about -1, until its first stop.
#[test]
fn a_floor_that_grows_rougher_stops_a_body_as_a_spring_would() {
    let (mu, v) = (0.2_f64, 3.0);
    let w = (G * mu).sqrt();
    let stop = (v / w).atan() / w;
    let exact = |t: f64| (w * t.min(stop)).cos() + v / w * (w * t.min(stop)).sin() - 1.0;
    let errors = [2e-3, 1e-3].map(|h| {
        let contacts = json!({"friction": "0.2*(1 + contact_x)"});
        let solution = solve(&stepped(on_the_ground(&[puck([v, 0.0])], &contacts, 1.5, h)));
        assert_sound(&solution, 0.5 * v * v);
        distance(&solution, "puck.x", exact)
    });
    assert!(errors[1] < 5e-3 && errors[1] < 0.6 * errors[0], "{errors:?}");
}

/// Friction at the ground has a moment about the centre of the block, at the height `h`, which moves more of the
/// weight to the front corners: `x'' = -g mu_0 (1 + x)/(1 - mu_0 h)`.
#[test]
fn the_block_of_the_example_meets_more_friction_under_its_front_corners() {
    let (mu, v, height) = (0.2_f64, 3.0, 0.1);
    let w = (G * mu / (1.0 - mu * height)).sqrt();
    let stop = (v / w).atan() / w;
    let exact = |t: f64| (w * t.min(stop)).cos() + v / w * (w * t.min(stop)).sin() - 1.0;
    let solution = solve(&stepped(example("rougher_floor")));
    assert_sound(&solution, v * v);
    // Time stepping is of first order. The position of a block of height zero, without the moment of friction, would
    // differ by 0.01 m.
    assert!(distance(&solution, "block.x", exact) < 2e-3, "{:e}", distance(&solution, "block.x", exact));
}

#[test]
fn friction_that_fades_lets_a_body_go_at_its_time() {
    // On a slope of the gradient 0.3 the body begins to slide when mu = 0.5 - 0.1 t has fallen to 0.3.
    let mut scene = stepped(on_the_ground(&[puck([0.0; 2])], &json!({"friction": "0.5 - 0.1*t"}), 4.0, 1e-3));
    scene["problem"]["rigid_bodies"]["gravity"] = json!([0.3 * G, 0, -G]);
    let exact = |t: f64| G * 0.1 * (t - 2.0_f64).max(0.0).powi(3) / 6.0;
    let solution = solve(&scene);
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    assert!(distance(&solution, "puck.x", exact) < 3e-3);
    let (t, x) = (&solution.trajectory.t, column(&solution, "puck.x"));
    assert!(t.iter().zip(x).all(|(&t, &x)| t > 1.99 || x.abs() < 1e-12), "it creeps");
}

/// The friction coefficient between two materials is the geometric mean of their coefficients, for varying coefficients
/// as for constant ones.
#[test]
fn two_materials_that_vary_have_the_geometric_mean_of_their_coefficients() {
    let mut bodies = [cube(2.0)];
    bodies[0]["material"] = json!("block");
    let mut scene = stepped(on_the_ground(&bodies, &json!({"friction": "0.1*(1 + 3*slip_speed)"}), 0.5, 1e-3));
    scene["problem"]["rigid_bodies"]["materials"] = json!({"block": {"friction": "0.4*(1 + 3*slip_speed)"}});
    // The block obeys v' = -g m (1 + 3 v) with m = sqrt(0.1 0.4).
    let exact = |t: f64| ((7.0 * (-0.6 * G * t).exp() - 1.0) / 3.0).max(0.0);
    assert!(distance(&solve(&scene), "puck.vx", exact) < 2e-2);
    // Friction vanishes if one of the two materials is smooth.
    scene["problem"]["rigid_bodies"]["materials"]["block"]["friction"] = json!(0);
    assert_eq!(last(&solve(&scene), "puck.vx"), 2.0);
}

/// By maximal dissipation in an ellipse the friction force is `-mu N D^2 u/|D u|` with `D = diag(1, c)`: `u_y` is
/// proportional to `u_x^(c^2)`, whatever `mu`.
#[test]
fn a_body_slides_on_the_path_of_an_elliptic_law() {
    let (c, start) = (1.5_f64, [2.0, 1.0]);
    let follows = |solution: &Solution, step: f64| {
        assert_sound(solution, 2.5);
        let (x, y) = (column(solution, "puck.vx"), column(solution, "puck.vy"));
        let off = |(x, y): (&f64, &f64)| (y / start[1] - (x / start[0]).max(0.0).powf(c * c)).abs();
        let error = x.iter().zip(y).map(off).fold(0.0, f64::max);
        // A solver with friction opposite to the slip, and with the coefficient of the slip's direction, would have
        // an error of 0.1.
        assert!(error < 4.0 * step, "{error:e}");
    };
    for step in [2e-3, 1e-3] {
        let contacts = json!({"friction": 0.3, "ratio": c});
        let solution = solve(&stepped(on_the_ground(&[puck(start)], &contacts, 1.0, step)));
        follows(&solution, step);
    }
    follows(&solve(&stepped(example("elliptic_friction"))), 5e-4);
}

#[test]
fn directions_of_friction_follow_the_axes_that_they_are_given_in() {
    // Distances that the body slides until it stops along and across the direction of the ellipse's axis: v^2/(2 mu g),
    // and half of that.
    let turned = json!([0.5_f64.sqrt(), 0, 0, 0.5_f64.sqrt()]);
    let way = |scene: &Value| last(&solve(scene), "puck.x");
    let scene = |contacts: Value, velocity: [f64; 2]| stepped(on_the_ground(&[puck(velocity)], &contacts, 1.0, 1e-3));
    let along = 1.0 / (2.0 * 0.2 * G);
    let near = |way: f64, exact: f64| assert!((way - exact).abs() < 2e-3, "{way} for {exact}");
    near(way(&scene(json!({"friction": 0.2, "ratio": 2}), [1.0, 0.0])), along);
    near(way(&scene(json!({"friction": 0.2, "ratio": 2, "along": [0, 3, 1]}), [1.0, 0.0])), 0.5 * along);
    // The axes of the ellipse are those of the first material's body, the ground or the puck: a rotation of that body
    // rotates the ellipse.
    let mut grained = scene(
        json!({"friction": 0.2, "pairs": [{"materials": ["wood", "felt"], "ratio": 2, "axes": "body"}]}),
        [1.0, 0.0],
    );
    let problem = &mut grained["problem"]["rigid_bodies"];
    problem["materials"] = json!({"felt": {}, "wood": {}});
    problem["bodies"][0]["material"] = json!("wood");
    problem["bodies"][1]["material"] = json!("felt");
    near(way(&grained), along);
    grained["problem"]["rigid_bodies"]["bodies"][0]["orientation"] = turned.clone();
    near(way(&grained), 0.5 * along);
    let pair = &mut grained["problem"]["rigid_bodies"]["contacts"]["pairs"][0];
    pair["materials"] = json!(["felt", "wood"]);
    near(way(&grained), along);
    grained["problem"]["rigid_bodies"]["bodies"][1]["orientation"] = turned;
    near(way(&grained), 0.5 * along);
}

#[test]
fn a_coefficient_that_falls_below_zero_ends_the_run_at_its_place() {
    let contacts = json!({"friction": "0.2 - 0.5*contact_x"});
    let text = stepped(on_the_ground(&[puck([3.0, 0.0])], &contacts, 1.0, 1e-3)).to_string();
    let specification = Specification::from_json(text.as_bytes()).unwrap();
    let solution = dvi::solve(&specification, &Control::new());
    let failure = solution.error.as_ref().unwrap();
    assert_eq!(failure.code, "friction_negative", "{failure:?}");
    assert!(failure.message.contains("`ground` and `puck`") && failure.message.contains("max(0, ..)"), "{failure:?}");
    let place = failure.state[0];
    assert!((place - 0.4).abs() < 0.01, "{place}");
}
