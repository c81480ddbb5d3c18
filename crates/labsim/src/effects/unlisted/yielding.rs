//! A drive that follows late, and yields: it loses a share of the board's angle while it turns fast.

use pulp::Simd;

use crate::lanes::Lanes;
use crate::motion::Pair;

#[derive(Clone)]
pub(super) struct Yielding<S: Simd> {
    /// Time constant (s).
    lag: Lanes<S>,
    /// Share of the angles about x and y that is lost at high rates, and the phase for each rad/s of the bell that is
    /// kept.
    lost: Pair<S>,
    slowness: Pair<S>,
    /// The drive's angles at the end of the last substep (rad); none before the first.
    drive: Option<Pair<S>>,
    /// Mean deviation of the angles from the board's in the last substep (rad).
    pub(super) away: Pair<S>,
}

/// Substep over time constant below which an exponential is dominated by rounding.
const SHORT: f64 = 1e-9;

impl<S: Simd> Yielding<S> {
    pub(super) fn new(lag: Lanes<S>, lost: Pair<S>, slowness: Pair<S>) -> Self {
        Self {
            lag,
            lost,
            slowness,
            drive: None,
            away: [lag.like(0.0); 2],
        }
    }

    #[inline(always)]
    pub(super) fn pass(&mut self, tilt: &Pair<S>, length: Lanes<S>) {
        let (zero, one) = (length.like(0.0), length.like(1.0));
        let follows = self.lag.gt(zero);
        let share = length.over(follows.select(self.lag, one));
        let left = follows.select((-share).exp_decay(), zero);
        let lasts = follows & share.gt(SHORT * one);
        let on_average = lasts.select((one - left).over(lasts.select(share, one)), left);
        let per_second = one.over(lasts.select(length, one));
        // At first the drive is at rest at the board's angles.
        let drive = self.drive.get_or_insert(*tilt);
        for axis in 0..2 {
            let away = drive[axis] - tilt[axis];
            // Without a lag the angles jump, and rest in between.
            let rate = lasts.select(per_second * (away * (left - one)), zero);
            let phase = self.slowness[axis] * rate;
            let kept = one - self.lost[axis] * (one - (-0.5 * (phase * phase)).exp_decay());
            let mean = tilt[axis] + on_average * away;
            self.away[axis] = kept * mean - tilt[axis];
            drive[axis] = tilt[axis] + left * away;
        }
    }
}
