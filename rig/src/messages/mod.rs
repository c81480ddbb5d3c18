//! The ROS 2 messages of the rig, and their definitions for bags.

use byteorder::LittleEndian;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// A message with its name and its text definition.
pub trait Message: Serialize + DeserializeOwned + std::fmt::Debug + Clone + Send + 'static {
    /// The package that defines it.
    const PACKAGE: &'static str;
    /// Its name in that package.
    const NAME: &'static str;
    /// Its definition, with those of all messages in it.
    const DEFINITION: &'static str;

    /// Package and name as ROS 2 writes them.
    fn type_name() -> String {
        format!("{}/msg/{}", Self::PACKAGE, Self::NAME)
    }
}

/// The bytes of a message as a bag holds them: CDR, little endian, behind its header of four bytes.
///
/// # Errors
/// [`Error::Broken`] if it cannot be written as CDR.
pub fn to_cdr<M: Message>(message: &M) -> Result<Vec<u8>> {
    let mut bytes = vec![0, 1, 0, 0];
    cdr_encoding::to_writer::<_, LittleEndian, _>(&mut bytes, message)
        .map_err(|error| Error::Broken(format!("{}: {error}", M::type_name())))?;
    Ok(bytes)
}

/// A time or a duration: `builtin_interfaces/Time` and `Duration`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds; since 1970 for a time.
    pub sec: i32,
    /// Remaining nanoseconds.
    pub nanosec: u32,
}

impl Time {
    /// Of nanoseconds.
    pub fn from_nanos(nanos: i64) -> Self {
        Self {
            sec: nanos.div_euclid(1_000_000_000) as i32,
            nanosec: nanos.rem_euclid(1_000_000_000) as u32,
        }
    }

    /// In nanoseconds.
    pub fn nanos(self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }

    /// Of seconds.
    pub fn from_seconds(seconds: f64) -> Self {
        Self::from_nanos((seconds * 1e9).round() as i64)
    }

    /// In seconds.
    pub fn seconds(self) -> f64 {
        self.nanos() as f64 / 1e9
    }
}

/// Time and frame.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// The time.
    pub stamp: Time,
    /// The coordinate frame.
    pub frame_id: String,
}

/// A place.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// The marble's tracked position.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PointStamped {
    /// When the picture was taken.
    pub header: Header,
    /// In the board's frame.
    pub point: Point,
}

/// Joint states.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// Time of measurement.
    pub header: Header,
    /// Names of the joints.
    pub name: Vec<String>,
    /// Angles (rad).
    pub position: Vec<f64>,
    /// Rates (rad/s); may be empty.
    pub velocity: Vec<f64>,
    /// Torques (N m); may be empty.
    pub effort: Vec<f64>,
}

/// A point of a trajectory.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectoryPoint {
    /// Angles (rad).
    pub positions: Vec<f64>,
    /// Rates (rad/s).
    pub velocities: Vec<f64>,
    /// Not used here.
    pub accelerations: Vec<f64>,
    /// Not used here.
    pub effort: Vec<f64>,
    /// Time from the trajectory's start.
    pub time_from_start: Time,
}

/// A trajectory of joints.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectory {
    /// Start time; zero starts at once.
    pub header: Header,
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// The points.
    pub points: Vec<JointTrajectoryPoint>,
}

/// A dimension of an array.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MultiArrayDimension {
    /// Label.
    pub label: String,
    /// Size.
    pub size: u32,
    /// Stride.
    pub stride: u32,
}

/// The shape of an array.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MultiArrayLayout {
    /// Its dimensions.
    pub dim: Vec<MultiArrayDimension>,
    /// Entries before the first.
    pub data_offset: u32,
}

/// Numbers: to a group controller, the rates of its joints (rad/s).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Float64MultiArray {
    /// Layout.
    pub layout: MultiArrayLayout,
    /// The numbers.
    pub data: Vec<f64>,
}

/// Rates of a Kinova arm's joints (deg/s), each message for 10 ms of motion.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointVelocity {
    pub joint1: f32,
    pub joint2: f32,
    pub joint3: f32,
    pub joint4: f32,
    pub joint5: f32,
    pub joint6: f32,
    pub joint7: f32,
}

impl JointVelocity {
    /// One joint turns, by its number from 1 to 7; the others rest.
    pub fn of(joint: usize, degrees_per_s: f64) -> Self {
        let mut all = [0.0; 7];
        all[joint - 1] = degrees_per_s as f32;
        let [joint1, joint2, joint3, joint4, joint5, joint6, joint7] = all;
        Self {
            joint1,
            joint2,
            joint3,
            joint4,
            joint5,
            joint6,
            joint7,
        }
    }

    /// The rate of a joint (deg/s), by its number from 1 to 7.
    pub fn joint(&self, joint: usize) -> f64 {
        let all = [
            self.joint1,
            self.joint2,
            self.joint3,
            self.joint4,
            self.joint5,
            self.joint6,
            self.joint7,
        ];
        f64::from(all[joint - 1])
    }
}

/// A boolean; true on the e-stop topic stops the rig.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bool {
    /// The answer.
    pub data: bool,
}

/// A line of a log.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Log {
    /// Time of the event.
    pub stamp: Time,
    /// Severity: 20 information, 30 warning, 40 error.
    pub level: u8,
    /// Name of the sender.
    pub name: String,
    /// Text.
    pub msg: String,
    /// Not used here.
    pub file: String,
    /// Kind of the event.
    pub function: String,
    /// Not used here.
    pub line: u32,
}

/// Request of `Trigger`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerRequest {
    /// Placeholder that ROS 2 adds to types without members.
    pub structure_needs_at_least_one_member: u8,
}

/// Response of `Trigger`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerResponse {
    /// Success.
    pub success: bool,
    /// Message.
    pub message: String,
}

/// Tolerance of a joint.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTolerance {
    /// The joint.
    pub name: String,
    /// By how much (rad).
    pub position: f64,
    /// By how much (rad/s).
    pub velocity: f64,
    /// By how much (rad/s²).
    pub acceleration: f64,
}

/// Goal of `FollowJointTrajectory`: the seven fields of Humble, Jazzy and later.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FollowGoal {
    /// The trajectory.
    pub trajectory: JointTrajectory,
    /// Of joints with several axes; not used here.
    pub multi_dof_trajectory: MultiDofTrajectory,
    /// Tolerances during the motion.
    pub path_tolerance: Vec<JointTolerance>,
    /// Not used here.
    pub component_path_tolerance: Vec<String>,
    /// Tolerances at the end.
    pub goal_tolerance: Vec<JointTolerance>,
    /// Not used here.
    pub component_goal_tolerance: Vec<String>,
    /// Time tolerance at the end.
    pub goal_time_tolerance: Time,
}

/// A trajectory of joints with several axes: empty.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MultiDofTrajectory {
    /// Start time.
    pub header: Header,
    /// No joints.
    pub joint_names: Vec<String>,
    /// No points.
    pub points: Vec<u8>,
}

/// Result of `FollowJointTrajectory`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FollowResult {
    /// Zero is success.
    pub error_code: i32,
    /// Message.
    pub error_string: String,
}

/// Feedback of `FollowJointTrajectory`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FollowFeedback {
    /// Time.
    pub header: Header,
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// Desired positions.
    pub desired: JointTrajectoryPoint,
    /// Actual positions.
    pub actual: JointTrajectoryPoint,
    /// Errors.
    pub error: JointTrajectoryPoint,
}

macro_rules! ros2_messages {
    ($($name:ident),*) => { $(impl ros2_client::Message for $name {})* };
}
ros2_messages!(
    TriggerRequest,
    TriggerResponse,
    FollowGoal,
    FollowResult,
    FollowFeedback
);

macro_rules! messages {
    ($($type:ident in $package:literal: $($part:expr),+;)*) => {
        $(impl Message for $type {
            const PACKAGE: &'static str = $package;
            const NAME: &'static str = stringify!($type);
            const DEFINITION: &'static str = concat!($($part),+);
        })*
    };
}

macro_rules! part {
    ($name:literal, $text:literal) => {
        concat!(
            "================================================================================\n",
            "MSG: ",
            $name,
            "\n",
            $text
        )
    };
}

macro_rules! time {
    () => {
        part!("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n")
    };
}

macro_rules! header {
    () => {
        concat!(
            part!(
                "std_msgs/Header",
                "builtin_interfaces/Time stamp\nstring frame_id\n"
            ),
            time!()
        )
    };
}

messages! {
    PointStamped in "geometry_msgs":
        "std_msgs/Header header\ngeometry_msgs/Point point\n",
        part!("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"), header!();
    JointState in "sensor_msgs":
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        header!();
    JointTrajectory in "trajectory_msgs":
        "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points\n",
        part!("trajectory_msgs/JointTrajectoryPoint",
            "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\nbuiltin_interfaces/Duration time_from_start\n"),
        part!("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n"), header!();
    Float64MultiArray in "std_msgs":
        "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
        part!("std_msgs/MultiArrayLayout", "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"),
        part!("std_msgs/MultiArrayDimension", "string label\nuint32 size\nuint32 stride\n");
    JointVelocity in "kinova_msgs":
        "float32 joint1\nfloat32 joint2\nfloat32 joint3\nfloat32 joint4\nfloat32 joint5\nfloat32 joint6\nfloat32 joint7\n";
    Bool in "std_msgs": "bool data\n";
    Log in "rcl_interfaces":
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\nbuiltin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n",
        time!();
}

mod frames;
mod labs;

pub use frames::{Quaternion, Text, TfMessage, Transform, TransformStamped, Vector3};
pub use labs::{
    DynamixelVel, HiwonderVel, Image, ResetRequest, ResetResponse, StateEstimate, StateEstimateSub,
    TagStateEstimate,
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_written_as_cdr_wants_it() {
        let message = PointStamped {
            header: Header {
                stamp: Time { sec: 1, nanosec: 2 },
                frame_id: "ab".to_owned(),
            },
            point: Point {
                x: 1.0,
                y: 0.0,
                z: -1.0,
            },
        };
        let bytes = to_cdr(&message).expect("it can be written");
        let mut expected = vec![
            0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0,
        ];
        // Numbers of eight bytes are aligned to multiples of eight after the header.
        expected.resize(4 + 16, 0);
        for value in [1.0_f64, 0.0, -1.0] {
            expected.extend(value.to_le_bytes());
        }
        assert_eq!(bytes, expected);
    }

    #[test]
    fn moments_before_1970_count_backwards() {
        let time = Time::from_nanos(-1);
        assert_eq!((time.sec, time.nanosec), (-1, 999_999_999));
        assert_eq!(time.nanos(), -1);
    }
}
