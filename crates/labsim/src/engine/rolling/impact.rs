//! Marbles that meet a rim.
//!
//! The normal velocity is reflected by the restitution, and Coulomb friction acts on the marble's
//! surface at the rim, along it and vertically; the vertical part lets the marble hop for some
//! milliseconds, in which the board has no hold of it. What spin is left then slips on the board.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use pulp::Simd;

use crate::lanes::Lanes;
use crate::motion::{Marbles, Push, Rims, length};

/// Moves marbles that may meet a rim on their way.
#[inline(always)]
pub(super) fn impact<S: Simd>(rims: &Rims<S>, marbles: &Marbles<S>, push: &Push<S>) -> Marbles<S> {
    let mut next = *marbles;
    if reaches(next.x, next.vx, push, rims.reach_x) {
        next = meet_rim(rims, rims.reach_x, push, &next);
    }
    // Friction of the rim along x may have brought the marble to the one along y.
    if reaches(next.y, next.vy, push, rims.reach_y) {
        next = mirrored(&meet_rim(rims, rims.reach_y, push, &mirrored(&next)));
    }
    Marbles {
        x: (next.x + next.vx * push.length).clamp(rims.reach_x),
        y: (next.y + next.vy * push.length).clamp(rims.reach_y),
        ..next
    }
}

#[inline(always)]
fn reaches<S: Simd>(
    position: Lanes<S>,
    velocity: Lanes<S>,
    push: &Push<S>,
    reach: Lanes<S>,
) -> bool {
    (position + velocity * push.length).abs().ge(reach).any()
}

/// The marbles seen in a mirror that swaps x and y, where a spin about the vertical turns back.
#[inline(always)]
fn mirrored<S: Simd>(marbles: &Marbles<S>) -> Marbles<S> {
    Marbles {
        x: marbles.y,
        y: marbles.x,
        vx: marbles.vy,
        vy: marbles.vx,
        sx: marbles.sy,
        sy: marbles.sx,
        spin: -marbles.spin,
        air: marbles.air,
    }
}

/// Impact and friction of the marbles that would pass a rim along x in this substep.
#[inline(always)]
pub(super) fn meet_rim<S: Simd>(
    rims: &Rims<S>,
    reach: Lanes<S>,
    push: &Push<S>,
    marbles: &Marbles<S>,
) -> Marbles<S> {
    let Marbles { x, vx, vy, sx, .. } = *marbles;
    let (zero, one) = (reach.like(0.0), reach.like(1.0));
    let side = vx.gt(zero).select(one, -one);
    let hits = ((x + vx * push.length) * side).ge(reach);
    // What leans on the rim already is pressed to it and does not bounce.
    let leans = (x * side).ge(reach);
    let restitution = leans.select(zero, rims.restitution.at(vx, hits & !leans));
    let impulse = (one + restitution) * vx.abs();
    // Velocity of the marble's surface where it touches the rim.
    let (along, up) = (vy + side * marbles.spin, -(side * sx));
    let part = (rims.friction * impulse).over(length(along, up));
    let part = hits.select(part.min(reach.like(2.0 / 7.0)), zero);
    let (j_along, j_up) = (part * along, part * up);
    Marbles {
        x: hits.select(side * reach, x),
        vx: hits.select(-(restitution * vx), vx),
        vy: vy - j_along,
        sx: sx + 2.5 * (side * j_up),
        spin: marbles.spin - 2.5 * (side * j_along),
        air: hop(marbles.air, -j_up, push),
        ..*marbles
    }
}

/// Time until the hop ends that marbles of that upward velocity begin, or the one they are in.
#[inline(always)]
fn hop<S: Simd>(air: Lanes<S>, up: Lanes<S>, push: &Push<S>) -> Lanes<S> {
    let fall = 2.0 * up;
    // A hop that ends within the substep leaves the board no less hold of the marble.
    let hops = fall.gt(push.normal * push.length);
    if hops.any() {
        air.max(hops.select(fall.over(push.normal), air))
    } else {
        air
    }
}
