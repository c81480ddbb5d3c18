//! The safety state machine, without a clock, input or output of its own.
//!
//! Its inputs are events and times, its outputs set points; `rig/README.md` has the diagram of the states.

mod motion;
mod reason;

pub use motion::{Bounds, SetPoint};
pub use reason::Reason;

use crate::config::{Config, Limits, TICK_S, Timeouts};

/// State of the arms.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// Nothing is commanded.
    Idle,
    /// The arms are held where they are.
    Armed,
    /// The arms move slowly to the level pose.
    Homing,
    /// The arms follow a file of commands.
    Playing,
    /// The arms come to rest.
    Stopping(Reason),
    /// The arms are held at rest until a new start by hand.
    Latched(Reason),
}

impl State {
    /// Its name in bags.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Armed => "armed",
            Self::Homing => "homing",
            Self::Playing => "playing",
            Self::Stopping(_) => "stopping",
            Self::Latched(_) => "latched",
        }
    }
}

/// External events.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Take the arms at their measured joint angles (rad).
    Arm([f64; 2]),
    /// Move slowly to the level pose.
    Home,
    /// Follow commands.
    Play,
    /// Release the arms: no more commands.
    Disarm,
    /// Come to rest, and stay there.
    Stop(Reason),
}

/// Inputs of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Inputs {
    /// Time of the monotonic clock (s).
    pub now: f64,
    /// Target joint angles (rad), if a file is played.
    pub target: Option<[f64; 2]>,
    /// Last measured joint angles (rad), unwrapped.
    pub measured: Option<[f64; 2]>,
    /// Age of the older of the two (s).
    pub joints_age_s: f64,
    /// Age of the marble's last valid point (s).
    pub tracker_age_s: f64,
    /// Lateness of this tick (s).
    pub late_s: f64,
}

/// Outputs of a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// Set points of the joints about x and y; none while nothing is commanded.
    pub set_points: Option<[SetPoint; 2]>,
    /// Whether the arms come to rest or are held after a stop.
    pub stopped: bool,
}

/// The state machine.
#[derive(Debug, Clone)]
pub struct Safety {
    state: State,
    limits: Limits,
    times: Timeouts,
    gain: f64,
    /// Joint angles of the level pose (rad), in the turn in which the joints were measured.
    level: [f64; 2],
    /// None while nothing is commanded.
    points: Option<[SetPoint; 2]>,
    /// Start of the time without a target, and of the time with joints too far from their set points.
    no_target: Option<f64>,
    astray: Option<f64>,
    /// Whether the arms follow: false in a dry run.
    follows: bool,
}

impl Safety {
    /// An idle rig; in a dry run its arms receive no commands and need not follow.
    pub fn new(config: &Config, dry_run: bool) -> Self {
        Self {
            state: State::Idle,
            limits: config.limits,
            times: config.timeouts,
            gain: config.backend.gain_per_s,
            level: [config.arms.x.level_rad, config.arms.y.level_rad],
            points: None,
            no_target: None,
            astray: None,
            follows: !dry_run,
        }
    }

    /// State of the arms.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Joint angles of the level pose (rad), in the turn of the joints once they are armed.
    pub fn level(&self) -> [f64; 2] {
        self.level
    }

    /// Limits of a joint.
    pub fn bounds(&self, axis: usize) -> Bounds {
        bounds(&self.limits, self.level[axis])
    }

    /// Whether the set points are at rest at the level pose.
    pub fn is_home(&self) -> bool {
        self.points.is_some_and(|points| {
            let at_level = |(point, level): (&SetPoint, f64)| {
                point.velocity == 0.0 && (point.position - level).abs() < 1e-6
            };
            points.iter().zip(self.level).all(at_level)
        })
    }

    /// Handles an event; events that the state does not allow are ignored.
    ///
    /// # Errors
    /// The reason why arms cannot be taken where they are.
    pub fn handle(&mut self, event: Event) -> Result<(), Reason> {
        match (&self.state, event) {
            (State::Idle, Event::Arm(measured)) => return self.arm(measured),
            (State::Armed | State::Playing | State::Homing, Event::Home) => {
                self.state = State::Homing;
            }
            (State::Armed, Event::Play) => {
                self.no_target = None;
                self.state = State::Playing;
            }
            (State::Armed, Event::Disarm) => {
                self.points = None;
                self.state = State::Idle;
            }
            (State::Idle, Event::Stop(reason)) => self.state = State::Latched(reason),
            (State::Armed | State::Homing | State::Playing, Event::Stop(reason)) => {
                self.state = State::Stopping(reason);
            }
            _ => (),
        }
        Ok(())
    }

    fn arm(&mut self, measured: [f64; 2]) -> Result<(), Reason> {
        for (axis, &measured) in measured.iter().enumerate() {
            if !measured.is_finite() {
                return Err(Reason::JointsLie("an angle that is no number".to_owned()));
            }
            // A continuous wrist may be some full turns away from the configured level pose.
            let turns = ((measured - self.level[axis]) / std::f64::consts::TAU).round();
            self.level[axis] += turns * std::f64::consts::TAU;
            let Bounds { low, high, .. } = self.bounds(axis);
            if !(low..=high).contains(&measured) {
                return Err(Reason::OutsideWindow {
                    axis,
                    by: (low - measured).max(measured - high),
                });
            }
        }
        self.points = Some(measured.map(SetPoint::at));
        self.state = State::Armed;
        Ok(())
    }

    /// One tick of 10 ms: checks the inputs and returns the set points.
    pub fn tick(&mut self, inputs: &Inputs) -> Output {
        if let Some(reason) = self.fault(inputs) {
            let _ = self.handle(Event::Stop(reason));
        }
        let stopped = matches!(self.state, State::Stopping(_) | State::Latched(_));
        let Some(mut points) = self.points else {
            return Output {
                set_points: None,
                stopped,
            };
        };
        let (targets, fastest) = match self.state {
            State::Homing => (Some(self.level), self.limits.home_velocity_rad_s),
            State::Playing => (inputs.target, self.limits.velocity_rad_s),
            State::Armed => (
                Some(points.map(|point| point.position)),
                self.limits.velocity_rad_s,
            ),
            _ => (None, self.limits.velocity_rad_s),
        };
        for (axis, point) in points.iter_mut().enumerate() {
            let bounds = self.bounds(axis);
            let measured = inputs.measured.filter(|_| !stopped).map(|all| all[axis]);
            let target = targets.map(|all| all[axis]);
            *point = point
                .next(target, fastest, &bounds)
                .with_rate(measured, self.gain, &bounds);
        }
        self.points = Some(points);
        let rests = points.iter().all(|point| point.is_at_rest());
        match &self.state {
            State::Stopping(reason) if rests => self.state = State::Latched(reason.clone()),
            State::Homing if self.is_home() => self.state = State::Armed,
            _ => (),
        }
        Output {
            set_points: Some(points),
            stopped,
        }
    }

    /// The fault of a tick, if the arms are moving or held.
    fn fault(&mut self, inputs: &Inputs) -> Option<Reason> {
        if !matches!(self.state, State::Armed | State::Homing | State::Playing) {
            return None;
        }
        let times = self.times;
        if inputs.late_s > times.overrun_s {
            return Some(Reason::Overrun(inputs.late_s));
        }
        if !(inputs.joints_age_s <= times.joints_s) {
            return Some(Reason::JointsSilent(inputs.joints_age_s));
        }
        let Some(measured) = inputs.measured else {
            return Some(Reason::JointsSilent(inputs.joints_age_s));
        };
        for (axis, &measured) in measured.iter().enumerate() {
            let Bounds { low, high, .. } = self.bounds(axis);
            let by = (low - measured).max(measured - high);
            if !(by <= self.limits.tracking_error_rad) {
                return Some(Reason::OutsideWindow { axis, by });
            }
        }
        if let Some(reason) = self.astray(inputs.now, measured) {
            return Some(reason);
        }
        if self.state != State::Playing {
            return None;
        }
        if !(inputs.tracker_age_s <= times.tracker_s) {
            return Some(Reason::TrackerSilent(inputs.tracker_age_s));
        }
        match inputs.target {
            Some(target) if target.iter().all(|angle| angle.is_finite()) => {
                self.no_target = None;
                None
            }
            Some(_) => Some(Reason::CommandRefused),
            None => {
                let since = *self.no_target.get_or_insert(inputs.now);
                let lasts = inputs.now - since;
                (lasts > times.command_s).then_some(Reason::CommandExpired(lasts))
            }
        }
    }

    /// Whether the joints have been too far from their set points for too long.
    fn astray(&mut self, now: f64, measured: [f64; 2]) -> Option<Reason> {
        let points = self.points.into_iter().flatten();
        let worst = points
            .zip(measured)
            .map(|(point, measured)| (point.position - measured).abs())
            .fold(0.0, f64::max);
        if !self.follows || worst <= self.limits.tracking_error_rad {
            self.astray = None;
            return None;
        }
        let since = *self.astray.get_or_insert(now);
        (now - since >= self.times.tracking_error_s).then_some(Reason::TrackingError(worst))
    }
}

/// Limits of a joint with this level pose.
pub fn bounds(limits: &Limits, level: f64) -> Bounds {
    Bounds {
        low: level - limits.window_rad,
        high: level + limits.window_rad,
        velocity: limits.velocity_rad_s,
        acceleration: limits.acceleration_rad_s2,
        step: limits.step_rad.max(TICK_S * 1e-6),
    }
}

#[cfg(test)]
mod exhaustive;
#[cfg(test)]
mod tests;
