//! The simulated arms: each kind of driver, and a joint that follows it at its maximum rate.

use std::collections::VecDeque;

use ros2_client::action::{ActionServerQosPolicies, SendGoalResponse};
use ros2_client::qos::Durability;
use ros2_client::{ActionServer, ActionTypeName, Name, action_msgs};

use crate::clock::Clock;
use crate::config::{Arm, Config, Kind, Reliability};
use crate::dds::{Inbox, Link, service_qos};
use crate::error::{Error, Result};
use crate::messages::{
    Float64MultiArray, FollowFeedback, FollowGoal, FollowResult, JointTrajectory, JointVelocity,
};

/// Messages that Kinova's driver keeps; each is 10 ms of motion.
const BUFFER: usize = 2000;
const KINOVA_S: f64 = 0.01;

/// The last command of an arm.
enum Plan {
    /// Rest.
    Rest,
    /// Angles (rad) at times (s).
    Way(Vec<(f64, f64)>),
    /// A rate (rad/s) until a time (s).
    Rate(f64, f64),
    /// Rates (rad/s), each for 10 ms.
    Queue(VecDeque<f64>),
}

enum Ears {
    Trajectory(Inbox<JointTrajectory>),
    Velocities(Inbox<Float64MultiArray>),
    Kinova(Inbox<JointVelocity>),
    Action(Box<ActionServer<FollowGoal, FollowResult, FollowFeedback>>),
}

/// A driver and its joint.
pub struct Driver {
    ears: Ears,
    clock: Clock,
    wrist: Wrist,
}

/// A joint that does what commands say, at its maximum rate.
pub struct Wrist {
    joint: String,
    number: usize,
    plan: Plan,
    angle: f64,
    rate: f64,
    /// Seconds of a Kinova message that are not played yet.
    credit: f64,
}

impl Driver {
    /// At its level pose.
    ///
    /// # Errors
    /// [`Error::Refused`] if DDS does not allow it.
    pub fn open(config: &Config, arm: &Arm, link: &mut Link) -> Result<Self> {
        let command = &arm.command;
        let ears = match config.backend.kind {
            Kind::Trajectory => Ears::Trajectory(link.subscribe(command, Reliability::Reliable)?),
            Kind::Velocities => Ears::Velocities(link.subscribe(command, Reliability::Reliable)?),
            Kind::Kinova => Ears::Kinova(link.subscribe(command, Reliability::Reliable)?),
            Kind::Action => Ears::Action(Box::new(action(link, command)?)),
        };
        Ok(Self {
            ears,
            clock: Clock::new(),
            wrist: Wrist::at_level(arm),
        })
    }

    /// Angle of the joint (rad).
    pub fn angle(&self) -> f64 {
        self.wrist.angle
    }

    /// Rate of the joint (rad/s).
    pub fn rate(&self) -> f64 {
        self.wrist.rate()
    }

    /// Clears the last command.
    pub fn rest(&mut self) {
        self.wrist.plan = Plan::Rest;
    }

    /// Receives commands and turns for a tick, no faster than `fastest` (rad/s); rates expire. Returns the angle (rad).
    pub fn step(&mut self, now: f64, tick: f64, fastest: f64, expires_s: f64) -> f64 {
        let (clock, wrist) = (self.clock, &mut self.wrist);
        match &self.ears {
            Ears::Trajectory(inbox) => inbox.drain(clock, |_, message| {
                wrist.follow(&message, now);
            }),
            Ears::Velocities(inbox) => inbox.drain(clock, |_, message| {
                wrist.turn(&message, now + expires_s);
            }),
            Ears::Kinova(inbox) => inbox.drain(clock, |_, message| wrist.queue(&message)),
            Ears::Action(server) => {
                while let Ok(Some((id, request))) = server.receive_goal() {
                    let response = SendGoalResponse {
                        accepted: wrist.follow(&request.goal.trajectory, now),
                        stamp: ros2_client::builtin_interfaces::Time::now(),
                    };
                    let _ = server.send_goal_response(id, response);
                }
            }
        }
        wrist.step(now, tick, fastest)
    }
}

impl Wrist {
    /// At its level pose.
    pub fn at_level(arm: &Arm) -> Self {
        Self {
            joint: arm.joint.clone(),
            number: arm.number,
            plan: Plan::Rest,
            angle: arm.level_rad,
            rate: 0.0,
            credit: 0.0,
        }
    }

    /// Rate of the joint (rad/s).
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Takes a trajectory; returns whether it is one of this joint. Otherwise the joint rests.
    pub fn follow(&mut self, message: &JointTrajectory, now: f64) -> bool {
        let found = way(message, &self.joint, now, self.angle);
        let accepted = found.is_some();
        self.plan = found.unwrap_or(Plan::Rest);
        accepted
    }

    /// Takes the rates of joints (rad/s), which count until a time (s).
    pub fn turn(&mut self, message: &Float64MultiArray, until: f64) {
        let rate = message.data.get(self.number - 1).copied().unwrap_or(0.0);
        self.plan = Plan::Rate(or_rest(rate), until);
    }

    /// Takes the rates of joints for the next 10 ms.
    pub fn queue(&mut self, message: &JointVelocity) {
        if !matches!(self.plan, Plan::Queue(_)) {
            self.plan = Plan::Queue(VecDeque::new());
        }
        if let Plan::Queue(queue) = &mut self.plan
            && queue.len() < BUFFER
        {
            queue.push_back(or_rest(message.joint(self.number).to_radians()));
        }
    }

    /// Turns for a tick, no faster than `fastest` (rad/s); returns the angle (rad).
    pub fn step(&mut self, now: f64, tick: f64, fastest: f64) -> f64 {
        let wanted = match &mut self.plan {
            Plan::Way(points) => along(points, now),
            Plan::Rate(rate, until) if now < *until => self.angle + *rate * tick,
            Plan::Rest | Plan::Rate(..) => self.angle,
            Plan::Queue(queue) => {
                self.credit += tick;
                let mut angle = self.angle;
                while self.credit >= KINOVA_S {
                    self.credit -= KINOVA_S;
                    angle += queue.pop_front().unwrap_or(0.0) * KINOVA_S;
                }
                angle
            }
        };
        let most = fastest * tick;
        let turn = (wanted - self.angle).clamp(-most, most);
        self.rate = turn / tick;
        self.angle += turn;
        self.angle
    }
}

/// A rate, none for what is no number: the joint's angle would be none from then on.
fn or_rest(rate: f64) -> f64 {
    if rate.is_finite() { rate } else { 0.0 }
}

/// The trajectory of a joint from its present angle; none if the message is of other joints or out of order.
fn way(message: &JointTrajectory, joint: &str, now: f64, angle: f64) -> Option<Plan> {
    let index = message.joint_names.iter().position(|name| name == joint)?;
    let mut points = vec![(now, angle)];
    for point in &message.points {
        let at = now + point.time_from_start.seconds();
        let angle = *point.positions.get(index)?;
        if !angle.is_finite() || at <= points[points.len() - 1].0 {
            return None;
        }
        points.push((at, angle));
    }
    Some(Plan::Way(points))
}

/// The angle of a trajectory at a time; it rests at its end.
fn along(points: &[(f64, f64)], now: f64) -> f64 {
    let after = points.partition_point(|&(at, _)| at <= now);
    match (points.get(after.wrapping_sub(1)), points.get(after)) {
        (Some(&(t0, a0)), Some(&(t1, a1))) => {
            let part = (now - t0) / (t1 - t0);
            // The difference of two angles may be infinite, and no number once it is multiplied by 0.
            a0 + (part * a1 - part * a0)
        }
        (None, Some(&(_, angle))) | (Some(&(_, angle)), None) => angle,
        (None, None) => 0.0,
    }
}

fn action(
    link: &mut Link,
    command: &str,
) -> Result<ActionServer<FollowGoal, FollowResult, FollowFeedback>> {
    let name =
        Name::parse(command).map_err(|error| Error::refused(format!("{command}: {error:?}")))?;
    let qos = ActionServerQosPolicies {
        goal_service: service_qos(),
        result_service: service_qos(),
        cancel_service: service_qos(),
        feedback_publisher: service_qos(),
        status_publisher: service_qos().durability(Durability::TransientLocal),
    };
    let mapping = link.mapping();
    let mut server: ActionServer<FollowGoal, FollowResult, FollowFeedback> = link
        .node()
        .create_action_server(
            mapping,
            &name,
            &ActionTypeName::new("control_msgs", "FollowJointTrajectory"),
            qos,
        )
        .map_err(|error| Error::refused(format!("{command}: {error:?}")))?;
    let _ = server
        .my_status_publisher()
        .publish(action_msgs::GoalStatusArray {
            status_list: vec![],
        });
    Ok(server)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_is_followed_point_by_point_and_then_held() {
        let points = [(1.0, 0.0), (2.0, 0.1), (4.0, -0.1)];
        let found = [0.5, 1.5, 3.0, 9.0].map(|now| along(&points, now));
        assert_eq!(found, [0.0, 0.05, 0.0, -0.1]);
    }

    #[test]
    fn angles_whose_difference_overflows_left_the_joint_without_an_angle_for_ever() {
        let points = [(1.0, f64::MIN), (2.0, f64::MAX)];
        for (now, sign) in [(1.0, -1.0), (1.25, -1.0), (1.75, 1.0), (2.0, 1.0)] {
            assert_eq!(along(&points, now).signum(), sign, "{now} s");
        }
        assert_eq!(along(&points, 1.5), 0.0);
    }

    #[test]
    fn a_rate_that_is_no_number_left_the_joint_without_an_angle_for_ever() {
        let config: Config = toml::from_str(crate::config::EXAMPLE).expect("the example is right");
        let mut wrist = Wrist::at_level(&config.arms.x);
        let data = vec![f64::NAN; 7];
        wrist.turn(
            &Float64MultiArray {
                data,
                ..Float64MultiArray::default()
            },
            1.0,
        );
        assert_eq!(wrist.step(0.0, 0.01, 0.8), config.arms.x.level_rad);
        wrist.queue(&JointVelocity::of(config.arms.x.number, f64::NAN));
        assert_eq!(wrist.step(0.01, 0.01, 0.8), config.arms.x.level_rad);
    }
}
