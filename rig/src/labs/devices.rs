//! The rig of another lab, as this machine hears and commands it.

use super::config::LabConfig;
use super::tcp::{Heard, Learner};
use super::{COMMANDS, ESTIMATE_SUBIMG, Lab, Seen, TAG_COMMANDS, TAG_ESTIMATE, TAG_LEARNER};
use crate::base::Base;
use crate::config::Reliability;
use crate::dds::{Inbox, Outlet};
use crate::error::Result;
use crate::messages::{
    DynamixelVel, HiwonderVel, StateEstimate, StateEstimateSub, TagStateEstimate,
};
use crate::recorder::Channel;
use crate::safety::Reason;
use crate::watch::Moment;

/// Ticks between messages of the same commands: 50 a second, about as many as the lab's learner sends.
const TICKS: u64 = 2;

/// The devices of a lab.
pub enum Devices {
    /// A `CyberRunner`.
    Cyberrunner(Box<Cyberrunner>),
    /// A TAG rig.
    Tag(Tag),
}

/// A `CyberRunner`'s topics.
pub struct Cyberrunner {
    states: (Inbox<StateEstimateSub>, Channel),
    /// The motors, if they are commanded.
    motors: Option<Outlet<DynamixelVel>>,
    /// What others command, if nothing is commanded here.
    others: Option<Inbox<DynamixelVel>>,
    commands: Channel,
    ticks: u64,
    sent: Option<[f64; 2]>,
}

/// A TAG rig's connection.
pub struct Tag {
    learner: Learner,
    /// Whether the servos are commanded.
    arm: bool,
    states: Channel,
    commands: Channel,
    sent: Option<[f64; 2]>,
}

impl Drop for Cyberrunner {
    /// The motors keep their last current for ever: however a run ends, that is none.
    fn drop(&mut self) {
        if let Some(motors) = &self.motors {
            let _ = motors.send(DynamixelVel::default());
        }
    }
}

impl Devices {
    /// Opens topics or connection; `arm` commands the motors.
    ///
    /// # Errors
    /// [`Error::Refused`](crate::error::Error::Refused) if the network does not allow it.
    pub fn open(config: &LabConfig, base: &mut Base, arm: bool) -> Result<Self> {
        let Base {
            link,
            recorder,
            clock,
            ..
        } = base;
        match config.backend.kind {
            Lab::Cyberrunner => {
                let states = link.subscribe(ESTIMATE_SUBIMG, Reliability::BestEffort)?;
                let (motors, others) = if arm {
                    (Some(link.publish(COMMANDS, Reliability::Reliable)?), None)
                } else {
                    (
                        None,
                        Some(link.subscribe(COMMANDS, Reliability::BestEffort)?),
                    )
                };
                Ok(Self::Cyberrunner(Box::new(Cyberrunner {
                    states: (
                        states,
                        recorder.channel::<StateEstimateSub>(ESTIMATE_SUBIMG),
                    ),
                    motors,
                    others,
                    commands: recorder.channel::<DynamixelVel>(COMMANDS),
                    ticks: 0,
                    sent: None,
                })))
            }
            Lab::TagTcp => Ok(Self::Tag(Tag {
                learner: Learner::open(TAG_LEARNER, *clock)?,
                arm,
                states: recorder.channel::<TagStateEstimate>(TAG_ESTIMATE),
                commands: recorder.channel::<HiwonderVel>(TAG_COMMANDS),
                sent: None,
            })),
        }
    }

    /// Takes and records all that has come.
    pub fn hear(&mut self, base: &Base, mut take: impl FnMut(Moment, Seen)) {
        let recorder = &base.recorder;
        match self {
            Self::Cyberrunner(rig) => {
                let (inbox, channel) = &rig.states;
                inbox.drain(base.clock, |moment, message| {
                    recorder.record(*channel, moment.nanos, moment.nanos, &message);
                    take(moment, Seen::from(&message.state));
                });
                if let Some(inbox) = &rig.others {
                    inbox.drain(base.clock, |moment, message| {
                        recorder.record(rig.commands, moment.nanos, moment.nanos, &message);
                    });
                }
            }
            Self::Tag(tag) => tag.learner.drain(|moment, heard| match heard {
                Heard::State(seen) => {
                    let ([alpha, beta], [x_b, y_b]) = (seen.angles(), seen.place_m);
                    let state = TagStateEstimate(StateEstimate {
                        alpha,
                        beta,
                        x_b,
                        y_b,
                        x_b_dot: f64::NAN,
                        y_b_dot: f64::NAN,
                    });
                    recorder.record(tag.states, moment.nanos, moment.nanos, &state);
                    take(moment, seen);
                }
                Heard::Sent([vel_1, vel_2]) if tag.sent != Some([vel_1, vel_2]) => {
                    tag.sent = Some([vel_1, vel_2]);
                    let message = HiwonderVel { vel_1, vel_2 };
                    recorder.record(tag.commands, moment.nanos, moment.nanos, &message);
                }
                Heard::Sent(_) => (),
            }),
        }
    }

    /// Commands motors 1 and 2, where they are commanded at all.
    ///
    /// # Errors
    /// [`Error::Refused`](crate::error::Error::Refused) if DDS does not take it.
    pub fn send(&mut self, commands: [f64; 2], now: Moment, base: &Base) -> Result<()> {
        match self {
            Self::Cyberrunner(rig) => {
                let Some(motors) = &rig.motors else {
                    return Ok(());
                };
                rig.ticks += 1;
                if rig.sent.replace(commands) == Some(commands) && !rig.ticks.is_multiple_of(TICKS)
                {
                    return Ok(());
                }
                let [vel_1, vel_2] = commands;
                let message = DynamixelVel { vel_1, vel_2 };
                base.recorder
                    .record(rig.commands, now.nanos, now.nanos, &message);
                motors.send(message)
            }
            Self::Tag(tag) => {
                if tag.arm {
                    tag.learner.command(commands);
                }
                Ok(())
            }
        }
    }

    /// Why no states come, or why commands would not arrive.
    pub fn missing(&self, base: &Base, has_state: bool) -> Option<String> {
        match self {
            Self::Cyberrunner(rig) => {
                let inbox = &rig.states.0;
                if !has_state {
                    let why = match (base.link.publishers(&inbox.topic), base.link.heard(inbox)) {
                        (0, _) => "nobody publishes there",
                        (_, 0) => "a publisher is there, but its QoS or type does not match",
                        _ => "its publisher is silent",
                    };
                    return Some(format!("no states on {}: {why}", inbox.topic));
                }
                let motors = rig.motors.as_ref()?;
                (base.link.hearing(motors) == 0)
                    .then(|| format!("no motors listen on {}", motors.topic))
            }
            Self::Tag(_) if has_state => None,
            Self::Tag(tag) => Some(match tag.learner.bridges() {
                0 => format!(
                    "no bridge has connected to TCP {TAG_LEARNER}; start tcp_ros_bridge.py or 'rig twin --as tag-tcp'"
                ),
                _ => "the bridge has connected, but sends no states".to_owned(),
            }),
        }
    }

    /// Whether anybody else commands the motors.
    pub fn others(&self, base: &Base) -> Option<Reason> {
        match self {
            Self::Cyberrunner(_) if base.link.publishers(COMMANDS) > 0 => {
                Some(Reason::OtherPublisher(COMMANDS.to_owned()))
            }
            // The port has one listener.
            Self::Cyberrunner(_) | Self::Tag(_) => None,
        }
    }
}
