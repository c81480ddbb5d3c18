//! The shape of the board, and forces at a distance.

use labsim::board::GRAVITY;
use proptest::prelude::*;

use crate::{ENGINES, ROW, SUBSTEP, Trial, assert_close, assert_speeds};

/// Part of a force through its centre that moves a rolling sphere.
const ROLLING: f64 = 5.0 / 7.0;

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
    fn a_point_pulls_by_its_softened_square(distance in 0.03..0.1_f64, strength in -2e-4..2e-4_f64) {
        for (engine, _) in ENGINES {
            // The marble passes from -distance towards the point in the middle.
            let radius = Trial::level(1).rig.marble.radius_m;
            let potential = |x: f64| -strength / f64::hypot(x, radius);
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
fn a_point_beside_the_board_pulls_a_resting_marble_to_it() {
    let (x, y, strength) = (0.25, 0.15, 1e-3);
    let radius = Trial::level(1).rig.marble.radius_m;
    let cube = (x * x + y * y + radius * radius).powf(1.5);
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
