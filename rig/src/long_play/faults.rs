//! The faults of a long play, the stop that each must end in, and how soon.

use crate::messages::{JointState, PointStamped, Time};
use crate::safety::Reason;

/// A fault.
pub struct Fault {
    /// Its name.
    pub name: &'static str,
    /// What it does.
    pub effect: Effect,
    /// The stop that must follow.
    pub code: &'static str,
    /// At most after this time (s): the time-out, the way of a picture, and a tick that is 40 ms late.
    pub most_s: f64,
}

/// What a fault does.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    TrackerDies,
    TrackerFreezes,
    TrackerJumps,
    TrackerFloods,
    TrackerSaysNan,
    TrackerIsOld,
    TrackerIsAhead,
    JointsDie,
    OneJointDies,
    JointsSayNan,
    JointsLie,
    JointsJump,
    DriverDies,
    /// The rig's process stands for some seconds.
    Stall(f64),
    EStop,
    Signal,
    ClockSteps,
    OtherPublisher,
    RecorderFails,
    Unsendable,
    NoCommand,
    NanCommand,
}

const fn fault(name: &'static str, effect: Effect, code: &'static str, most_s: f64) -> Fault {
    Fault {
        name,
        effect,
        code,
        most_s,
    }
}

/// All faults.
pub const FAULTS: [Fault; 24] = [
    fault(
        "the tracker dies",
        Effect::TrackerDies,
        "tracker_silent",
        0.37,
    ),
    fault(
        "the tracker freezes",
        Effect::TrackerFreezes,
        "tracker_lies",
        2.15,
    ),
    fault(
        "the tracker jumps",
        Effect::TrackerJumps,
        "tracker_lies",
        0.25,
    ),
    fault(
        "the tracker floods",
        Effect::TrackerFloods,
        "tracker_lies",
        0.6,
    ),
    fault(
        "the tracker says NaN",
        Effect::TrackerSaysNan,
        "tracker_silent",
        0.37,
    ),
    fault(
        "the tracker's stamps are old",
        Effect::TrackerIsOld,
        "tracker_silent",
        0.37,
    ),
    fault(
        "the tracker's stamps are of the future",
        Effect::TrackerIsAhead,
        "tracker_silent",
        0.37,
    ),
    fault(
        "joint states stop",
        Effect::JointsDie,
        "joints_silent",
        0.17,
    ),
    fault(
        "those of one joint stop",
        Effect::OneJointDies,
        "joints_silent",
        0.17,
    ),
    fault(
        "joint states are NaN",
        Effect::JointsSayNan,
        "joints_silent",
        0.17,
    ),
    fault(
        "joint states stay as they are",
        Effect::JointsLie,
        "tracking_error",
        1.0,
    ),
    fault(
        "joint states jump by 1 rad",
        Effect::JointsJump,
        "joints_lie",
        0.07,
    ),
    fault(
        "the arms stand still",
        Effect::DriverDies,
        "tracking_error",
        1.0,
    ),
    fault(
        "the rig stalls for 80 ms",
        Effect::Stall(0.08),
        "overrun",
        0.14,
    ),
    fault(
        "the rig stalls for 400 ms",
        Effect::Stall(0.4),
        "overrun",
        0.46,
    ),
    fault(
        "the rig stalls for 3 s",
        Effect::Stall(3.0),
        "overrun",
        3.06,
    ),
    fault(
        "the e-stop is pressed",
        Effect::EStop,
        "emergency_stop",
        0.07,
    ),
    fault("a signal", Effect::Signal, "signal", 0.07),
    fault(
        "the clock is set",
        Effect::ClockSteps,
        "clock_stepped",
        0.07,
    ),
    fault(
        "somebody else commands",
        Effect::OtherPublisher,
        "other_publisher",
        0.07,
    ),
    fault(
        "the bag cannot be written",
        Effect::RecorderFails,
        "recorder",
        0.07,
    ),
    fault(
        "commands cannot be sent",
        Effect::Unsendable,
        "unsendable",
        0.07,
    ),
    fault("no command", Effect::NoCommand, "command_expired", 0.25),
    fault(
        "a command is NaN",
        Effect::NanCommand,
        "command_refused",
        0.07,
    ),
];

impl Effect {
    /// What the camera's picture of this number becomes.
    pub fn points(&self, mut point: PointStamped, count: u64) -> Vec<PointStamped> {
        let stamp = point.header.stamp.nanos();
        match self {
            Self::TrackerDies => return Vec::new(),
            Self::TrackerFreezes => (point.point.x, point.point.y) = (0.01, 0.02),
            Self::TrackerJumps if count.is_multiple_of(2) => point.point.x += 0.4,
            Self::TrackerSaysNan => point.point.x = f64::NAN,
            Self::TrackerIsOld => point.header.stamp = Time::from_nanos(stamp - 3_000_000_000),
            Self::TrackerIsAhead => point.header.stamp = Time::from_nanos(stamp + 3_000_000_000),
            Self::TrackerFloods => {
                return (0..40)
                    .map(|part| {
                        let mut one = point.clone();
                        one.header.stamp = Time::from_nanos(stamp + 10_000 * part);
                        one
                    })
                    .collect();
            }
            _ => (),
        }
        vec![point]
    }

    /// Changes the state of a joint; returns whether it is sent.
    pub fn joint(&self, state: &mut JointState, axis: usize) -> bool {
        match self {
            Self::JointsDie => return false,
            Self::OneJointDies => return axis == 0,
            Self::JointsSayNan => state.position[0] = f64::NAN,
            Self::JointsJump => state.position[0] += 1.0,
            _ => (),
        }
        true
    }

    /// A stop from elsewhere.
    pub fn reason(&self) -> Option<Reason> {
        Some(match self {
            Self::EStop => Reason::EmergencyStop("/rig/e_stop".to_owned()),
            Self::Signal => Reason::Signal("SIGTERM"),
            Self::ClockSteps => Reason::ClockStepped(-5.0),
            Self::OtherPublisher => Reason::OtherPublisher("/left/joint_trajectory".to_owned()),
            Self::RecorderFails => Reason::Recorder("no space".to_owned()),
            Self::Unsendable => Reason::Unsendable("no route".to_owned()),
            _ => return None,
        })
    }

    /// The target, if there is one.
    pub fn target(&self, target: [f64; 2]) -> Option<[f64; 2]> {
        match self {
            Self::NoCommand => None,
            Self::NanCommand => Some([target[0], f64::NAN]),
            _ => Some(target),
        }
    }
}
