//! Robot descriptions in other formats, whose text is replaced by bodies and joints before the document is read.

use super::motors::Motor;
use super::vectors::Vector;
use crate::expression::Expression;
use crate::ordered::Ordered;
use serde::Deserialize;
use utoipa::ToSchema;

/// A robot described in URDF or MJCF: bodies of primitive shapes and joints, which become bodies and joints of the
/// scene. If the scene has no `gravity`, that of the description applies, for URDF 9.81 m/s^2 downwards. Elements
/// that affect the motion and have no counterpart in a scene, such as shapes in other files, are refused at their
/// line; warnings list other elements that are left out.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RobotDescription {
    /// The text of a URDF file. A root link without mass is fixed in the world, a root link with mass is free. Links
    /// of a robot do not touch each other.
    #[schema(max_length = 4_194_304)]
    pub urdf: Option<String>,
    /// The text of an MJCF file, of MuJoCo. Contacts are rigid, with the larger coefficient of friction of two
    /// shapes; `contype`, `conaffinity` and `exclude` determine which bodies touch. Controls are zero.
    #[schema(max_length = 4_194_304)]
    pub mjcf: Option<String>,
    /// The initial state of joints and free bodies, by their names. Default: that of the description, with joints at
    /// their references and everything at rest.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, PoseOfRobot>)]
    pub pose: Ordered<PoseOfRobot>,
    /// Motors of joints, by the names of the joints, as `motor` of a joint. Joint coordinates are zero at the start.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Motor>)]
    pub motors: Ordered<Motor>,
}

/// The initial state of a joint or of a free body, as numbers.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(untagged, expecting = "the position of a joint, or an object with `position` and `velocity`")]
pub enum PoseOfRobot {
    /// The initial position of a joint, in radians or metres.
    Position(Expression),
    /// The initial position and velocity of a joint; for a free body those of its origin, with its orientation
    /// `[w, x, y, z]` and its angular velocity.
    Start(Box<StartOfRobot>),
}

/// The initial state of a joint or of a free body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StartOfRobot {
    /// Position of a joint in radians or metres; for a free body three coordinates in metres.
    pub position: Option<NumberOrVector>,
    /// Velocity of a joint in radians or metres per second; for a free body three components in metres per second.
    pub velocity: Option<NumberOrVector>,
    /// Orientation of a free body, a unit quaternion `[w, x, y, z]`.
    pub orientation: Option<[Expression; 4]>,
    /// Angular velocity of a free body in the world frame, in radians per second.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub angular_velocity: Option<Vector>,
}

/// A number for a joint, or a vector for a free body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(untagged, expecting = "a number, or a list of three")]
pub enum NumberOrVector {
    /// The position or velocity of a joint.
    Number(Expression),
    /// The position or velocity of a free body.
    #[schema(value_type = [Expression; 3])]
    Vector(Vector),
}
