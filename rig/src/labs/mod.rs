//! The interfaces of other labs: a `CyberRunner` over ROS 2, and a TAG rig over lines of JSON.
//!
//! Both report the board's tilt as alpha and beta and the marble's place in metres from the board's centre. Neither
//! takes angles of knobs: a `CyberRunner`'s commands are currents of motors, those of a TAG rig targets of servos.

pub mod commands;
pub mod config;
pub mod devices;
pub mod guard;
pub mod lines;
pub mod play;
pub mod tcp;

use std::net::{Ipv4Addr, SocketAddr};

use clap::ValueEnum;
use serde::Deserialize;

use crate::frames::Size;
use crate::messages::StateEstimate;

/// Topics and services of a `CyberRunner`; its nodes name them relative to the root.
pub const ESTIMATE_SUBIMG: &str = "/cyberrunner_state_estimation/estimate_subimg";
/// State without a picture: in forks, and in the first versions.
pub const ESTIMATES: [&str; 2] = ["/cyberrunner_state_estimation/estimate", "/stateEstimation"];
/// Commands.
pub const COMMANDS: &str = "/cyberrunner_dynamixel/cmd";
/// The service that levels the board.
pub const RESET: &str = "/cyberrunner_dynamixel/reset";

/// Topics under which states and commands of a TAG rig are recorded, as its own nodes name them.
pub const TAG_ESTIMATE: &str = "/tag_state_estimation/estimate";
/// Commands.
pub const TAG_COMMANDS: &str = "/tag_hiwonder/cmd";

/// Where a TAG learner listens. A learner elsewhere is reached through a tunnel, as the lab does it.
pub const TAG_LEARNER: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 5555);

/// A lab whose interface is spoken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Lab {
    /// `CyberRunner`: ROS 2 topics, currents of motors
    Cyberrunner,
    /// TAG, Multi-maze: JSON lines to a learner on TCP port 5555, targets of servos
    TagTcp,
}

impl Lab {
    /// Sizes of the lab's board and marble.
    pub fn size(self) -> Size {
        let (edges_m, radius_m) = match self {
            Self::Cyberrunner => ([0.276, 0.231], 0.00635),
            Self::TagTcp => ([0.259, 0.229], 0.006),
        };
        Size { edges_m, radius_m }
    }

    /// Commands about x and y of those of motors 1 and 2, and the other way round.
    ///
    /// On a `CyberRunner` motor 1 changes alpha, which is about y; on a TAG rig servo 1 changes beta.
    pub fn exchanged(self, [first, second]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Cyberrunner => [second, first],
            Self::TagTcp => [first, second],
        }
    }
}

/// What a lab's estimator reports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// The board's tilts about x and y by the right-hand rule (rad).
    pub tilts: [f64; 2],
    /// The marble's place (m from the board's centre); NaN where it is lost.
    pub place_m: [f64; 2],
}

impl Seen {
    /// alpha and beta: minus the rotation about y, and the rotation about x.
    pub fn angles(&self) -> [f64; 2] {
        [-self.tilts[1], self.tilts[0]]
    }

    /// Of alpha and beta (rad) and of a place (m).
    pub fn of_angles([alpha, beta]: [f64; 2], place_m: [f64; 2]) -> Self {
        Self {
            tilts: [beta, -alpha],
            place_m,
        }
    }

    /// Whether the marble is seen.
    pub fn has_marble(&self) -> bool {
        self.place_m.iter().all(|value| value.is_finite())
    }
}

impl From<&StateEstimate> for Seen {
    fn from(state: &StateEstimate) -> Self {
        Self::of_angles([state.alpha, state.beta], [state.x_b, state.y_b])
    }
}
