//! The 100 Hz loop beside the rig of another lab: receive, decide, command, record.

use std::path::Path;

use super::Seen;
use super::config::LabConfig;
use super::devices::Devices;
use super::guard::{Guard, Inputs, Phase};
use crate::base::Base;
use crate::clock::Ticker;
use crate::commands::Commands;
use crate::config::TICK_S;
use crate::ending::Arms;
use crate::error::{Error, Result};
use crate::events::Level;
use crate::frames::Frames;
use crate::messages::{Header, Point, PointStamped, Time};
use crate::recorder::{Attached, Written};
use crate::safety::Reason;
use crate::watch::{MarbleWatch, Moment};

/// Ticks between checks for other publishers.
const LOOK_TICKS: u64 = 10;

/// Duration of the check for other publishers before the motors are taken (s), as for arms.
const LOOK_S: f64 = 3.0;

/// Duration for which zero is commanded after a file (s).
const REST_S: f64 = 0.3;

/// Shortest time between pictures of the labs' cameras (s).
const PICTURE_S: f64 = 1.0 / 60.0;

/// What a run may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// It only records.
    Listen,
    /// It does everything but command.
    DryRun,
    /// It commands the motors.
    Armed,
}

/// Result of a run.
pub struct Finished {
    /// The bag.
    pub written: Written,
    /// Number of states of the board.
    pub states: u64,
    /// Ticks of the loop, the number more than 2 ms late, and the maximum lateness (s).
    pub loop_ticks: (u64, u64, f64),
    /// The network is left after the result is printed.
    _base: Base,
}

/// A run beside a rig.
pub struct Run {
    /// Clocks, network, bag and stops.
    pub base: Base,
    config: LabConfig,
    devices: Devices,
    /// Whether the motors are commanded.
    arm: bool,
    frames: Frames,
    guard: Guard,
    marble: MarbleWatch,
    /// The last state, and when it came (s).
    last: Option<(f64, Seen)>,
    states: u64,
    ticks: u64,
}

impl Run {
    /// Joins the network, and begins a bag; a run that plays waits for the rig.
    ///
    /// # Errors
    /// [`Error::Refused`] where arming is not allowed, or says what is missing.
    pub fn open(
        config: &LabConfig,
        text: &str,
        (folder, name): (&Path, &str),
        mode: Mode,
    ) -> Result<Self> {
        let arm = mode == Mode::Armed;
        config.safety.check_arming(arm)?;
        let facts = [
            ("armed", arm.to_string()),
            ("verb", name.to_owned()),
            (
                "backend",
                format!("{:?}", config.backend.kind).to_lowercase(),
            ),
        ];
        // Another name than that of a rig with arms: such a bag is imported as the lab's own.
        let attached = Attached {
            name: "lab.toml",
            text,
        };
        let mut base = Base::open(
            &config.network,
            &config.safety,
            attached,
            (folder, name),
            &facts,
        )?;
        let now = base.clock.now().nanos;
        let frames = Frames::begin(&mut base.recorder, config.backend.kind.size(), now);
        let devices = Devices::open(config, &mut base, arm)?;
        let mut run = Self {
            devices,
            arm,
            frames,
            guard: Guard::new(config.limits, config.timeouts),
            marble: MarbleWatch::new(config.tracker(), config.timeouts, PICTURE_S),
            last: None,
            states: 0,
            ticks: 0,
            config: config.clone(),
            base,
        };
        let what = match mode {
            Mode::Listen => "listening",
            Mode::DryRun => "dry run",
            Mode::Armed => "armed run",
        };
        run.base.event(Level::Info, "begin", what);
        if mode != Mode::Listen
            && let Err(error) = run.wait()
        {
            run.base.event(Level::Error, "refused", &error.to_string());
            let refused = Err(error);
            let _ = run.base.close(&refused);
            return refused.map(|()| run);
        }
        Ok(run)
    }

    /// Waits for states, a marble and the motors.
    fn wait(&mut self) -> Result<()> {
        let seconds = self.config.network.match_s;
        let ticks = (seconds / TICK_S) as u64;
        let settled = (ticks - 1).min((LOOK_S / TICK_S) as u64);
        let mut missing = String::new();
        for tick in 0..ticks {
            let (now, _) = self.base.ticker.wait();
            if let Some(reason) = self.hear(now, false) {
                return Err(Error::refused(reason.to_string()));
            }
            if tick < settled {
                continue;
            }
            if let Some(reason) = self.devices.others(&self.base) {
                return Err(Error::refused(format!(
                    "{reason}; the rig commands motors alone: end the learner"
                )));
            }
            let times = &self.config.timeouts;
            let has_state = self.state_age_s(now) <= times.joints_s;
            let has_marble = self.marble.age_s(now.steady) <= times.tracker_s;
            let found = self.devices.missing(&self.base, has_state);
            let unseen = || "no marble is seen: put it on the board".to_owned();
            let Some(what) = found.or_else(|| (!has_marble).then(unseen)) else {
                // The wait is not counted as lateness of the loop.
                self.base.ticker = Ticker::new(self.base.clock);
                return Ok(());
            };
            missing = what;
        }
        Err(Error::refused(format!("{missing} (waited {seconds} s)")))
    }

    fn state_age_s(&self, now: Moment) -> f64 {
        self.last
            .map_or(f64::INFINITY, |(came, _)| now.steady - came)
    }

    /// Takes and records all that has come; returns the first reason to stop.
    fn hear(&mut self, now: Moment, moving: bool) -> Option<Reason> {
        let mut reasons = Vec::new();
        let (base, frames, marble) = (&self.base, &self.frames, &mut self.marble);
        let (last, states) = (&mut self.last, &mut self.states);
        self.devices.hear(base, |moment, seen| {
            *states += 1;
            let stamp = Time::from_nanos(moment.nanos);
            if seen.tilts.iter().all(|tilt| tilt.is_finite()) {
                *last = Some((moment.steady, seen));
                frames.board(&base.recorder, moment.nanos, stamp, seen.tilts);
            }
            frames.marble(&base.recorder, moment.nanos, stamp, seen.place_m);
            // Messages have no stamps: that of receipt stands for it.
            let [x, y] = seen.place_m;
            let point = PointStamped {
                header: Header {
                    stamp,
                    ..Header::default()
                },
                point: Point { x, y, z: 0.0 },
            };
            reasons.extend(marble.take(moment, &point, moving).err());
        });
        reasons.extend(self.base.stops(now));
        reasons.into_iter().next()
    }

    /// One tick with commands to play, if any.
    fn tick(&mut self, target: Option<[f64; 2]>) -> Moment {
        let (now, late_s) = self.base.ticker.wait();
        let playing = *self.guard.phase() == Phase::Playing;
        let moving = playing && target.is_some_and(|both| both != [0.0; 2]);
        let mut reason = self.hear(now, moving);
        self.ticks += 1;
        if self.ticks.is_multiple_of(LOOK_TICKS) {
            reason = reason.or_else(|| self.devices.others(&self.base));
        }
        let was_latched = matches!(self.guard.phase(), Phase::Latched(_));
        if let Some(reason) = reason {
            self.guard.stop(reason);
        }
        let commands = self.guard.tick(&Inputs {
            now: now.steady,
            target,
            tilts: self.last.map(|(_, seen)| seen.tilts),
            state_age_s: self.state_age_s(now),
            marble_age_s: self.marble.age_s(now.steady),
            late_s,
        });
        if self.arm {
            let rests = commands == [0.0; 2];
            let arms = if rests { Arms::AtRest } else { Arms::Moving };
            self.base.watch.command(arms);
        }
        if let Err(error) = self.devices.send(commands, now, &self.base) {
            self.guard.stop(Reason::Unsendable(error.to_string()));
        }
        if let (Phase::Latched(reason), false) = (self.guard.phase(), was_latched) {
            let code = format!("stopping:{}", reason.code());
            self.base.event(Level::Error, &code, &reason.to_string());
        }
        now
    }

    /// Repeats a stop for a while, and gives up.
    fn hold(&mut self) -> Result<()> {
        let Phase::Latched(reason) = self.guard.phase().clone() else {
            return Ok(());
        };
        for _ in 0..(self.config.safety.hold_s / TICK_S) as u64 {
            self.tick(None);
        }
        Err(Error::Stopped(format!("{} ({})", reason, reason.code())))
    }

    /// Plays a file of commands of motors 1 and 2, as the run of a name; `progress` receives the part played so far.
    ///
    /// # Errors
    /// [`Error::Stopped`] if it is stopped on the way.
    pub fn play(
        &mut self,
        commands: &Commands,
        run: &str,
        mut progress: impl FnMut(f64),
    ) -> Result<()> {
        self.guard.play();
        self.base.event(Level::Info, "playing", run);
        for tick in 0_u64.. {
            let time = tick as f64 * TICK_S;
            let Some(row) = commands.row(time) else { break };
            self.tick(Some(commands.values[row]));
            if matches!(self.guard.phase(), Phase::Latched(_)) {
                return self.hold();
            }
            progress(time / commands.seconds());
        }
        self.guard.end();
        self.base.event(Level::Info, "played", run);
        for _ in 0..(REST_S / TICK_S) as u64 {
            self.tick(None);
        }
        self.hold()
    }

    /// Records for some seconds, or until a signal.
    ///
    /// # Errors
    /// [`Error::Refused`] if the recording fails.
    pub fn listen(&mut self, seconds: Option<f64>) -> Result<()> {
        let begin = self.base.clock.now().steady;
        loop {
            let (now, _) = self.base.ticker.wait();
            match self.hear(now, false) {
                Some(Reason::Signal(_)) => return Ok(()),
                Some(reason) if reason.ends_recording() => {
                    return Err(Error::refused(reason.to_string()));
                }
                Some(reason) => {
                    self.base
                        .event(Level::Error, reason.code(), &reason.to_string());
                }
                None => (),
            }
            if seconds.is_some_and(|seconds| now.steady - begin >= seconds) {
                return Ok(());
            }
        }
    }

    /// Commands zero, and finishes the bag.
    ///
    /// # Errors
    /// The error that ended the run, or that of the bag.
    pub fn finish(mut self, outcome: Result<()>) -> Result<Finished> {
        let now = self.base.clock.now();
        match self.devices.send([0.0; 2], now, &self.base) {
            Ok(()) if self.arm => self.base.watch.command(Arms::AtRest),
            Ok(()) => (),
            Err(error) => self
                .base
                .event(Level::Error, "unsendable", &error.to_string()),
        }
        let arms = self.base.watch.arms().words();
        match &outcome {
            Ok(()) => self.base.event(Level::Info, "end", arms),
            Err(error) => self
                .base
                .event(Level::Error, "end", &format!("{error}; {arms}")),
        }
        let ticker = &self.base.ticker;
        let loop_ticks = (ticker.ticks, ticker.late, ticker.worst_s);
        let Self {
            mut base,
            devices,
            states,
            ..
        } = self;
        // The connection ends with a last command of zero.
        drop(devices);
        let written = base.close(&outcome);
        outcome?;
        Ok(Finished {
            written: written?,
            states,
            loop_ticks,
            _base: base,
        })
    }
}
