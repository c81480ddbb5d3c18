//! A rolling sphere on a tilting plane with rim walls: the fast engine.
//!
//! A solid sphere on a plane has five velocities that matter: of its centre along x and y (`vx`,
//! `vy`), of its surface where it touches the board (`sx`, `sy`: the velocity at which the present
//! spin would be a pure roll), and of its surface about the vertical (`spin`). A push along the
//! board at the contact changes v by j and s by -5/2 j, since the moment of inertia is 2/5 m r²; so
//! slip vanishes at j = 2/7 (v - s), and both then are w = (5 v + 2 s)/7, which no contact force
//! changes. Coulomb's law bounds j. Rolling resistance is a torque: it takes `min(5/7 μ g h, |w|)`
//! from w, so that a marble whose push is below the resistance stays where it is.
//!
//! At a rim the normal velocity is reflected by the restitution, and Coulomb friction acts on the
//! marble's surface there, along the rim and vertically; the vertical part lets the marble hop for
//! some milliseconds, in which the board has no hold of it. What spin is left then slips on the
//! board.
//!
//! All lanes of a group take the same number of substeps; each has its own parameters, commands,
//! start and substep length. There is no fused multiply-add and no reassociation, so the bits are
//! the same on every instruction set.

use std::sync::atomic::{AtomicBool, Ordering};

use multiversion::multiversion;

use super::Job;
use crate::board::{BOARD_FRICTION, GRAVITY, Rig};

/// Lanes: the most rollouts to a group.
pub(crate) const GROUP: usize = 32;

type Lanes = [f64; GROUP];

const ZERO: Lanes = [0.0; GROUP];

/// Keeps divisions by a length of zero finite; far below any speed (m/s) that matters.
const TINY: f64 = 1e-300;

/// The rig in the units of the kernel.
struct Constants {
    reach: [f64; 2],
    restitution: f64,
    wall_friction: f64,
    damping: f64,
}

/// One lane's values that last for the whole rollout.
struct Lane<'a> {
    job: &'a Job<'a>,
    /// Observed edges a metre.
    edges_per_m: f64,
}

/// Where the marbles are and how they move (m, m/s).
struct Marbles {
    x: Lanes,
    y: Lanes,
    vx: Lanes,
    vy: Lanes,
    sx: Lanes,
    sy: Lanes,
    /// Radius × angular velocity about the vertical.
    spin: Lanes,
    /// Time until a hop ends (s).
    air: Lanes,
}

/// What acts during a substep, times its length (m/s), and the length (s).
struct Push {
    x: Lanes,
    y: Lanes,
    /// Gravity across the board.
    normal: Lanes,
    /// Most that rolling resistance can take from the rolling velocity.
    resistance: Lanes,
    /// Most that friction with the board can change the velocity.
    grip: Lanes,
    /// Factor that damping leaves of every velocity.
    damping: Lanes,
    length: Lanes,
}

/// Simulates up to [`GROUP`] rollouts whose timesteps have equal numbers of substeps.
pub(crate) fn run(rig: &Rig, jobs: &[Job<'_>], out: &mut [&mut [[f64; 2]]], cancel: &AtomicBool) {
    let lanes: [Lane<'_>; GROUP] = std::array::from_fn(|lane| {
        // Empty lanes repeat the first rollout and are never read.
        let job = jobs.get(lane).unwrap_or(&jobs[0]);
        Lane {
            job,
            edges_per_m: job.parameters.observation_scale / rig.board.edge_x_m,
        }
    });
    let constants = Constants {
        reach: rig.reach_m(),
        restitution: rig.board.wall_restitution,
        wall_friction: rig.board.wall_friction,
        damping: rig.marble.damping_per_s,
    };
    simulate(&constants, &lanes, out, cancel);
}

#[multiversion(targets(
    "x86_64+avx512f+avx512dq+avx512vl+avx512bw",
    "x86_64+avx2",
    "aarch64+neon"
))]
fn simulate(constants: &Constants, lanes: &[Lane<'_>; GROUP], out: &mut [&mut [[f64; 2]]], cancel: &AtomicBool) {
    let rows = out[0].len();
    let mut marbles = place(constants, lanes);
    let mut push = Push {
        x: ZERO,
        y: ZERO,
        normal: ZERO,
        resistance: ZERO,
        grip: ZERO,
        damping: [1.0; GROUP],
        length: ZERO,
    };
    // While every marble rolls without slip, half the physics need not be looked at.
    let mut rolling = true;
    for row in 0..rows {
        observe(&marbles, lanes, row, out);
        if row + 1 == rows || cancel.load(Ordering::Relaxed) {
            break;
        }
        let gripping = tilt(constants, lanes, row, &mut push);
        for _ in 0..lanes[0].job.clock.step(row).substeps {
            if rolling && gripping {
                rolling = roll(constants, &mut marbles, &push);
                if rolling {
                    continue;
                }
            }
            rolling = slip(constants, &mut marbles, &push);
        }
    }
}

#[inline(always)]
fn place(constants: &Constants, lanes: &[Lane<'_>; GROUP]) -> Marbles {
    let mut marbles = Marbles {
        x: ZERO,
        y: ZERO,
        vx: ZERO,
        vy: ZERO,
        sx: ZERO,
        sy: ZERO,
        spin: ZERO,
        air: ZERO,
    };
    for (l, lane) in lanes.iter().enumerate() {
        let [x, y] = lane.job.start.map(|edges| edges / lane.edges_per_m);
        let [vx, vy] = lane.job.start_velocity.map(|edges| edges / lane.edges_per_m);
        marbles.x[l] = x.clamp(-constants.reach[0], constants.reach[0]);
        marbles.y[l] = y.clamp(-constants.reach[1], constants.reach[1]);
        (marbles.vx[l], marbles.vy[l]) = (vx, vy);
        (marbles.sx[l], marbles.sy[l]) = (vx, vy);
    }
    marbles
}

#[inline(always)]
fn observe(marbles: &Marbles, lanes: &[Lane<'_>; GROUP], row: usize, out: &mut [&mut [[f64; 2]]]) {
    for ((l, lane), out) in lanes.iter().enumerate().zip(out) {
        out[row] = if row == 0 {
            lane.job.start
        } else {
            [marbles.x[l] * lane.edges_per_m, marbles.y[l] * lane.edges_per_m]
        };
    }
}

/// What the command of this row does to the marbles; true where rolling marbles will not slip.
#[inline(always)]
fn tilt(constants: &Constants, lanes: &[Lane<'_>; GROUP], row: usize, push: &mut Push) -> bool {
    let mut tilt = [ZERO; 2];
    let mut friction = ZERO;
    for (l, lane) in lanes.iter().enumerate() {
        let Job { parameters, commands, clock, .. } = lane.job;
        tilt[0][l] = parameters.gear_x * commands[row][0];
        tilt[1][l] = parameters.gear_y * commands[row][1];
        friction[l] = parameters.rolling_friction;
        push.length[l] = clock.step(row).length_s;
    }
    let mut slipping = 0.0;
    for l in 0..GROUP {
        let h = push.length[l];
        let (sin_x, cos_x) = (sin(tilt[0][l]), cos(tilt[0][l]));
        let (sin_y, cos_y) = (sin(tilt[1][l]), cos(tilt[1][l]));
        // The board turned about x first, then about y: gravity in its frame.
        push.x[l] = GRAVITY * sin_y * h;
        push.y[l] = -GRAVITY * sin_x * cos_y * h;
        push.normal[l] = GRAVITY * cos_x * cos_y;
        push.resistance[l] = 5.0 / 7.0 * friction[l] * push.normal[l] * h;
        push.grip[l] = BOARD_FRICTION * push.normal[l] * h;
        push.damping[l] = 1.0 / (1.0 + h * constants.damping);
        let needed = 2.0 / 7.0 * (push.x[l].abs() + push.y[l].abs()) + push.resistance[l];
        slipping += if needed > push.grip[l] { 1.0 } else { 0.0 };
    }
    slipping == 0.0
}

/// A substep of marbles that all roll; false, with nothing moved, where one of them meets a rim.
#[inline(always)]
fn roll(constants: &Constants, marbles: &mut Marbles, push: &Push) -> bool {
    let [reach_x, reach_y] = constants.reach;
    let (mut x, mut y, mut wx, mut wy) = (ZERO, ZERO, ZERO, ZERO);
    let mut outside = 0.0;
    for l in 0..GROUP {
        let (ux, uy) = rolling_velocity(marbles, push, l);
        let taken = resisted(ux, uy, push.resistance[l]);
        wx[l] = ux - taken * ux;
        wy[l] = uy - taken * uy;
        x[l] = marbles.x[l] + wx[l] * push.length[l];
        y[l] = marbles.y[l] + wy[l] * push.length[l];
        let is_out = (x[l].abs() >= reach_x) | (y[l].abs() >= reach_y);
        outside += if is_out { 1.0 } else { 0.0 };
    }
    if outside > 0.0 {
        return false;
    }
    marbles.x = x;
    marbles.y = y;
    (marbles.vx, marbles.vy) = (wx, wy);
    (marbles.sx, marbles.sy) = (wx, wy);
    for l in 0..GROUP {
        marbles.spin[l] *= push.damping[l];
    }
    true
}

/// w = (5 v + 2 s)/7 after the push and damping, before any friction.
#[inline(always)]
fn rolling_velocity(marbles: &Marbles, push: &Push, l: usize) -> (f64, f64) {
    let damping = push.damping[l];
    let wx = (5.0 / 7.0 * (marbles.vx[l] + push.x[l]) + 2.0 / 7.0 * marbles.sx[l]) * damping;
    let wy = (5.0 / 7.0 * (marbles.vy[l] + push.y[l]) + 2.0 / 7.0 * marbles.sy[l]) * damping;
    (wx, wy)
}

/// The part of a rolling velocity that rolling resistance takes in a substep.
#[inline(always)]
fn resisted(wx: f64, wy: f64, resistance: f64) -> f64 {
    least(resistance / ((wx * wx + wy * wy).sqrt() + TINY), 1.0)
}

/// A substep of marbles that may slip, hop or meet a rim; true where all of them roll afterwards.
#[inline(always)]
fn slip(constants: &Constants, marbles: &mut Marbles, push: &Push) -> bool {
    let mut unsettled = 0.0;
    let mut touching = [0.0; 2];
    for l in 0..GROUP {
        board_contact(constants, marbles, push, l);
        let h = push.length[l];
        touching[0] += if (marbles.x[l] + marbles.vx[l] * h).abs() >= constants.reach[0] { 1.0 } else { 0.0 };
        touching[1] += if (marbles.y[l] + marbles.vy[l] * h).abs() >= constants.reach[1] { 1.0 } else { 0.0 };
    }
    if touching[0] > 0.0 {
        let Marbles { x, vx, vy, sx, spin, air, .. } = marbles;
        meet_rim(constants, constants.reach[0], push, Rim { x, vn: vx, vt: vy, sn: sx, spin, air, turn: 1.0 });
    }
    if touching[1] > 0.0 {
        let Marbles { y, vx, vy, sy, spin, air, .. } = marbles;
        meet_rim(constants, constants.reach[1], push, Rim { x: y, vn: vy, vt: vx, sn: sy, spin, air, turn: -1.0 });
    }
    for l in 0..GROUP {
        let h = push.length[l];
        let (x, y) = (marbles.x[l] + marbles.vx[l] * h, marbles.y[l] + marbles.vy[l] * h);
        marbles.x[l] = x.clamp(-constants.reach[0], constants.reach[0]);
        marbles.y[l] = y.clamp(-constants.reach[1], constants.reach[1]);
        let is_rolling = (marbles.vx[l] == marbles.sx[l]) & (marbles.vy[l] == marbles.sy[l]) & (marbles.air[l] == 0.0);
        unsettled += if is_rolling { 0.0 } else { 1.0 };
    }
    unsettled == 0.0
}

/// Gravity, friction and rolling resistance of the board.
#[inline(always)]
fn board_contact(constants: &Constants, marbles: &mut Marbles, push: &Push, l: usize) {
    let (h, damping) = (push.length[l], push.damping[l]);
    let held = if marbles.air[l] > 0.0 { 0.0 } else { 1.0 };
    marbles.air[l] = most(marbles.air[l] - h, 0.0);

    let (wx, wy) = rolling_velocity(marbles, push, l);
    // A rim that already holds the marble leaves no rolling against it to resist.
    let against = |position: f64, velocity: f64, reach: f64| {
        if (position >= reach) & (velocity > 0.0) | (position <= -reach) & (velocity < 0.0) { 0.0 } else { velocity }
    };
    let rx = against(marbles.x[l], wx, constants.reach[0]);
    let ry = against(marbles.y[l], wy, constants.reach[1]);
    let taken = resisted(rx, ry, push.resistance[l]) * held;
    let (rolled_x, rolled_y) = (wx - taken * rx, wy - taken * ry);

    let (vx, vy) = ((marbles.vx[l] + push.x[l]) * damping, (marbles.vy[l] + push.y[l]) * damping);
    let (sx, sy) = (marbles.sx[l] * damping - 3.5 * taken * rx, marbles.sy[l] * damping - 3.5 * taken * ry);
    let (ux, uy) = (vx - sx, vy - sy);
    let slip = (ux * ux + uy * uy).sqrt() + TINY;
    let grip = push.grip[l] * held;
    let part = grip / slip;
    let rolls = (2.0 / 7.0 * slip <= grip) & (held > 0.0);
    marbles.vx[l] = if rolls { rolled_x } else { vx - part * ux };
    marbles.vy[l] = if rolls { rolled_y } else { vy - part * uy };
    marbles.sx[l] = if rolls { rolled_x } else { sx + 2.5 * part * ux };
    marbles.sy[l] = if rolls { rolled_y } else { sy + 2.5 * part * uy };
    marbles.spin[l] *= damping;
}

/// Two opposite rims, seen along the axis they bound.
struct Rim<'a> {
    x: &'a mut Lanes,
    vn: &'a mut Lanes,
    vt: &'a mut Lanes,
    sn: &'a mut Lanes,
    spin: &'a mut Lanes,
    air: &'a mut Lanes,
    /// Sense in which spin about the vertical moves the surface at the rim.
    turn: f64,
}

/// Impact and friction of the marbles that would pass a rim in this substep.
#[inline(always)]
fn meet_rim(constants: &Constants, reach: f64, push: &Push, rim: Rim<'_>) {
    let Rim { x, vn, vt, sn, spin, air, turn } = rim;
    for l in 0..GROUP {
        let next = x[l] + vn[l] * push.length[l];
        let side = if next > 0.0 { 1.0 } else { -1.0 };
        let hits = (next.abs() >= reach) & (vn[l] * side > 0.0);
        let impulse = (1.0 + constants.restitution) * vn[l] * side;
        // Velocity of the marble's surface where it touches the rim.
        let along = vt[l] + turn * side * spin[l];
        let up = -side * sn[l];
        let surface = (along * along + up * up).sqrt() + TINY;
        let part = least(constants.wall_friction * impulse / surface, 2.0 / 7.0);
        let part = if hits { part } else { 0.0 };
        let (j_along, j_up) = (part * along, part * up);
        vt[l] -= j_along;
        spin[l] -= 2.5 * turn * side * j_along;
        sn[l] += 2.5 * side * j_up;
        air[l] = most(air[l], -2.0 * j_up / push.normal[l]);
        x[l] = if hits { side * reach } else { x[l] };
        vn[l] = if hits { -constants.restitution * vn[l] } else { vn[l] };
    }
}

/// Minimum that compiles to one instruction; operands are never NaN.
#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Maximum that compiles to one instruction; operands are never NaN.
#[inline(always)]
fn most(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Sine by its Taylor series: exact to 5e-14 up to a right angle and to the last bits on tilts.
#[inline(always)]
fn sin(x: f64) -> f64 {
    let z = x * x;
    let series = [17.0 * 16.0, 15.0 * 14.0, 13.0 * 12.0, 11.0 * 10.0, 9.0 * 8.0, 7.0 * 6.0, 5.0 * 4.0, 3.0 * 2.0];
    x * series.iter().fold(1.0, |sum, n| 1.0 - z * (1.0 / n) * sum)
}

/// Cosine by its Taylor series: see [`sin`].
#[inline(always)]
fn cos(x: f64) -> f64 {
    let z = x * x;
    let series = [18.0 * 17.0, 16.0 * 15.0, 14.0 * 13.0, 12.0 * 11.0, 10.0 * 9.0, 8.0 * 7.0, 6.0 * 5.0, 4.0 * 3.0, 2.0];
    series.iter().fold(1.0, |sum, n| 1.0 - z * (1.0 / n) * sum)
}
