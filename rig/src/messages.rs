//! The ROS 2 messages that the rig speaks, and their definitions as bags carry them.

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

/// A moment, or how long something takes: `builtin_interfaces/Time` and `Duration`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds; since 1970 where it is a moment.
    pub sec: i32,
    /// What is left of them (ns).
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

/// When, and in which frame.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// When it was.
    pub stamp: Time,
    /// The frame of what follows.
    pub frame_id: String,
}

/// A place.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// Where the tracker sees the marble.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PointStamped {
    /// When the picture was taken.
    pub header: Header,
    /// In the board's frame.
    pub point: Point,
}

/// Where joints are.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// When they were there.
    pub header: Header,
    /// Which joints.
    pub name: Vec<String>,
    /// Angles (rad).
    pub position: Vec<f64>,
    /// Rates (rad/s); may be empty.
    pub velocity: Vec<f64>,
    /// Torques (N m); may be empty.
    pub effort: Vec<f64>,
}

/// Where joints shall be, and when.
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
    /// After the trajectory's beginning.
    pub time_from_start: Time,
}

/// A way for joints to go.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectory {
    /// When it begins; zero is at once.
    pub header: Header,
    /// Which joints.
    pub joint_names: Vec<String>,
    /// Where they shall be.
    pub points: Vec<JointTrajectoryPoint>,
}

/// A dimension of an array.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MultiArrayDimension {
    /// What it counts.
    pub label: String,
    /// How many.
    pub size: u32,
    /// Entries from one to the next.
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
    /// How they are laid out.
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

/// Yes or no: to the emergency stop, yes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bool {
    /// The answer.
    pub data: bool,
}

/// A line of a log.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Log {
    /// When it happened.
    pub stamp: Time,
    /// How bad it is: 20 information, 30 warning, 40 error.
    pub level: u8,
    /// Who says it.
    pub name: String,
    /// What happened.
    pub msg: String,
    /// Not used here.
    pub file: String,
    /// What kind of event it is.
    pub function: String,
    /// Not used here.
    pub line: u32,
}

/// Asks for something to happen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerRequest {
    /// ROS 2 gives a type without members this one.
    pub structure_needs_at_least_one_member: u8,
}

/// Whether it happened.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerResponse {
    /// Whether it did.
    pub success: bool,
    /// In words.
    pub message: String,
}

/// How far a joint may stray.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTolerance {
    /// Which joint.
    pub name: String,
    /// By how much (rad).
    pub position: f64,
    /// By how much (rad/s).
    pub velocity: f64,
    /// By how much (rad/s²).
    pub acceleration: f64,
}

/// What `FollowJointTrajectory` is asked for: the seven fields of Humble, Jazzy and later.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FollowGoal {
    /// The way.
    pub trajectory: JointTrajectory,
    /// Of joints with several axes; not used here.
    pub multi_dof_trajectory: MultiDofTrajectory,
    /// On the way.
    pub path_tolerance: Vec<JointTolerance>,
    /// Not used here.
    pub component_path_tolerance: Vec<String>,
    /// At the end.
    pub goal_tolerance: Vec<JointTolerance>,
    /// Not used here.
    pub component_goal_tolerance: Vec<String>,
    /// After its end.
    pub goal_time_tolerance: Time,
}

/// A way for joints with several axes: empty.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MultiDofTrajectory {
    /// When it begins.
    pub header: Header,
    /// Which joints: none.
    pub joint_names: Vec<String>,
    /// No points.
    pub points: Vec<u8>,
}

/// How `FollowJointTrajectory` ended.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FollowResult {
    /// Zero is success.
    pub error_code: i32,
    /// In words.
    pub error_string: String,
}

/// How far `FollowJointTrajectory` is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FollowFeedback {
    /// When.
    pub header: Header,
    /// Which joints.
    pub joint_names: Vec<String>,
    /// Where they should be.
    pub desired: JointTrajectoryPoint,
    /// Where they are.
    pub actual: JointTrajectoryPoint,
    /// What is between the two.
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
        // Numbers of eight bytes begin at multiples of eight behind the header.
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
