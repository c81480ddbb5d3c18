//! The same bits on every instruction set.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use proptest::prelude::*;

use super::*;
use crate::board::{GRAVITY, Rig, SUBSTEP_S};
use crate::drive::paper_drive;
use crate::effects::{EffectInstance, EffectSpec, Parameter, known};
use crate::engine::obstacles::Obstacles;
use crate::engine::{Clock, Hold, Step};
use crate::maze::Maze;
use crate::motion::Restitution;
use crate::per_rollout::PerRollout;

/// What 29 marbles do on every instruction set that is here; `substeps` is asked for a marble's.
fn on_every_set(
    effects: &[EffectInstance<'_>],
    maze: Option<&Maze>,
    substeps: fn(i32) -> u32,
) -> Vec<Vec<[f64; 2]>> {
    let mut rig = Rig::default();
    rig.board.wall_restitution = 0.5;
    let obstacles = maze
        .and_then(|maze| Obstacles::new(maze, &rig))
        .map(Arc::new);
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
                fall: &mut [],
            })
            .collect();
        dispatch(Group {
            setup: &Setup {
                rig: &rig,
                effects,
                rows,
                hold: Hold::Zero,
                obstacles: obstacles.as_ref(),
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
    let found = on_every_set(&[], None, |i| 17 + i as u32 % 7);
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
        let found = on_every_set(one, None, |_| 19);
        let same = found.windows(2).all(|pair| pair[0] == pair[1]);
        assert!(same, "{}", one[0].effect.name);
    }
}

/// Walls along both axes and at an angle, a post and holes, where the marbles above come by.
fn maze() -> Maze {
    Maze {
        walls: vec![
            [0.05, -0.1155, 0.05, -0.06],
            [-0.06, -0.02, 0.02, -0.02],
            [-0.1, -0.08, -0.05, -0.05],
            [0.09, -0.05, 0.09, -0.05],
        ],
        wall_thickness_m: 0.005,
        holes: vec![[0.07, -0.05], [0.0, -0.08], [0.12, 0.0]],
        hole_radius_m: 0.0075,
    }
}

#[test]
fn every_instruction_set_gives_a_maze_the_same_bits() {
    let maze = maze();
    let found = on_every_set(&[], Some(&maze), |_| 19);
    let bits = |path: &Vec<[f64; 2]>| -> Vec<u64> {
        let numbers = path.as_flattened().iter();
        numbers.map(|number| number.to_bits()).collect()
    };
    assert!(
        found
            .windows(2)
            .all(|pair| bits(&pair[0]) == bits(&pair[1]))
    );
    assert!(
        found[0].iter().any(|seen| seen[0].is_nan()),
        "no marble falls"
    );
}

/// Energy over mass (m²/s²): of the motion, and of the spin by its moment of inertia.
fn energy(marbles: &Marbles<Scalar>) -> f64 {
    let square = |values: Lanes<Scalar>| values.to_array()[0].powi(2);
    let spin = square(marbles.sx) + square(marbles.sy) + square(marbles.spin);
    0.5 * (square(marbles.vx) + square(marbles.vy)) + 0.5 * 0.4 * spin
}

proptest! {
    #[test]
    fn energy_never_grows_among_walls_on_a_level_board(
        place in prop::array::uniform2(-1.0..1.0), velocity in prop::array::uniform5(-0.5..0.5),
        restitution in 0.0..1.0, falloff in 0.0..1.0, friction in 0.0..1.0, resistance in 0.0..0.002,
    ) {
        let lanes = |value: f64| Lanes::splat(Scalar::new(), value);
        let rig = Rig::default();
        let walls = Maze { holes: Vec::new(), ..maze() };
        let obstacles = Arc::new(Obstacles::new(&walls, &rig).expect("it has walls"));
        let mut inside = Inside::new(Scalar::new(), &rig, &obstacles);
        let rims = Rims {
            restitution: Restitution {
                    at_reference: lanes(restitution),
                    falloff: lanes(falloff),
                },
            friction: lanes(friction),
            ..Rims::new(Scalar::new(), &rig)
        };
        let (g, h) = (GRAVITY, SUBSTEP_S);
        let push = Push {
            x: lanes(0.0),
            y: lanes(0.0),
            normal: lanes(g),
            resistance: lanes(5.0 / 7.0 * resistance * g * h),
            grip: lanes(rig.board.sliding_friction * g * h),
            spinning: lanes(0.0),
            damping: lanes(1.0),
            length: lanes(h),
        };
        let [reach_x, reach_y] = rig.reach_m();
        let [vx, vy, sx, sy, spin] = velocity.map(lanes);
        let [x, y] = [lanes(place[0] * reach_x), lanes(place[1] * reach_y)];
        let mut marbles = Marbles { x, y, vx, vy, sx, sy, spin, air: lanes(0.0) };
        inside.release(&mut marbles);
        for _ in 0..500 {
            let before = energy(&marbles);
            marbles = inside.substep(&rims, &marbles, &push, 0);
            prop_assert!(energy(&marbles) <= before * (1.0 + 1e-12), "{before} became {}", energy(&marbles));
        }
    }
}
