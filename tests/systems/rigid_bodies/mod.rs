//! Rigid bodies in space, from specification to trajectory, each system compared with a closed form or an independent
//! integration.

mod arches;
mod balance;
mod chains;
mod driven;
mod events;
mod feet;
mod free;
mod friction;
mod heap;
mod heaps;
mod impacts;
mod joints;
mod located;
mod mounts;
mod patches;
mod stacks;
mod surfaces;

use serde_json::{Value, json};

/// A specification of bodies on the half space `z <= 0`, under gravity 9.81 m/s^2.
fn on_the_ground(bodies: &[Value], contacts: &Value, end: f64, step: f64) -> Value {
    let mut all = vec![json!({"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true})];
    all.extend_from_slice(bodies);
    json!({
        "problem": {"rigid_bodies": {"gravity": [0, 0, -9.81], "bodies": all, "contacts": contacts}},
        "time": {"end": end},
        "method": {"step": step},
        "output": {"times": {"count": 101}},
    })
}

/// Returns the specification with the option that impacts are located in time.
fn locate(mut specification: Value) -> Value {
    specification["method"]["impacts"] = json!("locate");
    specification
}

/// Returns the specification with the option of time stepping through impacts.
fn stepped(mut specification: Value) -> Value {
    specification["method"]["impacts"] = json!("time_stepping");
    specification
}

/// Returns the rigid-body specification without gravity.
fn weightless(mut specification: Value) -> Value {
    specification["problem"]["rigid_bodies"]["gravity"] = json!([0, 0, 0]);
    specification
}

/// Specification of a box, a capsule, a convex hull and a sphere that fall onto each other.
fn falling_on_each_other() -> Value {
    let shapes = [
        json!({"box": {"size": [1, 1, 1]}}),
        json!({"capsule": {"radius": 0.3, "length": 1}}),
        json!({"convex_hull": {"points": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]}}),
        json!({"sphere": {"radius": 0.4}}),
    ];
    let body = |(k, shape): (usize, &Value)| {
        json!({"name": format!("b{k}"), "shape": shape, "density": 1000, "position": [0.1 * k as f64, 0, 1.5 + 2.0 * k as f64],
            "angular_velocity": [1, 0.3 * k as f64, 0]})
    };
    let bodies: Vec<Value> = shapes.iter().enumerate().map(body).collect();
    on_the_ground(&bodies, &json!({"friction": 0.5, "restitution": 0.2}), 6.0, 2e-3)
}
