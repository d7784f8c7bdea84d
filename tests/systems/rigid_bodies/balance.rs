//! Random mechanisms on a shaking deck, with motors, springs, bushings, limits and impacts: the energy balance closes
//! for every kind of drive and dissipation.

use crate::systems::harness::solve;
use serde_json::{Map, Value, json};

/// Returns a random number between two bounds, rounded so that an expression prints it exactly.
fn between(random: &mut fastrand::Rng, [low, high]: [f64; 2]) -> f64 {
    ((low + random.f64() * (high - low)) * 1e4).round() * 1e-4
}

/// Returns a random power of ten with an exponent between two bounds.
fn power(random: &mut fastrand::Rng, exponents: [f64; 2]) -> f64 {
    10.0_f64.powf(between(random, exponents))
}

/// Returns a random drive, spring or limit for the coordinate of a hinge or a slider of the given range.
fn drive(random: &mut fastrand::Rng, range: f64) -> Map<String, Value> {
    let mut joint = Map::new();
    let (amplitude, rate) = (range * between(random, [0.2, 2.0]), between(random, [1.0, 6.0]));
    let kind = random.u32(0..6);
    let (key, value) = match kind {
        0 => ("motor", json!({"position": format!("{amplitude}*(1 - cos({rate}*t))")})),
        1 => ("motor", json!({"velocity": format!("{amplitude}*sin({rate}*t)")})),
        2 => ("motor", json!({"effort": format!("cos({rate}*t)")})),
        3 => {
            let [stiffness, damping, most] = [[0.0, 2.5], [-1.0, 1.0], [0.0, 2.0]].map(|of| power(random, of));
            let target = format!("{amplitude}*sin({rate}*t)");
            let servo = json!({"target": target, "stiffness": stiffness, "damping": damping, "largest_effort": most});
            ("motor", json!({"servo": servo}))
        }
        4 => {
            let damping = between(random, [0.0, 2.0]);
            ("spring", json!({"stiffness": power(random, [0.0, 2.5]), "damping": damping, "rest": 0.25 * amplitude}))
        }
        _ => return joint,
    };
    joint.insert(key.into(), value);
    // A coordinate with prescribed motion has no limits.
    if kind >= 2 {
        let [lower, upper, restitution] = [[-0.6, -0.1], [0.1, 0.6], [0.0, 1.0]].map(|of| between(random, of));
        let limits = json!({"lower": range * lower, "upper": range * upper, "restitution": restitution});
        joint.insert("limits".into(), limits);
    }
    joint
}

/// A random tree of bars on a deck that shakes and tilts, beside a ball that falls to the floor.
fn mechanism(seed: u64) -> Value {
    let random = &mut fastrand::Rng::with_seed(seed);
    let [shake, tilt] = [[0.01, 0.05], [0.0, 0.1]].map(|of| between(random, of));
    let [first, second] = [2.0, 9.0].map(|most| between(random, [1.0, most]));
    let motion = json!({"position": [format!("{shake}*(1 - cos({first}*t))"), 0, format!("{shake}*(1 - cos({second}*t))")],
        "rotation": [0, format!("{tilt}*(1 - cos({second}*t))"), 0]});
    let deck =
        json!({"name": "deck", "group": "mechanism", "shape": {"box": {"size": [0.6, 0.3, 0.02]}}, "motion": motion});
    let floor =
        json!({"name": "floor", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true, "position": [0, 0, -2]});
    let ball = json!({"name": "ball", "shape": {"sphere": {"radius": 0.05}}, "mass": 1, "position": [3, 0, -1.6]});
    let (mut bodies, mut joints, mut bushings) = (vec![deck, floor, ball], Vec::new(), Vec::new());
    let mut ends = vec![("deck".to_owned(), [0.0, 0.0, 0.1])];
    for k in 0..random.usize(2..=5) {
        let (parent, at) = ends[random.usize(ends.len().saturating_sub(2)..ends.len())].clone();
        let (axis, length) = (random.usize(0..3), between(random, [0.1, 0.3]));
        let width = between(random, [0.01, 0.05]);
        let (mut size, mut centre, mut end) = ([width; 3], at, at);
        size[axis] = length;
        let way = if random.bool() { length } else { -length };
        centre[axis] += 0.5 * way;
        end[axis] += way;
        let name = format!("bar{k}");
        bodies.push(json!({"name": name, "group": "mechanism", "shape": {"box": {"size": size}},
            "mass": power(random, [-1.0, 1.0]), "position": centre}));
        let mut joint = Map::new();
        joint.insert("name".into(), format!("joint{k}").into());
        joint.insert("bodies".into(), json!([name, parent]));
        joint.insert("at".into(), json!(at));
        let kind = ["hinge", "hinge", "slider", "ball", "bushing"][random.usize(0..5)];
        if kind == "bushing" {
            joint.insert("stiffness".into(), json!([0; 3].map(|_| power(random, [2.0, 4.0]))));
            joint.insert("damping".into(), json!([0; 3].map(|_| between(random, [0.0, 20.0]))));
            joint.insert("rotational_stiffness".into(), json!([0; 3].map(|_| between(random, [1.0, 50.0]))));
            joint.insert("rotational_damping".into(), json!([0; 3].map(|_| between(random, [0.0, 0.5]))));
            bushings.push(Value::Object(joint));
        } else {
            if kind != "ball" {
                let mut direction = [0; 3];
                direction[random.usize(0..3)] = 1;
                joint.insert("axis".into(), json!(direction));
                joint.extend(drive(random, if kind == "hinge" { 1.0 } else { 0.1 }));
            }
            joints.push(json!({kind: joint}));
        }
        ends.push((name, end));
    }
    let contacts = json!({"friction": 0.3, "restitution": 0.4, "exclude": [["mechanism", "mechanism"]]});
    let members = json!({"gravity": [0, 0, -9.81], "bodies": bodies, "joints": joints, "bushings": bushings, "contacts": contacts});
    let step = [5e-4, 1e-3, 2e-3][random.usize(0..3)];
    json!({"problem": {"rigid_bodies": members}, "time": {"end": 1}, "method": {"step": step}, "output": {"times": {"count": 2}}})
}

/// Number of mechanisms to test, which the environment variable `DVI_MECHANISMS` sets in place of 30.
#[test]
fn the_energy_of_random_mechanisms_is_accounted_for() {
    let count = std::env::var("DVI_MECHANISMS").map_or(30, |count| count.parse().expect("a number"));
    let mut defects = Vec::new();
    for seed in 0..count {
        let solution = solve(&mechanism(seed));
        let energy = solution.diagnostics.energy.unwrap();
        let part = energy.lacking() / energy.size();
        // A solution whose steps are too coarse for its energy balance is not trusted by the verdict.
        assert!(part < 1e-3 || !solution.verdict.trusted, "{seed}: {part:e}");
        defects.push(part);
    }
    defects.sort_by(f64::total_cmp);
    let [median, most] = [50, 93].map(|percent| defects[defects.len() * percent / 100]);
    assert!(median < 1e-5 && most < 1e-3, "{median:e} {most:e}");
}
