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
mod impact;

use pulp::{Arch, NullaryFnOnce, Scalar, Simd, WithSimd};

use self::contact::substep;
use self::estimator::Estimator;
pub(crate) use self::estimator::TAIL;
use super::actuation::Actuation;
use super::camera::Camera;
use super::{Job, Setup, Sink};
use crate::effects::Any;
use crate::lanes::Lanes;
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
                let Register {
                    rims, actuation, ..
                } = &registers[i];
                estimator.correct(row, rims, marbles, &actuation.tilt, groups[i], out);
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
        } else {
            for i in 0..step(row) {
                let mut out = out.chunks_mut(S::F64_LANES);
                for ((register, group), marbles) in
                    registers.iter_mut().zip(groups).zip(&mut marbles)
                {
                    if group.jobs.is_empty() {
                        break;
                    }
                    register.substep(row, i, marbles, out.next().unwrap_or_default());
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
}

impl<S: Simd> Register<S> {
    pub(crate) fn new(simd: S, setup: &Setup<'_>, group: LaneGroup<'_, '_>) -> Self {
        let job = |lane: usize| group.of(lane);
        let actuation = Actuation::new(simd, setup, job);
        Self {
            rims: setup.rims(simd, job),
            camera: Camera::new(simd, setup, &actuation, job),
            forces: setup.forces(simd, &actuation.tilt, job),
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
        Marbles {
            x: x.clamp(self.rims.reach_x),
            y: y.clamp(self.rims.reach_y),
            vx,
            vy,
            sx: vx,
            sy: vy,
            spin: zero,
            air: zero,
        }
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

    #[inline(always)]
    pub(crate) fn substep(
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
            *marbles = substep(&self.rims, marbles, &push);
            return;
        }
        let before = *marbles;
        *marbles = substep(&self.rims, &before, &push);
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
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::board::Rig;
    use crate::drive::paper_drive;
    use crate::effects::{EffectInstance, EffectSpec, Parameter, known};
    use crate::engine::{Clock, Hold, Step};
    use crate::per_rollout::PerRollout;

    /// What 29 marbles do on every instruction set that is here; `substeps` is asked for a marble's.
    fn on_every_set(
        effects: &[EffectInstance<'_>],
        substeps: fn(i32) -> u32,
    ) -> Vec<Vec<[f64; 2]>> {
        let mut rig = Rig::default();
        rig.board.wall_restitution = 0.5;
        let commands = paper_drive(100, 0.1, false);
        let jobs: Vec<Job<'_>> = (0..29)
            .map(|i| Job {
                rollout: 0,
                knobs_before: [0.0; 2],
                first: 10,
                seed: i as u64,
                measured: None,
                parameters: [0.003 * f64::from(i), 0.09, 0.0004, 23.0, 1.1].into(),
                commands: &commands,
                start: [0.01 * f64::from(i), -0.2],
                start_velocity: [0.3, 0.0],
                rolled: 0.0,
                turned: [0.0; 3],
                clock: Clock::Even(Step::rounded(f64::from(substeps(i)))),
            })
            .collect();
        let rows = commands.len() - 10;
        let run = |dispatch: &dyn Fn(Group<'_, '_, '_>)| {
            let mut all = vec![[0.0; 2]; jobs.len() * rows];
            let mut tilts = all.clone();
            let mut out: Vec<Sink<'_>> = all
                .chunks_mut(rows)
                .zip(tilts.chunks_mut(rows))
                .map(|(marble, tilt)| Sink {
                    marble,
                    tilt,
                    variance: &mut [],
                    corrections: &mut [],
                })
                .collect();
            dispatch(Group {
                setup: &Setup {
                    rig: &rig,
                    effects,
                    rows,
                    hold: Hold::Zero,
                    cancel: &AtomicBool::new(false),
                },
                jobs: &jobs,
                out: &mut out,
            });
            all.append(&mut tilts);
            all
        };
        let mut found = vec![
            run(&|group| group.with_simd(Scalar)),
            run(&|group| Arch::new().dispatch(group)),
        ];
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = pulp::x86::V3::try_new() {
            found.push(run(&|group| pulp::Simd::vectorize(avx2, group)));
        }
        found
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let found = on_every_set(&[], |i| 17 + i as u32 % 7);
        assert!(found.windows(2).all(|pair| pair[0] == pair[1]));
    }

    #[test]
    fn every_instruction_set_gives_effects_the_same_bits() {
        let middle = |about: &EffectSpec, answer: f64| -> Vec<f64> {
            let value = |one: &Parameter| match one.range {
                _ if one.is_choice() => answer,
                (low, high) => low + 0.4 * (high - low),
            };
            about.parameters.iter().map(value).collect()
        };
        // Those that ask for a choice twice, with either answer.
        let values: Vec<(&EffectSpec, Vec<f64>)> = known()
            .flat_map(|about| {
                let mut both = vec![middle(about, 0.0), middle(about, 1.0)];
                both.dedup();
                both.into_iter().map(move |values| (about, values))
            })
            .collect();
        let chosen: Vec<EffectInstance<'_>> = values
            .iter()
            .map(|(effect, values)| EffectInstance {
                effect,
                values: PerRollout::Shared(values),
            })
            .collect();
        for one in chosen.chunks(1).chain([&chosen[..]]) {
            let found = on_every_set(one, |_| 19);
            let same = found.windows(2).all(|pair| pair[0] == pair[1]);
            assert!(same, "{}", one[0].effect.name);
        }
    }
}
