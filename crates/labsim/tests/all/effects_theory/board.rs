//! The shape of the board, and forces at a distance.

use std::f64::consts::PI;

use labsim::board::GRAVITY;
use labsim::{Engine, Rig};
use proptest::prelude::*;

use super::{ENGINES, ROW, SUBSTEP, SUBSTEPS, Trial, assert_close, assert_speeds};

/// Part of a force through its centre that moves a rolling sphere.
const ROLLING: f64 = 5.0 / 7.0;

/// How far below the board a point lies that pulls (m).
const DEPTH: f64 = 0.03;

/// Half waves along x and along y of each mode of a map of slopes.
fn modes() -> Vec<[f64; 2]> {
    let of_order = |n: u32| (0..=n).map(move |j| [f64::from(n - j), f64::from(j)]);
    (1..=4).flat_map(of_order).collect()
}

/// Height of a map of slopes, and its gradient: its modes' root mean squares by hand.
fn height(coefficients: &[f64], place: [f64; 2], edges: [f64; 2]) -> (f64, [f64; 2]) {
    let (mut sum, mut gradient) = (0.0, [0.0; 2]);
    for (coefficient, waves) in coefficients.iter().zip(modes()) {
        let k = [0, 1].map(|axis| waves[axis] * PI / edges[axis]);
        let turns = [0, 1].map(|axis| k[axis] * (place[axis] + edges[axis] / 2.0));
        // Both factors have a mean square of a half, unless one has no waves.
        let mean = if waves[0] * waves[1] == 0.0 {
            0.5
        } else {
            0.25
        };
        let unit = coefficient / (mean * (k[0] * k[0] + k[1] * k[1])).sqrt();
        sum += unit * turns[0].cos() * turns[1].cos();
        gradient[0] -= unit * k[0] * turns[0].sin() * turns[1].cos();
        gradient[1] -= unit * k[1] * turns[0].cos() * turns[1].sin();
    }
    (sum, gradient)
}

/// How far a constant push moves a marble in a row, over the push (s²).
fn in_a_row() -> f64 {
    SUBSTEP * SUBSTEP * (SUBSTEPS * (SUBSTEPS + 1)) as f64 / 2.0
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn a_marble_swings_in_a_bowl(c_xx in 0.02..0.15_f64, c_yy in 0.02..0.15_f64) {
        let start = [0.05, -0.04];
        let [ox, oy] = [c_xx, c_yy].map(|c| f64::sqrt(ROLLING * GRAVITY * c));
        for (engine, _) in ENGINES {
            let trial = Trial { start, ..Trial::level(80) };
            let path = trial.with("board_warp", &[c_xx, 0.0, c_yy]).run(engine);
            for (row, place) in path.iter().enumerate() {
                // Velocities are half a substep ahead.
                let t = ROW * row as f64 + SUBSTEP / 2.0;
                assert_close(place[0], start[0] * f64::cos(ox * t), 2e-5, &format!("x at row {row} in {engine:?}"));
                assert_close(place[1], start[1] * f64::cos(oy * t), 2e-5, &format!("y at row {row} in {engine:?}"));
            }
        }
    }

    #[test]
    fn a_twisted_board_is_a_bowl_along_one_diagonal_and_a_dome_along_the_other(c in 0.05..0.15_f64) {
        let rate = f64::sqrt(ROLLING * GRAVITY * c);
        for (engine, _) in ENGINES {
            let at = |start, rows| {
                let trial = Trial { start, ..Trial::level(rows) };
                trial.with("board_warp", &[0.0, c, 0.0]).run(engine)[rows - 1]
            };
            let (swung, left) = (at([0.05, 0.05], 20), at([0.02, -0.02], 16));
            let t = |rows: f64| ROW * (rows - 1.0) + SUBSTEP / 2.0;
            for (found, sign) in left.iter().zip([1.0, -1.0]) {
                assert_close(*found, sign * 0.02 * f64::cosh(rate * t(16.0)), 5e-5, "on the dome");
            }
            for found in swung {
                assert_close(found, 0.05 * f64::cos(rate * t(20.0)), 5e-5, "in the bowl");
            }
        }
    }

    #[test]
    fn a_bump_takes_energy_and_gives_it_back(height in -4e-4..4e-4_f64, width in 0.01..0.03_f64) {
        let start = -0.1;
        let profile = |x: f64| height * f64::exp(-x * x / (2.0 * width * width));
        let speed = |x: f64| f64::sqrt(0.1 * 0.1 - 2.0 * ROLLING * GRAVITY * (profile(x) - profile(start)));
        for (engine, _) in ENGINES {
            let trial = Trial { start: [start, 0.0], velocity: [0.1, 0.0], ..Trial::level(20) };
            let path = trial.with("bump", &[0.0, 0.0, height, width]).run(engine);
            let way: Vec<f64> = path.iter().map(|place| place[0]).collect();
            assert_speeds(&way, speed, 2e-3, &format!("{engine:?}"));
            let (after, place) = ((way[19] - way[18]) / ROW, f64::midpoint(way[18], way[19]));
            assert_close(after, speed(place), 2e-4, &format!("speed behind it in {engine:?}"));
        }
    }

    #[test]
    fn a_map_of_slopes_pushes_downhill(
        coefficients in prop::collection::vec(-3e-4..3e-4_f64, 14), x in -0.12..0.12_f64, y in -0.1..0.1_f64,
    ) {
        for (engine, _) in ENGINES {
            let trial = Trial { start: [x, y], ..Trial::level(2) };
            let edges = [trial.rig.board.edge_x_m, trial.rig.board.edge_y_m];
            let (_, gradient) = height(&coefficients, [x, y], edges);
            let path = trial.with("slope_map", &coefficients).run(engine);
            for axis in 0..2 {
                let expected = -ROLLING * GRAVITY * gradient[axis] * in_a_row();
                assert_close(path[1][axis] - path[0][axis], expected, 2e-6, &format!("axis {axis} in {engine:?}"));
            }
        }
    }

    #[test]
    fn on_a_map_of_slopes_energy_stays(
        coefficients in prop::collection::vec(-2e-3..2e-3_f64, 14), heading in 0.0..6.2_f64,
    ) {
        for (engine, _) in ENGINES {
            let rows = 200;
            let trial = Trial {
                durations: Some(vec![SUBSTEP; rows]),
                velocity: [0.06 * f64::cos(heading), 0.06 * f64::sin(heading)],
                ..Trial::level(rows)
            };
            let edges = [trial.rig.board.edge_x_m, trial.rig.board.edge_y_m];
            let path = trial.with("slope_map", &coefficients).run(engine);
            let energy = |row: usize| {
                let [speeds, places] = [0, 1].map(|which| [0, 1].map(|axis| match which {
                    0 => (path[row][axis] - path[row - 1][axis]) / SUBSTEP,
                    _ => f64::midpoint(path[row][axis], path[row - 1][axis]),
                }));
                let lifted = height(&coefficients, places, edges).0;
                0.5 * (speeds[0] * speeds[0] + speeds[1] * speeds[1]) + ROLLING * GRAVITY * lifted
            };
            let begin = energy(1);
            for row in 2..rows {
                // 2 % of what the marble has.
                assert_close(energy(row), begin, 4e-5, &format!("row {row} in {engine:?}"));
            }
        }
    }

    #[test]
    fn a_point_pulls_by_its_softened_square(distance in 0.03..0.1_f64, strength in -5e-4..5e-4_f64) {
        for (engine, _) in ENGINES {
            // The marble passes from -distance towards the point in the middle.
            let potential = |x: f64| -strength / f64::hypot(x, DEPTH);
            let speed = |x: f64| f64::sqrt(0.2 * 0.2 - 2.0 * ROLLING * (potential(x) - potential(-distance)));
            let trial = Trial { start: [-distance, 0.0], velocity: [0.2, 0.0], ..Trial::level(2) };
            let path = trial.with("point_field", &[0.0, 0.0, strength]).run(engine);
            let way: Vec<f64> = path.iter().map(|place| place[0]).collect();
            assert_speeds(&way, speed, 3e-4, &format!("{engine:?}"));
            assert_eq!(path[1][1], 0.0, "it pulls along the line");
        }
    }
}

#[test]
fn each_mode_of_a_map_of_slopes_has_its_coefficient_as_root_mean_square() {
    let (size, count) = (1e-4, 10_u32);
    for mode in 0..14 {
        let mut coefficients = [0.0; 14];
        coefficients[mode] = size;
        let mut trial = Trial::level(2).with("slope_map", &coefficients);
        // So small that it gets nearly everywhere.
        trial.rig.marble.radius_m = 1e-6;
        let edges = [trial.rig.board.edge_x_m, trial.rig.board.edge_y_m];
        let squares: f64 = (0..count * count)
            .map(|i| {
                let cell =
                    [i / count, i % count].map(|i| (f64::from(i) + 0.5) / f64::from(count) - 0.5);
                trial.start = [cell[0] * edges[0], cell[1] * edges[1]];
                let path = trial.run(Engine::Rolling);
                (path[1][0] - path[0][0]).powi(2) + (path[1][1] - path[0][1]).powi(2)
            })
            .sum();
        let rms = (squares / f64::from(count * count)).sqrt() / (ROLLING * GRAVITY * in_a_row());
        assert_close(rms, size, 1e-3 * size, &format!("mode {mode}"));
    }
}

#[test]
fn a_point_beside_the_board_pulls_a_resting_marble_to_it() {
    let (x, y, strength) = (0.25, 0.15, 1e-3);
    let cube = (x * x + y * y + DEPTH * DEPTH).powf(1.5);
    for (engine, _) in ENGINES {
        let path = Trial::level(4)
            .with("point_field", &[x, y, strength])
            .run(engine);
        let n: f64 = 72.0;
        let way = ROLLING * strength / cube * SUBSTEP * SUBSTEP * n * (n + 1.0) / 2.0;
        assert_close(path[3][0], way * x, 0.02 * way * x, "along x");
        assert_close(path[3][1], way * y, 0.02 * way * y, "along y");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn a_turn_shifts_a_marble_over_the_axes_uphill_by_its_radius(
        tilt in prop::array::uniform2(-0.01..0.01_f64), rate in 40.0..200.0_f64,
    ) {
        for (engine, within) in ENGINES {
            let trial = Trial::of([vec![[0.0; 2]; 2], vec![tilt; 6]].concat());
            let (plain, turned) = (trial.run(engine), trial.with("inertial_forces", &[rate]).run(engine));
            let [dx, dy]: [f64; 2] = std::array::from_fn(|axis| turned[7][axis] - plain[7][axis]);
            let radius = Rig::default().marble.radius_m;
            assert_close(dx, -radius * tilt[1], 1e-6 + within, &format!("x in {engine:?}"));
            assert_close(dy, radius * tilt[0], 1e-6 + within, &format!("y in {engine:?}"));
        }
    }

    #[test]
    fn each_turn_throws_a_marble_outwards_by_its_square(
        tilt in 0.005..0.02_f64, rate in 40.0..200.0_f64, about_x: bool, back: bool,
    ) {
        let start = if about_x { [0.0, 0.08] } else { [-0.08, 0.0] };
        let tilt = if back { -tilt } else { tilt };
        let turned = if about_x { [tilt, 0.0] } else { [0.0, tilt] };
        // There and back within two rows, then level.
        let commands = [vec![[0.0; 2]], vec![turned], vec![[0.0; 2]; 8]].concat();
        let axis = usize::from(about_x);
        // The rate of turn falls from tilt × rate as the board follows: the integral of its square, for each turn.
        let squares = 2.0 * tilt * tilt * rate / (2.0 + rate * SUBSTEP);
        for (engine, within) in ENGINES {
            let trial = Trial { start, ..Trial::of(commands.clone()) };
            let (plain, thrown) = (trial.clone().run(engine), trial.with("inertial_forces", &[rate]).run(engine));
            let speed = ((thrown[9][axis] - plain[9][axis]) - (thrown[5][axis] - plain[5][axis])) / (4.0 * ROW);
            let expected = ROLLING * start[axis] * squares;
            assert_close(speed, expected, 0.03 * expected.abs() + 10.0 * within, &format!("{engine:?}"));
        }
    }
}
