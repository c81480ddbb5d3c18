//! The machine on a coarse grid, what may happen to it in a tick, the rules of a tick, and faults to plant.

use std::f64::consts::TAU;

use super::super::*;

/// Joint angles of a grid: a stop from full speed takes two ticks, and a window is five steps wide in either direction.
const UNIT: f64 = 0.001;
const CELL: f64 = 2.5 * UNIT;
pub const WINDOW: f64 = 5.0 * UNIT;
pub const FASTEST: f64 = 0.2;
/// What a tick may change of a rate.
const SLOWED: f64 = FASTEST / 2.0;

fn config() -> Config {
    let mut config: Config = toml::from_str(crate::config::EXAMPLE).expect("the example is right");
    config.limits = Limits {
        window_rad: WINDOW,
        velocity_rad_s: FASTEST,
        acceleration_rad_s2: SLOWED / TICK_S,
        step_rad: 2.0 * UNIT,
        tracking_error_rad: 2.0 * UNIT,
        home_velocity_rad_s: SLOWED,
    };
    config.timeouts.command_s = 2.5 * TICK_S;
    config.timeouts.tracking_error_s = 1.5 * TICK_S;
    config.backend.gain_per_s = 20.0;
    config
}

/// A mistake in the machine, which the search has to find.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Planted {
    Nothing,
    HomeWhileStopping,
    ArmAfterStop,
    DisarmAfterStop,
    PlayUnarmed,
    StopUnheardWhileHoming,
    NanAgeIsFresh,
    CommandNeverExpires,
    RampDoesNotSlowDown,
    LatchedWhileMoving,
    LatchedArmsDrift,
    LaterReasonWins,
}

/// Where the joints are measured.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Joints {
    Follow,
    Astray,
    Outside,
    Nan,
    Missing,
}

/// The inputs of a tick.
#[derive(Debug, Clone)]
pub struct Tick {
    event: Option<Event>,
    target: Option<[f64; 2]>,
    joints: Joints,
    joints_age_s: f64,
    tracker_age_s: f64,
    late_s: f64,
}

impl Tick {
    /// Whether it must stop arms that move or are held, in this state, whichever came before.
    fn is_fault(&self, playing: bool) -> bool {
        let bad_target = self
            .target
            .is_some_and(|target| !target.iter().all(|angle| angle.is_finite()));
        let is_old = |age: f64, most: f64| !(age <= most);
        let times = Timeouts::default();
        matches!(self.joints, Joints::Outside | Joints::Nan | Joints::Missing)
            || is_old(self.joints_age_s, times.joints_s)
            || is_old(self.late_s, times.overrun_s)
            || (playing && (bad_target || is_old(self.tracker_age_s, times.tracker_s)))
    }
}

fn healthy(target: [f64; 2]) -> Tick {
    Tick {
        event: None,
        target: Some(target),
        joints: Joints::Follow,
        joints_age_s: 0.01,
        tracker_age_s: 0.03,
        late_s: 0.0,
    }
}

/// Each event with each of: good inputs that lead to different places, and single faults.
pub fn inputs() -> Vec<Tick> {
    let far = 9.0 * UNIT;
    let base = healthy([far, -far]);
    let ticks = [
        healthy([far, far]),
        healthy([-far, far]),
        healthy([0.0, 0.0]),
        base.clone(),
        Tick {
            target: None,
            ..base.clone()
        },
        Tick {
            target: Some([f64::NAN, 0.0]),
            ..base.clone()
        },
        Tick {
            joints: Joints::Astray,
            ..base.clone()
        },
        Tick {
            joints: Joints::Outside,
            ..base.clone()
        },
        Tick {
            joints: Joints::Nan,
            ..base.clone()
        },
        Tick {
            joints: Joints::Missing,
            ..base.clone()
        },
        Tick {
            joints_age_s: 0.2,
            ..base.clone()
        },
        Tick {
            joints_age_s: f64::NAN,
            ..base.clone()
        },
        Tick {
            tracker_age_s: 0.5,
            ..base.clone()
        },
        Tick {
            tracker_age_s: f64::NAN,
            ..base.clone()
        },
        Tick {
            late_s: 0.1,
            ..base
        },
    ];
    let events = [
        None,
        Some(Event::Arm([0.0, 0.0])),
        Some(Event::Arm([2.0 * UNIT, TAU])),
        Some(Event::Arm([0.0, 3.0])),
        Some(Event::Arm([f64::NAN, 0.0])),
        Some(Event::Home),
        Some(Event::Play),
        Some(Event::Disarm),
        Some(Event::Stop(Reason::Signal("SIGINT"))),
    ];
    let with = |event: &Option<Event>| {
        ticks.clone().map(|tick| Tick {
            event: event.clone(),
            ..tick
        })
    };
    events.iter().flat_map(with).collect()
}

/// The machine, its planted fault, and what the rules ask about its past.
#[derive(Debug, Clone)]
pub struct Machine {
    pub safety: Safety,
    planted: Planted,
    /// Whether it was armed since it last was idle or stopped.
    pub armed: bool,
    /// Ticks in a row in which a file was played without a target.
    silent: usize,
    /// Ticks in a row in which the joints were too far from their set points.
    astray: usize,
}

impl Machine {
    pub fn new(planted: Planted) -> Self {
        Self {
            safety: Safety::new(&config(), false),
            planted,
            armed: false,
            silent: 0,
            astray: 0,
        }
    }

    /// What the machine does with an event, but for the planted fault.
    fn handle(&mut self, event: Event) {
        let safety = &mut self.safety;
        let stopped = matches!(safety.state, State::Stopping(_) | State::Latched(_));
        match (self.planted, &event) {
            (Planted::HomeWhileStopping, Event::Home)
                if matches!(safety.state, State::Stopping(_)) =>
            {
                safety.state = State::Homing;
            }
            (Planted::ArmAfterStop, Event::Arm(_)) if stopped => safety.state = State::Armed,
            (Planted::DisarmAfterStop, Event::Disarm) if stopped => {
                (safety.state, safety.points) = (State::Idle, None);
            }
            (Planted::PlayUnarmed, Event::Play) if safety.state == State::Idle => {
                (safety.state, safety.points) = (State::Playing, Some([SetPoint::at(0.0); 2]));
            }
            (Planted::StopUnheardWhileHoming, Event::Stop(_)) if safety.state == State::Homing => {}
            (Planted::LaterReasonWins, Event::Stop(reason)) if stopped => {
                safety.state = State::Latched(reason.clone());
            }
            _ => {
                let is_idle = safety.state == State::Idle;
                let is_arm = matches!(event, Event::Arm(_));
                let taken = safety.handle(event).is_ok();
                self.armed |= is_idle && is_arm && taken;
            }
        }
    }

    fn tick(&mut self, tick: &Tick) -> Output {
        let before = self.safety.points;
        let mut inputs = self.inputs(tick);
        match self.planted {
            Planted::NanAgeIsFresh if inputs.tracker_age_s.is_nan() => inputs.tracker_age_s = 0.0,
            Planted::CommandNeverExpires => self.safety.no_target = None,
            _ => (),
        }
        let mut output = self.safety.tick(&inputs);
        let stopping = matches!(self.safety.state, State::Stopping(_));
        match (self.planted, &self.safety.state) {
            (Planted::RampDoesNotSlowDown, _) if stopping => {
                (self.safety.points, output.set_points) = (before, before);
            }
            (Planted::LatchedWhileMoving, State::Stopping(reason)) => {
                self.safety.state = State::Latched(reason.clone());
            }
            (Planted::LatchedArmsDrift, State::Latched(_)) => {
                if let Some(points) = &mut self.safety.points {
                    points[0].position *= 0.5;
                }
                output.set_points = self.safety.points;
            }
            _ => (),
        }
        output
    }

    fn inputs(&self, tick: &Tick) -> Inputs {
        let level = self.safety.level;
        let at = self
            .safety
            .points
            .map_or(level, |points| points.map(|one| one.position));
        let measured = match tick.joints {
            Joints::Follow => Some(at),
            // Towards the level pose, so that it is not outside the window.
            Joints::Astray => {
                let way = if at[0] > level[0] {
                    -2.5 * UNIT
                } else {
                    2.5 * UNIT
                };
                Some([at[0] + way, at[1]])
            }
            Joints::Outside => Some([at[0], level[1] + 8.0 * UNIT]),
            Joints::Nan => Some([f64::NAN, at[1]]),
            Joints::Missing => None,
        };
        // The targets are those of the level pose.
        let target = tick
            .target
            .map(|target| [0, 1].map(|axis| level[axis] + target[axis]));
        Inputs {
            now: 0.0,
            target,
            measured,
            joints_age_s: tick.joints_age_s,
            tracker_age_s: tick.tracker_age_s,
            late_s: tick.late_s,
        }
    }

    /// Its abstract state: a tenth of the window for angles, half of what a tick may change for rates, ticks for times.
    pub fn key(&self) -> impl Eq + std::hash::Hash + use<> {
        let Safety {
            state,
            level,
            points,
            no_target,
            astray,
            ..
        } = &self.safety;
        let cell = |value: f64, width: f64| (value / width).round() as i64;
        let points = points.map(|points| {
            [0, 1].map(|axis| {
                let SetPoint {
                    position,
                    velocity,
                    rate,
                } = points[axis];
                let way = cell(position - level[axis], CELL);
                [way, speed_cell(velocity), speed_cell(rate)]
            })
        });
        let ticks = |since: &Option<f64>| since.map(|since| (since / TICK_S).round() as i64);
        let moves = matches!(state, State::Armed | State::Homing | State::Playing);
        let code = match state {
            State::Stopping(reason) | State::Latched(reason) => reason.code(),
            _ => "",
        };
        (
            (
                state.name(),
                code,
                level.map(|angle| cell(angle, TAU)),
                points,
            ),
            (self.armed, self.silent, self.astray),
            // Play begins with no_target anew, and a stop looks at neither.
            ticks(no_target).filter(|_| *state == State::Playing),
            ticks(astray).filter(|_| moves),
        )
    }

    fn speed(&self) -> [f64; 4] {
        let [x, y] = self.safety.points.unwrap_or([SetPoint::at(0.0); 2]);
        [x.velocity, x.rate, y.velocity, y.rate].map(f64::abs)
    }

    /// The next state; time 0 stays the time of the next tick.
    pub fn step(&self, tick: &Tick) -> std::result::Result<Self, String> {
        let mut next = self.clone();
        if let Some(event) = tick.event.clone() {
            next.handle(event);
        }
        let asked = next.safety.state.clone();
        let output = next.tick(tick);
        for since in [&mut next.safety.no_target, &mut next.safety.astray] {
            *since = since.map(|since| since - TICK_S);
        }
        next.armed &= is_moved(&next.safety.state);
        let counted = |yes: bool, ticks: usize| if yes { ticks + 1 } else { 0 };
        let playing = asked == State::Playing;
        let before = if self.safety.state == State::Playing {
            self.silent
        } else {
            0
        };
        next.silent = counted(playing && tick.target.is_none(), before);
        next.astray = counted(
            is_moved(&asked) && tick.joints == Joints::Astray,
            self.astray,
        );
        let must_stop = matches!(tick.event, Some(Event::Stop(_)))
            || is_moved(&asked) && (tick.is_fault(playing) || next.astray > 2)
            || next.silent > 3;
        if is_stopped(&next.safety.state) {
            (next.silent, next.astray) = (0, 0);
        }
        self.rules(&next, must_stop, &output)?;
        Ok(next)
    }

    fn rules(
        &self,
        next: &Self,
        must_stop: bool,
        output: &Output,
    ) -> std::result::Result<(), String> {
        let (before, after) = (&self.safety.state, &next.safety.state);
        let (was, is) = (self.speed(), next.speed());
        let slower = was
            .iter()
            .zip(&is)
            .all(|(was, is)| *is == 0.0 || *is < was - 1e-9);
        let reason = |state: &State| match state {
            State::Stopping(reason) | State::Latched(reason) => Some(reason.clone()),
            _ => None,
        };
        let latched = |state: &State| matches!(state, State::Latched(_));
        let places = |machine: &Self| machine.safety.points.map(|all| all.map(|one| one.position));
        let rules = [
            (
                "nothing leads from a stop to motion",
                !is_stopped(before) || is_stopped(after),
            ),
            (
                "nothing leads from Latched",
                !latched(before) || latched(after),
            ),
            (
                "a stop is a stop at once",
                !must_stop || is_stopped(after) && output.stopped,
            ),
            (
                "a stop keeps its reason",
                !is_stopped(before) || reason(before) == reason(after),
            ),
            (
                "a stop slows down in each tick",
                !is_stopped(before) || slower,
            ),
            (
                "latched arms are at rest",
                !latched(after) || is == [0.0; 4],
            ),
            (
                "latched arms stay where they are",
                !latched(before) || places(self) == places(next),
            ),
            ("only armed arms move", !is_moved(after) || next.armed),
            (
                "idle arms are not commanded",
                *after != State::Idle || output.set_points.is_none(),
            ),
        ];
        match rules.iter().find(|(_, holds)| !holds) {
            Some((rule, _)) => Err(format!("{rule}: {before:?} to {after:?}")),
            None => Ok(()),
        }
    }
}

fn is_stopped(state: &State) -> bool {
    matches!(state, State::Stopping(_) | State::Latched(_))
}

/// Whether the arms move, or may in the next tick.
pub fn is_moved(state: &State) -> bool {
    matches!(state, State::Armed | State::Homing | State::Playing)
}

/// At rest, or up to one or two ticks from rest, in either direction.
fn speed_cell(speed: f64) -> i64 {
    let ticks = (speed.abs() / SLOWED - 1e-9).ceil() as i64;
    if speed < 0.0 { -ticks } else { ticks }
}
