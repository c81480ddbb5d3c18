//! Where the marble touches board and rim, and the air around it.

use std::f64::consts::PI;

use labsim::Engine;
use labsim::board::GRAVITY;
use proptest::prelude::*;

use super::{ENGINES, ROW, SUBSTEP, SUBSTEPS, Trial, assert_close, assert_speeds, integral};

const FRICTION: f64 = 1e-3;

/// What rolling friction takes from the speed (m/s²).
const BRAKING: f64 = 5.0 / 7.0 * FRICTION * GRAVITY;

/// A marble that coasts on a level board with rolling friction.
fn coasting(start: [f64; 2], velocity: [f64; 2], rows: usize) -> Trial {
    Trial {
        friction: FRICTION,
        start,
        velocity,
        ..Trial::level(rows)
    }
}

/// A marble at rest on a board that tilts about y by so many times the rolling friction.
fn tilted(times: f64, rows: usize) -> Trial {
    Trial {
        friction: FRICTION,
        ..Trial::of(vec![[0.0, times * FRICTION]; rows])
    }
}

fn moves(engine: Engine, trial: &Trial) -> bool {
    let path = trial.run(engine);
    let [x, y] = path[path.len() - 1];
    x.abs() + y.abs() > 1e-5
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn with_stribecks_excess_a_marble_stops_short(strength in 0.2..3.0_f64, slow in 0.005..0.05_f64, speed in 0.01..0.03_f64) {
        let braking = |v: f64| BRAKING * (1.0 + strength * f64::exp(-v / slow));
        let expected = integral(0.0, speed, |v| v / braking(v));
        for (engine, _) in ENGINES {
            let trial = coasting([0.0; 2], [speed, 0.0], 60).with("stribeck", &[strength, slow]);
            let path = trial.run(engine);
            // Speeds are those of the substeps' ends.
            assert_close(path[59][0], expected, speed * SUBSTEP + 1e-5, &format!("{engine:?}"));
            assert_close(path[58][0], path[59][0], 1e-7, "it rests");
        }
    }

    #[test]
    fn a_patch_brakes_by_its_factor_from_rim_to_rim(factor in 0.2..3.0_f64, radius in 0.02..0.05_f64) {
        // Within the patch's rim the resistance passes from one to the other about its radius.
        let within = |x: f64| f64::midpoint(radius, x.clamp(-radius, radius)) * 2.0 - radius;
        let work = |x: f64| (x + 0.1) + (factor - 1.0) * (within(x) + radius);
        let speed = |x: f64| f64::sqrt(0.09 * 0.09 - 2.0 * BRAKING * work(x));
        for (engine, _) in ENGINES {
            let trial = coasting([-0.1, 0.0], [0.09, 0.0], 18).with("friction_patch", &[0.0, 0.0, radius, factor]);
            let way: Vec<f64> = trial.run(engine).iter().map(|place| place[0]).collect();
            assert_speeds(&way, speed, 2e-3, &format!("{engine:?}"));
        }
    }

    #[test]
    fn a_strip_brakes_by_its_factor_from_edge_to_edge(
        factor in 0.2..3.0_f64, width in 0.01..0.08_f64, angle in 1.0..2.1_f64, offset in -0.03..0.03_f64,
    ) {
        let (middle, half) = (-offset / f64::sin(angle), width / 2.0 / f64::sin(angle));
        let work = |x: f64| (x + 0.1) + (factor - 1.0) * ((x - middle).clamp(-half, half) + half);
        let speed = |x: f64| f64::sqrt(0.09 * 0.09 - 2.0 * BRAKING * work(x));
        for (engine, _) in ENGINES {
            let trial = coasting([-0.1, 0.0], [0.09, 0.0], 18);
            let path = trial.with("friction_strip", &[offset, angle, width, factor]).run(engine);
            let way: Vec<f64> = path.iter().map(|place| place[0]).collect();
            assert_speeds(&way, speed, 2e-3, &format!("{engine:?}"));
        }
    }

    #[test]
    fn along_the_frame_a_marble_runs_out_by_the_factor(
        factor in 0.5..4.0_f64, width in 0.004..0.02_f64, along_y: bool, far: bool,
    ) {
        let axis = usize::from(along_y);
        let side = if far { 1.0 } else { -1.0 };
        // How far the marble's edge is from the rim, and the share of the factor that it feels there.
        for (beside, share) in [(width - 0.0015, 1.0), (width, 0.5), (width + 0.0015, 0.0)] {
            for (engine, _) in ENGINES {
                let (mut start, mut velocity) = ([0.0; 2], [0.0; 2]);
                start[1 - axis] = side * (coasting(start, velocity, 1).rig.reach_m()[1 - axis] - beside);
                velocity[axis] = 0.02;
                let path = coasting(start, velocity, 80).with("frame_friction", &[width, factor]).run(engine);
                let expected = 0.02 * 0.02 / (2.0 * BRAKING * (1.0 + share * (factor - 1.0)));
                assert_close(path[79][axis], expected, 0.02 * SUBSTEP + 2e-5, &format!("{beside} m beside it in {engine:?}"));
            }
        }
    }

    #[test]
    fn break_away_grows_with_the_time_at_rest(ratio in 2.0..6.0_f64, rest_time in 0.1..1.0_f64, rows in 1..12_usize) {
        // It coasts for nine rows and a half, and rests until the board tilts.
        let speed = 0.95 * BRAKING;
        let rested = 0.05 + ROW * rows as f64;
        let grown = |rested: f64| 1.0 + (ratio - 1.0) * (1.0 - f64::exp(-rested / rest_time));
        for (engine, _) in ENGINES {
            let breaks_away = |times: f64| {
                let mut commands = vec![[0.0; 2]; 10 + rows];
                commands.extend([[0.0, times * FRICTION]; 12]);
                let trial = Trial { friction: FRICTION, velocity: [speed, 0.0], ..Trial::of(commands) };
                let path = trial.with("static_friction", &[ratio, rest_time]).run(engine);
                path[path.len() - 1][0] - path[10][0] > 1e-5
            };
            prop_assert!(!breaks_away(0.99 * grown(rested - 2.0 * SUBSTEP)), "{engine:?} below");
            prop_assert!(breaks_away(1.01 * grown(rested + 2.0 * SUBSTEP)), "{engine:?} above");
        }
    }

    #[test]
    fn a_marble_that_is_held_has_rested_long(ratio in 1.5..5.0_f64, rest_time in 0.1..1.0_f64) {
        for (engine, _) in ENGINES {
            let at = |times: f64| tilted(times * ratio, 12).with("static_friction", &[ratio, rest_time]);
            prop_assert!(!moves(engine, &at(0.99)), "{engine:?} below");
            prop_assert!(moves(engine, &at(1.01)), "{engine:?} above");
        }
    }

    #[test]
    fn a_resting_marble_breaks_away_at_the_ratio_and_then_rolls_as_any(ratio in 1.0..5.0_f64) {
        for (engine, _) in ENGINES {
            let at = |times: f64| tilted(times * ratio, 12).with("static_friction", &[ratio]);
            prop_assert!(!moves(engine, &at(0.99)), "{engine:?} below");
            prop_assert!(moves(engine, &at(1.01)), "{engine:?} above");
            let path = tilted(6.0, 12).with("static_friction", &[ratio]).run(engine);
            let plain = tilted(6.0, 12).run(engine);
            // What the first substep holds back stays behind: some speed.
            let lost = BRAKING * (ratio - 1.0) * SUBSTEP * 1.1;
            assert_close(path[11][0], plain[11][0], lost * 3.0 + 1e-6, &format!("{engine:?} once it rolls"));
        }
    }

    #[test]
    fn a_marble_that_would_turn_back_stays(ratio in 2.0..5.0_f64, part in 0.1..0.9_f64, speed in 0.005..0.03_f64) {
        // On a tilt that would roll a moving marble but not start a resting one, uphill first.
        let tilt = 1.0 + part * (ratio - 1.0);
        for (engine, _) in ENGINES {
            let trial = Trial { velocity: [-speed, 0.0], ..tilted(tilt, 80) };
            let path = trial.with("static_friction", &[ratio]).run(engine);
            let expected = -speed * speed / (2.0 * BRAKING * (1.0 + tilt));
            assert_close(path[79][0], expected, speed * SUBSTEP + 1e-5, &format!("{engine:?}"));
            assert_close(path[60][0], path[79][0], 1e-7, &format!("rest in {engine:?}"));
        }
    }

    #[test]
    fn wood_resists_by_its_grain(ratio in 1.2..5.0_f64, grain in 0.0..3.1_f64) {
        for (engine, _) in ENGINES {
            let along = |angle: f64| [f64::cos(angle), f64::sin(angle)];
            let effect = |trial: Trial| trial.with("anisotropic_friction", &[ratio, grain]);
            for (angle, resists) in [(grain, 1.0), (grain + std::f64::consts::FRAC_PI_2, ratio)] {
                let out = along(angle);
                let trial = coasting([0.0; 2], out.map(|x| 0.02 * x), 80);
                let end = effect(trial).run(engine)[79];
                let expected = 0.02 * 0.02 / (2.0 * BRAKING * resists);
                let way = end[0] * out[0] + end[1] * out[1];
                assert_close(way, expected, 0.02 * SUBSTEP + 1e-5, &format!("run-out at {angle} in {engine:?}"));
                let pushed = |times: f64| {
                    let tilt = times * resists * FRICTION;
                    let commands = vec![[-tilt * out[1], tilt * out[0]]; 12];
                    effect(Trial { friction: FRICTION, ..Trial::of(commands) })
                };
                prop_assert!(!moves(engine, &pushed(0.99)), "{engine:?} below at {angle}");
                prop_assert!(moves(engine, &pushed(1.02)), "{engine:?} above at {angle}");
            }
        }
    }

    #[test]
    fn between_the_axes_of_the_grain_the_resistance_is_that_of_an_ellipse(ratio in 1.2..4.0_f64, angle in 0.0..3.1_f64) {
        let (along, across) = (f64::cos(angle), ratio * f64::sin(angle));
        let expected = 0.02 * 0.02 / (2.0 * BRAKING * f64::hypot(along, across));
        for (engine, _) in ENGINES {
            let out = [f64::cos(angle), f64::sin(angle)];
            let trial = coasting([0.0; 2], out.map(|x| 0.02 * x), 80).with("anisotropic_friction", &[ratio, 0.0]);
            let end = trial.run(engine)[79];
            let way = end[0] * out[0] + end[1] * out[1];
            assert_close(way, expected, 0.02 * SUBSTEP + 1e-5, &format!("run-out in {engine:?}"));
            assert_close(end[0] * out[1], end[1] * out[0], 1e-6, "against the motion");
        }
    }

    #[test]
    fn drag_slows_a_coasting_marble_by_its_law(rate in 0.01..2.0_f64, coefficient in 0.0..20.0_f64) {
        for (engine, within) in ENGINES {
            let run = |name, value| Trial { velocity: [0.05, 0.0], ..Trial::level(20) }.with(name, &[value]).run(engine);
            let (viscous, quadratic) = (run("viscous_drag", rate), run("quadratic_drag", coefficient));
            // Rapier damps a velocity once the marble has moved by it.
            let first = usize::from(engine == Engine::Rolling);
            let sum = |row: usize, speed: &dyn Fn(f64) -> f64| -> f64 {
                let ends = first..first + row * SUBSTEPS;
                ends.map(|n| SUBSTEP * speed(SUBSTEP * n as f64)).sum()
            };
            for row in 0..20 {
                // The exponential, in steps of 1/(1 + c h).
                let left = |t: f64| 0.05 * f64::powf(1.0 + rate * SUBSTEP, -t / SUBSTEP);
                assert_close(viscous[row][0], sum(row, &left), within, &format!("viscous in {engine:?}, row {row}, {rate}"));
                let left = |t: f64| 0.05 / (1.0 + coefficient * 0.05 * t);
                assert_close(quadratic[row][0], sum(row, &left), within, &format!("quadratic in {engine:?}, row {row}, {coefficient}"));
            }
            let decayed = 0.05 / rate * (1.0 - f64::exp(-rate * 1.9));
            assert_close(viscous[19][0], decayed, 0.05 * SUBSTEP * (1.0 + rate), "exp(-c t)");
        }
    }

    #[test]
    fn a_side_force_leads_in_a_circle(rate in 0.5..1.0_f64, left: bool) {
        let (speed, rate) = (0.02, if left { rate } else { -rate });
        let radius = speed / rate;
        for (engine, _) in ENGINES {
            let trial = Trial { velocity: [speed, 0.0], ..Trial::level(120) };
            let path = trial.with("side_force", &[rate]).run(engine);
            for (row, place) in path.iter().enumerate() {
                let angle = rate * ROW * row as f64;
                let what = format!("row {row} in {engine:?}");
                assert_close(place[0], radius * f64::sin(angle), speed * SUBSTEP + 1e-4, &what);
                assert_close(place[1], radius * (1.0 - f64::cos(angle)), speed * SUBSTEP + 1e-4, &what);
            }
        }
    }

    /// v² + 10/7 g ε R cos α stays, with ε the offset and α = s/R + phase, s the way.
    #[test]
    fn an_eccentric_marble_ripples_with_its_circumference(
        offset in 0.002..0.01_f64, phase in 0.0..6.2_f64, heading in 0.0..6.2_f64,
    ) {
        let radius = Trial::level(1).rig.marble.radius_m;
        let height = |way: f64| 10.0 / 7.0 * GRAVITY * offset * radius * f64::cos(way / radius + phase);
        let speed = |way: f64| f64::sqrt(0.09 * 0.09 + height(0.0) - height(way));
        let out = [f64::cos(heading), f64::sin(heading)];
        for (engine, _) in ENGINES {
            let trial = Trial { velocity: out.map(|x| 0.09 * x), ..Trial::level(9) };
            let path = trial.with("eccentric_marble", &[offset, phase, 0.0, 1.0]).run(engine);
            let way: Vec<f64> = path.iter().map(|place| place[0] * out[0] + place[1] * out[1]).collect();
            assert_speeds(&way, speed, 6e-3, &format!("{engine:?}"));
        }
    }

    /// g + v²/R grows by exp(-10/7 ε cos α): potential energy, and inertia that changes from place to place.
    #[test]
    fn a_heavy_side_that_keeps_its_place_ripples_in_the_plane_it_lies_in(
        offset in 0.002..0.01_f64, phase in 0.0..6.2_f64, along_y: bool,
    ) {
        let radius = Trial::level(1).rig.marble.radius_m;
        let begin = GRAVITY + 0.09 * 0.09 / radius;
        let turned = |way: f64| f64::cos(phase) - f64::cos(way / radius + phase);
        let speed = |way: f64| {
            let grown = begin * f64::exp(10.0 / 7.0 * offset * turned(way));
            f64::sqrt((grown - GRAVITY) * radius)
        };
        // A heavy side ahead of the top along y leans; one below it does so from the bottom.
        let below = if f64::cos(phase) < 0.0 { PI } else { 0.0 };
        let (velocity, angles) = if along_y {
            ([0.0, 0.09], [below, f64::asin(f64::sin(phase))])
        } else {
            ([0.09, 0.0], [phase, 0.0])
        };
        for (engine, _) in ENGINES {
            let trial = Trial { velocity, ..Trial::level(9) };
            let path = trial.with("eccentric_marble", &[offset, angles[0], angles[1], 0.0]).run(engine);
            let way: Vec<f64> = path.iter().map(|place| place[usize::from(along_y)]).collect();
            assert_speeds(&way, speed, 6e-3, &format!("{engine:?}"));
        }
    }

    #[test]
    fn a_livelier_rim_is_a_rim_of_that_restitution(own in 0.0..0.5_f64, increase in -0.5..0.45_f64) {
        for (engine, _) in ENGINES {
            let mut trial = Trial { start: [0.08, 0.0], velocity: [0.2, 0.1], ..Trial::level(30) };
            trial.rig.board.wall_restitution = own;
            let found = trial.clone().with("wall_restitution", &[increase]).run(engine);
            trial.rig.board.wall_restitution = (own + increase).clamp(0.0, 0.95);
            prop_assert_eq!(found, trial.run(engine));
        }
    }

    #[test]
    fn a_rougher_rim_is_a_rim_of_that_friction(own in 0.0..0.5_f64, increase in -0.5..0.5_f64) {
        for (engine, _) in ENGINES {
            let mut trial = Trial { start: [0.08, 0.0], velocity: [0.2, 0.1], ..Trial::level(30) };
            trial.rig.board.wall_friction = own;
            let found = trial.clone().with("wall_restitution", &[0.0, 0.0, increase]).run(engine);
            trial.rig.board.wall_friction = (own + increase).max(0.0);
            prop_assert_eq!(found, trial.run(engine));
        }
    }

    #[test]
    fn a_restitution_falls_with_a_power_of_the_speed(
        expected in 0.45..0.95_f64, falloff in -0.5..1.0_f64, speed in 0.1..0.6_f64,
    ) {
        // e = own (v / 0.1 m/s)^-falloff. A marble that keeps more than 2/5 of its speed rolls away for good.
        let own = expected * (speed / 0.1).powf(falloff);
        prop_assume!(own <= 1.0);
        for (engine, _) in ENGINES {
            let start = [0.1, 0.0];
            let mut trial = Trial { start, velocity: [speed, 0.0], ..Trial::level(14) };
            trial.rig.board.wall_friction = 0.0;
            trial.rig.board.wall_restitution = own;
            let found = trial.clone().with("wall_restitution", &[0.0, falloff]).run(engine);
            trial.rig.board.wall_restitution = expected;
            let apart = found.iter().zip(trial.run(engine)).map(|(a, b)| (a[0] - b[0]).abs());
            let most = apart.fold(0.0, f64::max);
            prop_assert!(most < 1e-3 * speed * 14.0 * ROW, "{engine:?}: {most} m apart");
        }
    }
}

#[test]
fn no_rim_becomes_perfect_or_less_than_dead() {
    for (engine, _) in ENGINES {
        for (own, increase, expected) in [(0.5, 0.9, 0.95), (0.97, 0.9, 0.97), (0.3, -0.9, 0.0)] {
            let mut trial = Trial {
                velocity: [0.4, 0.1],
                ..Trial::level(12)
            };
            trial.rig.board.wall_restitution = own;
            let found = trial
                .clone()
                .with("wall_restitution", &[increase])
                .run(engine);
            trial.rig.board.wall_restitution = expected;
            assert_eq!(
                found,
                trial.run(engine),
                "{own} and {increase} in {engine:?}"
            );
        }
    }
}

#[test]
fn friction_against_spins_is_the_boards() {
    for (engine, _) in ENGINES {
        let mut trial = Trial {
            velocity: [0.5, 0.2],
            ..Trial::level(60)
        };
        let plain = trial.run(engine);
        let found = trial
            .clone()
            .with("spinning_friction", &[0.001])
            .run(engine);
        assert_ne!(found, plain, "{engine:?}");
        trial.rig.board.spinning_friction = 0.001;
        assert_eq!(found, trial.run(engine), "{engine:?}");
    }
}

#[test]
fn a_rebound_is_as_lively_as_the_effect_says() {
    // Against a smooth rim v becomes -e v and the spin stays; rolling again, w = (2 - 5 e) v / 7.
    for (engine, _) in ENGINES {
        let mut trial = Trial {
            velocity: [0.5, 0.0],
            ..Trial::level(12)
        };
        trial.rig.board.wall_friction = 0.0;
        let path = trial.with("wall_restitution", &[0.8]).run(engine);
        let speed = (path[11][0] - path[10][0]) / ROW;
        assert_close(
            speed,
            0.5 * (2.0 - 5.0 * 0.8) / 7.0,
            1e-3,
            &format!("{engine:?}"),
        );
    }
}

#[test]
fn an_eccentric_marble_at_rest_stays() {
    for (engine, _) in ENGINES {
        let path = Trial::level(5)
            .with("eccentric_marble", &[0.01, 1.0, 0.0, 1.0])
            .run(engine);
        assert_eq!(path, vec![[0.0; 2]; 5], "{engine:?}");
    }
}

/// A marble whose heavy side keeps its place is a pendulum: it swings about where the heavy side is below.
#[test]
fn a_marble_let_go_with_its_heavy_side_aside_swings() {
    for (engine, _) in ENGINES {
        let path = Trial::level(600)
            .with("eccentric_marble", &[0.01, 2.5, 0.4, 0.0])
            .run(engine);
        let radius = Trial::level(1).rig.marble.radius_m;
        let far = |axis: usize| {
            path.iter()
                .map(|place| place[axis].abs())
                .fold(0.0, f64::max)
        };
        assert!(far(0) > 0.5 * radius && far(1) > 0.5 * radius, "{engine:?}");
        // It comes back to where it was let go, after turning by twice the angle to below.
        let furthest = far(0).hypot(far(1));
        let below = f64::acos(-f64::cos(2.5) * f64::cos(0.4));
        assert_close(furthest, 2.0 * below * radius, 5e-4, &format!("{engine:?}"));
        let near = |place: &[f64; 2]| place[0].hypot(place[1]) < 2e-4;
        assert!(path[100..].iter().any(near), "{engine:?}");
    }
}

#[test]
fn a_heavy_side_keeps_its_length_however_far_the_marble_rolls() {
    // In two minutes of circles about a leaning axis the marble neither gains speed nor loses it.
    let trial = Trial {
        velocity: [0.05, 0.0],
        ..Trial::level(1200)
    };
    let path = trial
        .with("eccentric_marble", &[0.0005, 1.0, 0.0, 1.0])
        .with("side_force", &[1.0])
        .run(Engine::Rolling);
    let speed = |row: usize| {
        f64::hypot(
            path[row][0] - path[row - 1][0],
            path[row][1] - path[row - 1][1],
        ) / ROW
    };
    for row in 1..1200 {
        assert_close(speed(row), 0.05, 0.01, &format!("row {row}"));
    }
}
