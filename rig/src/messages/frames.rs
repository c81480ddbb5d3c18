//! Messages for viewers: coordinate frames, and the description of the rig.

use serde::{Deserialize, Serialize};

use super::{Header, Message};

/// A displacement (m).
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// A rotation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Self {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 1.0,
        }
    }
}

/// A pose of one frame in another.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Transform {
    /// Origin (m).
    pub translation: Vector3,
    /// Orientation.
    pub rotation: Quaternion,
}

/// A pose with its time and the names of the frames.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TransformStamped {
    /// Time, and the parent frame.
    pub header: Header,
    /// The child frame.
    pub child_frame_id: String,
    /// The child's pose in the parent.
    pub transform: Transform,
}

/// Poses of several frames.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TfMessage {
    /// The poses.
    pub transforms: Vec<TransformStamped>,
}

/// A text: `std_msgs/String`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Text {
    /// The text.
    pub data: String,
}

impl Message for TfMessage {
    const PACKAGE: &'static str = "tf2_msgs";
    const NAME: &'static str = "TFMessage";
    const DEFINITION: &'static str = concat!(
        "geometry_msgs/TransformStamped[] transforms\n",
        part!(
            "geometry_msgs/TransformStamped",
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
        ),
        part!(
            "geometry_msgs/Transform",
            "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
        ),
        part!("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
        part!(
            "geometry_msgs/Quaternion",
            "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"
        ),
        header!()
    );
}

impl Message for Text {
    const PACKAGE: &'static str = "std_msgs";
    const NAME: &'static str = "String";
    const DEFINITION: &'static str = "string data\n";
}
