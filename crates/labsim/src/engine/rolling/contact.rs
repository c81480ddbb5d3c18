//! What happens to rolling, slipping and hopping marbles within one substep.
//!
//! A solid sphere on a plane has five velocities that matter: of its centre along x and y (`v`), of
//! its surface where it touches the board (`s`: the velocity at which the present spin would be a
//! pure roll), and of its surface about the vertical (`spin`). A push j along the board at the
//! contact changes v by -j and s by 5/2 j, since the moment of inertia is 2/5 m r²; so slip vanishes
//! at j = 2/7 (v - s), and both are then w = (5 v + 2 s)/7, which no contact force changes. Coulomb's
//! law bounds j. Rolling resistance is a torque: it takes min(5/7 μ g h, |w|) from w, so that a
//! marble whose push is below the resistance stays where it is.
//!
//! At a rim the normal velocity is reflected by the restitution, and Coulomb friction acts on the
//! marble's surface there, along the rim and vertically; the vertical part lets the marble hop for
//! some milliseconds, in which the board has no hold of it. What spin is left then slips on the
//! board. A marble that leans on a rim and rolls along it turns on both, so that a push sees
//! 1 + 2/5 + 2/5 of its mass.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use pulp::Simd;

use crate::lanes::{Lanes, Mask};
use crate::motion::{Marbles, Push, Rims};

/// Keeps one over a speed of zero finite; the square of a speed (m/s) far below any that matters.
const TINY: f64 = 1e-280;

/// Each lane takes the cheap way while its marble rolls, and pays for a slip or an impact only then;
/// what its neighbours do decides whether the dear way is computed, never whether it counts.
#[inline(always)]
pub(super) fn substep<S: Simd>(rims: &Rims<S>, marbles: &Marbles<S>, push: &Push<S>) -> Marbles<S> {
    let (next, meets_rim) = roll(rims, marbles, push);
    let slip = (marbles.vx - marbles.sx).abs() + (marbles.vy - marbles.sy).abs();
    let unsettled = (slip + marbles.air + push.excess).gt(slip.like(0.0)) | meets_rim;
    if unsettled.any() {
        Marbles::select(unsettled, &self::slip(rims, marbles, push), &next)
    } else {
        next
    }
}

/// Lanes whose marble lies at a rim and would roll on into it.
#[inline(always)]
fn against<S: Simd>(position: Lanes<S>, velocity: Lanes<S>, reach: Lanes<S>) -> Mask<S> {
    let zero = reach.like(0.0);
    position.ge(reach) & velocity.gt(zero) | position.le(-reach) & velocity.lt(zero)
}

/// A substep of marbles that roll, on the board alone or along a rim; and where one meets a rim.
#[inline(always)]
fn roll<S: Simd>(rims: &Rims<S>, marbles: &Marbles<S>, push: &Push<S>) -> (Marbles<S>, Mask<S>) {
    let zero = push.length.like(0.0);
    let (wx, wy) = rolling_velocity(marbles, push);
    let (held_x, held_y) = (
        against(marbles.x, wx, rims.reach_x),
        against(marbles.y, wy, rims.reach_y),
    );
    let (wx, wy) = (held_x.select(zero, wx), held_y.select(zero, wy));
    let taken = resisted(wx, wy, push.resistance);
    let (mut wx, mut wy) = (wx - taken * wx, wy - taken * wy);
    let mut spin = marbles.spin * push.damping;
    if (held_x | held_y).any() {
        (wy, spin) = turn_on_rim(rims, held_x, push.x, wy, spin);
        let (along, turned) = turn_on_rim(rims, held_y, push.y, wx, -spin);
        (wx, spin) = (held_x.select(zero, along), -turned);
        wy = held_y.select(zero, wy);
    }
    let (x, y) = (marbles.x + wx * push.length, marbles.y + wy * push.length);
    let meets_x = x.abs().ge(rims.reach_x) & !held_x;
    let meets_y = y.abs().ge(rims.reach_y) & !held_y;
    (
        Marbles {
            x,
            y,
            vx: wx,
            vy: wy,
            sx: wx,
            sy: wy,
            spin,
            air: marbles.air,
        },
        meets_x | meets_y,
    )
}

/// Friction of a rim on marbles that lean on it: new velocity along it and spin.
#[inline(always)]
fn turn_on_rim<S: Simd>(
    rims: &Rims<S>,
    held: Mask<S>,
    pressing: Lanes<S>,
    velocity: Lanes<S>,
    spin: Lanes<S>,
) -> (Lanes<S>, Lanes<S>) {
    let zero = spin.like(0.0);
    let spin_there = pressing.gt(zero).select(spin, -spin);
    // Rolling on the board and the rim at once: 5/7 of the impulse and 5/2 of it bring the surface to rest.
    let impulse = (14.0 / 45.0 * (velocity + spin_there)).clamp(rims.friction * pressing.abs());
    let impulse = held.select(impulse, zero);
    let turned = 2.5 * impulse;
    (
        velocity - 5.0 / 7.0 * impulse,
        spin - pressing.gt(zero).select(turned, -turned),
    )
}

/// w = (5 v + 2 s)/7 after the push and damping, before any friction.
#[inline(always)]
fn rolling_velocity<S: Simd>(marbles: &Marbles<S>, push: &Push<S>) -> (Lanes<S>, Lanes<S>) {
    let wx = 5.0 / 7.0 * (marbles.vx + push.x) + 2.0 / 7.0 * marbles.sx;
    let wy = 5.0 / 7.0 * (marbles.vy + push.y) + 2.0 / 7.0 * marbles.sy;
    (wx * push.damping, wy * push.damping)
}

/// The part of a rolling velocity that rolling resistance takes in a substep.
#[inline(always)]
fn resisted<S: Simd>(wx: Lanes<S>, wy: Lanes<S>, resistance: Lanes<S>) -> Lanes<S> {
    resistance.over(length(wx, wy)).min(wx.like(1.0))
}

/// Length of a vector, never quite zero.
#[inline(always)]
fn length<S: Simd>(x: Lanes<S>, y: Lanes<S>) -> Lanes<S> {
    (x * x + y * y + x.like(TINY)).sqrt()
}

/// A substep of marbles that may slip, hop or meet a rim.
#[inline(always)]
fn slip<S: Simd>(rims: &Rims<S>, marbles: &Marbles<S>, push: &Push<S>) -> Marbles<S> {
    let mut next = board_contact(rims, marbles, push);
    let (x, y) = (
        next.x + next.vx * push.length,
        next.y + next.vy * push.length,
    );
    if x.abs().ge(rims.reach_x).any() {
        let Marbles {
            x,
            vx: vn,
            vy: vt,
            sx: sn,
            spin,
            air,
            ..
        } = next;
        let met = meet_rim(
            rims,
            rims.reach_x,
            push,
            &Rim {
                x,
                vn,
                vt,
                sn,
                spin,
                air,
            },
        );
        next = Marbles {
            x: met.x,
            vx: met.vn,
            vy: met.vt,
            sx: met.sn,
            spin: met.spin,
            air: met.air,
            ..next
        };
    }
    if y.abs().ge(rims.reach_y).any() {
        // Seen along y, spin about the vertical moves the rim's side of the marble the other way.
        let Marbles {
            y: x,
            vy: vn,
            vx: vt,
            sy: sn,
            spin,
            air,
            ..
        } = next;
        let met = meet_rim(
            rims,
            rims.reach_y,
            push,
            &Rim {
                x,
                vn,
                vt,
                sn,
                spin: -spin,
                air,
            },
        );
        next = Marbles {
            y: met.x,
            vy: met.vn,
            vx: met.vt,
            sy: met.sn,
            spin: -met.spin,
            air: met.air,
            ..next
        };
    }
    Marbles {
        x: (next.x + next.vx * push.length).clamp(rims.reach_x),
        y: (next.y + next.vy * push.length).clamp(rims.reach_y),
        ..next
    }
}

/// Gravity, friction and rolling resistance of the board.
#[inline(always)]
fn board_contact<S: Simd>(rims: &Rims<S>, marbles: &Marbles<S>, push: &Push<S>) -> Marbles<S> {
    let zero = push.length.like(0.0);
    let held = marbles.air.le(zero);
    let (wx, wy) = rolling_velocity(marbles, push);
    // A rim that holds the marble leaves no rolling against it, neither to resist nor to reach.
    let (held_x, held_y) = (
        against(marbles.x, wx, rims.reach_x),
        against(marbles.y, wy, rims.reach_y),
    );
    let (wx, wy) = (held_x.select(zero, wx), held_y.select(zero, wy));
    let taken = held.select(resisted(wx, wy, push.resistance), zero);
    let (rolled_x, rolled_y) = (wx - taken * wx, wy - taken * wy);

    let spin = marbles.spin * push.damping;
    let (vx, vy) = (
        (marbles.vx + push.x) * push.damping,
        (marbles.vy + push.y) * push.damping,
    );
    let sx = marbles.sx * push.damping - 3.5 * (taken * wx);
    let sy = marbles.sy * push.damping - 3.5 * (taken * wy);
    // Against a rim only the spin has to be stopped: j = 2/5 s there, 2/7 of the slip elsewhere. It
    // presses the marble to the rim, whose friction then acts with that force too.
    let ux = held_x.select(-(1.4 * sx), vx - sx);
    let uy = held_y.select(-(1.4 * sy), vy - sy);
    let limit = 3.5 * push.grip;
    let rolls = held & (ux * ux + uy * uy).le(limit * limit);
    let part = held.select(push.grip, zero).over(length(ux, uy));
    let pressing_x = held_x.select(vx + 0.4 * sx, rolled_x);
    let pressing_y = held_y.select(vy + 0.4 * sy, rolled_y);
    Marbles {
        vx: rolls.select(pressing_x, vx - part * ux),
        vy: rolls.select(pressing_y, vy - part * uy),
        sx: rolls.select(rolled_x, sx + 2.5 * (part * ux)),
        sy: rolls.select(rolled_y, sy + 2.5 * (part * uy)),
        spin,
        air: (marbles.air - push.length).max(zero),
        ..*marbles
    }
}

/// Marbles seen along the axis that two opposite rims bound.
#[derive(Clone, Copy)]
struct Rim<S: Simd> {
    x: Lanes<S>,
    vn: Lanes<S>,
    vt: Lanes<S>,
    sn: Lanes<S>,
    spin: Lanes<S>,
    air: Lanes<S>,
}

/// Impact and friction of the marbles that would pass a rim in this substep.
#[inline(always)]
fn meet_rim<S: Simd>(rims: &Rims<S>, reach: Lanes<S>, push: &Push<S>, rim: &Rim<S>) -> Rim<S> {
    let Rim {
        x,
        vn,
        vt,
        sn,
        spin,
        air,
    } = *rim;
    let (zero, one) = (reach.like(0.0), reach.like(1.0));
    let side = vn.gt(zero).select(one, -one);
    let hits = ((x + vn * push.length) * side).ge(reach);
    // What leans on the rim already is pressed to it and does not bounce.
    let restitution = (x * side).ge(reach).select(zero, rims.restitution);
    let impulse = (one + restitution) * vn.abs();
    // Velocity of the marble's surface where it touches the rim.
    let (along, up) = (vt + side * spin, -(side * sn));
    let part = (rims.friction * impulse).over(length(along, up));
    let part = hits.select(part.min(reach.like(2.0 / 7.0)), zero);
    let (j_along, j_up) = (part * along, part * up);
    // A hop that ends within the substep leaves the board no less hold of the marble.
    let hop = (-2.0 * j_up).over(push.normal);
    Rim {
        x: hits.select(side * reach, x),
        vn: hits.select(-(restitution * vn), vn),
        vt: vt - j_along,
        sn: sn + 2.5 * (side * j_up),
        spin: spin - 2.5 * (side * j_along),
        air: air.max(hop.gt(push.length).select(hop, zero)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::{BOARD_FRICTION, GRAVITY, Rig, SUBSTEP_S};
    use proptest::prelude::*;
    use pulp::Scalar;

    /// Energy over mass (m²/s²): of the motion, and of the spin by its moment of inertia.
    fn energy(marbles: &Marbles<Scalar>) -> f64 {
        let square = |values: Lanes<Scalar>| values.to_array()[0].powi(2);
        let spin = square(marbles.sx) + square(marbles.sy) + square(marbles.spin);
        0.5 * (square(marbles.vx) + square(marbles.vy)) + 0.5 * 0.4 * spin
    }

    proptest! {
        #[test]
        fn energy_never_grows_on_a_level_board(
            place in prop::array::uniform2(-1.0..1.0),
            velocity in prop::array::uniform5(-0.5..0.5),
            restitution in 0.0..1.0, friction in 0.0..1.0, resistance in 0.0..0.002,
        ) {
            let lanes = |value: f64| Lanes::splat(Scalar, value);
            let rig = Rig::default();
            let [reach_x, reach_y] = rig.reach_m();
            let rims = Rims {
                reach_x: lanes(reach_x),
                reach_y: lanes(reach_y),
                restitution: lanes(restitution),
                friction: lanes(friction),
            };
            let (g, h) = (GRAVITY, SUBSTEP_S);
            let push = Push {
                x: lanes(0.0),
                y: lanes(0.0),
                normal: lanes(g),
                resistance: lanes(5.0 / 7.0 * resistance * g * h),
                grip: lanes(BOARD_FRICTION * g * h),
                excess: lanes(0.0),
                damping: lanes(1.0),
                length: lanes(h),
            };
            let [vx, vy, sx, sy, spin] = velocity.map(lanes);
            let [x, y] = [lanes(place[0] * reach_x), lanes(place[1] * reach_y)];
            let mut marbles = Marbles { x, y, vx, vy, sx, sy, spin, air: lanes(0.0) };
            for _ in 0..500 {
                let before = energy(&marbles);
                marbles = substep(&rims, &marbles, &push);
                prop_assert!(energy(&marbles) <= before * (1.0 + 1e-12), "{before} became {}", energy(&marbles));
            }
        }
    }
}
