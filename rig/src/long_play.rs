//! Hours of play in fast time: the rig's own checks and state machine beside the twin's arms and board, with a fault in each
//! run. Only the network, the bag and the clock are not there.

mod faults;

use std::collections::{BTreeMap, VecDeque};
use std::f64::consts::PI;

use self::faults::{Effect, FAULTS, Fault};
use crate::backend::trajectory;
use crate::config::{Config, TICK_S};
use crate::fuzz::Draws;
use crate::messages::{Header, JointState, Point, PointStamped, Time};
use crate::model::Model;
use crate::model::tests::PLAIN;
use crate::safety::{Event, Inputs, Reason, Safety, SetPoint, State};
use crate::twin::board::Board;
use crate::twin::wrist::Wrist;
use crate::watch::{JointWatch, MarbleWatch, Moment};

/// Steps a second: six are a tick of the rig, five one of the twin, ten a picture.
const HZ: u64 = 600;

/// Time of the first stamp since 1970 (ns).
const BEGIN: i64 = 1_700_000_000_000_000_000;

/// Longest time from a stop to rest (s), as `rig/README.md` promises it, and that of an arm behind its last set point.
const REST_S: f64 = 0.13;
const ARM_REST_S: f64 = 0.3;

/// A laboratory.
struct Room {
    config: Config,
    wrists: [Wrist; 2],
    board: Board,
    draws: Draws,
    step: u64,
}

/// A run from arming to the end, and what is on its way to the rig.
struct Session {
    safety: Safety,
    marble: MarbleWatch,
    joints: [JointWatch; 2],
    /// Points and when they arrive (s).
    on_the_way: VecDeque<(f64, PointStamped)>,
    reason: Option<Reason>,
    /// When play began, when a fault began, and when the arms were stopped (s).
    played: Option<f64>,
    began: Option<f64>,
    stopped: Option<f64>,
    points: Option<[SetPoint; 2]>,
    /// The last tick, and until when others use the processor (s).
    ticked: f64,
    busy_until: f64,
    /// Angles of joints that stay as they are (rad).
    stays: [Option<f64>; 2],
}

/// How a run ended: the code of its stop, and how long after its fault (s).
type Outcome = Option<(&'static str, f64)>;

impl Room {
    fn new(seed: u64) -> Self {
        let config: Config = toml::from_str(crate::config::EXAMPLE).expect("the example is right");
        let model = Model::parse(PLAIN).expect("the model is right");
        Self {
            wrists: [
                Wrist::at_level(&config.arms.x),
                Wrist::at_level(&config.arms.y),
            ],
            board: Board::new(model, [0.0; 2], 0.5, seed).expect("the model is right"),
            draws: Draws(seed),
            step: 0,
            config,
        }
    }

    fn now(&self) -> Moment {
        Moment {
            steady: self.step as f64 / HZ as f64,
            nanos: BEGIN + (self.step * 1_000_000_000 / HZ).cast_signed(),
        }
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.draws.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// One run: arm, home, play, and a fault after some time, if any.
    fn session(&mut self, fault: Option<&Fault>) -> Result<Outcome, String> {
        let begin = self.now().steady;
        let mut session = Session::new(&self.config, begin);
        let wait = self.uniform(0.5, 4.0);
        let end = |session: &Session| {
            let lasts = if fault.is_some() { 0.5 } else { 0.0 };
            session.stopped.map(|at| at + lasts).or(match fault {
                Some(_) => None,
                None => session.played.map(|at| at + wait),
            })
        };
        while end(&session).is_none_or(|end| self.now().steady < end) {
            let now = self.now();
            if let (Some(played), None, Some(_)) = (session.played, session.began, fault)
                && now.steady >= played + wait
            {
                session.began = Some(now.steady);
            }
            if now.steady - begin > 60.0 {
                return Err("it does not end".to_owned());
            }
            let effect = fault
                .filter(|_| session.began.is_some())
                .map(|fault| &fault.effect);
            if self.step.is_multiple_of(5) {
                self.twin(&mut session, effect, now);
            }
            session.receive(now);
            if self.step.is_multiple_of(6) {
                self.rig(&mut session, effect, now)?;
            }
            self.step += 1;
        }
        let _ = session.safety.handle(Event::Disarm);
        let (State::Stopping(reason) | State::Latched(reason)) = session.safety.state() else {
            return Ok(None);
        };
        let after = session
            .stopped
            .zip(session.began)
            .map(|(stopped, began)| stopped - began);
        Ok(Some((reason.code(), after.unwrap_or(f64::NAN))))
    }

    /// A tick of arms, board and camera.
    fn twin(&mut self, session: &mut Session, effect: Option<&Effect>, now: Moment) {
        let arms = self.config.arms.clone();
        let mut knobs = [0.0; 2];
        for (axis, (_, arm)) in arms.both().into_iter().enumerate() {
            let fastest = if effect == Some(&Effect::DriverDies) {
                0.0
            } else {
                0.83
            };
            let angle = self.wrists[axis].step(now.steady, 5.0 / HZ as f64, fastest);
            knobs[axis] = (angle - arm.level_rad) / arm.gear;
            let mut state = JointState {
                header: Header {
                    stamp: Time::from_nanos(now.nanos),
                    ..Header::default()
                },
                name: vec![arm.joint.clone()],
                position: vec![angle + self.uniform(-4e-5, 4e-5)],
                ..JointState::default()
            };
            if effect == Some(&Effect::JointsLie) {
                let first = state.position[0];
                state.position[0] = *session.stays[axis].get_or_insert(first);
            }
            if effect.is_none_or(|effect| effect.joint(&mut state, axis)) {
                session.reason = session
                    .reason
                    .take()
                    .or(session.joints[axis].take(now, &state).err());
            }
        }
        let seen = self.board.seen();
        self.board.tick(knobs).expect("the model is right");
        if !self.step.is_multiple_of(10) || self.uniform(0.0, 1.0) < 0.002 {
            return;
        }
        let noise = [self.uniform(-2e-3, 2e-3), self.uniform(-2e-3, 2e-3)];
        let point = PointStamped {
            header: Header {
                stamp: Time::from_nanos(now.nanos),
                ..Header::default()
            },
            point: Point {
                x: seen[0] + noise[0],
                y: seen[1] + noise[1],
                z: 0.0,
            },
        };
        let delay = self.uniform(0.026, 0.034);
        let count = self.step / 10;
        let sent = effect.map_or(vec![point.clone()], |effect| effect.points(point, count));
        session
            .on_the_way
            .extend(sent.into_iter().map(|point| (now.steady + delay, point)));
    }

    /// A tick of the rig.
    fn rig(
        &mut self,
        session: &mut Session,
        effect: Option<&Effect>,
        now: Moment,
    ) -> Result<(), String> {
        let stalls = session.began.zip(effect).is_some_and(|(began, effect)| {
            matches!(effect, Effect::Stall(seconds) if now.steady - began < *seconds)
        });
        if stalls || now.steady < session.busy_until {
            return Ok(());
        }
        if self.draws.below(500) == 0 && session.stopped.is_none() {
            session.busy_until = now.steady + self.uniform(0.01, 0.04);
        }
        let late_s = (now.steady - session.ticked - TICK_S).max(0.0);
        session.ticked = now.steady;
        session.drive(&mut self.draws);
        let outside = effect
            .and_then(Effect::reason)
            .filter(|_| session.stopped.is_none());
        if let Some(reason) = session.reason.take().or(outside) {
            let _ = session.safety.handle(Event::Stop(reason));
        }
        let target = session
            .played
            .map(|played| self.target(now.steady - played));
        let angles = session.joints[0].angle().zip(session.joints[1].angle());
        let age_s = |joint: &JointWatch| joint.age_s(now.steady);
        let output = session.safety.tick(&Inputs {
            now: now.steady,
            target: target.and_then(|target| effect.map_or(Some(target), |one| one.target(target))),
            measured: angles.map(Into::into),
            joints_age_s: age_s(&session.joints[0]).max(age_s(&session.joints[1])),
            tracker_age_s: session.marble.age_s(now.steady),
            late_s,
        });
        session.check(output.set_points, now.steady, &self.wrists)?;
        if session.stopped.is_some() {
            // Late ticks lengthen a stop; how much is not asked here.
            session.busy_until = now.steady;
        }
        if let Some(points) = output.set_points {
            for (axis, (_, arm)) in self.config.arms.both().into_iter().enumerate() {
                let bounds = session.safety.bounds(axis);
                let message = trajectory(&arm.joint, &points[axis], &bounds, 2.0 * TICK_S);
                self.wrists[axis].follow(&message, now.steady);
            }
        }
        Ok(())
    }

    /// Targets that turn back and forth with hardly any rest (rad).
    fn target(&self, seconds: f64) -> [f64; 2] {
        let x = 0.24 * 2.0 / PI * (PI / 2.0 * seconds).sin().asin();
        let [(_, one), (_, other)] = self.config.arms.both();
        [
            one.level_rad + one.gear * x,
            other.level_rad + other.gear * 0.5 * x,
        ]
    }
}

impl Session {
    fn new(config: &Config, now: f64) -> Self {
        Self {
            safety: Safety::new(config, false),
            marble: MarbleWatch::new(config.tracker.clone(), config.timeouts, 0.0),
            joints: [JointWatch::new(config, 0), JointWatch::new(config, 1)],
            on_the_way: VecDeque::new(),
            reason: None,
            played: None,
            began: None,
            stopped: None,
            points: None,
            ticked: now,
            busy_until: now,
            stays: [None; 2],
        }
    }

    fn receive(&mut self, now: Moment) {
        let moving = *self.safety.state() == State::Playing;
        while self
            .on_the_way
            .front()
            .is_some_and(|(due, _)| *due <= now.steady)
        {
            if let Some((_, point)) = self.on_the_way.pop_front() {
                let found = self.marble.take(now, &point, moving).err();
                self.reason = self.reason.take().or(found);
            }
        }
    }

    /// What the programs do: arm, home, play. Once stopped, everything that may be asked for.
    fn drive(&mut self, draws: &mut Draws) {
        let angles = self.joints[0].angle().zip(self.joints[1].angle());
        match (self.safety.state(), angles) {
            (State::Idle, Some((x, y))) if self.marble.position().is_some() => {
                self.safety
                    .handle(Event::Arm([x, y]))
                    .expect("the arms are in their window");
                let _ = self.safety.handle(Event::Home);
            }
            (State::Armed, _) if self.played.is_none() && self.safety.is_home() => {
                let _ = self.safety.handle(Event::Play);
            }
            (State::Stopping(_) | State::Latched(_), _) => {
                let event = match draws.below(5) {
                    0 => Event::Arm([0.0; 2]),
                    1 => Event::Home,
                    2 => Event::Play,
                    3 => Event::Disarm,
                    _ => Event::Stop(Reason::Signal("SIGTERM")),
                };
                let _ = self.safety.handle(event);
            }
            _ => (),
        }
    }

    /// The promises: within the limits, at rest in time after a stop, and there for good.
    fn check(
        &mut self,
        points: Option<[SetPoint; 2]>,
        now: f64,
        wrists: &[Wrist; 2],
    ) -> Result<(), String> {
        let before = std::mem::replace(&mut self.points, points);
        if *self.safety.state() == State::Playing {
            self.played.get_or_insert(now);
        }
        for axis in 0..2 {
            let Some((point, before)) = points.zip(before).map(|both| (both.0[axis], both.1[axis]))
            else {
                continue;
            };
            let bounds = self.safety.bounds(axis);
            let most = bounds.acceleration * TICK_S + 1e-9;
            let is_within = point.position >= bounds.low
                && point.position <= bounds.high
                && point.velocity.abs() <= bounds.velocity
                && (point.velocity - before.velocity).abs() <= most
                && (point.position - before.position).abs() <= bounds.step + 1e-9;
            if !is_within {
                return Err(format!(
                    "a set point leaves its limits: {before:?}, {point:?}"
                ));
            }
        }
        if matches!(self.safety.state(), State::Stopping(_) | State::Latched(_)) {
            self.stopped.get_or_insert(now);
        } else if self.stopped.is_some() {
            return Err(format!(
                "it goes on after a stop: {:?}",
                self.safety.state()
            ));
        }
        let Some(after) = self.stopped.map(|at| now - at) else {
            return Ok(());
        };
        let rests = points.is_none_or(|all| all.iter().all(|point| point.is_at_rest()));
        if after >= REST_S && !(rests && matches!(self.safety.state(), State::Latched(_))) {
            return Err(format!("not at rest {after:.3} s after a stop"));
        }
        if after >= ARM_REST_S && wrists.iter().any(|wrist| wrist.rate().abs() > 1e-3) {
            return Err(format!("an arm moves {after:.3} s after a stop"));
        }
        Ok(())
    }
}

/// Plays for some hours. Returns the number of runs without a fault, and for each fault how often and how late it was
/// answered (s).
fn play(hours: f64, seed: u64) -> (usize, BTreeMap<&'static str, Vec<f64>>) {
    let mut room = Room::new(seed);
    let (mut good, mut found) = (0, BTreeMap::<_, Vec<f64>>::new());
    while room.now().steady < 3600.0 * hours {
        let number = room.draws.below(FAULTS.len() + 1);
        let fault = FAULTS.get(number);
        let name = fault.map_or("none", |fault| fault.name);
        let at = room.now().steady;
        match (fault, room.session(fault)) {
            (None, Ok(None)) => good += 1,
            (Some(fault), Ok(Some((code, after)))) => {
                assert_eq!(code, fault.code, "{name} at {at:.2} s");
                assert!(
                    after <= fault.most_s,
                    "{name} at {at:.2} s: after {after:.3} s"
                );
                found.entry(name).or_default().push(after);
            }
            (_, outcome) => panic!("{name} at {at:.2} s: {outcome:?}"),
        }
    }
    (good, found)
}

#[test]
fn minutes_of_play_end_each_fault_in_its_stop() {
    let (good, found) = play(0.3, 1);
    assert!(
        good > 3 && found.len() == FAULTS.len(),
        "{good}, {}",
        found.len()
    );
}

#[test]
#[ignore = "a simulated day takes ten seconds: cargo test --release --package rig -- --ignored --nocapture a_day"]
fn a_day_of_play_ends_each_fault_in_its_stop() {
    let (good, mut found) = play(24.0, 2);
    let count: usize = found.values().map(Vec::len).sum();
    println!("{good} runs without a fault, {count} with one");
    println!("| fault | runs | stopped after, median [ms] | longest | allowed |");
    println!("| --- | ---: | ---: | ---: | ---: |");
    for fault in &FAULTS {
        let all = found.get_mut(fault.name).expect("each fault is drawn");
        all.sort_by(f64::total_cmp);
        let [median, longest] = [all[all.len() / 2], all[all.len() - 1]].map(|s| 1e3 * s);
        let allowed = 1e3 * fault.most_s;
        println!(
            "| {} | {} | {median:.0} | {longest:.0} | {allowed:.0} |",
            fault.name,
            all.len()
        );
    }
    assert!(count >= 10_000, "{count} faults");
}
