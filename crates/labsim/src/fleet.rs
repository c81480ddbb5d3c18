//! Many marbles whose commands come one by one, each in an episode of its own: environments to learn in.

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use crate::board::Rig;
use crate::effects::{EffectInstance, EffectSpec, in_order};
use crate::engine::obstacles::Obstacles;
use crate::error::{Error, Result};
use crate::live::{Live, Start, check, setup};
use crate::maze::Maze;
use crate::parameters::Parameters;
use crate::per_rollout::PerRollout;
use crate::scene::{CUT, Scene};
use crate::threads::Threads;

/// Marbles that share board, maze and step length, and are stepped together.
///
/// Each is a [`Live`] of its own, so what it does depends neither on its neighbours nor on the threads.
pub struct Fleet {
    rig: Rig,
    obstacles: Option<Arc<Obstacles>>,
    simulators: Vec<Simulator>,
    marbles: Vec<Option<Episode>>,
    path: Vec<[f64; 2]>,
    tracker: Tracker,
    rows: usize,
    row_s: f64,
}

/// How well marbles are seen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tracker {
    /// Standard deviation of a place, along each axis (board edges).
    pub noise: f64,
    /// Probability that the marble is lost in a row: it stays where it was seen before.
    pub lost: f64,
}

/// A marble on its way.
struct Episode {
    live: Live,
    /// What its tracker draws.
    random: ChaCha8Rng,
    state: State,
}

/// What an episode can be played in.
struct Simulator {
    rig: Rig,
    parameters: Parameters,
    effects: Vec<(&'static EffectSpec, Vec<f64>)>,
}

/// What is known of a marble as a row begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Where the tracker saw it last (board edges).
    pub seen: [f64; 2],
    /// Where it had seen it a row before (board edges).
    pub before: [f64; 2],
    /// The board's angles about x and about y as the tilt sensor reports them (rad).
    pub tilt: [f64; 2],
    /// Where it is (m from the board's centre).
    pub place: [f64; 2],
    /// Through which of [`Maze::holes`] it fell.
    pub hole: Option<usize>,
    /// How far along the path it has come: the number of a point.
    pub passed: usize,
}

impl Fleet {
    /// So many marbles, none of them in an episode yet; episodes have at most `rows` rows of `row_s` seconds.
    /// `path` leads through the maze in points (m from the board's centre), close to each other.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a rig or a maze that no physics allows, episodes without a step, an empty path.
    pub fn new(
        rig: Rig,
        maze: Option<&Maze>,
        path: Vec<[f64; 2]>,
        tracker: Tracker,
        count: usize,
        (rows, row_s): (usize, f64),
    ) -> Result<Self> {
        rig.check()?;
        tracker.check()?;
        if let Some(maze) = maze {
            maze.check(&rig)?;
        }
        if path.is_empty() || !path.as_flattened().iter().all(|one| one.is_finite()) {
            let expected = "at least one point of finite numbers";
            return Err(Error::invalid("path", expected, format!("{path:?}")));
        }
        if rows < 2 {
            return Err(Error::invalid("rows", "at least 2", rows));
        }
        if !(row_s > 0.0 && row_s <= 20.0) {
            return Err(Error::invalid(
                "row_s",
                "a duration above 0, at most 20 s",
                row_s,
            ));
        }
        let obstacles = maze.and_then(|maze| Obstacles::new(maze, &rig));
        Ok(Self {
            rig,
            obstacles: obstacles.map(Arc::new),
            simulators: Vec::new(),
            marbles: std::iter::repeat_with(|| None).take(count).collect(),
            path,
            tracker,
            rows,
            row_s,
        })
    }

    /// Adds a simulator that episodes can be played in, and returns its number.
    ///
    /// # Errors
    /// [`Error::Invalid`] for values that no physics allows, for another board or marble than the fleet's, and
    /// for an effect that would have to know commands to come.
    pub fn add(
        &mut self,
        rig: Rig,
        parameters: Parameters,
        effects: Vec<(&'static EffectSpec, Vec<f64>)>,
    ) -> Result<usize> {
        let shape = |rig: &Rig| [rig.board.edge_x_m, rig.board.edge_y_m, rig.marble.radius_m];
        if shape(&rig) != shape(&self.rig) {
            let expected = format!("edges and a radius of {:?} m", shape(&self.rig));
            return Err(Error::invalid(
                "simulator",
                &expected,
                format!("{:?}", shape(&rig)),
            ));
        }
        let simulator = Simulator {
            rig,
            parameters,
            effects,
        };
        check(
            &simulator.rig,
            None,
            parameters,
            &simulator.instances(),
            [0.0; 2],
            self.row_s,
        )?;
        self.simulators.push(simulator);
        Ok(self.simulators.len() - 1)
    }

    /// Begins an episode of a marble: at rest on a level board, at a place (m from the board's centre) that lies
    /// `passed` points along the path.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a marble, a simulator or a point that is not there, and a place off the board.
    pub fn begin(
        &mut self,
        marble: usize,
        simulator: usize,
        (place, passed): ([f64; 2], usize),
        seed: u64,
    ) -> Result<()> {
        let below = |what: &str, count: usize, number: usize| {
            if number < count {
                return Ok(());
            }
            let expected = format!("a number below {count}");
            Err(Error::invalid(what, &expected, number))
        };
        below("marble", self.marbles.len(), marble)?;
        below("simulator", self.simulators.len(), simulator)?;
        below("passed", self.path.len(), passed)?;
        let simulator = &self.simulators[simulator];
        let [reach_x, reach_y] = self.rig.reach_m();
        if !(place[0].abs() <= reach_x && place[1].abs() <= reach_y) {
            let expected = format!("within {reach_x} and {reach_y} m of the board's centre");
            return Err(Error::invalid(
                "place",
                &expected,
                format!("{} {}", place[0], place[1]),
            ));
        }
        let effects = in_order(&simulator.instances());
        let setup = setup(&simulator.rig, &effects, self.rows, self.obstacles.as_ref());
        let start = Start::Place(place);
        let live = Live::begin(&setup, simulator.parameters, start, self.row_s, seed);
        self.marbles[marble] = Some(Episode::new(live, passed, seed, self.tracker));
        Ok(())
    }

    /// Plays a row of the marbles that are `active`, under a command for each (knob angles, rad), over so many
    /// threads (`None`: one for each core).
    ///
    /// # Errors
    /// [`Error::Invalid`] for other numbers of commands than of marbles, a command that is no number, and an
    /// active marble without an episode, or whose episode is over. Nothing has moved then.
    pub fn play(
        &mut self,
        commands: &[[f64; 2]],
        active: &[bool],
        threads: Option<usize>,
    ) -> Result<()> {
        let count = self.marbles.len();
        for (what, length) in [("commands", commands.len()), ("active", active.len())] {
            if length != count {
                return Err(Error::invalid(what, &format!("{count} of them"), length));
            }
        }
        for (i, (marble, command)) in self.marbles.iter().zip(commands).enumerate() {
            if !active[i] {
                continue;
            }
            if !command.iter().all(|angle| angle.is_finite()) {
                let got = format!("{} {}", command[0], command[1]);
                return Err(Error::invalid(
                    format!("command of marble {i}"),
                    "finite numbers",
                    got,
                ));
            }
            if marble.as_ref().is_none_or(|one| one.live.left() == 0) {
                return Err(Error::invalid(
                    format!("marble {i}"),
                    "one in an episode that is not over",
                    "none",
                ));
            }
        }
        let (path, tracker) = (&self.path, self.tracker);
        let marbles = self.marbles.chunks_mut(TOGETHER);
        let each = marbles.zip(commands.chunks(TOGETHER).zip(active.chunks(TOGETHER)));
        Threads::new(threads)?.each(each.collect(), |(marbles, (commands, active))| {
            for ((episode, &command), &active) in marbles.iter_mut().zip(commands).zip(active) {
                if let Some(episode) = episode.as_mut().filter(|_| active) {
                    episode.play(command, path, tracker);
                }
            }
        });
        Ok(())
    }

    /// Paints what is around each marble into `out`, [`CUT`] squared pixels of each; black of those that have no
    /// episode yet.
    ///
    /// # Errors
    /// [`Error::Invalid`] if `out` is not of that many pixels.
    pub fn pictures(
        &self,
        scene: &Scene,
        out: &mut [[u8; 3]],
        threads: Option<usize>,
    ) -> Result<()> {
        let pixels = CUT * CUT;
        if out.len() != pixels * self.marbles.len() {
            let expected = format!("{} pixels", pixels * self.marbles.len());
            return Err(Error::invalid("pictures", &expected, out.len()));
        }
        let each = self.marbles.iter().zip(out.chunks_exact_mut(pixels));
        Threads::new(threads)?.each(each.collect(), |(episode, out)| {
            let place = episode.as_ref().map(|one| one.state.place);
            scene.cut(place.unwrap_or([f64::NAN; 2]), out);
        });
        Ok(())
    }

    /// What is known of each marble, in order; nothing of those that have no episode yet.
    pub fn states(&self) -> impl ExactSizeIterator<Item = Option<&State>> {
        let each = self.marbles.iter();
        each.map(|one| one.as_ref().map(|one| &one.state))
    }
}

impl Tracker {
    fn check(self) -> Result<()> {
        if !(self.noise >= 0.0 && self.noise.is_finite()) {
            return Err(Error::invalid(
                "noise",
                "a number of at least 0",
                self.noise,
            ));
        }
        if !(0.0..1.0).contains(&self.lost) {
            return Err(Error::invalid("lost", "a probability below 1", self.lost));
        }
        Ok(())
    }

    /// Where a marble is seen; always as an episode begins, when `before` is nothing.
    fn look(self, seen: [f64; 2], before: Option<[f64; 2]>, random: &mut ChaCha8Rng) -> [f64; 2] {
        if self == Self::default() {
            return if seen[0].is_nan() {
                before.unwrap_or(seen)
            } else {
                seen
            };
        }
        let noise = [0, 1].map(|_| {
            let normal: f64 = StandardNormal.sample(random);
            self.noise * normal
        });
        // Of 53 bits, as many as a number from 0 to 1 has.
        let chance = (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        match before {
            Some(before) if chance < self.lost || seen[0].is_nan() => before,
            _ => [seen[0] + noise[0], seen[1] + noise[1]],
        }
    }
}

impl Episode {
    fn new(mut live: Live, passed: usize, seed: u64, tracker: Tracker) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let seen = tracker.look(live.seen(), None, &mut random);
        let state = State {
            seen,
            before: seen,
            tilt: live.tilt(),
            place: live.place(),
            hole: None,
            passed,
        };
        Self {
            live,
            random,
            state,
        }
    }

    fn play(&mut self, command: [f64; 2], path: &[[f64; 2]], tracker: Tracker) {
        let Self {
            live,
            random,
            state,
        } = self;
        let seen = live.play(command);
        let place = live.place();
        *state = State {
            seen: tracker.look(seen, Some(state.seen), random),
            before: state.seen,
            tilt: live.tilt(),
            place,
            hole: live.fall().map(|fall| fall.hole),
            passed: passed(path, place, state.passed),
        };
    }
}

/// The point of a path to which a marble has come that was at another a row before: the nearest one around, unless it has
/// left the path.
fn passed(path: &[[f64; 2]], place: [f64; 2], before: usize) -> usize {
    let around = before.saturating_sub(AROUND)..path.len().min(before + AROUND + 1);
    let far = |[x, y]: [f64; 2]| (x - place[0]).powi(2) + (y - place[1]).powi(2);
    let (mut nearest, mut least) = (before, OFF_PATH_M.powi(2));
    for i in around {
        let distance = far(path[i]);
        if distance < least {
            (nearest, least) = (i, distance);
        }
    }
    nearest
}

/// How many points of a path a marble may pass in a row, either way.
const AROUND: usize = 30;

/// How far from its path a marble still makes progress (m): about half a corridor.
const OFF_PATH_M: f64 = 0.02;

/// Marbles that a thread steps together: fewer take less time than another thread needs to begin.
const TOGETHER: usize = 64;

impl Simulator {
    fn instances(&self) -> Vec<EffectInstance<'_>> {
        let each = self.effects.iter();
        each.map(|(effect, values)| EffectInstance {
            effect,
            values: PerRollout::Shared(values),
        })
        .collect()
    }
}
