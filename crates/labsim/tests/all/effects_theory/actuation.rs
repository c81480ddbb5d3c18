//! From the command to the board's angles.

use labsim::Engine;
use proptest::prelude::*;

use super::{EDGE, ENGINES, ROW, SUBSTEP, Trial, angles, assert_close};

/// The marble that shows the angles does not move; in rapier its soft contacts let it creep.
fn shows(engine: Engine) -> f64 {
    match engine {
        Engine::Rolling => 1e-10,
        Engine::Rapier => 1e-5,
    }
}

/// The knob about x at these angles, one a row, the other at rest; what is seen of an angle is that
/// of the next row.
fn about_x(effects: &[(&'static str, &[f64])], knob: &[f64]) -> Vec<Vec<f64>> {
    let mut commands: Vec<[f64; 2]> = knob.iter().map(|&x| [x, 0.0]).collect();
    commands.push([0.0; 2]);
    let run = |(engine, _)| {
        let seen = angles(engine, effects, commands.clone());
        assert_eq!(seen[0], [0.0; 2], "row 0 is the start");
        seen[1..].iter().map(|seen| seen[0]).collect()
    };
    ENGINES.map(run).to_vec()
}

fn assert_angles(effects: &[(&'static str, &[f64])], knob: &[f64], expected: &[f64]) {
    for (found, (engine, _)) in about_x(effects, knob).iter().zip(ENGINES) {
        for (row, (&found, &expected)) in found.iter().zip(expected).enumerate() {
            assert_close(
                found,
                expected,
                shows(engine),
                &format!("{effects:?}, row {row} in {engine:?}"),
            );
        }
    }
}

/// From the first to the second in so many steps, without the first.
fn sweep(from: f64, to: f64, steps: u32) -> Vec<f64> {
    (1..=steps)
        .map(|i| from + (to - from) * f64::from(i) / f64::from(steps))
        .collect()
}

/// Average of a function over the last substep of each row, given its integral from row 0.
fn last_substeps(rows: usize, integral: impl Fn(f64) -> f64) -> Vec<f64> {
    let ends = (1..=rows).map(|row| ROW * row as f64);
    ends.map(|end| (integral(end) - integral(end - SUBSTEP)) / SUBSTEP)
        .collect()
}

/// Integral of exp(-ζ τ)(C + ζ S) of a step from 0 to t: what the knob has missed of it by then (s).
///
/// By complex roots s of T² s² + 2 ζ T s + 1, or by the double root where they meet within rounding.
fn missing(time: f64, damping: f64, t: f64) -> f64 {
    let at = t / time;
    let q = 1.0 - damping * damping;
    // way'' + 2 ζ way' + way = 0 in units of T: the integral of the way is 2 ζ - way' - 2 ζ way.
    let (way, rate) = if q.abs() < 1e-7 {
        let decay = f64::exp(-at);
        (decay * (1.0 + at), -decay * at)
    } else if q > 0.0 {
        let (root, decay) = (q.sqrt(), f64::exp(-damping * at));
        let (sin, cos) = (root * at).sin_cos();
        (decay * (cos + damping / root * sin), -decay * sin / root)
    } else {
        let root = (-q).sqrt();
        let (slow, fast) = (-1.0 / (damping + root), -damping - root);
        let (a, b) = (f64::exp(slow * at), f64::exp(fast * at));
        (
            (fast * a - slow * b) / (fast - slow),
            (a - b) / (fast - slow),
        )
    };
    time * (2.0 * damping - rate - 2.0 * damping * way)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn a_lagging_knob_creeps_exponentially(step in -0.2..0.2_f64, time in 0.02..1.0_f64) {
        let expected = last_substeps(20, |t| step * (t + time * f64::exp(-t / time)));
        assert_angles(&[("lag", &[time])], &[step; 20], &expected);
    }

    #[test]
    fn each_axis_creeps_by_its_own_time_constant(step in -0.15..0.15_f64, mean in 0.02..0.5_f64, y_minus_x in -0.5..0.5_f64) {
        for (engine, _) in ENGINES {
            let seen = angles(engine, &[("lag", &[mean, y_minus_x])], vec![[step, step]; 12]);
            for (axis, sign) in [-0.5, 0.5].into_iter().enumerate() {
                let time = f64::max(mean + sign * y_minus_x, 0.0);
                let creeps = |t: f64| step * (t + if time > 0.0 { time * f64::exp(-t / time) } else { 0.0 });
                let expected = last_substeps(11, creeps);
                for (row, (seen, expected)) in seen[1..].iter().zip(expected).enumerate() {
                    assert_close(seen[axis], expected, shows(engine), &format!("axis {axis}, row {row} in {engine:?}"));
                }
            }
        }
    }

    #[test]
    fn a_servo_of_second_order_answers_a_step_by_its_closed_form(
        step in -0.1..0.1_f64, time in 0.01..0.5_f64,
        damping in prop::sample::select(vec![0.05, 0.3, 0.95, 1.0 - 1e-12, 1.0, 1.0 + 1e-5, 1.02, 1.7, 5.0]),
    ) {
        let expected = last_substeps(18, |t| step * (t - missing(time, damping, t)));
        let found = about_x(&[("second_order_lag", &[time, damping])], &[step; 18]);
        for (found, (engine, _)) in found.iter().zip(ENGINES) {
            for (row, (&found, &expected)) in found.iter().zip(&expected).enumerate() {
                assert_close(found, expected, shows(engine), &format!("row {row} in {engine:?}, {time} s, damping {damping}"));
            }
        }
    }

    #[test]
    fn a_knob_slews_in_a_ramp_and_stops(step in 0.01..0.2_f64, rate in 0.02..2.0_f64) {
        let arrives = step / rate;
        let way = |t: f64| if t < arrives { rate * t * t / 2.0 } else { step * (t - arrives / 2.0) };
        assert_angles(&[("slew_limit", &[rate])], &[step; 20], &last_substeps(20, way));
        let down = last_substeps(20, |t| -way(t));
        assert_angles(&[("slew_limit", &[rate])], &[-step; 20], &down);
    }

    #[test]
    fn a_lag_behind_a_slew_limit_trails_the_ramp_by_its_time_constant(rate in 0.02..0.1_f64, time in 0.02..0.1_f64) {
        // Of the ramp's integral what the lag withholds: T (t - T (1 - exp(-t/T))).
        let trailing = |t: f64| rate * (t * t / 2.0 - time * t + time * time * (1.0 - f64::exp(-t / time)));
        let found = about_x(&[("slew_limit", &[rate]), ("lag", &[time])], &[0.2; 18]);
        let expected = last_substeps(18, trailing);
        // The ramp reaches the lag as an average of each substep.
        let within = rate * SUBSTEP * SUBSTEP / time;
        for (row, expected) in expected.iter().enumerate() {
            assert_close(found[0][row], *expected, within, &format!("row {row}"));
        }
    }

    #[test]
    fn backlash_swallows_the_gap_after_each_reversal(top in 0.01..0.2_f64, gap in 0.001..0.3_f64) {
        let (up, down) = (sweep(0.0, top, 10), sweep(top, -top, 20));
        let rising: Vec<f64> = up.iter().map(|knob| (knob - gap / 2.0).max(0.0)).collect();
        let falling = down.iter().map(|knob| rising[9].min(knob + gap / 2.0));
        let expected: Vec<f64> = rising.iter().copied().chain(falling).collect();
        assert_angles(&[("backlash", &[gap, 0.0])], &[up, down].concat(), &expected);
    }

    #[test]
    fn a_dead_band_takes_its_half_width(knob in -0.2..0.2_f64, half_width in 0.0..0.15_f64) {
        let expected = f64::signum(knob) * (knob.abs() - half_width).max(0.0);
        assert_angles(&[("dead_band", &[half_width])], &[knob], &[expected]);
    }

    #[test]
    fn a_quantised_command_is_the_nearest_multiple_of_the_step(knob in -0.2..0.2_f64, step in 5e-4..0.02_f64) {
        let expected = step * f64::round(knob / step);
        assert_angles(&[("command_quantisation", &[step])], &[knob], &[expected]);
    }

    #[test]
    fn a_spring_adds_what_it_is_stretched_by(
        top in 0.01..0.05_f64, strength in -0.5..1.5_f64, width in 0.02..0.2_f64, jumps in 0..2_u32,
    ) {
        // Stretched, released, and stretched the other way by the rest of the turn: by small steps if each is one
        // of the law, else however the knob gets there.
        let steps = if jumps == 1 { 50 } else { 1 };
        let stretched = width * (1.0 - f64::exp(-top / width));
        let returned = -width * (1.0 - f64::exp(-(top - stretched) / width));
        let knob = [sweep(0.0, top, steps), sweep(top, 0.0, steps)].concat();
        for (found, (engine, _)) in about_x(&[("spring_hysteresis", &[strength, width, f64::from(jumps)])], &knob).iter().zip(ENGINES) {
            let within = shows(engine) + 0.03 * f64::from(jumps) * strength.abs() * top;
            let n = steps as usize;
            assert_close(found[n - 1], top + strength * stretched, within, "on the way out");
            assert_close(found[2 * n - 1], strength * returned, within, "on the way back");
            prop_assert!((found[n - 1] - top).abs() <= strength.abs() * width + within);
        }
    }

    #[test]
    fn a_spring_stretches_by_the_whole_of_a_jump_that_is_one_step(jump in -0.06..0.06_f64, strength in -0.5..1.5_f64, width in 0.005..0.2_f64) {
        assert_angles(&[("spring_hysteresis", &[strength, width, 1.0])], &[0.0, jump, jump], &[0.0, (1.0 + strength) * jump, (1.0 + strength) * jump]);
    }

    #[test]
    fn gears_follow_their_laws(knob in -0.12..0.12_f64, cubic in -60.0..60.0_f64, asymmetry in -0.3..0.3_f64) {
        assert_angles(&[("gear_nonlinearity", &[cubic])], &[knob], &[knob * (1.0 + cubic * knob * knob)]);
        let gear = if knob > 0.0 { 1.0 + asymmetry } else { 1.0 - asymmetry };
        assert_angles(&[("gear_asymmetry", &[asymmetry, 0.0])], &[knob], &[gear * knob]);
    }

    #[test]
    fn coupled_axes_tilt_by_their_shares(x in -0.1..0.1_f64, y in -0.1..0.1_f64, a in -0.3..0.3_f64, b in -0.3..0.3_f64) {
        for (engine, _) in ENGINES {
            let seen = angles(engine, &[("cross_coupling", &[a, b])], vec![[x, y]; 2])[1];
            assert_close(seen[0], x + a * y, shows(engine), "about x");
            assert_close(seen[1], y + b * x, shows(engine), "about y");
        }
    }
}

#[test]
fn each_axis_has_its_own_play_and_asymmetry() {
    for (engine, _) in ENGINES {
        let seen = angles(engine, &[("backlash", &[0.02, 0.06])], vec![[0.1, 0.1]; 2])[1];
        assert_close(seen[0], 0.09, shows(engine), "about x");
        assert_close(seen[1], 0.07, shows(engine), "about y");
        let skewed = [("gear_asymmetry", &[0.1, -0.2][..])];
        let seen = angles(engine, &skewed, vec![[0.1, 0.1]; 2])[1];
        assert_close(seen[0], 0.11, shows(engine), "about x");
        assert_close(seen[1], 0.08, shows(engine), "about y");
    }
}

#[test]
fn each_axis_has_its_own_dead_band_limit_and_nonlinearity() {
    let both =
        |engine, effect: (&'static str, &[f64])| angles(engine, &[effect], vec![[0.1, 0.1]; 2])[1];
    for (engine, _) in ENGINES {
        for (effect, expected) in [
            (("dead_band", &[0.04, 0.02][..]), [0.07, 0.05]),
            (("dead_band", &[0.02, 0.06]), [0.1, 0.05]),
            (("gear_nonlinearity", &[10.0, 40.0]), [0.09, 0.13]),
            (("gear_matrix", &[0.2, -0.5]), [0.12, 0.05]),
        ] {
            let seen = both(engine, effect);
            for axis in 0..2 {
                assert_close(
                    seen[axis],
                    expected[axis],
                    shows(engine),
                    &format!("{effect:?} in {engine:?}"),
                );
            }
        }
        // Halfway through the last substep of a row.
        let slewed = both(engine, ("slew_limit", &[0.3, 0.2]));
        for (seen, rate) in slewed.iter().zip([0.2, 0.4]) {
            assert_close(
                *seen,
                rate * (ROW - SUBSTEP / 2.0),
                shows(engine),
                "slew_limit",
            );
        }
    }
}

#[test]
fn a_gear_matrix_needs_no_gear_of_its_axis() {
    // The knob effects act on each command before the matrix does.
    for (engine, _) in ENGINES {
        let effects = [("dead_band", &[0.02][..]), ("gear_matrix", &[-0.5, 0.3])];
        let seen = angles(engine, &effects, vec![[0.12, 0.0]; 2])[1];
        assert_close(seen[0], 0.1, shows(engine), "about x");
        assert_close(seen[1], 0.03, shows(engine), "about y");
    }
}

#[test]
fn a_run_leans_by_its_own_angles_for_any_size() {
    for (engine, _) in ENGINES {
        let lean = |size| {
            Trial::level(11)
                .with("lean", &[0.001, -0.002, size])
                .run(engine)
        };
        let bias = Trial::level(11)
            .with("tilt_bias", &[0.001, -0.002])
            .run(engine);
        assert_eq!(lean(0.0), bias, "{engine:?}");
        assert_eq!(lean(0.02), bias, "{engine:?}");
    }
}

#[test]
fn a_board_that_is_not_level_leans_from_the_start() {
    for (engine, _) in ENGINES {
        let seen = angles(
            engine,
            &[("tilt_bias", &[0.01, -0.02])],
            vec![[0.1, 0.1]; 2],
        );
        // Row 0 is where the marble is seen to start; only what the command adds shows.
        assert_close(seen[1][0], 0.1, shows(engine), "about x");
        let trial = Trial::level(11).with("tilt_bias", &[0.0, 0.003]);
        let x = trial.run(engine)[10][0];
        let expected = 5.0 / 7.0 * 9.81 * f64::sin(0.003) * SUBSTEP.powi(2) * 240.0 * 241.0 / 2.0;
        assert_close(x, expected, 1e-5, "a marble on a lean board");
    }
}

#[test]
fn in_a_row_of_no_time_a_creeping_knob_stays() {
    for (engine, _) in ENGINES {
        let effects = [
            ("lag", &[0.3][..]),
            ("slew_limit", &[0.2]),
            ("second_order_lag", &[0.3, 0.5]),
        ];
        for effect in effects {
            let mut durations = vec![ROW; 8];
            durations[4] = 0.0;
            let trial = Trial {
                friction: 0.3,
                durations: Some(durations),
                ..Trial::of(vec![[0.2, 0.0]; 8])
            };
            let path = trial
                .with("parallax", &[EDGE])
                .with(effect.0, effect.1)
                .run(engine);
            // From the average over the last substep to its end at most.
            let within = 0.2 * SUBSTEP / 0.3;
            assert_close(path[5][1] / EDGE, path[4][1] / EDGE, within, effect.0);
        }
    }
}
