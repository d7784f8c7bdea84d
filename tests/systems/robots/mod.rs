//! Robots in URDF and MJCF, written as public models are: each loads, starts in its pose, and moves as closed forms
//! and independent equations of motion predict. `peers/robots.py` compares them with MuJoCo.

mod contacts;
mod loaded;
mod motion;
mod refusals;

use serde_json::{Value, json};

/// Robot descriptions for the tests: name, format and text.
pub const MODELS: [(&str, &str, &str); 11] = [
    ("pendulum", "urdf", include_str!("models/pendulum.urdf")),
    ("double_pendulum", "urdf", include_str!("models/double_pendulum.urdf")),
    ("cartpole", "urdf", include_str!("models/cartpole.urdf")),
    ("arm", "urdf", include_str!("models/arm.urdf")),
    ("quadruped", "urdf", include_str!("models/quadruped.urdf")),
    ("two_poles", "mjcf", include_str!("models/double_pendulum.xml")),
    ("hopper", "mjcf", include_str!("models/hopper.xml")),
    ("half_cheetah", "mjcf", include_str!("models/half_cheetah.xml")),
    ("ant", "mjcf", include_str!("models/ant.xml")),
    ("humanoid", "mjcf", include_str!("models/humanoid.xml")),
    ("four_bar", "mjcf", include_str!("models/four_bar.xml")),
];

/// Returns the format and the text of the robot description with this name.
pub fn model(name: &str) -> (&'static str, &'static str) {
    let found = MODELS.iter().find(|(known, ..)| *known == name).unwrap_or_else(|| panic!("no model `{name}`"));
    (found.1, found.2)
}

/// A specification of the robot with this name that starts in `pose`.
pub fn specification(name: &str, pose: Value, end: f64, step: f64) -> Value {
    let (format, text) = model(name);
    json!({
        "problem": {"rigid_bodies": {"robot": {format: text, "pose": pose}}},
        "time": {"end": end},
        "method": {"step": step},
    })
}
