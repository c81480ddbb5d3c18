//! A rolling sphere on a tilting plane with rim walls: the fast engine.
//!
//! Each lane has its own parameters, commands, start, and number and length of substeps; in a row
//! that is longer for some, the others wait. The physics of a substep is in [`contact`].

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

mod contact;
mod impact;

use std::sync::atomic::{AtomicBool, Ordering};

use pulp::{Arch, Scalar, Simd, WithSimd};

use self::contact::{Marbles, Push, Rims, substep};
use super::Job;
use super::lanes::Lanes;
use crate::board::{BOARD_FRICTION, GRAVITY, Rig};

/// The most rollouts to a group.
pub(crate) const GROUP: usize = 32;

/// The most registers whose marbles take turns, so that one's divisions hide behind another's.
const REGISTERS: usize = 4;

/// Simulates up to [`GROUP`] rollouts, fastest where neighbours take equally many substeps.
pub(crate) fn run(rig: &Rig, jobs: &[Job<'_>], out: &mut [&mut [[f64; 2]]], cancel: &AtomicBool) {
    let group = Group {
        rig,
        jobs,
        out,
        cancel,
    };
    match jobs.len() {
        // Nothing stands beside it, and wide registers take longer to divide.
        1 => group.with_simd(Scalar),
        _ => Arch::new().dispatch(group),
    }
}

struct Group<'a, 'b, 'c> {
    rig: &'a Rig,
    jobs: &'a [Job<'b>],
    out: &'a mut [&'c mut [[f64; 2]]],
    cancel: &'a AtomicBool,
}

impl WithSimd for Group<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let lanes = REGISTERS * S::F64_LANES;
        for (jobs, out) in self.jobs.chunks(lanes).zip(self.out.chunks_mut(lanes)) {
            match jobs.len().div_ceil(S::F64_LANES) {
                1 => simulate::<S, 1>(simd, self.rig, jobs, out, self.cancel),
                2 => simulate::<S, 2>(simd, self.rig, jobs, out, self.cancel),
                _ => simulate::<S, REGISTERS>(simd, self.rig, jobs, out, self.cancel),
            }
        }
    }
}

#[inline(always)]
fn simulate<S: Simd, const N: usize>(
    simd: S,
    rig: &Rig,
    jobs: &[Job<'_>],
    out: &mut [&mut [[f64; 2]]],
    cancel: &AtomicBool,
) {
    // Empty lanes repeat the first rollout and are never read.
    let job =
        |register: usize, lane: usize| jobs.get(register * S::F64_LANES + lane).unwrap_or(&jobs[0]);
    let [reach_x, reach_y] = rig.reach_m();
    let rims = Rims {
        reach_x: Lanes::splat(simd, reach_x),
        reach_y: Lanes::splat(simd, reach_y),
        restitution: Lanes::splat(simd, rig.board.wall_restitution),
        friction: Lanes::splat(simd, rig.board.wall_friction),
    };
    let edges_per_m: Vec<f64> = jobs
        .iter()
        .map(|job| job.parameters.observation_scale / rig.board.edge_x_m)
        .collect();
    let mut marbles: [Marbles<S>; N] =
        std::array::from_fn(|register| place(simd, &rims, rig, |lane| job(register, lane)));
    let rows = out[0].len();
    for row in 0..rows {
        observe(&marbles, jobs, &edges_per_m, row, out);
        if row + 1 == rows || cancel.load(Ordering::Relaxed) {
            break;
        }
        let push: [Push<S>; N] =
            std::array::from_fn(|register| tilt(simd, rig, row, |lane| job(register, lane)));
        let substeps: [Substeps<S>; N] =
            std::array::from_fn(|register| Substeps::of(simd, register, jobs, row));
        let most = substeps.iter().map(|substeps| substeps.most).max();
        for done in 0..most.unwrap_or(0) {
            for (marbles, (push, substeps)) in marbles.iter_mut().zip(push.iter().zip(&substeps)) {
                if done < substeps.most {
                    let next = substep(&rims, marbles, push);
                    *marbles = substeps.take(done, next, marbles);
                }
            }
        }
    }
}

/// How many substeps each lane of a register takes in a row; empty lanes take none.
struct Substeps<S: Simd> {
    lanes: Lanes<S>,
    fewest: u32,
    most: u32,
}

impl<S: Simd> Substeps<S> {
    #[inline(always)]
    fn of(simd: S, register: usize, jobs: &[Job<'_>], row: usize) -> Self {
        let (mut fewest, mut most) = (u32::MAX, 0);
        let lanes = Lanes::from_fn(simd, |lane| {
            let job = jobs.get(register * S::F64_LANES + lane);
            job.map_or(0.0, |job| {
                let substeps = job.clock.step(row).substeps;
                (fewest, most) = (fewest.min(substeps), most.max(substeps));
                f64::from(substeps)
            })
        });
        Self {
            lanes,
            fewest,
            most,
        }
    }

    /// Lets the lanes whose row is not over after that many substeps have their next.
    #[inline(always)]
    fn take(&self, done: u32, next: Marbles<S>, marbles: &Marbles<S>) -> Marbles<S> {
        if done < self.fewest {
            return next;
        }
        let goes_on = self.lanes.gt(self.lanes.like(f64::from(done)));
        Marbles::select(goes_on, &next, marbles)
    }
}

#[inline(always)]
fn place<'a, 'b: 'a, S: Simd>(
    simd: S,
    rims: &Rims<S>,
    rig: &Rig,
    job: impl Fn(usize) -> &'a Job<'b>,
) -> Marbles<S> {
    let metres = |value: fn(&Job<'_>) -> f64| {
        Lanes::from_fn(simd, |lane| {
            let job = job(lane);
            value(job) / (job.parameters.observation_scale / rig.board.edge_x_m)
        })
    };
    let (vx, vy) = (
        metres(|job| job.start_velocity[0]),
        metres(|job| job.start_velocity[1]),
    );
    Marbles {
        x: metres(|job| job.start[0]).clamp(rims.reach_x),
        y: metres(|job| job.start[1]).clamp(rims.reach_y),
        vx,
        vy,
        sx: vx,
        sy: vy,
        spin: Lanes::splat(simd, 0.0),
        air: Lanes::splat(simd, 0.0),
    }
}

#[inline(always)]
fn observe<S: Simd>(
    marbles: &[Marbles<S>],
    jobs: &[Job<'_>],
    edges_per_m: &[f64],
    row: usize,
    out: &mut [&mut [[f64; 2]]],
) {
    let lanes = S::F64_LANES;
    for (register, marbles) in marbles.iter().enumerate() {
        let (x, y) = (marbles.x.to_array(), marbles.y.to_array());
        for i in register * lanes..jobs.len().min((register + 1) * lanes) {
            let lane = i - register * lanes;
            let seen = [x[lane] * edges_per_m[i], y[lane] * edges_per_m[i]];
            out[i][row] = if row == 0 { jobs[i].start } else { seen };
        }
    }
}

/// What the command of this row does to the marbles of a register.
#[inline(always)]
fn tilt<'a, 'b: 'a, S: Simd>(
    simd: S,
    rig: &Rig,
    row: usize,
    job: impl Fn(usize) -> &'a Job<'b>,
) -> Push<S> {
    let lanes = |value: &dyn Fn(&Job<'_>) -> f64| Lanes::from_fn(simd, |lane| value(job(lane)));
    let tilt_x = lanes(&|job| job.parameters.gear_x * job.commands[row][0]);
    let tilt_y = lanes(&|job| job.parameters.gear_y * job.commands[row][1]);
    let friction = lanes(&|job| job.parameters.rolling_friction);
    let length = lanes(&|job| job.clock.step(row).length_s);
    let one = Lanes::splat(simd, 1.0);
    // The board turned about x first, then about y: gravity in its frame.
    let (sin_x, cos_x) = (tilt_x.sin(), tilt_x.cos());
    let (sin_y, cos_y) = (tilt_y.sin(), tilt_y.cos());
    let normal = GRAVITY * (cos_x * cos_y);
    let push_x = GRAVITY * sin_y * length;
    let push_y = -(GRAVITY * (sin_x * cos_y) * length);
    let resistance = 5.0 / 7.0 * (friction * normal * length);
    let grip = BOARD_FRICTION * (normal * length);
    Push {
        x: push_x,
        y: push_y,
        normal,
        resistance,
        grip,
        damping: one.over(one + rig.marble.damping_per_s * length),
        length,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::paper_drive;
    use crate::engine::{Clock, Step};

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let mut rig = Rig::default();
        rig.board.wall_restitution = 0.5;
        let commands = paper_drive(100, 0.1, false);
        let jobs: Vec<Job<'_>> = (0..29)
            .map(|i| Job {
                parameters: [0.003 * f64::from(i), 0.09, 0.0004, 23.0, 1.1].into(),
                commands: &commands,
                start: [0.01 * f64::from(i), -0.2],
                start_velocity: [0.3, 0.0],
                clock: Clock::Even(Step::rounded(f64::from(17 + i % 7))),
            })
            .collect();
        let run = |dispatch: &dyn Fn(Group<'_, '_, '_>)| {
            let mut all = vec![[0.0; 2]; jobs.len() * commands.len()];
            let mut out: Vec<&mut [[f64; 2]]> = all.chunks_mut(commands.len()).collect();
            let cancel = AtomicBool::new(false);
            dispatch(Group {
                rig: &rig,
                jobs: &jobs,
                out: &mut out,
                cancel: &cancel,
            });
            all
        };
        let scalar = run(&|group| group.with_simd(Scalar));
        assert_eq!(run(&|group| Arch::new().dispatch(group)), scalar);
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = pulp::x86::V3::try_new() {
            assert_eq!(run(&|group| pulp::Simd::vectorize(avx2, group)), scalar);
        }
    }
}
