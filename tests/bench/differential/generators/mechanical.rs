//! Random mechanical systems: an oscillator with a stop, a ball that bounces and slides, a block on a rough floor
//! pulled by a spring, a pendulum on a joint, and two bodies on a spring that collide.

use crate::differential::problem::{Field, Problem, View, Way};
use crate::differential::random::Random;
use crate::differential::reference::{Stop, Values};
use crate::differential::signal::Signal;
use serde_json::{Value, json};

struct Mechanical {
    scene: MultibodySystem,
    end: f64,
    /// The step size of time stepping; `None` if impacts are located.
    step: Option<f64>,
}

enum MultibodySystem {
    Stop(Stop),
    Ball { height: f64, velocity: [f64; 2], gravity: f64, restitution: f64, friction: f64 },
    Block { friction: f64, gravity: f64, stiffness: f64, drive: Signal, initial: [f64; 2] },
    Pendulum { length: f64, gravity: f64, angle: f64, wall: Option<(f64, f64)> },
    Pair { masses: [f64; 2], stiffness: f64, rest: f64, initial: [f64; 4], restitution: f64 },
}

pub fn generate(random: &mut Random, stepped: bool) -> Box<dyn Problem> {
    let size = random.scale(1e-2, 1e2);
    let time = random.scale(1e-2, 1e2);
    let gravity = size / (time * time) * random.uniform(1.0, 10.0);
    let restitution = *random.choose(&[0.0, 0.3, 0.5, 0.8, 0.9]);
    let omega = random.scale(0.3, 3.0) / time;
    let speed = size / time;
    let scene = match random.whole(0, if stepped { 3 } else { 4 }) {
        0 => MultibodySystem::Stop(Stop {
            stiffness: random.uniform(0.0, 2.0) / (time * time),
            damping: random.uniform(0.05, 0.5) / time,
            force: {
                let mut force = Signal::random(random, gravity * 0.3, omega, 2);
                force.constant -= gravity * random.uniform(0.0, 0.5);
                force
            },
            wall: -size * random.uniform(0.0, 0.5),
            restitution,
            initial: [size * random.uniform(0.1, 1.0), speed * random.uniform(-1.0, 1.0)],
        }),
        1 => MultibodySystem::Ball {
            height: size * random.uniform(0.1, 1.0),
            velocity: [speed * random.uniform(-3.0, 3.0), speed * random.uniform(-1.0, 1.0)],
            gravity,
            restitution,
            friction: if random.chance(0.7) { random.uniform(0.05, 0.8) } else { 0.0 },
        },
        2 => MultibodySystem::Block {
            friction: random.uniform(0.05, 0.5),
            gravity,
            stiffness: random.uniform(0.2, 3.0) / (time * time),
            drive: Signal::random(random, gravity * 0.5, omega, 2),
            initial: [size * random.uniform(-1.0, 1.0), speed * random.uniform(-1.0, 1.0)],
        },
        3 => MultibodySystem::Pair {
            masses: [random.scale(0.1, 10.0), random.scale(0.1, 10.0)],
            stiffness: random.uniform(0.5, 3.0) / (time * time),
            rest: size * random.uniform(0.2, 0.8),
            initial: [0.0, size * random.uniform(0.5, 1.5), speed * random.uniform(-1.0, 1.0), 0.0],
            restitution,
        },
        _ => MultibodySystem::Pendulum {
            length: size,
            gravity,
            angle: random.uniform(-1.4, 1.4),
            wall: random.chance(0.5).then(|| (size * random.uniform(0.1, 0.5), restitution)),
        },
    };
    let end = time * random.scale(2.0, 15.0);
    Box::new(Mechanical { scene, end, step: stepped.then_some(time / random.scale(300.0, 1500.0)) })
}

impl Mechanical {
    /// Converts a value to the units of `view`, given the powers of length and time in its unit.
    fn in_units(view: &View, value: f64, size: i32, time: i32) -> f64 {
        value / (view.size.powi(size) * view.time.powi(time))
    }

    fn names(&self) -> &'static [&'static str] {
        match self.scene {
            MultibodySystem::Stop(_) => &["q"],
            MultibodySystem::Ball { .. } | MultibodySystem::Pendulum { .. } => &["x", "y"],
            MultibodySystem::Block { .. } => &["x"],
            MultibodySystem::Pair { .. } => &["p", "q"],
        }
    }
}

impl Problem for Mechanical {
    fn document(&self, view: &View) -> Value {
        let q = |value: f64, state: usize| Self::in_units(view, value + view.change(state), 1, 0);
        let v = |value: f64, state: usize| Self::in_units(view, value + view.change(state), 1, -1);
        let rate = |value: f64| Self::in_units(view, value, 0, -1);
        let spring = |value: f64| Self::in_units(view, value, 0, -2);
        let pull = |value: f64| Self::in_units(view, value, 1, -2);
        let force = |signal: &Signal| signal.expression(Self::in_units(view, 1.0, 1, -2), view.time);
        let problem = match &self.scene {
            MultibodySystem::Stop(stop) => json!({
                "coordinates": {"q": {"initial": q(stop.initial[0], 0), "velocity": v(stop.initial[1], 1)}},
                "mass": [[1]],
                "potential": format!("({:?})*q^2/2", spring(stop.stiffness)),
                "forces": {"q": format!("{} - ({:?})*q_dot", force(&stop.force), rate(stop.damping))},
                "contacts": [{
                    "name": "stop", "gap": format!("q - ({:?})", Self::in_units(view, stop.wall, 1, 0)),
                    "restitution": stop.restitution
                }],
            }),
            MultibodySystem::Ball { height, velocity, gravity, restitution, friction } => {
                let mut contact = json!({"name": "floor", "gap": "y", "restitution": restitution});
                if *friction > 0.0 {
                    contact["friction"] = json!({"coefficient": friction, "slip": ["x_dot"]});
                }
                json!({
                    "coordinates": {
                        "x": {"initial": q(0.0, 0), "velocity": v(velocity[0], 2)},
                        "y": {"initial": q(*height, 1), "velocity": v(velocity[1], 3)},
                    },
                    "mass": [[1, 0], [0, 1]],
                    "potential": format!("({:?})*y", pull(*gravity)),
                    "contacts": [contact],
                })
            }
            MultibodySystem::Block { friction, gravity, stiffness, drive, initial } => json!({
                "coordinates": {
                    "x": {"initial": q(initial[0], 0), "velocity": v(initial[1], 1)},
                    "y": {"initial": 0},
                },
                "mass": [[1, 0], [0, 1]],
                "potential": format!("({:?})*y + ({:?})*x^2/2", pull(*gravity), spring(*stiffness)),
                "forces": {"x": force(drive)},
                "contacts": [{
                    "name": "floor", "gap": "y", "friction": {"coefficient": friction, "slip": ["x_dot"]}
                }],
            }),
            MultibodySystem::Pendulum { length, gravity, angle, wall } => {
                let (x, y) = (length * angle.sin(), -length * angle.cos());
                let mut scene = json!({
                    "coordinates": {
                        "x": {"initial": Self::in_units(view, x, 1, 0)}, "y": {"initial": Self::in_units(view, y, 1, 0)},
                    },
                    "mass": [[1, 0], [0, 1]],
                    "potential": format!("({:?})*y", pull(*gravity)),
                    "joints": [{
                        "name": "rod",
                        "constraint": format!("x^2 + y^2 - ({:?})", Self::in_units(view, length * length, 2, 0))
                    }],
                });
                if let Some((distance, restitution)) = wall {
                    // The wall is on the side of the pendulum away from its initial position.
                    let side = if *angle > 0.0 { "x" } else { "-x" };
                    let gap = format!("{side} + ({:?})", Self::in_units(view, *distance, 1, 0));
                    scene["contacts"] = json!([{"name": "wall", "gap": gap, "restitution": restitution}]);
                }
                scene
            }
            MultibodySystem::Pair { masses, stiffness, rest, initial, restitution } => json!({
                "coordinates": {
                    "p": {"initial": q(initial[0], 0), "velocity": v(initial[2], 2)},
                    "q": {"initial": q(initial[1], 1), "velocity": v(initial[3], 3)},
                },
                "mass": [[masses[0], 0], [0, masses[1]]],
                "potential": format!(
                    "({:?})*(q - p - ({:?}))^2/2", spring(*stiffness), Self::in_units(view, *rest, 1, 0)
                ),
                "contacts": [{"name": "between", "gap": "q - p", "restitution": restitution}],
            }),
        };
        json!({"mechanical": problem})
    }

    fn fields(&self) -> Vec<Field> {
        let positions = self.names().iter().map(|name| Field::sized(*name));
        positions.chain(self.names().iter().map(|name| Field::velocity(format!("{name}_dot")))).collect()
    }

    fn starts(&self) -> usize {
        if matches!(self.scene, MultibodySystem::Pendulum { .. }) { 0 } else { 2 * self.names().len() }
    }

    fn end(&self) -> f64 {
        self.end
    }

    fn way(&self) -> Way {
        self.step.map_or(Way::Stages, Way::Step)
    }

    fn smallest(&self) -> f64 {
        let size = match &self.scene {
            MultibodySystem::Stop(stop) => stop.initial[0].abs(),
            MultibodySystem::Ball { height, .. } => *height,
            MultibodySystem::Block { initial, .. } => initial[0].abs(),
            MultibodySystem::Pendulum { length, .. } => *length,
            MultibodySystem::Pair { rest, .. } => *rest,
        };
        // In a long unit of time velocities are large numbers, and in a short one they are small.
        0.1 * size * (1.0 / self.end).min(1.0)
    }

    fn is_unique(&self) -> bool {
        true
    }

    fn reference(&self, change: &[f64], times: &[f64]) -> Option<Values> {
        let MultibodySystem::Stop(stop) = &self.scene else { return None };
        let mut stop = stop.clone();
        stop.initial.iter_mut().zip(change).for_each(|(x, change)| *x += change);
        stop.solve(times)
    }
}
