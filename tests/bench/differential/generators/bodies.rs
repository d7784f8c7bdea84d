//! Random scenes of rigid bodies: spheres dropped and thrown on a floor, boxes that land flat, and pendulums on a
//! ball joint.

use crate::differential::problem::{Field, Problem, View, Way};
use crate::differential::random::Random;
use serde_json::{Value, json};

pub struct Bodies {
    bodies: Vec<Body>,
    gravity: f64,
    restitution: f64,
    friction: f64,
    end: f64,
    step: f64,
}

struct Body {
    radius: f64,
    is_box: bool,
    mass: f64,
    position: [f64; 3],
    velocity: [f64; 3],
    /// The fixed point in space from which the body hangs.
    joint: Option<[f64; 3]>,
}

pub fn generate(random: &mut Random) -> Bodies {
    let size = random.scale(1e-2, 1e2);
    let time = random.scale(1e-2, 1e2);
    let speed = size / time;
    let body = |random: &mut Random, k: usize| {
        let radius = 0.1 * size;
        // Bodies start side by side and far apart, so that they do not meet.
        let position = [10.0 * size * k as f64, 0.0, radius + size * random.uniform(0.0, 1.0)];
        let is_box = random.chance(0.25);
        let hangs = !is_box && random.chance(0.3);
        let velocity = if is_box || hangs {
            [0.0, 0.0, 0.0]
        } else {
            [speed * random.uniform(-1.0, 1.0), speed * random.uniform(-1.0, 1.0), speed * random.uniform(-0.5, 1.0)]
        };
        let above = |position: [f64; 3]| [position[0] + size * 0.5, position[1], position[2] + 3.0 * size];
        let joint = hangs.then(|| above(position));
        Body { radius, is_box, mass: random.scale(0.1, 10.0), position, velocity, joint }
    };
    let bodies = (0..random.whole(1, 3)).map(|k| body(random, k)).collect();
    Bodies {
        bodies,
        gravity: size / (time * time) * random.uniform(1.0, 5.0),
        restitution: *random.choose(&[0.0, 0.0, 0.3, 0.6]),
        friction: if random.chance(0.7) { random.uniform(0.05, 0.8) } else { 0.0 },
        end: time * random.uniform(1.0, 4.0),
        step: time / random.scale(200.0, 800.0),
    }
}

impl Problem for Bodies {
    fn document(&self, view: &View) -> Value {
        let length = |x: f64| x / view.size;
        let speed = |x: f64| x * view.time / view.size;
        let mut bodies = vec![json!({"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true})];
        let mut joints = Vec::new();
        for (k, body) in self.bodies.iter().enumerate() {
            let shape = match body.is_box {
                true => {
                    json!({"box": {"size": [length(4.0 * body.radius), length(3.0 * body.radius), length(2.0 * body.radius)]}})
                }
                false => json!({"sphere": {"radius": length(body.radius)}}),
            };
            let mut position = body.position.map(length);
            position[0] += length(view.change(2 * k));
            position[2] += length(view.change(2 * k + 1));
            bodies.push(json!({
                "name": format!("b{k}"), "shape": shape, "mass": body.mass, "position": position,
                "velocity": body.velocity.map(speed),
            }));
            if let Some(at) = body.joint {
                joints.push(json!({"ball": {"bodies": [format!("b{k}")], "at": at.map(length)}}));
            }
        }
        json!({"rigid_bodies": {
            "gravity": [0, 0, -self.gravity * view.time * view.time / view.size],
            "bodies": bodies, "joints": joints,
            "contacts": {"friction": self.friction, "restitution": self.restitution},
        }})
    }

    fn fields(&self) -> Vec<Field> {
        let of_body = |k: usize| ["x", "z", "y"].map(|axis| Field::sized(format!("b{k}.{axis}")));
        let all: Vec<Field> = (0..self.bodies.len()).flat_map(of_body).collect();
        // The fields whose initial values are perturbed come before all others.
        let (first, rest): (Vec<Field>, Vec<Field>) = all.into_iter().partition(|field| !field.name.ends_with(".y"));
        first.into_iter().chain(rest).collect()
    }

    fn starts(&self) -> usize {
        2 * self.bodies.len()
    }

    fn starts_on_bound(&self) -> bool {
        true
    }

    fn end(&self) -> f64 {
        self.end
    }

    fn way(&self) -> Way {
        Way::Step(self.step)
    }

    fn smallest(&self) -> f64 {
        self.bodies[0].radius
    }

    fn is_unique(&self) -> bool {
        true
    }
}
