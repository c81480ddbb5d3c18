//! A rolling sphere on a tilting plane with rim walls: the fast engine.
//!
//! Each lane has its own parameters, commands, start, and number and length of substeps; in a row
//! that is longer for some, the others wait. The physics of a substep is in [`contact`].

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

mod contact;
mod estimator;
mod frame;
mod impact;
mod maze;

use pulp::{Arch, NullaryFnOnce, Scalar, Simd, WithSimd};

use self::contact::substep;
use self::estimator::Estimator;
pub(crate) use self::estimator::TAIL;
use self::maze::Inside;
use super::actuation::Actuation;
use super::camera::Camera;
use super::{Job, Setup, Sink};
use crate::effects::Any;
use crate::lanes::Lanes;
use crate::maze::Fall;
use crate::motion::{Marbles, Pair, Push, Rims};

/// The most rollouts to a group.
pub(crate) const GROUP: usize = 32;

/// The most registers whose marbles take turns, so that one's divisions hide behind another's.
const REGISTERS: usize = 4;

/// Simulates up to [`GROUP`] rollouts whose marbles are let go at the same row; fastest where neighbours
/// take equally many substeps, which they must if [`Setup::is_plain`] is not true.
pub(crate) fn run(setup: &Setup<'_>, jobs: &[Job<'_>], out: &mut [Sink<'_>]) {
    let group = Group { setup, jobs, out };
    match jobs.len() {
        // Nothing stands beside it, and wide registers take longer to divide.
        1 => group.with_simd(Scalar),
        _ => Arch::new().dispatch(group),
    }
}

struct Group<'a, 'b, 'c> {
    setup: &'a Setup<'a>,
    jobs: &'a [Job<'b>],
    out: &'a mut [Sink<'c>],
}

impl WithSimd for Group<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let lanes = REGISTERS * S::F64_LANES;
        for (jobs, out) in self.jobs.chunks(lanes).zip(self.out.chunks_mut(lanes)) {
            match jobs.len().div_ceil(S::F64_LANES) {
                1 => simulate::<S, 1>(simd, self.setup, jobs, out),
                2 => simulate::<S, 2>(simd, self.setup, jobs, out),
                _ => simulate::<S, REGISTERS>(simd, self.setup, jobs, out),
            }
        }
    }
}

#[inline(always)]
fn simulate<S: Simd, const N: usize>(
    simd: S,
    setup: &Setup<'_>,
    jobs: &[Job<'_>],
    out: &mut [Sink<'_>],
) {
    let groups: [LaneGroup<'_, '_>; N] = std::array::from_fn(|register| {
        let begin = register * S::F64_LANES;
        let end = jobs.len().min(begin + S::F64_LANES);
        LaneGroup {
            jobs: jobs.get(begin..end).unwrap_or(&[]),
            filler: &jobs[0],
        }
    });
    let mut registers = groups.map(|group| Register::new(simd, setup, group));
    let (first, step) = (jobs[0].first, |row: usize| jobs[0].clock.step(row).substeps);
    for row in 0..first {
        for (register, group) in registers.iter_mut().zip(groups) {
            register.wait(row, step(row), group);
        }
    }
    let mut marbles: [Marbles<S>; N] = std::array::from_fn(|i| registers[i].release(groups[i]));
    let mut estimators: [Option<Estimator<S>>; N] =
        std::array::from_fn(|i| registers[i].estimator(&marbles[i], groups[i]));
    for row in first..first + setup.rows {
        for (((register, group), marbles), out) in registers
            .iter_mut()
            .zip(groups)
            .zip(&marbles)
            .zip(out.chunks_mut(S::F64_LANES))
        {
            register.observe(row, marbles, group, out);
        }
        let each = estimators.iter_mut().zip(&mut marbles);
        for (i, (estimator, out)) in each.zip(out.chunks_mut(S::F64_LANES)).enumerate() {
            if let (Some(estimator), marbles) = estimator {
                estimator.correct(row, &registers[i], marbles, groups[i], out);
            }
        }
        if row + 1 == first + setup.rows || setup.is_cancelled() {
            break;
        }
        for (register, group) in registers.iter_mut().zip(groups) {
            register.begin_row(row, group);
        }
        if setup.is_plain() {
            let substeps: [Substeps<S>; N] =
                std::array::from_fn(|i| registers[i].substeps(row, groups[i]));
            let pushes: [Push<S>; N] = std::array::from_fn(|i| registers[i].actuation.push);
            let most = substeps.iter().map(|substeps| substeps.most).max();
            for done in 0..most.unwrap_or(0) {
                for (i, marbles) in marbles.iter_mut().enumerate() {
                    if done < substeps[i].most {
                        let next = substep(&registers[i].rims, marbles, &pushes[i]);
                        *marbles = substeps[i].take(done, next, marbles);
                    }
                }
            }
        } else if setup.obstacles.is_none() {
            for i in 0..step(row) {
                let mut out = out.chunks_mut(S::F64_LANES);
                for ((register, group), marbles) in
                    registers.iter_mut().zip(groups).zip(&mut marbles)
                {
                    if group.jobs.is_empty() {
                        break;
                    }
                    register.substep::<false>(row, i, marbles, out.next().unwrap_or_default());
                }
            }
        } else {
            let mut out = out.chunks_mut(S::F64_LANES);
            for ((register, group), marbles) in registers.iter_mut().zip(groups).zip(&mut marbles) {
                if group.jobs.is_empty() {
                    break;
                }
                simd.vectorize(Among {
                    register,
                    row,
                    substeps: 0..step(row),
                    marbles,
                    out: out.next().unwrap_or_default(),
                });
            }
        }
    }
    for ((register, group), out) in registers
        .iter()
        .zip(groups)
        .zip(out.chunks_mut(S::F64_LANES))
    {
        for (lane, (job, out)) in group.jobs.iter().zip(out).enumerate() {
            if let Some(fall) = out.fall.first_mut() {
                *fall = register.fall(lane, job.first);
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

/// The rollouts in the lanes of a register.
#[derive(Clone, Copy)]
pub(crate) struct LaneGroup<'a, 'b> {
    pub(crate) jobs: &'a [Job<'b>],
    /// The rollout that empty lanes repeat; their output is discarded.
    pub(crate) filler: &'a Job<'b>,
}

impl<'a, 'b> LaneGroup<'a, 'b> {
    #[inline(always)]
    fn of(self, lane: usize) -> &'a Job<'b> {
        self.jobs.get(lane).unwrap_or(self.filler)
    }
}

/// State of the rollouts of a register.
pub(crate) struct Register<S: Simd> {
    rims: Rims<S>,
    pub(crate) actuation: Actuation<S>,
    camera: Camera<S>,
    forces: Vec<Any<S>>,
    inside: Option<Box<Inside<S>>>,
}

impl<S: Simd> Register<S> {
    pub(crate) fn new(simd: S, setup: &Setup<'_>, group: LaneGroup<'_, '_>) -> Self {
        let job = |lane: usize| group.of(lane);
        let actuation = Actuation::new(simd, setup, job);
        Self {
            rims: setup.rims(simd, job),
            camera: Camera::new(simd, setup, &actuation, job),
            forces: setup.forces(simd, &actuation.tilt, job),
            inside: setup
                .obstacles
                .map(|obstacles| Box::new(Inside::new(simd, setup.rig, obstacles))),
            actuation,
        }
    }

    #[inline(always)]
    fn substeps(&self, row: usize, group: LaneGroup<'_, '_>) -> Substeps<S> {
        let (mut fewest, mut most) = (u32::MAX, 0);
        let lanes = Lanes::from_fn(self.rims.reach_x.simd(), |lane| {
            group.jobs.get(lane).map_or(0.0, |job| {
                let substeps = job.clock.step(row).substeps;
                (fewest, most) = (fewest.min(substeps), most.max(substeps));
                f64::from(substeps)
            })
        });
        Substeps {
            lanes,
            fewest,
            most,
        }
    }

    #[inline(always)]
    pub(crate) fn begin_row(&mut self, row: usize, group: LaneGroup<'_, '_>) {
        self.actuation.begin_row(row, |lane| group.of(lane));
        if let Some(schedule) = &mut self.camera.schedule {
            schedule.begin_row(row);
        }
    }

    /// Plays the commands of a row before the release of the marbles.
    #[inline(always)]
    fn wait(&mut self, row: usize, substeps: u32, group: LaneGroup<'_, '_>) {
        self.begin_row(row, group);
        let moves = self.actuation.moves();
        // A board that is constant within a row takes one step.
        let (times, substeps) = if moves { (substeps, 1) } else { (1, substeps) };
        let length = if self.forces.is_empty() {
            Lanes::splat(self.rims.reach_x.simd(), 0.0)
        } else {
            f64::from(substeps) * self.actuation.length(row, |lane| group.of(lane))
        };
        for substep in 0..times {
            if moves {
                self.actuation.substep(row, substep);
            }
            for effect in &mut self.forces {
                effect.pass(&self.actuation.tilt, length);
            }
        }
    }

    /// Releases the marbles.
    pub(crate) fn release(&self, group: LaneGroup<'_, '_>) -> Marbles<S> {
        let lanes = |value: fn(&Job<'_>) -> f64| {
            Lanes::from_fn(self.rims.reach_x.simd(), |lane| value(group.of(lane)))
        };
        let start = [lanes(|job| job.start[0]), lanes(|job| job.start[1])];
        let velocity = [
            lanes(|job| job.start_velocity[0]),
            lanes(|job| job.start_velocity[1]),
        ];
        let ([x, y], [vx, vy]) = self.camera.place(start, velocity, &self.actuation.tilt);
        let zero = vx.like(0.0);
        let mut marbles = Marbles {
            x: x.clamp(self.rims.reach_x),
            y: y.clamp(self.rims.reach_y),
            vx,
            vy,
            sx: vx,
            sy: vy,
            spin: zero,
            air: zero,
        };
        if let Some(inside) = &self.inside {
            inside.release(&mut marbles);
        }
        marbles
    }

    /// Where the camera sees marbles that are at a place (m).
    pub(crate) fn seen(&self, place: Pair<S>) -> Pair<S> {
        self.camera.see(place, &self.actuation.tilt)
    }

    /// Where the marble of a lane has fallen, that was let go in row `first`.
    pub(crate) fn fall(&self, lane: usize, first: usize) -> Option<Fall> {
        let (row, hole) = self.inside.as_ref()?.fallen[lane]?;
        Some(Fall {
            row: row + 1 - first,
            hole,
        })
    }

    fn estimator(&self, marbles: &Marbles<S>, group: LaneGroup<'_, '_>) -> Option<Estimator<S>> {
        Estimator::new(
            &self.rims,
            self.camera.edges_per_m,
            marbles,
            &self.actuation.tilt,
            group,
        )
    }

    /// Writes the observations of camera and tilt sensor at the beginning of a row.
    #[inline(always)]
    pub(crate) fn observe(
        &mut self,
        row: usize,
        marbles: &Marbles<S>,
        group: LaneGroup<'_, '_>,
        out: &mut [Sink<'_>],
    ) {
        if out.iter().any(|out| !out.tilt.is_empty()) {
            let [x, y] = self.actuation.gauged();
            let (x, y) = (x.to_array(), y.to_array());
            for (lane, (job, out)) in group.jobs.iter().zip(&mut *out).enumerate() {
                out.tilt[row - job.first] = [x[lane], y[lane]];
            }
        }
        if row > group.filler.first && self.camera.schedule.is_some() {
            return;
        }
        let seen = self
            .camera
            .see([marbles.x, marbles.y], &self.actuation.tilt);
        let (x, y) = (seen[0].to_array(), seen[1].to_array());
        for (lane, (job, out)) in group.jobs.iter().zip(out).enumerate() {
            out.marble[row - job.first] = if row == job.first {
                job.start
            } else {
                [x[lane], y[lane]]
            };
        }
    }

    /// The substeps of a row, for any kind of board.
    pub(crate) fn play(
        &mut self,
        row: usize,
        substeps: u32,
        marbles: &mut Marbles<S>,
        out: &mut [Sink<'_>],
    ) {
        if self.inside.is_some() {
            return self.rims.reach_x.simd().vectorize(Among {
                register: self,
                row,
                substeps: 0..substeps,
                marbles,
                out,
            });
        }
        for index in 0..substeps {
            self.substep::<false>(row, index, marbles, out);
        }
    }

    /// A substep, on the bare board or `INSIDE` a maze.
    #[inline(always)]
    fn substep<const INSIDE: bool>(
        &mut self,
        row: usize,
        index: u32,
        marbles: &mut Marbles<S>,
        out: &mut [Sink<'_>],
    ) {
        if self.actuation.moves() {
            self.actuation.substep(row, index);
        }
        let mut push = self.actuation.push;
        if !self.forces.is_empty() {
            let simd = self.rims.reach_x.simd();
            simd.vectorize(Acting {
                effects: &mut self.forces,
                tilt: &self.actuation.tilt,
                marbles,
                push: &mut push,
            });
        }
        let end = f64::from(index) + 1.0;
        if !self.camera.is_due(end) {
            *marbles = self.moved::<INSIDE>(marbles, &push, row);
            return;
        }
        let before = *marbles;
        *marbles = self.moved::<INSIDE>(&before, &push, row);
        let simd = self.rims.reach_x.simd();
        simd.vectorize(|| {
            let (stretch, motion) = ([end - 1.0, end], [&before, &*marbles]);
            let write = |lane: usize, row: usize, seen: [f64; 2]| {
                if let Some(out) = out.get_mut(lane) {
                    out.marble[row] = seen;
                }
            };
            self.camera
                .expose(row, stretch, motion, &self.actuation, write);
        });
    }

    /// The marbles after a substep of a row.
    #[inline(always)]
    fn moved<const INSIDE: bool>(
        &mut self,
        marbles: &Marbles<S>,
        push: &Push<S>,
        row: usize,
    ) -> Marbles<S> {
        match &mut self.inside {
            Some(inside) if INSIDE => inside.substep(&self.rims, marbles, push, row),
            _ => substep(&self.rims, marbles, push),
        }
    }
}

/// The substeps of a row among walls and holes, as a function of its own: the loop on the bare board is slow
/// where it holds all this.
struct Among<'a, 'b, S: Simd> {
    register: &'a mut Register<S>,
    row: usize,
    substeps: std::ops::Range<u32>,
    marbles: &'a mut Marbles<S>,
    out: &'a mut [Sink<'b>],
}

impl<S: Simd> NullaryFnOnce for Among<'_, '_, S> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let row = self.row;
        for index in self.substeps {
            self.register
                .substep::<true>(row, index, self.marbles, self.out);
        }
    }
}

/// The effects on marbles in a substep, in a separate function: inlined, all effects would slow down the loop over
/// substeps.
struct Acting<'a, S: Simd> {
    effects: &'a mut [Any<S>],
    tilt: &'a Pair<S>,
    marbles: &'a Marbles<S>,
    push: &'a mut Push<S>,
}

impl<S: Simd> NullaryFnOnce for Acting<'_, S> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for effect in self.effects {
            effect.pass(self.tilt, self.push.length);
            effect.act(self.marbles, self.push);
        }
    }
}

#[cfg(test)]
mod tests;
