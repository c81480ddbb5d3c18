//! Subscriptions, checks and recording, shared by all verbs.

use std::collections::BTreeMap;
use std::path::Path;

use crate::clock::{Clock, Ticker};
use crate::config::Config;
use crate::dds::{Inbox, Link, Trigger};
use crate::error::Result;
use crate::messages::{Bool, Header, JointState, Log, PointStamped, Time};
use crate::recorder::{Channel, Recorder, fresh};
use crate::safety::Reason;
use crate::signals::Signals;
use crate::watch::{JointWatch, MarbleWatch, Moment};

/// Severity of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// It went as it should.
    Info = 20,
    /// It did not.
    Error = 40,
}

/// Subscriptions, bag and clocks.
pub struct Station {
    /// Configuration.
    pub config: Config,
    /// Time.
    pub clock: Clock,
    /// The loop's ticks.
    pub ticker: Ticker,
    /// The network.
    pub link: Link,
    /// The bag.
    pub recorder: Recorder,
    /// Check of the tracker's points.
    pub marble: MarbleWatch,
    /// Checks of the joints about x and about y.
    pub joints: [JointWatch; 2],
    /// The topics of the joints, each once.
    pub joint_inboxes: Vec<(Inbox<JointState>, Channel)>,
    /// The topic of the tracker.
    pub marble_inbox: (Inbox<PointStamped>, Channel),
    e_stop: (Inbox<Bool>, Channel),
    stop: Trigger,
    signals: Signals,
    events: Channel,
    rows: Channel,
    points: Channel,
}

impl Station {
    /// Joins the network as `rig`, and begins a bag in a folder.
    ///
    /// # Errors
    /// [`Error::Refused`](crate::error::Error::Refused) if the network or the bag is unavailable.
    pub fn open(
        config: &Config,
        text: &str,
        folder: &Path,
        name: &str,
        facts: &[(&str, String)],
    ) -> Result<Self> {
        let signals = Signals::register()?;
        let mut link = Link::open(&config.network, "rig")?;
        let mut all: BTreeMap<String, String> = facts
            .iter()
            .map(|(key, value)| ((*key).to_owned(), value.clone()))
            .collect();
        all.insert("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned());
        all.insert(
            "backend".to_owned(),
            format!("{:?}", config.backend.kind).to_lowercase(),
        );
        let mut recorder = Recorder::create(&fresh(folder, name)?, text, all)?;
        let mut joint_inboxes: Vec<(Inbox<JointState>, Channel)> = Vec::new();
        for (_, arm) in config.arms.both() {
            if joint_inboxes
                .iter()
                .all(|(inbox, _)| inbox.topic != arm.joint_states)
            {
                let inbox = link.subscribe(&arm.joint_states, config.tracker.reliability)?;
                joint_inboxes.push((inbox, recorder.channel::<JointState>(&arm.joint_states)));
            }
        }
        let tracker = &config.tracker;
        let marble_inbox = link.subscribe(&tracker.topic, tracker.reliability)?;
        let e_stop = link.subscribe(
            &config.safety.e_stop,
            crate::config::Reliability::BestEffort,
        )?;
        let clock = Clock::new();
        Ok(Self {
            marble: MarbleWatch::new(config),
            joints: [JointWatch::new(config, 0), JointWatch::new(config, 1)],
            joint_inboxes,
            marble_inbox: (
                marble_inbox,
                recorder.channel::<PointStamped>(&tracker.topic),
            ),
            e_stop: (e_stop, recorder.channel::<Bool>(&config.safety.e_stop)),
            stop: link.serve(&config.safety.stop_service)?,
            signals,
            events: recorder.channel::<Log>("/rig/events"),
            rows: recorder.channel::<JointState>("/rig/command"),
            points: recorder.channel::<JointState>("/rig/setpoint"),
            ticker: Ticker::new(clock),
            config: config.clone(),
            clock,
            link,
            recorder,
        })
    }

    /// Takes and records all received messages; returns the first reason to stop. The argument says whether the knobs move.
    pub fn hear(&mut self, now: Moment, moving: bool) -> Option<Reason> {
        let mut reasons: Vec<Reason> = Vec::new();
        let (clock, recorder) = (self.clock, &self.recorder);
        for (inbox, channel) in &self.joint_inboxes {
            inbox.drain(clock, |moment, state| {
                recorder.record(*channel, moment.nanos, state.header.stamp.nanos(), &state);
                for joint in &mut self.joints {
                    reasons.extend(joint.take(moment, &state).err());
                }
            });
        }
        let (inbox, channel) = &self.marble_inbox;
        let marble = &mut self.marble;
        inbox.drain(clock, |moment, point| {
            recorder.record(*channel, moment.nanos, point.header.stamp.nanos(), &point);
            reasons.extend(marble.take(moment, &point, moving).err());
        });
        let (inbox, channel) = &self.e_stop;
        inbox.drain(clock, |moment, stop| {
            recorder.record(*channel, moment.nanos, moment.nanos, &stop);
            if stop.data {
                reasons.push(Reason::EmergencyStop(inbox.topic.clone()));
            }
        });
        if self.stop.asked() {
            reasons.push(Reason::EmergencyStop(
                self.config.safety.stop_service.clone(),
            ));
        }
        reasons.extend(self.signals.caught().map(Reason::Signal));
        reasons.extend(self.ticker.stepped(now).map(Reason::ClockStepped));
        reasons.extend(self.recorder.failure().map(Reason::Recorder));
        reasons.into_iter().next()
    }

    /// The last joint angles (rad), and the age of the older one (s).
    pub fn measured(&self, steady: f64) -> (Option<[f64; 2]>, f64) {
        let [x, y] = &self.joints;
        let angles = x.angle().zip(y.angle()).map(Into::into);
        (angles, x.age_s(steady).max(y.age_s(steady)))
    }

    /// Records an event.
    pub fn event(&self, level: Level, code: &str, message: &str) {
        let now = self.clock.now().nanos;
        let log = Log {
            stamp: Time::from_nanos(now),
            level: level as u8,
            name: "rig".to_owned(),
            msg: message.to_owned(),
            function: code.to_owned(),
            ..Log::default()
        };
        self.recorder.record(self.events, now, now, &log);
    }

    /// Records the start of a row of a file (knob angles, rad).
    pub fn row(&self, now: Moment, run: &str, knobs: [f64; 2]) {
        let state = knob_state(now, run, knobs, Vec::new());
        self.recorder
            .record(self.rows, now.nanos, now.nanos, &state);
    }

    /// Records the knobs' set points (rad), their rates (rad/s), and the state of the rig.
    pub fn point(&self, now: Moment, state: &str, position: [f64; 2], velocity: [f64; 2]) {
        let state = knob_state(now, state, position, velocity.to_vec());
        self.recorder
            .record(self.points, now.nanos, now.nanos, &state);
    }
}

fn knob_state(now: Moment, frame: &str, position: [f64; 2], velocity: Vec<f64>) -> JointState {
    JointState {
        header: Header {
            stamp: Time::from_nanos(now.nanos),
            frame_id: frame.to_owned(),
        },
        name: vec!["knob_x".to_owned(), "knob_y".to_owned()],
        position: position.to_vec(),
        velocity,
        effort: Vec::new(),
    }
}
