//! Contact of rolling and slipping marbles with board and rims within one substep.
//!
//! A solid sphere on a plane has five velocities that matter: of its centre along x and y (`v`), of
//! its surface where it touches the board (`s`: the velocity at which the present spin would be a
//! pure roll), and of its surface about the vertical (`spin`). A push j along the board at the
//! contact changes v by -j and s by 5/2 j, since the moment of inertia is 2/5 m r²; so slip vanishes
//! at j = 2/7 (v - s), and both are then w = (5 v + 2 s)/7, which no contact force changes. Coulomb's
//! law bounds j. Rolling resistance is a torque: it takes min(5/7 μ g h, |w|) from w, so that a
//! marble whose push is below the resistance stays where it is.
//!
//! A marble that leans on a rim and rolls along it turns on both, so that a push sees 1 + 2/5 + 2/5
//! of its mass. How it gets there is in [`super::impact`].

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use pulp::Simd;

use super::impact::impact;
use crate::lanes::{Lanes, Mask};
use crate::motion::{Marbles, Push, Rims, length};

/// Slips and impacts are computed only in substeps in which some lane has one. The other lanes discard the
/// result, so a lane never depends on its neighbours.
#[inline(always)]
pub(super) fn substep<S: Simd>(rims: &Rims<S>, marbles: &Marbles<S>, push: &Push<S>) -> Marbles<S> {
    let zero = push.length.like(0.0);
    let slip_x = marbles.vx - marbles.sx + push.x;
    let slip_y = marbles.vy - marbles.sy + push.y;
    let needed = 2.0 / 7.0 * (slip_x.abs() + slip_y.abs()) + push.resistance;
    let (rolled, climbs) = roll(rims, marbles, push);
    let loose = needed.gt(push.grip) | marbles.air.gt(zero) | climbs;
    let next = advance(&rolled, push.length);
    let meets = next.x.abs().gt(rims.reach_x) | next.y.abs().gt(rims.reach_y);
    if (loose | meets).any() {
        let mut moving = rolled;
        if loose.any() {
            moving = Marbles::select(loose, &board_contact(rims, marbles, push), &rolled);
        }
        Marbles::select(loose | meets, &impact(rims, &moving, push), &next)
    } else {
        next
    }
}

/// Moves the marbles by their velocities.
#[inline(always)]
fn advance<S: Simd>(marbles: &Marbles<S>, length: Lanes<S>) -> Marbles<S> {
    Marbles {
        x: marbles.x + marbles.vx * length,
        y: marbles.y + marbles.vy * length,
        ..*marbles
    }
}

/// Lanes whose marble lies at a rim and would roll on into it.
#[inline(always)]
fn against<S: Simd>(position: Lanes<S>, velocity: Lanes<S>, reach: Lanes<S>) -> Mask<S> {
    position.abs().ge(reach) & (position * velocity).gt(reach.like(0.0))
}

/// Velocities of marbles that roll, on the board alone or along a rim; and which of them have yet to
/// lose a spin against the rim that holds them.
#[inline(always)]
fn roll<S: Simd>(rims: &Rims<S>, marbles: &Marbles<S>, push: &Push<S>) -> (Marbles<S>, Mask<S>) {
    let zero = push.length.like(0.0);
    let (wx, wy) = rolling_velocity(marbles, push);
    let spin = spun(marbles.spin, push);
    let rolling = |wx, wy, spin| Marbles {
        vx: wx,
        vy: wy,
        sx: wx,
        sy: wy,
        spin,
        ..*marbles
    };
    let at_rim = marbles.x.abs().ge(rims.reach_x) | marbles.y.abs().ge(rims.reach_y);
    if !at_rim.any() {
        let left = unresisted(wx, wy, push.resistance);
        return (rolling(left * wx, left * wy, spin), zero.lt(zero));
    }
    let held_x = against(marbles.x, wx, rims.reach_x);
    let held_y = against(marbles.y, wy, rims.reach_y);
    let climbs = held_x & marbles.vx.ne(marbles.sx) | held_y & marbles.vy.ne(marbles.sy);
    let (wx, wy) = (held_x.select(zero, wx), held_y.select(zero, wy));
    let left = unresisted(wx, wy, push.resistance);
    let (wx, wy, spin) = turn_on_rim(rims, push, held_x, held_y, left * wx, left * wy, spin);
    (rolling(wx, wy, spin), climbs)
}

/// The spin about the vertical after damping and friction with the board in a substep.
#[inline(always)]
fn spun<S: Simd>(spin: Lanes<S>, push: &Push<S>) -> Lanes<S> {
    let spin = spin * push.damping;
    spin - spin.clamp(push.spinning)
}

/// Factor of rolling resistance on the rolling velocity after a substep.
#[inline(always)]
fn unresisted<S: Simd>(wx: Lanes<S>, wy: Lanes<S>, resistance: Lanes<S>) -> Lanes<S> {
    let (zero, one) = (wx.like(0.0), wx.like(1.0));
    let square = wx * wx + wy * wy;
    let stops = square.le(resistance * resistance);
    stops.select(zero, one - resistance.over(square.sqrt()))
}

/// Friction of the rims on marbles that lean on one: rolling velocity and spin after it.
///
/// A corner holds a marble by both rims; it only spins there.
#[inline(always)]
fn turn_on_rim<S: Simd>(
    rims: &Rims<S>,
    push: &Push<S>,
    held_x: Mask<S>,
    held_y: Mask<S>,
    wx: Lanes<S>,
    wy: Lanes<S>,
    spin: Lanes<S>,
) -> (Lanes<S>, Lanes<S>, Lanes<S>) {
    let (zero, one) = (spin.like(0.0), spin.like(1.0));
    // Seen along y, spin about the vertical moves the rim's side of the marble the other way.
    let towards = held_x.select(push.x, -push.y);
    let side = towards.lt(zero).select(-one, one);
    let pressing = held_x.select(push.x.abs(), zero) + held_y.select(push.y.abs(), zero);
    let along = held_x.select(wy, wx);
    // Rolling on the board and the rim at once: 5/7 of the impulse and 5/2 of it bring the surface to rest.
    let impulse = (14.0 / 45.0 * (along + side * spin)).clamp(rims.friction * pressing);
    let along = along - 5.0 / 7.0 * impulse;
    (
        held_x.select(zero, held_y.select(along, wx)),
        held_y.select(zero, held_x.select(along, wy)),
        (held_x | held_y).select(spin - 2.5 * (side * impulse), spin),
    )
}

/// w = (5 v + 2 s)/7 after the push and damping, before any friction.
#[inline(always)]
fn rolling_velocity<S: Simd>(marbles: &Marbles<S>, push: &Push<S>) -> (Lanes<S>, Lanes<S>) {
    let wx = marbles.vx + 5.0 / 7.0 * push.x - 2.0 / 7.0 * (marbles.vx - marbles.sx);
    let wy = marbles.vy + 5.0 / 7.0 * push.y - 2.0 / 7.0 * (marbles.vy - marbles.sy);
    (wx * push.damping, wy * push.damping)
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
    let one = zero.like(1.0);
    let left = held.select(unresisted(wx, wy, push.resistance), one);
    let taken = one - left;
    let (rolled_x, rolled_y) = (left * wx, left * wy);

    let spin = held.select(spun(marbles.spin, push), marbles.spin * push.damping);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::{GRAVITY, Rig, SUBSTEP_S};
    use crate::motion::Restitution;
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
            restitution in 0.0..1.0, falloff in 0.0..1.0, friction in 0.0..1.0, resistance in 0.0..0.002,
        ) {
            let lanes = |value: f64| Lanes::splat(Scalar, value);
            let rig = Rig::default();
            let [reach_x, reach_y] = rig.reach_m();
            let rims = Rims {
                reach_x: lanes(reach_x),
                reach_y: lanes(reach_y),
                restitution: Restitution {
                    at_reference: lanes(restitution),
                    falloff: lanes(falloff),
                },
                friction: lanes(friction),
            };
            let (g, h) = (GRAVITY, SUBSTEP_S);
            let push = Push {
                x: lanes(0.0),
                y: lanes(0.0),
                normal: lanes(g),
                resistance: lanes(5.0 / 7.0 * resistance * g * h),
                grip: lanes(rig.board.sliding_friction * g * h),
                spinning: lanes(2.5 * rig.board.spinning_friction * g * h),
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
