//! Hard cases of friction on contact patches: patch radii from zero to far beyond the body, rebounds, patches beside
//! point contacts, several patches on one body, heaps, and masses of all sizes.

use super::super::{on_the_ground, stepped, weightless};
use super::{G, MU, R, assert_sound, disc, of_surface};
use crate::systems::harness::{column, distance, last, solve};
use dvi::solution::Solution;
use serde_json::{Value, json};

/// A ball of mass 1 kg and radius 0.1 m with the given position, velocity and angular velocity.
fn ball(name: &str, at: [f64; 3], velocity: [f64; 3], omega: [f64; 3]) -> Value {
    json!({"name": name, "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": at, "velocity": velocity,
        "angular_velocity": omega})
}

const INERTIA: f64 = 0.4 * 0.01;

#[test]
fn patches_of_all_kinds_are_solved() {
    let contacts = [
        json!({"friction": 0.3, "patch": 0}),
        json!({"friction": 0, "patch": 0.1, "rolling": 0.01}),
        json!({"friction": 0, "patch": 0.1}),
        json!({"friction": 0.3, "rolling": 0.01}),
        json!({"friction": 0.5, "patch": 1e-6, "rolling": 1e-6}),
        json!({"friction": 5, "patch": 10, "rolling": 0.1}),
        json!({"friction": 0.3, "patch": 1e3, "rolling": 1e3}),
        json!({"friction": 0.3, "patch": 1e-12, "rolling": 1e-12}),
        json!({"friction": "0.1 + 0.3*exp(-slip_speed/0.1)", "patch": 0.05, "rolling": 0.001}),
        json!({"friction": 0.3, "restitution": 0.5, "patch": 0.02, "rolling": 0.001}),
        json!({"friction": 0.3, "restitution": 1, "patch": 0.02, "rolling": 0.001}),
    ];
    for contacts in contacts {
        // First the ball and the brick move apart, so that the contact law is solved to its tolerance. Then the ball
        // runs into the brick as the brick's corners land: the largest residual of all steps may be large there, as
        // it may be without patches.
        for (aside, most) in [(1.0, 1e-10), (0.0, f64::INFINITY)] {
            let ball = ball("ball", [0.0, 0.0, 0.15], [1.0, 0.2, 0.0], [1.0, 2.0, 30.0]);
            let brick = json!({"name": "brick", "shape": {"box": {"size": [0.2, 0.2, 0.1]}}, "mass": 3,
                "position": [0.4, 0.1 + aside, 0.06], "angular_velocity": [0, 0, 2]});
            let solution = solve(&on_the_ground(&[ball, brick], &contacts, 0.6, 1e-3));
            let vi = solution.diagnostics.vi.as_ref().unwrap();
            println!("{contacts} {aside}: {:e} {} {:?}", vi.largest_residual, vi.pivots, solution.verdict.because);
            assert!(vi.largest_residual <= most, "{contacts}: {:e}", vi.largest_residual);
        }
    }
}

#[test]
fn a_patch_without_size_is_a_point_and_a_huge_one_turns_only_as_it_slides() {
    let scene = |contacts: Value| {
        let ball = ball("ball", [0.0, 0.0, 0.1], [1.0, 0.0, 0.0], [3.0, 2.0, 30.0]);
        solve(&stepped(on_the_ground(&[ball], &contacts, 1.0, 1e-3)))
    };
    let point = scene(json!({"friction": 0.2}));
    for patch in [json!({"friction": 0.2, "patch": 1e-12}), json!({"friction": 0.2, "patch": 1e-12, "rolling": 1e-12})]
    {
        let found = scene(patch);
        for field in ["ball.x", "ball.y", "ball.vx", "ball.wx", "ball.wz"] {
            let pairs = column(&point, field).iter().zip(column(&found, field));
            let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart < 1e-8, "{field}: {apart:e}");
        }
    }
    // On a contact patch far larger than its radius of gyration, a disc stops spinning at once and slides like a block.
    let mut solution = on_the_ground(&[disc([1.0, 0.0], 10.0)], &json!({"friction": MU, "patch": 1e4}), 1.0, 1e-3);
    solution["output"]["times"] = json!("steps");
    let solution = solve(&solution);
    assert!(column(&solution, "disc.wz")[2..].iter().all(|w| w.abs() < 1e-9));
    // Friction opposes the spin of the disc, and not its slide, during at most one step.
    assert!(distance(&solution, "disc.vx", |t| (1.0 - MU * G * t).max(0.0)) < MU * G * 1e-3 + 1e-9);
    assert_sound(&solution, 0.5 + 0.25 * R * R * 100.0);
}

/// A ball with a contact patch and a spin about the normal falls and rebounds: a normal impulse `p` reduces its spin by
/// `2/3 mu p R/I`, with the patch radius `R`.
#[test]
fn a_patch_turns_within_an_impact() {
    let (speed, spin, e, patch) = (2.0, 30.0, 0.5, 0.03);
    for law in ["simultaneous", "sequential"] {
        let ball = ball("ball", [0.0, 0.0, 0.2], [0.0, 0.0, -speed], [0.0, 0.0, spin]);
        let contacts = json!({"friction": MU, "patch": patch, "restitution": e});
        let mut scene = weightless(on_the_ground(&[ball], &contacts, 0.2, 1e-3));
        scene["method"]["impact_law"] = json!(law);
        let solution = solve(&scene);
        assert!((last(&solution, "ball.vz") - e * speed).abs() < 1e-12, "{law}");
        let turned = 2.0 / 3.0 * MU * (1.0 + e) * speed * patch / INERTIA;
        assert!((last(&solution, "ball.wz") - (spin - turned)).abs() < 1e-9, "{law}: {}", last(&solution, "ball.wz"));
    }
    // A ball that rolls without slip keeps rolling through a rebound, apart from the effect of the rolling friction
    // torque.
    for law in ["simultaneous", "sequential"] {
        let (v, c) = (1.0, 1e-3);
        // The ball strikes the ground in the first step, while it touches it, so that the lever arm of friction is
        // the radius of the ball.
        let ball = ball("ball", [0.0, 0.0, 0.1], [v, 0.0, -speed], [0.0, v / 0.1, 0.0]);
        let mut scene =
            weightless(on_the_ground(&[ball], &json!({"friction": 0.5, "rolling": c, "restitution": e}), 0.2, 1e-3));
        scene["method"]["impact_law"] = json!(law);
        let solution = solve(&scene);
        // Angular momentum of the ball about the contact point: 7/5 m r v changes by c p, with the coefficient c of the
        // rolling torque and the normal impulse p.
        let slowed = c * (1.0 + e) * speed / (1.4 * 0.1);
        assert!((last(&solution, "ball.vx") - (v - slowed)).abs() < 1e-9, "{law}: {}", last(&solution, "ball.vx"));
        assert!((last(&solution, "ball.wy") - (v - slowed) / 0.1).abs() < 1e-8, "{law}");
    }
}

/// A ball in a corner has a patch contact with the floor and a point contact with the wall, whose friction resists the
/// ball's spin as well.
#[test]
fn a_patch_stands_beside_points_on_one_body() {
    let wall = 2.0;
    for rough in [0.0, 0.04] {
        let scene = json!({"problem": {"rigid_bodies": {
            "gravity": [-wall, 0, -G],
            "materials": {"floor": {}, "wall": {}, "ball": {}},
            "bodies": [
                {"name": "floor", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true, "material": "floor"},
                {"name": "wall", "shape": {"half_space": {"normal": [1, 0, 0]}}, "fixed": true, "material": "wall"},
                {"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0.1, 0, 0.1],
                    "angular_velocity": [0, 0, 20], "material": "ball"}],
            "contacts": {"pairs": [{"materials": ["floor", "ball"], "friction": MU, "patch": 0.03},
                {"materials": ["wall", "ball"], "friction": rough}]}}},
            "time": {"end": 1}, "method": {"step": 1e-3}, "output": {"times": {"count": 101}}});
        let solution = solve(&scene);
        assert!(solution.verdict.trusted, "{:?}", solution.verdict);
        if rough == 0.0 {
            let rate = 2.0 / 3.0 * MU * G * 0.03 / INERTIA;
            assert!(distance(&solution, "ball.wz", |t| (20.0 - rate * t).max(0.0)) < 1e-9);
        } else {
            // Friction on the wall pushes the ball along the wall with 0.08 N, less than the friction bound of the
            // floor, but the drilling patch lets the ball creep. With the creep e = u/(w a) of a disc of radius a and
            // uniform pressure, its friction is `mu N (e + O(e^3))` and its moment `mu N a (2/3 - e^2/2 + O(e^4))`.
            let (patch, radius, push, bound) = (0.03, 0.1, rough * wall, MU * G);
            let (mut y, mut vy, mut wx, mut wz, step) = (0.0, 0.0, 0.0, 20.0, 1e-5);
            for _ in 0..50_000 {
                let creep = (vy + radius * wx) / (patch * wz);
                y += step * vy;
                vy += step * (push - bound * creep);
                wx -= step * radius * bound * creep / INERTIA;
                wz -= step * (bound * patch * (2.0 / 3.0 - 0.5 * creep * creep) + radius * push) / INERTIA;
            }
            for (name, exact, scale) in [("y", y, 0.05), ("vy", vy, 0.03), ("wx", wx, 0.3), ("wz", wz, 0.1)] {
                let found = column(&solution, &format!("ball.{name}"))[50];
                assert!((found - exact).abs() < 1e-3 * scale, "{name}: {found}, not {exact}");
            }
        }
    }
}

/// A ball rolls along a groove of walls at 45 degrees, about an axis that is neither normal nor tangential to its
/// contacts. It drills on both patches, so that friction along the groove lets it creep. The reference solves every
/// step independently, with sums over the patch and regula falsi.
#[test]
fn a_ball_that_rolls_in_a_groove_drills_on_both_patches() {
    let (mu, patch, c, h, steps) = (0.3, 0.01, 5e-4, 5e-3, 40);
    let half = 0.5_f64.sqrt();
    let scene = json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G],
        "bodies": [{"name": "left", "shape": {"half_space": {"normal": [0, half, half]}}, "fixed": true},
            {"name": "right", "shape": {"half_space": {"normal": [0, -half, half]}}, "fixed": true},
            ball("ball", [0.0, 0.0, 0.1 / half], [1.0, 0.0, 0.0], [0.0, 1.0 / (0.1 * half), 0.0])],
        "contacts": {"friction": mu, "patch": patch, "rolling": c}}},
        "time": {"end": h * f64::from(steps)}, "method": {"step": h}, "output": {"times": "steps"}});
    let solution = solve(&scene);
    assert!(solution.diagnostics.vi.as_ref().unwrap().largest_residual <= 1e-10);
    let normal = G / (2.0 * half);
    // Finds a root by regula falsi with the Illinois modification.
    let root = |function: &dyn Fn(f64) -> f64, mut a: f64, mut b: f64| {
        let (mut at_a, mut at_b) = (function(a), function(b));
        assert!(at_a * at_b < 0.0);
        while (b - a).abs() > 1e-13 && at_b != 0.0 {
            let next = b - at_b * (b - a) / (at_b - at_a);
            if (next - b).abs() < 1e-14 {
                break;
            }
            let at = function(next);
            if at * at_b < 0.0 {
                (a, at_a) = (b, at_b);
            } else {
                at_a *= 0.5;
            }
            (b, at_b) = (next, at);
        }
        b
    };
    let (mut v, mut w) = (1.0, 1.0 / (0.1 * half));
    for k in 1..=steps as usize {
        // Friction force and drilling torque of a contact patch at the end of a step, for the slip there and the spin
        // `w`.
        let law = |slip: f64, w: f64| {
            let [force, torque] = of_surface(slip.abs(), patch * half * w);
            [slip.signum() * force, torque]
        };
        let speed = |w: f64| {
            let off = |next: f64| next - v + 2.0 * h * mu * normal * law(next - 0.1 * half * w, w)[0];
            root(&off, 0.0, 2.0)
        };
        let off = |next: f64| {
            let [force, torque] = law(speed(next) - 0.1 * half * next, next);
            INERTIA * (next - w) - 2.0 * h * normal * (mu * force * 0.1 * half - mu * torque * patch * half - c * half)
        };
        let next = root(&off, 0.5 * w, w);
        (v, w) = (speed(next), next);
        let found = [column(&solution, "ball.vx")[k], column(&solution, "ball.wy")[k]];
        assert!((found[0] - v).abs() < 1e-5 && 0.1 * (found[1] - w).abs() < 1e-5, "{k}: {found:?} {v} {w}");
    }
    println!("{v} {w} creep {}", v - 0.1 * half * w);
}

/// A spinning sphere on top of another one, which lies on ice: the drilling torque `2/3 mu m g R` acts between them
/// until both rotate as one.
#[test]
fn discs_of_masses_that_differ_by_four_orders_come_to_turn_as_one() {
    for (below, above) in [(1.0, 1e-4), (1.0, 1.0), (1.0, 1e4), (1e4, 1.0)] {
        let sphere = |name: &str, material: &str, mass: f64, z: f64, spin: f64| {
            json!({"name": name, "shape": {"sphere": {"radius": 0.1}}, "mass": mass, "position": [0, 0, z],
                "angular_velocity": [0, 0, spin], "material": material})
        };
        let scene = json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G],
            "materials": {"ice": {"friction": 0}, "disc": {"friction": MU}},
            "bodies": [{"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true, "material": "ice"},
                sphere("below", "disc", below, 0.1, 0.0), sphere("above", "disc", above, 0.3, 20.0)],
            "contacts": {"patch": 0.03}}},
            "time": {"end": 2}, "method": {"step": 1e-3}, "output": {"times": {"count": 201}}});
        let solution = solve(&scene);
        assert!(solution.verdict.trusted, "{:?}", solution.verdict);
        let torque = 2.0 / 3.0 * MU * above * G * 0.03;
        let common = 20.0 * above / (below + above);
        let exact = |t: f64| (20.0 - torque / (INERTIA * above) * t).max(common);
        let error = distance(&solution, "above.wz", exact);
        let other = |t: f64| (torque / (INERTIA * below) * t).min(common);
        let of_below = distance(&solution, "below.wz", other);
        println!("{below} {above}: {error:e} {of_below:e}");
        assert!(error < 1e-7 && of_below < 1e-7, "{below} {above}: {error:e} {of_below:e}");
    }
}

/// Balls that fall on a floor without walls roll away, unless rolling friction stops them.
#[test]
fn a_heap_with_rolling_friction_comes_to_rest() {
    let heap = |contacts: Value, end: f64| {
        let bodies: Vec<Value> = (0..30)
            .map(|k: i32| {
                let (layer, place) = (f64::from(k / 9), k % 9);
                let at = |i: i32| 0.21 * f64::from(i - 1) + 0.013 * layer;
                let z = 0.11 + 0.2 * layer;
                ball(&format!("b{k}"), [at(place % 3), at(place / 3) + 0.03 * layer, z], [0.0; 3], [0.0; 3])
            })
            .collect();
        solve(&on_the_ground(&bodies, &contacts, end, 2e-3))
    };
    let solution = heap(json!({"friction": 0.5, "patch": 5e-3, "rolling": 5e-3}), 5.0);
    let residual = solution.diagnostics.vi.as_ref().unwrap().largest_residual;
    assert!(residual <= 1e-10, "{residual:e}");
    let moves = |solution: &Solution| {
        let energy = column(solution, "kinetic_energy");
        last(solution, "kinetic_energy") / energy.iter().fold(0.0, |most, energy| energy.max(most))
    };
    // Velocities of the balls at rest are as small as the tolerance of the contact law, and kinetic energies as its
    // square.
    assert!(moves(&solution) < 1e-15, "{:e}", moves(&solution));
    // Without rolling friction the balls of the heap continue to roll over the plane.
    let rolls = moves(&heap(json!({"friction": 0.5}), 1.0));
    assert!(rolls > 1e-2, "{rolls:e}");
}

/// A ball that falls, rebounds, slides, spins and rolls, and a disc beside it, in several units of length and mass.
#[test]
fn the_law_holds_in_units_of_all_sizes() {
    let scene = |length: f64, mass: f64| {
        let at = |x: [f64; 3]| json!(x.map(|x| x * length));
        let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.1 * length}}, "mass": mass,
            "position": at([0.0, 0.0, 0.15]), "velocity": at([1.0, 0.2, 0.0]), "angular_velocity": [1, 2, 30]});
        let axial = 0.5 * R * R * mass * length * length;
        let disc = json!({"name": "disc", "shape": {"sphere": {"radius": 0.02 * length}}, "mass": mass,
            "centre_of_mass": at([0.0, 0.0, -0.02]), "inertia": [0.5 * axial, 0.5 * axial, axial],
            "position": at([0.0, 1.0, 0.02]), "velocity": at([1.0, 0.0, 0.0]), "angular_velocity": [0, 0, 20]});
        let contacts = json!({"friction": MU, "patch": 0.03 * length, "rolling": 1e-3 * length, "restitution": 0.4});
        let mut scene = on_the_ground(&[ball, disc], &contacts, 0.6, 1e-3);
        scene["problem"]["rigid_bodies"]["gravity"] = at([0.0, 0.0, -G]);
        solve(&scene)
    };
    let unit = scene(1.0, 1.0);
    for length in [1e-6_f64, 1e-3, 1e3, 1e6] {
        for mass in [length.powi(3), 1.0, 1e-12, 1e12] {
            let found = scene(length, mass);
            assert!(found.verdict.trusted, "{length:e} {mass:e}: {:?}", found.verdict);
            for (field, size) in [
                ("ball.x", length),
                ("ball.vy", length),
                ("ball.wz", 1.0),
                ("ball.wx", 1.0),
                ("disc.wz", 1.0),
                ("disc.vx", length),
            ] {
                let pairs = column(&unit, field).iter().zip(column(&found, field));
                let apart = pairs.map(|(a, b)| (a - b / size).abs()).fold(0.0, f64::max);
                println!("{length:e} {mass:e} {field}: {apart:e}");
                assert!(apart < 1e-7, "{length:e} {mass:e} {field}: {apart:e}");
            }
        }
    }
}

/// A stack of balls on a rotating table: the torque of the table drives all of them. The torques between the balls
/// are bounded by the weights above, so that all balls rotate as one if the table has less friction than they have.
#[test]
fn a_stack_on_a_turning_table_turns_as_one_or_slips_at_its_foot() {
    let n = 5;
    let patch = 0.02;
    let stack = |table: f64, between: f64| {
        let mut bodies = vec![
            json!({"name": "table", "shape": {"cylinder": {"radius": 1, "length": 0.1}}, "position": [0, 0, -0.05],
            "motion": {"angular_velocity": [0, 0, 3]}, "material": "table"}),
        ];
        bodies.extend((0..n).map(|k| {
            let z = 0.1 + 0.2 * f64::from(k);
            json!({"name": format!("b{k}"), "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, z], "material": "ball"})
        }));
        json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G], "bodies": bodies,
            "materials": {"table": {}, "ball": {}},
            "contacts": {"patch": patch, "pairs": [{"materials": ["table", "ball"], "friction": table},
                {"materials": ["ball", "ball"], "friction": between}]}}},
            "time": {"end": 1.5}, "method": {"step": 1e-3}, "output": {"times": "steps"}})
    };
    let rate = |mu: f64| 2.0 / 3.0 * mu * G * patch / INERTIA;
    // On a table with less friction than the balls have, all balls rotate as one.
    let solution = solve(&stack(0.1, 0.3));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    for k in 0..n {
        let error = distance(&solution, &format!("b{k}.wz"), |t| (rate(0.1) * t).min(3.0));
        assert!(error < 1e-8, "{k}: {error:e}");
    }
    // On a table with more friction than the balls have, the lowest ball follows the table and drives the others, which
    // rotate as one.
    let solution = solve(&stack(0.9, 0.1));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let lowest = |t: f64| ((f64::from(n) * rate(0.9) - f64::from(n - 1) * rate(0.1)) * t).min(3.0);
    assert!(distance(&solution, "b0.wz", lowest) < 1e-8, "{:e}", distance(&solution, "b0.wz", lowest));
    for k in 1..n {
        let error = distance(&solution, &format!("b{k}.wz"), |t| (rate(0.1) * t).min(3.0));
        assert!(error < 1e-8, "{k}: {error:e}");
    }
}

/// A table on a hinge with a motor. A motor with a prescribed velocity makes the ball on the table drill until it
/// rotates with the table; one with a prescribed torque below the friction bound rotates both as one.
#[test]
fn a_table_with_a_motor_turns_a_ball_and_its_work_is_in_the_balance() {
    let (mu, patch) = (0.1, 0.02);
    let (of_table, of_ball) = (0.5 * 4.0, INERTIA);
    let scene = |motor: Value, start: f64| {
        json!({"problem": {"rigid_bodies": {"gravity": [0, 0, -G],
            "bodies": [
                {"name": "table", "shape": {"cylinder": {"radius": 1, "length": 0.1}}, "mass": 4, "position": [0, 0, -0.05],
                    "angular_velocity": [0, 0, start]},
                {"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1, "position": [0, 0, 0.1]}],
            "joints": [{"hinge": {"name": "axle", "bodies": ["table"], "at": [0, 0, 0], "axis": [0, 0, 1], "motor": motor}}],
            "contacts": {"friction": mu, "patch": patch}}},
            "time": {"end": 1}, "method": {"step": 1e-3}, "output": {"times": {"count": 101}}})
    };
    let torque = 2.0 / 3.0 * mu * G * patch;
    let solution = solve(&scene(json!({"velocity": 3}), 3.0));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let error = distance(&solution, "ball.wz", |t| (torque / of_ball * t).min(3.0));
    assert!(error < 1e-7, "{error:e}");
    // While the ball slips, the motor transmits the friction torque at 3 rad/s: half of its work is dissipated.
    let work = solution.diagnostics.energy.as_ref().unwrap().work_of_drives;
    assert!((work - of_ball * 9.0).abs() < 1e-2 * work, "{work}");
    assert!((last(&solution, "dissipated_by_friction") - 0.5 * of_ball * 9.0).abs() < 1e-5);
    // If the table and the ball rotate as one, friction transmits the ball's share of the motor's torque.
    let effort = 0.5 * torque / of_ball * (of_ball + of_table);
    let solution = solve(&scene(json!({"effort": effort}), 0.0));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let as_one = |t: f64| effort / (of_ball + of_table) * t;
    // Bound for the error of an angular velocity: the sum of the errors of a thousand steps, each of 1e-10 relative to
    // the velocities.
    let most = 1000.0 * 1e-10 * as_one(1.0);
    for body in ["table.wz", "ball.wz"] {
        let error = distance(&solution, body, as_one);
        assert!(error < most, "{body}: {error:e}");
    }
    assert!(last(&solution, "dissipated_by_friction").abs() < 1e-9);
}
