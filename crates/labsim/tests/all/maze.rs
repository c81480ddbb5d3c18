//! Inner walls and holes.

use std::sync::atomic::AtomicBool;

use labsim::{
    Batch, Engine, Fall, Live, Maze, Parameters, PerRollout, Rig, TimeBase, effects::effect,
};
use proptest::prelude::*;

use crate::commands;

const ROWS: usize = 60;

/// Walls along both axes and at an angle, posts, and holes between them.
pub(crate) fn labyrinth() -> Maze {
    Maze {
        walls: vec![
            [-0.1, 0.1155, -0.1, 0.03],
            [-0.06, -0.02, 0.02, -0.02],
            [0.06, 0.1, 0.06, 0.02],
            [0.06, 0.02, 0.11, 0.02],
            [-0.1, -0.08, -0.05, -0.05],
            [0.03, -0.1155, 0.03, -0.06],
            [0.09, -0.06, 0.09, -0.06],
            [-0.02, 0.08, 0.02, 0.05],
        ],
        wall_thickness_m: 0.005,
        holes: vec![[-0.07, 0.02], [0.04, 0.0], [0.1, 0.04], [0.06, -0.08]],
        hole_radius_m: 0.0075,
    }
}

fn walls_alone() -> Maze {
    Maze {
        holes: Vec::new(),
        ..labyrinth()
    }
}

fn parameters() -> [Parameters; 1] {
    [[0.1, 0.1, 2e-4, 10.0, 1.0].into()]
}

fn run(batch: &Batch<'_>, engine: Engine) -> Vec<[f64; 2]> {
    batch
        .run(engine, None, &AtomicBool::new(false))
        .expect("the inputs are physical")
}

/// Distance of a place (m) from the nearest wall's surface.
fn clearance(maze: &Maze, [x, y]: [f64; 2]) -> f64 {
    let distance = |&[x0, y0, x1, y1]: &[f64; 4]| {
        let (ux, uy) = (x1 - x0, y1 - y0);
        let square = (ux * ux + uy * uy).max(1e-300);
        let part = (((x - x0) * ux + (y - y0) * uy) / square).clamp(0.0, 1.0);
        (x - x0 - part * ux).hypot(y - y0 - part * uy)
    };
    let nearest = maze.walls.iter().map(distance).fold(1.0, f64::min);
    nearest - maze.wall_thickness_m / 2.0
}

#[test]
fn a_bare_maze_and_one_that_is_not_met_leave_every_bit() {
    let rig = Rig::default();
    let (parameters, commands) = (parameters(), commands(ROWS));
    let bare = Batch::new(&rig, &parameters, &commands);
    let corner = Maze {
        walls: vec![[0.13, 0.11, 0.138, 0.11]],
        wall_thickness_m: 0.001,
        holes: vec![[-0.13, -0.107]],
        hole_radius_m: 0.007,
    };
    let gentle: Vec<[f64; 2]> = commands
        .iter()
        .map(|knobs| knobs.map(|k| 0.3 * k))
        .collect();
    for (engine, commands) in [
        (Engine::Rolling, &commands),
        (Engine::Rolling, &gentle),
        (Engine::Rapier, &gentle),
    ] {
        let bare = Batch {
            commands: PerRollout::Shared(commands),
            ..bare
        };
        let expected = run(&bare, engine);
        for maze in [&Maze::default(), &corner] {
            let with = Batch {
                maze: Some(maze),
                ..bare
            };
            assert_eq!(run(&with, engine), expected);
        }
    }
}

#[test]
fn a_wall_stops_marbles_as_a_rim_in_its_place_does() {
    // The wall's face is where the rim of the narrower board is.
    let narrow_by = 0.04;
    for (restitution, friction) in [(0.0, 0.0), (0.0, 0.25), (0.6, 0.25), (0.9, 1.0)] {
        let mut rig = Rig::default();
        rig.board.wall_restitution = restitution;
        rig.board.wall_friction = friction;
        let mut narrow = rig;
        narrow.board.edge_x_m -= 2.0 * narrow_by;
        let at = rig.board.edge_x_m / 2.0 - narrow_by + 0.0025;
        let maze = Maze {
            walls: vec![[at, -0.1155, at, 0.1155]],
            wall_thickness_m: 0.005,
            ..Maze::default()
        };
        let (parameters, commands) = (parameters(), vec![[0.003, 0.06]; 2 * ROWS]);
        for engine in [Engine::Rolling, Engine::Rapier] {
            let wide = Batch::new(&rig, &parameters, &commands);
            let beside_wall = run(
                &Batch {
                    maze: Some(&maze),
                    ..wide
                },
                engine,
            );
            let at_rim = run(&Batch::new(&narrow, &parameters, &commands), engine);
            let edges = narrow.board.edge_x_m / rig.board.edge_x_m;
            let apart = beside_wall
                .iter()
                .zip(&at_rim)
                .map(|(a, b)| (a[0] - edges * b[0]).abs().max((a[1] - edges * b[1]).abs()));
            let most = apart.fold(0.0, f64::max);
            let furthest = at_rim.iter().map(|seen| seen[0]).fold(0.0, f64::max);
            assert!(furthest > 0.46, "the rim is not met");
            let allowed = if engine == Engine::Rolling {
                1e-12
            } else {
                2e-4
            };
            assert!(
                most < allowed,
                "{engine:?} {restitution} {friction}: {most}"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_marble_enters_a_wall_at_any_speed(
        start in prop::array::uniform2(-0.3..0.3), angle in 0.0..std::f64::consts::TAU, speed in -2.0..2.5,
        restitution in 0.0..1.0, friction in 0.0..1.0, radius in 0.003..0.0068,
    ) {
        let mut rig = Rig::default();
        rig.marble.radius_m = radius;
        rig.board.wall_restitution = restitution;
        rig.board.wall_friction = friction;
        let maze = walls_alone();
        let speed = 10.0_f64.powf(speed) / rig.board.edge_x_m;
        let (parameters, commands) = (parameters(), commands(ROWS));
        let batch = Batch {
            maze: Some(&maze),
            start: PerRollout::Shared(&[start]),
            start_velocity: PerRollout::Shared(&[[speed * angle.cos(), speed * angle.sin()]]),
            // Every substep is looked at.
            time: TimeBase::Durations(PerRollout::Shared(&[1.0 / 240.0; ROWS])),
            ..Batch::new(&rig, &parameters, &commands)
        };
        for seen in &run(&batch, Engine::Rolling)[1..] {
            let place = seen.map(|edges| edges * rig.board.edge_x_m);
            let gap = clearance(&maze, place) - radius;
            prop_assert!(gap > -1e-9, "{gap} at {place:?}");
        }
    }

    #[test]
    fn no_marble_leaves_a_box_of_walls(
        corners in prop::array::uniform4(0.03..0.08), turn in 0.0..1.5, angle in 0.0..std::f64::consts::TAU,
        speed in -2.0..2.5, restitution in 0.0..1.0,
    ) {
        let mut rig = Rig::default();
        rig.board.wall_restitution = restitution;
        let corner = |i: usize| {
            let angle: f64 = turn + std::f64::consts::FRAC_PI_2 * i as f64;
            [corners[i % 4] * angle.cos(), corners[i % 4] * angle.sin()]
        };
        let maze = Maze {
            walls: (0..4).map(|i| {
                let ([x0, y0], [x1, y1]) = (corner(i), corner(i + 1));
                [x0, y0, x1, y1]
            }).collect(),
            wall_thickness_m: 0.001,
            ..Maze::default()
        };
        let inside = |[x, y]: [f64; 2]| {
            let mut sides = maze.walls.iter().map(|[x0, y0, x1, y1]| (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0));
            sides.all(|side| side > 0.0)
        };
        // The smallest box still has room for the marble in its middle.
        rig.marble.radius_m = 0.004;
        let speed = 10.0_f64.powf(speed) / rig.board.edge_x_m;
        let (parameters, commands) = (parameters(), commands(ROWS));
        let batch = Batch {
            maze: Some(&maze),
            start_velocity: PerRollout::Shared(&[[speed * angle.cos(), speed * angle.sin()]]),
            ..Batch::new(&rig, &parameters, &commands)
        };
        for seen in run(&batch, Engine::Rolling) {
            let place = seen.map(|edges| edges * rig.board.edge_x_m);
            prop_assert!(inside(place), "{place:?}");
        }
    }

    #[test]
    fn a_mirrored_labyrinth_mirrors_the_path(
        start in prop::array::uniform2(-0.3..0.3), velocity in prop::array::uniform2(-1.0..1.0), restitution in 0.0..0.9,
    ) {
        let mut rig = Rig::default();
        rig.board.wall_restitution = restitution;
        let maze = labyrinth();
        let mirrored = Maze {
            walls: maze.walls.iter().map(|[x0, y0, x1, y1]| [-x0, *y0, -x1, *y1]).collect(),
            holes: maze.holes.iter().map(|[x, y]| [-x, *y]).collect(),
            ..maze
        };
        let (parameters, commands) = (parameters(), commands(ROWS));
        let turned: Vec<[f64; 2]> = commands.iter().map(|[x, y]| [*x, -y]).collect();
        let ahead = Batch {
            maze: Some(&maze),
            start: PerRollout::Shared(&[start]),
            start_velocity: PerRollout::Shared(&[velocity]),
            ..Batch::new(&rig, &parameters, &commands)
        };
        let back = Batch {
            maze: Some(&mirrored),
            commands: PerRollout::Shared(&turned),
            start: PerRollout::Shared(&[[-start[0], start[1]]]),
            start_velocity: PerRollout::Shared(&[[-velocity[0], velocity[1]]]),
            ..ahead
        };
        let (ahead, back) = (run(&ahead, Engine::Rolling), run(&back, Engine::Rolling));
        for ([x, y], [mirrored_x, mirrored_y]) in ahead.into_iter().zip(back) {
            prop_assert!(x == -mirrored_x || x.is_nan() && mirrored_x.is_nan(), "{x} {mirrored_x}");
            prop_assert!(y == mirrored_y || y.is_nan() && mirrored_y.is_nan(), "{y} {mirrored_y}");
        }
    }
}

/// Many marbles all over the labyrinth: their starts and velocities (board edges).
fn crowd(count: usize) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    let place = |i: usize| {
        let i = i as f64;
        [0.45 * (1.7 * i).sin(), 0.38 * (2.9 * i + 1.0).sin()]
    };
    let velocity = |i: usize| [0.6 * (0.9 * i as f64).sin(), 0.6 * (1.3 * i as f64).cos()];
    (
        (0..count).map(place).collect(),
        (0..count).map(velocity).collect(),
    )
}

#[test]
fn neighbours_and_threads_change_no_bit() {
    let (rig, maze, commands) = (Rig::default(), labyrinth(), commands(ROWS));
    let count = 45;
    let parameters = vec![parameters()[0]; count];
    let (start, velocity) = crowd(count);
    for engine in [Engine::Rolling, Engine::Rapier] {
        let batch = Batch {
            maze: Some(&maze),
            start: PerRollout::Each(&start),
            start_velocity: PerRollout::Each(&velocity),
            ..Batch::new(&rig, &parameters, &commands)
        };
        let bits = |path: &[[f64; 2]]| -> Vec<u64> {
            path.as_flattened()
                .iter()
                .map(|number| number.to_bits())
                .collect()
        };
        let all = run(&batch, engine);
        let on_one = batch
            .run(engine, Some(1), &AtomicBool::new(false))
            .expect("it is physical");
        assert!(bits(&all) == bits(&on_one));
        for i in 0..count {
            let alone = Batch {
                parameters: &parameters[..1],
                start: PerRollout::Shared(&start[i..=i]),
                start_velocity: PerRollout::Shared(&velocity[i..=i]),
                ..batch
            };
            let alone = run(&alone, engine);
            assert!(
                bits(&alone) == bits(&all[i * ROWS..(i + 1) * ROWS]),
                "{engine:?} {i}"
            );
        }
    }
}

#[test]
fn a_marble_falls_where_a_hole_is_and_is_gone() {
    let (rig, maze) = (Rig::default(), labyrinth());
    let parameters = parameters();
    // Along x onto the second hole.
    let commands = [[0.0, 0.05]; ROWS];
    let falls = [Engine::Rolling, Engine::Rapier].map(|engine| {
        let batch = Batch {
            maze: Some(&maze),
            ..Batch::new(&rig, &parameters, &commands)
        };
        let found = batch
            .run_with_falls(engine, None, &AtomicBool::new(false))
            .expect("it is physical");
        let Some(Fall { row, hole }) = found.falls[0] else {
            panic!("{engine:?}: it rolled on: {:?}", found.marble);
        };
        assert_eq!(hole, 1);
        let last = found.marble[row - 1].map(|edges| edges * rig.board.edge_x_m);
        assert!((last[0] - 0.04).hypot(last[1]) < 0.012, "{last:?}");
        for (i, seen) in found.marble.iter().enumerate() {
            assert_eq!(seen[0].is_nan(), i >= row, "{engine:?}, row {i}");
            assert_eq!(seen[1].is_nan(), i >= row, "{engine:?}, row {i}");
        }
        assert!(
            found
                .tilt
                .as_flattened()
                .iter()
                .all(|angle| angle.is_finite())
        );
        row
    });
    assert!(falls[0].abs_diff(falls[1]) <= 1, "{falls:?}");
}

#[test]
fn wall_restitution_acts_at_inner_walls() {
    let (rig, maze, parameters) = (Rig::default(), walls_alone(), parameters());
    let commands = [[0.0; 2]; ROWS];
    let values = [0.5, 0.0, 0.0];
    let livelier = [labsim::EffectInstance {
        effect: effect("wall_restitution").expect("it is in the catalogue"),
        values: PerRollout::Shared(&values),
    }];
    for engine in [Engine::Rolling, Engine::Rapier] {
        let batch = Batch {
            maze: Some(&maze),
            start: PerRollout::Shared(&[[-0.1, 0.0]]),
            start_velocity: PerRollout::Shared(&[[0.0, -0.5]]),
            ..Batch::new(&rig, &parameters, &commands)
        };
        let dead = run(&batch, engine);
        let lively = run(
            &Batch {
                effects: &livelier,
                ..batch
            },
            engine,
        );
        let far = |path: &[[f64; 2]]| path[ROWS - 1][1];
        assert!(
            far(&lively) > far(&dead) + 0.02,
            "{engine:?}: {} {}",
            far(&lively),
            far(&dead)
        );
    }
}

#[test]
fn a_live_marble_has_the_bits_of_a_batch_until_it_falls_and_after() {
    let (rig, maze, parameters) = (Rig::default(), labyrinth(), parameters());
    let commands = [[0.0, 0.05]; ROWS];
    let row_s = 10.0 / 240.0;
    let batch = Batch {
        maze: Some(&maze),
        time: TimeBase::Durations(PerRollout::Shared(&[row_s; ROWS])),
        ..Batch::new(&rig, &parameters, &commands)
    };
    let found = batch
        .run_with_falls(Engine::Rolling, None, &AtomicBool::new(false))
        .expect("it is physical");
    let mut live = Live::new(
        &rig,
        Some(&maze),
        parameters[0],
        &[],
        [0.0; 2],
        (ROWS, row_s),
        0,
    )
    .expect("it is physical");
    for expected in &found.marble[1..] {
        let seen = live.play([0.0, 0.05]);
        assert_eq!(seen.map(f64::to_bits), expected.map(f64::to_bits));
    }
    assert!(live.fall().is_some());
    assert_eq!(live.fall(), found.falls[0]);
}
