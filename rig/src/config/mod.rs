//! `rig.toml` of the lab machine: names, signs, units, limits, time limits, networks.

mod mistakes;

#[cfg(test)]
pub use mistakes::tests::EXAMPLE;

use std::fs;
use std::net::IpAddr;
use std::path::Path;

use serde::Deserialize;

use crate::error::{Error, Result};

/// Seconds from one set point to the next: Kinova's driver takes exactly 100 a second.
pub const TICK_S: f64 = 0.01;

/// The longest that a stop may take from full speed to rest (s).
pub const RAMP_S: f64 = 0.12;

/// The whole file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Where DDS may send.
    #[serde(default)]
    pub network: Network,
    /// What turns the knobs: about x, about y.
    pub arms: Arms,
    /// How arms take commands.
    pub backend: Backend,
    /// What no motion exceeds.
    pub limits: Limits,
    /// How long what may be missing.
    #[serde(default)]
    pub timeouts: Timeouts,
    /// Where the marble is said to be.
    #[serde(default)]
    pub tracker: Tracker,
    /// How it is stopped and started.
    #[serde(default)]
    pub safety: Safety,
    /// How the stand-in laboratory behaves.
    #[serde(default)]
    pub twin: Twin,
}

/// Where DDS may send.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Network {
    /// `ROS_DOMAIN_ID`.
    pub domain: u16,
    /// Addresses of this machine's interfaces that are used; no other is.
    pub interfaces: Vec<IpAddr>,
    /// How services travel.
    pub services: Services,
    /// How long peers are waited for (s).
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

/// How requests and answers find each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Services {
    /// Fast-DDS, the default of Humble and Jazzy.
    Enhanced,
    /// Cyclone DDS.
    Cyclone,
}

/// What turns the knobs.
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
    /// Where its commands go: a topic, or an action.
    pub command: String,
    /// Joint angle over knob angle; negative where they turn against each other.
    pub gear: f64,
    /// The joint's angle while the board is level (rad).
    pub level_rad: f64,
    /// Its place among the joints that a velocity command names, from 1.
    #[serde(default = "last_of_seven")]
    pub number: usize,
}

fn last_of_seven() -> usize {
    7
}

/// How arms take commands.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Backend {
    /// Which message.
    pub kind: Kind,
    /// How many numbers a `Float64MultiArray` has.
    #[serde(default = "last_of_seven")]
    pub joints: usize,
    /// Rate that is added for each radian between set point and joint, where rates are sent (1/s).
    #[serde(default = "gain")]
    pub gain_per_s: f64,
}

fn gain() -> f64 {
    2.0
}

/// Which message moves an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// `trajectory_msgs/JointTrajectory`: short ways that end at rest.
    Trajectory,
    /// `std_msgs/Float64MultiArray`: rates.
    Velocities,
    /// `kinova_msgs/JointVelocity`: rates in deg/s.
    Kinova,
    /// `control_msgs/FollowJointTrajectory`: short goals, each of which replaces the last.
    Action,
}

/// What no motion exceeds, in angles of the joint.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Away from the level pose, either way (rad).
    pub window_rad: f64,
    /// Rate (rad/s).
    pub velocity_rad_s: f64,
    /// How fast the rate changes (rad/s²).
    pub acceleration_rad_s2: f64,
    /// From one set point to the next (rad).
    pub step_rad: f64,
    /// Between set point and joint (rad).
    pub tracking_error_rad: f64,
    /// Rate of the slow move to the level pose (rad/s).
    pub home_velocity_rad_s: f64,
}

/// How long what may be missing (s).
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
    /// The marble at the same place to the last bit while the knobs turn; 0: for ever.
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

/// Where the marble is said to be.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tracker {
    /// The topic of its `PointStamped`.
    pub topic: String,
    /// What a point's numbers are.
    pub unit: Unit,
    /// The board's long edge (m).
    pub edge_x_m: f64,
    /// What is asked of the publisher.
    pub reliability: Reliability,
    /// A faster marble has jumped (board edges per second).
    pub fastest_edges_s: f64,
    /// How many jumps a second are let pass.
    pub jumps: usize,
    /// More points a second are a flood.
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

/// What a point's numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Long edges of the board.
    Edges,
    /// Metres.
    M,
}

/// What a subscription asks of publishers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reliability {
    /// Takes what comes, from either kind of publisher.
    BestEffort,
    /// Has lost messages sent again; hears reliable publishers only.
    Reliable,
}

/// How the rig is stopped and started.
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
    /// How long the stop is repeated before the rig leaves (s).
    pub hold_s: f64,
}

impl Default for Safety {
    fn default() -> Self {
        Self {
            allow_arming: false,
            e_stop: "/rig/e_stop".to_owned(),
            stop_service: "/rig/stop".to_owned(),
            call_on_stop: Vec::new(),
            hold_s: 1.0,
        }
    }
}

/// How the stand-in laboratory behaves.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Twin {
    /// Points of the marble a second: a divisor of 120, or 1000 for a test of the intake.
    pub tracker_hz: u32,
    /// From picture to message (s).
    pub delay_s: f64,
    /// Standard deviation of that delay (s).
    pub delay_jitter_s: f64,
    /// Standard deviation of a point (board edges).
    pub noise: f64,
    /// Part of the pictures in which the marble is lost.
    pub lost: f64,
    /// Standard deviation of a joint's angle (rad).
    pub joint_noise_rad: f64,
    /// The fastest that the arms can turn (rad/s).
    pub velocity_rad_s: f64,
    /// Where a hand puts the marble before each run (board edges).
    pub start: [f64; 2],
    /// How long the knobs are level and still before it does (s).
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
            velocity_rad_s: 0.83,
            start: [0.0, 0.0],
            hand_s: 0.5,
        }
    }
}

impl Config {
    /// Reads a file, and says every mistake in it.
    ///
    /// # Errors
    /// [`Error::Refused`] if it cannot be read, [`Error::Mistakes`] for what is wrong in it.
    pub fn read(path: &Path) -> Result<(Self, String)> {
        let shown = path.display();
        let text = fs::read_to_string(path).map_err(|error| {
            let advice = "copy rig/example/rig.toml, or name another with --config";
            Error::refused(format!("{shown}: cannot be read: {error}; {advice}"))
        })?;
        let config: Self = toml::from_str(&text).map_err(|error| {
            let line = error
                .span()
                .map_or(1, |span| 1 + text[..span.start].matches('\n').count());
            let message = error.message().replace('\n', " ");
            Error::refused(format!("{shown}, line {line}: {message}"))
        })?;
        let mistakes = config.mistakes();
        if mistakes.is_empty() {
            return Ok((config, text));
        }
        Err(Error::Mistakes(
            mistakes
                .iter()
                .map(|one| format!("{shown}, {one}"))
                .collect(),
        ))
    }
}
