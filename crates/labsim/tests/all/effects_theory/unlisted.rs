//! Profiles of push, drag and gears, powers of the speed, the mode, and the drive that yields.

use labsim::Engine;
use labsim::board::GRAVITY;
use labsim::effects::effect;
use proptest::prelude::*;

use super::{ENGINES, ROW, SUBSTEP, SUBSTEPS, Trial, assert_close, assert_speeds, integral};

/// Every parameter, neutral but for those named.
fn values(named: &[(&str, f64)]) -> Vec<f64> {
    let about = effect("unlisted").expect("it is known");
    let value = |name: &str| named.iter().find(|(other, _)| *other == name);
    let known = |name: &str| about.parameters.iter().any(|one| one.name == name);
    assert!(named.iter().all(|(name, _)| known(name)), "{named:?}");
    let of = about.parameters.iter();
    of.map(|one| value(one.name).map_or(one.neutral, |(_, value)| *value))
        .collect()
}

pub(super) fn unlisted(trial: Trial, named: &[(&str, f64)]) -> Trial {
    trial.with("unlisted", &values(named))
}

fn along_x(path: &[[f64; 2]]) -> Vec<f64> {
    path.iter().map(|place| place[0]).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn a_marble_swings_in_the_trough_of_a_wave(push in 0.02..0.1_f64, wave in 10.0..40.0_f64) {
        // -push sin(wave y) = push cos(wave y + 90°) on small ways.
        let (start, rate) = (0.002, f64::sqrt(push * wave));
        let named = [("push_3_y_m_per_s2", push), ("wave_3_y_per_m", wave), ("phase_3_rad", 0.5 * std::f64::consts::PI)];
        for (engine, _) in ENGINES {
            let path = unlisted(Trial { start: [0.0, start], ..Trial::level(40) }, &named).run(engine);
            for (row, place) in path.iter().enumerate() {
                // Velocities are half a substep ahead.
                let t = ROW * row as f64 + SUBSTEP / 2.0;
                assert_close(place[1], start * f64::cos(rate * t), 2e-5, &format!("row {row} in {engine:?}"));
                assert_close(place[0], 0.0, 1e-9, "it pushes along y");
            }
        }
    }

    #[test]
    fn a_standing_wave_takes_energy_and_gives_it_back(push in -0.05..0.05_f64, wave in 50.0..150.0_f64, phase in 0.0..6.2_f64) {
        let (start, speed) = (-0.08, 0.12);
        let work = |x: f64| push / wave * (f64::sin(wave * x + phase) - f64::sin(wave * start + phase));
        let speeds = |x: f64| f64::sqrt(speed * speed + 2.0 * work(x));
        let named = [("push_1_x_m_per_s2", push), ("wave_1_x_per_m", wave), ("phase_1_rad", phase)];
        for (engine, _) in ENGINES {
            let trial = Trial { start: [start, 0.0], velocity: [speed, 0.0], ..Trial::level(13) };
            let way = along_x(&unlisted(trial, &named).run(engine));
            assert_speeds(&way, speeds, 4e-3, &format!("{engine:?}"));
        }
    }

    #[test]
    fn waves_add_up_and_a_push_of_time_is_its_own_integral(
        pushes in prop::array::uniform3(-0.1..0.1_f64), rates in prop::array::uniform3(-60.0..60.0_f64),
        phases in prop::array::uniform3(0.0..6.2_f64),
    ) {
        let push = |t: f64| -> f64 { (0..3).map(|i| pushes[i] * f64::cos(rates[i] * t + phases[i])).sum() };
        let named = [
            ("push_1_x_m_per_s2", pushes[0]), ("rate_1_per_s", rates[0]), ("phase_1_rad", phases[0]),
            ("push_2_x_m_per_s2", pushes[1]), ("rate_2_per_s", rates[1]), ("phase_2_rad", phases[1]),
            ("push_3_x_m_per_s2", pushes[2]), ("rate_3_per_s", rates[2]), ("phase_3_rad", phases[2]),
        ];
        for (engine, within) in ENGINES {
            let path = unlisted(Trial::level(10), &named).run(engine);
            let (mut place, mut speed) = (0.0, 0.0);
            for n in 0..9 * SUBSTEPS {
                if n % SUBSTEPS == 0 {
                    assert_close(path[n / SUBSTEPS][0], place, within, &format!("row {} in {engine:?}", n / SUBSTEPS));
                }
                speed += SUBSTEP * push(SUBSTEP * n as f64);
                place += SUBSTEP * speed;
            }
            // The integral by time, from places that are as old as the velocities.
            let end = 9.0 * ROW;
            let way = integral(0.0, end, |t| (end - t) * push(t));
            assert_close(path[9][0], way, 0.3 * end * SUBSTEP, &format!("{engine:?}"));
        }
    }

    #[test]
    fn a_wave_that_travels_as_the_marble_rolls_pushes_it_evenly_at_first(phase in 0.0..6.2_f64) {
        // In the frame of the wave the marble stands still.
        let (speed, wave, push) = (0.1, 30.0, 0.002);
        let named = [
            ("push_2_y_m_per_s2", push), ("wave_2_x_per_m", wave), ("rate_2_per_s", -speed * wave), ("phase_2_rad", phase),
        ];
        for (engine, within) in ENGINES {
            let trial = Trial { velocity: [speed, 0.0], ..Trial::level(11) };
            let path = unlisted(trial, &named).run(engine);
            let n: f64 = 240.0;
            let way = push * f64::cos(phase) * SUBSTEP * SUBSTEP * n * (n + 1.0) / 2.0;
            assert_close(path[10][1], way, 2.0 * within, &format!("{engine:?}"));
        }
    }

    #[test]
    fn a_wave_over_the_velocity_pushes_evenly_what_rolls_evenly(swift in -80.0..80.0_f64, phase in 0.0..6.2_f64) {
        let (speed, push) = (0.1, 0.002);
        let named = [("push_4_y_m_per_s2", push), ("velocity_4_x_s_per_m", swift), ("phase_4_rad", phase)];
        for (engine, within) in ENGINES {
            let trial = Trial { velocity: [speed, 0.0], ..Trial::level(11) };
            let path = unlisted(trial, &named).run(engine);
            let n: f64 = 240.0;
            let way = push * f64::cos(swift * speed + phase) * SUBSTEP * SUBSTEP * n * (n + 1.0) / 2.0;
            assert_close(path[10][1], way, 2.0 * within, &format!("{engine:?}"));
        }
    }

    #[test]
    fn a_wave_over_the_tilt_pushes_as_long_as_the_board_stands(knob in -0.02..0.02_f64, by in -900.0..900.0_f64, phase in 0.0..6.2_f64) {
        // A turn about x drives the marble along y: what moves it along x is the wave alone.
        let push = 0.004;
        let named = [("push_5_x_m_per_s2", push), ("tilt_5_x_per_rad", by), ("phase_5_rad", phase)];
        for (engine, within) in ENGINES {
            let trial = Trial::of(vec![[knob, 0.0]; 9]);
            let path = unlisted(trial, &named).run(engine);
            let n: f64 = 192.0;
            let way = push * f64::cos(by * knob + phase) * SUBSTEP * SUBSTEP * n * (n + 1.0) / 2.0;
            assert_close(path[8][0], way, 4.0 * within, &format!("{engine:?}"));
        }
    }

    #[test]
    fn drag_with_the_first_and_second_power_is_that_of_the_catalogue(strength in 0.001..0.15_f64) {
        let with = |effect, values: &[f64]| Trial { velocity: [0.04, 0.03], ..Trial::level(20) }.with(effect, values);
        for (engine, within) in ENGINES {
            let drag = |power| unlisted(Trial { velocity: [0.04, 0.03], ..Trial::level(20) },
                &[("drag_strength", strength), ("drag_power", power)]).run(engine);
            // Rapier damps a velocity once the marble has moved by it; 1/(1 + c h) is not quite the exponential.
            let (later, rate) = (if engine == Engine::Rapier { 0.05 * SUBSTEP } else { 0.0 }, strength / 0.1);
            for (power, law, parameter, steps) in [
                (1.0, "viscous_drag", rate, 0.05 * rate * SUBSTEP),
                (2.0, "quadratic_drag", rate / 0.1, 0.0),
            ] {
                let (found, expected) = (drag(power), with(law, &[parameter]).run(engine));
                for (row, (found, expected)) in found.iter().zip(&expected).enumerate() {
                    for axis in 0..2 {
                        let what = format!("{law}, row {row} in {engine:?}");
                        assert_close(found[axis], expected[axis], within + later + steps, &what);
                    }
                }
            }
        }
    }

    #[test]
    fn drag_slows_by_its_power(power in 0.0..4.0_f64, strength in 0.01..0.1_f64) {
        prop_assume!((power - 1.0).abs() > 0.05);
        let fall = strength / f64::powf(0.1, power);
        let speed = |t: f64| {
            let left = f64::powf(0.15, 1.0 - power) - (1.0 - power) * fall * t;
            if left > 0.0 { f64::powf(left, 1.0 / (1.0 - power)) } else { 0.0 }
        };
        for (engine, _) in ENGINES {
            let trial = Trial { velocity: [-0.15, 0.0], start: [0.1, 0.0], ..Trial::level(13) };
            let path = unlisted(trial, &[("drag_strength", strength), ("drag_power", power)]).run(engine);
            for (row, place) in path.iter().enumerate() {
                let way = integral(0.0, ROW * row as f64, speed);
                assert_close(0.1 - place[0], way, 0.15 * SUBSTEP, &format!("row {row} in {engine:?}"));
            }
        }
    }

    #[test]
    fn a_negative_drag_of_power_zero_drives_evenly_and_leaves_a_resting_marble(strength in 0.01..0.05_f64) {
        let named = [("drag_strength", -strength), ("drag_power", 0.0)];
        for (engine, within) in ENGINES {
            let trial = Trial { velocity: [0.03, -0.04], ..Trial::level(11) };
            let path = unlisted(trial, &named).run(engine);
            let n: f64 = 240.0;
            let way = 0.05 + strength * SUBSTEP * SUBSTEP * n * (n + 1.0) / 2.0;
            assert_close(path[10][0], 0.6 * way, 2.0 * within, &format!("x in {engine:?}"));
            assert_close(path[10][1], -0.8 * way, 2.0 * within, &format!("y in {engine:?}"));
            prop_assert_eq!(unlisted(Trial::level(4), &named).run(engine), vec![[0.0; 2]; 4]);
        }
    }

    #[test]
    fn a_side_push_turns_the_velocity_by_its_power(power in 0.0..4.0_f64, strength in 0.02..0.1_f64, left: bool) {
        let (speed, sign) = (0.06, if left { 1.0 } else { -1.0 });
        let rate = sign * strength * f64::powf(speed / 0.1, power) / speed;
        for (engine, _) in ENGINES {
            let trial = Trial { velocity: [speed, 0.0], ..Trial::level(15) };
            let path = unlisted(trial, &[("side_strength", sign * strength), ("side_power", power)]).run(engine);
            for (row, place) in path.iter().enumerate() {
                let angle = rate * ROW * row as f64;
                let what = format!("row {row} in {engine:?}");
                assert_close(place[0], speed / rate * f64::sin(angle), speed * SUBSTEP + 1e-4, &what);
                assert_close(place[1], speed / rate * (1.0 - f64::cos(angle)), speed * SUBSTEP + 1e-4, &what);
            }
        }
    }

    #[test]
    fn every_shape_over_the_board_takes_energy_and_gives_it_back(
        shape in 0..8_usize, push in -0.03..0.03_f64, vector in 20.0..60.0_f64, phase in -2.0..2.0_f64,
    ) {
        let (start, speed) = (-0.06, 0.14);
        let named = [
            ("shape_2", shape as f64), ("push_2_x_m_per_s2", 0.2 * push), ("wave_2_x_per_m", vector),
            ("phase_2_rad", phase), ("across_2_rad", 0.5),
        ];
        let profile = |x: f64| profiles(vector * x + phase, 0.5)[shape];
        let speeds = |x: f64| f64::sqrt(speed * speed + 2.0 * integral(start, x, |x| 0.2 * push * profile(x)));
        prop_assume!((0..=24).all(|i| speeds(start + 0.005 * f64::from(i)) > 0.08));
        for (engine, _) in ENGINES {
            let trial = Trial { start: [start, 0.0], velocity: [speed, 0.0], ..Trial::level(11) };
            let way = along_x(&unlisted(trial, &named).run(engine));
            assert_speeds(&way, speeds, 6e-3, &format!("shape {shape} in {engine:?}"));
        }
    }

    #[test]
    fn a_saddle_over_the_tilt_pushes_by_the_product_of_both_angles(
        x in -0.02..0.02_f64, y in -0.003..0.003_f64, push in -0.1..0.1_f64,
    ) {
        let named = [("shape_4", 7.0), ("push_4_y_m_per_s2", push), ("tilt_4_x_per_rad", 60.0)];
        for (engine, within) in ENGINES {
            let plain = Trial::of(vec![[x, y]; 7]);
            let (path, without) = (unlisted(plain.clone(), &named).run(engine), plain.run(engine));
            let n: f64 = 144.0;
            let way = push * 3600.0 * x * y * SUBSTEP * SUBSTEP * n * (n + 1.0) / 2.0;
            assert_close(path[6][1] - without[6][1], way, 4.0 * within, &format!("{engine:?}"));
        }
    }

    #[test]
    fn a_round_spot_brakes_by_where_the_marble_is(
        brake in 0.01..0.08_f64, radius in 0.015..0.04_f64, x in -0.03..0.03_f64, y in -0.03..0.03_f64,
    ) {
        // A drag of the first power takes as much speed on each way at any speed.
        let (start, speed) = (-0.08, 0.15);
        let bell = |at: f64| f64::exp(-0.5 * ((at - x).powi(2) + y.powi(2)) / radius.powi(2));
        let named = [
            ("shape_1", 4.0), ("brake_1_m_per_s2", brake), ("wave_1_x_per_m", 1.0 / radius),
            ("phase_1_rad", -x / radius), ("across_1_rad", -y / radius), ("drag_power", 1.0),
        ];
        let speeds = |at: f64| speed - integral(start, at, |at| brake / 0.1 * bell(at));
        for (engine, _) in ENGINES {
            let trial = Trial { start: [start, 0.0], velocity: [speed, 0.0], ..Trial::level(10) };
            let way = along_x(&unlisted(trial, &named).run(engine));
            prop_assume!(speeds(way[9]) > 0.05);
            assert_speeds(&way, speeds, 6e-3, &format!("{engine:?}"));
        }
    }

    #[test]
    fn a_drag_may_grow_with_the_way_that_the_marble_has_rolled(by in 0.1..1.0_f64, rolled in 0.0..0.5_f64, angle in 0.0..6.2_f64) {
        let speed = 0.15;
        let named = [
            ("shape_5", 5.0), ("brake_5_m_per_s2", 0.05), ("way_5_per_m", by), ("drag_power", 0.0),
        ];
        let fall = |way: f64| 0.05 * by * (rolled * way + 0.5 * way * way);
        let speeds = |way: f64| f64::sqrt(speed * speed - 2.0 * fall(way));
        prop_assume!(fall(0.15) < 0.4 * speed * speed);
        for (engine, _) in ENGINES {
            let velocity = [speed * f64::cos(angle), speed * f64::sin(angle)];
            let start = velocity.map(|v| -0.5 * v);
            let trial = Trial { start, velocity, rolled, ..Trial::level(10) };
            let path = unlisted(trial, &named).run(engine);
            let way: Vec<f64> = path.iter().map(|[x, y]| f64::hypot(x - start[0], y - start[1])).collect();
            assert_speeds(&way, speeds, 6e-3, &format!("{engine:?}"));
        }
    }

    #[test]
    fn a_drag_may_depend_on_the_direction_of_motion(share in -0.9..0.9_f64, back: bool) {
        let (speed, drag) = (if back { -0.12 } else { 0.12 }, 0.03);
        let named = [
            ("shape_1", 5.0), ("brake_1_m_per_s2", drag), ("heading_1_x", share), ("phase_1_rad", 1.0),
            ("drag_power", 0.0),
        ];
        let fall = drag * (1.0 + share * f64::signum(speed));
        for (engine, within) in ENGINES {
            let trial = Trial { velocity: [speed, 0.0], ..Trial::level(9) };
            let path = unlisted(trial, &named).run(engine);
            let n: f64 = 192.0;
            let way = speed.abs() * 8.0 * ROW - fall * SUBSTEP * SUBSTEP * n * (n + 1.0) / 2.0;
            assert_close(path[8][0], f64::signum(speed) * way, 4.0 * within, &format!("{engine:?}"));
        }
    }

    #[test]
    fn gears_may_change_with_time(x in -0.01..0.01_f64, y in -0.01..0.01_f64, gears in prop::array::uniform2(-0.5..0.5), rate in 0.1..2.0_f64) {
        let named = [
            ("shape_2", 5.0), ("rate_2_per_s", rate), ("gear_2_x", gears[0]), ("gear_2_y", gears[1]),
        ];
        for (engine, within) in ENGINES {
            let plain = Trial::of(vec![[x, y]; 8]);
            let (path, without) = (unlisted(plain.clone(), &named).run(engine), plain.run(engine));
            let way = 5.0 / 7.0 * GRAVITY * rate * (7.0 * ROW).powi(3) / 6.0;
            // A substep early or late is a part of the way; a turn about y pushes along x, one about x against y.
            let within = 4.0 * within + 0.02 * way * f64::max(x.abs(), y.abs());
            assert_close(path[7][0] - without[7][0], way * gears[1] * y, within, &format!("{engine:?}"));
            assert_close(path[7][1] - without[7][1], -way * gears[0] * x, within, &format!("{engine:?}"));
        }
    }

    #[test]
    fn a_picture_turns_and_grows_by_the_tilt(
        knob in prop::array::uniform2(-0.1..0.1_f64), place in prop::array::uniform2(-0.08..0.08_f64),
        turn in prop::array::uniform2(-30.0..30.0_f64), growth in prop::array::uniform2(-2.0..2.0_f64),
    ) {
        let named = [
            ("picture_turn_x", turn[0]), ("picture_turn_y", turn[1]),
            ("picture_growth_x_per_rad", growth[0]), ("picture_growth_y_per_rad", growth[1]),
        ];
        let by = |rates: [f64; 2]| rates[0] * knob[0] + rates[1] * knob[1];
        let ((sin, cos), size) = (f64::sin_cos(by(turn)), 1.0 + by(growth));
        for (engine, _) in ENGINES {
            // Friction holds the marble.
            let trial = Trial { friction: 0.3, start: place, ..Trial::of(vec![knob; 2]) };
            let seen = unlisted(trial, &named).run(engine)[1];
            let within = if engine == Engine::Rolling { 1e-12 } else { 1e-5 };
            assert_close(seen[0], size * (place[0] * cos - place[1] * sin), within, "along x");
            assert_close(seen[1], size * (place[0] * sin + place[1] * cos), within, "along y");
        }
    }

    #[test]
    fn a_mode_swings_after_a_knob_that_jumps(rate in 3.0..25.0_f64, damping in 0.0..0.9_f64, gain in -1.0..1.0_f64) {
        let (knob, first) = (0.006, 3);
        let commands = (0..16).map(|row| [0.0, if row < first { 0.0 } else { knob }]).collect();
        let (fade, ringing) = (rate * damping, rate * f64::sqrt(1.0 - damping * damping));
        // How far the board is from where it settles.
        let away = |t: f64| {
            -knob * f64::exp(-fade * t) * (f64::cos(ringing * t) + fade / ringing * f64::sin(ringing * t))
        };
        let plain = Trial::of(commands);
        let named = [("mode_gain", gain), ("mode_rate_rad_per_s", rate), ("mode_damping", damping)];
        for (engine, _) in ENGINES {
            let path = unlisted(plain.clone(), &named).run(engine);
            let rigid = plain.run(engine);
            let end = ROW * f64::from(15 - first);
            let way = 5.0 / 7.0 * GRAVITY * gain * integral(0.0, end, |t| (end - t) * away(t));
            let found = path[15][0] - rigid[15][0];
            assert_close(found, way, 0.02 * way.abs() + 1e-4, &format!("{engine:?}"));
            assert_close(path[15][1], 0.0, 1e-7, "it swings about y alone");
        }
    }

    #[test]
    fn a_drive_that_yields_follows_late_and_gains_its_angle_as_it_slows(lag in 0.05..0.3_f64, lost in -0.5..1.0_f64, slowness in 0.0..200.0_f64) {
        let (knob, first) = (0.006, 3);
        let commands = (0..16).map(|row| [0.0, if row < first { 0.0 } else { knob }]).collect();
        let late = |t: f64| f64::exp(-t / lag);
        let bell = |t: f64| f64::exp(-0.5 * (slowness * knob / lag * late(t)).powi(2));
        let away = |t: f64| knob * ((1.0 - late(t)) * (1.0 - lost * (1.0 - bell(t))) - 1.0);
        let plain = Trial::of(commands);
        let named = [("yield_lag_s", lag), ("yield_y", lost), ("yield_y_s_per_rad", slowness), ("yield_x", 0.3), ("yield_x_s_per_rad", 50.0)];
        for (engine, _) in ENGINES {
            let path = unlisted(plain.clone(), &named).run(engine);
            let rigid = plain.run(engine);
            let end = ROW * f64::from(15 - first);
            let way = 5.0 / 7.0 * GRAVITY * integral(0.0, end, |t| (end - t) * away(t));
            let found = path[15][0] - rigid[15][0];
            assert_close(found, way, 0.02 * way.abs() + 1e-4, &format!("{engine:?}"));
            assert_close(path[15][1], 0.0, 1e-7, "it turns about y alone");
        }
    }
}

/// Each shape at a phase, with the phase across.
fn profiles(s: f64, across: f64) -> [f64; 8] {
    let bell = f64::exp(-0.5 * s * s);
    [
        f64::cos(s),
        f64::tanh(s),
        bell,
        -s * bell * f64::exp(0.5),
        bell * f64::exp(-0.5 * across * across),
        s,
        s * s,
        s * across,
    ]
}

#[test]
fn a_drag_of_power_zero_is_friction() {
    // It stops a marble, and holds it against a push that is less.
    let named = |push| {
        [
            ("drag_strength", 0.05),
            ("drag_power", 0.0),
            ("push_1_x_m_per_s2", push),
        ]
    };
    for (engine, _) in ENGINES {
        let trial = Trial {
            velocity: [0.05, 0.0],
            ..Trial::level(14)
        };
        let path = unlisted(trial, &named(0.0)).run(engine);
        assert_close(
            path[13][0],
            0.05 * 0.05 / 0.1,
            0.05 * SUBSTEP,
            &format!("{engine:?}"),
        );
        assert_close(path[13][0], path[12][0], 1e-7, "it rests");
        let held = unlisted(Trial::level(6), &named(0.04)).run(engine);
        assert_close(held[5][0], 0.0, 1e-7, "it is held");
        let moved = unlisted(Trial::level(6), &named(0.06)).run(engine);
        assert!(moved[5][0] > 1e-3, "it is moved in {engine:?}");
    }
}

/// The way along a path (m).
fn rolled(path: &[[f64; 2]]) -> f64 {
    path.windows(2)
        .map(|two| f64::hypot(two[1][0] - two[0][0], two[1][1] - two[0][1]))
        .sum()
}

#[test]
fn a_window_continues_the_path_of_the_whole_run() {
    let first = 9;
    let commands: Vec<[f64; 2]> = (0..24)
        .map(|row| {
            let t = f64::from(row);
            [0.01 * f64::sin(0.7 * t), 0.008 * f64::cos(0.5 * t)]
        })
        .collect();
    // The row before the window is one substep, so that its way gives the velocity.
    let durations: Vec<f64> = (0..24)
        .map(|row| match row {
            row if row == first - 1 => SUBSTEP,
            row => 0.04 + 0.01 * (row % 3) as f64,
        })
        .collect();
    let named = [
        ("push_1_x_m_per_s2", 0.1),
        ("wave_1_y_per_m", 30.0),
        ("rate_1_per_s", 11.0),
        ("phase_1_rad", 1.0),
        ("push_2_y_m_per_s2", -0.1),
        ("wave_2_x_per_m", -20.0),
        ("rate_2_per_s", 17.0),
        ("drag_strength", 0.05),
        ("drag_power", 1.5),
        ("side_strength", 0.03),
        ("shape_3", 1.0),
        ("brake_3_m_per_s2", 0.03),
        ("heading_3_x", 0.7),
        ("way_3_per_m", 2.0),
        ("shape_4", 2.0),
        ("gear_4_x", 0.3),
        ("gear_4_y", -0.4),
        ("rate_4_per_s", 0.8),
        ("mode_gain", 0.6),
        ("mode_rate_rad_per_s", 9.0),
        ("mode_damping", 0.1),
        ("yield_lag_s", 0.15),
        ("yield_x", 0.6),
        ("yield_y", 0.8),
        ("yield_x_s_per_rad", 40.0),
        ("yield_y_s_per_rad", 70.0),
    ];
    let whole = Trial {
        durations: Some(durations),
        ..unlisted(Trial::of(commands), &named)
    };
    for moves in [false, true] {
        let whole = if moves {
            whole.clone().with("lag", &[0.1])
        } else {
            whole.clone()
        };
        // The way by its rows is a little shorter than it was.
        for (engine, within) in [(Engine::Rolling, 1e-7), (Engine::Rapier, 1e-4)] {
            let path = whole.run(engine);
            let (before, start) = (path[first - 1], path[first]);
            let velocity = [0, 1].map(|axis| (start[axis] - before[axis]) / SUBSTEP);
            let window = Trial {
                start,
                velocity,
                first,
                rolled: rolled(&path[..=first]),
                ..whole.clone()
            };
            for (row, (found, expected)) in
                window.run(engine).iter().zip(&path[first..]).enumerate()
            {
                for axis in 0..2 {
                    let what = format!("row {row} of the window in {engine:?}");
                    assert_close(found[axis], expected[axis], within, &what);
                }
            }
        }
    }
}
