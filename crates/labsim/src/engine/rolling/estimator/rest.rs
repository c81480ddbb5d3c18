//! Marbles that have stopped while the means went on, and marbles that went on while the means stopped.
//!
//! A marble that just stops at a turn, or just does not, goes two ways from there, and a normal distribution has one
//! middle. A mean that went on does not come back: small corrections never let it rest. And a mean that rests stays at
//! rest, however far the marble has gone. So the rows are compared with a marble that did the other thing in the last row in
//! which this was no likelier, by a cumulative sum of log-likelihood ratios (Page 1954, "Continuous inspection schemes").

use pulp::{NullaryFnOnce, Simd};

use super::super::contact::substep;
use super::super::{Acting, Register};
use super::covariance::rarity;
use super::{ACCELERATION, Estimator};
use crate::lanes::{Lanes, Mask};
use crate::motion::{Marbles, Pair};

/// Odds at which a marble has certainly done the other thing, squared: e^4.6, 99 to 1.
const CERTAIN: f64 = 9.9e3;

/// Smallest acceleration that a marble may have (m/s²).
const LEAST: f64 = 1e-3;

/// An observation along an axis (board edges).
#[derive(Clone, Copy)]
pub(super) struct Seen<S: Simd> {
    /// Distance from the prediction, and its variance.
    pub(super) off: Lanes<S>,
    pub(super) variance: Lanes<S>,
    /// The predicted place (m).
    pub(super) predicted: Lanes<S>,
    /// Variance of the tracker's errors.
    pub(super) errors: Lanes<S>,
    pub(super) edges_per_m: Lanes<S>,
}

impl<S: Simd> Seen<S> {
    /// Square of the odds of another prediction (m) with this variance (board edges squared); 1 if nothing is seen. A
    /// smaller variance counts as that of the prediction, or a marble that is as predicted might have done something else.
    #[inline(always)]
    fn odds(&self, place: Lanes<S>, variance: Lanes<S>) -> Lanes<S> {
        let variance = variance.max(self.variance);
        let odds = rarity(self.off, self.variance).over(rarity(self.beside(place), variance));
        self.is_known().select(odds, odds.like(1.0))
    }

    /// Distance from another predicted place (m).
    #[inline(always)]
    fn beside(&self, place: Lanes<S>) -> Lanes<S> {
        self.off - self.edges_per_m * (place - self.predicted)
    }

    #[inline(always)]
    fn is_known(&self) -> Mask<S> {
        !self.off.ne(self.off)
    }
}

/// Where marbles may have stopped, and how likely this is.
pub(super) struct Stop<S: Simd> {
    /// Means (m) and variances (m²) of the places.
    places: Pair<S>,
    variances: Pair<S>,
    /// Odds that they have stopped, squared.
    odds: Lanes<S>,
    /// Stops that were found in the last row.
    found: Mask<S>,
}

impl<S: Simd> Stop<S> {
    /// No stop yet of marbles at these places.
    pub(super) fn none(places: Pair<S>) -> Self {
        let one = places[0].like(1.0);
        Self {
            places,
            variances: [one.like(0.0); 2],
            odds: one.like(0.0),
            found: one.lt(one),
        }
    }

    /// The places (m) before the observation of a row.
    #[inline(always)]
    pub(super) fn places(&self) -> Pair<S> {
        self.places
    }

    /// Leaves out stops where friction does not hold marbles. Asks only if a stop is likelier than none, because the
    /// answer takes as long as a substep.
    #[inline(always)]
    pub(super) fn may_last(&mut self, holds: impl FnOnce() -> Mask<S>) {
        let one = self.odds.like(1.0);
        if self.odds.gt(one).any() {
            self.odds = holds().select(self.odds, one.like(0.0));
        }
    }

    /// Compares an observation along an axis with a marble that rests.
    #[inline(always)]
    pub(super) fn compare(&mut self, axis: usize, seen: &Seen<S>) {
        let place = &mut self.places[axis];
        let with = seen.edges_per_m * self.variances[axis];
        let whole = seen.edges_per_m * with + seen.errors;
        self.odds = self.odds * seen.odds(*place, whole);
        let (known, zero) = (seen.is_known(), place.like(0.0));
        let gain = known.select(with.over(whole), zero);
        let beside = known.select(seen.beside(*place), zero);
        *place = *place + gain * beside;
        self.variances[axis] = self.variances[axis] - gain * with;
    }

    /// Marbles that have certainly stopped.
    #[inline(always)]
    pub(super) fn is_certain(&self) -> Mask<S> {
        self.odds.gt(self.odds.like(CERTAIN))
    }

    /// Stops that were found in the row before.
    #[inline(always)]
    pub(super) fn found(&self) -> Mask<S> {
        self.found
    }

    /// The place of a stop along an axis (m), and its variance (m²).
    #[inline(always)]
    pub(super) fn place(&self, axis: usize) -> (Lanes<S>, Lanes<S>) {
        (self.places[axis], self.variances[axis])
    }

    /// Begins anew at these places, where no stop is at least as likely as one, or one was found.
    #[inline(always)]
    pub(super) fn begin(&mut self, places: Pair<S>, variances: Pair<S>) {
        let one = self.odds.like(1.0);
        self.found = self.is_certain();
        let again = self.found | !self.odds.gt(one);
        for axis in 0..2 {
            self.places[axis] = again.select(places[axis], self.places[axis]);
            self.variances[axis] = again.select(variances[axis], self.variances[axis]);
        }
        self.odds = again.select(one, self.odds);
    }
}

/// Marbles that may have gone on from rest, each at a constant acceleration, and how likely this is.
pub(super) struct Start<S: Simd> {
    /// Means (m) and variances (m²) of the places of rest, and the time since then (s).
    places: Pair<S>,
    variances: Pair<S>,
    time: Lanes<S>,
    /// Information on the accelerations (s⁴/m²), and this times their means (s²/m).
    known: Pair<S>,
    pulled: Pair<S>,
    /// Odds that they have gone on, squared.
    odds: Lanes<S>,
}

/// State of a marble that has gone on, along an axis.
pub(super) struct Gone<S: Simd> {
    /// Place (m) and velocity (m/s).
    pub(super) place: Lanes<S>,
    pub(super) velocity: Lanes<S>,
    /// Their covariance.
    pub(super) xx: Lanes<S>,
    pub(super) xv: Lanes<S>,
    pub(super) vv: Lanes<S>,
}

impl<S: Simd> Start<S> {
    /// No marble at these places has gone on.
    pub(super) fn none(places: Pair<S>) -> Self {
        let zero = places[0].like(0.0);
        Self {
            places,
            variances: [zero; 2],
            time: zero,
            known: [zero.like(1.0); 2],
            pulled: [zero; 2],
            odds: zero,
        }
    }

    /// A row of so many seconds begins.
    #[inline(always)]
    pub(super) fn advance(&mut self, seconds: Lanes<S>) {
        self.time = self.time + seconds;
    }

    /// Compares an observation along an axis with a marble that has gone on.
    #[inline(always)]
    pub(super) fn compare(&mut self, axis: usize, seen: &Seen<S>) {
        let way = 0.5 * self.time * self.time;
        let with = seen.edges_per_m * way;
        let errors = seen.errors + seen.edges_per_m * seen.edges_per_m * self.variances[axis];
        let (known, pulled) = (&mut self.known[axis], &mut self.pulled[axis]);
        let (mean, variance) = (pulled.over(*known), with.like(1.0).over(*known));
        let place = self.places[axis];
        let odds = seen.odds(place + way * mean, with * with * variance + errors);
        self.odds = self.odds * odds;
        let share = seen.is_known().select(with.over(errors), with.like(0.0));
        *known = *known + share * with;
        *pulled = *pulled + seen.is_known().select(share * seen.beside(place), share);
    }

    /// Which of the resting marbles have certainly gone on.
    #[inline(always)]
    pub(super) fn is_certain(&self, rests: Mask<S>) -> Mask<S> {
        rests & self.odds.gt(self.odds.like(CERTAIN))
    }

    /// The state of a marble that has gone on, along an axis.
    #[inline(always)]
    pub(super) fn state(&self, axis: usize) -> Gone<S> {
        let variance = self.time.like(1.0).over(self.known[axis]);
        let acceleration = self.pulled[axis] * variance;
        let way = 0.5 * self.time * self.time;
        Gone {
            place: self.places[axis] + way * acceleration,
            velocity: self.time * acceleration,
            xx: self.variances[axis] + way * way * variance,
            xv: way * self.time * variance,
            vv: self.time * self.time * variance,
        }
    }

    /// Begins anew where marbles do not rest, or have no more likely gone on, or were found to have: at these places, with
    /// accelerations of this size.
    #[inline(always)]
    pub(super) fn begin(
        &mut self,
        rests: Mask<S>,
        places: Pair<S>,
        variances: Pair<S>,
        sizes: Pair<S>,
    ) {
        let (zero, one) = (self.odds.like(0.0), self.odds.like(1.0));
        let goes_on = rests & self.odds.gt(one) & !self.is_certain(rests);
        for axis in 0..2 {
            self.places[axis] = goes_on.select(self.places[axis], places[axis]);
            self.variances[axis] = goes_on.select(self.variances[axis], variances[axis]);
            let size = sizes[axis] * sizes[axis] + one.like(LEAST * LEAST);
            self.known[axis] = goes_on.select(self.known[axis], one.over(size));
            self.pulled[axis] = goes_on.select(self.pulled[axis], zero);
        }
        self.time = goes_on.select(self.time, zero);
        self.odds = goes_on.select(self.odds, one);
    }
}

impl<S: Simd> Estimator<S> {
    /// Puts marbles to rest that have stopped while their means went on, and sets those in motion that went on while
    /// their means rested.
    #[inline(always)]
    pub(super) fn decide(&mut self, marbles: &mut Marbles<S>, rests: Mask<S>, seconds: Lanes<S>) {
        let (stopped, gone) = (self.stop.is_certain(), self.start.is_certain(rests));
        if (stopped | gone).any() {
            let zero = seconds.like(0.0);
            let places = [&mut marbles.x, &mut marbles.y];
            let velocities = [&mut marbles.vx, &mut marbles.vy];
            let spins = [&mut marbles.sx, &mut marbles.sy];
            let axes = places.into_iter().zip(velocities).zip(spins);
            for (axis, ((place, velocity), spin)) in axes.enumerate() {
                let covariance = &mut self.axes[axis];
                let (at, variance) = self.stop.place(axis);
                *place = stopped.select(at, *place);
                *velocity = stopped.select(zero, *velocity);
                *spin = stopped.select(zero, *spin);
                covariance.place(stopped, [variance, zero, zero]);
                let on = self.start.state(axis);
                *place = gone.select(on.place, *place);
                *velocity = gone.select(on.velocity, *velocity);
                *spin = gone.select(on.velocity, *spin);
                covariance.place(gone, [on.xx, on.xv, on.vv]);
                self.place[axis] = *place;
                self.velocity[axis] = *velocity;
            }
        }
        let variances = [0, 1].map(|axis| self.axes[axis].xx);
        let sizes = [1, 0].map(|about: usize| ACCELERATION * self.tilt[about]);
        self.start.begin(rests, self.place, variances, sizes);
        let spreads = [0, 1].map(|axis| {
            let way = self.velocity[axis] * seconds;
            variances[axis] + 1.0 / 3.0 * way * way
        });
        self.stop.begin(self.place, spreads);
    }
}

impl<S: Simd> Register<S> {
    /// Where friction holds marbles that are at rest at a place (m), as the board lies now.
    pub(super) fn holds(&self, place: Pair<S>) -> Mask<S> {
        let simd = self.rims.reach_x.simd();
        simd.vectorize(Holding { board: self, place })
    }
}

/// The answer of [`Register::holds`], in a separate function.
struct Holding<'a, S: Simd> {
    board: &'a Register<S>,
    place: Pair<S>,
}

impl<S: Simd> NullaryFnOnce for Holding<'_, S> {
    type Output = Mask<S>;

    #[inline(always)]
    fn call(self) -> Mask<S> {
        let rest = Marbles::at_rest(self.place);
        let mut push = self.board.actuation.push;
        if !self.board.forces.is_empty() {
            // Effects with a memory keep it.
            let mut effects = self.board.forces.clone();
            rest.x.simd().vectorize(Acting {
                effects: &mut effects,
                tilt: &self.board.actuation.tilt,
                marbles: &rest,
                push: &mut push,
            });
        }
        let next = substep(&self.board.rims, &rest, &push);
        let zero = next.vx.like(0.0);
        next.vx.abs().le(zero) & next.vy.abs().le(zero)
    }
}
