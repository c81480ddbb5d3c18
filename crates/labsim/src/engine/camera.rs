//! The camera: from the marbles' positions to the picture, and back.

use pulp::Simd;

use super::actuation::Actuation;
use super::schedule::{Moment, Schedule, Timeline};
use super::{Job, Setup};
use crate::effects::{Any, Hook};
use crate::lanes::Lanes;
use crate::motion::{Marbles, Pair};

/// Iterations of Newton's method from a picture to a position, with a margin.
const ROUNDS: usize = 8;

/// Tolerance of Newton's method: a distance in the picture (board edges), and a relative one of the velocity.
const MET: f64 = 1e-13;
const MET_VELOCITY: f64 = 1e-8;

/// Step of the camera's slopes (m).
const STEP: f64 = 1e-6;

/// The camera for the rollouts of a register.
pub(super) struct Camera<S: Simd> {
    pub(super) edges_per_m: Lanes<S>,
    effects: Vec<Any<S>>,
    age: Lanes<S>,
    /// Times of pictures, if they are not the beginnings of rows.
    pub(super) schedule: Option<Schedule<S>>,
}

#[expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]
impl<S: Simd> Camera<S> {
    pub(super) fn new<'a, 'b: 'a>(
        simd: S,
        setup: &Setup<'_>,
        actuation: &Actuation<S>,
        job: impl Fn(usize) -> &'a Job<'b>,
    ) -> Self {
        let effects = |places: fn(Hook) -> bool| setup.acting(simd, places, &job);
        let ages = effects(|acts| acts == Hook::OnExposure);
        let zero = Lanes::splat(simd, 0.0);
        let age = ages
            .iter()
            .filter_map(Any::age)
            .fold(zero, |sum, age| sum + age);
        let schedule = (!ages.is_empty()).then(|| {
            let timeline = actuation.timeline(setup, &job);
            let of_lane = |lane: usize| {
                exposures(
                    &timeline,
                    lane,
                    age.to_array()[lane],
                    job(lane).first,
                    setup.rows,
                )
            };
            Schedule::new(simd, (0..S::F64_LANES).map(of_lane).collect())
        });
        Self {
            edges_per_m: Lanes::from_fn(simd, |lane| {
                job(lane).parameters.observation_scale / setup.rig.board.edge_x_m
            }),
            effects: effects(Hook::is_on_picture),
            age,
            schedule,
        }
    }

    /// Positions in the picture (board edges) of marbles at these positions (m) and board angles.
    #[inline(always)]
    pub(super) fn see(&self, place: Pair<S>, tilt: &Pair<S>) -> Pair<S> {
        let mut seen = [place[0] * self.edges_per_m, place[1] * self.edges_per_m];
        for effect in &self.effects {
            effect.see(&mut seen, tilt);
        }
        seen
    }

    /// Whether a picture is due up to this number of substeps of the row.
    #[inline(always)]
    pub(super) fn is_due(&self, substeps: f64) -> bool {
        matches!(&self.schedule, Some(schedule) if schedule.is_due(substeps))
    }

    /// Takes the pictures of a part of a row, from one number of substeps to another, in which the marbles move
    /// at constant velocity; `write` receives lane, row and observed position.
    #[inline(always)]
    pub(super) fn expose(
        &mut self,
        row: usize,
        [begin, end]: [f64; 2],
        [before, after]: [&Marbles<S>; 2],
        actuation: &Actuation<S>,
        mut write: impl FnMut(usize, usize, [f64; 2]),
    ) {
        let Some(mut schedule) = self.schedule.take() else {
            return;
        };
        let length = (end - begin) * actuation.push.length;
        schedule.take(row, end, |lane, picture| {
            let at = (picture.at - begin) / (end - begin);
            let place = [
                between(before.x, after.x, before.vx * length, at),
                between(before.y, after.y, before.vy * length, at),
            ];
            let seen = self.see(place, &actuation.tilt);
            write(
                lane,
                picture.what,
                seen.map(|values| values.to_array()[lane]),
            );
        });
        self.schedule = Some(schedule);
    }

    /// Positions (m) and velocities (m/s) at row 0 of marbles with observed position `start` and observed
    /// `velocity`.
    pub(super) fn place(
        &self,
        start: Pair<S>,
        velocity: Pair<S>,
        tilt: &Pair<S>,
    ) -> (Pair<S>, Pair<S>) {
        let mut place = start.map(|seen| seen.over(self.edges_per_m));
        let mut moves = velocity.map(|seen| seen.over(self.edges_per_m));
        if !self.effects.is_empty() {
            for _ in 0..ROUNDS {
                place = self.nearer(place, start, tilt);
            }
            moves = self.velocity(place, moves, velocity, tilt);
        }
        for (place, &moves) in place.iter_mut().zip(&moves) {
            *place = *place + moves * self.age;
        }
        (place, moves)
    }

    /// An iteration of Newton's method, for lanes that have not converged.
    fn nearer(&self, place: Pair<S>, start: Pair<S>, tilt: &Pair<S>) -> Pair<S> {
        let seen = self.see(place, tilt);
        let miss = [start[0] - seen[0], start[1] - seen[1]];
        let step = solve(self.slopes(place, tilt), miss);
        let missed = (miss[0].abs() + miss[1].abs()).gt(miss[0].like(MET));
        [0, 1].map(|axis| missed.select(place[axis] + step[axis], place[axis]))
    }

    /// Velocity (m/s) of marbles with observed `velocity`; `guess` without effects on the picture.
    fn velocity(
        &self,
        place: Pair<S>,
        guess: Pair<S>,
        velocity: Pair<S>,
        tilt: &Pair<S>,
    ) -> Pair<S> {
        let solved = solve(self.slopes(place, tilt), velocity);
        [0, 1].map(|axis| {
            let apart = (solved[axis] - guess[axis]).abs();
            let plain = apart.le(MET_VELOCITY * (guess[0].abs() + guess[1].abs()));
            plain.select(guess[axis], solved[axis])
        })
    }

    /// Derivatives of the observed position (edges/m): along x, along y.
    fn slopes(&self, [x, y]: Pair<S>, tilt: &Pair<S>) -> [Pair<S>; 2] {
        let step = x.like(STEP);
        let along = |ahead: Pair<S>, behind: Pair<S>| {
            let (ahead, behind) = (self.see(ahead, tilt), self.see(behind, tilt));
            [0, 1].map(|axis| 0.5 / STEP * (ahead[axis] - behind[axis]))
        };
        [
            along([x + step, y], [x - step, y]),
            along([x, y + step], [x, y - step]),
        ]
    }
}

/// Solves a + b: columns `[ax, ay]` and `[bx, by]` of a matrix, and a right-hand side.
fn solve<S: Simd>([[ax, ay], [bx, by]]: [Pair<S>; 2], [x, y]: Pair<S>) -> Pair<S> {
    let determinant = ax * by - bx * ay;
    [
        (x * by - bx * y).over(determinant),
        (ax * y - x * ay).over(determinant),
    ]
}

/// Times of the pictures of a lane's rollout, for the rows after its release.
fn exposures(timeline: &Timeline, lane: usize, age: f64, first: usize, rows: usize) -> Vec<Moment> {
    let moment = |what: usize| {
        let row = first + what;
        let (row, at) = if age > 0.0 {
            timeline.locate(lane, timeline.begins(row, lane) - age, first, row)
        } else {
            (row - 1, timeline.substeps(row - 1))
        };
        Moment { row, at, what }
    };
    (1..rows).map(moment).collect()
}

/// Linear interpolation within a part of a row; before it, extrapolation by the velocity (per part).
#[expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]
#[inline(always)]
fn between<S: Simd>(from: Lanes<S>, to: Lanes<S>, velocity: Lanes<S>, at: f64) -> Lanes<S> {
    if at >= 1.0 {
        to
    } else if at < 0.0 {
        from + at * velocity
    } else {
        from + at * (to - from)
    }
}
