//! An extended Kalman filter in each lane: rows correct the marble by what was seen in them.
//!
//! The mean is the simulated marble itself, with all effects, walls and stops. The covariance goes with a
//! marble that moves freely between two rows and is scaled by the restitution where it has met a wall. Each
//! axis has four states: place x (m), velocity v (m/s), a push that lasts a (m/s²), and the tracker's lasting
//! error b (board edges).

use pulp::{NullaryFnOnce, Simd};

use super::LaneGroup;
use crate::board::GRAVITY;
use crate::engine::{Job, Measured, Sink};
use crate::lanes::{Lanes, Mask};
use crate::motion::{Marbles, Pair, Rims};
use crate::noise::Noise;

/// Degrees of freedom of the Student-t distribution of the tracker's errors: as in least squares
/// ([`crate::fit`]), rows beyond about three standard deviations lose their weight.
pub(crate) const TAIL: f64 = 4.0;

/// Standard deviation of a speed of which nothing is known (m/s): a hundred times what a marble on a board may
/// have, so that a row in which it changes without a reason costs about ten nats.
const JUMP: f64 = 30.0;

/// What a marble that rolls gains by a tilt (m/s² per rad).
const ACCELERATION: f64 = 5.0 / 7.0 * GRAVITY;

/// Speed along either axis below which a marble is at rest (m/s).
const REST: f64 = 1e-6;

/// The filters of a register.
pub(super) struct Estimator<S: Simd> {
    axes: [Covariance<S>; 2],
    /// Means of the tracker's lasting errors (board edges).
    lasting: Pair<S>,
    /// Means of the pushes that last (m/s²).
    pull: Pair<S>,
    /// Whether it is known of the marbles that they rest, if they do: 1 or 0.
    known: Lanes<S>,
    /// The marbles' velocities as the row began (m/s).
    velocity: Pair<S>,
    /// The board's angles as the row began (rad).
    tilt: Pair<S>,
    edges_per_m: Lanes<S>,
    variances: Variances<S>,
    /// The last row: most are as long as the one before.
    row: Option<Row<S>>,
}

/// Variances of the random quantities.
struct Variances<S: Simd> {
    white: Lanes<S>,
    lasting: Lanes<S>,
    push: Lanes<S>,
    pull: Lanes<S>,
    restitution: Lanes<S>,
    jitter: Lanes<S>,
}

/// The covariance of one axis: of place, velocity, push and lasting error.
#[derive(Clone, Copy)]
struct Covariance<S: Simd> {
    xx: Lanes<S>,
    xv: Lanes<S>,
    xa: Lanes<S>,
    xb: Lanes<S>,
    vv: Lanes<S>,
    va: Lanes<S>,
    vb: Lanes<S>,
    aa: Lanes<S>,
    ab: Lanes<S>,
    bb: Lanes<S>,
}

/// A row between two corrections.
#[derive(Clone, Copy)]
struct Row<S: Simd> {
    /// How long it is (s).
    seconds: Lanes<S>,
    /// Shares that the lasting error, and the push that lasts, keep.
    remembered: Lanes<S>,
    kept: Lanes<S>,
    /// What the push at its beginning, going over evenly into that at its end, adds to velocity and place.
    of_velocity: Lanes<S>,
    of_place: Lanes<S>,
}

impl<S: Simd> Estimator<S> {
    /// Filters of marbles that are let go where they were seen; none where nothing was measured.
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
            },
            row: None,
        })
    }

    /// Corrects the marbles by what was seen in a row. In `out` is what the camera was predicted to see; the
    /// tracker's lasting error is added, and the variance of the prediction written beside it.
    pub(super) fn correct(
        &mut self,
        row: usize,
        rims: &Rims<S>,
        marbles: &mut Marbles<S>,
        tilt: &Pair<S>,
        group: LaneGroup<'_, '_>,
        out: &mut [Sink<'_>],
    ) {
        rims.reach_x.simd().vectorize(Correction {
            estimator: self,
            row,
            rims,
            marbles,
            tilt,
            group,
            out,
        });
    }
}

/// One row of all lanes, as a function of its own.
struct Correction<'a, 'b, 'c, 'd, S: Simd> {
    estimator: &'a mut Estimator<S>,
    row: usize,
    rims: &'a Rims<S>,
    marbles: &'a mut Marbles<S>,
    tilt: &'a Pair<S>,
    group: LaneGroup<'b, 'c>,
    out: &'a mut [Sink<'d>],
}

impl<S: Simd> NullaryFnOnce for Correction<'_, '_, '_, '_, S> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            estimator,
            row,
            rims,
            marbles,
            tilt,
            group,
            out,
        } = self;
        let simd = rims.reach_x.simd();
        let of_job = |of: &dyn Fn(&Job<'_>) -> f64| Lanes::from_fn(simd, |lane| of(group.of(lane)));
        let last = row.checked_sub(1).filter(|_| row > group.filler.first);
        let length = |job: &Job<'_>| {
            last.map_or(0.0, |last| {
                let step = job.clock.step(last);
                f64::from(step.substeps) * step.length_s
            })
        };
        let seconds = of_job(&length);
        let share = |lasts: &dyn Fn(&Noise) -> f64| {
            of_job(&|job| {
                let measured = job.measured.as_ref();
                measured.map_or(0.0, |one| libm::exp(-length(job) / lasts(&one.noise)))
            })
        };
        let lasted = match estimator.row {
            Some(row) if row.seconds.to_array() == seconds.to_array() => row,
            _ => {
                let (remembered, kept) = (share(&|one| one.lasting_s), share(&|one| one.pull_s));
                Row {
                    seconds,
                    remembered,
                    kept,
                    of_velocity: 0.5 * seconds * (kept + kept.like(1.0)),
                    of_place: (1.0 / 6.0) * seconds * seconds * (kept + kept.like(2.0)),
                }
            }
        };
        estimator.row = Some(lasted);
        let Row {
            remembered, kept, ..
        } = lasted;
        let still = seconds.like(REST);
        let rests = marbles.vx.abs().lt(still) & marbles.vy.abs().lt(still);
        // Of a marble that was let go at an unknown velocity, nobody knows that it rests before it has moved.
        let [x, y] = estimator.velocity;
        let moved = x.abs().ge(still) | y.abs().ge(still);
        let rests = rests & (moved | estimator.known.gt(still.like(0.0)));
        estimator.known = (rests | moved).select(still.like(1.0), estimator.known);
        let places = [&mut marbles.x, &mut marbles.y];
        let velocities = [&mut marbles.vx, &mut marbles.vy];
        let spins = [&mut marbles.sx, &mut marbles.sy];
        let reaches = [rims.reach_x, rims.reach_y];
        let axes = places.into_iter().zip(velocities).zip(spins).zip(reaches);
        for (axis, (((place, velocity), spin), reach)) in axes.enumerate() {
            let covariance = &mut estimator.axes[axis];
            let before = estimator.velocity[axis];
            let hit = hits(*place, before, *velocity, seconds, reach);
            covariance.advance(&lasted, &estimator.variances);
            // A turn about y pushes along x, a turn about x against y.
            let turned = ACCELERATION * (tilt[1 - axis] - estimator.tilt[1 - axis]);
            covariance.kick(turned, seconds, &estimator.variances);
            covariance.settle(rests, seconds, &estimator.variances);
            covariance.bounce(hit, before, rims.restitution, &estimator.variances);

            let lasting = &mut estimator.lasting[axis];
            *lasting = *lasting * remembered;
            // Friction holds a marble that rests.
            let pull = &mut estimator.pull[axis];
            let acts = rests.select(seconds.like(0.0), *pull);
            *pull = *pull * kept;
            let (moved, faster) = (lasted.of_place * acts, lasted.of_velocity * acts);
            let seen = |lane: usize| {
                out.get(lane)
                    .map_or(0.0, |out| out.marble[row - group.filler.first][axis])
            };
            let predicted = Lanes::from_fn(simd, seen) + estimator.edges_per_m * moved + *lasting;
            // A first row that is the start itself says nothing of it.
            let counts = |one: &Measured<'_>| last.is_some() || one.noise.start_velocity.is_none();
            let measured = of_job(&|job| {
                let measured = job.measured.as_ref().filter(|one| counts(one));
                measured.map_or(f64::NAN, |one| one.observed[row - job.first][axis])
            });
            let off = measured - predicted;
            covariance.follow(off, seconds, estimator.edges_per_m, &estimator.variances);
            let (variance, gain) =
                covariance.update(off, estimator.edges_per_m, &estimator.variances);
            *place = (*place + moved + gain[0]).clamp(reach);
            *velocity = *velocity + faster + gain[1];
            *spin = *spin + faster + gain[1];
            *pull = *pull + gain[2];
            *lasting = *lasting + gain[3];
            estimator.velocity[axis] = *velocity;
            let (predicted, variance) = (predicted.to_array(), variance.to_array());
            for (lane, out) in out.iter_mut().enumerate().take(group.jobs.len()) {
                out.marble[row - group.filler.first][axis] = predicted[lane];
                let is_start = !group.jobs[lane].measured.as_ref().is_some_and(counts);
                out.variance[row - group.filler.first][axis] =
                    if is_start { f64::NAN } else { variance[lane] };
            }
        }
        estimator.tilt = *tilt;
    }
}

/// Whether marbles have met the wall that they moved towards as a row began.
#[inline(always)]
fn hits<S: Simd>(
    place: Lanes<S>,
    before: Lanes<S>,
    after: Lanes<S>,
    seconds: Lanes<S>,
    reach: Lanes<S>,
) -> Mask<S> {
    let zero = place.like(0.0);
    let near = (place.abs() + before.abs() * seconds).ge(reach);
    near & (before * place).gt(zero) & (after * before).le(zero)
}

impl<S: Simd> Covariance<S> {
    /// A marble that is pushed at random rolls freely for a row.
    #[inline(always)]
    fn advance(&mut self, row: &Row<S>, variances: &Variances<S>) {
        let Row {
            seconds,
            remembered,
            kept,
            of_velocity,
            of_place,
        } = *row;
        let push = variances.push * seconds;
        let one = remembered.like(1.0);
        // Covariances of the place and the velocity after the row with what was before.
        let (place_v, place_a, place_b) = (
            self.xv + seconds * self.vv + of_place * self.va,
            self.xa + seconds * self.va + of_place * self.aa,
            self.xb + seconds * self.vb + of_place * self.ab,
        );
        let (velocity_a, velocity_b) = (
            self.va + of_velocity * self.aa,
            self.vb + of_velocity * self.ab,
        );
        let velocity_v = self.vv + of_velocity * self.va;
        let place_x = self.xx + seconds * self.xv + of_place * self.xa;
        self.xx =
            place_x + seconds * place_v + of_place * place_a + 1.0 / 3.0 * seconds * seconds * push;
        self.xv = place_v + of_velocity * place_a + 0.5 * seconds * push;
        self.vv = velocity_v + of_velocity * velocity_a + push;
        self.xa = kept * place_a;
        self.va = kept * velocity_a;
        self.xb = remembered * place_b;
        self.vb = remembered * velocity_b;
        self.ab = kept * remembered * self.ab;
        let square = kept * kept;
        self.aa = square * self.aa + (one - square) * variances.pull;
        let square = remembered * remembered;
        self.bb = square * self.bb + (one - square) * variances.lasting;
    }

    /// A command that came early or late by some time has given the marble another velocity since.
    #[inline(always)]
    fn kick(&mut self, turned: Lanes<S>, seconds: Lanes<S>, variances: &Variances<S>) {
        let kick = variances.jitter * turned * turned;
        self.xx = self.xx + seconds * seconds * kick;
        self.xv = self.xv + seconds * kick;
        self.vv = self.vv + kick;
    }

    /// A marble that friction holds at the end of a row has the velocity that the push gave it in that row, and
    /// nothing of what was unknown about its motion before: else small corrections would never let it rest.
    #[inline(always)]
    fn settle(&mut self, rests: Mask<S>, seconds: Lanes<S>, variances: &Variances<S>) {
        let push = variances.push * seconds;
        self.xv = rests.select(0.5 * seconds * push, self.xv);
        self.vv = rests.select(push, self.vv);
        self.va = rests.select(push.like(0.0), self.va);
        self.vb = rests.select(push.like(0.0), self.vb);
    }

    /// Gives marbles that are lost an unknown speed, where that is likelier than an outlier of the tracker.
    ///
    /// A marble that just stops, or just does not, or meets a corner, goes two ways from there, and a normal
    /// distribution has one middle; outliers count so little that the mean would never come back.
    #[inline(always)]
    fn follow(
        &mut self,
        off: Lanes<S>,
        seconds: Lanes<S>,
        edges_per_m: Lanes<S>,
        variances: &Variances<S>,
    ) {
        let speed = off.like(JUMP * JUMP);
        let here = self.seen(edges_per_m) + variances.white;
        let step = edges_per_m * seconds;
        let gone = here + step * step * speed;
        // Squares of inverse densities of Student's t.
        let rarity = |variance: Lanes<S>| {
            let far = off.like(1.0) + (1.0 / TAIL) * (off * off).over(variance);
            variance * far * far * far * far * far
        };
        let speed = rarity(here).gt(rarity(gone)).select(speed, off.like(0.0));
        self.xx = self.xx + seconds * seconds * speed;
        self.xv = self.xv + seconds * speed;
        self.vv = self.vv + speed;
    }

    /// The variance of what would be seen without the error of the row (board edges squared).
    #[inline(always)]
    fn seen(&self, edges_per_m: Lanes<S>) -> Lanes<S> {
        edges_per_m * (edges_per_m * self.xx + 2.0 * self.xb) + self.bb
    }

    /// A wall that was met at some speed sends back a share of all deviations, and adds one of its own.
    #[inline(always)]
    fn bounce(
        &mut self,
        hit: Mask<S>,
        speed: Lanes<S>,
        restitution: Lanes<S>,
        variances: &Variances<S>,
    ) {
        let square = restitution * restitution;
        let bounced = Self {
            xx: square * self.xx,
            xv: square * self.xv,
            xa: -restitution * self.xa,
            xb: -restitution * self.xb,
            vv: square * self.vv + variances.restitution * speed * speed,
            va: -restitution * self.va,
            vb: -restitution * self.vb,
            ..*self
        };
        self.xx = hit.select(bounced.xx, self.xx);
        self.xv = hit.select(bounced.xv, self.xv);
        self.xa = hit.select(bounced.xa, self.xa);
        self.xb = hit.select(bounced.xb, self.xb);
        self.vv = hit.select(bounced.vv, self.vv);
        self.va = hit.select(bounced.va, self.va);
        self.vb = hit.select(bounced.vb, self.vb);
    }

    /// Takes in how far off a prediction was; returns the variance that it had, and the corrections of the states.
    ///
    /// Outliers count as if the tracker's error had the variance that a Student-t distribution gives them.
    #[inline(always)]
    fn update(
        &mut self,
        off: Lanes<S>,
        edges_per_m: Lanes<S>,
        variances: &Variances<S>,
    ) -> (Lanes<S>, [Lanes<S>; 4]) {
        let zero = off.like(0.0);
        let known = !off.ne(off);
        let off = known.select(off, zero);
        let with = [
            edges_per_m * self.xx + self.xb,
            edges_per_m * self.xv + self.vb,
            edges_per_m * self.xa + self.ab,
            edges_per_m * self.xb + self.bb,
        ];
        let own = self.seen(edges_per_m);
        let variance = own + variances.white;
        let wild =
            off.like(TAIL / (TAIL + 1.0)) + (1.0 / (TAIL + 1.0)) * (off * off).over(variance);
        let counted = own + variances.white * wild.max(off.like(1.0));
        let share = known.select(off.like(1.0).over(counted), zero);
        let gain = with.map(|one| one * share);
        self.xx = self.xx - gain[0] * with[0];
        self.xv = self.xv - gain[0] * with[1];
        self.xa = self.xa - gain[0] * with[2];
        self.xb = self.xb - gain[0] * with[3];
        self.vv = self.vv - gain[1] * with[1];
        self.va = self.va - gain[1] * with[2];
        self.vb = self.vb - gain[1] * with[3];
        self.aa = self.aa - gain[2] * with[2];
        self.ab = self.ab - gain[2] * with[3];
        self.bb = self.bb - gain[3] * with[3];
        (variance, gain.map(|one| one * off))
    }
}
