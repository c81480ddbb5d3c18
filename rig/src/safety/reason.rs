//! Why arms are stopped.

use std::fmt;

/// Why arms are stopped.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// Time without a valid point of the marble (s).
    TrackerSilent(f64),
    /// Impossible points from the tracker, described: jumps, floods, frozen positions.
    TrackerLies(String),
    /// Time without joint states (s).
    JointsSilent(f64),
    /// Impossible joint states, described.
    JointsLie(String),
    /// Tracking error of a joint (rad).
    TrackingError(f64),
    /// A joint is outside its window.
    OutsideWindow {
        /// 0 about x, 1 about y.
        axis: usize,
        /// By how much (rad).
        by: f64,
    },
    /// Time without a state of the board (s), of a lab that measures its tilt.
    StateSilent(f64),
    /// The board is tilted too far (rad), or its tilt is no number.
    BoardTilted(f64),
    /// Lateness of the loop (s).
    Overrun(f64),
    /// Time without a command (s).
    CommandExpired(f64),
    /// A command is no number.
    CommandRefused,
    /// Another publisher on this command topic.
    OtherPublisher(String),
    /// The source of the emergency stop.
    EmergencyStop(String),
    /// The name of the signal.
    Signal(&'static str),
    /// Step of this machine's clock (s).
    ClockStepped(f64),
    /// The recorder's error.
    Recorder(String),
    /// Memory that this program holds (MB).
    Memory(f64),
    /// The error of sending commands.
    Unsendable(String),
}

impl Reason {
    /// Whether nothing can be recorded after it.
    pub fn ends_recording(&self) -> bool {
        matches!(self, Self::Recorder(_) | Self::Memory(_))
    }

    /// Its name in bags: a word to search for.
    pub fn code(&self) -> &'static str {
        match self {
            Self::TrackerSilent(_) => "tracker_silent",
            Self::TrackerLies(_) => "tracker_lies",
            Self::JointsSilent(_) => "joints_silent",
            Self::JointsLie(_) => "joints_lie",
            Self::TrackingError(_) => "tracking_error",
            Self::OutsideWindow { .. } => "outside_window",
            Self::StateSilent(_) => "state_silent",
            Self::BoardTilted(_) => "board_tilted",
            Self::Overrun(_) => "overrun",
            Self::CommandExpired(_) => "command_expired",
            Self::CommandRefused => "command_refused",
            Self::OtherPublisher(_) => "other_publisher",
            Self::EmergencyStop(_) => "emergency_stop",
            Self::Signal(_) => "signal",
            Self::ClockStepped(_) => "clock_stepped",
            Self::Recorder(_) => "recorder",
            Self::Memory(_) => "memory",
            Self::Unsendable(_) => "unsendable",
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TrackerSilent(s) if s.is_infinite() => {
                write!(f, "the tracker has sent no valid point yet")
            }
            Self::TrackerSilent(s) => write!(f, "no valid point from the tracker for {s:.3} s"),
            Self::TrackerLies(what) => write!(f, "the tracker cannot be right: {what}"),
            Self::JointsSilent(s) if s.is_infinite() => write!(f, "no joint states yet"),
            Self::JointsSilent(s) => write!(f, "no joint states for {s:.3} s"),
            Self::JointsLie(what) => write!(f, "the joint states cannot be right: {what}"),
            Self::TrackingError(by) => write!(f, "a joint is {by:.4} rad from its set point"),
            Self::OutsideWindow { axis, by } => {
                write!(
                    f,
                    "the joint of arms.{} is {by:.4} rad outside its window",
                    ["x", "y"][*axis]
                )
            }
            Self::StateSilent(s) if s.is_infinite() => write!(f, "no state of the board yet"),
            Self::StateSilent(s) => write!(f, "no state of the board for {s:.3} s"),
            Self::BoardTilted(by) => write!(f, "the board is tilted by {by:.3} rad"),
            Self::Overrun(s) => write!(f, "the loop came {:.1} ms late", 1e3 * s),
            Self::CommandExpired(s) => write!(f, "no command for {s:.3} s"),
            Self::CommandRefused => write!(f, "a command is no number"),
            Self::OtherPublisher(topic) => write!(f, "somebody else publishes on {topic}"),
            Self::EmergencyStop(which) => write!(f, "emergency stop from {which}"),
            Self::Signal(which) => write!(f, "{which}"),
            Self::ClockStepped(by) => write!(f, "this machine's clock was set by {by:+.3} s"),
            Self::Recorder(what) => write!(f, "the recording fails: {what}"),
            Self::Memory(mb) => write!(
                f,
                "this program holds {mb:.0} MB, more than safety.memory_mb: somebody sends too much"
            ),
            Self::Unsendable(what) => write!(f, "commands cannot be sent: {what}"),
        }
    }
}
