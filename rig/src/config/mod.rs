//! `rig.toml` of the lab machine: names, signs, units, limits, timeouts, networks.

mod mistakes;

pub use mistakes::Mistakes;

#[cfg(test)]
pub use mistakes::tests::EXAMPLE;

use std::fs;
use std::net::IpAddr;
use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer};

use crate::error::{Error, Result};

/// Period of set points (s): Kinova's driver requires exactly 100 per second.
pub const TICK_S: f64 = 0.01;

/// Longest duration of a stop from full speed to rest (s).
pub const RAMP_S: f64 = 0.12;

/// The whole file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Where DDS may send.
    #[serde(default)]
    pub network: Network,
    /// The arms at the knobs: about x, about y.
    pub arms: Arms,
    /// The command interface of the arms.
    pub backend: Backend,
    /// Limits of motion.
    pub limits: Limits,
    /// Timeouts.
    #[serde(default)]
    pub timeouts: Timeouts,
    /// The tracker.
    #[serde(default)]
    pub tracker: Tracker,
    /// Arming and stops.
    #[serde(default)]
    pub safety: Safety,
    /// The simulated laboratory.
    #[serde(default)]
    pub twin: Twin,
    /// The board as viewers of bags draw it.
    #[serde(default)]
    pub board: Board,
}

/// Where DDS may send.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Network {
    /// `ROS_DOMAIN_ID`.
    pub domain: u16,
    /// Addresses of this machine's interfaces; no others are used.
    pub interfaces: Vec<IpAddr>,
    /// Mapping of services to DDS topics.
    pub services: Services,
    /// Longest wait for peers (s).
    pub match_s: f64,
}

impl Default for Network {
    fn default() -> Self {
        Self {
            domain: 0,
            interfaces: vec![IpAddr::from([127, 0, 0, 1])],
            services: Services::Enhanced,
            match_s: 5.0,
        }
    }
}

/// Correlation of requests and responses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Services {
    /// Fast-DDS, the default of Humble and Jazzy.
    Enhanced,
    /// Cyclone DDS.
    Cyclone,
}

/// The arms at the knobs.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arms {
    /// About x.
    pub x: Arm,
    /// About y.
    pub y: Arm,
}

impl Arms {
    /// Both, with the names of their tables.
    pub fn both(&self) -> [(&'static str, &Arm); 2] {
        [("arms.x", &self.x), ("arms.y", &self.y)]
    }
}

/// One arm's wrist: joint angle = `level_rad` + `gear` x knob angle.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Its name in `JointState`.
    pub joint: String,
    /// The topic of its `JointState`.
    pub joint_states: String,
    /// Its command topic or action.
    pub command: String,
    /// Joint angle over knob angle; negative if they turn in opposite directions.
    pub gear: f64,
    /// The joint's angle while the board is level (rad).
    pub level_rad: f64,
    /// Its number among the joints of a velocity command, from 1.
    #[serde(default = "last_of_seven")]
    pub number: usize,
}

fn last_of_seven() -> usize {
    7
}

/// The command interface of the arms.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Backend {
    /// Type of the messages.
    pub kind: Kind,
    /// Length of a `Float64MultiArray`.
    #[serde(default = "last_of_seven")]
    pub joints: usize,
    /// Gain from position error to rate, for backends that send rates (1/s).
    #[serde(default = "gain")]
    pub gain_per_s: f64,
}

fn gain() -> f64 {
    2.0
}

/// Type of the messages that move an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// `trajectory_msgs/JointTrajectory`: short trajectories that end at rest.
    Trajectory,
    /// `std_msgs/Float64MultiArray`: rates.
    Velocities,
    /// `kinova_msgs/JointVelocity`: rates in deg/s.
    Kinova,
    /// `control_msgs/FollowJointTrajectory`: short goals, each of which replaces the last.
    Action,
}

/// Limits of motion, in angles of the joint.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Largest distance from the level pose, in both directions (rad).
    pub window_rad: f64,
    /// Rate (rad/s).
    pub velocity_rad_s: f64,
    /// Acceleration (rad/s²).
    pub acceleration_rad_s2: f64,
    /// Largest step between set points (rad).
    pub step_rad: f64,
    /// Largest distance between set point and joint (rad).
    pub tracking_error_rad: f64,
    /// Rate of the slow move to the level pose (rad/s).
    pub home_velocity_rad_s: f64,
}

/// Timeouts (s).
#[expect(
    clippy::struct_field_names,
    reason = "keys of the file carry their unit"
)]
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Timeouts {
    /// Points of the marble.
    pub tracker_s: f64,
    /// Joint states.
    pub joints_s: f64,
    /// A tracking error above its limit.
    pub tracking_error_s: f64,
    /// The loop.
    pub overrun_s: f64,
    /// Commands to play; arms expire theirs alike.
    pub command_s: f64,
    /// The age of a stamp, by this machine's clock.
    pub stamp_s: f64,
    /// The marble at bitwise the same position while the knobs turn; 0 disables the check.
    pub frozen_s: f64,
}

impl Default for Timeouts {
    fn default() -> Self {
        Self {
            tracker_s: 0.3,
            joints_s: 0.1,
            tracking_error_s: 0.1,
            overrun_s: 0.05,
            command_s: 0.1,
            stamp_s: 0.5,
            frozen_s: 2.0,
        }
    }
}

/// The tracker.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tracker {
    /// The topic of its `PointStamped`.
    pub topic: String,
    /// Unit of the points.
    pub unit: Unit,
    /// The board's long edge (m).
    pub edge_x_m: f64,
    /// Requested reliability.
    pub reliability: Reliability,
    /// Speed above which the marble has jumped (board edges per second).
    pub fastest_edges_s: f64,
    /// Tolerated jumps per second.
    pub jumps: usize,
    /// Largest number of points per second.
    pub most_hz: f64,
}

impl Default for Tracker {
    fn default() -> Self {
        Self {
            topic: "/marble/position".to_owned(),
            unit: Unit::Edges,
            edge_x_m: 0.276,
            reliability: Reliability::BestEffort,
            fastest_edges_s: 10.0,
            jumps: 3,
            most_hz: 1100.0,
        }
    }
}

/// The board as viewers of bags draw it.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Board {
    /// The short edge (m).
    pub edge_y_m: f64,
    /// The marble's radius (m).
    pub marble_radius_m: f64,
    /// The board's tilt over the knobs' angle.
    pub gear: f64,
}

impl Default for Board {
    fn default() -> Self {
        Self {
            edge_y_m: 0.231,
            marble_radius_m: 0.00685,
            gear: 0.06,
        }
    }
}

/// Unit of the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Long edges of the board.
    Edges,
    /// Metres.
    M,
}

/// Reliability of a subscription.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reliability {
    /// Best effort: accepts both kinds of publishers.
    BestEffort,
    /// Reliable: lost messages are resent; matches only reliable publishers.
    Reliable,
}

/// Arming and stops.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Safety {
    /// Whether `--arm` may move the arms.
    pub allow_arming: bool,
    /// Topic of the emergency stop: `std_msgs/Bool`, true stops.
    pub e_stop: String,
    /// Service that stops as well: `std_srvs/Trigger`.
    pub stop_service: String,
    /// Services of the arms' drivers that a stop calls: `std_srvs/Trigger`.
    pub call_on_stop: Vec<String>,
    /// Duration for which the stop is repeated before the program ends (s).
    pub hold_s: f64,
    /// Most memory that this program may hold (MB). Topics keep 1000 messages each, of 12 kB at most on known rigs
    /// (pictures in the states of a `CyberRunner`), and the recorder 131,072 of 1 kB: about 200 MB, and as much again.
    pub memory_mb: f64,
}

impl Safety {
    /// Refuses to arm where that is not allowed.
    ///
    /// # Errors
    /// [`Error::Refused`] says what to set.
    pub fn check_arming(&self, arm: bool) -> Result<()> {
        if arm && !self.allow_arming {
            return Err(Error::refused(
                "safety.allow_arming is false: set it to true once the hardware e-stop has been tried",
            ));
        }
        Ok(())
    }
}

impl Default for Safety {
    fn default() -> Self {
        Self {
            allow_arming: false,
            e_stop: "/rig/e_stop".to_owned(),
            stop_service: "/rig/stop".to_owned(),
            call_on_stop: Vec::new(),
            hold_s: 1.0,
            memory_mb: 400.0,
        }
    }
}

/// The simulated laboratory.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Twin {
    /// Points of the marble per second: a divisor of 120, or 1000 for a load test.
    pub tracker_hz: u32,
    /// Delay from picture to message (s).
    pub delay_s: f64,
    /// Standard deviation of that delay (s).
    pub delay_jitter_s: f64,
    /// Standard deviation of a point (board edges).
    pub noise: f64,
    /// Share of the pictures in which the marble is lost.
    pub lost: f64,
    /// Standard deviation of a joint's angle (rad).
    pub joint_noise_rad: f64,
    /// Standard deviation of a measured tilt of the board (rad), for the twins of other labs.
    pub tilt_noise_rad: f64,
    /// Maximum rate of the arms (rad/s).
    pub velocity_rad_s: f64,
    /// Rate of the knobs about x and y over the current of their motors (rad/s), for the twin of a `CyberRunner`.
    #[serde(deserialize_with = "by_axis")]
    pub current_rad_s: [f64; 2],
    /// Largest currents that do not turn the knobs about x and y: those that friction holds.
    #[serde(deserialize_with = "by_axis")]
    pub current_dead: [f64; 2],
    /// Position to which a hand returns the marble before each run (board edges).
    pub start: [f64; 2],
    /// Time for which the knobs are level and at rest before that (s).
    pub hand_s: f64,
}

impl Default for Twin {
    fn default() -> Self {
        Self {
            tracker_hz: 60,
            delay_s: 0.03,
            delay_jitter_s: 0.002,
            noise: 0.001,
            lost: 0.002,
            joint_noise_rad: 2e-5,
            tilt_noise_rad: 0.0009,
            velocity_rad_s: 0.83,
            current_rad_s: [0.02; 2],
            current_dead: [0.0; 2],
            start: [0.0, 0.0],
            hand_s: 0.5,
        }
    }
}

/// A number for both axes, or one for each.
fn by_axis<'de, D: Deserializer<'de>>(source: D) -> std::result::Result<[f64; 2], D::Error> {
    #[derive(Deserialize)]
    #[serde(
        untagged,
        expecting = "expected a number, or two in brackets: about x and about y"
    )]
    enum ByAxis {
        Both(f64),
        Each([f64; 2]),
    }
    Ok(match ByAxis::deserialize(source)? {
        ByAxis::Both(value) => [value; 2],
        ByAxis::Each(values) => values,
    })
}

/// The text of a configuration.
///
/// # Errors
/// [`Error::Refused`] if it cannot be read.
pub fn text(path: &Path) -> Result<String> {
    fs::read_to_string(path).map_err(|error| {
        let advice = "copy rig/example/rig.toml, or name another with --config";
        Error::refused(format!(
            "{}: cannot be read: {error}; {advice}",
            path.display()
        ))
    })
}

/// A configuration of a text, without mistakes.
///
/// # Errors
/// [`Error::Refused`] for a text of another form, [`Error::Mistakes`] for what is wrong in it.
pub fn parse<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    mistakes: impl Fn(&T) -> Vec<String>,
) -> Result<T> {
    let shown = path.display();
    let config: T = toml::from_str(text).map_err(|error| {
        let line = error
            .span()
            .map_or(1, |span| 1 + text[..span.start].matches('\n').count());
        let message = error.message().replace('\n', " ");
        Error::refused(format!("{shown}, line {line}: {message}"))
    })?;
    let mistakes = mistakes(&config);
    if mistakes.is_empty() {
        return Ok(config);
    }
    Err(Error::Mistakes(
        mistakes
            .iter()
            .map(|one| format!("{shown}, {one}"))
            .collect(),
    ))
}
