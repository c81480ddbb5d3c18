//! The profiles of a push, a drag or a gear: shapes over a phase.

use pulp::Simd;

use super::{FORCE, Unlisted};
use crate::lanes::{Lanes, Mask};
use crate::motion::{Marbles, Pair, Push, length};

/// Shapes of a profile over its phase s: the wave cos s, the step tanh s, the bell exp(-s²/2), the ridge
/// -s exp((1-s²)/2), which is its slope and 1 at most, the spot, a bell that is round, the line s, the bowl s²
/// and the saddle, s times what it is across.
const STEP: f64 = 1.0;
const BELL: f64 = 2.0;
const RIDGE: f64 = 3.0;
const SPOT: f64 = 4.0;
const LINE: f64 = 5.0;
const BOWL: f64 = 6.0;
pub(super) const SADDLE: f64 = 7.0;

/// Phase beyond which line, bowl and saddle do not grow: a push that grows with the speed has an end.
const FARTHEST: f64 = 1e3;

/// Scale that makes the ridge's maximum 1: the root of e.
const RIDGE_TOP: f64 = 1.648_721_270_700_128_2;

#[derive(Clone)]
pub(super) struct Profile<S: Simd> {
    shape: Shapes<S>,
    pub(super) push: Pair<S>,
    /// Its contribution to the drag, as `Law::most`; none if it is zero in all lanes.
    pub(super) brake: Option<Lanes<S>>,
    /// Its relative contribution to the gears about x and y; none if it is zero in all lanes.
    pub(super) gear: Option<Pair<S>>,
    /// Radians per metre along x and y.
    vector: Pair<S>,
    /// Radians per m/s along x and y, for the direction of motion, and per radian about x and y; none if zero in all
    /// lanes.
    swift: Option<Pair<S>>,
    heading: Option<Pair<S>>,
    tilt: Option<Pair<S>>,
    rate: Lanes<S>,
    /// Radians per metre of the path; none if zero in all lanes.
    pub(super) way: Option<Lanes<S>>,
    phase: Lanes<S>,
    across: Lanes<S>,
}

/// The lanes of each shape; none where no lane has it.
#[derive(Clone)]
struct Shapes<S: Simd> {
    step: Option<Mask<S>>,
    bell: Option<Mask<S>>,
    ridge: Option<Mask<S>>,
    spot: Option<Mask<S>>,
    line: Option<Mask<S>>,
    bowl: Option<Mask<S>>,
    saddle: Option<Mask<S>>,
    is_wave: bool,
}

impl<S: Simd> Profile<S> {
    /// `growth` is the ratio of the drag at `FASTEST` to that at 0.1 m/s.
    pub(super) fn new(values: &[Lanes<S>], growth: Lanes<S>) -> Self {
        let zero = growth.like(0.0);
        let used = |pair: Pair<S>| (pair[0].ne(zero) | pair[1].ne(zero)).any().then_some(pair);
        Self {
            shape: Shapes::new(values[0].round()),
            push: [values[1], values[2]],
            brake: values[3].ne(zero).any().then(|| values[3] * growth),
            gear: used([values[4], values[5]]),
            vector: [values[6], values[7]],
            swift: used([values[8], values[9]]),
            heading: used([values[10], values[11]]),
            tilt: used([values[12], values[13]]),
            rate: values[14],
            way: values[15].ne(zero).any().then_some(values[15]),
            phase: values[16],
            across: values[17],
        }
    }

    /// Its value for marbles; `now` has the board's angles, the time and the path length.
    #[inline(always)]
    pub(super) fn at(&self, marbles: &Marbles<S>, push: &Push<S>, now: &Unlisted<S>) -> Lanes<S> {
        let [kx, ky] = self.vector;
        let mut angle = kx * marbles.x + ky * marbles.y;
        let mut across = kx * marbles.y - ky * marbles.x + self.across;
        if let Some(swift) = self.swift {
            let [wx, wy] = marbles.rolling();
            angle = angle + swift[0] * wx + swift[1] * wy;
        }
        if let Some(by) = self.heading {
            // A resting marble has the direction in which the push would set it going.
            let [wx, wy] = marbles.rolling();
            let (wx, wy) = (wx + 1.0 / FORCE * push.x, wy + 1.0 / FORCE * push.y);
            angle = angle + (by[0] * wx + by[1] * wy).over(length(wx, wy));
        }
        if let (Some(by), Some(tilt)) = (self.tilt, now.tilt) {
            angle = angle + by[0] * tilt[0] + by[1] * tilt[1];
            across = across + by[0] * tilt[1] - by[1] * tilt[0];
        }
        if let (Some(by), Some(way)) = (self.way, now.way) {
            angle = angle + by * way;
        }
        let angle = angle + self.rate * now.time + self.phase;
        self.shape.of(angle, across)
    }
}

impl<S: Simd> Shapes<S> {
    fn new(shape: Lanes<S>) -> Self {
        let of = |code: f64| {
            let own = !shape.ne(shape.like(code));
            own.any().then_some(own)
        };
        Self {
            step: of(STEP),
            bell: of(BELL),
            ridge: of(RIDGE),
            spot: of(SPOT),
            line: of(LINE),
            bowl: of(BOWL),
            saddle: of(SADDLE),
            is_wave: shape.lt(shape.like(0.5)).any(),
        }
    }

    /// The value at a phase; `across` is the phase of a spot or a saddle in the other direction.
    #[inline(always)]
    fn of(&self, angle: Lanes<S>, across: Lanes<S>) -> Lanes<S> {
        let one = angle.like(1.0);
        let mut value = if self.is_wave { angle.cos() } else { one };
        if let Some(own) = self.step {
            let fallen = (-2.0 * angle.abs()).exp_decay();
            let high = (one - fallen).over(one + fallen);
            let step = angle.lt(angle.like(0.0)).select(-high, high);
            value = own.select(step, value);
        }
        if self.line.is_some() || self.bowl.is_some() || self.saddle.is_some() {
            let farthest = angle.like(FARTHEST);
            let (angle, across) = (angle.clamp(farthest), across.clamp(farthest));
            if let Some(own) = self.line {
                value = own.select(angle, value);
            }
            if let Some(own) = self.bowl {
                value = own.select(angle * angle, value);
            }
            if let Some(own) = self.saddle {
                value = own.select(angle * across, value);
            }
        }
        if self.bell.is_some() || self.ridge.is_some() || self.spot.is_some() {
            let square = -0.5 * (angle * angle);
            if let Some(own) = self.bell {
                value = own.select(square.exp_decay(), value);
            }
            if let Some(own) = self.ridge {
                value = own.select(RIDGE_TOP * (-angle * square.exp_decay()), value);
            }
            if let Some(own) = self.spot {
                value = own.select((square - 0.5 * (across * across)).exp_decay(), value);
            }
        }
        value
    }
}
