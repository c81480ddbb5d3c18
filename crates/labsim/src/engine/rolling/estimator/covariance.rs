//! Covariance of a marble's state along one axis, from row to row.

use pulp::Simd;

use super::{JUMP, TAIL};
use crate::lanes::{Lanes, Mask};

/// Observations beyond a wall by more than this many standard deviations are not of the marble.
const FAR: f64 = 3.0;

/// Variance of a place that is known (m²): a nanometre.
const LEAST: f64 = 1e-18;

/// Variances of the random quantities.
pub(super) struct Variances<S: Simd> {
    pub(super) white: Lanes<S>,
    pub(super) lasting: Lanes<S>,
    pub(super) push: Lanes<S>,
    pub(super) pull: Lanes<S>,
    pub(super) restitution: Lanes<S>,
    pub(super) jitter: Lanes<S>,
    pub(super) departure: Lanes<S>,
    pub(super) release: Lanes<S>,
}

/// The covariance of one axis: of place, velocity, push and lasting error.
#[derive(Clone, Copy)]
pub(super) struct Covariance<S: Simd> {
    pub(super) xx: Lanes<S>,
    pub(super) xv: Lanes<S>,
    pub(super) xa: Lanes<S>,
    pub(super) xb: Lanes<S>,
    pub(super) vv: Lanes<S>,
    pub(super) va: Lanes<S>,
    pub(super) vb: Lanes<S>,
    pub(super) aa: Lanes<S>,
    pub(super) ab: Lanes<S>,
    pub(super) bb: Lanes<S>,
}

/// A row between two corrections.
#[derive(Clone, Copy)]
pub(super) struct Row<S: Simd> {
    /// Its duration (s).
    pub(super) seconds: Lanes<S>,
    /// Remaining shares of the lasting error and of the lasting acceleration.
    pub(super) remembered: Lanes<S>,
    pub(super) kept: Lanes<S>,
    /// What the push at its beginning, going over evenly into that at its end, adds to velocity and place.
    pub(super) of_velocity: Lanes<S>,
    pub(super) of_place: Lanes<S>,
}

/// What is seen of a marble along an axis in a row and in the two after it.
pub(super) struct Sight<S: Simd> {
    /// Distance from the prediction, and beyond a wall (board edges).
    pub(super) off: Lanes<S>,
    pub(super) beyond: Lanes<S>,
    /// Time since the row before (s).
    pub(super) seconds: Lanes<S>,
    /// Distances from the prediction in the next rows (board edges; NaN if nothing is seen), and the times until
    /// then (s).
    pub(super) later: [(Lanes<S>, Lanes<S>); 2],
}

impl<S: Simd> Covariance<S> {
    /// Free rolling with random accelerations for a row.
    #[inline(always)]
    pub(super) fn advance(&mut self, row: &Row<S>, variances: &Variances<S>) {
        let Row {
            seconds,
            remembered,
            kept,
            of_velocity,
            of_place,
        } = *row;
        let push = variances.push * seconds;
        let one = remembered.like(1.0);
        // Covariances of the position and the velocity after the row with the state before.
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

    /// A marble that followed a turn of the board early or late by some time has another velocity since: by how much
    /// the board's push has changed (m/s²), and the variance of that time.
    #[inline(always)]
    pub(super) fn kick(&mut self, turned: Lanes<S>, seconds: Lanes<S>, variance: Lanes<S>) {
        let kick = variance * turned * turned;
        self.xx = self.xx + seconds * seconds * kick;
        self.xv = self.xv + seconds * kick;
        self.vv = self.vv + kick;
    }

    /// A marble that friction holds at the end of a row has the velocity that the push gave it in that row, and
    /// nothing of what was unknown about its motion before: else small corrections would never let it rest.
    #[inline(always)]
    pub(super) fn settle(&mut self, rests: Mask<S>, seconds: Lanes<S>, variances: &Variances<S>) {
        let push = variances.push * seconds;
        self.xv = rests.select(0.5 * seconds * push, self.xv);
        self.vv = rests.select(push, self.vv);
        self.va = rests.select(push.like(0.0), self.va);
        self.vb = rests.select(push.like(0.0), self.vb);
    }

    /// Marbles whose place and velocity have these variances and covariance, and depend on nothing else.
    #[inline(always)]
    pub(super) fn place(&mut self, which: Mask<S>, [xx, xv, vv]: [Lanes<S>; 3]) {
        let zero = xx.like(0.0);
        self.xx = which.select(xx, self.xx);
        self.xv = which.select(xv, self.xv);
        self.vv = which.select(vv, self.vv);
        for other in [&mut self.xa, &mut self.xb, &mut self.va, &mut self.vb] {
            *other = which.select(zero, *other);
        }
    }

    /// Where an observation is less likely of a marble that went on than of one of unknown speed.
    #[inline(always)]
    pub(super) fn is_off(
        &self,
        off: Lanes<S>,
        seconds: Lanes<S>,
        edges_per_m: Lanes<S>,
        variances: &Variances<S>,
    ) -> Mask<S> {
        let here = self.seen(edges_per_m) + variances.white;
        let step = edges_per_m * seconds;
        let gone = here + (JUMP * JUMP) * step * step;
        rarity(off, here).gt(rarity(off, gone))
    }

    /// Resets lost marbles among those that are off to an unknown speed, if that is likelier than an outlier of the tracker.
    ///
    /// A marble that just stops, or just does not, or meets a corner, goes two ways from there, and a normal
    /// distribution has one middle; outliers count so little that the mean would never come back. The row alone does not
    /// decide: after an outlier the marble is seen where it would have been, and a lost one goes straight on. What is
    /// seen beyond a wall, by more than errors do, is no marble.
    #[inline(always)]
    pub(super) fn follow(
        &mut self,
        is_off: Mask<S>,
        sight: &Sight<S>,
        edges_per_m: Lanes<S>,
        variances: &Variances<S>,
    ) {
        let Sight {
            off,
            beyond,
            seconds,
            later,
        } = *sight;
        let zero = off.like(0.0);
        let (white, own) = (variances.white, self.seen(edges_per_m));
        let here = own + white;
        let step = edges_per_m * seconds;
        let speed = off.like(JUMP * JUMP);
        let mut stays = rarity(off, here);
        let mut is_lost = rarity(off, here + step * step * speed);
        for (off_later, time) in later {
            let step = edges_per_m * time;
            let share = time.over(seconds);
            let onto = share + share.like(1.0);
            let wider = step * (2.0 * (edges_per_m * self.xv + self.vb) + step * self.vv);
            let straight = onto * onto * white + share * share * own + white;
            let known = !off_later.ne(off_later);
            let one = off.like(1.0);
            stays = stays * known.select(rarity(off_later, here + wider), one);
            is_lost = is_lost * known.select(rarity(off_later - onto * off, straight), one);
        }
        let outside = beyond.gt(zero) & (beyond * beyond).gt(FAR * FAR * here);
        let is_lost = is_off & stays.gt(is_lost);
        let speed = is_lost.select(speed, zero);
        let speed = outside.select(zero, speed);
        self.xx = self.xx + seconds * seconds * speed;
        self.xv = self.xv + seconds * speed;
        self.vv = self.vv + speed;
    }

    /// The upper triangle, row by row.
    #[inline(always)]
    pub(super) fn triangle(&self) -> [Lanes<S>; 10] {
        let Self {
            xx,
            xv,
            xa,
            xb,
            vv,
            va,
            vb,
            aa,
            ab,
            bb,
        } = *self;
        [xx, xv, xa, xb, vv, va, vb, aa, ab, bb]
    }

    /// The variance of the observation without the white error of the row (board edges squared).
    #[inline(always)]
    pub(super) fn seen(&self, edges_per_m: Lanes<S>) -> Lanes<S> {
        edges_per_m * (edges_per_m * self.xx + 2.0 * self.xb) + self.bb
    }

    /// Probability that a place lies beyond a wall which its mean exceeds by `depth` (m): a cubic that is within 0.03 of
    /// the normal distribution function.
    #[inline(always)]
    pub(super) fn beyond(&self, depth: Lanes<S>) -> Lanes<S> {
        let (zero, one) = (depth.like(0.0), depth.like(1.0));
        let deviations = depth.over((self.xx + depth.like(LEAST)).sqrt());
        let part = (0.25 * deviations + depth.like(0.5)).max(zero).min(one);
        part * part * (depth.like(3.0) - 2.0 * part)
    }

    /// A wall that was met at some speed sends back a share of all deviations, and adds one of its own. `hit` is the
    /// probability of this.
    #[inline(always)]
    pub(super) fn bounce(
        &mut self,
        hit: Lanes<S>,
        speed: Lanes<S>,
        restitution: Lanes<S>,
        variances: &Variances<S>,
    ) {
        let one = hit.like(1.0);
        let square = one - hit * (one - restitution * restitution);
        let turned = one - hit * (one + restitution);
        self.xx = square * self.xx;
        self.xv = square * self.xv;
        self.xa = turned * self.xa;
        self.xb = turned * self.xb;
        self.vv = square * self.vv + hit * variances.restitution * speed * speed;
        self.va = turned * self.va;
        self.vb = turned * self.vb;
    }

    /// The friction of a wall that was met changes the velocity along it, by at most so much (m/s) if nothing bounces.
    #[inline(always)]
    pub(super) fn graze(&mut self, hit: Lanes<S>, speed: Lanes<S>, variances: &Variances<S>) {
        self.vv = self.vv + hit * variances.restitution * speed * speed;
    }

    /// Updates with an innovation; returns its variance, the corrections of the states, and the inverse of the
    /// variance with which it counts.
    ///
    /// Outliers count as if the tracker's error had the variance that a Student-t distribution gives them.
    #[inline(always)]
    pub(super) fn update(
        &mut self,
        off: Lanes<S>,
        edges_per_m: Lanes<S>,
        variances: &Variances<S>,
    ) -> (Lanes<S>, [Lanes<S>; 4], Lanes<S>) {
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
        (variance, gain.map(|one| one * off), share)
    }
}

/// The square of the inverse density of Student's t at a distance, but for a constant.
#[inline(always)]
pub(super) fn rarity<S: Simd>(off: Lanes<S>, variance: Lanes<S>) -> Lanes<S> {
    let far = off.like(1.0) + (1.0 / TAIL) * (off * off).over(variance);
    variance * far * far * far * far * far
}
