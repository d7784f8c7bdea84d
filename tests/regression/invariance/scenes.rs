//! Test scenes for every type of problem and every stepping method, which can be written in any units.

use serde_json::{Value, json};
use std::f64::consts::TAU;

/// The sizes of the three base units of a scene, relative to the reference units: mass, length and time for
/// mechanics; volt, ohm and second for circuits; unit of the values, length and time for fields.
pub type Units = [f64; 3];

/// The exponents of the three base units in the unit of a value.
pub type Dimension = [f64; 3];

/// A specification that can be written in any units.
pub struct MultibodySystem {
    pub name: &'static str,
    /// The names of the three base units of the scene, such as mass, length and time.
    pub axes: [&'static str; 3],
    /// Returns the problem in the given units, its end time, and its method without the absolute tolerances.
    pub write: fn(Units) -> (Value, f64, Value),
    /// The output fields that are compared between runs, with their dimensions.
    pub fields: &'static [(&'static str, Dimension)],
    /// How absolute tolerances of the scene are given; if each state has a tolerance of its own, all states are
    /// compared.
    pub tolerances: Tolerances,
    /// Permitted difference of a field relative to its largest value, and of an event time relative to the end: some
    /// hundred relative tolerances, or rounding errors if the steps are fixed.
    pub within: f64,
}

/// How the absolute tolerances of a scene's method are written.
#[derive(Clone, Copy)]
pub enum Tolerances {
    /// One absolute tolerance for each of the first fields of the scene, whose number is given.
    Fields(usize),
    /// One absolute tolerance, with this dimension, for all states.
    All(Dimension),
    /// No absolute tolerances: the stepping method has fixed steps.
    None,
}

const MECHANICS: [&str; 3] = ["mass", "length", "time"];
const CIRCUITS: [&str; 3] = ["volt", "ohm", "second"];
const FIELDS: [&str; 3] = ["value", "length", "time"];

const NONE: Dimension = [0.0, 0.0, 0.0];
const LENGTH: Dimension = [0.0, 1.0, 0.0];
const SPEED: Dimension = [0.0, 1.0, -1.0];
const PER_TIME: Dimension = [0.0, 0.0, -1.0];
const FORCE: Dimension = [1.0, 1.0, -2.0];
const VALUE: Dimension = [1.0, 0.0, 0.0];

/// All scenes of which the invariance under units and horizon is tested.
pub const SCENES: [MultibodySystem; 20] = [
    MultibodySystem {
        name: "dvi: friction on a belt",
        axes: MECHANICS,
        write: belt,
        fields: &[("x", LENGTH), ("v", SPEED), ("F", FORCE)],
        tolerances: Tolerances::Fields(2),
        within: 1e-6,
    },
    MultibodySystem {
        name: "dvi: friction in the plane",
        axes: MECHANICS,
        write: disk,
        fields: &[("x", LENGTH), ("y", LENGTH), ("vx", SPEED), ("vy", SPEED), ("Fx", FORCE)],
        tolerances: Tolerances::Fields(4),
        within: 1e-6,
    },
    MultibodySystem {
        name: "dvi: pendulum of index two",
        axes: MECHANICS,
        write: pendulum_of_index_two,
        fields: &[("x", LENGTH), ("y", LENGTH), ("u", SPEED), ("v", SPEED), ("tension", [0.0, 0.0, -2.0])],
        tolerances: Tolerances::Fields(4),
        within: 1e-6,
    },
    MultibodySystem {
        name: "filippov: a circle that turns round",
        axes: MECHANICS,
        write: circle,
        fields: &[("x", LENGTH), ("y", LENGTH)],
        tolerances: Tolerances::Fields(2),
        within: 1e-6,
    },
    MultibodySystem {
        name: "lcs: two queues",
        axes: FIELDS,
        write: queues,
        fields: &[("q1", VALUE), ("q2", VALUE), ("idle1", [1.0, 0.0, -1.0])],
        tolerances: Tolerances::Fields(2),
        within: 1e-6,
    },
    MultibodySystem {
        name: "circuit: rectifier with a filter",
        axes: CIRCUITS,
        write: rectifier,
        fields: &[("v(C1)", VALUE), ("i(L1)", [1.0, -1.0, 0.0])],
        tolerances: Tolerances::Fields(2),
        within: 1e-6,
    },
    MultibodySystem {
        name: "mechanical, located: bouncing ball",
        axes: MECHANICS,
        write: |units| located(bouncing_ball(units)),
        fields: &[("y", LENGTH), ("y_dot", SPEED)],
        tolerances: Tolerances::Fields(2),
        within: 1e-6,
    },
    MultibodySystem {
        name: "mechanical, located: ball with spin",
        axes: MECHANICS,
        write: |units| located(spinning_ball(units)),
        fields: &[("a", NONE), ("x", LENGTH), ("y", LENGTH), ("a_dot", PER_TIME), ("x_dot", SPEED), ("y_dot", SPEED)],
        tolerances: Tolerances::Fields(6),
        within: 1e-6,
    },
    MultibodySystem {
        name: "mechanical, located: block that rocks",
        axes: MECHANICS,
        write: |units| located(rocking_block(units)),
        fields: &[
            ("angle", NONE),
            ("x", LENGTH),
            ("y", LENGTH),
            ("angle_dot", PER_TIME),
            ("x_dot", SPEED),
            ("y_dot", SPEED),
        ],
        tolerances: Tolerances::Fields(6),
        within: 1e-5,
    },
    MultibodySystem {
        name: "mechanical, located: pendulum and wall",
        axes: MECHANICS,
        write: |units| located(pendulum_and_wall(units)),
        fields: &[("x", LENGTH), ("y", LENGTH), ("x_dot", SPEED), ("y_dot", SPEED)],
        tolerances: Tolerances::Fields(4),
        within: 1e-6,
    },
    MultibodySystem {
        name: "mechanical, time stepping: ball with spin",
        axes: MECHANICS,
        write: |units| stepped(spinning_ball(units)),
        fields: &[("a", NONE), ("x", LENGTH), ("y", LENGTH)],
        tolerances: Tolerances::None,
        within: 1e-9,
    },
    MultibodySystem {
        name: "mechanical, time stepping: block that rocks",
        axes: MECHANICS,
        write: |units| stepped(rocking_block(units)),
        fields: &[("angle", NONE), ("x", LENGTH), ("y", LENGTH)],
        tolerances: Tolerances::None,
        within: 1e-9,
    },
    MultibodySystem {
        name: "mechanical, time stepping: pendulum and wall",
        axes: MECHANICS,
        write: |units| stepped(pendulum_and_wall(units)),
        fields: &[("x", LENGTH), ("y", LENGTH)],
        tolerances: Tolerances::None,
        within: 1e-9,
    },
    MultibodySystem {
        name: "rigid bodies: ball thrown with spin",
        axes: MECHANICS,
        write: |units| stepped(thrown_ball(units)),
        fields: &[("ball.x", LENGTH), ("ball.z", LENGTH), ("ball.vx", SPEED), ("ball.wy", PER_TIME)],
        tolerances: Tolerances::None,
        within: 1e-9,
    },
    MultibodySystem {
        name: "rigid bodies: boxes that fall on each other",
        axes: MECHANICS,
        write: |units| stepped(boxes(units)),
        fields: &[("lower.z", LENGTH), ("upper.z", LENGTH), ("upper.x", LENGTH)],
        tolerances: Tolerances::None,
        within: 1e-9,
    },
    MultibodySystem {
        name: "rigid bodies, default step: ball thrown with spin",
        axes: MECHANICS,
        write: |units| by_default(thrown_ball(units)),
        fields: &[("ball.x", LENGTH), ("ball.z", LENGTH), ("ball.vx", SPEED), ("ball.wy", PER_TIME)],
        tolerances: Tolerances::None,
        within: 1e-9,
    },
    MultibodySystem {
        name: "elastic: bar thrown at a wall",
        axes: MECHANICS,
        write: bar,
        fields: &[("contact_end", LENGTH), ("free_end", LENGTH), ("force_x_min", FORCE)],
        tolerances: Tolerances::All(LENGTH),
        within: 1e-5,
    },
    MultibodySystem {
        name: "obstacle: membrane let down",
        axes: FIELDS,
        write: membrane,
        fields: &[("middle", VALUE), ("beside", VALUE), ("total", [1.0, 1.0, 0.0])],
        tolerances: Tolerances::All(VALUE),
        within: 1e-4,
    },
    MultibodySystem {
        name: "convolution: Abel's kernel",
        axes: FIELDS,
        write: abel,
        fields: &[("u", [1.0, 0.0, -0.5])],
        tolerances: Tolerances::Fields(1),
        within: 1e-2,
    },
    MultibodySystem {
        name: "convolution: a relaxation between bounds",
        axes: FIELDS,
        write: relaxation_with_memory,
        fields: &[("u", [1.0, 0.0, -0.5])],
        tolerances: Tolerances::Fields(1),
        within: 1e-5,
    },
];

impl MultibodySystem {
    /// Returns the specification of the scene with `count` output times up to its end, in a run to `beyond` times the
    /// end, and the end of the scene.
    pub fn specification(&self, units: Units, count: usize, beyond: f64) -> (Value, f64) {
        let (problem, end, mut method) = (self.write)(units);
        let rtol = method["rtol"].as_f64().unwrap_or(1e-6);
        method["atol"] = match self.tolerances {
            Tolerances::None => Value::Null,
            Tolerances::All(dimension) => json!(1e-3 * rtol * unit(dimension, units)),
            Tolerances::Fields(states) => {
                let states = self.fields.iter().take(states);
                states.map(|(name, of)| ((*name).to_owned(), json!(1e-3 * rtol * unit(*of, units)))).collect()
            }
        };
        // No output time is a simple fraction of the end time: there variables may jump at switches, where both
        // one-sided values are right.
        let times: Vec<f64> = (0..count).map(|k| end * (k as f64 + 0.618) / count as f64).collect();
        let fields: Vec<&str> = self.fields.iter().map(|(name, _)| *name).collect();
        let specification = json!({"problem": problem, "time": {"end": beyond * end}, "method": method,
                                   "output": {"times": times, "fields": fields}});
        (specification, end)
    }
}

/// Returns the size of the derived unit with this dimension.
pub fn unit(dimension: Dimension, units: Units) -> f64 {
    units.iter().zip(dimension).map(|(unit, exponent)| unit.powf(exponent)).product()
}

/// Returns a mechanical problem and its end time together with a method that locates each impact.
fn located((problem, end): (Value, f64)) -> (Value, f64, Value) {
    (problem, end, json!({"impacts": "locate", "rtol": 1e-8}))
}

/// Returns a problem and its end time together with a method of a thousand fixed steps.
fn stepped((problem, end): (Value, f64)) -> (Value, f64, Value) {
    (problem, end, json!({"step": end / 1000.0}))
}

/// Returns a problem and its end time together with the default method.
fn by_default((problem, end): (Value, f64)) -> (Value, f64, Value) {
    (problem, end, json!({}))
}

fn belt([m, l, t]: Units) -> (Value, f64, Value) {
    let problem = json!({"dvi": {
        "parameters": {"m": m, "c": 0.1 * m / t, "k": m / (t * t), "f": m * l / (t * t), "v_belt": 0.5 * l / t},
        "states": {"x": {"initial": 4.0 * l, "rate": "v"}, "v": {"initial": 0, "rate": "(-c*v - k*x - F)/m"}},
        "variables": {"F": {"inequality": "-(v - v_belt)"}},
        "set": [{"box": {"of": ["F"], "lower": "-f", "upper": "f"}}]}});
    (problem, 20.0 * t, json!({"rtol": 1e-8}))
}

fn disk([m, l, t]: Units) -> (Value, f64, Value) {
    let problem = json!({"dvi": {
        "parameters": {"m": 2.0 * m, "g": 9.81 * l / (t * t), "mu": 0.4},
        "states": {"x": {"initial": 0, "rate": "vx"}, "y": {"initial": 0, "rate": "vy"},
                   "vx": {"initial": 3.0 * l / t, "rate": "-Fx/m"}, "vy": {"initial": 4.0 * l / t, "rate": "-Fy/m"}},
        "variables": {"Fx": {"inequality": "-vx"}, "Fy": {"inequality": "-vy"}},
        "set": [{"ball": {"of": ["Fx", "Fy"], "radius": "mu*m*g"}}]}});
    (problem, 2.0 * t, json!({"rtol": 1e-8}))
}

fn pendulum_of_index_two([_, l, t]: Units) -> (Value, f64, Value) {
    let problem = json!({"dvi": {
        "parameters": {"g": 9.81 * l / (t * t)},
        "states": {"x": {"initial": l, "rate": "u"}, "y": {"initial": 0, "rate": "v"},
                   "u": {"initial": 0, "rate": "-x*tension"}, "v": {"initial": 0, "rate": "-y*tension - g"}},
        "variables": {"tension": {"inequality": "-(x*u + y*v)"}},
        "set": [{"free": ["tension"]}]}});
    (problem, 3.0 * t, json!({"rtol": 1e-8}))
}

fn circle([_, l, t]: Units) -> (Value, f64, Value) {
    let problem = json!({"filippov": {
        "parameters": {"omega": TAU / t, "tau": t, "r": l},
        "states": {"x": {"initial": "r*exp(-1)", "plus": "x/tau - omega*y", "minus": "x/tau + omega*y"},
                   "y": {"initial": 0, "plus": "omega*x + y/tau", "minus": "-omega*x + y/tau"}},
        "surface": "r^2 - x^2 - y^2"}});
    (problem, 1.5 * t, json!({"rtol": 1e-8}))
}

fn queues([v, _, t]: Units) -> (Value, f64, Value) {
    let problem = json!({"lcs": {
        "parameters": {"arrivals": 1.5 * v / t, "mu1": 2.0 * v / t, "mu2": 1.2 * v / t},
        "state_names": ["q1", "q2"], "variable_names": ["idle1", "idle2"], "initial": [3.0 * v, 0],
        "a": ["arrivals - mu1", "mu1 - mu2"], "B": [[1, 0], [-1, 1]], "C": [[1, 0], [0, 1]],
        "set": [{"nonnegative": ["idle1", "idle2"]}]}});
    (problem, 12.0 * t, json!({"rtol": 1e-8}))
}

fn rectifier([v, r, s]: Units) -> (Value, f64, Value) {
    let (peak, hertz, l, c, load) = (10.0 * v, 50.0 / s, 1e-2 * s * r, 1e-5 * s / r, 1e3 * r);
    let netlist = format!("V1 a 0 SIN(0 {peak:e} {hertz:e})\nL1 a b {l:e}\nD1 b c\nC1 c 0 {c:e}\nR1 c 0 {load:e}");
    (json!({"circuit": {"netlist": netlist}}), 0.1 * s, json!({"rtol": 1e-8}))
}

fn bouncing_ball([m, l, t]: Units) -> (Value, f64) {
    let problem = json!({"mechanical": {
        "parameters": {"m": m, "g": 9.81 * l / (t * t)},
        "coordinates": {"y": {"initial": l}}, "mass": [["m"]], "potential": "m*g*y",
        "contacts": [{"name": "floor", "gap": "y", "restitution": 0.6}]}});
    (problem, 3.0 * t)
}

fn spinning_ball([m, l, t]: Units) -> (Value, f64) {
    let problem = json!({"mechanical": {
        "parameters": {"m": m, "g": 9.81 * l / (t * t), "R": 0.1 * l},
        "coordinates": {"a": {"initial": 0}, "x": {"initial": 0, "velocity": 2.0 * l / t}, "y": {"initial": l}},
        "mass": [["0.4*m*R^2", 0, 0], [0, "m", 0], [0, 0, "m"]], "potential": "m*g*y",
        "contacts": [{"name": "floor", "gap": "y - R", "restitution": 0.7,
                      "friction": {"coefficient": 0.2, "slip": ["x_dot + R*a_dot"]}}]}});
    (problem, 1.5 * t)
}

fn rocking_block([m, l, t]: Units) -> (Value, f64) {
    let problem = json!({"mechanical": {
        "parameters": {"b": 0.1 * l, "h": 0.4 * l, "m": m, "g": 9.81 * l / (t * t), "tilt": "0.5*atan(b/h)"},
        "coordinates": {"angle": {"initial": "tilt"}, "x": {"initial": "b*cos(tilt) - h*sin(tilt)"},
                        "y": {"initial": "b*sin(tilt) + h*cos(tilt)"}},
        "mass": [["m*(b^2 + h^2)/3", 0, 0], [0, "m", 0], [0, 0, "m"]], "potential": "m*g*y",
        "contacts": [
            {"name": "left", "gap": "y - b*sin(angle) - h*cos(angle)",
             "friction": {"coefficient": 2, "slip": ["x_dot + (b*sin(angle) + h*cos(angle))*angle_dot"]}},
            {"name": "right", "gap": "y + b*sin(angle) - h*cos(angle)",
             "friction": {"coefficient": 2, "slip": ["x_dot + (-b*sin(angle) + h*cos(angle))*angle_dot"]}}]}});
    (problem, 1.5 * t)
}

fn pendulum_and_wall([m, l, t]: Units) -> (Value, f64) {
    let problem = json!({"mechanical": {
        "parameters": {"m": m, "g": 9.81 * l / (t * t), "l": l},
        "coordinates": {"x": {"initial": "l"}, "y": {"initial": 0}},
        "mass": [["m", 0], [0, "m"]], "potential": "m*g*y",
        "joints": [{"name": "rod", "constraint": "x^2 + y^2 - l^2"}],
        "contacts": [{"name": "wall", "gap": "x + 0.3*l", "restitution": 0.8}]}});
    (problem, 2.0 * t)
}

fn thrown_ball([m, l, t]: Units) -> (Value, f64) {
    let problem = json!({"rigid_bodies": {
        "gravity": [0, 0, -9.81 * l / (t * t)],
        "bodies": [{"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true},
                   {"name": "ball", "shape": {"sphere": {"radius": 0.1 * l}}, "mass": m, "position": [0, 0, 0.5 * l],
                    "velocity": [2.0 * l / t, 0, 0]}],
        "contacts": {"friction": 0.3, "restitution": 0.5}}});
    (problem, t)
}

fn boxes([m, l, t]: Units) -> (Value, f64) {
    let cube = json!({"box": {"size": [0.2 * l, 0.2 * l, 0.2 * l]}});
    let problem = json!({"rigid_bodies": {
        "gravity": [0, 0, -9.81 * l / (t * t)],
        "bodies": [{"name": "ground", "shape": {"half_space": {"normal": [0, 0, 1]}}, "fixed": true},
                   {"name": "lower", "shape": cube, "mass": m, "position": [0, 0, 0.15 * l]},
                   {"name": "upper", "shape": cube, "mass": 2.0 * m, "position": [0.02 * l, 0, 0.4 * l],
                    "velocity": [0.3 * l / t, 0, 0]}],
        "contacts": {"friction": 0.4}}});
    (problem, 0.5 * t)
}

fn bar([m, l, t]: Units) -> (Value, f64, Value) {
    let problem = json!({"elastic": {
        "parameters": {"L": 10.0 * l, "E": 900.0 * m * l / (t * t), "rho": m / l, "h0": 5.0 * l, "v0": 10.0 * l / t},
        "body": {"bar": {"x": [0, "L"]}}, "elements": 20, "density": "rho", "young": "E",
        "contact": {"x_min": {"gap": "h0"}}, "initial": {"velocity": ["-v0"]},
        "probes": {"contact_end": [0], "free_end": ["L"]}}});
    (problem, 2.0 * t, json!({"rtol": 1e-8}))
}

fn membrane([v, l, t]: Units) -> (Value, f64, Value) {
    let problem = json!({"obstacle": {
        "parameters": {"l": l, "d": l * l / t, "weight": 12.0 * v / t, "v": v},
        "domain": {"x": [0, "l"]}, "elements": 51, "diffusion": "d", "source": "-weight", "obstacle": 0, "initial": "v",
        "boundary": {"x_min": {"dirichlet": "v"}, "x_max": {"dirichlet": "v"}},
        "probes": {"middle": ["0.5*l"], "beside": ["0.3*l"]}}});
    (problem, t, json!({"rtol": 1e-6}))
}

fn relaxation_with_memory([v, _, t]: Units) -> (Value, f64, Value) {
    let problem = json!({"convolution": {
        "parameters": {"v": v, "tau": t},
        "variables": {"u": {"q": "v*(1.2 - cos(3*t/tau) - 1.4*sin(t/tau)^2)"}},
        "kernel": {"fractional": {"exponent": 0.5}},
        "set": [{"box": {"of": ["u"], "lower": 0, "upper": "v/sqrt(tau)"}}]}});
    (problem, 5.0 * t, json!({"rtol": 1e-6}))
}

fn abel([v, _, t]: Units) -> (Value, f64, Value) {
    let problem = json!({"convolution": {
        "parameters": {"v": v, "tau": t},
        "variables": {"u": {"q": "v*(1 - t/tau)"}},
        "kernel": {"fractional": {"exponent": 0.5, "matrix": [[1]]}}, "set": [{"nonnegative": ["u"]}]}});
    (problem, 3.0 * t, json!({"rtol": 1e-4}))
}
