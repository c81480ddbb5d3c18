//! Backends: from set points to messages to the arms, for each kind of driver.

use ros2_client::action::ActionClientQosPolicies;
use ros2_client::qos::Durability;
use ros2_client::{ActionClient, ActionTypeName, Name};

use crate::config::{Config, Kind, Reliability, TICK_S};
use crate::dds::{Link, Outlet, service_qos};
use crate::error::{Error, Result};
use crate::messages::{
    Float64MultiArray, FollowFeedback, FollowGoal, FollowResult, Header, JointTrajectory,
    JointTrajectoryPoint, JointVelocity, Message, Time,
};
use crate::recorder::{Channel, Recorder};
use crate::safety::{Bounds, SetPoint};
use crate::watch::Moment;

/// Ticks between goals, for backends that send goals.
const GOAL_TICKS: u64 = 10;

/// Time by which a set point is ahead of the arm (s).
const LEAD_S: f64 = 2.0 * TICK_S;

/// A driver of one arm.
enum Driver {
    Trajectory(Outlet<JointTrajectory>),
    Velocities(Outlet<Float64MultiArray>),
    Kinova(Outlet<JointVelocity>),
    Action(Box<ActionClient<FollowGoal, FollowResult, FollowFeedback>>),
}

/// One arm: its driver, and the contents of its messages.
struct Wrist {
    driver: Driver,
    command: String,
    joint: String,
    number: usize,
    joints: usize,
    channel: Channel,
}

/// Both arms.
pub struct Backend {
    wrists: Vec<Wrist>,
    ticks: u64,
    stopping: bool,
}

/// The topic of an arm's commands; for an action, that of its goals.
pub fn command_topic(kind: Kind, command: &str) -> String {
    match kind {
        Kind::Action => format!("{command}/_action/status"),
        _ => command.to_owned(),
    }
}

impl Backend {
    /// Opens the publishers and actions of the configuration.
    ///
    /// # Errors
    /// [`Error::Refused`] if DDS does not allow it.
    pub fn open(config: &Config, link: &mut Link, recorder: &mut Recorder) -> Result<Self> {
        let mut wrists = Vec::new();
        for (_, arm) in config.arms.both() {
            let command = &arm.command;
            let (driver, channel) = match config.backend.kind {
                Kind::Trajectory => (
                    Driver::Trajectory(link.publish(command, Reliability::Reliable)?),
                    recorder.channel::<JointTrajectory>(command),
                ),
                Kind::Velocities => (
                    Driver::Velocities(link.publish(command, Reliability::Reliable)?),
                    recorder.channel::<Float64MultiArray>(command),
                ),
                Kind::Kinova => (
                    Driver::Kinova(link.publish(command, Reliability::Reliable)?),
                    recorder.channel::<JointVelocity>(command),
                ),
                Kind::Action => (
                    Driver::Action(Box::new(action(link, command)?)),
                    recorder.channel::<JointTrajectory>(&format!("{command}/goal")),
                ),
            };
            wrists.push(Wrist {
                driver,
                command: command.clone(),
                joint: arm.joint.clone(),
                number: arm.number,
                joints: config.backend.joints,
                channel,
            });
        }
        Ok(Self {
            wrists,
            ticks: 0,
            stopping: false,
        })
    }

    /// The first arm without a subscriber.
    pub fn unheard(&self, link: &Link) -> Option<String> {
        let wrist = self.wrists.iter().find(|wrist| wrist.hearing(link) == 0)?;
        Some(wrist.command.clone())
    }

    /// Sends set points and records the messages.
    ///
    /// # Errors
    /// [`Error::Refused`] if DDS does not take a message.
    pub fn send(
        &mut self,
        points: [(SetPoint, Bounds); 2],
        stopped: bool,
        now: Moment,
        recorder: &Recorder,
    ) -> Result<()> {
        let goal_is_due = self.ticks.is_multiple_of(GOAL_TICKS) || stopped != self.stopping;
        (self.ticks, self.stopping) = (self.ticks + 1, stopped);
        for (wrist, point) in self.wrists.iter().zip(points) {
            wrist.send(&point, now, goal_is_due, recorder)?;
        }
        Ok(())
    }
}

fn action(
    link: &mut Link,
    command: &str,
) -> Result<ActionClient<FollowGoal, FollowResult, FollowFeedback>> {
    let name =
        Name::parse(command).map_err(|error| Error::refused(format!("{command}: {error:?}")))?;
    let qos = ActionClientQosPolicies {
        goal_service: service_qos(),
        result_service: service_qos(),
        cancel_service: service_qos(),
        feedback_subscription: service_qos(),
        status_subscription: service_qos().durability(Durability::TransientLocal),
    };
    let mapping = link.mapping();
    link.node()
        .create_action_client(
            mapping,
            &name,
            &ActionTypeName::new("control_msgs", "FollowJointTrajectory"),
            qos,
        )
        .map_err(|error| Error::refused(format!("{command}: {error:?}")))
}

impl Wrist {
    fn hearing(&self, link: &Link) -> usize {
        match &self.driver {
            Driver::Trajectory(outlet) => link.hearing(outlet),
            Driver::Velocities(outlet) => link.hearing(outlet),
            Driver::Kinova(outlet) => link.hearing(outlet),
            Driver::Action(_) => link.publishers(&command_topic(Kind::Action, &self.command)),
        }
    }

    fn send(
        &self,
        (point, bounds): &(SetPoint, Bounds),
        now: Moment,
        goal_is_due: bool,
        recorder: &Recorder,
    ) -> Result<()> {
        match &self.driver {
            Driver::Trajectory(outlet) => self.put(
                outlet,
                trajectory(&self.joint, point, bounds, LEAD_S),
                now,
                recorder,
            ),
            Driver::Velocities(outlet) => {
                let mut data = vec![0.0; self.joints];
                data[self.number - 1] = point.rate;
                let message = Float64MultiArray {
                    data,
                    ..Float64MultiArray::default()
                };
                self.put(outlet, message, now, recorder)
            }
            Driver::Kinova(outlet) => {
                let message = JointVelocity::of(self.number, point.rate.to_degrees());
                self.put(outlet, message, now, recorder)
            }
            Driver::Action(client) if goal_is_due => {
                // Up to the next goal, and as long again in case that one is late.
                let ahead = 2.0 * GOAL_TICKS as f64 * TICK_S;
                let message = trajectory(&self.joint, point, bounds, ahead);
                recorder.record(self.channel, now.nanos, now.nanos, &message);
                let goal = FollowGoal {
                    trajectory: message,
                    ..FollowGoal::default()
                };
                client
                    .send_goal(goal)
                    .map(|_| ())
                    .map_err(|error| Error::refused(format!("{}: {error:?}", self.command)))
            }
            Driver::Action(_) => Ok(()),
        }
    }

    fn put<M: Message>(
        &self,
        outlet: &Outlet<M>,
        message: M,
        now: Moment,
        recorder: &Recorder,
    ) -> Result<()> {
        recorder.record(self.channel, now.nanos, now.nanos, &message);
        outlet.send(message)
    }
}

/// A short trajectory that expires by itself: on from the set point for `ahead`, then a uniform slow-down to rest.
pub fn trajectory(joint: &str, point: &SetPoint, bounds: &Bounds, ahead: f64) -> JointTrajectory {
    let at = |position: f64, velocity: f64, after: f64| JointTrajectoryPoint {
        positions: vec![position.clamp(bounds.low, bounds.high)],
        velocities: vec![velocity],
        time_from_start: Time::from_seconds(after),
        ..JointTrajectoryPoint::default()
    };
    let SetPoint {
        position, velocity, ..
    } = *point;
    let mut points = vec![at(position, velocity, LEAD_S)];
    if velocity != 0.0 {
        let on = position + velocity * (ahead - LEAD_S);
        if ahead > LEAD_S {
            points.push(at(on, velocity, ahead));
        }
        let slowing = velocity.abs() / bounds.acceleration;
        points.push(at(on + velocity * slowing / 2.0, 0.0, ahead + slowing));
    }
    JointTrajectory {
        header: Header::default(),
        joint_names: vec![joint.to_owned()],
        points,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_ends_at_rest_and_within_the_window() {
        let bounds = Bounds {
            low: -0.5,
            high: 0.5,
            velocity: 0.35,
            acceleration: 4.0,
            step: 0.005,
        };
        for (position, velocity) in [(0.0, 0.35), (0.49, 0.2), (-0.499, -0.35), (0.3, 0.0)] {
            let point = SetPoint {
                position,
                velocity,
                rate: velocity,
            };
            for ahead in [LEAD_S, 0.2] {
                let way = trajectory("wrist", &point, &bounds, ahead);
                let last = way.points.last().expect("it has points");
                assert_eq!(last.velocities, [0.0]);
                assert!(
                    way.points
                        .iter()
                        .all(|point| point.positions[0].abs() <= 0.5)
                );
                let times: Vec<f64> = way
                    .points
                    .iter()
                    .map(|one| one.time_from_start.seconds())
                    .collect();
                assert!(
                    times.windows(2).all(|pair| pair[0] < pair[1]) && times[times.len() - 1] < 0.4
                );
            }
        }
    }
}
