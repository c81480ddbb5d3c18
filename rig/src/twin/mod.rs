//! The simulated laboratory: two wrists, a board with a marble, and a camera, with the topics of real ones.

pub mod board;
pub mod lab;
pub mod wrist;

use std::collections::VecDeque;
use std::path::Path;
use std::thread;
use std::time::Duration;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal, Uniform};

use self::board::Board;
use self::wrist::Driver;
use crate::clock::Clock;
use crate::config::{Config, Reliability, Unit};
use crate::dds::{Link, Outlet, Trigger};
use crate::ending::Watch;
use crate::error::{Error, Result};
use crate::messages::{Header, JointState, Point, PointStamped, Time};
use crate::model::Model;
use crate::signals::Signals;
use crate::watch::Moment;

/// Ticks a second: two physics updates of 1/240 s each.
const HZ: u32 = 120;

/// A tick (s).
const TICK_S: f64 = 1.0 / HZ as f64;

/// The laboratory.
struct Twin {
    config: Config,
    wrists: [Driver; 2],
    joint_states: [Outlet<JointState>; 2],
    points: Outlet<PointStamped>,
    stops: Vec<Trigger>,
    board: Board,
    /// Points that have not been sent yet, and when they are due (s).
    on_the_way: VecDeque<(f64, PointStamped)>,
    random: ChaCha8Rng,
}

/// Runs until a signal, or for some seconds; `ready` is called once everything is on the network.
///
/// # Errors
/// [`Error::Refused`] for an invalid model or network.
pub fn run(
    config: &Config,
    model: &Path,
    seed: u64,
    seconds: Option<f64>,
    ready: impl FnOnce(),
) -> Result<()> {
    let signals = Signals::register()?;
    let watch = Watch::start(signals.any(), 0.0, config.safety.memory_mb)?;
    let model = Model::read(model)?;
    let mut link = Link::open(&config.network, "rig_twin")?;
    let [(_, x), (_, y)] = config.arms.both();
    let mut twin = Twin {
        wrists: [
            Driver::open(config, x, &mut link)?,
            Driver::open(config, y, &mut link)?,
        ],
        joint_states: [
            link.publish(&x.joint_states, Reliability::Reliable)?,
            link.publish(&y.joint_states, Reliability::Reliable)?,
        ],
        points: link.publish(&config.tracker.topic, config.tracker.reliability)?,
        stops: config
            .safety
            .call_on_stop
            .iter()
            .map(|name| link.serve(name))
            .collect::<Result<_>>()?,
        board: Board::new(model, config.twin.start, config.twin.hand_s, seed)?,
        on_the_way: VecDeque::new(),
        random: ChaCha8Rng::seed_from_u64(seed),
        config: config.clone(),
    };
    ready();
    let outcome = pace(&signals, &watch, seconds, |tick, now| twin.tick(tick, now));
    watch.leaves(outcome.as_ref().err());
    outcome
}

/// Ticks until a signal, or for some seconds. Physics follows the clock: a late tick is caught up on, with its nominal
/// stamps.
fn pace(
    signals: &Signals,
    watch: &Watch,
    seconds: Option<f64>,
    mut act: impl FnMut(u64, Moment) -> Result<()>,
) -> Result<()> {
    let clock = Clock::new();
    let ticks = seconds.map_or(u64::MAX, |seconds| (seconds * f64::from(HZ)) as u64);
    for tick in 0..ticks {
        let due = tick as f64 * TICK_S;
        let ahead = due - clock.now().steady;
        if ahead > 0.0 {
            thread::sleep(Duration::from_secs_f64(ahead));
        }
        watch.beat();
        if signals.caught().is_some() {
            break;
        }
        let now = clock.now();
        let late = ((now.steady - due) * 1e9) as i64;
        let moment = Moment {
            steady: due,
            nanos: now.nanos - late,
        };
        act(tick, moment)?;
    }
    Ok(())
}

impl Twin {
    fn tick(&mut self, tick: u64, now: Moment) -> Result<()> {
        if self.stops.iter().any(Trigger::asked) {
            self.wrists.iter_mut().for_each(Driver::rest);
        }
        let mut knobs = [0.0; 2];
        for (axis, (_, arm)) in self.config.arms.both().into_iter().enumerate() {
            let wrist = &mut self.wrists[axis];
            let fastest = self.config.twin.velocity_rad_s;
            let angle = wrist.step(now.steady, TICK_S, fastest, self.config.timeouts.command_s);
            knobs[axis] = (angle - arm.level_rad) / arm.gear;
        }
        let before = self.board.seen();
        self.publish_joints(now.nanos)?;
        self.board.tick(knobs)?;
        self.take_pictures(tick, before, now.steady, now.nanos)?;
        while self
            .on_the_way
            .front()
            .is_some_and(|(due, _)| *due <= now.steady)
        {
            if let Some((_, point)) = self.on_the_way.pop_front() {
                self.points.send(point)?;
            }
        }
        Ok(())
    }

    fn publish_joints(&mut self, nanos: i64) -> Result<()> {
        let noise = normal(self.config.twin.joint_noise_rad)?;
        for (axis, (_, arm)) in self.config.arms.both().into_iter().enumerate() {
            let wrist = &self.wrists[axis];
            let state = JointState {
                header: Header {
                    stamp: Time::from_nanos(nanos),
                    frame_id: String::new(),
                },
                name: vec![arm.joint.clone()],
                position: vec![wrist.angle() + noise.sample(&mut self.random)],
                velocity: vec![wrist.rate()],
                effort: vec![0.0],
            };
            self.joint_states[axis].send(state)?;
        }
        Ok(())
    }

    /// Pictures at the beginning of a tick.
    fn take_pictures(
        &mut self,
        tick: u64,
        before: [f64; 2],
        steady: f64,
        nanos: i64,
    ) -> Result<()> {
        let hz = self.config.twin.tracker_hz;
        if hz > HZ {
            let after = self.board.seen();
            let count =
                u64::from(hz) * (tick + 1) / u64::from(HZ) - u64::from(hz) * tick / u64::from(HZ);
            for i in 0..count {
                let part = i as f64 / count as f64;
                let place = [0, 1].map(|axis| before[axis] + part * (after[axis] - before[axis]));
                let on = part * TICK_S;
                self.see(place, steady, nanos + (on * 1e9) as i64)?;
            }
            return Ok(());
        }
        if tick.is_multiple_of(u64::from(HZ / hz)) {
            self.see(before, steady, nanos)?;
        }
        Ok(())
    }

    fn see(&mut self, place: [f64; 2], steady: f64, nanos: i64) -> Result<()> {
        let twin = self.config.twin;
        let noise = normal(twin.noise)?;
        let delay = twin.delay_s + normal(twin.delay_jitter_s)?.sample(&mut self.random);
        let place = place.map(|value| value + noise.sample(&mut self.random));
        let sees = Uniform::new(0.0, 1.0).map_err(|error| Error::Broken(error.to_string()))?;
        let fallen = !place.iter().all(|value| value.is_finite());
        if sees.sample(&mut self.random) < twin.lost || fallen {
            return Ok(());
        }
        let scale = match self.config.tracker.unit {
            Unit::Edges => 1.0,
            Unit::M => self.config.tracker.edge_x_m,
        };
        let point = PointStamped {
            header: Header {
                stamp: Time::from_nanos(nanos),
                frame_id: "board".to_owned(),
            },
            point: Point {
                x: place[0] * scale,
                y: place[1] * scale,
                z: 0.0,
            },
        };
        // One picture does not overtake another.
        let last = self.on_the_way.back().map_or(0.0, |(due, _)| *due);
        self.on_the_way
            .push_back(((steady + delay.max(0.0)).max(last), point));
        Ok(())
    }
}

fn normal(deviation: f64) -> Result<Normal<f64>> {
    Normal::new(0.0, deviation).map_err(|error| Error::Broken(error.to_string()))
}
