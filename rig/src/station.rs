//! Subscriptions, checks and recording, shared by all verbs.

use std::f64::consts::TAU;
use std::path::Path;

use crate::base::Base;
use crate::config::{Config, Unit};
use crate::dds::Inbox;
use crate::error::Result;
use crate::frames::{Frames, Size};
use crate::messages::{Header, JointState, PointStamped, Time};
use crate::recorder::{Attached, Channel};
use crate::safety::Reason;
use crate::watch::{JointWatch, MarbleWatch, Moment};

/// Subscriptions, bag and clocks.
pub struct Station {
    /// Configuration.
    pub config: Config,
    /// Clocks, network, bag and stops.
    pub base: Base,
    /// Check of the tracker's points.
    pub marble: MarbleWatch,
    /// Checks of the joints about x and about y.
    pub joints: [JointWatch; 2],
    /// The topics of the joints, each once.
    pub joint_inboxes: Vec<(Inbox<JointState>, Channel)>,
    /// The topic of the tracker.
    pub marble_inbox: (Inbox<PointStamped>, Channel),
    frames: Frames,
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
        let mut facts = facts.to_vec();
        let backend = format!("{:?}", config.backend.kind).to_lowercase();
        facts.push(("backend", backend));
        let attached = Attached {
            name: "rig.toml",
            text,
        };
        let (network, safety) = (&config.network, &config.safety);
        let mut base = Base::open(network, safety, attached, (folder, name), &facts)?;
        let (link, recorder) = (&mut base.link, &mut base.recorder);
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
        let size = Size {
            edges_m: [tracker.edge_x_m, config.board.edge_y_m],
            radius_m: config.board.marble_radius_m,
        };
        let frames = Frames::begin(recorder, size, base.clock.now().nanos);
        Ok(Self {
            marble: MarbleWatch::new(config.tracker.clone(), config.timeouts, 0.0),
            joints: [JointWatch::new(config, 0), JointWatch::new(config, 1)],
            joint_inboxes,
            marble_inbox: (
                marble_inbox,
                recorder.channel::<PointStamped>(&tracker.topic),
            ),
            frames,
            rows: recorder.channel::<JointState>("/rig/command"),
            points: recorder.channel::<JointState>("/rig/setpoint"),
            config: config.clone(),
            base,
        })
    }

    /// Takes and records all received messages; returns the first reason to stop. The argument says whether the knobs move.
    pub fn hear(&mut self, now: Moment, moving: bool) -> Option<Reason> {
        let mut reasons: Vec<Reason> = Vec::new();
        let (clock, recorder) = (self.base.clock, &self.base.recorder);
        let mut turned = None;
        for (inbox, channel) in &self.joint_inboxes {
            inbox.drain(clock, |moment, state| {
                recorder.record(*channel, moment.nanos, state.header.stamp.nanos(), &state);
                for joint in &mut self.joints {
                    reasons.extend(joint.take(moment, &state).err());
                }
                turned = Some((moment.nanos, state.header.stamp));
            });
        }
        if let (Some((log, stamp)), Some(tilts)) = (turned, self.tilts()) {
            self.frames.board(recorder, log, stamp, tilts);
        }
        let tracker = &self.config.tracker;
        let unit_m = match tracker.unit {
            Unit::Edges => tracker.edge_x_m,
            Unit::M => 1.0,
        };
        let (inbox, channel) = &self.marble_inbox;
        let (marble, frames) = (&mut self.marble, &self.frames);
        inbox.drain(clock, |moment, point| {
            recorder.record(*channel, moment.nanos, point.header.stamp.nanos(), &point);
            let place = [point.point.x, point.point.y].map(|value| value * unit_m);
            frames.marble(recorder, moment.nanos, point.header.stamp, place);
            reasons.extend(marble.take(moment, &point, moving).err());
        });
        reasons.extend(self.base.stops(now));
        reasons.into_iter().next()
    }

    /// The last joint angles (rad), and the age of the older one (s).
    pub fn measured(&self, steady: f64) -> (Option<[f64; 2]>, f64) {
        let [x, y] = &self.joints;
        let angles = x.angle().zip(y.angle()).map(Into::into);
        (angles, x.age_s(steady).max(y.age_s(steady)))
    }

    /// The board's tilts (rad) as far as the knobs show them: the joints' angles through both gears.
    fn tilts(&self) -> Option<[f64; 2]> {
        let (measured, _) = self.measured(0.0);
        let arms = self.config.arms.both();
        measured.map(|angles| {
            [0, 1].map(|axis| {
                let arm = arms[axis].1;
                // A continuous wrist may be some full turns away from its level pose.
                let turned = angles[axis] - arm.level_rad;
                let turned = turned - TAU * (turned / TAU).round();
                self.config.board.gear * turned / arm.gear
            })
        })
    }

    /// Records the start of a row of a file (knob angles, rad).
    pub fn row(&self, now: Moment, run: &str, knobs: [f64; 2]) {
        let state = knob_state(now, run, knobs, Vec::new());
        self.base
            .recorder
            .record(self.rows, now.nanos, now.nanos, &state);
    }

    /// Records the knobs' set points (rad), their rates (rad/s), and the state of the rig.
    pub fn point(&self, now: Moment, state: &str, position: [f64; 2], velocity: [f64; 2]) {
        let state = knob_state(now, state, position, velocity.to_vec());
        self.base
            .recorder
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
