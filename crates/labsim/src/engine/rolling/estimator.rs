//! An extended Kalman filter in each lane: each row's observation corrects the marble.
//!
//! The mean is the simulated marble itself, with all effects, walls and stops. The covariance goes with a
//! marble that moves freely between two rows and is scaled by the restitution where it has met a wall. Each
//! axis has four states: position x (m), velocity v (m/s), a lasting acceleration a (m/s²), and the tracker's
//! lasting error b (board edges).

mod covariance;
mod rest;

use pulp::{NullaryFnOnce, Simd};

use self::covariance::{Covariance, Row, Sight, Variances};
use self::rest::{Seen, Start, Stop};
use super::{LaneGroup, Register};
use crate::board::GRAVITY;
use crate::correction::Correction;
use crate::engine::{Job, Measured, Sink};
use crate::lanes::{Lanes, Mask};
use crate::motion::{Marbles, Pair, Rims, length};
use crate::noise::Noise;

/// Degrees of freedom of the Student-t distribution of the tracker's errors: as in least squares
/// ([`crate::fit`]), rows beyond about three standard deviations lose their weight.
pub(crate) const TAIL: f64 = 4.0;

/// Standard deviation of an unknown speed (m/s): a hundred times what a marble on a board may
/// have, so that a row in which it changes without a reason costs about ten nats.
const JUMP: f64 = 30.0;

/// Acceleration of a rolling marble per tilt (m/s² per rad).
const ACCELERATION: f64 = 5.0 / 7.0 * GRAVITY;

/// Speed along either axis below which a marble is at rest (m/s).
const REST: f64 = 1e-6;

/// The filters of a register.
pub(super) struct Estimator<S: Simd> {
    axes: [Covariance<S>; 2],
    /// Means of the tracker's lasting errors (board edges).
    lasting: Pair<S>,
    /// Means of the lasting accelerations (m/s²).
    pull: Pair<S>,
    /// Whether the marbles' rest is certain while they rest: 1 or 0.
    known: Lanes<S>,
    /// Whether friction held the marbles at the end of the last row: 1 or 0.
    held: Lanes<S>,
    /// Where the marbles may have stopped while the means went on, or the other way around.
    stop: Stop<S>,
    start: Start<S>,
    /// The marbles' positions and velocities at the beginning of the row (m, m/s).
    place: Pair<S>,
    velocity: Pair<S>,
    /// The board's angles at the beginning of the row (rad).
    tilt: Pair<S>,
    edges_per_m: Lanes<S>,
    variances: Variances<S>,
    /// The last row: most are as long as the one before.
    row: Option<Row<S>>,
}

impl<S: Simd> Estimator<S> {
    /// Filters of marbles that are released at their observed positions; none without measurements.
    pub(super) fn new(
        rims: &Rims<S>,
        edges_per_m: Lanes<S>,
        marbles: &Marbles<S>,
        tilt: &Pair<S>,
        group: LaneGroup<'_, '_>,
    ) -> Option<Self> {
        group.jobs.first()?.measured?;
        let simd = rims.reach_x.simd();
        let square = |size: fn(&Noise) -> f64| {
            Lanes::from_fn(simd, |lane| {
                let measured = group.of(lane).measured.as_ref();
                measured.map_or(0.0, |one| size(&one.noise).powi(2))
            })
        };
        let (white, lasting) = (square(|one| one.white), square(|one| one.lasting));
        let pull = square(|one| one.pull);
        let m_per_edge = edges_per_m.like(1.0).over(edges_per_m);
        let unknown = Lanes::from_fn(simd, |lane| {
            let measured = group.of(lane).measured.as_ref();
            let is_unknown = measured.is_some_and(|one| one.noise.start_velocity.is_some());
            f64::from(u8::from(is_unknown))
        });
        let start = Covariance {
            xx: unknown * (white + lasting) * m_per_edge * m_per_edge,
            xv: white.like(0.0),
            xa: white.like(0.0),
            xb: -unknown * lasting * m_per_edge,
            vv: square(|one| one.start_velocity.unwrap_or(0.0)),
            va: white.like(0.0),
            vb: white.like(0.0),
            aa: pull,
            ab: white.like(0.0),
            bb: lasting,
        };
        Some(Self {
            axes: [start; 2],
            lasting: [white.like(0.0); 2],
            pull: [white.like(0.0); 2],
            known: unknown.like(1.0) - unknown,
            held: white.like(0.0),
            stop: Stop::none([marbles.x, marbles.y]),
            start: Start::none([marbles.x, marbles.y]),
            place: [marbles.x, marbles.y],
            velocity: [marbles.vx, marbles.vy],
            tilt: *tilt,
            edges_per_m,
            variances: Variances {
                white,
                lasting,
                push: square(|one| one.push.sqrt()),
                pull,
                restitution: square(|one| one.restitution),
                jitter: square(|one| one.jitter),
                departure: square(|one| one.departure),
                release: square(|one| one.release),
            },
            row: None,
        })
    }

    /// Corrects the marbles on a board by the observation of a row. `out` holds the predicted observation; the
    /// tracker's lasting error is added to it, and the variance of the prediction is written beside it.
    pub(super) fn correct(
        &mut self,
        row: usize,
        board: &Register<S>,
        marbles: &mut Marbles<S>,
        group: LaneGroup<'_, '_>,
        out: &mut [Sink<'_>],
    ) {
        board.rims.reach_x.simd().vectorize(Taken {
            estimator: self,
            row,
            board,
            marbles,
            group,
            out,
        });
    }
}

impl<S: Simd> Estimator<S> {
    /// A row of so many seconds, by lane the `length` of each job's: often the one before again.
    #[inline(always)]
    fn lasted(
        &mut self,
        seconds: Lanes<S>,
        group: LaneGroup<'_, '_>,
        length: &dyn Fn(&Job<'_>) -> f64,
    ) -> Row<S> {
        if let Some(row) = self.row
            && row.seconds.to_array() == seconds.to_array()
        {
            return row;
        }
        let share = |lasts: &dyn Fn(&Noise) -> f64| {
            Lanes::from_fn(seconds.simd(), |lane| {
                let job = group.of(lane);
                let measured = job.measured.as_ref();
                measured.map_or(0.0, |one| libm::exp(-length(job) / lasts(&one.noise)))
            })
        };
        let (remembered, kept) = (share(&|one| one.lasting_s), share(&|one| one.pull_s));
        let row = Row {
            seconds,
            remembered,
            kept,
            of_velocity: 0.5 * seconds * (kept + kept.like(1.0)),
            of_place: (1.0 / 6.0) * seconds * seconds * (kept + kept.like(2.0)),
        };
        self.row = Some(row);
        row
    }

    /// Marbles that are certainly at rest.
    #[inline(always)]
    fn resting(&mut self, marbles: &Marbles<S>) -> Mask<S> {
        let still = marbles.vx.like(REST);
        let rests = marbles.vx.abs().lt(still) & marbles.vy.abs().lt(still);
        // After a release at an unknown velocity, rest is not certain before the marble has moved.
        let [x, y] = self.velocity;
        let moved = x.abs().ge(still) | y.abs().ge(still);
        let rests = rests & (moved | self.known.gt(still.like(0.0)));
        self.known = (rests | moved).select(still.like(1.0), self.known);
        rests
    }

    /// Lets a row make the marbles uncertain: pushes, turns of the board, rests and releases from them, and walls;
    /// returns by which factors walls are expected to change an additional speed along x and along y.
    #[inline(always)]
    fn grow(&mut self, lasted: &Row<S>, board: &Register<S>, rests: Mask<S>) -> Pair<S> {
        let (rims, tilt, push) = (&board.rims, &board.actuation.tilt, &board.actuation.push);
        let resistance = push.resistance.over(push.length);
        let (seconds, variances) = (lasted.seconds, &self.variances);
        let zero = seconds.like(0.0);
        let at_rim = [
            self.place[0].abs().ge(rims.reach_x),
            self.place[1].abs().ge(rims.reach_y),
        ];
        let freed = self.held.gt(zero) & !rests & !(at_rim[0] | at_rim[1]);
        self.held = rests.select(zero.like(1.0), zero);
        // The share of the last row's push beyond rolling friction, which the marble was held against.
        let held = ACCELERATION * length(self.tilt[0], self.tilt[1]);
        let excess = freed.select((held.like(1.0) - resistance.over(held)).max(zero), zero);
        let mut met = [zero; 2];
        for (axis, reach) in [rims.reach_x, rims.reach_y].into_iter().enumerate() {
            let covariance = &mut self.axes[axis];
            covariance.advance(lasted, variances);
            // A turn about y pushes along x, a turn about x against y.
            let pushes = if axis == 0 {
                ACCELERATION
            } else {
                -ACCELERATION
            };
            let turned = pushes * (tilt[1 - axis] - self.tilt[1 - axis]);
            let place = self.place[axis];
            let leaves = at_rim[axis] & (turned * place).lt(zero);
            let of_time = variances.jitter + leaves.select(variances.departure, zero);
            covariance.kick(turned, seconds, of_time);
            // A marble that breaks away earlier or later gains or misses that excess for as long.
            let missed = pushes * self.tilt[1 - axis] * excess;
            covariance.kick(missed, seconds, variances.release);
            covariance.settle(rests, seconds, variances);
            let velocity = self.velocity[axis];
            let pushed = 0.5 * pushes * (tilt[1 - axis] + self.tilt[1 - axis]);
            let end = place + seconds * (velocity + 0.5 * seconds * pushed);
            let towards = (velocity * place).gt(zero);
            met[axis] = towards.select(covariance.beyond(end.abs() - reach), zero);
        }
        let mut carried = [zero; 2];
        for axis in 0..2 {
            let covariance = &mut self.axes[axis];
            let speed = self.velocity[axis];
            let rebound = rims.restitution.slope_at(speed, met[axis].gt(zero));
            covariance.bounce(met[axis], speed, rebound, variances);
            // Coulomb's law: friction goes with the impulse, and is as uncertain.
            let along = rims.friction * self.velocity[1 - axis];
            covariance.graze(met[1 - axis], along, variances);
            let one = seconds.like(1.0);
            carried[axis] = one - met[axis] * (one + rebound);
        }
        carried
    }
}

/// One row of all lanes, in a separate function.
struct Taken<'a, 'b, 'c, 'd, S: Simd> {
    estimator: &'a mut Estimator<S>,
    row: usize,
    board: &'a Register<S>,
    marbles: &'a mut Marbles<S>,
    group: LaneGroup<'b, 'c>,
    out: &'a mut [Sink<'d>],
}

impl<S: Simd> NullaryFnOnce for Taken<'_, '_, '_, '_, S> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            estimator,
            row,
            board,
            marbles,
            group,
            out,
        } = self;
        let (rims, tilt) = (&board.rims, &board.actuation.tilt);
        let simd = rims.reach_x.simd();
        let edges_per_m = estimator.edges_per_m;
        let of_job = |of: &dyn Fn(&Job<'_>) -> f64| Lanes::from_fn(simd, |lane| of(group.of(lane)));
        let last = row.checked_sub(1).filter(|_| row > group.filler.first);
        let length = |job: &Job<'_>| {
            last.map_or(0.0, |last| {
                let step = job.clock.step(last);
                f64::from(step.substeps) * step.length_s
            })
        };
        let seconds = of_job(&length);
        let lasted = estimator.lasted(seconds, group, &length);
        let rests = estimator.resting(marbles);
        let carried = estimator.grow(&lasted, board, rests);
        estimator.start.advance(seconds);
        let at_rest = estimator.stop.places();
        let places = [&mut marbles.x, &mut marbles.y];
        let velocities = [&mut marbles.vx, &mut marbles.vy];
        let spins = [&mut marbles.sx, &mut marbles.sy];
        let reaches = [rims.reach_x, rims.reach_y];
        let axes = places.into_iter().zip(velocities).zip(spins).zip(reaches);
        for (axis, (((place, velocity), spin), reach)) in axes.enumerate() {
            let covariance = &mut estimator.axes[axis];
            let lasting = &mut estimator.lasting[axis];
            *lasting = *lasting * lasted.remembered;
            // Friction holds a marble that rests.
            let pull = &mut estimator.pull[axis];
            let acts = rests.select(seconds.like(0.0), *pull);
            *pull = *pull * lasted.kept;
            let (moved, faster) = (lasted.of_place * acts, lasted.of_velocity * acts);
            let seen = |lane: usize| {
                out.get(lane)
                    .map_or(0.0, |out| out.marble[row - group.filler.first][axis])
            };
            let predicted = Lanes::from_fn(simd, seen) + edges_per_m * moved + *lasting;
            // A first row that is the start state itself holds no information about it.
            let counts = |one: &Measured<'_>| last.is_some() || one.noise.start_velocity.is_none();
            let measured = of_job(&|job| {
                let measured = job.measured.as_ref().filter(|one| counts(one));
                measured.map_or(f64::NAN, |one| one.observed[row - job.first][axis])
            });
            let off = measured - predicted;
            let is_off = covariance.is_off(off, seconds, edges_per_m, &estimator.variances);
            if is_off.any() {
                let ahead = Ahead {
                    group,
                    row,
                    axis,
                    edges_per_m,
                    reach,
                };
                let motion = [*place + moved, *velocity, estimator.velocity[axis]];
                let sight = ahead.sight(predicted, off, motion, seconds);
                covariance.follow(is_off, &sight, edges_per_m, &estimator.variances);
            }
            let before = *covariance;
            let (variance, gain, weight) =
                covariance.update(off, edges_per_m, &estimator.variances);
            let seen = Seen {
                off,
                variance,
                predicted: *place + moved,
                errors: before.bb + estimator.variances.white,
                edges_per_m,
            };
            estimator.stop.compare(axis, &seen);
            estimator.start.compare(axis, &seen);
            let one = weight.like(1.0);
            let went = [
                estimator.variances.push * seconds,
                (rests | estimator.stop.found()).select(one, one.like(0.0)),
                carried[axis],
                edges_per_m,
            ];
            let known = [*pull, *lasting, off, weight];
            let at = (row - group.filler.first, axis);
            write_down(out, at, &before, known, &lasted, went);
            *place = (*place + moved + gain[0]).clamp(reach);
            *velocity = *velocity + faster + gain[1];
            *spin = *spin + faster + gain[1];
            *pull = *pull + gain[2];
            *lasting = *lasting + gain[3];
            estimator.place[axis] = *place;
            estimator.velocity[axis] = *velocity;
            let is_start = |lane: usize| !group.jobs[lane].measured.as_ref().is_some_and(counts);
            let out = &mut out[..group.jobs.len()];
            write_prediction(out, at, predicted, variance, &is_start);
        }
        estimator.tilt = *tilt;
        estimator.stop.may_last(|| board.holds(at_rest));
        estimator.decide(marbles, rests, seconds);
    }
}

/// The rows after a row, along an axis.
struct Ahead<'a, 'b, S: Simd> {
    group: LaneGroup<'a, 'b>,
    row: usize,
    axis: usize,
    edges_per_m: Lanes<S>,
    reach: Lanes<S>,
}

impl<S: Simd> Ahead<'_, '_, S> {
    /// What is seen in the row and in the next two, beside a marble that goes on: from its place, velocity, and velocity
    /// before the row, which took so many seconds.
    #[inline(always)]
    fn sight(
        &self,
        predicted: Lanes<S>,
        off: Lanes<S>,
        [place, velocity, before]: [Lanes<S>; 3],
        seconds: Lanes<S>,
    ) -> Sight<S> {
        let pushed = (velocity - before).over(seconds);
        let mut time = seconds.like(0.0);
        let later = [1, 2].map(|rows| {
            time = time + self.of(|job| self.duration(job, rows - 1));
            let way = time * (velocity + 0.5 * time * pushed);
            let way = (place + way).clamp(self.reach) - place;
            let seen = self.of(|job| self.observed(job, rows));
            (seen - predicted - self.edges_per_m * way, time)
        });
        let at = place + off.over(self.edges_per_m);
        Sight {
            off,
            beyond: self.edges_per_m * (at.abs() - self.reach),
            seconds,
            later,
        }
    }

    fn of(&self, value: impl Fn(&Job<'_>) -> f64) -> Lanes<S> {
        Lanes::from_fn(self.reach.simd(), |lane| value(self.group.of(lane)))
    }

    /// What is seen some rows later; NaN beyond the recording.
    fn observed(&self, job: &Job<'_>, rows: usize) -> f64 {
        let measured = job.measured.as_ref();
        let seen = measured.and_then(|one| one.observed.get(self.row + rows - job.first));
        seen.map_or(f64::NAN, |seen| seen[self.axis])
    }

    /// Time from the row that is some rows later to the one after it (s); 0 beyond the recording.
    fn duration(&self, job: &Job<'_>, rows: usize) -> f64 {
        let row = self.row + rows;
        let recorded = job.measured.as_ref().map_or(0, |one| one.observed.len());
        if row + 1 - job.first >= recorded {
            return 0.0;
        }
        let step = job.clock.step(row);
        f64::from(step.substeps) * step.length_s
    }
}

/// Writes the predictions of a row along an axis and their variances, which are NaN for start states.
#[inline(always)]
fn write_prediction<S: Simd>(
    out: &mut [Sink<'_>],
    (row, axis): (usize, usize),
    predicted: Lanes<S>,
    variance: Lanes<S>,
    is_start: &dyn Fn(usize) -> bool,
) {
    let (predicted, variance) = (predicted.to_array(), variance.to_array());
    for (lane, out) in out.iter_mut().enumerate() {
        out.marble[row][axis] = predicted[lane];
        out.variance[row][axis] = if is_start(lane) {
            f64::NAN
        } else {
            variance[lane]
        };
    }
}

/// Writes the filter's state along an axis at a row, if requested.
#[inline(always)]
fn write_down<S: Simd>(
    out: &mut [Sink<'_>],
    (row, axis): (usize, usize),
    before: &Covariance<S>,
    [pull, lasting, off, weight]: [Lanes<S>; 4],
    lasted: &Row<S>,
    [push, rests, rebound, edges_per_m]: [Lanes<S>; 4],
) {
    if out.iter().all(|out| out.corrections.is_empty()) {
        return;
    }
    let off = weight.gt(weight.like(0.0)).select(off, weight.like(0.0));
    let covariance = before.triangle().map(Lanes::to_array);
    for (lane, out) in out.iter_mut().enumerate() {
        let at = |one: Lanes<S>| one.to_array()[lane];
        if let Some(known) = out.corrections.get_mut(row) {
            known[axis] = Correction {
                covariance: covariance.map(|one| one[lane]),
                pull: at(pull),
                lasting: at(lasting),
                off: at(off),
                weight: at(weight),
                seconds: at(lasted.seconds),
                remembered: at(lasted.remembered),
                kept: at(lasted.kept),
                push: at(push),
                rests: at(rests),
                rebound: at(rebound),
                edges_per_m: at(edges_per_m),
            };
        }
    }
}
