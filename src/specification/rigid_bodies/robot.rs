//! The description of a robot in another format. Its text is written out as bodies and joints before the document is read.

use super::motors::Motor;
use super::vectors::Vector;
use crate::expression::Expression;
use crate::ordered::Ordered;
use serde::Deserialize;
use utoipa::ToSchema;

/// A robot as other programs describe it, in `urdf` or in `mjcf`: bodies of primitive shapes and joints, written out as bodies and joints of
/// the scene. Where the scene has no `gravity`, that of the description holds, for URDF 9.81 m/s^2 downwards. What moves bodies and has no
/// counterpart here, such as shapes in other files, is refused at its line; what is left out beside it, warnings say.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RobotDescription {
    /// The text of a URDF file. A link without mass at the root stands in the world, one with mass is free. Links of a robot do not touch
    /// each other.
    #[schema(max_length = 4_194_304)]
    pub urdf: Option<String>,
    /// The text of an MJCF file, of MuJoCo. Contacts are rigid, with the larger friction of two shapes; `contype`, `conaffinity` and `exclude` say
    /// which touch. Controls are zero.
    #[schema(max_length = 4_194_304)]
    pub mjcf: Option<String>,
    /// How joints and free bodies begin, by their names. Default as they are described: joints at their references, all at rest.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, PoseOfRobot>)]
    pub pose: Ordered<PoseOfRobot>,
    /// What drives joints, by their names, as `motor` of a joint does. Coordinates are zero at the start.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Motor>)]
    pub motors: Ordered<Motor>,
}

/// The start of a joint, or of a free body: numbers.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(untagged, expecting = "the position of a joint, or an object with `position` and `velocity`")]
pub enum PoseOfRobot {
    /// The position of a joint, in radians or metres.
    Position(Expression),
    /// The position and velocity of a joint; of a free body those of its origin, its orientation `[w, x, y, z]` and its angular velocity.
    Start(Box<StartOfRobot>),
}

/// The start of a joint or of a free body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StartOfRobot {
    /// Radians or metres of a joint; of a free body three metres.
    pub position: Option<NumberOrVector>,
    /// The same a second.
    pub velocity: Option<NumberOrVector>,
    /// Of a free body a unit quaternion `[w, x, y, z]`.
    pub orientation: Option<[Expression; 4]>,
    /// Of a free body, in the world, in radians a second.
    #[schema(value_type = Option<[Expression; 3]>)]
    pub angular_velocity: Option<Vector>,
}

/// A number of a joint, or a vector of a free body.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(untagged, expecting = "a number, or a list of three")]
pub enum NumberOrVector {
    /// Of a joint.
    Number(Expression),
    /// Of a free body.
    #[schema(value_type = [Expression; 3])]
    Vector(Vector),
}
