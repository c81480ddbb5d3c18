//! Forces on a marble that touches the rim.

use pulp::Simd;

use super::FORCE;
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Pair, Push, length};

/// Distance from the rim (m) at which a marble begins to touch it: more than a marble at the rim moves when a filter
/// corrects it, and less than a tracker sees.
const CONTACT_M: f64 = 2e-4;

#[derive(Clone)]
pub(super) struct Rim<S: Simd> {
    /// Farthest place of a marble's centre along x and y (m).
    reach: Pair<S>,
    /// Acceleration away from the rim that it holds back (m/s²).
    hold: Lanes<S>,
    /// Deceleration at any speed (m/s²), and for each m/s (1/s).
    brake: Lanes<S>,
    drag: Lanes<S>,
}

impl<S: Simd> Rim<S> {
    pub(super) fn new(rig: &Rig, sizes: [Lanes<S>; 3]) -> Self {
        let [hold, brake, drag] = sizes.map(|size| size.max(size.like(0.0)));
        Self {
            reach: rig.reach_m().map(|reach| hold.like(reach)),
            hold,
            brake,
            drag,
        }
    }

    /// Adds to a push (m/s) what holds the marbles at the rim, and to their resistance what brakes them there.
    #[inline(always)]
    pub(super) fn act(&self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let touch = [
            touching(marbles.x, self.reach[0]),
            touching(marbles.y, self.reach[1]),
        ];
        let most = (FORCE * push.length) * self.hold;
        push.x = held(push.x, marbles.x, most * touch[0]);
        push.y = held(push.y, marbles.y, most * touch[1]);
        let [wx, wy] = marbles.rolling();
        let speed = length(wx + 1.0 / FORCE * push.x, wy + 1.0 / FORCE * push.y);
        let part = touch[0].max(touch[1]) * push.length;
        let dragged = part * self.drag;
        let slows = part * self.brake + (speed * dragged).over(dragged + speed.like(1.0));
        push.resistance = push.resistance + slows;
    }
}

/// How far marbles at a place (m) touch the rim, from 0 to 1.
#[inline(always)]
fn touching<S: Simd>(place: Lanes<S>, reach: Lanes<S>) -> Lanes<S> {
    let (zero, one) = (reach.like(0.0), reach.like(1.0));
    ((1.0 / CONTACT_M) * (place.abs() - reach) + one)
        .max(zero)
        .min(one)
}

/// A push without the part of it that leads away from the rim, up to `most`.
#[inline(always)]
fn held<S: Simd>(push: Lanes<S>, place: Lanes<S>, most: Lanes<S>) -> Lanes<S> {
    let zero = push.like(0.0);
    let side = place.gt(zero).select(push.like(1.0), push.like(-1.0));
    let away = (-(side * push)).max(zero);
    push + side * away.min(most)
}
