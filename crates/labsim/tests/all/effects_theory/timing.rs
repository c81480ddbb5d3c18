//! When things happen.

use labsim::Engine;
use proptest::prelude::*;

use super::{ENGINES, ROW, SUBSTEP, SUBSTEPS, Trial, angles, assert_close};

const TILT: f64 = 0.004;

/// Acceleration on the tilt (m/s²).
fn acceleration() -> f64 {
    5.0 / 7.0 * 9.81 * f64::sin(TILT)
}

/// A knob that turns as row 0 begins, and stays.
fn step(rows: usize) -> Trial {
    Trial::of(vec![[0.0, TILT]; rows])
}

/// Where a marble is that a step has driven since it came `late`, by the engine's sum over substeps.
fn driven(row: usize, late: f64) -> f64 {
    let velocity = |n: usize| acceleration() * (SUBSTEP * n as f64 - late).max(0.0);
    (1..=row * SUBSTEPS).map(|n| velocity(n) * SUBSTEP).sum()
}

/// When the step came, by how fast the marble was at the end of the first row.
fn lateness(seed: u64, delay: f64, sd: f64) -> f64 {
    let trial = Trial {
        seed,
        ..step(3).with("delay", &[delay]).with("delay_jitter", &[sd])
    };
    let path = trial.run(Engine::Rolling);
    let n = SUBSTEPS as f64;
    let gained = acceleration() * SUBSTEP * SUBSTEP * n * (n + 1.0) / 2.0;
    let velocity = (path[2][0] - path[1][0] - gained) / ROW;
    ROW - velocity / acceleration()
}

fn mean(of: &[f64]) -> f64 {
    of.iter().sum::<f64>() / of.len() as f64
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn a_delay_shifts_the_answer_to_a_step(delay in 0.0..0.6_f64) {
        for (engine, within) in ENGINES {
            let path = step(12).with("delay", &[delay]).run(engine);
            for (row, place) in path.iter().enumerate() {
                assert_close(place[0], driven(row, delay), within, &format!("row {row} in {engine:?}"));
            }
        }
    }

    #[test]
    fn each_axis_is_shifted_by_its_own_delay(delay in 0.0..0.4_f64, y_minus_x in -0.3..0.3_f64) {
        for (engine, within) in ENGINES {
            let both = Trial::of(vec![[-TILT, TILT]; 12]);
            let path = both.with("delay", &[delay, y_minus_x]).run(engine);
            // A knob about x moves the marble along y.
            let late = [delay + y_minus_x / 2.0, delay - y_minus_x / 2.0].map(|late| late.max(0.0));
            for (row, place) in path.iter().enumerate() {
                // Gravity turns about x first: along y it has the cosine of the tilt about y.
                for axis in 0..2 {
                    let within = within + 1e-5 * place[axis].abs();
                    assert_close(place[axis], driven(row, late[axis]), within, &format!("axis {axis}, row {row} in {engine:?}"));
                }
            }
        }
    }

    /// Positions show the total delay of a response, not where it arises.
    #[test]
    fn from_rest_a_late_picture_is_a_late_command(late in 0.0..0.3_f64) {
        for (engine, within) in ENGINES {
            let [picture, command] =
                ["latency", "delay"].map(|effect| step(12).with(effect, &[late]).run(engine));
            // A picture between two substeps is interpolated.
            let within = within + acceleration() * SUBSTEP * SUBSTEP / 4.0;
            for (row, (picture, command)) in picture.iter().zip(&command).enumerate() {
                assert_close(picture[0], command[0], within, &format!("row {row} in {engine:?}"));
            }
        }
    }

    #[test]
    fn a_drifting_clock_stretches_each_row_more_and_agrees_at_the_end(drift in -0.2..0.2_f64) {
        for (engine, within) in ENGINES {
            let trial = Trial { velocity: [0.05, -0.03], ..Trial::level(21) };
            let path = trial.with("clock_drift", &[drift]).run(engine);
            for (row, place) in path.iter().enumerate() {
                let k = row as f64;
                let time = ROW * (k + drift * k * (k - 20.0) / 2.0 / 20.0);
                assert_close(place[0], 0.05 * time, within, &format!("x at row {row} in {engine:?}"));
                assert_close(place[1], -0.03 * time, within, &format!("y at row {row} in {engine:?}"));
            }
        }
    }
}

#[test]
fn a_delay_of_whole_rows_is_a_shift_of_the_commands() {
    let commands: Vec<[f64; 2]> = (0..40)
        .map(|i| {
            [
                0.01 * f64::sin(0.7 * f64::from(i)),
                0.008 * f64::cos(0.3 * f64::from(i)),
            ]
        })
        .collect();
    let mut shifted = vec![[0.0; 2]; 3];
    shifted.extend(&commands[..37]);
    for (engine, _) in ENGINES {
        let late = Trial::of(commands.clone()).with("delay", &[3.0 * ROW]);
        let (late, shifted) = (late.run(engine), Trial::of(shifted.clone()).run(engine));
        for (row, (late, shifted)) in late.iter().zip(&shifted).enumerate() {
            for axis in 0..2 {
                assert_close(
                    late[axis],
                    shifted[axis],
                    1e-11,
                    &format!("row {row} in {engine:?}"),
                );
            }
        }
    }
}

/// Commands that overtake others do so about each axis by themselves.
#[test]
fn delays_by_axis_are_delays_of_each_axis_alone() {
    let commands: Vec<[f64; 2]> = (0..40)
        .map(|i| [0.02 * f64::sin(f64::from(i)), 0.01 * f64::cos(f64::from(i))])
        .collect();
    for (delay, y_minus_x) in [(0.16, 0.1), (0.05, -0.3)] {
        let apart = angles(
            Engine::Rolling,
            &[("delay", &[delay, y_minus_x])],
            commands.clone(),
        );
        for axis in 0..2 {
            let late = f64::max(0.0, delay + [-0.5, 0.5][axis] * y_minus_x);
            let tied = angles(Engine::Rolling, &[("delay", &[late])], commands.clone());
            for (row, (apart, tied)) in apart.iter().zip(&tied).enumerate() {
                assert_close(
                    apart[axis],
                    tied[axis],
                    1e-12,
                    &format!("axis {axis}, row {row}"),
                );
            }
        }
    }
}

#[test]
fn late_commands_scatter_about_the_delay() {
    let (delay, sd) = (0.04, 0.008);
    let late: Vec<f64> = (0..2000).map(|seed| lateness(seed, delay, sd)).collect();
    let spread = mean(
        &late
            .iter()
            .map(|late| (late - delay).powi(2))
            .collect::<Vec<_>>(),
    )
    .sqrt();
    assert_close(mean(&late), delay, 0.1 * sd, "mean");
    assert_close(spread, sd, 0.05 * sd, "standard deviation");
}

#[test]
fn without_a_delay_half_the_commands_are_in_time() {
    let sd = 0.02;
    let late: Vec<f64> = (0..2000).map(|seed| lateness(seed, 0.0, sd)).collect();
    let in_time = late.iter().filter(|late| late.abs() < 1e-9).count();
    assert!((920..1080).contains(&in_time), "{in_time} of 2000");
    // The mean of max(0, N(0, sd)) is sd/√(2π).
    assert_close(
        mean(&late),
        sd / f64::sqrt(std::f64::consts::TAU),
        0.05 * sd,
        "mean",
    );
}

#[test]
fn equal_seeds_draw_equal_delays_in_both_engines() {
    let commands: Vec<[f64; 2]> = (0..20)
        .map(|i| [0.01 * f64::sin(f64::from(i)), 0.0])
        .collect();
    let trial = |seed| Trial {
        seed,
        ..Trial::of(commands.clone()).with("delay_jitter", &[0.05])
    };
    let [rolling, rapier] = ENGINES.map(|(engine, _)| trial(5).run(engine));
    for (a, b) in rolling.iter().zip(&rapier) {
        assert_close(a[1], b[1], 2e-5, "one engine and the other");
    }
    assert_ne!(trial(6).run(Engine::Rolling), rolling);
}

#[test]
fn a_coasting_marble_is_seen_where_it_would_be_without_latency() {
    // It is ahead of its picture from the start.
    for (engine, within) in ENGINES {
        let trial = Trial {
            velocity: [0.06, 0.02],
            ..Trial::level(15)
        };
        let path = trial.with("latency", &[0.25]).run(engine);
        for (row, place) in path.iter().enumerate() {
            let time = ROW * row as f64;
            assert_close(
                place[0],
                0.06 * time,
                within,
                &format!("x at row {row} in {engine:?}"),
            );
            assert_close(
                place[1],
                0.02 * time,
                within,
                &format!("y at row {row} in {engine:?}"),
            );
        }
    }
}
