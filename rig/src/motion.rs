//! The 100 Hz loop that moves the arms: receive, decide, command, record.

use std::path::Path;

use crate::backend::{Backend, command_topic};
use crate::clock::Ticker;
use crate::commands::Commands;
use crate::config::{Config, TICK_S};
use crate::dds::Caller;
use crate::ending::Arms;
use crate::error::{Error, Result};
use crate::events::Level;
use crate::recorder::Written;
use crate::safety::{Event, Inputs, Reason, Safety, SetPoint, State};
use crate::station::Station;
use crate::watch::Moment;

/// Ticks between checks for other publishers.
const LOOK_TICKS: u64 = 10;

/// Duration of the check for other publishers before the arms are taken (s): the announcement period of Fast-DDS, which
/// most laboratories use.
const LOOK_S: f64 = 3.0;

/// Largest distance from the level pose at which a file may begin (rad).
const NEAR_RAD: f64 = 0.02;

/// Arms under command; in a dry run, all but the commands.
pub struct Motion {
    /// Subscriptions and recorder.
    pub station: Station,
    safety: Safety,
    backend: Option<Backend>,
    callers: Vec<Caller>,
    ticks: u64,
    /// Time of the last tick.
    now: Moment,
    target: Option<[f64; 2]>,
    stop_called: bool,
}

/// Result of a motion.
pub struct Summary {
    /// The bag.
    pub written: Written,
    /// Ticks of the loop, the number more than 2 ms late, and the maximum lateness (s).
    pub loop_ticks: (u64, u64, f64),
}

impl Motion {
    /// Joins the network, and waits until every peer is there; `arm` moves the arms, a dry run does not.
    ///
    /// # Errors
    /// [`Error::Refused`] where arming is not allowed, or says which peer is missing.
    pub fn open(
        config: &Config,
        text: &str,
        (folder, name): (&Path, &str),
        arm: bool,
    ) -> Result<Self> {
        config.safety.check_arming(arm)?;
        let facts = [("armed", arm.to_string()), ("verb", name.to_owned())];
        let mut station = Station::open(config, text, folder, name, &facts)?;
        let backend = if arm {
            Some(Backend::open(
                config,
                &mut station.base.link,
                &mut station.base.recorder,
            )?)
        } else {
            None
        };
        let callers = config.safety.call_on_stop.iter().filter(|_| arm);
        let callers = callers
            .map(|name| station.base.link.caller(name))
            .collect::<Result<_>>()?;
        let mut motion = Self {
            safety: Safety::new(config, !arm),
            backend,
            callers,
            ticks: 0,
            now: station.base.clock.now(),
            target: None,
            stop_called: false,
            station,
        };
        motion.station.base.event(
            Level::Info,
            "begin",
            if arm { "armed run" } else { "dry run" },
        );
        if let Err(error) = motion.wait() {
            motion
                .station
                .base
                .event(Level::Error, "refused", &error.to_string());
            let refused = Err(error);
            let _ = motion.station.base.close(&refused);
            return refused.map(|()| motion);
        }
        Ok(motion)
    }

    /// Waits for joints, tracker and drivers, and takes the arms.
    fn wait(&mut self) -> Result<()> {
        let seconds = self.station.config.network.match_s;
        let ticks = (seconds / TICK_S) as u64;
        let mut missing = String::new();
        // Other publishers are discovered with a delay, and those that have just ended are still listed.
        let settled = (ticks - 1).min((LOOK_S / TICK_S) as u64);
        for tick in 0..ticks {
            let (now, _) = self.station.base.ticker.wait();
            if let Some(reason) = self.station.hear(now, false) {
                return Err(Error::refused(reason.to_string()));
            }
            if tick < settled {
                continue;
            }
            if let Some(reason) = self.others() {
                return Err(Error::refused(format!(
                    "{reason}; the rig commands arms alone"
                )));
            }
            match self.missing(now) {
                Some(what) => missing = what,
                None => return self.arm(now),
            }
        }
        Err(Error::refused(format!("{missing} (waited {seconds} s)")))
    }

    /// Description of the first missing peer.
    fn missing(&self, now: Moment) -> Option<String> {
        let (station, times) = (&self.station, &self.station.config.timeouts);
        for (joint, (table, arm)) in station.joints.iter().zip(station.config.arms.both()) {
            if !(joint.age_s(now.steady) <= times.joints_s) {
                let inbox = station
                    .joint_inboxes
                    .iter()
                    .find(|(inbox, _)| inbox.topic == arm.joint_states);
                let heard = inbox.map_or(0, |(inbox, _)| station.base.link.heard(inbox));
                let there = station.base.link.publishers(&arm.joint_states);
                let what = format!(
                    "{table}: no joint states of {} on {}",
                    arm.joint, arm.joint_states
                );
                return Some(format!("{what}: {}", silence(there, heard, &joint.tally)));
            }
        }
        if !(station.marble.age_s(now.steady) <= times.tracker_s) {
            let (inbox, _) = &station.marble_inbox;
            let (there, heard) = (
                station.base.link.publishers(&inbox.topic),
                station.base.link.heard(inbox),
            );
            let why = silence(there, heard, &station.marble.tally);
            return Some(format!("tracker: no points on {}: {why}", inbox.topic));
        }
        let command = self.backend.as_ref()?.unheard(&station.base.link)?;
        Some(format!("no driver listens on {command}"))
    }

    /// Whether anybody else commands the arms.
    fn others(&self) -> Option<Reason> {
        let config = &self.station.config;
        let arms = config.arms.both();
        arms.iter().find_map(|(_, arm)| {
            // An action's server publishes its status itself; goals of other clients are not visible in advance.
            if config.backend.kind == crate::config::Kind::Action {
                return None;
            }
            let topic = command_topic(config.backend.kind, &arm.command);
            let others = self.station.base.link.publishers(&topic);
            (others > 0).then_some(Reason::OtherPublisher(topic))
        })
    }

    fn arm(&mut self, now: Moment) -> Result<()> {
        let (measured, _) = self.station.measured(now.steady);
        let measured = measured.ok_or_else(|| Error::refused("no joint states yet"))?;
        self.safety
            .handle(Event::Arm(measured))
            .map_err(|reason| Error::refused(format!("{reason}; turn it back by hand")))?;
        let shown = format!("joints at {:.4} and {:.4} rad", measured[0], measured[1]);
        self.station.base.event(Level::Info, "armed", &shown);
        // The wait for peers is not counted as lateness of the loop.
        self.station.base.ticker = Ticker::new(self.station.base.clock);
        Ok(())
    }

    /// One tick: receive, decide, command, record.
    fn tick(&mut self) {
        let (now, late_s) = self.station.base.ticker.wait();
        self.now = now;
        let moving = matches!(self.safety.state(), State::Playing);
        let mut reason = self.station.hear(now, moving);
        self.ticks += 1;
        if self.ticks.is_multiple_of(LOOK_TICKS) {
            reason = reason.or_else(|| self.others());
        }
        let before = self.safety.state().name();
        if let Some(reason) = reason {
            let _ = self.safety.handle(Event::Stop(reason));
        }
        let (measured, joints_age_s) = self.station.measured(now.steady);
        let output = self.safety.tick(&Inputs {
            now: now.steady,
            target: self.target,
            measured,
            joints_age_s,
            tracker_age_s: self.station.marble.age_s(now.steady),
            late_s,
        });
        if let Some(points) = output.set_points {
            self.send(points, output.stopped, now);
        }
        self.note(before);
    }

    fn send(&mut self, points: [SetPoint; 2], stopped: bool, now: Moment) {
        let with_bounds = [0, 1].map(|axis| (points[axis], self.safety.bounds(axis)));
        if let Some(backend) = &mut self.backend {
            // Arms that are held are corrected by small rates; after a stop these have to end, too.
            let rests = points
                .iter()
                .all(|point| point.velocity == 0.0 && (!stopped || point.is_at_rest()));
            let arms = if rests { Arms::AtRest } else { Arms::Moving };
            self.station.base.watch.command(arms);
            let sent = backend.send(with_bounds, stopped, now, &self.station.base.recorder);
            if let Err(error) = sent {
                let _ = self
                    .safety
                    .handle(Event::Stop(Reason::Unsendable(error.to_string())));
            }
        }
        let level = self.safety.level();
        let gears = self.station.config.arms.both().map(|(_, arm)| arm.gear);
        let position = [0, 1].map(|axis| (points[axis].position - level[axis]) / gears[axis]);
        let velocity = [0, 1].map(|axis| points[axis].velocity / gears[axis]);
        self.station
            .point(now, self.safety.state().name(), position, velocity);
    }

    /// Records a change of state, and calls the drivers' stop services.
    fn note(&mut self, before: &str) {
        let state = self.safety.state().clone();
        if state.name() != before {
            match &state {
                State::Stopping(reason) => self.note_stop("stopping", reason),
                State::Latched(reason) => {
                    // Arms that were at rest already are stopped and held in one tick.
                    if before != "stopping" {
                        self.note_stop("stopping", reason);
                    }
                    self.note_stop("latched", reason);
                }
                _ => self.station.base.event(Level::Info, state.name(), ""),
            }
        }
        if matches!(state, State::Stopping(_) | State::Latched(_)) && !self.stop_called {
            self.stop_called = true;
            self.callers.iter().for_each(Caller::call);
        }
    }

    fn note_stop(&self, state: &str, reason: &Reason) {
        let code = format!("{state}:{}", reason.code());
        self.station
            .base
            .event(Level::Error, &code, &reason.to_string());
    }

    /// Ticks until `done`, or until a stop has been held.
    fn until(&mut self, done: impl Fn(&Self) -> bool) -> Result<()> {
        while !done(self) {
            self.tick();
            if let State::Stopping(reason) | State::Latched(reason) = self.safety.state().clone() {
                return self.hold(&reason);
            }
        }
        Ok(())
    }

    /// Repeats a stop for a while, and gives up.
    fn hold(&mut self, reason: &Reason) -> Result<()> {
        let ticks = (self.station.config.safety.hold_s / TICK_S) as u64;
        for _ in 0..ticks {
            self.tick();
        }
        Err(Error::Stopped(format!("{} ({})", reason, reason.code())))
    }

    /// Moves slowly to the level pose.
    ///
    /// # Errors
    /// [`Error::Stopped`] if it is stopped on the way.
    pub fn home(&mut self) -> Result<()> {
        let _ = self.safety.handle(Event::Home);
        self.station.base.event(Level::Info, "homing", "");
        self.until(|motion| *motion.safety.state() == State::Armed)
    }

    /// Plays a file of commands, as the run of a name; `progress` receives the part played so far.
    ///
    /// # Errors
    /// [`Error::Refused`] if the arms are not level, [`Error::Stopped`] if it is stopped on the way.
    pub fn play(
        &mut self,
        commands: &Commands,
        run: &str,
        mut progress: impl FnMut(f64),
    ) -> Result<()> {
        let now = self.station.base.clock.now();
        let (measured, _) = self.station.measured(now.steady);
        let level = self.safety.level();
        let away = measured.map_or(f64::INFINITY, |at| {
            (at[0] - level[0]).abs().max((at[1] - level[1]).abs())
        });
        if self.backend.is_some() && away > NEAR_RAD {
            return Err(Error::refused(format!(
                "a joint is {away:.3} rad from its level pose; run 'rig home --arm' first"
            )));
        }
        let gears = self.station.config.arms.both().map(|(_, arm)| arm.gear);
        let targets = |knobs: [f64; 2]| [0, 1].map(|axis| level[axis] + gears[axis] * knobs[axis]);
        self.target = Some(targets([0.0; 2]));
        let _ = self.safety.handle(Event::Play);
        self.station.base.event(Level::Info, "playing", run);
        let mut last = None;
        for tick in 0_u64.. {
            let time = tick as f64 * TICK_S;
            let Some(row) = commands.row(time) else { break };
            let knobs = commands.values[row];
            self.target = Some(targets(knobs));
            self.tick();
            if last != Some(row) && *self.safety.state() == State::Playing {
                self.station.row(self.now, run, knobs);
                last = Some(row);
            }
            if let State::Stopping(reason) | State::Latched(reason) = self.safety.state().clone() {
                return self.hold(&reason);
            }
            progress(time / commands.seconds());
        }
        self.station.base.event(Level::Info, "played", run);
        self.home()
    }

    /// Finishes the bag with the result of the motion.
    ///
    /// # Errors
    /// The error that ended the motion, or that of the bag.
    pub fn finish(&mut self, outcome: Result<()>) -> Result<Summary> {
        let _ = self.safety.handle(Event::Disarm);
        let ticker = &self.station.base.ticker;
        let loop_ticks = (ticker.ticks, ticker.late, ticker.worst_s);
        let text = format!(
            "{}; {} ticks, {} more than 2 ms late, the worst {:.1} ms; points {} ({} refused), joint states {} and {}",
            self.station.base.watch.arms().words(),
            loop_ticks.0,
            loop_ticks.1,
            1e3 * loop_ticks.2,
            self.station.marble.tally.came,
            self.station.marble.tally.refused,
            self.station.joints[0].tally.came,
            self.station.joints[1].tally.came,
        );
        match &outcome {
            Ok(()) => self.station.base.event(Level::Info, "end", &text),
            Err(error) => self
                .station
                .base
                .event(Level::Error, "end", &format!("{error}; {text}")),
        }
        let written = self.station.base.close(&outcome);
        outcome?;
        Ok(Summary {
            written: written?,
            loop_ticks,
        })
    }
}

/// Why no valid message arrives on a topic.
pub fn silence(there: usize, heard: usize, tally: &crate::watch::Tally) -> String {
    if tally.refused > 0 {
        return format!(
            "{} of {} messages are refused: {}",
            tally.refused, tally.came, tally.why
        );
    }
    match (there, heard) {
        (0, _) => "nobody publishes there".to_owned(),
        (_, 0) => "a publisher is there, but its QoS or type does not match".to_owned(),
        _ => "its publisher is silent".to_owned(),
    }
}
